"""Enumerations whose members are sentences: results, events, answers and directions."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
import optimistix as optx
from jaxtyping import Array


class RESULTS(optx.RESULTS):  # pyright: ignore[reportGeneralTypeIssues]
    """How a computation ended; the member successful says that all requested bounds and conditions hold.

    `RESULTS[member]` is the sentence of a member.
    """

    if TYPE_CHECKING:
        # Inherited; type checkers would take it for a member of the base class alone.
        successful = ""
    gap_not_closed = (
        "The bounds are true but wider than the tolerance: raise max_steps of BranchAndBound, or atol or "
        "rtol if rounding keeps them apart."
    )
    capacity_reached = (
        "The search ran out of room, so the result is true but wider or incomplete: raise the size that "
        "the call takes (queue_size, max_cells, max_boxes or capacity), or atol or rtol."
    )
    interrupted = "The search was interrupted: the bounds are true and not closed."
    fit_steps_exhausted = "The fit was still improving at its last step: raise max_steps."
    out_of_time = (
        "The time limit was reached: the bounds are true and not closed, and a fit is the best so far. Raise "
        "max_seconds, or the tolerance."
    )
    fit_slow_progress = (
        "Slow progress (under 0.1 % a step): the problem is nearly degenerate. Fix redundant parameters, change the "
        "start or raise max_steps."
    )
    fit_nonsmooth_stall = (
        "The gradient predicts a descent, but no step achieves it: a foot point jumps there, or a new maximum appears. "
        "Change the start."
    )
    fit_missed_a_maximum = (
        "The certified distance exceeds all maxima that the fit used: a maximum is narrower than the sample spacing. "
        "Split the curves, or change the start."
    )
    fit_tolerance_missed = (
        "The certified distance to the target exceeds the tolerance: raise tolerance, max_segments or max_steps."
    )
    fit_roundoff_limited = (
        "The remaining improvement is below the rounding of the coordinates: accept the result, or scale or center the "
        "coordinates."
    )
    not_certified = (
        "The result comes from a published method that can miss the exact value and certifies no bound: use the "
        "default method for bounds."
    )
    existence_not_certified = (
        "Could not certify that a surface has a point in the relevant cells, so a bound is missing or wide: raise "
        "cells. If a polynomial does not change its sign, only single points at simple fractions can be certified."
    )
    nonisolated_maxima = (
        "The bounds are true but wider than the tolerance: a whole curve or region of points is nearly as far as the "
        "farthest point, or as near as the nearest. The work grows like 1 / gap: raise atol or max_steps."
    )
    many_nearest_points = (
        "The bounds are true but not closed: a whole curve or region of the shape is nearly as near as its nearest "
        "point, a surface has a cuspidal edge there, or weights are very uneven. Use lower and upper, or another query."
    )
    empty_surface = "A surface is certified to be empty in its box, so the distance is undefined: check its box."
    nonfinite_value = (
        "An input that was traced is invalid: correct NaN, infinity, or weights that are not positive or differ by too "
        "large a ratio."
    )


# It is inherited without a sentence; a second definition of a member would warn.
RESULTS._index_to_message[int(RESULTS.successful._value)] = "All requested bounds and conditions hold."  # pyright: ignore


class EVENTS(eqx.Enumeration):
    """How the maximum of the distance arises (Elber & Grandine 2008; Cao et al. 2014).

    - a_end: the farthest point is a free end of its shape.
    - corner: the farthest point is a corner of its shape.
    - b_end: its foot point is a free end or a corner of the other shape.
    - antipodal: the line from the farthest point to its foot point is normal to both shapes.
    - one_to_two: two foot points are equally near.
    - coincident: the distance is zero.

    In these names, a is the shape with the farthest point and b the shape with its foot points, whichever was passed
    first. An end of a surface is its border, or a face of its box. Compare with a member, as in
    `solution.event == jhd.EVENTS.corner`; `jhd.EVENTS[solution.event]` is its sentence, and `solution.to_dict()` holds
    its name.
    """

    a_end = "The farthest point is a free end of its shape."
    corner = "The farthest point is a corner of its shape (a joint at which the tangent jumps, an edge or a vertex)."
    b_end = (
        "The foot point is a free end or a corner of the other shape. For parametric surfaces and mixed pairs, the "
        "line from the point to its foot point may also be normal to both shapes."
    )
    antipodal = "The line from the farthest point to its foot point is normal to both shapes."
    one_to_two = "Two foot points are equally near: the point lies on the self-bisector of the other shape."
    coincident = "The distance is zero: one shape lies on the other."


class ANSWERS(eqx.Enumeration):
    """Answers to the question whether a distance is at most a threshold: yes, no and undecided."""

    yes = "Certified: the distance is at most the threshold."
    no = "Certified: the distance is larger than the threshold."
    undecided = "Undecided: the threshold lies between the bounds reached; `result` tells why."


class DIRECTIONS(eqx.Enumeration):
    """The shape that carries the point that attains the Hausdorff distance.

    The members are a_to_b and b_to_a. Compare with a member, as in `solution.direction == jhd.DIRECTIONS.b_to_a`.
    """

    a_to_b = "The point lies on a, its foot points on b."
    b_to_a = "The point lies on b, its foot points on a."


def result_where(condition: Array, yes: Any, no: Any) -> Any:
    """RESULTS.where with types: type checkers take it for a method of a plain enumeration."""
    return RESULTS.where(condition, yes, no)


def name_of(item: Any) -> str:
    """The name of a member of RESULTS, EVENTS, ANSWERS or DIRECTIONS. Printing a member shows its sentence."""
    index = int(item._value)
    for name, member in item._enumeration._name_to_item.items():
        if int(member._value) == index:
            return name
    raise ValueError(f"{index} is no member of {item._enumeration.__name__}.")


def names_of(item: Any) -> Any:
    """The name of a member, or the names of an array of members in one list."""
    by_index = {int(member._value): name for name, member in item._enumeration._name_to_item.items()}
    values = np.asarray(item._value)
    return by_index[int(values)] if values.ndim == 0 else [by_index[int(i)] for i in np.ravel(values)]
