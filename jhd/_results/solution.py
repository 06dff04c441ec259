"""Results of the entry points: witnesses and solutions. It also re-exports the names of jhd._results.outcomes.

Every class is a pytree of arrays, so solutions pass through jit and vmap. A batch of solutions is a solution whose
leaves have leading axes. JSON and files hold nested dictionaries, lists, numbers and names.
"""

from collections.abc import Sequence
from typing import Any, Generic, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jhd._results.batches import AbstractBounds, AbstractSolution, leaves_on_device, shown_many
from jhd._results.batches import Bounds as Bounds
from jhd._results.batches import on_device as on_device
from jhd._results.batches import stored_fields as stored_fields
from jhd._results.batches import to_plain as to_plain
from jhd._results.display import is_read
from jhd._results.outcomes import ANSWERS as ANSWERS
from jhd._results.outcomes import DIRECTIONS as DIRECTIONS
from jhd._results.outcomes import EVENTS as EVENTS
from jhd._results.outcomes import RESULTS as RESULTS
from jhd._results.outcomes import name_of as name_of
from jhd._results.outcomes import names_of as names_of
from jhd._results.outcomes import result_where as result_where
from jhd._results.unproven import NotProvenError as NotProvenError
from jhd._results.unproven import throw_unless_successful as throw_unless_successful
from jhd._runtime.decimals import lower_text, point_text, upper_text

Parameters = TypeVar("Parameters")
Built = TypeVar("Built", bound=eqx.Module)


def unchecked(kind: type[Built], fields: dict[str, Any]) -> Built:
    """An object with these fields, all of its class, made without the constructor, which takes 70 microseconds."""
    found: Any = object.__new__(kind)
    found.__dict__.update(fields)
    return found


def with_result(solution: Any, result: Any) -> Any:
    """The solution with another result code."""
    return eqx.tree_at(lambda s: s.result, solution, result)


def with_lengths(solution: Any, value: Any, lower: Any, upper: Any, point: Any, feet: Any) -> Any:
    """The HausdorffSolution with lengths in another unit, on the device."""
    # By its leaves, in the order of the fields: creating the two Modules again costs five times as much.
    leaves, structure = jax.tree_util.tree_flatten(solution)
    leaves[:3], leaves[5:7] = (value, lower, upper), (point, feet)
    return jax.tree_util.tree_unflatten(structure, leaves_on_device(leaves))


def with_answers(solution: Any, answers: Sequence[tuple[Any, Any, Any, Any, Any]]) -> Any:
    """The HausdorffSolution with other value, t, point, feet and feet_params, also in its directions."""
    leaves, structure = jax.tree_util.tree_flatten(solution)
    # The directions come last, with equally many leaves.
    size = len(jax.tree_util.tree_leaves(solution.directions)) // 2
    for begin, answer in zip((0, len(leaves) - 2 * size, len(leaves) - size), answers, strict=False):
        leaves[begin], (leaves[begin + 4], leaves[begin + 5], leaves[begin + 6]) = answer[0], answer[1:4]
        leaves[begin + 8] = answer[4]
    return jax.tree_util.tree_unflatten(structure, leaves)


def in_direction(solution: Any, direction: Any) -> Any:
    """The solution with another direction in its witness."""
    witness = unchecked(Witness, vars(solution.witness) | {"direction": direction})
    return unchecked(HausdorffSolution, vars(solution) | {"witness": witness})


