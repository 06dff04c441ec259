"""How many cells of a patch does a certified distance need, for each bound of a cell?

The search takes cells in the order of their upper bounds of the distance from the other patch, cuts them in two, and
records the largest remaining bound. The bounds of common_surface_bounds.py in NumPy are:

- Lipschitz: the distance in the middle plus half of the largest possible length of the cell;
- one foot: the largest coefficient of the squared distance from it;
- a moving foot, which follows an affine map of the parameters;
- two branches of moving feet in the best convex combination.

They are compared with jhd's own search, at tolerances from coarse to fine. Its bound also uses tangent planes of the
squared distance, ties of branches and sides of cells (jhd._distance.cells.weighted). If the distance is constant, it
follows feet to higher order. The distance of three pairs is known exactly: a maximum with parallel surfaces, a maximum
on a ridge with two equally near feet, and two planes at constant distance, one with curved parameters.

Claims: all bounds of jhd enclose the exact distance, and it closes to 1e-10 of the diagonal with fewer than a hundred
cells on each pair, and fewer than any other bound takes. Between two feet no other is below 1e-5 after 129 cells; if
the tangent planes are parallel, moving feet reach the tolerance too, with more than twice as many cells.

Feeds: figure and table "cells of surfaces".
Takes: 1 minute (30 CPU seconds).
"""

import heapq
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from common import Run, markdown
from common_surface_bounds import FAMILIES, Patch, Rectangle

import jhd
from jhd._results.solution import name_of

_CELLS, _SMOKE_CELLS = 129, 33
_TOLERANCES, _SMOKE_TOLERANCES = 10.0 ** -np.arange(2.0, 11.0), (1e-10,)
# Loss of accuracy of values at nodes; smaller gaps do not count.
_ROUNDING = 1e-11
_GOAL = 1e-10


class KnownPair(NamedTuple):
    """Two patches and the exact directed distance."""

    a: Patch
    b: Patch
    exact: float


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    found, rows = {}, []
    pairs = _pairs()
    for name in ["ridge"] if run.smoke else list(pairs):
        pair = pairs[name]
        size = _diagonal(pair)
        most = _SMOKE_CELLS if run.smoke else _CELLS
        searches = {family: _search(pair, bound, most, size) for family, bound in FAMILIES.items()}
        searches["jhd"] = _ours(pair, _SMOKE_TOLERANCES if run.smoke else _TOLERANCES, size)
        found[name] = {"exact": pair.exact, "diagonal": size, "searches": searches}
        for family, search in searches.items():
            row = [name, family, int(search["cells"][-1]), f"{search['gap'][-1]:.1e}"]
            rows.append([*row, *(_reached(search, goal) for goal in (1e-2, 1e-4, 1e-6, _GOAL))])
    header = ["pair", "bound", "cells", "gap", "cells to 1e-2", "1e-4", "1e-6", "1e-10"]
    run.save({"goal": _GOAL, "pairs": found}, markdown(header, rows))


def _pairs() -> dict[str, KnownPair]:
    """Return patches (x, y, z) over x and z; the parameters of x = z = 0 are off the middle."""
    x, z = np.array([-0.75, 2.25]), np.array([-0.55, 1.0])
    wide, long = np.array([-1.5, 3.0]), np.array([-1.0, 2.0])
    flat = np.zeros((4, 3, 3))
    flat[0, 0], flat[1, 0, 0], flat[0, 1, 2] = [0.2, 1.0, 0.2], 0.6, 0.6
    bent = np.zeros((4, 3, 3))
    # In one plane, at parameters that are not affine ones.
    bent[1, 0, 0], bent[2, 0, 0], bent[3, 0, 0], bent[0, 1, 2], bent[0, 2, 2], bent[1, 1, 0] = (
        0.8,
        0.5,
        -0.3,
        0.8,
        0.2,
        0.1,
    )
    return {
        "parallel": KnownPair(
            _graph(x, z, lambda p: -1 + 0.5 * p[0] ** 2 + 0.25 * p[0] ** 3 + 0.25 * p[1] ** 2),
            _graph(wide, long, lambda p: 0.5 * p[0] ** 2 + 0.125 * p[0] ** 3),
            1.0,
        ),
        "ridge": KnownPair(
            _graph(x, z, lambda p: 2 + 0.5 * p[0] - 0.25 * p[0] ** 2 - 0.25 * p[1] ** 2),
            _graph(2 * wide, long, lambda p: p[0] ** 2),
            float(np.sqrt(7) / 2),
        ),
        "planes": KnownPair(Patch(flat), Patch(bent), 1.0),
    }


