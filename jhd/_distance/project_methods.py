"""Methods for nearest points on curves: our own search, and four published methods.

The nearest point is one of the roots of f(s) = (P - B).B', or an end of a segment. `BestFirstProjection` and
`ProjectedPolyhedronProjection` are global and certified. Interval halving, Newton's method and their hybrid start at
the control point nearest to P and are for comparison: they miss the nearest point for 3 to 16 % of random queries,
certify nothing, and no bound relies on them.

Changes to the source of the local methods: they serve any number of segments of any degree, also rational ones, and
keep parameters in [0, 1].

Source: Shortest distance from a point to a Bezier curve (halving, Newton, hybrid); Patrikalakis & Maekawa, Shape
Interrogation (2002), chapter 4.
"""

import math
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._arithmetic import bernstein, polynomial_roots
from jhd._arithmetic.rounding import gamma
from jhd._distance.nearest.curves import NearestOnCurve, best_end, length_bound, nearest
from jhd._distance.nearest.feet import equation
from jhd._distance.nearest.stationarity import roots_on
from jhd._distance.normalization.jets import jet
from jhd._distance.normalization.pieces import Piece
from jhd._results.solution import RESULTS, result_where
from jhd._runtime.arrays import check_whole, varying
from jhd._shapes.curve import BezierSegments


def best_local(
    point: Array, curve: BezierSegments, local: Callable[[Array, Array | None, Array], tuple[Array, Array]]
) -> tuple[NearestOnCurve, Any]:
    """Return the best of all ends and of one foot a segment, by a local method that returns parameter and steps."""
    offsets = point - curve.control_points
    radius = jnp.max(jnp.abs(offsets), axis=(1, 2))

    def of_segment(e: Array, w: Array | None, r: Array) -> tuple:
        start = jnp.argmin(jnp.sum(e * e, axis=-1)) / max(e.shape[0] - 1, 1)
        s, steps = local(e, w, start.astype(e.dtype))
        return s, steps, *length_bound(jet(e, w, s).point, e.shape[0] - 1, r)

    s, steps, distance, upper = jax.vmap(of_segment)(offsets, curve.weights, radius)
    k = jnp.argmin(upper)
    inner = NearestOnCurve(distance[k], jnp.zeros_like(radius[k]), upper[k], k, s[k], jnp.array(True), jnp.sum(steps))
    end = best_end(offsets)
    nearer = inner.upper < end.upper
    best = jax.tree_util.tree_map(lambda x, y: jnp.where(nearer, x, y), inner, end)
    return eqx.tree_at(lambda n: (n.closed, n.steps), best, (inner.closed, inner.steps)), RESULTS.successful


def height(e: Array, w: Array | None, s: Array) -> Array:
    """Return the squared distance at the parameter s, for offsets e = P - b and weights w."""
    c = jet(e, w, s).point
    return c @ c


