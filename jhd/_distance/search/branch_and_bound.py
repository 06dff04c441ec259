"""The default method: certified lower and upper bounds, closed by branch and bound.

This file holds its options and how it runs inside a compiled function. The search itself is in
jhd._distance.search.curves.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import sequential_vmap
from jaxtyping import Array
from typing_extensions import override

from jhd._distance.nearest.blocks import is_long
from jhd._distance.nearest.near_curve import near_curve
from jhd._distance.normalization.coordinates import Frame
from jhd._distance.normalization.method import AbstractHausdorffMethod, AbstractMethod
from jhd._distance.normalization.stopping import Aim, Wanted
from jhd._distance.search.candidates import Target
from jhd._distance.search.curves import advance, begin, solution_of
from jhd._distance.search.search import Watch
from jhd._distance.search.solutions import CoveredPair, in_one_go
from jhd._results.solution import DIRECTIONS, HausdorffSolution
from jhd._runtime.argument_hints import belongs
from jhd._runtime.arrays import check_scalar, check_whole, is_traced, real_array, same_arrays
from jhd._runtime.clock import Clock
from jhd._shapes.checks import Numbers, optional_array
from jhd._shapes.curve import BezierSegments
from jhd.progress import Callback

Chosen = TypeVar("Chosen", bound=AbstractMethod)
# Rows of a table for surfaces, for each row of a table for curves.
_SURFACE_ROWS = 32
# Segments of a long curve for each initial row of its table.
_LONG_SHARE = 8


def _relative(given: Numbers) -> Array:
    return real_array("rtol", given)


class BranchAndBound(AbstractHausdorffMethod):
    """Branch and bound, the default method: certified bounds, lower <= exact <= upper, closed to a tolerance.

    >>> import jhd
    >>> method = jhd.BranchAndBound(atol=1e-3)
    >>> found = jhd.directed_hausdorff(jhd.point_set([(0, 0), (4, 0)]), jhd.point_set([(0, 3)]), method)
    >>> bool(found.upper - found.lower <= 1e-3)
    True

    Args:
        rtol: tolerance relative to `upper`, at least 0; by default 0. The larger tolerance counts.
        atol: absolute tolerance on `upper - lower`, in the unit of the coordinates. The default is 1e-10 (in float32:
            64 units in the last place) of the diagonal of the joint bounding box, or the rounding error if that is
            larger. The box holds control points, vertices and the boxes of implicit surfaces: see `bounds` of each
            shape. If rounding prevents the given tolerance, the result is RESULTS.gap_not_closed.
        max_steps: largest number of steps. For Hausdorff distances a step cuts four cells (implicit surfaces: 32,
            meshes: 16 384); for minimum distances see `minimum_distance`.
        queue_size: initial size of the queue of open cells, at least twice the number of segments of `a`. Outside jit
            and vmap it grows automatically for curves and minimum distances. Implicit surfaces use 32 times this size,
            rounded up to a power of two, and scale the nearest-point search with it. Meshes hold 2048 times as many
            cells.
    """

    rtol: Array = eqx.field(default=0.0, converter=_relative, kw_only=True)
    atol: Array | None = eqx.field(default=None, converter=optional_array("atol"), kw_only=True)
    max_steps: int = eqx.field(static=True, default=4000)
    queue_size: int = eqx.field(static=True, default=512)

    def __check_init__(self) -> None:
        check_scalar("atol", self.atol)
        check_scalar("rtol", self.rtol)
        check_whole("max_steps", self.max_steps, 0)
        check_whole("queue_size", self.queue_size, 16)

    @classmethod
    @override
    def serves(cls, a: object, b: object) -> bool:
        """Whether the method can measure this pair: always true."""
        return True

    def _directed(self, a: BezierSegments, b: BezierSegments, frame: Frame, aim: Aim) -> HausdorffSolution:
        """The distance from `a` to `b` in common coordinates, in one loop; called by `jhd.directed_hausdorff`.

        In a batch on a CPU the searches run one after the other: side by side, all would take as long as the longest
        one. On other devices they run side by side.
        """

        def search(a: BezierSegments, b: BezierSegments, wanted: Wanted) -> HausdorffSolution:
            near = near_curve(b, is_long(a) or is_long(b))
            state = begin(a, near, wanted, max(self.queue_size, 2 * a.count))
            return solution_of(a, near, wanted, advance(a, near, wanted, state, self.max_steps))

        if jax.default_backend() == "cpu":
            search = sequential_vmap(search)
        return search(a, b, wanted_of(self, frame, aim))

    def _directed_surfaces(self, pair: CoveredPair, frame: Frame, aim: Aim, direction: DIRECTIONS) -> HausdorffSolution:
        """The directed distance of surfaces in common coordinates, in one loop; called by `jhd.directed_hausdorff`."""

        def search(pair: CoveredPair, wanted: Wanted) -> HausdorffSolution:
            return in_one_go(pair, wanted, length_of_table(self, pair.a), self.max_steps, direction)

        if jax.default_backend() == "cpu":
            search = sequential_vmap(search)
        return search(pair, wanted_of(self, frame, aim))


@lru_cache(maxsize=1)
def default_method() -> BranchAndBound:
    """Return BranchAndBound(), made once: its checks take as long as preparing a curve."""
    # If first called inside a trace, its numbers would be tracers of that trace.
    with jax.ensure_compile_time_eval():
        return BranchAndBound()


# Sizes are options of the method, and tolerances have other names elsewhere.
_TOLERANCE = "write atol=... (a length) or rtol=... (relative to upper)"
sized_by_method = belongs(
    **{name: f"write method=jhd.BranchAndBound({name}=...)" for name in ("max_steps", "queue_size")},
    **dict.fromkeys(("tol", "tolerance"), _TOLERANCE),
)


def chosen_method(method: Chosen | None, rtol: Any, atol: Any) -> Chosen | BranchAndBound:
    """Return the method of a call, BranchAndBound() if it is None, with the tolerances of the call.

    Raises:
        TypeError: a tolerance is given, and the method has it already or none.
    """
    given = {name: value for name, value in (("rtol", rtol), ("atol", atol)) if value is not None}
    if method is None:
        return BranchAndBound(**given) if given else default_method()
    if not given:
        return method
    if not isinstance(method, BranchAndBound):
        raise TypeError(f"{' and '.join(given)} cannot be combined with {type(method).__name__}: pass its own options.")
    known = {name: getattr(method, name) for name in given}
    # A method made inside jit holds its default as a tracer.
    twice = [
        name for name, x in known.items() if not is_traced(x) and not same_arrays(x, getattr(default_method(), name))
    ]
    if twice:
        raise TypeError(f"{' and '.join(twice)} stands in the method and in the call: pass it once.")
    return replace(method, **given)


def limited(
    method: Any, progress: Callback | None, max_seconds: float | None, threshold: float | None = None
) -> Callback | None:
    """The callback of a call, which also ends the search after `max_seconds` of wall time or at a threshold, if given.

    Raises:
        TypeError: `max_seconds` is not a number, or the method is no search with bounds at every stage.
        ValueError: `max_seconds` is not positive.
    """
    if max_seconds is None and threshold is None:
        return progress
    clock = Clock(max_seconds)
    if not isinstance(method, BranchAndBound):
        raise TypeError(f"max_seconds cannot be combined with {type(method).__name__}: it needs BranchAndBound.")
    return Watch(progress, clock, threshold)


# Functions and no methods: a method of a Module is made anew wherever it is taken, which costs more than these do.
def length_of_table(method: BranchAndBound, a: BezierSegments | Target) -> int:
    """Return the initial number of cells in the queue."""
    if not isinstance(a, BezierSegments):
        return _SURFACE_ROWS * (1 << (method.queue_size - 1).bit_length())
    # Few cells of a long curve are left when the first bounds are known; if more are left, it begins anew with room.
    return max(method.queue_size, a.count // _LONG_SHARE if is_long(a) else 2 * a.count)


def wanted_of(method: BranchAndBound, frame: Frame, aim: Aim) -> Wanted:
    """Return the tolerances and the aim in common coordinates."""
    xp: Any = jnp if is_traced(method, frame) else np
    # One compiled function serves a given tolerance and the default one.
    atol = xp.asarray(-1.0 if method.atol is None else frame.common(method.atol), frame.center.dtype)
    return Wanted(atol, xp.asarray(method.rtol, frame.center.dtype), aim)
