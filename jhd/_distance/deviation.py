"""Distribution of the distance to one shape over another: maximum, mean, root mean square, quantiles and fractions."""

from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from jhd._arithmetic.rationals import float_near
from jhd._arithmetic.scaling import common_exponent
from jhd._distance.cells.arc_length_area import FlatCells
from jhd._distance.cells.weighted import exact_sum
from jhd._distance.deviation_solution import Bounds, Deviation, DistanceSamples, UndifferentiatedBounds, check_share
from jhd._distance.hausdorff import directed_hausdorff
from jhd._distance.normalization.coordinates import Frame, user_length
from jhd._distance.search.bodies import body_of
from jhd._distance.search.body import AbstractBody, Together, dtype_of, joint_diagonal, together
from jhd._distance.search.branch_and_bound import BranchAndBound, limited
from jhd._distance.search.distribution import COUNTS, DistanceCells, Distribution, DistributionSearch
from jhd._distance.search.search import Listener, Watch, drive
from jhd._distance.search.weighted_cells import AbstractMeasured
from jhd._results.solution import (
    RESULTS,
    HausdorffSolution,
    name_of,
    throw_unless_successful,
)
from jhd._results.unproven import relative_tolerance
from jhd._runtime.arrays import check_scalar, check_whole, is_traced, real_array, taken, undifferentiated
from jhd._shapes.as_shape import ShapeLike, check_shape, taken_as
from jhd._shapes.checks import Numbers, check_same_dim
from jhd._shapes.prepared import working
from jhd.progress import Callback

# Times that the largest cells are cut if none has a proven length or area, and number of cells cut each time.
_LOOKS, _LOOKED_AT = 12, 16


class _Asked(NamedTuple):
    """Requested accuracy: tolerances, the fraction of a quantile that must meet them too (or None), and most cells."""

    atol: float
    rtol: float
    quantile: float | None
    max_cells: int