class Witness(eqx.Module):
    """The point that attains a directed Hausdorff distance, with its foot points.

    `direction` tells which shape carries the point. If the two shapes of `hausdorff` are of different kinds, `t` and
    `feet_params` have the length of the longer parameter. A single number is then repeated, and (u, v) is followed by a
    zero.

    Args:
        element: index of the part that carries the point: a segment of a curve, a point of a point set, a triangle of
            a mesh or a Bezier patch of a parametric surface; -1 on an implicit surface.
        t: parameter of the point on this element, in [0, 1], of shape (). On a mesh: three barycentric coordinates. On
            a parametric surface: (u, v) on the patch. On an implicit surface: NaN. Without meaning for point sets.
        point: coordinates of the point.
        feet: foot points on the other shape: two rows if both shapes are curves or points, else four. Unused rows
            repeat the first one with multiplier 0.
        feet_elements: indices of the segments, points, triangles or patches of the foot points; -1 on an implicit
            surface.
        feet_params: parameters of the foot points. Curves: one number. Patches: (u, v) on the patch `feet_elements`; a
            B-spline surface is first split by `patches()`. Meshes: three barycentric coordinates. Implicit surfaces:
            NaN. Point sets: no meaning.
        multipliers: weights of the foot points in the gradient, at least 0, with sum one (0.5 each if undefined).
        event: the member of EVENTS that tells how the maximum arises.
        direction: the member of DIRECTIONS that tells which shape carries the point.
    """

    element: Int[Array, "*batch"]
    t: Float[Array, "*batch"] | Float[Array, "*batch corners"]
    point: Float[Array, "*batch dim"]
    feet: Float[Array, "*batch feet dim"]
    feet_elements: Int[Array, "*batch feet"]
    feet_params: Float[Array, "*batch feet"] | Float[Array, "*batch feet parameters"]
    multipliers: Float[Array, "*batch feet"]
    event: EVENTS
    direction: DIRECTIONS

    def __repr__(self) -> str:
        if not is_read(self) or np.ndim(self.point) > 1:
            return f"Witness(t={eqx.tree_pformat(self.t)}, a batch or traced; index or vmap it)"
        numbers = {name: np.asarray(getattr(self, name)).tolist() for name in ("element", "t", "point", "feet")}
        numbers |= {name: np.asarray(getattr(self, name)).tolist() for name in ("feet_elements", "feet_params")}
        shown = ", ".join(f"{name}={value}" for name, value in numbers.items())
        ends = f"multipliers={np.asarray(self.multipliers).tolist()}, event={name_of(self.event)}"
        return f"Witness({shown}, {ends}, direction={name_of(self.direction)})"


class HausdorffSolution(AbstractBounds, AbstractSolution):
    """A Hausdorff distance with certified bounds: lower <= exact <= upper.

    `float(solution)` is the value. `f"{solution:.3f}"` shows both bounds, rounded outward.

    Args:
        value: the distance found, between the bounds; differentiable.
        lower: certified lower bound; 0 if the method certifies none.
        upper: certified upper bound; inf if the method certifies none.
        witness: the point that attains the value, with its foot points.
        result: the member of RESULTS that tells how the search ended.
        stats: counts of the work (never seconds).
        directed: whether this is the distance from `a` to `b` only.
        directions: both directed distances, from `a` to `b` and from `b` to `a`; None if this is a directed distance.
    """

    value: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    witness: Witness
    result: RESULTS
    stats: dict[str, Array]
    directed: bool = eqx.field(static=True, default=True)
    # Not stored: it is as much again for each direction.
    directions: "tuple[HausdorffSolution, HausdorffSolution] | None" = eqx.field(
        default=None, metadata={"stored": False}
    )

    @property
    def event(self) -> EVENTS:
        """The event of the witness, a member of EVENTS."""
        return self.witness.event

    @property
    def direction(self) -> DIRECTIONS:
        """The direction of the witness, a member of DIRECTIONS."""
        return self.witness.direction

    def __repr__(self) -> str:
        if many := shown_many(self, "value"):
            return many
        place = point_text(self.witness.point)
        return (
            f"HausdorffSolution(value={float(self.value)!r}, lower={lower_text(self.lower)}, "
            f"upper={upper_text(self.upper)},\n  {name_of(self.event)} at {place}, {name_of(self.direction)}, "
            f"{name_of(self.result)})"
        )


