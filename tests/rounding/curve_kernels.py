"""The bounds of cells of curves, from the stored numbers on, for many inputs of one size side by side."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jhd._arithmetic import bernstein
from jhd._distance.cells import branches
from jhd._distance.nearest import chords
from jhd._distance.nearest import curves as nearest
from jhd._distance.normalization import curves as preparation
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import Piece
from jhd._shapes.curve import BezierSegments
from jhd._shapes.unchecked import trusted

# Inputs side by side, of four kinds in turn.
COUNT = 32


class Pairs:
    """Pairs of single segments with coordinates and weights of at most one, and numbers in the unit interval.

    A quarter each are random, have all coordinates at the corners of the cube, lie close together, and stay at opposite
    corners.

    Args:
        degrees: of both segments.
        dim: number of coordinates.
        rational: whether they have weights, with ratios up to about 20.
    """

    def __init__(self, degrees: tuple[int, int], dim: int, rational: bool, dtype: type = np.float32):
        rng = np.random.default_rng([*degrees, dim, rational])
        p, q = degrees
        a, b = (rng.uniform(-1, 1, (COUNT, n + 1, dim)) for n in degrees)
        a[1::4], b[1::4] = np.sign(a[1::4]), np.sign(b[1::4])
        b[2::4] = np.clip(a[2::4, np.arange(q + 1) * p // q] + 1e-3 * b[2::4], -1, 1)
        a[3::4], b[3::4] = 1.0, -1.0
        self.degrees, self.dim, self.rational = degrees, dim, rational
        weights = [np.exp(-rng.uniform(0, 3, (COUNT, n + 1))) for n in degrees] if rational else []
        shares = rng.uniform(0, 1, (COUNT, 7))
        shares[:, :2].sort(axis=1)
        self.inputs = [x.astype(dtype) for x in (a, b, shares, *weights)]


def on_all(one: Callable) -> Callable:
    """A function of one pair with weights or None for all pairs side by side."""

    def of(a, b, x, *weights):
        return jax.vmap(lambda a, b, x, *w: one(a, b, x, *(w or (None, None))))(a, b, x, *weights)

    return of


def split_bound(a, b, x, wa, wb):
    """The upper bound of a cell from one branch, split at x[6]; the part is [x[0], x[1]], x[2] and x[3] are feet."""
    part = branches._restricted(Piece(a, wa), x[0], x[1])
    sigma = branches._sigma(x[2], x[3], x[4], x[5], wa is not None)
    e, w = branches._difference(part, Piece(b, wb), *sigma)
    both = branches._FollowedBranch(e[None], None if w is None else w[None], x[2:3], x[3:4])
    return branches._split_bound(both, x[6], a.shape[0] - 1, b.shape[0] - 1)


def first_bound(a, b, x, wa, wb):
    """The cheap upper bound of the same cell."""
    first = jnp.array(0)
    cell = branches.CurveCell(first, x[0], x[1], first, x[2], first, x[3])
    return branches.first_upper_bound(_segment(a, wa), _segment(b, wb), cell)


def run_bound(a, b, x, wa, wb):
    """The upper bound of the same cell by the chord of b, of a run as straight as b is."""
    first, runs = jnp.array(0), chords.chords_between(b[:1], b[-1:], b[None])
    cell = branches.CurveCell(first, x[0], x[1], first, x[2], first, x[3])
    return branches._run_bound(branches._restricted(Piece(a, wa), x[0], x[1]), runs, cell)


def cell_lower_bound(a, b, x, wa, wb):
    """The lower bound of the distance from a control point of a to the part [x[0], x[1]] of b."""
    offsets = a[0] - b
    n, _ = nearest._homogeneous(offsets, wb)
    part = bernstein.restrict(n, x[0], x[1], axis=0)
    weights = None if wb is None else bernstein.restrict(wb, x[0], x[1])
    return nearest.cell_bound(part, weights, jnp.max(jnp.abs(offsets)))[0]


def foot(a, b, x, wa, wb):
    """The vector from the point of b at x[2] to a control point of a."""
    return jet(a[0] - b, wb, x[2]).point


def length(a, b, x, wa, wb):
    """The bound of the distance for the vector a[0] to such a point, with coordinates of at most two before."""
    return nearest.length_bound(a[0], b.shape[0] - 1, jnp.asarray(2.0, a.dtype))[1]


# Each with the modules whose constants it uses and the side of the bound.
BOUNDS = {
    "split": (on_all(split_bound), (branches,), 1),
    "first": (on_all(first_bound), (branches,), 1),
    "run": (on_all(run_bound), (branches, chords), 1),
    "lower": (on_all(cell_lower_bound), (nearest,), -1),
}


def _prepared(degree: int, a, x, wa) -> BezierSegments:
    """Segments moved by x[2], with the degree raised."""
    return preparation._bucketed(jnp, _segment(a, wa), (a - x[2])[None], degree, wa is not None, 1)


def prepared_points(degree: int) -> Callable:
    """The control points of these."""
    return on_all(lambda a, b, x, wa, wb: _prepared(degree, a, x, wa).control_points[0])


def prepared_point(degree: int) -> Callable:
    """Their point at x[0]."""

    def of(a, b, x, wa, wb):
        moved = _prepared(degree, a, x, wa)
        weights = None if moved.weights is None else moved.weights[0]
        return jet(moved.control_points[0], weights, x[0]).point

    return on_all(of)


def _segment(points, weights) -> BezierSegments:
    return trusted(points[None], None if weights is None else weights[None], np.zeros(1, int))
