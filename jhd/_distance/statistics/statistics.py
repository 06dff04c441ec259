"""Statistics of the distance between two shapes: maximum, quantile, mean, and root mean square.

Each has certified bounds, from the cells of jhd._distance.deviation, and a differentiable value. On point sets the
value uses the distances of all points. On curves, surfaces and meshes it is an integral with nodes at fixed parameters
(jhd._distance.statistics.quadrature), and its derivative is the derivative of this integral.

Source: the partial Hausdorff distance by a quantile is due to Huttenlocher, Klanderman & Rucklidge, Comparing Images
Using the Hausdorff Distance (1993); the larger of both means is the modified Hausdorff distance of Dubuisson & Jain
(1994).
"""

from abc import abstractmethod
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._distance.deviation import check_kinds, checked_weights, deviation
from jhd._distance.deviation_solution import Deviation, check_share
from jhd._distance.hausdorff import directed_hausdorff
from jhd._distance.normalization.custom_derivatives import carrying
from jhd._distance.normalization.host_callback import answer_in_program
from jhd._distance.search.bodies import body_of
from jhd._distance.search.body import dtype_of
from jhd._distance.search.branch_and_bound import BranchAndBound, limited
from jhd._distance.statistics.distances_along import check_size, common_scale, distances_along, scaled_net
from jhd._distance.statistics.error_control import Estimated
from jhd._distance.statistics.pointwise import Sight
from jhd._distance.statistics.quantiles import quantile_beside, quantile_of, quantile_over
from jhd._results.batches import AbstractBounds, AbstractSolution, Bounds, shown_many
from jhd._results.solution import DIRECTIONS, RESULTS, NotProvenError, name_of, result_where, throw_unless_successful
from jhd._results.unproven import relative_tolerance
from jhd._runtime.arrays import is_traced, is_tracing, undifferentiated, whole
from jhd._runtime.decimals import interval_text
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.checks import Numbers, optional_array
from jhd._triangles.closest_point import outward
from jhd.progress import Callback


class StatisticSolution(AbstractBounds, AbstractSolution):
    """A statistic of the distances from one shape to another, or the larger of both directions, with certified bounds.

    Args:
        value: the statistic, between the bounds; differentiable in both shapes.
        lower: certified lower bound.
        upper: certified upper bound.
        direction: the member of DIRECTIONS that attains the value.
        result: RESULTS.successful, or the reason why the bounds are wider than the tolerance.
    """

    value: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    direction: DIRECTIONS
    result: RESULTS

    def __repr__(self) -> str:
        if many := shown_many(self, "value"):
            return many
        numbers = f"{float(self.value):.9g} in {interval_text(self.lower, self.upper, '.9g')}"
        return f"StatisticSolution({numbers}, {name_of(self.direction)}, {name_of(self.result)})"


def _directed(given: bool) -> bool:
    if not isinstance(given, bool | np.bool_):
        came = type(given).__name__
        raise TypeError(
            f"directed must be True or False; got {came}. Pass shapes in a second call: MeanDistance()(a, b)."
        )
    return bool(given)


def check_statistic(statistic: object) -> None:
    """Raise TypeError unless it is a statistic or None."""
    if statistic is None or isinstance(statistic, AbstractStatistic):
        return
    came = f"the class {statistic.__name__}: call it" if isinstance(statistic, type) else repr(statistic)
    raise TypeError(
        f"statistic must be MaxDistance(), MeanDistance(), RMSDistance() or QuantileDistance(q); got {came}."
    )


