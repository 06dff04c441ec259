"""A target and a parametric curve: the critical pairs at parameters, with derivatives, and counts of the work.

Curves of few segments are searched for all local maxima, which all take part. This work grows with the product of both
numbers of segments. Beyond a limit, the maxima near the largest are found with trees (near_top), in a time that grows
with the sum of both numbers. This also serves if the time is too short to compile the full search.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jhd._distance.critical_pairs import critical_pairs
from jhd._distance.witness.critical import local_pairs
from jhd._fitting.expansion import Expansion, FloatArray, Moving, expand
from jhd._fitting.near_top import pairs_near_top
from jhd._fitting.sampled import SampledCurve, lengths_of
from jhd._results.solution import CriticalPairs
from jhd._runtime.clock import Clock, OutOfTimeError
from jhd._runtime.compiled import asking
from jhd._shapes.curve import AbstractCurve, BezierSegments

# The same fraction for curves of many segments.
_LEAST_OF_MANY = 0.3


@dataclass
class Point:
    """Parameters with the critical pairs there."""

    parameters: FloatArray
    shape: AbstractCurve
    pairs: CriticalPairs
    fixed: Moving
    moving: Moving
    many: bool
    top: float
    size: float

    @cached_property
    def expansion(self) -> Expansion:
        """The pairs that take part, with their derivatives; a rejected point needs none."""
        # Pairs below this fraction of the largest take no part in a step.
        least = _LEAST_OF_MANY if self.many else 1e-3
        return expand(self.pairs, self.fixed, self.moving, least * self.top)


@eqx.filter_jit
def _moving(build: Callable, parameters: Any) -> tuple[AbstractCurve, Any, Any, Any]:
    """The shape, its segments' homogeneous control points, their derivatives, and `next_segment`."""

    def segments(p: Any) -> Any:
        curve = build(p).segments()
        return curve.homogeneous, (build(p), curve.next_segment)

    points, (shape, next_segment) = segments(parameters)
    tangent = jax.jacfwd(lambda p: segments(p)[0])(parameters)
    return shape, points, tangent, next_segment


@eqx.filter_jit
def _bending(build: Callable, parameters: Any, cotangent: Any) -> Any:
    """Second derivatives of the control points, contracted."""
    return jax.hessian(lambda p: jnp.sum(build(p).segments().homogeneous * cotangent))(parameters)


@dataclass
class Problem:
    """A target and a parametric curve, with counts of the work.

    Args:
        build: takes a vector of parameters and returns a curve.
        target: the curve to fit.
        capacity: length of the list of pairs.
        clock: checked before each evaluation after the first.
        density: factor on the number of samples of curves of many segments.
    """

    build: Callable
    target: BezierSegments
    capacity: int
    clock: Clock = field(default_factory=Clock)
    density: float = 1.0
    counts: dict[str, int] = field(default_factory=lambda: {"steps": 0, "newton_steps": 0, "evaluations": 0})

    def __post_init__(self):
        points = np.asarray(self.target.homogeneous)
        self._fixed = Moving(points, None, self.target.weights is not None)
        self._size = float(np.max(np.ptp(np.asarray(self.target.control_points).reshape(-1, self.target.dim), axis=0)))
        self._length = float(np.sum(lengths_of(points, self._fixed.rational)))
        self._sampled: dict[tuple[int, float], SampledCurve] = {}
        self._hurried = self._proving = False

    def at(self, parameters: FloatArray) -> Point:
        """The critical pairs at the parameters."""
        # The first one is needed, whatever the time.
        clock = self.clock if self.counts["evaluations"] else Clock()
        clock.check()
        self.counts["evaluations"] += 1
        shape, points, tangent, next_segment = _moving(self.build, jnp.asarray(parameters))
        rational = points.shape[-1] > self.target.dim
        moving = Moving(np.asarray(points), np.asarray(tangent), rational)
        pairs = None if self.has_many(len(points)) else self._all(_curve(moving, next_segment))
        many = pairs is None
        if pairs is None:
            pairs = self._near_top(moving, np.asarray(next_segment), clock)
        return Point(parameters, shape, pairs, self._fixed, moving, many, float(pairs.value[0]), self._size)

    def look_closer(self) -> None:
        """After a missed maximum, prove the largest for few segments, and take more samples for many segments."""
        self.density *= 2
        self._proving = True

    def has_many(self, count: int) -> bool:
        """Whether only maxima near the top take part, for a shape of `count` segments."""
        # Curves have many segments if the product of both numbers exceeds this.
        return self._hurried or count * self.target.count > (1 << 10)

    def _all(self, shape: BezierSegments) -> CriticalPairs | None:
        """All maxima; None, also in later calls, if there is no time to compile their search."""
        try:
            with asking(self.clock.compiling):
                if self._proving:
                    return critical_pairs(self.target, shape, self.capacity)
                return local_pairs(self.target, shape, self.capacity)[0]
        except OutOfTimeError:
            self._hurried = True
            return None

    def _near_top(self, moving: Moving, next_segment: FloatArray, clock: Clock) -> CriticalPairs:
        # Least number of samples of each curve, and least number for each segment of the opposite curve.
        samples = self.density * max(1 << 11, 4 * max(self.target.count, len(moving.points)))
        # Points have no length; then the length of the shape gives the spacing.
        length = self._length or float(np.sum(lengths_of(moving.points, moving.rational)))
        spacing = (length or 1.0) / samples
        target = self._sampled.get((len(moving.points), self.density))
        if target is None:
            target = SampledCurve(
                self._fixed.points, np.asarray(self.target.next_segment), self._fixed.rational, spacing
            )
            self._sampled[len(moving.points), self.density] = target
        clock.check()
        shape = SampledCurve(moving.points, next_segment, moving.rational, spacing)
        return pairs_near_top(target, shape, _LEAST_OF_MANY, self.capacity, clock)

    def scales(self, parameters: FloatArray) -> FloatArray:
        """The change of each parameter that moves the control points by about one unit of length."""
        tangent = np.asarray(_moving(self.build, jnp.asarray(parameters))[2])
        moved = np.max(np.abs(tangent.reshape(-1, tangent.shape[-1])), axis=0)
        return 1 / np.where(moved > 0, moved, 1.0)

    def bending(self, point: Point, mu: FloatArray) -> FloatArray:
        """The part of the Hessian of sum mu_j h_j due to second derivatives of the control points."""
        cotangent = np.tensordot(mu, point.expansion.cotangent, axes=1)
        return np.asarray(_bending(self.build, jnp.asarray(point.parameters), cotangent))


def _curve(moving: Moving, next_segment: Any) -> BezierSegments:
    if not moving.rational:
        return BezierSegments(moving.points, None, next_segment)
    weights = moving.points[..., -1]
    return BezierSegments(moving.points[..., :-1] / weights[..., None], weights, next_segment)