def halve(
    e: Array, w: Array | None, start: Array, interval: float, tolerance: float, max_steps: int
) -> tuple[Array, Array]:
    """Interval halving: moves to the better neighbor, or halves the interval if the middle is best."""

    def step(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        s, width, count = state
        around = jnp.clip(jnp.stack([s, s - width, s + width]), 0.0, 1.0)
        best = jnp.argmin(jax.vmap(lambda s: height(e, w, s))(around))
        return around[best], jnp.where(best == 0, 0.5 * width, width), count + 1

    state = varying((start, jnp.full_like(start, interval), jnp.array(0)), e, w)
    s, _, count = jax.lax.while_loop(lambda x: (x[1] > tolerance) & (x[2] < max_steps), step, state)
    return s, count


def newton(e: Array, w: Array | None, start: Array, tolerance: float, max_steps: int) -> tuple[Array, Array]:
    """Newton's method on C.C' = 0, kept in [0, 1]; it does not move if the slope vanishes."""

    def step(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        s, _, count = state
        here = equation(0.0, Piece(e, w), s)
        moved = jnp.where(here.slope != 0, s - here.residual / jnp.where(here.slope != 0, here.slope, 1.0), s)
        moved = jnp.clip(moved, 0.0, 1.0)
        return moved, jnp.abs(moved - s), count + 1

    state = varying((start, jnp.full_like(start, jnp.inf), jnp.array(0)), e, w)
    s, _, count = jax.lax.while_loop(lambda x: (x[1] > tolerance) & (x[2] < max_steps), step, state)
    return s, count


class AbstractProjectionMethod(eqx.Module):
    """A method for nearest points of curves; its fields are options."""

    @abstractmethod
    def _one(self, point: Array, curve: BezierSegments, skip: Array) -> tuple[NearestOnCurve, RESULTS]:
        """The nearest point to one query, in scaled coordinates.

        Args:
            point: the query (dim,).
            curve: the curve.
            skip: marks repeated segments, (segments,).

        Returns:
            The nearest point, and the member of RESULTS that tells how the search ended.
        """


class BestFirstProjection(AbstractProjectionMethod):
    """Nearest points on curves by best-first search with Bernstein bounds: global, certified, and the fastest method.

    Use it as `jhd.project(points, curve, jhd.BestFirstProjection())`; it is the default for curves.
    """

    def _one(self, point: Array, curve: BezierSegments, skip: Array) -> tuple[NearestOnCurve, RESULTS]:
        """The nearest point to one query; called by `jhd.project`."""
        found = nearest(point, curve.control_points, curve.weights, 0.0, skip)
        return found, how_closed(found)


class ProjectedPolyhedronProjection(AbstractProjectionMethod):
    """Nearest points on curves from all stationary parameters and all ends: global and certified.

    The projected-polyhedron solver finds the stationary parameters of every segment, so BestFirstProjection is faster
    for curves of many segments.

    Args:
        capacity: number of boxes that the solver can hold for one segment.

    Source: Patrikalakis & Maekawa, Shape Interrogation (2002), chapter 4.
    """

    capacity: int = eqx.field(static=True, default=32)

    def __check_init__(self) -> None:
        check_whole("capacity", self.capacity, 1)

    def _one(self, point: Array, curve: BezierSegments, skip: Array) -> tuple[NearestOnCurve, RESULTS]:
        """The nearest point to one query; called by `jhd.project`."""
        roots = jax.vmap(lambda k: roots_on(point, curve, k, self.capacity))(jnp.arange(curve.count))
        return _nearest_of_roots(point, curve, roots, skip)


class IntervalHalvingProjection(AbstractProjectionMethod):
    """Nearest points on curves by interval halving: step to the better neighbor, or halve the interval; a local method.

    Change to the source: it stops on the interval. The source stops on the differences of the three distances, which
    depend on the unit and end early at a flat minimum.

    Args:
        interval: initial interval of the parameter.
        xtol: interval of the parameter at which it stops.
        max_steps: largest number of steps.

    Source: Shortest distance from a point to a Bezier curve.
    """

    interval: float = eqx.field(static=True, default=0.1)
    xtol: float = eqx.field(static=True, default=1e-8)
    max_steps: int = eqx.field(static=True, default=200)

    def __check_init__(self) -> None:
        check_whole("max_steps", self.max_steps, 1)
        _check_positive("interval", self.interval)
        _check_positive("xtol", self.xtol)

    def _one(self, point: Array, curve: BezierSegments, skip: Array) -> tuple[NearestOnCurve, RESULTS]:
        """The best foot point over all segments, from the nearest control point of each; called by `jhd.project`."""
        return best_local(point, curve, lambda e, w, s: halve(e, w, s, self.interval, self.xtol, self.max_steps))


class NewtonProjection(AbstractProjectionMethod):
    """Nearest points on curves by Newton's method on (P - B).B' = 0, from the nearest control point; a local method.

    Changes to the source: parameters stay in [0, 1], and it stops on the step. The source names no criterion.

    Args:
        xtol: step of the parameter at which it stops.
        max_steps: largest number of steps.

    Source: Shortest distance from a point to a Bezier curve.
    """

    xtol: float = eqx.field(static=True, default=1e-14)
    max_steps: int = eqx.field(static=True, default=32)

    def __check_init__(self) -> None:
        check_whole("max_steps", self.max_steps, 1)
        _check_positive("xtol", self.xtol)

    def _one(self, point: Array, curve: BezierSegments, skip: Array) -> tuple[NearestOnCurve, RESULTS]:
        """The best foot point over all segments, from the nearest control point of each; called by `jhd.project`."""
        return best_local(point, curve, lambda e, w, s: newton(e, w, s, self.xtol, self.max_steps))


class HybridProjection(AbstractProjectionMethod):
    """Nearest points on curves by interval halving to a rough parameter, then Newton's method; a local method.

    The source suggests it without numbers; the intervals and the criterion are ours.

    Args:
        interval: initial interval of the halving.
        rough: interval at which Newton's method takes over.
        xtol: Newton step at which it stops.
        max_steps: largest number of steps of each method.

    Source: Shortest distance from a point to a Bezier curve.
    """

    interval: float = eqx.field(static=True, default=0.1)
    rough: float = eqx.field(static=True, default=1e-2)
    xtol: float = eqx.field(static=True, default=1e-14)
    max_steps: int = eqx.field(static=True, default=64)

    def __check_init__(self) -> None:
        check_whole("max_steps", self.max_steps, 1)
        for name in ("interval", "rough", "xtol"):
            _check_positive(name, getattr(self, name))

    def _one(self, point: Array, curve: BezierSegments, skip: Array) -> tuple[NearestOnCurve, RESULTS]:
        """The best foot point over all segments, from the nearest control point of each; called by `jhd.project`."""

        def local(e: Array, w: Array | None, s: Array) -> tuple[Array, Array]:
            rough, first = halve(e, w, s, self.interval, self.rough, self.max_steps)
            fine, second = newton(e, w, rough, self.xtol, self.max_steps)
            # From a foot at an end, which is no root, Newton's method runs away.
            return jnp.where(height(e, w, fine) <= height(e, w, rough), fine, rough), first + second

        return best_local(point, curve, local)


def _check_positive(name: str, value: float) -> None:
    if not (isinstance(value, int | float) and 0 < value < math.inf):
        raise ValueError(f"{name} is {value!r}; needs a positive number.")


def how_closed(found: NearestOnCurve) -> Any:
    """Return the result code of a search: whether its bounds are closed."""
    return result_where(found.closed, RESULTS.successful, RESULTS.many_nearest_points)


def failed(result: Any) -> Array:
    """Return whether a result is a failure."""
    return result != RESULTS.successful


def _nearest_of_roots(
    point: Array, curve: BezierSegments, roots: polynomial_roots.Roots, skip: Array
) -> tuple[NearestOnCurve, Any]:
    """Return the nearest point among the ends and the stationary parameters, searched in the boxes of the roots.

    The boxes are cut out of their segments and handed to the search as segments of their own: if a multiple root or an
    uneven parametrization leaves a wide box, distances narrow it. Cutting out takes gamma(3 n + 4) of the largest
    offset in each coordinate, a quotient included, and the bounds are moved by that much.
    """
    offsets = point - curve.control_points
    best = best_end(offsets)
    valid = roots.valid & ~skip[:, None]
    s0, s1 = (jnp.where(valid, x, end) for x, end in ((roots.lower, 0.0), (roots.upper, 1.0)))

    def cut(e: Array, w: Array | None, u0: Array, u1: Array) -> tuple[Array, Array | None]:
        if w is None:
            return bernstein.restrict(e, u0, u1, axis=0), None
        weights = bernstein.restrict(w, u0, u1)
        return bernstein.restrict(e * w[:, None], u0, u1, axis=0) / weights[:, None], weights

    pieces = jax.vmap(jax.vmap(cut, in_axes=(None, None, 0, 0)))(offsets, curve.weights, s0, s1)
    pieces = jax.tree_util.tree_map(lambda x: x.reshape((-1, *x.shape[2:])), pieces)
    none = ~jnp.any(valid)
    inner = nearest(jnp.zeros_like(point), -pieces[0], pieces[1], 0.0, ~valid.ravel())
    cutting = math.sqrt(curve.dim) * gamma(3 * curve.degree + 4, point.dtype) * jnp.max(jnp.abs(offsets))
    segment, box = inner.segment // valid.shape[1], inner.segment % valid.shape[1]
    a, b = s0[segment, box], s1[segment, box]
    inner = eqx.tree_at(
        lambda n: (n.lower, n.upper, n.segment, n.t),
        inner,
        (
            jnp.where(none, jnp.inf, inner.lower - cutting),
            jnp.where(none, jnp.inf, inner.upper + cutting),
            segment,
            jnp.clip(a + inner.t * (b - a), 0.0, 1.0),
        ),
    )
    # The nearest end errs by as much below as above.
    lower = jnp.minimum(2 * best.distance - best.upper, inner.lower)
    nearer = inner.upper < best.upper
    found = jax.tree_util.tree_map(lambda x, y: jnp.where(nearer, x, y), inner, best)
    closed = ~jnp.any(failed(roots.result)) & (inner.closed | none)
    lower = jnp.clip(lower, 0.0, found.upper)
    steps = jnp.sum(roots.boxes) + inner.steps
    found = eqx.tree_at(lambda n: (n.lower, n.closed, n.steps), found, (lower, closed, steps))
    return found, result_where(closed, RESULTS.successful, RESULTS.capacity_reached)
