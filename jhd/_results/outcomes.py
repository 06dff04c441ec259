"""How computations end, how a maximum arises, what is answered, and from where to where: enumerations of sentences."""

from typing import Any

import equinox as eqx
import numpy as np
import optimistix as optx
from jaxtyping import Array


class RESULTS(optx.RESULTS):  # pyright: ignore[reportGeneralTypeIssues]
    """How a computation ended; `RESULTS.successful` means that everything that was asked for holds."""

    gap_not_closed = "The bounds are true but wider than the tolerance asked for: raise max_steps, or atol or rtol."
    capacity_reached = (
        "A queue of fixed length was full, so the answer is true but wider or incomplete: raise capacity (or max_cells "
        "or max_boxes, where that is its name), or atol or rtol."
    )
    interrupted = "The search was interrupted: the bounds are those it had reached."
    fit_steps_exhausted = "The fit was still improving when its steps were used up: raise max_steps."
    fit_out_of_time = "The time ran out: this is the best so far. Raise max_seconds, or begin with its parameters."
    fit_in_a_valley = (
        "The fit creeps along a valley, by less than a thousandth a step: fix what slides (a parametrisation, a "
        "weight), start elsewhere, or raise max_steps."
    )
    fit_at_a_kink = (
        "No step lowers the distance although its maxima could be lowered to first order: two feet change places "
        "there, or a maximum is born. Start elsewhere."
    )
    fit_missed_a_maximum = (
        "The proven distance is above all maxima that the fit worked with: one is narrower than the samples are apart. "
        "Split the curves, or start elsewhere."
    )
    fit_at_rounding = (
        "What is left to gain is below the rounding of the coordinates: scale or centre them, or be content with it."
    )
    unproven = (
        "The answer is that of a published method which can miss the exact value and proves no bound: take the default "
        "method for bounds."
    )
    unverified = (
        "No cell, or none of those that count, could be proven to hold a point of one of the surfaces, so a bound is "
        "missing or wide: raise cells. Where a polynomial does not change its sign only single points that simple "
        "fractions name can be proven."
    )
    family_of_maxima = (
        "The bounds are true but wider than asked for: a whole curve or region of points is about as far as the "
        "farthest one, or about as near as the nearest, and the work grows like the inverse of the gap: raise atol, or "
        "max_steps."
    )
    many_nearest_points = (
        "The bounds are true but not closed: a whole curve or region of the shape is about as near as its nearest "
        "point, or a surface has a cuspidal edge there. Use lower and upper, or move the query."
    )
    empty_surface = "A surface is proven to have no point in its box, so there is no distance: check its box."
    nonfinite_value = (
        "An input that was not known when the program was compiled cannot be used: it holds a NaN or an infinity, or "
        "weights that are not positive or differ by too large a ratio."
    )


# It is inherited without a sentence; a second definition of a member would warn.
RESULTS._index_to_message[int(RESULTS.successful._value)] = "Everything that was asked for holds."  # pyright: ignore


class EVENTS(eqx.Enumeration):
    """How the maximum of the distance from a to b arises (Elber & Grandine 2008; Cao et al. 2014)."""

    a_end = "It is attained at a free end of a."
    corner = "It is attained at a joint of a where the tangent jumps."
    b_end = "Its foot is a free end or a corner of b, and its distance is stationary along a."
    antipodal = "The joining line is normal to both curves."
    one_to_two = "Two feet on b are equally near: a crosses the self-bisector of b."
    coincident = "The distance is zero: a lies on b."


class ANSWERS(eqx.Enumeration):
    """Whether a distance is at most a threshold."""

    yes = "Proven: the distance is at most the threshold."
    no = "Proven: the distance is larger than the threshold."
    undecided = "The bounds reached lie on both sides of the threshold."


class DIRECTIONS(eqx.Enumeration):
    """Which curve carries the point whose distance to the other one is the Hausdorff distance."""

    a_to_b = "The point lies on a, its feet on b."
    b_to_a = "The point lies on b, its feet on a."


def result_where(condition: Array, yes: Any, no: Any) -> Any:
    """RESULTS.where, which type checkers take for a method of a plain enumeration."""
    return RESULTS.where(condition, yes, no)


def name_of(item: Any) -> str:
    """The name of a member of RESULTS, EVENTS, ANSWERS or DIRECTIONS; the members themselves print their sentence."""
    index = int(item._value)
    for name, member in item._enumeration._name_to_item.items():
        if int(member._value) == index:
            return name
    raise ValueError(f"{index} is no member of {item._enumeration.__name__}.")


def names_of(item: Any) -> Any:
    """The name of a member, or the names of an array of members, in one list."""
    by_index = {int(member._value): name for name, member in item._enumeration._name_to_item.items()}
    values = np.asarray(item._value)
    return by_index[int(values)] if values.ndim == 0 else [by_index[int(i)] for i in np.ravel(values)]