class MinimumSolution(AbstractBounds, AbstractSolution):
    """A minimum distance of two shapes with certified bounds: lower <= exact <= upper.

    If the shapes meet, `lower` is 0 and `upper` bounds the distance between the two points found.

    Args:
        value: the distance of the two points found, up to rounding; differentiable.
        lower: certified lower bound.
        upper: certified upper bound; inf if none is certified.
        point_a: the point of `a` that is nearest to `b`.
        point_b: the point of `b` that is nearest to `a`.
        result: the member of RESULTS that tells how the search ended.
        stats: counts of the work (never seconds).
    """

    value: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    point_a: Float[Array, "*batch dim"]
    point_b: Float[Array, "*batch dim"]
    result: RESULTS
    stats: dict[str, Array]

    def __repr__(self) -> str:
        if many := shown_many(self, "value"):
            return many
        places = point_text(self.point_a), point_text(self.point_b)
        return (
            f"MinimumSolution(value={float(self.value)!r}, lower={lower_text(self.lower)}, "
            f"upper={upper_text(self.upper)},\n  between {places[0]} and {places[1]}, {name_of(self.result)})"
        )


class Projection(AbstractSolution):
    """Nearest points of a shape to queries, with bounds of the distances; fields keep the batch shape.

    Args:
        distance: distance from the query to the foot point.
        lower: certified lower bound of the distance to the shape; 0 for local methods.
        upper: certified upper bound of the distance to the shape.
        foot: the nearest point found.
        element: index of the segment, triangle or Bezier patch that holds the foot point; -1 on an implicit surface.
        t: parameter of the foot point, in [0, 1]. On a mesh: three barycentric coordinates, exactly 0 off a face. On a
            parametric surface: (u, v) on the patch. On an implicit surface: NaN.
        result: a member of RESULTS for each query.
    """

    distance: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    foot: Float[Array, "*batch dim"]
    element: Int[Array, "*batch"]
    t: Float[Array, "*batch"] | Float[Array, "*batch corners"]
    result: RESULTS

    def __repr__(self) -> str:
        if many := shown_many(self, "distance"):
            return many
        foot = point_text(self.foot)
        bounds = f"lower={lower_text(self.lower)}, upper={upper_text(self.upper)}"
        return f"Projection(distance={float(self.distance)!r}, {bounds},\n  foot {foot}, {name_of(self.result)})"


class StationaryPoints(AbstractSolution):
    """All stationary parameters of the distance from a point to a curve, in order along the curve, padded and masked.

    A stretch of constant distance (seen from the center of a circle) is one interval.

    Args:
        segment: index of the segment of each entry.
        t: a parameter inside the enclosure.
        lower: lower end of the enclosure. Every stationary parameter is certified to lie in one of the enclosures.
        upper: upper end of the enclosure.
        distance: distance from the query to the curve point at t.
        valid: whether the entry is an enclosure; the other entries are padding.
        result: RESULTS.capacity_reached if some enclosures did not fit.
    """

    segment: Int[Array, "*batch capacity"]
    t: Float[Array, "*batch capacity"]
    lower: Float[Array, "*batch capacity"]
    upper: Float[Array, "*batch capacity"]
    distance: Float[Array, "*batch capacity"]
    valid: Bool[Array, "*batch capacity"]
    result: RESULTS

    def __repr__(self) -> str:
        if many := shown_many(self, "distance"):
            return many
        numbers = np.asarray(self.distance)[np.asarray(self.valid)].tolist()
        return f"StationaryPoints(distance={numbers}, {name_of(self.result)})"


class CriticalPairs(AbstractSolution):
    """Local maxima of the distance between two curves, in both directions, largest first, padded and masked.

    Args:
        value: the distances, differentiable; 0 in padded entries.
        witness: the points that attain them, with foot points and direction.
        valid: whether the entry is a maximum; the other entries are padding.
        result: RESULTS.capacity_reached if some maxima did not fit.
    """

    value: Float[Array, "*batch capacity"]
    witness: Witness
    valid: Bool[Array, "*batch capacity"]
    result: RESULTS

    def __repr__(self) -> str:
        if many := shown_many(self, "value"):
            return many
        numbers = np.asarray(self.value)[np.asarray(self.valid)].tolist()
        return f"CriticalPairs(value={numbers}, {name_of(self.result)})"