class AbstractStatistic(eqx.Module):
    """A statistic of the distances between two shapes; call it as `statistic(a, b)`.

    Args:
        directed: whether to use the distances from `a` to `b` only; by default the larger of both directions. If `a`
            holds points sampled on a shape `b`, use True: the other direction includes the spacing of the points.
        weights: default weights of the points of `a`, of shape (points,), at least 0; by default one each. A call can
            override them. In a fit, `a` is the target.
    """

    directed: eqx.AbstractVar[bool]
    weights: eqx.AbstractVar[Array | None]

    def __call__(
        self,
        a: ShapeLike,
        b: ShapeLike,
        *,
        weights: Numbers | None = None,
        rtol: Numbers = 1e-3,
        atol: Numbers | None = None,
        throw: bool = True,
        max_seconds: float | None = None,
        progress: Callback | None = None,
    ) -> StatisticSolution:
        """The statistic with certified bounds; its value is differentiable in both shapes and in the weights.

        Works under jit and vmap by host calls, one after the other, with first derivatives. There, checks of values are
        skipped and `throw` is ignored: read `result`.

        Args:
            a: points, a curve, a parametric surface or a mesh; for MaxDistance() an implicit surface too.
            b: a shape of any of these kinds and of the same dimension. Directed statistics also accept an implicit
                surface.
            weights: weights of the points of `a`, of shape (points,), at least 0; by default those of the statistic.
            rtol: tolerance relative to the upper bound, at least 0; by default 1e-3. MaxDistance() ignores it.
            atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; by default the tolerance of
                `deviation`, or of `hausdorff` for MaxDistance().
            throw: whether to raise NotProvenError if the bounds do not close; by default True.
            max_seconds: wall time in seconds after which the searches end with the bounds reached, and the value is
                computed; by default no limit. Ignored under jit.
            progress: a function that is called with a Progress from time to time; ignored under jit.

        Returns:
            A StatisticSolution: value, bounds and direction.

        Raises:
            TypeError: an object that is not a shape, a surface whose area is not certified, or weights for a shape that
                is not a point set.
            ValueError: the dimensions differ, or `deviation` refuses the shapes.
            NotProvenError: the tolerance was not reached and `throw` is True. Differentiation also raises it if the
                derivative is not confirmed to a millionth; if `throw` is False, the derivative is then NaN.
        """
        a, b, counts = self._checked(a, b, weights)
        if _is_hidden(a, b, counts, atol, rtol) and not isinstance(self, MaxDistance):
            shapes, options = _with_weights(a, b, counts)
            options |= {"atol": atol, "rtol": rtol}
            return answer_in_program(partial(_known, self), partial(_refused, dtype_of(a)), shapes, options)
        hears = limited(BranchAndBound(), progress, max_seconds)
        found = self._one_way(a, b, counts, atol, rtol, hears)
        if not self.directed:
            back = self._one_way(b, a, None, atol, rtol, hears)
            turned = eqx.tree_at(lambda x: x.direction, back.solution, DIRECTIONS.b_to_a)
            found = _larger(found, back._replace(solution=turned))
        if throw and not is_traced(found.solution.result):
            throw_unless_successful(found.solution, option=relative_tolerance(found.reached))
            _throw_unless_confirmed(found.value, found.solution)
        return eqx.tree_at(lambda x: x.value, found.solution, found.value.guarded())

    def estimate(self, a: ShapeLike, b: ShapeLike, weights: Numbers | None = None, nodes: int | None = None) -> Array:
        """The value alone, without bounds, for losses that are evaluated often.

        Args:
            a: the source shape, as in a call.
            b: the target shape, as in a call.
            weights: weights of the points of `a`, as in a call.
            nodes: largest number of points along a curve or surface. By default points are added until the integrals
                are accurate, or until a fixed limit is reached (some seconds).

        Returns:
            The value, a scalar array, differentiable in both shapes.

        Raises:
            ValueError: all coordinates are nearly subnormal, or `nodes` is not a positive whole number.
            NotProvenError: the call is differentiated without `nodes`, and the relative error of the derivative could
                not be confirmed to be below 1e-6. In compiled functions the derivative is NaN instead.
        """
        a, b, counts = self._checked(a, b, weights)
        nodes = None if nodes is None else whole("nodes", nodes, 1)
        if _is_hidden(a, b, counts) and not isinstance(self, MaxDistance):
            known = partial(_known_value, self, nodes)
            return answer_in_program(known, partial(jnp.asarray, jnp.inf, dtype_of(a)), *_with_weights(a, b, counts))
        if not _is_hidden(a, b, counts):
            check_size(a, b)
        found = self._estimated(a, b, counts, nodes)
        _throw_unless_confirmed(found, None)
        return found.value

    def _checked(self, a: Any, b: Any, weights: Any) -> tuple[Any, Any, Any]:
        """Return both shapes and the weights after all checks that need no values."""
        a, b = taken_as("a", a), taken_as("b", b)
        if not isinstance(self, MaxDistance):
            check_kinds(a, b, self.directed)
        return a, b, checked_weights(a, self.weights if weights is None else weights)

    def _estimated(self, a: Any, b: Any, weights: Any, nodes: int | None) -> Estimated:
        """Return the value alone, in one direction or both."""
        ways = [(a, b, weights)] if self.directed else [(a, b, weights), (b, a, None)]
        found = [self._value(a, b, counts, nodes) for a, b, counts in ways]
        # With a requested number of nodes, the derivative counts as confirmed.
        found = found if nodes is None else [x._replace(off=0.0) for x in found]
        return found[0] if self.directed else found[0].larger(found[1])

    def _one_way(self, a: Any, b: Any, weights: Any, atol: Any, rtol: Any, hears: Callback | None) -> "_Directed":
        """Return the directed statistic."""
        *known, counts = undifferentiated((a, b, weights))
        options: dict[str, Any] = {"quantile": getattr(self, "q", None), "weights": counts, "progress": hears}
        found = deviation(*known, atol=atol, rtol=rtol, throw=False, **options)
        bounds = self._bounds(found)
        value, off = self._value(a, b, weights, None)
        lower, upper = _rounded_outward(bounds, np.dtype(value.dtype))
        inside = jnp.asarray(_within(bounds, np.asarray(undifferentiated(value))))
        # Compiled functions take subnormal numbers for zero.
        value = carrying(inside, value) if is_traced(value) else inside
        solution = StatisticSolution(value, lower, upper, DIRECTIONS.a_to_b, found.result)
        return _Directed(solution, Estimated(value, off), found._reached(getattr(self, "q", None)))

    @abstractmethod
    def _bounds(self, found: Deviation) -> Bounds:
        """Return the bounds of the statistic."""

    @abstractmethod
    def _value(self, a: Any, b: Any, weights: Any, nodes: int | None) -> Estimated:
        """Return the value, differentiable in both shapes."""


