"""The entry for minimum distances of two shapes, and its driver.

Parametric shapes are handled in one program under tracing; concrete ones from the host, in stretches between which
Ctrl-C is heard, progress is reported and a table that is about to be full is exchanged for a longer one.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import sequential_vmap
from jaxtyping import Array

from jhd.arithmetic.rounding import gamma
from jhd.arrays import is_traced, real_array
from jhd.compiled import compiled
from jhd.distance.frame.net_jets import Net, jet, point_error
from jhd.distance.frame.prepare import Frame
from jhd.distance.published.voxel_pairs import VoxelPairs
from jhd.distance.search.closest import (
    WIDTH,
    Parametric,
    State,
    advance,
    begin,
    is_full,
    is_open,
    lower_of,
)
from jhd.distance.search.closest_triangles import as_mesh, of_meshes
from jhd.distance.search.mixed import Outcome, with_surface
from jhd.distance.search.stretches import in_stretches
from jhd.distance.witness.nets import attached, net_of, polished, prepared
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve
from jhd.shapes.implicit import ImplicitSurface
from jhd.shapes.mesh import TriangleMesh
from jhd.shapes.patch import AbstractPatch
from jhd.solution import RESULTS, MinimumSolution, result_where, throw_unless_successful

# The default tolerance as a share of the diagonal, and in units of roundoff where that is more.
_RELATIVE, _ULPS = 1e-10, 64

_KINDS = (
    "a curve, a parametric surface (BezierPatch, BezierPatches, BSplineSurface), an ImplicitSurface or a TriangleMesh"
)


class MinimumProgress(NamedTuple):
    """How far a search for a minimum distance has come; bounds in the unit of the coordinates.

    Args:
        steps: steps taken.
        lower: proven lower bound.
        upper: proven upper bound.
    """

    steps: int
    lower: float
    upper: float


class _Wanted(NamedTuple):
    """Tolerances in common coordinates, and what preparing the shapes may have changed."""

    atol: Array
    rtol: Array
    error: Array


def minimum_distance(
    a: Any,
    b: Any,
    method: VoxelPairs | None = None,
    *,
    atol: Numbers | None = None,
    rtol: Numbers = 0.0,
    max_steps: int = 4000,
    capacity: int = 512,
    throw: bool = True,
    progress: Callable[[MinimumProgress], object] | None = None,
) -> MinimumSolution:
    """Minimum distance of two shapes, min |p - q| over p on a and q on b, with proven bounds.

    Pairs of cells are bounded by the hulls of their control points along the line that joins them, left out where the
    gradient of the distance excludes a minimum, and closed where the distance is proven convex. The distance is that of
    the stored arrays taken as real numbers. Shapes that meet have distance zero: `upper` is then what rounding leaves
    between two points found, at most the tolerance, and `lower` is 0.

    The value and the points are differentiable in both shapes; where several pairs are equally near, as for the pair
    found, and at distance zero the derivative is zero by convention. Works under jit, vmap and grad, where checks of
    values are left out and `throw` is ignored: read `result`.

    Where nearest pairs form a surface (equidistant or coincident patches), the cost grows like diagonal / gap; the
    bounds are then true and wider, as RESULTS.gap_not_closed.

    A triangle mesh is a surface and not the solid that it may bound: of a mesh inside another one the distance of the
    surfaces is meant. Meshes, and a mesh with a point set or a polyline, have a search of their own from the host: the
    pairs of triangles that count are measured in rational arithmetic, so the bounds are next to each other and meshes
    that meet have `upper` 0; only where very many pairs are equally near is the tolerance used. With other shapes, and
    under jit and vmap, which form all pairs of triangles and pieces, the triangles count as patches; an implicit
    surface allows hundreds of them, not thousands.

    >>> from jhd.shapes.curve import circle
    >>> found = minimum_distance(circle([0, 0], 3.0), circle([0, 7], 2.0))
    >>> bool(found.lower <= 2.0 <= found.upper), bool(found.upper - found.lower < 1e-8)
    (True, True)

    Args:
        a: a curve, a parametric surface (BezierPatch, BezierPatches, BSplineSurface), an ImplicitSurface, which is
            clipped to its box, or a TriangleMesh.
        b: another of these, of the same dimension.
        method: None for the proven search, or VoxelPairs(...) for implicit surfaces, whose answer is RESULTS.unproven,
            is never raised, and to which the options below say nothing.
        atol: absolute tolerance on upper - lower, in the unit of the coordinates; by default 1e-10 (in float32: 64
            units of roundoff) of the diagonal of the box of both shapes' control points, or what rounding leaves where
            that is more.
        rtol: tolerance relative to upper; the larger of both counts.
        max_steps: most steps, of sixteen pairs of cells each; of meshes, of a block of pairs or an exact pair.
        capacity: least length of the table of pairs; outside jit and vmap a longer one is taken where it is full.
        throw: whether to raise where the gap is not closed.
        progress: called with a MinimumProgress now and then; not under jit. Ctrl-C ends the search with the bounds
            reached, as RESULTS.interrupted.

    Returns:
        The distance with its bounds and the nearest points.

    Raises:
        TypeError: a shape of another kind.
        ValueError: shapes of different dimensions, a surface that is proven empty in its box, tolerances that are no
            numbers of at least 0, counts too small.
        NotProvenError: the gap was not closed and throw is True; it carries the solution.

    Source: Lin & Wang, 3D signed Euclidean distance transform and its applications, section on the minimum distance
    (the problem; their method is VoxelPairs, which proves nothing).
    """
    for name, shape in (("a", a), ("b", b)):
        if not isinstance(shape, AbstractCurve | AbstractPatch | ImplicitSurface | TriangleMesh):
            raise TypeError(f"{name} must be {_KINDS}; got {type(shape).__name__}.")
    if isinstance(method, VoxelPairs):
        return method.minimum(a, b)
    if method is not None:
        raise TypeError(f"method must be None or VoxelPairs(...); got {type(method).__name__}.")
    tolerances = _checked(atol, rtol, max_steps, capacity)
    if a.dim != b.dim:
        raise ValueError(f"a has {a.dim} coordinates a point and b has {b.dim}; needs the same.")
    meshes = _known_meshes(a, b, tolerances)
    if meshes is not None:
        report = None if progress is None else lambda found: progress(MinimumProgress(*found))
        solution = of_meshes(*meshes, *tolerances, max_steps, report)
    elif isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface):
        report = None if progress is None else lambda found, frame: progress(_report(found, frame))
        solution = with_surface(a, b, *tolerances, max_steps, capacity, report)
    else:
        solution = _parametric(a, b, tolerances, max_steps, capacity, progress)
    if throw:
        throw_unless_successful(solution)
    return solution


def _known_meshes(a: Any, b: Any, tolerances: Any) -> tuple[TriangleMesh, TriangleMesh] | None:
    """Both shapes as meshes where one is a mesh, the other can be one, and all numbers are known."""
    if not isinstance(a, TriangleMesh) and not isinstance(b, TriangleMesh):
        return None
    # Inside jit all operations are traced, those on known numbers too.
    if is_traced(jax.lax.stop_gradient((a, b)), tolerances, jnp.zeros(())):
        return None
    first, second = as_mesh(a), as_mesh(b)
    return None if first is None or second is None else (first, second)


def _parametric(
    a: Any,
    b: Any,
    tolerances: tuple[Array | None, Array],
    max_steps: int,
    capacity: int,
    progress: Callable[[MinimumProgress], object] | None,
) -> MinimumSolution:
    """The distance of curves and parametric surfaces, in common coordinates."""
    nets = net_of(a), net_of(b)
    counts = nets[0].points.shape[0], nets[1].points.shape[0]
    p, q, frame, error = prepared(*jax.lax.stop_gradient(nets))
    wanted = _wanted(p, q, frame, error, *tolerances)
    # Inside jit all operations are traced, those on known numbers too.
    if is_traced(p, q, wanted, jnp.zeros(())):
        found = _in_one_go(p, q, counts, wanted, max_steps, capacity)
    else:
        found = _from_host(p, q, counts, wanted, max_steps, capacity, frame, progress)
    solution = found.solution(frame)
    if is_traced(nets):
        value, point_a, point_b = attached(*nets, frame, jax.lax.stop_gradient(found.best), solution.value)
        keep = jnp.isfinite(solution.value)
        solution = replace(
            solution,
            value=jnp.where(keep, value, solution.value),
            point_a=solution.point_a + _moving(point_a),
            point_b=solution.point_b + _moving(point_b),
        )
    return solution


def _moving(point: Array) -> Array:
    """Zero, with the derivatives of the point."""
    return jnp.where(jnp.isfinite(point), point - jax.lax.stop_gradient(point), 0.0)


def _checked(atol: Any, rtol: Any, max_steps: Any, capacity: Any) -> tuple[Array | None, Array]:
    numbers = [None if x is None else real_array(name, x) for name, x in (("atol", atol), ("rtol", rtol))]
    for name, value in zip(("atol", "rtol"), numbers, strict=True):
        if value is None:
            continue
        if value.shape != ():
            raise ValueError(f"{name} has shape {value.shape}; needs a scalar.")
        if not is_traced(value) and not float(value) >= 0:
            raise ValueError(f"{name} is {float(value):g}; needs a number of at least 0.")
    for name, value, least in (("max_steps", max_steps, 0), ("capacity", capacity, 4 * WIDTH)):
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise ValueError(f"{name} is {value!r}; needs a whole number of at least {least}.")
    if numbers[1] is None:
        raise ValueError("rtol is None; needs a number of at least 0.")
    return numbers[0], numbers[1]


def _wanted(a: Net, b: Net, frame: Frame, error: float, atol: Array | None, rtol: Array) -> _Wanted:
    xp: Any = jnp if is_traced(a, b, atol, rtol, frame) else np
    points = [xp.asarray(net.points) for net in (a, b)]
    dtype = points[0].dtype
    if atol is None:
        lows, highs = ([f(x, axis=(0, 1, 2)) for x in points] for f in (xp.min, xp.max))
        box = xp.maximum(highs[0], highs[1]) - xp.minimum(lows[0], lows[1])
        share = max(_RELATIVE, _ULPS * float(np.finfo(dtype).eps))
        absolute = share * xp.sqrt(xp.sum(box * box))
    else:
        absolute = frame.common(atol)
    return _Wanted(xp.asarray(absolute, dtype), xp.asarray(rtol, dtype), xp.asarray(error, dtype))


def _pairs(counts: tuple[int, int]) -> np.ndarray:
    return np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1).reshape(-1, 2)


def _in_one_go(a: Net, b: Net, counts: tuple[int, int], wanted: _Wanted, max_steps: int, capacity: int) -> Outcome:
    """All in one program; of a batch the searches run one after the other on a CPU, side by side elsewhere."""
    pairs = _pairs(counts)

    def search(a: Net, b: Net, wanted: _Wanted) -> Outcome:
        state = begin(a, b, jnp.asarray(pairs), jnp.ones(len(pairs), bool), max(capacity, 2 * len(pairs)))
        state = advance(Parametric(a, b), wanted.atol, wanted.rtol, state, max_steps)
        return _outcome(a, b, wanted, state)

    if jax.default_backend() == "cpu":
        search = sequential_vmap(search)
    return search(a, b, wanted)


def _outcome(a: Net, b: Net, wanted: _Wanted, state: State) -> Outcome:
    """Bounds and points of the search as it stands, the nearest pair polished."""
    dtype, n = state.lower.dtype, a.parameters
    best = polished(a, b, state.best)
    point_a = jet(a.piece(best.piece_a), best.x[:n]).point
    point_b = jet(b.piece(best.piece_b), best.x[n:]).point
    upper = best.distance * (1 + gamma(12, dtype)) + point_error(a) + point_error(b)
    upper = jnp.minimum(upper, state.best.upper) * (1 + gamma(6, dtype)) + wanted.error
    lower = jnp.maximum(lower_of(state) * (1 - gamma(6, dtype)) - wanted.error, 0.0)
    lower = jnp.minimum(lower, upper)
    # The search closes pairs below the tolerance by more than the error of preparing.
    granted = jnp.maximum(jnp.maximum(wanted.atol, wanted.rtol * upper), 2 * Parametric(a, b).floor + 4 * wanted.error)
    failed = result_where(state.lost, RESULTS.capacity_reached, RESULTS.gap_not_closed)
    result = result_where(upper - lower <= granted, RESULTS.successful, failed)
    stats = {"steps": state.steps, "pairs": state.pairs, "waiting": jnp.sum(jnp.isfinite(state.lower))}
    best = best._replace(distance=jnp.clip(best.distance, lower, upper))
    return Outcome(best, lower, upper, point_a, point_b, result, stats)


_begun = compiled(begin, (4,))


@compiled
def _stretch(
    a: Net, b: Net, wanted: _Wanted, state: State, limit: Array, growing: Array
) -> tuple[State, Outcome, Array]:
    """Goes on for some steps, and says how the search stands and whether it is unfinished, and full."""
    state = advance(Parametric(a, b), wanted.atol, wanted.rtol, state, limit, growing)
    going_on = is_open(Parametric(a, b), wanted.atol, wanted.rtol, state)
    return state, _outcome(a, b, wanted, state), jnp.stack([going_on, is_full(state)])


def _from_host(
    a: Net,
    b: Net,
    counts: tuple[int, int],
    wanted: _Wanted,
    max_steps: int,
    capacity: int,
    frame: Frame,
    progress: Callable[[MinimumProgress], object] | None,
) -> Outcome:
    pairs, valid = _near_pairs(a, b, counts)
    size = max(capacity, 1 << (2 * len(pairs) - 1).bit_length())
    state = _begun(a, b, pairs, valid, size)
    report = None if progress is None else lambda found: progress(_report(found, frame))
    return in_stretches(partial(_stretch, a, b, wanted), state, max_steps, report)


def _report(found: Outcome, frame: Frame) -> MinimumProgress:
    lower, upper = frame.length(found.lower, 0.0), frame.length(found.upper, np.inf)
    return MinimumProgress(int(found.stats["steps"]), float(lower), float(upper))


def _near_pairs(a: Net, b: Net, counts: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """The pairs of pieces whose boxes are not farther apart than two points of the shapes, padded to a power of two.

    Corners of pieces are points of the shapes. The slack is far more than the roundings of boxes and lengths; of pairs
    left out nothing has to be known, since their distance is larger.
    """
    if counts[0] > counts[1]:
        pairs, valid = _near_pairs(b, a, (counts[1], counts[0]))
        return pairs[:, ::-1], valid
    x, y = (np.asarray(net.points)[:count] for net, count in zip((a, b), counts, strict=True))
    upper, kept = np.inf, []
    for i in range(len(x)):
        upper = min(upper, float(np.sqrt(np.sum((x[i, 0, 0] - y[:, 0, 0]) ** 2, axis=-1)).min()))
    slack = 1e4 * float(np.finfo(x.dtype).eps)
    low_a, high_a, low_b, high_b = x.min((1, 2)), x.max((1, 2)), y.min((1, 2)), y.max((1, 2))
    for i in range(len(x)):
        apart = np.maximum(np.maximum(low_a[i] - high_b, low_b - high_a[i]), 0.0)
        near = np.flatnonzero(np.sqrt(np.sum(apart**2, axis=-1)) <= upper * (1 + slack) + slack)
        kept.append(np.stack([np.full(len(near), i), near], axis=-1))
    pairs = np.concatenate(kept)
    size = max(16, 1 << (len(pairs) - 1).bit_length())
    index = np.minimum(np.arange(size), len(pairs) - 1)
    return pairs[index], np.arange(size) < len(pairs)