def deviation(
    a: ShapeLike,
    b: ShapeLike,
    *,
    rtol: Numbers = 1e-3,
    atol: Numbers | None = None,
    quantile: float | None = None,
    weights: Numbers | None = None,
    max_cells: int = 1 << 17,
    throw: bool = True,
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> Deviation:
    """Distribution of the distance to `b` over `a`: maximum, mean, RMS and quantiles, each with certified bounds.

    The shape `a` is cut into cells. Their lengths or areas, and their distances to `b`, have certified bounds. The
    cells that contribute most to the gaps of mean and RMS are cut further, until both gaps are within the tolerance.
    The result refers to the stored numbers. Parts that `a` covers twice count twice.

    - If `b` is a curve or a parametric surface, the gap of cells much smaller than the radius of curvature shrinks with
      the fourth power of their size, unless `a` crosses `b` in the cell. By default a mesh of a thousand triangles,
      compared with the surface it approximates, needs about forty cells a triangle.
    - If `b` is an implicit surface, the gap is of second order, so the number of cells grows like 1 / gap. Choose a
      larger `rtol` if the distance is small.
    - Between two meshes, the distance to the nearest face is the absolute value of an affine function. Its mean, mean
      square and quantiles have closed forms, also if the meshes cross. Cells are cut at changes of the nearest face and
      at crossings.
    - Quantiles and fractions come from the same cells. Their bounds are as wide as the distance varies within a cell;
      `rtol` covers only the quantile that you pass.

    Meshes that cross a curved `b` many times, such as noisy scans, take minutes, also with `rtol=1e-2`: begin with
    `rtol=0.05, max_seconds=60, throw=False`, and read the bounds. The largest deviation lies at
    `maximum.witness.point`.

    `maximum.value` and the distances of `at(params)` have first derivatives in both shapes. The derivative of
    `maximum.value` has an error of about the square root of its gap. The mean and all bounds have no derivative: their
    `value` raises TypeError under `jax.grad`; use `jhd.MeanDistance().estimate` there. The shapes must be concrete:
    deviation does not work under jit or vmap.

    >>> import jhd
    >>> found = jhd.deviation(jhd.polyline([(0, 0), (1, 0)]), jhd.point_set([(0, 0)]))
    >>> found.mean.lower <= 0.5 <= found.mean.upper, found.mean.upper - found.mean.lower < 1e-3
    (True, True)

    Args:
        a: points (`jhd.point_set`), a curve, a parametric surface or a mesh, or an object that `jhd.as_shape` accepts.
        b: a shape of any kind (implicit surfaces too) and of the same dimension, or an object that `jhd.as_shape`
            accepts.
        rtol: tolerance relative to the upper bound, at least 0; by default 1e-3. The larger tolerance counts.
        atol: absolute tolerance on `upper - lower`, in the unit of the coordinates; by default 1e-6 of the diagonal of
            the joint bounding box.
        quantile: order of a quantile, above 0 and at most 1, that must reach the tolerance too; by default none.
        weights: weights of the points of `a`, of shape (points,), at least 0; by default one each. They do not affect
            the maximum.
        max_cells: largest number of cells, at least 16.
        throw: whether to raise NotProvenError if the tolerance is not reached; by default True.
        max_seconds: wall time in seconds after which the searches end with the bounds reached, as soon as the cells
            of the current step have bounds; by default no limit.
        progress: a function that is called with a Progress after each step, first for the maximum, then for the mean.
            A step with many cells takes seconds.

    Returns:
        A Deviation: bounds of the statistics, and methods for quantiles and fractions.

    Raises:
        TypeError: an object that is not a shape, traced shapes, an ImplicitSurface as `a` (its area is not certified),
            or weights for a shape that is not a point set.
        ValueError: the dimensions differ, `b` has no point in its box, `a` has no length or area, or a tolerance is
            negative.
        NotProvenError: the tolerance was not reached, or the search was interrupted, and `throw` is True. The
            `solution` of the exception is the Deviation, whose bounds are true.
    """
    a, b = taken_as("a", a), taken_as("b", b)
    absolute, relative = _checked(a, b, atol, rtol, max_cells)
    tolerance, counts = BranchAndBound(atol=absolute, rtol=relative), checked_weights(a, weights)
    if quantile is not None:
        check_share("quantile", quantile)
    progress = limited(tolerance, progress, max_seconds)
    maximum = directed_hausdorff(a, b, tolerance, throw=False, progress=progress)
    asked = _Asked(absolute, relative, quantile, max_cells)
    found, pair, measure = _distributed(a, b, asked, counts, maximum, progress)
    deviation = _in_units(a, b, maximum, found, pair, measure)
    if throw:
        known = deviation._reached(quantile)
        throw_unless_successful(deviation, known, relative_tolerance(known))
    return deviation


def check_kinds(a: Any, b: Any, directed: bool = True) -> None:
    """Raise TypeError or ValueError unless `deviation` serves these shapes; traced shapes are checked too.

    Args:
        a: the shape that the distances are taken over.
        b: the shape that they lead to.
        directed: False if they are taken over b as well.
    """
    for name, shape in (("a", a), ("b", b)):
        check_shape(name, shape)
    for name, shape in (("a", a),) if directed else (("a", a), ("b", b)):
        body = body_of(shape)
        if body.dimension is None:
            refused = "an ImplicitSurface, whose area is not certified; pass a mesh or a parametric surface."
            raise TypeError(f"{name} is {refused}")
        if body.lacks_area():
            raise ValueError(f"{name} has no area, so averages are undefined; a patch of degree zero is a curve.")
    check_same_dim(a.dim, b.dim)


def _checked(a: Any, b: Any, atol: Any, rtol: Any, max_cells: int) -> tuple[float, float]:
    """Return both tolerances as floats: `atol` in the user's unit and `rtol`."""
    check_kinds(a, b)
    if is_traced(*jax.tree_util.tree_leaves(undifferentiated((a, b)))):
        raise TypeError(
            "deviation needs concrete shapes, because its cells depend on them. Under jit use "
            "MeanDistance, RMSDistance or QuantileDistance, and directed_hausdorff for the maximum."
        )
    check_whole("max_cells", max_cells, 16)
    if rtol is None:
        raise TypeError("rtol is None; needs a number of at least 0.")
    given = None if atol is None else real_array("atol", atol)
    relative = real_array("rtol", rtol)
    check_scalar("atol", given)
    check_scalar("rtol", relative)
    if given is None:
        size = joint_diagonal(in_space(a), in_space(b))
        # Without a given tolerance, gaps up to this fraction of the diagonal stay.
        given = 1e-6 * min(size, np.finfo(np.asarray(size).dtype).max)
    return float(given), float(relative)


def checked_weights(a: Any, weights: Any) -> Any:
    """Return the weights of the points of a, checked: finite, none negative, some positive; None for None."""
    if weights is None:
        return None
    if body_of(a).dimension != 0:
        raise TypeError(f"weights need a point set; a is {type(a).__name__}: leave weights out.")
    rows, count = real_array("weights", weights), a.segments().count
    known = undifferentiated(rows)
    hidden = is_traced(known)
    known = known if hidden else np.asarray(known, np.float64)
    sound = hidden or bool(np.all(np.isfinite(known) & (known >= 0)) and np.any(known > 0))
    if not (known.shape == (count,) and sound):
        raise ValueError(f"weights has shape {known.shape}; needs ({count},), finite, none negative and some positive.")
    return rows if is_traced(rows) else known


def in_space(shape: Any) -> AbstractBody:
    """Return the body of a shape as searches take it: nothing traced, and plane shapes at height zero."""
    return body_of(body_of(working(undifferentiated(shape))).in_space())


def _distributed(
    a: Any,
    b: Any,
    asked: _Asked,
    counts: np.ndarray | None,
    maximum: HausdorffSolution,
    progress: Any,
) -> tuple[Distribution, Together, Bounds]:
    """Return the distribution in common coordinates, the shapes in them, and the measure of a in the user's unit."""
    a, b = in_space(a), in_space(b)
    pair = together(a, b)
    frame, moved = pair.frame, pair.moved
    source = a.measured(pair.a, moved, _moderate(counts))
    target, size = b.target_in(pair.b)
    dtype = dtype_of(a.shape)
    # Smaller gaps cannot be resolved: bounds err by some hundred roundings to both sides.
    # Gap that rounding leaves between bounds, in units of roundoff of coordinates of at most one.
    floor = 8 * moved + 4096 * float(np.finfo(dtype).eps) * (1 + size)
    atol = max(float(frame.common(np.asarray(asked.atol))), floor)

    def allowed(upper: float) -> float:
        return max(atol, asked.rtol * upper)

    most = float(frame.common(np.asarray(maximum.upper, np.float64), np.inf)) + moved
    # Most steps of the search; its cells end it much earlier.
    limits = most, allowed, asked.max_cells, 4000, asked.quantile
    listener = Listener(progress, frame, "mean")
    ends = listener.is_over if isinstance(progress, Watch) else None
    search = DistributionSearch(source, target, dtype, *limits, a.heights(b, pair, target), ends)
    # After an interruption of the search for the maximum, no further search runs.
    listener.late = name_of(maximum.result) == "out_of_time"
    listener.interrupted = listener.late or name_of(maximum.result) == "interrupted"
    found = drive(search, listener)
    if source.dimension and not _is_extended(source, found.cells):
        size = ("length", "area")[source.dimension - 1]
        raise ValueError(f"a has no {size} above the rounding of its coordinates, so averages are undefined.")
    flat = found.cells.flat
    return (
        found,
        pair,
        user_measure(frame, source.dimension, flat) if source.dimension else _size(len(flat.lower), counts),
    )


def _moderate(counts: np.ndarray | None) -> np.ndarray | None:
    """Scale weights by a power of two, so that their sums and products neither overflow nor underflow.

    Weights that underflow are negligible compared with the largest weight. Others keep their digits.
    """
    power = 0 if counts is None else int(common_exponent(counts))
    # Weights up to this power of two, and from its inverse on, are taken as they are: sums of their products are
    # numbers.
    return counts if counts is None or abs(power) <= 400 else np.ldexp(counts, -power)


def _is_extended(source: AbstractMeasured, known: DistanceCells) -> bool:
    """Return whether a shape has a proven length or area. Large cells may not show it, so the largest are cut first."""
    cells, flat = known.cells, known.flat
    for _ in range(_LOOKS):
        if np.any(flat.lower > 0):
            return True
        largest = np.argsort(flat.upper)[-_LOOKED_AT:]
        cells, _ = source.cut(cells.take(largest), taken(flat, largest))
        flat = source.flat(cells)
    return bool(np.any(flat.lower > 0))


def _in_units(
    a: Any, b: Any, maximum: HausdorffSolution, found: Distribution, pair: Together, measure: Bounds
) -> Deviation:
    """Return the result of `deviation` in the user's coordinates."""
    frame, over, flat = pair.frame, found.cells.over, found.cells.flat
    ends = partial(_lengths, frame, pair.moved)
    kind = UndifferentiatedBounds if is_traced(*jax.tree_util.tree_leaves((a, b))) else Bounds
    known = ends(found.lower, found.upper), ends(*found.rms)
    mean, rms = (kind(low, high) for low, high in known)
    lower, upper = ends(over.lower, over.upper)
    place = np.asarray(frame.place(np.mean(flat.corners, axis=1)))[:, : a.dim]
    affine = np.stack(_affine_lengths(frame, pair.moved, over.ends), axis=2)
    samples = DistanceSamples(place, lower, upper, np.stack([flat.lower, flat.upper], axis=1), affine)
    result = maximum.result if found.result == RESULTS.successful else found.result
    counts = {name: int(count) for name, count in zip(COUNTS, (found.steps, len(lower)), strict=True)}
    return Deviation(a, b, maximum, mean, rms, measure, samples, result, counts)


def _lengths(frame: Frame, moved: float, lower: Any, upper: Any) -> tuple[np.ndarray, np.ndarray]:
    below, above = np.maximum(np.asarray(lower) - moved, 0.0), np.asarray(upper) + moved
    room = 4 * np.finfo(np.float64).eps
    return user_length(frame, below * (1 - room), 0.0), user_length(frame, above * (1 + room), np.inf)


def _affine_lengths(frame: Frame, moved: float, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `_lengths` of the values of affine functions; lower values may be negative."""
    lower, upper = _lengths(frame, moved, ends[..., 0], ends[..., 1])
    beyond = _lengths(frame, moved, 0.0, np.maximum(-ends[..., 0], 0.0))[1]
    return np.where(ends[..., 0] < moved, -beyond, lower), upper


def _size(count: int, counts: np.ndarray | None) -> Bounds:
    """Return bounds of the number of points or the sum of their weights: one float if exact, else two neighbors."""
    total = Fraction(count) if counts is None else exact_sum(counts)
    near = float_near(total, np.dtype(np.float64))
    low = np.nextafter(near, 0.0) if near > total else near
    high = np.nextafter(near, np.inf) if near < total else near
    return Bounds(low, high)


def user_measure(frame: Frame, dimension: int, flat: FlatCells) -> Bounds:
    """Return bounds of the length or area of all cells in the user's unit."""
    lower, upper = float(np.sum(flat.lower)), float(np.sum(flat.upper))
    room = (len(flat.lower) + 16) * np.finfo(np.float64).eps
    power = dimension * int(frame.first + frame.second)
    with np.errstate(over="ignore", under="ignore"):
        low, high = (np.ldexp(x, power) for x in (lower * (1 - room), upper * (1 + room)))
    # Below the normal numbers a power of two rounds too.
    low, high = np.nextafter(min(low, np.finfo(np.float64).max), 0.0), np.nextafter(high, np.inf)
    return Bounds(low, high)