class _Directed(NamedTuple):
    """A statistic, its value with the accuracy of its derivative, and all bounds that were to be closed."""

    solution: StatisticSolution
    value: Estimated
    reached: dict[str, Any]


class MaxDistance(AbstractStatistic):
    """The largest distance as a statistic: `hausdorff`, or `directed_hausdorff` if `directed`. It accepts no weights.

    Args:
        directed: whether to use the distances from `a` to `b` only; by default the larger of both directions. If `a`
            holds points sampled on a shape `b`, use True: the other direction includes the spacing of the points.
    """

    directed: bool = eqx.field(default=False, static=True, converter=_directed)
    weights: Array | None = eqx.field(default=None, init=False)

    def _one_way(self, a: Any, b: Any, weights: Any, atol: Any, rtol: Any, hears: Callback | None) -> _Directed:
        if weights is not None:
            raise ValueError("MaxDistance() accepts no weights; leave out the points that do not count.")
        found = directed_hausdorff(a, b, BranchAndBound(atol=atol), throw=False, progress=hears)
        solution = StatisticSolution(found.value, found.lower, found.upper, DIRECTIONS.a_to_b, found.result)
        return _Directed(solution, Estimated(found.value, 0.0), {})

    def _bounds(self, found: Deviation) -> Bounds:
        return Bounds(found.maximum.lower, found.maximum.upper)

    def _value(self, a: Any, b: Any, weights: Any, nodes: int | None) -> Estimated:
        return Estimated(directed_hausdorff(a, b, throw=False).value, 0.0)


class MeanDistance(AbstractStatistic):
    """The mean distance over the length or area of `a`, or over its points.

    Call it as `jhd.MeanDistance()(a, b)`, or as `jhd.MeanDistance().estimate(a, b)` in a loss.

    >>> import jhd
    >>> scan, model = jhd.point_set([(0, 0), (1, 0), (2, 0), (3, 8)]), jhd.polyline([(0, 0), (3, 0)])
    >>> mean = jhd.MeanDistance(directed=True)
    >>> round(float(mean(scan, model)), 6), round(float(mean.estimate(scan, model)), 6)
    (2.0, 2.0)

    Args:
        directed: whether to use the distances from `a` to `b` only; by default the larger of both directions. If `a`
            holds points sampled on a shape `b`, use True: the other direction includes the spacing of the points.
        weights: default weights of the points of `a`, of shape (points,), at least 0; by default one each.
    """

    directed: bool = eqx.field(default=False, static=True, converter=_directed)
    weights: Array | None = eqx.field(default=None, converter=optional_array("weights"))

    def _bounds(self, found: Deviation) -> Bounds:
        return found.mean

    def _value(self, a: Any, b: Any, weights: Any, nodes: int | None) -> Estimated:
        scale, at = distances_along(a, b, weights, nodes)
        return Estimated(jnp.sum(at.weight * at.distance) / jnp.sum(at.weight) / scale, at.off)


