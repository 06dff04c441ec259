"""The pairs that may be within a threshold by their signatures, without looking at all of them.

Distances from one of the points, sorted, leave for each shape a window of others; all points are compared within it.
"""

from collections.abc import Iterator

import numpy as np

from jhd.distance.many.signatures import SignatureBounds, Signatures

# Shapes whose windows are looked at together.
_TOGETHER = 64


def candidates(a: Signatures, b: Signatures, threshold: float, same: bool) -> Iterator[tuple[np.ndarray, ...]]:
    """Yields rows, columns, lower and upper bounds of the pairs that are not proven to be farther apart.

    Args:
        a: of the first shapes.
        b: of the second ones.
        threshold: a length in their unit.
        same: whether both are the same; then each pair comes once, the smaller index first.
    """
    bounds = SignatureBounds(a, b)
    with np.errstate(invalid="ignore"):
        spread = np.where(np.all(np.isfinite(a.upper), axis=0), np.std(a.upper, axis=0), 0.0)
    pivot = int(np.argmax(spread))
    order_a, order_b = (np.argsort(x.lower[:, pivot], kind="stable") for x in (a, b))
    keys = b.lower[order_b, pivot]
    # A key is at most this much below the distance that it stands for.
    slack = np.max(b.upper[:, pivot] - b.lower[:, pivot])
    for start in range(0, len(order_a), _TOGETHER):
        rows = order_a[start : start + _TOGETHER]
        least, most = a.lower[rows, pivot].min(), a.upper[rows, pivot].max()
        # Widened by far more than the rounding of these sums.
        margin = (threshold + slack) * (1 + 1e-9) + 1e-9 * abs(most)
        first = int(np.searchsorted(keys, least - margin))
        last = int(np.searchsorted(keys, most + margin, "right"))
        columns = order_b[first:last]
        if not len(columns):
            continue
        lower, upper = bounds.between(rows, columns)
        near = lower <= threshold
        if same:
            near &= columns[None, :] > rows[:, None]
        i, j = np.nonzero(near)
        yield rows[i], columns[j], lower[i, j], upper[i, j]
