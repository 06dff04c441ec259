"""How fast does an upper bound of the distance over a cell converge, and how many cells does a search need?

Four bounds on cells, parameter intervals of width h: (i) Lipschitz, the distance at the middle plus half the largest
possible length of the cell; (ii) one branch, the largest Bernstein coefficient of |A - B(sigma)|^2 for a map sigma
through the feet; (iii) lambda, the best convex combination of the branches from both ends; (iv) ours,
`jhd._distance.cells.branches.cell_upper_bound`: both branches split at their peak. The first three are written in NumPy
in common_bounds.py.

Two pairs have an exactly known distance, attained at an antipodal and at a one-to-two maximum, around which the cells
shrink. Two more pairs are coincident: a straight segment written as two cubics, and a quarter circle with two sets of
weights, related by a Moebius map. There the bound is the mismatch of the map itself. Maps are compared: affine, cubic
Hermite, Moebius. The second part cuts cells in the order of their bounds, and follows the largest remaining bound. Our
bound is also tried with cells cut at their peak, as in the package.

Theory: the map misses the foot by O(h^p) with p = 2 (affine), 3 (Moebius), 4 (cubic). So the distance errs by O(h^2p)
if it is not zero, because a foot is a minimum, and by O(h^p) if it is zero; (iv) adds nothing to this error. (i) is of
first order. (ii) is of second order if one branch has a smooth top, and of first order at a crossing of two branches;
(iii) is of second order.

Claims: the fitted slopes confirm these orders. Ours is of order 8 at both maxima (with an affine map 4), and on
coincident curves of order 4. It is exact if the parametrizations differ by a Moebius map, as soon as its few Newton
steps reach the feet (h < 1/8). A search for 1e-10 of the diagonal bounds 3 cells at a maximum, at most 9 if cells are
halved, against 27 to 71. With Lipschitz bounds at an antipodal maximum it needs more cells than is practical. The
kernel levels off at its allowance for rounding, some 1e-14, which the fits leave out.

Feeds: figures and tables "convergence of upper bounds" and "cells of a search".
Takes: 1 minute, 20 seconds once compiled.
"""

import heapq
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from common import Run, markdown
from common_bounds import (
    Interval,
    branches,
    combined,
    feet,
    homogeneous,
    jet,
    lipschitz,
    one_branch,
    split_at_peak,
)

import jhd
from jhd._distance.cells.branches import CurveCell, cell_upper_bound
from jhd._distance.normalization.curves import prepare

# Parameter of the maximum in the cells of the first part; the middle would be a special case.
_PLACE = 0.4
# Slopes are fitted to the last points that stay this far above the floor of rounding.
_FITTED, _ABOVE = 5, 50.0
# Rounding of the bounds in NumPy, as a fraction of the diagonal.
_ROUNDING = 2e-15
# A search ends if the gap of its largest bound is at most this fraction of the diagonal, the package's default.
_GOAL = 1e-10
# If a peak is nearer than this fraction of the cell to an end, it is no cut, as in the package.
_NEAR_END = 0.02

# Control points of both curves, their weights, the distance and the parameter of the maximum; all numbers are exact.
_DATA = {
    # y = -1 + x^2/2 + x^3/4 below y = x^2/2 + x^3/8: farthest at x = 0, where both are level.
    "antipodal": (
        ((-0.75, -0.82421875), (0.0, -1.0703125), (0.75, -1.421875), (1.5, 0.96875)),
        ((-1.5, 0.703125), (-0.5, 0.046875), (0.5, -0.796875), (1.5, 1.546875)),
        (None, None),
        (1.0, 1 / 3),
    ),
    # y = 2 + x/2 - x^2/4 above y = x^2: at x = 0 the point is (0, 2), whose feet are at x^2 = 3/2.
    "one_to_two": (
        ((-0.5, 1.6875), (0.125, 2.15625), (0.75, 2.234375)),
        ((-2.0, 4.0), (0.0, -4.0), (2.0, 4.0)),
        (None, None),
        (np.sqrt(7) / 2, 0.4),
    ),
    # No curved cubic has a cubic parametrization but the affine ones.
    "coincident_line": (
        ((0.0, 0.0), (1.0, 0.5), (2.0, 1.0), (3.0, 1.5)),
        ((0.0, 0.0), (0.75, 0.375), (1.25, 0.625), (3.0, 1.5)),
        (None, None),
        (0.0, 0.4),
    ),
    "coincident_circle": (
        ((1.0, 0.0), (1.0, 1.0), (0.0, 1.0)),
        ((1.0, 0.0), (1.0, 1.0), (0.0, 1.0)),
        ((1.0, 1.0, 2.0), (1.0, 2.0, 8.0)),
        (0.0, 0.4),
    ),
}