class RMSDistance(AbstractStatistic):
    """The root of the mean squared distance over the length or area of `a`, or over its points.

    Call it as `jhd.RMSDistance()(a, b)`, or as `jhd.RMSDistance().estimate(a, b)` in a loss.

    Args:
        directed: whether to use the distances from `a` to `b` only; by default the larger of both directions. If `a`
            holds points sampled on a shape `b`, use True: the other direction includes the spacing of the points.
        weights: default weights of the points of `a`, of shape (points,), at least 0; by default one each.
    """

    directed: bool = eqx.field(default=False, static=True, converter=_directed)
    weights: Array | None = eqx.field(default=None, converter=optional_array("weights"))

    def _bounds(self, found: Deviation) -> Bounds:
        return found.rms

    def _value(self, a: Any, b: Any, weights: Any, nodes: int | None) -> Estimated:
        scale, at = distances_along(a, b, weights, nodes)
        square = jnp.sum(at.weight * at.distance**2) / jnp.sum(at.weight)
        some = square > 0
        return Estimated(jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), 0.0) / scale, at.off)


class QuantileDistance(AbstractStatistic):
    """The q-quantile of the distance: the least distance that a fraction q of `a` does not exceed.

    This is the partial Hausdorff distance; call it as `jhd.QuantileDistance(0.9)(a, b)`. The derivative is taken at the
    points whose distance equals the quantile (or on the region, if a whole region has this distance). If an estimate is
    given a number of `nodes`, it approximates the quantile, with a relative error of up to a few hundredths.

    >>> import jhd
    >>> scan, model = jhd.point_set([(0, 0), (1, 0), (2, 0), (3, 8)]), jhd.polyline([(0, 0), (3, 0)])
    >>> statistics = jhd.QuantileDistance(0.75, directed=True), jhd.MaxDistance(directed=True)
    >>> [round(float(statistic(scan, model)), 6) for statistic in statistics]
    [0.0, 8.0]

    Args:
        q: a fraction, above 0 and at most 1: 0.5 is the median, 1 the largest distance. Rounding of q is
            tolerated: 9 of 10 points reach q = 0.9.
        directed: whether to use the distances from `a` to `b` only; by default the larger of both directions. If `a`
            holds points sampled on a shape `b`, use True: the other direction includes the spacing of the points.
        weights: default weights of the points of `a`, of shape (points,), at least 0; by default one each.
    """

    q: float = eqx.field(static=True)
    directed: bool = eqx.field(static=True)
    weights: Array | None

    def __init__(self, q: float, directed: bool = False, weights: Numbers | None = None):
        check_share("q", q)
        self.q, self.directed, self.weights = float(q), _directed(directed), optional_array("weights")(weights)

    def _bounds(self, found: Deviation) -> Bounds:
        return found.quantile(self.q)

    def _value(self, a: Any, b: Any, weights: Any, nodes: int | None) -> Estimated:
        if self.q == 1 and weights is None:
            return Estimated(directed_hausdorff(a, b, throw=False).value, 0.0)
        dimension = body_of(a).dimension
        found = None if dimension == 0 else self._level(a, b, nodes)
        if found is not None:
            return found
        scale, at = distances_along(a, b, weights, nodes)
        if dimension == 0:
            # The weights as they were given, whose sums are exact.
            counts = at.weight if weights is None else weights
            return Estimated(at.distance[quantile_of(at.distance, counts, self.q)[0]] / scale, 0.0)
        beside = quantile_beside(at.distance, at.weight, self.q)
        return beside._replace(value=beside.value / scale)

    def _level(self, a: Any, b: Any, nodes: int | None) -> Estimated | None:
        """Return the quantile by the points where the distance crosses it; None if these do not determine it."""
        if body_of(a).dimension != 1 and nodes is not None:
            return None
        scale = common_scale(a, b)
        # Newton's steps for the level of a quantile if the number of nodes is given.
        sight, steps = Sight(b, scale, is_traced(a, b)), None if nodes is None else 3
        found = quantile_over(scaled_net(a, scale), sight, b, self.q, steps)
        return None if found is None else found._replace(value=found.value / scale)