class Decision(AbstractSolution):
    """Answer to the question whether a distance is at most a threshold, with the bounds reached.

    `if decision:` uses the answer; it raises ValueError if the answer is undecided.

    Args:
        answer: a member of ANSWERS.
        lower: certified lower bound of the distance.
        upper: certified upper bound of the distance.
        result: the member successful of RESULTS if it is decided; otherwise the reason.
        stats: counts of the work in both directions.
        distance: the distance in question: "directed" (from `a` to `b`), "two_sided" (the larger of both directions) or
            "minimum".
        point_a: for a minimum distance, the point of `a` that attains `upper`; otherwise None.
        point_b: for a minimum distance, the point of `b` that attains `upper`; otherwise None.
    """

    answer: ANSWERS
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    result: RESULTS
    stats: dict[str, Array]
    distance: str = eqx.field(static=True, default="two_sided")
    point_a: Float[Array, "*batch dim"] | None = None
    point_b: Float[Array, "*batch dim"] | None = None

    def __bool__(self) -> bool:
        """Whether the answer is yes.

        Raises:
            ValueError: the answer is undecided, or this is a batch of decisions.
        """
        if np.ndim(self.lower):
            raise ValueError(f"there are {np.size(self.lower)} decisions: read `answer`, or index or vmap them.")
        if bool(self.answer == ANSWERS.undecided):
            bounds = f"between {lower_text(self.lower)} and {upper_text(self.upper)}"
            raise ValueError(f"undecided: the distance lies {bounds}; use a smaller atol, or read `answer`.")
        return bool(self.answer == ANSWERS.yes)

    def __repr__(self) -> str:
        if many := shown_many(self, "lower"):
            return many
        ends = f"lower={lower_text(self.lower)}, upper={upper_text(self.upper)}"
        return f"Decision({name_of(self.answer)}, {ends}, {name_of(self.result)}, distance={self.distance})"


class FitSolution(AbstractSolution, Generic[Parameters, Built]):
    """A shape fitted by its Hausdorff distance to a target, with the certified distance.

    `float(solution)` is the distance, or the fitted statistic if there is one.

    Args:
        parameters: the fitted parameters, in the form of the initial ones.
        shape: the curve, surface or mesh built from them.
        error: the certified Hausdorff distance between target and shape.
        optimality: length of sum mu_j g_j, with the gradients g_j of the largest maxima in the parameters and the best
            multipliers mu_j >= 0 of sum one; zero at a stationary point.
        multipliers: the mu_j of the critical pairs, largest distance first.
        pairs: the critical pairs of (target, shape). For surfaces and meshes: the maximum of each direction. For fits
            by another statistic: the largest distance only.
        result: RESULTS.successful, or the reason why the fit stopped before a stationary point.
        stats: counts of steps, of Newton steps among them, and of evaluations.
        history: the distance, or the fitted statistic, at the start and after each step.
        statistic: the fitted statistic of (target, shape) with its bounds; None for the largest distance.
    """

    parameters: Parameters
    shape: Built
    error: HausdorffSolution
    optimality: Float[Array, ""]
    multipliers: Float[Array, " capacity"]
    pairs: CriticalPairs
    result: RESULTS
    stats: dict[str, Array]
    history: Float[Array, " samples"]
    statistic: AbstractBounds | None = None

    def __float__(self) -> float:
        return float((self.error if self.statistic is None else self.statistic).value)

    def __repr__(self) -> str:
        measured = "" if self.statistic is None else f"{self.statistic!r},\n  "
        return (
            f"FitSolution({measured}error={float(self.error.value):.9g} in {self.error:.9g},\n  "
            f"optimality={float(self.optimality):.1e}, steps={int(self.stats['steps'])}, {name_of(self.result)})"
        )
