"""What the entries return: witnesses and solutions; how they ended stands in jhd._results.outcomes, named here too.

Every class is a pytree of arrays, so solutions pass through jit and vmap; a batch of solutions is a solution whose
leaves have leading axes. JSON and files hold them as nested dictionaries, lists, numbers and names.
"""

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jhd._results.batches import AbstractSolution, shown_many
from jhd._results.batches import on_device as on_device
from jhd._results.outcomes import ANSWERS as ANSWERS
from jhd._results.outcomes import DIRECTIONS as DIRECTIONS
from jhd._results.outcomes import EVENTS as EVENTS
from jhd._results.outcomes import RESULTS as RESULTS
from jhd._results.outcomes import name_of as name_of
from jhd._results.outcomes import names_of as names_of
from jhd._results.outcomes import result_where as result_where
from jhd._results.unproven import NotProvenError as NotProvenError
from jhd._results.unproven import throw_unless_successful as throw_unless_successful
from jhd._runtime.arrays import is_traced
from jhd.decimals import interval_text, lower_text, point_text, upper_text


def stored_fields(value: eqx.Module) -> list[str]:
    """The names under which the contents of a result stand in files and JSON."""
    return [field.metadata.get("name", field.name) for field in fields(value) if field.metadata.get("stored", True)]