def _rounded_outward(bounds: Bounds, dtype: np.dtype) -> tuple[Array, Array]:
    """Return bounds in double precision as arrays of the precision of the shapes, rounded outward."""
    ends = (bounds.lower, -1), (bounds.upper, 1)
    return tuple(jnp.asarray(outward(np.asarray(x), 0, dtype, sign)) for x, sign in ends)  # pyright: ignore[reportReturnType]


def _within(bounds: Bounds, value: np.ndarray) -> np.ndarray:
    """Return the value clipped to the bounds, or their middle if it is NaN."""
    known = np.where(np.isnan(value), bounds.value, value)
    return np.asarray(np.clip(known, bounds.lower, bounds.upper), value.dtype)


def _is_hidden(*values: Any) -> bool:
    """Return whether numbers are known only when a compiled function runs; differentiation alone hides nothing."""
    return is_tracing(undifferentiated([x for x in jax.tree_util.tree_leaves(values) if eqx.is_array(x)]))


def _with_weights(a: Any, b: Any, weights: Any) -> tuple[Any, dict[str, Any]]:
    """Return the arguments that may be differentiated, and the options: weights that are known stay unchanged."""
    return ((a, b, weights), {"weights": None}) if is_traced(weights) else ((a, b, None), {"weights": weights})


def _known(statistic: AbstractStatistic, shapes: Any, weights: Any, **options: Any) -> StatisticSolution:
    a, b, moving = shapes
    return statistic(a, b, weights=weights if moving is None else moving, **options, throw=False)


def _known_value(statistic: AbstractStatistic, nodes: int | None, shapes: Any, weights: Any) -> Array:
    a, b, moving = shapes
    return statistic._estimated(a, b, checked_weights(a, weights if moving is None else moving), nodes).guarded()


def _throw_unless_confirmed(value: Estimated, solution: Any) -> None:
    if not value.is_confirmed:
        raise NotProvenError(value.refusal, solution)


def _refused(dtype: Any) -> StatisticSolution:
    """Return the result for invalid shapes."""
    unknown, nothing = jnp.asarray(jnp.inf, dtype), jnp.asarray(0.0, dtype)
    return StatisticSolution(unknown, nothing, unknown, DIRECTIONS.a_to_b, RESULTS.nonfinite_value)


def _larger(first_way: _Directed, second_way: _Directed) -> _Directed:
    """Return the larger of both directions: its value and direction, with the larger of both bounds."""
    there, back = first_way.solution, second_way.solution
    known = undifferentiated((there, back))
    # Compiled functions take subnormal numbers for zero.
    host = not is_tracing([x.value for x in known])
    values, lowers, uppers = ([getattr(x, name) for x in known] for name in ("value", "lower", "upper"))
    if host:
        values, lowers, uppers = ([np.asarray(x) for x in pair] for pair in (values, lowers, uppers))
    largest = np.maximum if host else jnp.maximum
    first = jnp.asarray(values[0] >= values[1])
    result = result_where(there.result == RESULTS.successful, back.result, there.result)
    lower, upper = (jnp.asarray(largest(*pair)) for pair in (lowers, uppers))
    # On the host the smaller one is left out, whose derivative may not be confirmed.
    value = Estimated(jnp.where(first, there.value, back.value), 0.0)
    value = (first_way if first else second_way).value if host else value
    direction = DIRECTIONS.where(first, there.direction, back.direction)
    reached = {f"{of}, {way}": ends for way, x in enumerate((first_way, second_way)) for of, ends in x.reached.items()}
    return _Directed(StatisticSolution(value.value, lower, upper, direction, result), value, reached)
