"""Derivatives of functions by differences of their values."""

import numpy as np

# Of the differences over one and two steps such that their terms of third order cancel: where feet are known to 1e-13,
# differences of second order know a derivative to 1e-8 at best, these to 1e-9.
_CENTRAL = {1: 2 / 3, 2: -1 / 12}


def differences(function, arrays, directions, step):
    """The derivatives along directions of the arrays that the function returns, to fourth order in the step."""

    def at(steps):
        moved = [x + steps * step * d for x, d in zip(arrays, directions, strict=True)]
        return [np.asarray(x) for x in function(*moved)]

    pairs = [(share, at(steps), at(-steps)) for steps, share in _CENTRAL.items()]
    return [sum(share * (x[k] - y[k]) for share, x, y in pairs) / step for k in range(len(pairs[0][1]))]