class Pair:
    """Two segments in the package's common coordinates; gaps are in units of the diagonal of their box.

    Args:
        rows: control points of both curves.
        weights: their weights.
        known: the directed distance and the parameter of its maximum.
        kernel: the package's bound over a cell, compiled.
    """

    def __init__(self, rows: tuple, weights: tuple, known: tuple[float, float], kernel: Callable[..., Any]):
        curves = (jhd.BezierCurve(x, w).segments() for x, w in zip(rows, weights, strict=True))
        self.p, self.q, frame = prepare(*curves)
        self.a, self.b = (
            homogeneous(np.asarray(c.control_points)[0], None if c.weights is None else np.asarray(c.weights)[0])
            for c in (self.p, self.q)
        )
        points = np.concatenate(rows)
        self.unit = float(frame.length(1.0)) / float(np.linalg.norm(np.ptp(points, axis=0)))
        self.kernel = kernel
        self.exact, self.t = float(frame.common(known[0])), known[1]

    def gap(self, upper: float) -> float:
        """Return the excess of a bound over the distance, in diagonals."""
        return (upper - self.exact) * self.unit

    def foot(self, t: float) -> tuple[float, float]:
        """Return the parameter of the foot of a point of a, and its distance."""
        return feet(self.b, jet(self.a, t)[0])


class Bound(NamedTuple):
    """An upper bound over a cell, and the parameter of its cut."""

    upper: float
    cut: float


def _middle(cell: Interval) -> float:
    return 0.5 * (cell.t0 + cell.t1)


def _lipschitz(pair: Pair, cell: Interval) -> Bound:
    return Bound(lipschitz(pair.a, cell, pair.foot(_middle(cell))[1]), _middle(cell))


def _of_branches(kind: str, bound: Callable[[list[np.ndarray]], float]) -> Callable[[Pair, Interval], Bound]:
    """Return a bound that takes both branches, with a map of this kind."""
    return lambda pair, cell: Bound(bound(branches(pair.a, pair.b, cell, kind)), _middle(cell))


def _ours(pair: Pair, cell: Interval) -> Bound:
    """Compute the package's bound; the cell is cut at its peak if that lies inside."""
    found = pair.kernel(pair.p, pair.q, CurveCell(*map(jnp.asarray, (0, cell.t0, cell.t1, 0, cell.s0, 0, cell.s1))))
    share = (float(found.t) - cell.t0) / (cell.t1 - cell.t0)
    inside = _NEAR_END < share < 1 - _NEAR_END
    return Bound(float(found.upper), float(found.t) if inside else _middle(cell))


def _ours_halved(pair: Pair, cell: Interval) -> Bound:
    return Bound(_ours(pair, cell).upper, _middle(cell))


_FAMILIES: dict[str, Callable[[Pair, Interval], Bound]] = {
    "Lipschitz": _lipschitz,
    "one branch": _of_branches("cubic", one_branch),
    "lambda": _of_branches("cubic", combined),
    "ours, affine map": _of_branches("affine", split_at_peak),
    "affine map": _of_branches("affine", one_branch),
    "cubic map": _of_branches("cubic", one_branch),
    "Moebius map": _of_branches("Moebius", one_branch),
    "ours": _ours,
    "ours, halved": _ours_halved,
}
# The bounds measured on each pair, with their orders by theory; None if the bound is exact.
_LOCAL: dict[str, dict[str, int | None]] = {
    "antipodal": {"Lipschitz": 1, "one branch": 2, "lambda": 2, "ours, affine map": 4, "ours": 8},
    "one_to_two": {"Lipschitz": 1, "one branch": 1, "lambda": 2, "ours, affine map": 4, "ours": 8},
    "coincident_line": {"Lipschitz": 1, "affine map": 2, "Moebius map": 3, "ours": 4},
    "coincident_circle": {"affine map": 2, "cubic map": 4, "ours": None},
}
_SEARCHED = {
    "antipodal": ("Lipschitz", "one branch", "lambda", "ours, halved", "ours"),
    "one_to_two": ("Lipschitz", "one branch", "lambda", "ours, halved", "ours"),
    "coincident_line": ("Lipschitz", "affine map", "Moebius map", "ours"),
    "coincident_circle": ("affine map", "cubic map", "ours"),
}


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    halvings, most = (6, 40) if run.smoke else (14, 1500)
    widths = 2.0 ** -(np.arange(2, 2 * halvings + 1) / 2)
    kernel = jax.jit(cell_upper_bound, compiler_options=run.options)
    pairs = {name: Pair((data[0], data[1]), data[2], data[3], kernel) for name, data in _DATA.items()}
    local = {
        name: {family: _local(pair, family, widths, order) for family, order in _LOCAL[name].items()}
        for name, pair in pairs.items()
    }
    cells = {name: {family: _cells(pair, family, most) for family in _SEARCHED[name]} for name, pair in pairs.items()}
    table = _local_table(local) + "\n\n" + _cells_table(cells)
    run.save({"goal": _GOAL, "most": most, "width": widths, "local": local, "cells": cells}, table)


