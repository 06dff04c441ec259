"""Multipliers with which several feet prove the bound of a cell if no single foot does.

The slack of a foot is the squared bound less the squared distance. Let q be the point of the cell at which the largest
slack is smallest. At q two or more slacks are equal, and about zero if the bound is sharp. A combination of them is not
negative about q only if it has no slope there, and bends upward. Affine multipliers can achieve both: they grow where
their slack grows. So linear programs in a shrinking region first find q, and another one then finds the multipliers,
over samples that are dense near q.
"""

from collections.abc import Callable

import numpy as np

# Fractions of the way from q to a corner, or to the middle of two, at which samples lie.
_SHARES = 2.0 ** -np.arange(1, 25)
# The difference quotients that stand for slopes, and the steps towards q.
_DIFFERENCE, _STEPS = 1e-6, 40
# A slack that is smaller by this fraction of the largest one belongs to a foot that is far away.
_FAR = 1e-2
# Multipliers are rounded to multiples of this fraction of their sum.
_BITS = 2.0**30

# Evaluates slacks (feet, samples) at barycentric coordinates (samples, corners).
Slack = Callable[[np.ndarray], np.ndarray]


def multipliers(slack: Slack, grid: np.ndarray) -> list[list[float]] | None:
    """Affine multipliers, by their values at the corners, for which the sum of the slacks is positive on samples.

    Args:
        slack: evaluates the slacks at any points of the cell.
        grid: a few points all over the cell.

    Returns:
        A row for each foot, or None if none are found.
    """
    corners = grid.shape[1]
    q = _tightest(slack, grid)
    towards = np.concatenate([np.eye(corners), 0.5 * (np.eye(corners) + np.roll(np.eye(corners), 1, axis=1))])
    near = q + (_SHARES[:, None, None] * (towards - q)).reshape(-1, corners)
    places = np.concatenate([grid, near])
    wanted = np.append(np.ones(len(grid)), np.repeat(_SHARES, len(towards)))
    slacks, here = slack(places), slack(q[None])[:, 0]
    # Feet that are far at q would hide the others there; they take part only if the others do not suffice.
    for active in (here >= here.max() - _FAR * np.max(np.abs(slacks)), np.ones(len(here), bool)):
        rows = _solved(slacks[active], places, wanted)
        if rows is not None:
            found = iter(rows)
            return [next(found) if each else [0.0] for each in active]
    return None


def _tightest(slack: Slack, grid: np.ndarray) -> np.ndarray:
    """Return the point at which the largest slack is smallest."""
    values = np.max(slack(grid), axis=0)
    q, best, reach = grid[np.argmin(values)], float(values.min()), 0.25
    corners = np.eye(grid.shape[1])
    for _ in range(_STEPS):
        rows = slack(np.concatenate([q[None], q + _DIFFERENCE * (corners - q)]))
        step = _step(rows[:, 0], (rows[:, 1:] - rows[:, :1]) / _DIFFERENCE, reach)
        tried = q + step @ (corners - q)
        value = float(np.max(slack(tried[None])))
        if value < best:
            q, best = tried, value
        else:
            reach *= 0.35
        if reach < 1e-9:
            break
    return q


def _step(values: np.ndarray, slopes: np.ndarray, reach: float) -> np.ndarray:
    """Return the step towards each corner that makes the largest of the values, taken as linear, smallest."""
    from scipy.optimize import linprog

    count = slopes.shape[1]
    size = max(float(np.max(np.abs(slopes))), 1e-300)
    above = np.concatenate([slopes / size, -np.ones((len(values), 1))], axis=1)
    total = np.append(np.ones(count), 0.0)[None]
    limits = np.append(-(values - values.max()) / (size * reach), 1.0)
    bounds = [(0, None)] * count + [(None, None)]
    done = linprog(np.append(np.zeros(count), 1.0), A_ub=np.concatenate([above, total]), b_ub=limits, bounds=bounds)
    return reach * done.x[:count] if done.status == 0 else np.zeros(count)


def _solved(slacks: np.ndarray, places: np.ndarray, wanted: np.ndarray) -> list[list[float]] | None:
    """Multipliers for which all sums, as fractions of the largest slack there, are at least `wanted` times a number.

    The number is maximized; None if it cannot be positive.
    """
    from scipy.optimize import linprog

    sizes = np.maximum(np.max(np.abs(slacks), axis=0), 1e-300)
    terms = np.einsum("ks,sc->skc", slacks / sizes, places).reshape(len(places), -1)
    cost = np.append(np.zeros(terms.shape[1]), -1.0)
    total = np.append(np.ones(terms.shape[1]), 0.0)[None]
    above = np.concatenate([-terms, wanted[:, None]], axis=1)
    bounds = [(0, None)] * terms.shape[1] + [(None, 1)]
    done = linprog(cost, A_ub=above, b_ub=np.zeros(len(places)), A_eq=total, b_eq=[1.0], bounds=bounds)
    if done.status != 0 or done.x[-1] <= 0:
        return None
    return (np.round(done.x[:-1] * _BITS) / _BITS).reshape(len(slacks), -1).tolist()