def _graph(x: np.ndarray, z: np.ndarray, height: Callable[[Any], Any]) -> Patch:
    """Return the graph of a polynomial of degrees 3 and 2 over a rectangle, by its values."""
    u, v = np.linspace(0, 1, 4), np.linspace(0, 1, 3)
    places = x[0] + x[1] * u[:, None] + 0 * v, z[0] + z[1] * v + 0 * u[:, None]
    points = np.stack([places[0], height(places), places[1]], axis=-1)
    first, second = (np.linalg.inv(np.vander(t, increasing=True)) for t in (u, v))
    return Patch(np.einsum("iu,jv,uvk->ijk", first, second, points))


def _diagonal(pair: KnownPair) -> float:
    rows = np.concatenate([_bezier(p).reshape(-1, 3) for p in (pair.a, pair.b)])
    return float(np.linalg.norm(np.ptp(rows, axis=0)))


def _bezier(patch: Patch) -> np.ndarray:
    """Return control points."""
    rows = patch.rows
    for axis in range(2):
        n = rows.shape[axis] - 1
        nodes = np.linspace(0, 1, n + 1)
        basis = np.array([[_bernstein(n, i, t) for i in range(n + 1)] for t in nodes])
        matrix = np.linalg.solve(basis, np.vander(nodes, increasing=True))
        rows = np.moveaxis(np.tensordot(matrix, rows, axes=(1, axis)), 0, axis)
    return rows


def _bernstein(n: int, i: int, t: float) -> float:
    binomial = np.prod([(n - k) / (k + 1) for k in range(i)]) if i else 1.0
    return float(binomial * t**i * (1 - t) ** (n - i))


def _search(pair: KnownPair, bound: Callable[..., float], most: int, size: float) -> dict[str, Any]:
    """Return the largest remaining bound against the number of bounded cells."""
    whole = Rectangle(np.zeros(2), np.ones(2))
    heap, count = [(-bound(pair.a, pair.b, whole), 0, whole)], 1
    cells, gaps = [count], [-heap[0][0] - pair.exact]
    while count < most and gaps[-1] > max(_GOAL, _ROUNDING) * size:
        above, _, cell = heapq.heappop(heap)
        for part in cell.halves():
            count += 1
            # A bound of a cell holds for its parts.
            heapq.heappush(heap, (max(-bound(pair.a, pair.b, part), above), count, part))
        cells.append(count)
        gaps.append(-heap[0][0] - pair.exact)
    return {"cells": np.array(cells), "gap": np.array(gaps) / size}


def _ours(pair: KnownPair, tolerances: Any, size: float) -> dict[str, Any]:
    """Return cells and gaps of the package at each tolerance."""
    a, b = (jhd.BezierPatch(_bezier(p)) for p in (pair.a, pair.b))
    found = [jhd.directed_hausdorff(a, b, jhd.BranchAndBound(atol=t * size), throw=False) for t in tolerances]
    # Control points are rounded, so that the stored distance differs in the last digits.
    room = 1e-14 * size
    enclosed = all(float(x.lower) - room <= pair.exact <= float(x.upper) + room for x in found)
    return {
        "cells": np.array([int(x.stats["cells"]) for x in found]),
        "gap": np.array([max(float(x.upper) - pair.exact, 1e-16) for x in found]) / size,
        "enclosed": enclosed,
        "results": [name_of(x.result) for x in found],
        "between": np.array([float(x.upper - x.lower) for x in found]) / size,
    }


def _reached(search: dict[str, Any], goal: float) -> str:
    below = np.flatnonzero(search["gap"] <= goal)
    return str(int(search["cells"][below[0]])) if len(below) else "-"


if __name__ == "__main__":
    main()