def to_plain(value: Any) -> Any:
    """Nested dictionaries, lists, numbers and names of a result, as JSON can hold them; non-finite numbers are None."""
    if hasattr(value, "_enumeration"):  # a member of an enumeration is a Module too
        return names_of(value)
    if isinstance(value, eqx.Module):
        return {name: to_plain(getattr(value, name)) for name in stored_fields(value)}
    if isinstance(value, dict):
        return {name: to_plain(item) for name, item in value.items()}
    if isinstance(value, jax.Array | np.ndarray):
        return to_plain(np.asarray(value).tolist())
    if isinstance(value, list):
        return [to_plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def with_result(solution: Any, result: Any) -> Any:
    """The same solution, ended in another way."""
    return eqx.tree_at(lambda s: s.result, solution, result)


def with_lengths(solution: Any, value: Any, lower: Any, upper: Any, point: Any, feet: Any) -> Any:
    """The same HausdorffSolution in another unit; the numbers may still be NumPy's, see `on_device`."""
    # By its leaves, in the order of the fields: making the two Modules anew costs five times as much.
    leaves, structure = jax.tree_util.tree_flatten(solution)
    leaves[:3], leaves[5:7] = (value, lower, upper), (point, feet)
    return jax.tree_util.tree_unflatten(structure, leaves)


def with_answers(solution: Any, answers: Sequence[tuple[Any, Any, Any, Any, Any]]) -> Any:
    """The same HausdorffSolution with other numbers: value, t, point, feet, foot_params; of its directions likewise."""
    leaves, structure = jax.tree_util.tree_flatten(solution)
    # The directions come last, each with as many leaves.
    size = len(jax.tree_util.tree_leaves(solution.directions)) // 2
    for begin, answer in zip((0, len(leaves) - 2 * size, len(leaves) - size), answers, strict=False):
        leaves[begin], (leaves[begin + 4], leaves[begin + 5], leaves[begin + 6]) = answer[0], answer[1:4]
        leaves[begin + 8] = answer[4]
    return jax.tree_util.tree_unflatten(structure, leaves)


def in_direction(solution: Any, direction: Any) -> Any:
    """The same solution, its witness in a direction: what measures from one shape to another knows of no other."""
    return replace(solution, witness=replace(solution.witness, direction=direction))


class Witness(eqx.Module):
    """Where a directed Hausdorff distance is attained; `direction` says which shape carries it and which the feet.

    Where `hausdorff` takes shapes of two kinds, `t` and `foot_params` have the shapes of the richer direction: a single
    number is repeated, and (u, v) is followed by a zero.

    Args:
        segment: index of the segment that carries the point; of points, of the point; of a mesh, of its triangle; of a
            parametric surface, of its Bezier patch; -1 on an implicit surface.
        t: parameter on it, in [0, 1], of shape (); of points too, where it says nothing; of a mesh, three barycentric
            coordinates; of a parametric surface, the parameters (u, v) of the patch; NaN on an implicit surface.
        point: the point there.
        feet: the active feet on the other shape: two rows where both shapes are curves or points, else four; those that
            are not used repeat the first one with multiplier 0.
        foot_segments: their segments, points, triangles or patches; -1 on an implicit surface.
        foot_params: their parameters, one number a foot on curves and points (where it says nothing), rows (u, v) on
            patches and rows of barycentric coordinates on meshes; NaN on an implicit surface.
        multipliers: weights of the feet in the gradient, non-negative with sum one (0.5 each where they are undefined).
        event: a member of EVENTS.
        direction: a member of DIRECTIONS.
    """

    segment: Int[Array, "*batch"]
    t: Float[Array, "*batch"] | Float[Array, "*batch corners"]
    point: Float[Array, "*batch dim"]
    feet: Float[Array, "*batch feet dim"]
    foot_segments: Int[Array, "*batch feet"]
    foot_params: Float[Array, "*batch feet"] | Float[Array, "*batch feet parameters"]
    multipliers: Float[Array, "*batch feet"]
    event: Any
    direction: Any

    def __repr__(self) -> str:
        if is_traced(self.t) or np.ndim(self.point) > 1:
            return f"Witness(t={eqx.tree_pformat(self.t)}, a batch or traced; index or vmap it)"
        numbers = {name: np.asarray(getattr(self, name)).tolist() for name in ("segment", "t", "point", "feet")}
        numbers |= {name: np.asarray(getattr(self, name)).tolist() for name in ("foot_segments", "foot_params")}
        shown = ", ".join(f"{name}={value}" for name, value in numbers.items())
        ends = f"multipliers={np.asarray(self.multipliers).tolist()}, event={name_of(self.event)}"
        return f"Witness({shown}, {ends}, direction={name_of(self.direction)})"


class AbstractDistance(AbstractSolution):
    """A distance with what is proven of it."""

    value: eqx.AbstractVar[Array]
    lower: eqx.AbstractVar[Array]
    upper: eqx.AbstractVar[Array]

    def __float__(self) -> float:
        if is_traced(self.value):
            raise TypeError("the distance is traced: it has no number before the program runs; take its `value` here.")
        return float(self.value)

    def __format__(self, spec: str) -> str:
        """Both bounds in a format of numbers, the lower one rounded down and the upper one up; without one the repr."""
        if not spec:
            return str(self)
        if is_traced(self.value) or np.ndim(self.value):
            raise TypeError("a format of numbers is for the bounds of one distance; these are traced, or a batch.")
        return interval_text(self.lower, self.upper, spec)

    def to_json(self, **options: Any) -> str:
        """The solution as JSON text: bounds that are not proven are null, enumerations are names.

        Args:
            options: handed to json.dumps, for example indent=2.
        """
        return json.dumps(to_plain(self), **options)


class HausdorffSolution(AbstractDistance):
    """A Hausdorff distance with its bounds: lower <= exact <= upper.

    `value` is what to differentiate. upper is inf where the method proves no upper bound, lower 0 where it proves no
    lower one. `stats` counts work (never seconds). `directed` says whether it is the distance from a to b alone; where
    it is the larger of both directed ones, `directions` holds these, from a to b and from b to a.
    `float(solution)` is the value, `f"{solution:.3f}"` both bounds, rounded outward.
    """

    value: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    witness: Witness
    result: Any
    stats: dict[str, Array]
    directed: bool = eqx.field(static=True, default=True)
    # Not stored: it is as much again for each direction.
    directions: "tuple[HausdorffSolution, HausdorffSolution] | None" = eqx.field(
        default=None, metadata={"stored": False}
    )

    @property
    def event(self) -> Any:
        """The event of the witness."""
        return self.witness.event

    @property
    def direction(self) -> Any:
        """The direction of the witness."""
        return self.witness.direction

    def __repr__(self) -> str:
        many = shown_many(self, "value")
        if many is not None:
            return many
        place = point_text(self.witness.point)
        return (
            f"HausdorffSolution(value={float(self.value)!r}, lower={lower_text(self.lower)}, "
            f"upper={upper_text(self.upper)},\n  {name_of(self.event)} at {place}, {name_of(self.direction)}, "
            f"{name_of(self.result)})"
        )


class MinimumSolution(AbstractDistance):
    """A minimum distance of two shapes with its bounds: lower <= exact <= upper.

    `value` is what to differentiate; it is about the distance of the two points. Where the shapes meet, `lower` is 0
    and `upper` what proves it: the points are that close. `stats` counts work (never seconds).

    Args:
        value: the distance found.
        lower: proven lower bound.
        upper: proven upper bound; inf where none is.
        point_a: the point of a that is nearest to b.
        point_b: the point of b that is nearest to a.
        result: a member of RESULTS.
        stats: counts.
    """

    value: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    point_a: Float[Array, "*batch dim"]
    point_b: Float[Array, "*batch dim"]
    result: Any
    stats: dict[str, Array]

    def __repr__(self) -> str:
        many = shown_many(self, "value")
        if many is not None:
            return many
        places = point_text(self.point_a), point_text(self.point_b)
        return (
            f"MinimumSolution(value={float(self.value)!r}, lower={lower_text(self.lower)}, "
            f"upper={upper_text(self.upper)},\n  between {places[0]} and {places[1]}, {name_of(self.result)})"
        )


class Projection(AbstractSolution):
    """Nearest points of a shape: distances with bounds, feet and their places; the shape of the queries is kept.

    Args:
        distance: distance to the foot.
        lower: proven lower bound of the distance to the whole shape; 0 for the local methods.
        upper: proven upper bound.
        foot: the nearest point found.
        segment: its segment; of a mesh, its triangle; of a parametric surface, the number of its Bezier patch; of a
            polynomial surface -1.
        t: its parameter there; of a mesh, the three barycentric coordinates, exactly 0 off a face; of a parametric
            surface, the parameters (u, v) of the patch; of a polynomial surface nan.
        result: a member of RESULTS for each query.
    """

    distance: Float[Array, "*batch"]
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    foot: Float[Array, "*batch dim"]
    segment: Int[Array, "*batch"]
    t: Float[Array, "*batch"] | Float[Array, "*batch corners"]
    result: Any

    def __repr__(self) -> str:
        many = shown_many(self, "distance")
        if many is not None:
            return many
        foot = point_text(self.foot)
        bounds = f"lower={lower_text(self.lower)}, upper={upper_text(self.upper)}"
        return f"Projection(distance={float(self.distance)!r}, {bounds},\n  foot {foot}, {name_of(self.result)})"


class StationaryPoints(AbstractSolution):
    """All stationary parameters of the distance from a point to a curve, in order along the curve, padded and masked.

    Where the distance is constant along a stretch (the centre of a circle), the stretch comes as one interval.

    Args:
        segment: the segment of each.
        t: a parameter inside the enclosure.
        lower: lower end of the enclosure; every stationary parameter is proven to lie in one.
        upper: upper end of it.
        distance: distance of the point at t.
        valid: which entries are enclosures; the others are padding.
        result: capacity_reached where some did not fit.
    """

    segment: Int[Array, "*batch capacity"]
    t: Float[Array, "*batch capacity"]
    lower: Float[Array, "*batch capacity"]
    upper: Float[Array, "*batch capacity"]
    distance: Float[Array, "*batch capacity"]
    valid: Bool[Array, "*batch capacity"]
    result: Any

    def __repr__(self) -> str:
        many = shown_many(self, "distance")
        if many is not None:
            return many
        numbers = np.asarray(self.distance)[np.asarray(self.valid)].tolist()
        return f"StationaryPoints(distance={numbers}, {name_of(self.result)})"


class CriticalPairs(AbstractSolution):
    """Local maxima of the distance between two curves, in both directions, largest first, padded and masked.

    Args:
        value: the distances, which are what to differentiate; 0 where there is no further maximum.
        witness: where they are attained, and in which direction.
        valid: which entries hold a maximum.
        result: capacity_reached where there were more.
    """

    value: Float[Array, "*batch capacity"]
    witness: Witness
    valid: Bool[Array, "*batch capacity"]
    result: Any

    def __repr__(self) -> str:
        many = shown_many(self, "value")
        if many is not None:
            return many
        numbers = np.asarray(self.value)[np.asarray(self.valid)].tolist()
        return f"CriticalPairs(value={numbers}, {name_of(self.result)})"


class Decision(AbstractSolution):
    """The answer to whether a distance is at most a threshold, with the bounds that were reached.

    `if` takes it for what it answers; where it is undecided that raises ValueError.

    Args:
        answer: a member of ANSWERS.
        lower: proven lower bound of the distance.
        upper: proven upper bound.
        result: why it is undecided where it is.
        stats: counts of the work in both directions.
        distance: which distance it is about: "directed" from a to b, "two_sided", the larger of both directed ones, or
            "minimum".
        point_a: of a minimum distance the point of a at which `upper` was reached, otherwise None.
        point_b: likewise of b.
    """

    answer: Any
    lower: Float[Array, "*batch"]
    upper: Float[Array, "*batch"]
    result: Any
    stats: dict[str, Array]
    distance: str = eqx.field(static=True, default="two_sided")
    point_a: Float[Array, "*batch dim"] | None = None
    point_b: Float[Array, "*batch dim"] | None = None

    def __bool__(self) -> bool:
        """Whether the answer is yes; an undecided one is neither.

        Raises:
            ValueError: it is undecided, or a batch of decisions.
        """
        if np.ndim(self.lower):
            raise ValueError(f"there are {np.size(self.lower)} decisions; look at `answer`, or index or vmap them.")
        if bool(self.answer == ANSWERS.undecided):
            bounds = f"between {lower_text(self.lower)} and {upper_text(self.upper)}"
            raise ValueError(f"undecided: the distance lies {bounds}; ask for a smaller atol, or read `answer`.")
        return bool(self.answer == ANSWERS.yes)

    def __repr__(self) -> str:
        many = shown_many(self, "lower")
        if many is not None:
            return many
        ends = f"lower={lower_text(self.lower)}, upper={upper_text(self.upper)}"
        return f"Decision({name_of(self.answer)}, {ends}, {name_of(self.result)}, distance={self.distance})"


class FitSolution(AbstractSolution):
    """A shape fitted by its Hausdorff distance, with the proven distance.

    Args:
        parameters: where the fit ended, in the form in which they were given.
        shape: the curve, surface or mesh that belongs to them.
        error: the proven Hausdorff distance of the target and the shape.
        optimality: length of sum mu_j g_j, with the gradients g_j of the largest maxima in the parameters and the best
            multipliers mu_j >= 0 of sum one; zero at a stationary point.
        multipliers: the mu_j of the critical pairs, largest distance first.
        pairs: the critical pairs of (target, shape); of surfaces and meshes the maximum of each direction, of fits by
            another measure the largest distance alone.
        result: successful, or why the fit stopped where it is not stationary.
        stats: counts of steps, of Newton steps among them, and of evaluations.
        history: the distance, or the measure that was fitted by, at the start and after each step.
        measured: that measure of (target, shape) with its bounds; None where it is the largest distance.
    """

    parameters: Any
    shape: Any
    error: HausdorffSolution
    optimality: Float[Array, ""]
    multipliers: Float[Array, " capacity"]
    pairs: CriticalPairs
    result: Any
    stats: dict[str, Array]
    history: Float[Array, " samples"]
    measured: Any = None

    def __float__(self) -> float:
        return float((self.error if self.measured is None else self.measured).value)

    def __repr__(self) -> str:
        measured = "" if self.measured is None else f"{self.measured!r},\n  "
        return (
            f"FitSolution({measured}error={float(self.error.value):.9g} in {self.error:.9g},\n  "
            f"optimality={float(self.optimality):.1e}, steps={int(self.stats['steps'])}, {name_of(self.result)})"
        )
