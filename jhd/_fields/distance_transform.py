"""Distance transforms of grids: for each voxel the distance to the nearest feature voxel, and its index.

There are two methods. The exact method processes one axis after another. With g(j) the squared distance within the
processed axes, the squared distance at i is the minimum of g(j) + (i - j)^2 over j. The minimum is taken over growing
offsets d = |i - j|, plane by plane, until d^2 exceeds every possible improvement. If the sides of a voxel are equal,
the squared distance and the index are packed into one integer, so that one minimum finds both.

The published method passes vectors to neighbors ("3-D signed Euclidean distance transform"; "signed" refers to the
signs of the components of these vectors). It is kept for comparison. A nearest feature is lost if no neighbor has it,
so some distances are too large by a fraction of a voxel. The figure with its templates is lost. The templates below
fit the published counts of shifts and comparisons (not the count of additions, which is larger by two) and the only
template in print; their errors are small.

Changes to the source of "vector_propagation": planes of constant k are swept, and in them rows of constant i. The text
sweeps planes of constant i and rows of constant k, which does not fit templates that "act in the k plane". Voxels at
the border of the grid are processed too; the text leaves them out.

Sources: C. Lin, C. Wang, "3-D signed Euclidean distance transform and its applications" (2003), section 2; the
separable minimum after Saito & Toriwaki, Pattern Recognition 27 (1994).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from jhd._arithmetic.rounding import power_of_two, smallest_normal
from jhd._arithmetic.scaling import common_exponent, ldexp
from jhd._results.display import described, most_text, opaque, size_text
from jhd._runtime.arrays import array_of, is_traced, one_of, real_array, varying
from jhd._runtime.compiled import compiled
from jhd._shapes.checks import Numbers

METHODS = ("exact", "vector_propagation")
# Offsets between two tests for the end.
_UNROLLED = 4
# A squared distance above all others, and so is its sum with another one; 32 bits hold both.
_FAR = np.int32(2**29)


class DistanceTransform(eqx.Module):
    """Distances to the nearest feature on a grid, in the shape of the grid.

    Args:
        distance: distance from the center of each voxel to the center of the nearest feature voxel, in the unit of the
            spacing; infinite if there is no feature.
        nearest: indices of the nearest feature voxel along the axes of the grid, in the last axis; -1 if there is none.
    """

    distance: Float[Array, "..."]
    nearest: Int[Array, "... axes"]

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        most = most_text("distances up to", self.distance)
        return described(self, f"{size_text(self.distance.shape)} voxels", most)


def distance_transform(features: Numbers, spacing: Numbers = 1.0, *, method: str = "exact") -> DistanceTransform:
    """Euclidean distance transform of a grid of one to three dimensions, with the nearest feature of each voxel.

    If several features are equally near, any of them may be returned. Works under jit and vmap. The distances are
    differentiable in the spacing, with the features held fixed.

    >>> import jhd
    >>> transform = jhd.distance_transform([False, False, True, False], spacing=0.5)
    >>> transform.distance.tolist(), transform.nearest[:, 0].tolist()
    ([1.0, 0.5, 0.0, 0.5], [2, 2, 2, 2])

    Args:
        features: boolean array of one to three axes, True at feature voxels.
        spacing: side lengths of a voxel: one positive number for all axes, or one for each axis.
        method: "exact" (the default), or "vector_propagation" for the published method, whose distances can be too
            large by a fraction of a voxel.

    Returns:
        A DistanceTransform with the distances and the indices of the nearest features.

    Raises:
        TypeError: the features are not booleans.
        ValueError: the grid has no or more than three dimensions or is empty, a side is not positive, or the method is
            unknown.
    """
    one_of("method", method, METHODS)
    grid = _checked_grid("features", features)
    sides, power, equal = _checked_spacing(spacing, grid.ndim)
    index = _nearest(grid, sides, equal, method)
    return DistanceTransform(_in_unit(_lengths(index, sides), power), index)


def signed_distance_transform(inside: Numbers, spacing: Numbers = 1.0) -> Float[Array, "..."]:
    """Exact signed distances on a grid, between centers of voxels: positive outside, negative inside.

    At an outside voxel, the value is the distance to the nearest inside voxel. At an inside voxel, it is minus the
    distance to the nearest outside voxel. The value is infinite if nothing is inside, and minus infinity if nothing is
    outside.

    >>> import jhd
    >>> jhd.signed_distance_transform([False, False, True, True]).tolist()
    [2.0, 1.0, -1.0, -2.0]

    Args:
        inside: boolean array of one to three axes, True at inside voxels.
        spacing: side lengths of a voxel: one positive number for all axes, or one for each axis.

    Returns:
        Distances in the unit of the spacing, in the shape of the grid.

    Raises:
        TypeError: `inside` is not boolean.
        ValueError: the grid has no or more than three dimensions or is empty, or a side is not positive.
    """
    grid = _checked_grid("inside", inside)
    sides, power, equal = _checked_spacing(spacing, grid.ndim)
    there, here = (_lengths(_nearest(x, sides, equal, "exact"), sides) for x in (grid, ~grid))
    return _in_unit(jnp.where(grid, -here, there), power)


def _checked_grid(name: str, value: Any) -> Any:
    grid = value if is_traced(value) else np.asarray(value)
    if grid.dtype != bool:
        raise TypeError(f"{name} must be booleans; its dtype is {grid.dtype}.")
    if not 1 <= grid.ndim <= 3:
        raise ValueError(f"{name} has {grid.ndim} axes; needs one to three.")
    if 0 in grid.shape:
        raise ValueError(f"{name} has shape {grid.shape}; needs at least one voxel.")
    return grid


def _checked_spacing(spacing: Numbers, axes: int) -> tuple[Array, int, bool]:
    """The side along each axis divided by a power of two, that power, and whether all are known to be equal."""
    given = real_array("spacing", spacing)
    if given.shape not in ((), (axes,)):
        raise ValueError(f"spacing has shape {given.shape}; needs one number or ({axes},).")
    equal, power = given.ndim == 0, 0
    if not is_traced(given):
        known = np.ravel(np.asarray(given))
        if not np.all(known > 0):
            i = int(np.argmin(known > 0))
            raise ValueError(f"spacing{'' if equal else f'[{i}]'} is {known[i]:g}; needs a positive number.")
        equal = bool(np.all(known == known[0]))
        if np.min(known) < np.max(known) * float(smallest_normal(known.dtype)) ** 0.5:
            raise ValueError(f"spacing has sides from {np.min(known):g} to {np.max(known):g}: their squares vanish.")
        if np.min(known) < smallest_normal(known.dtype):
            # Compiled functions flush these to zero.
            power = int(common_exponent(known))
            given = np.ldexp(np.asarray(given), -power)
    return jnp.broadcast_to(given, (axes,)), power, equal


def _in_unit(distance: Array, power: int) -> Array:
    if power == 0:
        return distance
    return ldexp(distance, power) if is_traced(distance) else array_of(np.ldexp(np.asarray(distance), power))


def _nearest(grid: Any, sides: Array, equal: bool, method: str) -> Array:
    """Indices of the nearest features, (..., axes); -1 if the grid has no feature."""
    axes, shape = grid.ndim, (1,) * (3 - grid.ndim) + grid.shape
    volume = grid.reshape(shape)
    # Only ratios of sides count; squares of sides near the ends of the range would overflow or vanish.
    sides = lax.stop_gradient(sides / power_of_two(jnp.max(sides)))
    sides = jnp.concatenate([jnp.ones(3 - axes, sides.dtype), sides])
    bits = _bits(shape)
    if method == "vector_propagation":
        index = _propagated(volume, sides)
    elif equal and bits is not None:
        index = _by_integers(*_padded(volume))
    else:
        index = _by_numbers(*_padded(volume), sides)
    index = index[tuple(slice(n) for n in shape)]
    return index[..., 3 - axes :].reshape(*grid.shape, axes)


def _bits(shape: tuple[int, ...]) -> int | None:
    """Bits of an index, if squared distances and indices fit into 30 bits together; grids are padded before."""
    largest = _room(shape)
    bits = max((max(largest) - 1).bit_length(), 1)
    return bits if (sum(n * n for n in largest) << bits) < _FAR else None


def _room(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shapes for which functions are compiled: small cubes, and above them lengths at most an eighth apart."""
    largest = max(shape)
    # Grids with no longer side are padded to cubes, which takes milliseconds; another compilation takes a second.
    if largest <= 64:
        side = max(8, 1 << (largest - 1).bit_length())
        return tuple(1 if n == 1 else side for n in shape)
    steps = [max(8, 1 << max(0, (n - 1).bit_length() - 3)) for n in shape]
    return tuple(1 if n == 1 else -(-n // step) * step for n, step in zip(shape, steps, strict=True))


def _padded(volume: Any) -> tuple[Any, Any]:
    """The volume padded to a compiled shape, and its true lengths; a traced volume stays unchanged."""
    if is_traced(volume):
        return volume, np.array(volume.shape, np.int32)
    room = tuple((0, m - n) for m, n in zip(_room(volume.shape), volume.shape, strict=True))
    return np.pad(volume, room), np.array(volume.shape, np.int32)


def _lengths_of(index: Array, sides: Array) -> Array:
    """Distances to features; infinite at indices of -1."""
    axes = index.shape[-1]
    total = jnp.zeros(index.shape[:-1], sides.dtype)
    # Squares of sides near the ends of the range would overflow or vanish.
    scale = power_of_two(lax.stop_gradient(jnp.max(sides)))
    for axis in range(axes):
        places = lax.broadcasted_iota(index.dtype, total.shape, axis)
        total = total + ((index[..., axis] - places) * (sides[axis] / scale)) ** 2
    root = jnp.where(total > 0, jnp.sqrt(jnp.where(total > 0, total, 1.0)), 0.0)
    return jnp.where(index[..., 0] < 0, jnp.inf, scale * root)


_lengths = compiled(_lengths_of)


# ---- the exact transform ---------------------------------------------------------------------------


def _along_lines(volume: Array) -> tuple[Array, Array]:
    """For each voxel the index of the nearest feature on its line along the last axis, and whether there is one."""
    n = volume.shape[-1]
    places = lax.broadcasted_iota(jnp.int32, volume.shape, 2)
    before = lax.cummax(jnp.where(volume, places, -4 * n), axis=2)
    after = lax.cummin(jnp.where(volume, places, 8 * n), axis=2, reverse=True)
    index = jnp.where(places - before <= after - places, before, after)
    return index, (index >= 0) & (index < n)


def _offsets(count: Array, step: Any, best: Any, limits: Any) -> Any:
    """Apply `step` to offsets 1, 2, ... as long as a larger offset can improve the result.

    Args:
        count: offsets there are, at most.
        step: (offset, best) -> better.
        best: at offset 0.
        limits: (offset, best) -> whether to go on.
    """

    def on(state: tuple[Array, Any]) -> Array:
        return (state[0] < count) & limits(*state)

    def further(state: tuple[Array, Any]) -> tuple[Array, Any]:
        d, best = state
        for extra in range(_UNROLLED):
            best = step(d + extra, best)
        return d + _UNROLLED, best

    return lax.while_loop(on, further, (varying(jnp.int32(1), best), best))[1]


def _shifted(padded: Array, n: int, d: Array) -> tuple[Array, Array]:
    """Rows i - d and i + d of a plane with n rows of padding on both sides."""
    d, zero, size = jnp.minimum(d, n), jnp.int32(0), (n, padded.shape[1])
    return lax.dynamic_slice(padded, (n - d, zero), size), lax.dynamic_slice(padded, (n + d, zero), size)


def _integer_plane(key: Array, bits: int, count: Array) -> Array:
    """The minimum over j of key[j] + ((i - j)^2 << bits), for the first `count` rows i of a plane."""
    n = key.shape[0]
    padded = jnp.pad(key, ((n, n), (0, 0)), constant_values=_FAR)
    real = lax.broadcasted_iota(jnp.int32, key.shape, 0) < count
    least = jnp.min(key) >> bits

    def step(d: Array, best: Array) -> Array:
        # Not beyond _FAR: larger offsets than there are rows come from the unrolling alone.
        back, forth = _shifted(padded, n, d)
        return jnp.minimum(best, jnp.minimum(back, forth) + (jnp.minimum(d, n) ** 2 << bits))

    def on(d: Array, best: Array) -> Array:
        return least + d * d < jnp.max(jnp.where(real, best, 0)) >> bits

    return jnp.minimum(_offsets(count, step, key, on), _FAR)


@partial(compiled, level=None)
def _by_integers(volume: Array, counts: Array) -> Array:
    """Indices of the nearest features on a grid of equal sides, axis by axis, by keys of squared distance and index."""
    bits = _bits(volume.shape) or 0
    index, found = _along_lines(volume)
    z = index
    squares = (index - lax.broadcasted_iota(jnp.int32, index.shape, 2)) ** 2
    for axis in (1, 0):
        keys = squares << bits | lax.broadcasted_iota(jnp.int32, squares.shape, axis)
        # Beyond the true lengths nothing is a feature.
        real = lax.broadcasted_iota(jnp.int32, squares.shape, axis) < counts[axis]
        keys = jnp.where(found & real, keys, _FAR)
        planes = jnp.moveaxis(keys, axis, 1)
        planes = lax.map(lambda plane, axis=axis: _integer_plane(plane, bits, counts[axis]), planes)
        keys = jnp.moveaxis(planes, 1, axis)
        found, squares = keys < _FAR, keys >> bits
        index = jnp.where(found, keys & ((1 << bits) - 1), 0)
        if axis == 1:
            y = index
    return _traced_back(index, y, z, found)


def _traced_back(x: Array, y: Array, z: Array, found: Array) -> Array:
    """Indices of the features, from the index along x and the tables of indices along y and z."""
    places = [lax.broadcasted_iota(jnp.int32, x.shape, axis) for axis in range(3)]
    row = y[x, places[1], places[2]]
    index = jnp.stack([x, row, z[x, row, places[2]]], axis=-1)
    return jnp.where(found[..., None], index, -1)


def _number_plane(value: Array, count: Array, side: Array) -> tuple[Array, Array]:
    """The minimum over j of value[j] + (side (i - j))^2 and its index j, for the first `count` rows i of a plane."""
    n = value.shape[0]
    padded = jnp.pad(value, ((n, n), (0, 0)), constant_values=jnp.inf)
    rows = lax.broadcasted_iota(jnp.int32, value.shape, 0)
    least = jnp.min(value)

    def square(d: Array) -> Array:
        return (d * side) ** 2

    def step(d: Array, best: tuple[Array, Array]) -> tuple[Array, Array]:
        least, index = best
        for there, place in zip(_shifted(padded, n, d), (rows - d, rows + d), strict=True):
            there = there + square(d)
            nearer = there < least
            least, index = jnp.where(nearer, there, least), jnp.where(nearer, place, index)
        return least, index

    def on(d: Array, best: tuple[Array, Array]) -> Array:
        return least + square(d) < jnp.max(jnp.where(rows < count, best[0], 0.0))

    return _offsets(count, step, (value, rows), on)


@partial(compiled, level=None)
def _by_numbers(volume: Array, counts: Array, sides: Array) -> Array:
    """Indices of the nearest features on a grid of any sides, axis by axis, by squared distances in floating point."""
    sides = sides / power_of_two(jnp.max(sides))
    z, found = _along_lines(volume)
    places = lax.broadcasted_iota(jnp.int32, z.shape, 2)
    squares = jnp.where(found, ((z - places) * sides[2]) ** 2, jnp.inf)
    indices = []
    for axis in (1, 0):
        real = lax.broadcasted_iota(jnp.int32, squares.shape, axis) < counts[axis]
        planes = jnp.moveaxis(jnp.where(real, squares, jnp.inf), axis, 1)
        found = lax.map(lambda plane, axis=axis: _number_plane(plane, counts[axis], sides[axis]), planes)
        squares, index = (jnp.moveaxis(x, 1, axis) for x in found)
        indices.append(jnp.clip(index, 0, volume.shape[axis] - 1))
    return _traced_back(indices[1], indices[0], jnp.maximum(z, 0), squares < jnp.inf)


# ---- the published transform -----------------------------------------------------------------------

# A feature that is farther than all others: its square still fits.
_NOWHERE = np.int32(-(2**14))


def _nearer(here: Array, offered: Array, place: Array, squares: Array) -> Array:
    mine, other = (jnp.sum((x - place) ** 2 * squares, axis=-1, keepdims=True) for x in (here, offered))
    return jnp.where(other < mine, offered, here)


def _around(x: Array, axis: int) -> list[Array]:
    """The entries at -1, 0 and 1 along an axis."""
    room = [(0, 0)] * x.ndim
    room[axis] = (1, 1)
    wide = jnp.pad(x, room, constant_values=_NOWHERE)
    return [lax.slice_in_dim(wide, k, k + x.shape[axis], axis=axis) for k in range(3)]


def _scanned(offer: Callable[[Array, Array, Array], Array], here: Array, places: Array, back: bool) -> Array:
    """Scan along the first axis: each entry becomes offer(entry, finished entry before it, place)."""

    def step(before: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        best = offer(now[0], before, now[1])
        return best, best

    start = varying(jnp.full(here.shape[1:], _NOWHERE), here)
    return lax.scan(step, start, (here, places), reverse=back)[1]


@partial(compiled, level=None)
def _propagated(volume: Array, sides: Array) -> Array:
    """Features passed on by the templates: planes of the last axis, in them rows of the first, along the second.

    In the forward pass a voxel is offered the nine next to it in the plane k + 1, the three in the row i - 1, then
    j - 1; going back along the row, j + 1. Then rows go the other way: three in the row i + 1 and j + 1, then j - 1.
    The backward pass repeats this with all signs changed.
    """
    squares = (sides / power_of_two(jnp.max(sides))) ** 2
    nearer = partial(_nearer, squares=squares)
    grid = jnp.stack([lax.broadcasted_iota(jnp.int32, volume.shape, axis) for axis in range(3)], axis=-1)
    places = jnp.moveaxis(grid, 2, 0)
    index = jnp.where(jnp.moveaxis(volume, 2, 0)[..., None], places, _NOWHERE)

    for turned in (False, True):

        def row(here: Array, before: Array, place: Array, back: bool) -> Array:
            for offered in _around(before, 0):
                here = nearer(here, offered, place)
            return _scanned(nearer, _scanned(nearer, here, place, back), place, not back)

        def plane(here: Array, before: Array, place: Array, turned: bool = turned) -> Array:
            for neighbors in _around(before, 0):
                for offered in _around(neighbors, 1):
                    here = nearer(here, offered, place)
            for back in (turned, not turned):
                here = _scanned(partial(row, back=back), here, place, back)
            return here

        index = _scanned(plane, index, places, not turned)
    index = jnp.moveaxis(index, 0, 2)
    return jnp.where(index[..., :1] < 0, -1, index)