def _local(pair: Pair, family: str, widths: np.ndarray, order: int | None) -> dict[str, Any]:
    """Return gaps of cells of these widths around the maximum, the floor of rounding, and the slope fitted above it."""
    gaps = []
    for width in widths:
        t0 = pair.t - _PLACE * width
        t1 = t0 + width
        cell = Interval(t0, t1, pair.foot(t0)[0], pair.foot(t1)[0])
        gaps.append(pair.gap(_FAMILIES[family](pair, cell).upper))
    found = np.array(gaps)
    floor = max(_ROUNDING, float(np.min(np.abs(found))) if family == "ours" else 0.0)
    above = np.flatnonzero(found > _ABOVE * floor)[-_FITTED:]
    fitted = len(above) >= 3 and order is not None
    slope = np.polyfit(np.log(widths[above]), np.log(found[above]), 1)[0] if fitted else None
    return {"gap": found, "floor": floor, "fitted": above, "slope": slope, "order": order}


def _cells(pair: Pair, family: str, most: int) -> dict[str, Any]:
    """Cut the cell with the largest bound repeatedly; return this bound's gap against the number of bounded cells."""
    bound = _FAMILIES[family]
    first = Interval(0.0, 1.0, pair.foot(0.0)[0], pair.foot(1.0)[0])
    found = bound(pair, first)
    heap, count = [(-found.upper, found.cut, first)], 1
    counts, gaps = [], []
    while True:
        gap = pair.gap(-heap[0][0])
        if not gaps or gap < gaps[-1]:
            counts.append(count)
            gaps.append(gap)
        if gap <= _GOAL or count + 2 > most:
            return {"count": counts, "gap": gaps}
        upper, cut, cell = heapq.heappop(heap)
        s = pair.foot(cut)[0]
        for child in (cell._replace(t1=cut, s1=s), cell._replace(t0=cut, s0=s)):
            found = bound(pair, child)
            # A bound of the whole cell holds for its parts.
            heapq.heappush(heap, (max(-found.upper, upper), found.cut, child))
            count += 1


def _local_table(local: dict[str, Any]) -> str:
    header = ["pair", "bound", "order by theory", "slope fitted", "gap at the widest cell", "floor"]
    rows = [
        [
            pair,
            family,
            "exact" if entry["order"] is None else entry["order"],
            "" if entry["slope"] is None else f"{entry['slope']:.2f}",
            f"{entry['gap'][0]:.1e}",
            f"{entry['floor']:.1e}" if family == "ours" else "",
        ]
        for pair, families in local.items()
        for family, entry in families.items()
    ]
    return markdown(header, rows)


def _cells_table(cells: dict[str, Any]) -> str:
    """Format the cells needed for some gaps, in diagonals; a dash if the search stopped before."""
    goals = (1e-2, 1e-4, 1e-6, 1e-8, _GOAL)
    header = ["pair", "bound", *(f"cells for {goal:.0e}" for goal in goals), "smallest gap"]
    rows = [
        [pair, family, *(_needed(entry, goal) for goal in goals), f"{entry['gap'][-1]:.1e}"]
        for pair, families in cells.items()
        for family, entry in families.items()
    ]
    return markdown(header, rows)


def _needed(entry: dict[str, Any], goal: float) -> int | str:
    return next((n for n, gap in zip(entry["count"], entry["gap"], strict=True) if gap <= goal), "-")


if __name__ == "__main__":
    main()
