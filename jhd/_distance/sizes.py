"""Lengths of curves and areas of surfaces, with certified bounds."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jhd._distance.deviation import in_space, user_measure
from jhd._distance.deviation_solution import Bounds
from jhd._distance.search.bodies import body_of
from jhd._distance.search.body import joint_diagonal, together
from jhd._results.unproven import NotProvenError
from jhd._runtime.arrays import check_scalar, check_whole, is_traced, joined, real_array
from jhd._runtime.clock import Clock
from jhd._runtime.decimals import interval_text
from jhd._shapes.as_shape import ShapeLike, check_shape, taken_as
from jhd._shapes.checks import Numbers
from jhd._shapes.sizes import SIZE_OF


def arc_length(
    curve: ShapeLike,
    *,
    rtol: Numbers = 1e-6,
    atol: Numbers | None = None,
    max_cells: int = 1 << 18,
    throw: bool = True,
    max_seconds: float | None = None,
) -> Bounds:
    """The length of a curve with certified bounds; parts that are traversed twice count twice.

    >>> import jhd
    >>> found = jhd.arc_length(jhd.circle((0, 0), 1.0))
    >>> bool(found.lower <= 2 * 3.14159265358979 and found.upper >= 2 * 3.14159265358980)
    True

    Args:
        curve: a curve in the plane or in space, or an object that `jhd.as_shape` accepts; not a point set.
        rtol: tolerance on `upper - lower`, relative to `upper`, at least 0. The number of cells grows like
            1 / sqrt(rtol); straight segments need none.
        atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; by default 1e-12 of the diagonal of
            the bounding box. The larger tolerance counts.
        max_cells: largest number of cells.
        throw: whether to raise NotProvenError if the bounds do not close; by default True.
        max_seconds: wall time in seconds after which no further cells are cut; by default no limit.

    Returns:
        Bounds of the length, in the unit of the coordinates.

    Raises:
        TypeError: another shape than a curve, or a traced one.
        ValueError: a tolerance that is negative or not one number, `max_cells` below 16, or `max_seconds` not positive.
        NotProvenError: `max_cells` or `max_seconds` were not enough, and `throw` is True. The exception carries the
            bounds reached.
    """
    curve = taken_as("curve", curve)
    check_shape("curve", curve)
    if body_of(curve).dimension != 1:
        raise TypeError(f"curve is a {type(curve).__name__}; needs a curve with a length.")
    return _closed(curve, rtol, atol, max_cells, throw, Clock(max_seconds))


def surface_area(
    surface: ShapeLike,
    *,
    rtol: Numbers = 1e-4,
    atol: Numbers | None = None,
    max_cells: int = 1 << 18,
    throw: bool = True,
    max_seconds: float | None = None,
) -> Bounds:
    """The area of a parametric surface or a mesh with certified bounds; parts that lie on each other count twice.

    >>> import jhd
    >>> found = jhd.surface_area(jhd.TriangleMesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]]))
    >>> bool(found.lower <= 2 <= found.upper)
    True

    Args:
        surface: a mesh, a parametric surface, or an object that `jhd.as_shape` accepts. For an implicit surface pass
            `surface.to_mesh(tolerance).shape`, whose area differs from the area of the surface.
        rtol: tolerance on `upper - lower`, relative to `upper`, at least 0. The number of cells grows like 1 / rtol;
            flat pieces need none.
        atol: absolute tolerance on `upper - lower`, in the square of the unit of the coordinates; by default 1e-12 of
            the squared diagonal of the bounding box. The larger tolerance counts.
        max_cells: largest number of cells.
        throw: whether to raise NotProvenError if the bounds do not close; by default True.
        max_seconds: wall time in seconds after which no further cells are cut; by default no limit.

    Returns:
        Bounds of the area, in the square of the unit of the coordinates.

    Raises:
        TypeError: another shape than a mesh or a parametric surface, or a traced one.
        ValueError: a tolerance that is negative or not one number, `max_cells` below 16, or `max_seconds` not positive.
        NotProvenError: `max_cells` or `max_seconds` were not enough, and `throw` is True. The exception carries the
            bounds reached.
    """
    surface = taken_as("surface", surface)
    check_shape("surface", surface)
    if body_of(surface).dimension != 2:
        raise TypeError(f"surface must be a mesh or a parametric surface; got {type(surface).__name__}.")
    clock = Clock(max_seconds)
    if body_of(surface).lacks_area():
        return Bounds(0.0, 0.0)
    return _closed(surface, rtol, atol, max_cells, throw, clock)


SIZE_OF.update(length=arc_length, area=surface_area)


def _closed(shape: Any, rtol: Any, atol: Any, max_cells: int, throw: bool, clock: Clock) -> Bounds:
    """Return bounds of the length or area of a shape, cutting cells until they meet a tolerance."""
    if is_traced(shape):
        raise TypeError("the shape is traced; its cells depend on its numbers, so these must be concrete.")
    given, relative = None if atol is None else real_array("atol", atol), real_array("rtol", rtol)
    check_scalar("rtol", relative)
    check_scalar("atol", given)
    check_whole("max_cells", max_cells, 16)
    # Numbers of single precision are numbers of double precision, in which all of this is computed.
    relative, body = float(relative), body_of(jax.tree_util.tree_map(_doubled, in_space(shape).shape))
    pair = together(body, body)
    source = body.measured(pair.a, pair.moved, None)
    diagonal = joint_diagonal(body)
    if diagonal == 0:  # all control points are one
        return Bounds(0.0, 0.0)
    with np.errstate(over="ignore", under="ignore"):
        # The default tolerance, as a fraction of the diagonal or of its square.
        share = 1e-12 * np.float64(diagonal) ** source.dimension
    # Bounds of a measure below the normal numbers are one of these apart at least.
    absolute = max(float(share), np.finfo(np.float64).tiny) if given is None else float(given)
    cells = source.cover()
    flat, found = source.flat(cells), Bounds(0.0, np.inf)
    while True:
        # Each cell is rounded, so more of them may prove less.
        now = user_measure(pair.frame, source.dimension, flat)
        found = Bounds(max(found.lower, now.lower), min(found.upper, now.upper))
        if found.upper - found.lower <= max(absolute, relative * found.upper):
            return found
        gap = flat.upper - flat.lower
        order = np.argsort(-gap)
        # The cells that are cut hold this fraction of the gap.
        wide = order[: 1 + int(np.searchsorted(np.cumsum(gap[order]), 0.8 * np.sum(gap)))]
        full = len(gap) + 3 * len(wide) > max_cells
        if full or clock.is_over():
            if not throw:
                return found
            text, limit = interval_text(found.lower, found.upper, ".6g"), "max_cells" if full else "max_seconds"
            raise NotProvenError(f"{len(gap)} cells prove {text} only. Raise a tolerance or {limit}.", found)
        parts, _ = source.cut(cells.take(wide), flat.take(wide))
        kept = np.delete(np.arange(len(gap)), wide)
        cells = joined([cells.take(kept), parts])
        flat = joined([flat.take(kept), source.flat(parts)])


def _doubled(x: Any) -> Any:
    return np.asarray(x, np.float64) if jnp.issubdtype(x.dtype, jnp.floating) else x
