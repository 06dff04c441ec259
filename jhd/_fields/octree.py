"""Implicit surfaces on a grid of cells: an octree keeps the cells that a range of the polynomial cannot exclude.

The polynomial is first rewritten, in exact arithmetic, in coordinates w in which the box is centered at zero, has at
most the size [-1, 1], and the corners of all cells are floats. So neither the size nor the position of the box costs
digits, and cells fit without gaps.

A kept cell need not meet the surface. It is *proven* to meet it if the polynomial takes both signs in the cell, or is
zero at a corner. The cell is closed and connected, so this holds for cells at the border of the box too. Signs are
evaluated at the corners, in exact arithmetic if rounding leaves them open. One more point is tested: the point of the
cell, possibly on a face or an edge, at which a quadratic model is most of the opposite sign.

Source: AlgSurf, section 2, steps 1 to 3; the proofs are ours.
"""

from collections.abc import Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jhd._arithmetic import exact_polynomials, trivariate
from jhd._fields.boxes import CORNERS, children
from jhd._results.display import count_text, described, is_known, opaque, value_text
from jhd._runtime.arrays import is_traced, one_of, whole_between
from jhd._runtime.clock import with_time_limit
from jhd._runtime.compiled import optimized
from jhd._runtime.memory import check_memory
from jhd._shapes.checks import empty_surface
from jhd._shapes.implicit import ImplicitSurface, check_surface
from jhd.progress import Callback, Progress

# Chunks between two reports, which hold some tenths of a second.
_CHUNKS = 64
# Most multiplications of integers for the signs of corners, some seconds.
_EXACT = 10_000_000
# Three coordinates of a corner fit into 63 bits.
_LARGEST = (1 << 20) + 1


class Voxels(eqx.Module):
    """Cells of a grid that may contain a point of a surface; no cell that contains one is missing.

    Cell (i, j, k) is the closed box from lower + spacing (i, j, k) to lower + spacing (i + 1, j + 1, k + 1).

    Args:
        cells: indices (i, j, k) of the cells in the grid, in no particular order.
        lower: corner of the grid with the smallest coordinates.
        spacing: side lengths of a cell.
        proven: for each cell, whether it is proven to contain a point of the surface.
    """

    cells: Int[Array, "cells 3"]
    lower: Float[Array, "3"]
    spacing: Float[Array, "3"]
    proven: Bool[Array, " cells"]

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        proven = f"{np.count_nonzero(self.proven)} proven to hold a point" if is_known(self.proven) else ""
        sides = (f"lower={value_text(self.lower)}", f"spacing={value_text(self.spacing)}")
        return described(self, count_text(self.count, "cell"), proven, *sides)

    @property
    def count(self) -> int:
        """Number of cells."""
        return self.cells.shape[-2]

    @property
    def centers(self) -> Float[Array, "cells 3"]:
        """Centers of the cells."""
        return self.lower + self.spacing * (self.cells + 0.5)


def voxelize(
    surface: ImplicitSurface,
    cells: int,
    *,
    ranges: str = "bernstein",
    max_seconds: float | None = None,
    progress: Callback | None = None,
) -> Voxels:
    """Grid cells in the box of an implicit surface that may contain a point of the surface, by octree subdivision.

    The working memory is bounded; the result takes 13 bytes a cell.

    >>> import jhd
    >>> sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2, -2, -2], [2, 2, 2])
    >>> found = jhd.voxelize(sphere, 2)
    >>> found.count, int(found.proven.sum())
    (8, 8)

    Args:
        surface: implicit surface; it cannot be traced, as the number of cells depends on its coefficients.
        cells: number of cells along each axis, 1 to 2^20; not only powers of two.
        ranges: how the range of the polynomial over a cell is bounded: "bernstein" (the default, which keeps the fewest
            cells), "modified_affine" (as published), "interval", "horner" or "centered".
        max_seconds: time limit in seconds, checked several times per level; by default none.
        progress: callback that receives a Progress several times per level.

    Returns:
        The kept cells, and for each whether it is proven to contain a point of the surface.

    Raises:
        TypeError: the shape is no implicit surface, it is traced, or `cells` is no whole number.
        ValueError: `cells` is out of range, `ranges` is unknown, `max_seconds` is not positive, or the surface is
            certified to be empty in its box.
        MemoryError: the cells of the next level would need more memory than is free.
        TimeoutError: the cells take longer than `max_seconds`, at a report of progress.
    """
    cells, ranges = whole_between("cells", cells, 1, _LARGEST - 1), one_of("ranges", ranges, trivariate.RANGES)
    grid = _grid(surface, cells)
    found = _descend(grid, ranges, with_time_limit(progress, max_seconds))
    if not len(found):
        raise empty_surface()
    sides = [high - low for low, high in grid.box]
    spacing = jnp.asarray([float(side / cells) for side in sides], surface.lower.dtype)
    return Voxels(jnp.asarray(found), surface.lower, spacing, jnp.asarray(_proven(grid, found)))


class _VoxelGrid(NamedTuple):
    """A polynomial on a grid of 2^(levels - 1) < cells <= 2^levels cells along each axis.

    `box` holds its ends in each coordinate; `exact` is written in integers W = 2 v - cells, where v counts cells from
    the lower corner; `coefficients` in w = W / 2^levels, rounded once.
    """

    box: list[tuple[Fraction, Fraction]]
    exact: np.ndarray
    coefficients: Array
    cells: int
    levels: int

    @property
    def chunk(self) -> int:
        """Number of cells in one batch, whose forms are 2^19 numbers and fit into the cache of a core."""
        return min(4096, 1 << max(8, ((1 << 19) // self.coefficients.size).bit_length() - 1))

    def place(self, level: int) -> tuple[Array, Array]:
        """Numbers p and h: a cell i of a level has its center at w = p + 2 h i and half the width h; all are exact."""
        h = 2.0**-level
        return jnp.asarray(h - self.cells / 2.0**self.levels), jnp.asarray(h)


def _grid(surface: ImplicitSurface, cells: int) -> _VoxelGrid:
    check_surface("surface", surface)
    if is_traced(surface):
        raise TypeError("surface is traced; needs a concrete surface, as the number of cells depends on it.")
    levels = (cells - 1).bit_length()
    lower, upper = ([Fraction(float(x)) for x in np.asarray(end)] for end in surface.bounds)
    box = list(zip(lower, upper, strict=True))
    exact = exact_polynomials.trimmed(exact_polynomials.integers(np.asarray(surface.coefficients)))
    exact = exact_polynomials.substituted(
        exact, [(low + high) / 2 for low, high in box], [(high - low) / (2 * cells) for low, high in box]
    )
    raised = exact.copy()
    for index in np.ndindex(*exact.shape):
        raised[index] = exact[index] << (levels * sum(index))
    return _VoxelGrid(box, exact, jnp.asarray(exact_polynomials.floats(raised), float), cells, levels)


def _descend(grid: _VoxelGrid, ranges: str, progress: Callback | None) -> np.ndarray:
    """The cells of the last level that a range of the polynomial cannot exclude."""
    kept, tested = np.zeros((1, 3), np.int32), 0
    for level in range(grid.levels + 1):
        place, left = grid.place(level), []
        # For a surface, about four of the eight children are left.
        work = f"level {level} of {grid.levels} of {grid.cells} cells along an axis would take about"
        # Bytes for each cell that is kept, as measured on twenty million cells.
        check_memory(70 * 4 * len(kept), work, "fewer cells take less")
        # If cells is not a power of two, boxes of the tree may lie outside of the grid.
        last = (grid.cells - 1) >> (grid.levels - level)
        for boxes in _batches(kept, grid.chunk * _CHUNKS, level > 0):
            boxes = boxes[np.all(boxes <= last, axis=1)]
            masks = [_may_vanish(grid.coefficients, part, *place, ranges) for part in _chunks(boxes, grid.chunk)]
            left.append(boxes[_joined(masks, len(boxes))])
            tested += len(boxes)
            if progress is not None:
                details = {"tested": tested, "kept": sum(map(len, left))}
                progress(Progress("levels", level, grid.levels, details=details))
        kept = np.concatenate(left)
        if not len(kept):
            break
    return kept


def _batches(cells: np.ndarray, most: int, halved: bool) -> Iterator[np.ndarray]:
    """Batches of the cells, or of their children if `halved`, of at most `most` rows."""
    step = most // 8 if halved else most
    for first in range(0, len(cells), step):
        part = cells[first : first + step]
        yield children(part) if halved else part


def _chunks(rows: np.ndarray, size: int) -> Iterator[np.ndarray]:
    """Rows in chunks of one size, transposed; the last one is padded with zeros."""
    for first in range(0, len(rows), size):
        part = rows[first : first + size]
        yield np.pad(part, [(0, size - len(part)), (0, 0)]).T


def _joined(chunks: list[Any], count: int) -> np.ndarray:
    """The results of chunks along their last axis, without the padding."""
    if not chunks:
        return np.zeros(0, bool)
    return np.concatenate([np.asarray(chunk) for chunk in chunks], axis=-1)[..., :count]


def _may_vanish_of(coefficients: Array, cells: Array, origin: Array, h: Array, ranges: str) -> Array:
    center = origin + 2 * h * cells
    found = trivariate.enclose(coefficients, center, jnp.broadcast_to(h, center.shape), ranges)
    return (found.lower <= 0) & (found.upper >= 0)


def _signs_of(coefficients: Array, cells: Array, origin: Array, h: Array) -> tuple[Array, Array]:
    """Masks (8, cells) of the corners proven to be positive, and of the corners proven to be negative."""
    center = origin + 2 * h * cells
    values = trivariate.corner_values(coefficients, center, jnp.broadcast_to(h, center.shape))
    return values.lower > 0, values.upper < 0


def _opposite_of(coefficients: Array, cells: Array, origin: Array, h: Array, sign: Array) -> Array:
    """Whether each cell has a found point at which the polynomial is proven to have the opposite sign.

    A pattern search on the quadratic part of the local form, in steps that are powers of two, so that the point is
    exactly in the cell.
    """
    center = origin + 2 * h * cells
    form = trivariate.local_form(coefficients, center, jnp.broadcast_to(h, center.shape)) * sign
    steps = jnp.asarray(np.stack(np.meshgrid(*[[0.0, -1.0, 1.0]] * 3, indexing="ij")).reshape(3, 27, 1))
    terms = [index for index in np.ndindex(*form.shape[:3]) if sum(index) <= 2]

    def model(e: Array) -> Array:
        return sum((form[i] * e[0] ** i[0] * e[1] ** i[1] * e[2] ** i[2] for i in terms), jnp.zeros(()))

    def closer(_: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        best, step = state
        tried = jnp.clip(best[:, None] + step * steps, -1.0, 1.0)
        chosen = jnp.argmin(model(tried), axis=0)
        return jnp.take_along_axis(tried, chosen[None, None], axis=1)[:, 0], 0.5 * step

    # Rounds of the search for a point of the other sign; the first looks at the corners, edges, faces and the center.
    best, _ = lax.fori_loop(0, 7, closer, (jnp.zeros_like(center), jnp.ones_like(h)))
    found = trivariate.evaluate(coefficients, center + h * best)
    return jnp.where(sign > 0, found.upper < 0, found.lower > 0)


_may_vanish = optimized(_may_vanish_of, (4,))
_signs = optimized(_signs_of)
_opposite = optimized(_opposite_of)


def _proven(grid: _VoxelGrid, cells: np.ndarray) -> np.ndarray:
    """Mask of the cells proven to hold a zero."""
    place = grid.place(grid.levels)
    signs = [_signs(grid.coefficients, part, *place) for part in _chunks(cells, grid.chunk)]
    positive, negative = (_joined([pair[i] for pair in signs], len(cells)) for i in (0, 1))
    above, below = np.any(positive, axis=0), np.any(negative, axis=0)
    left = np.flatnonzero(~(above & below))
    for some, exact in _exact_signs(grid, cells[left], ~(positive | negative)[:, left]):
        above[left[some]] |= exact >= 0
        below[left[some]] |= exact <= 0
    proven = np.logical_and(above, below)
    left = np.flatnonzero(~proven)
    sign = np.where(above[left], 1.0, -1.0)[:, None]
    parts = zip(_chunks(cells[left], grid.chunk), _chunks(sign, grid.chunk), strict=True)
    found = [_opposite(grid.coefficients, part, *place, jnp.asarray(s[0], float)) for part, s in parts]
    # If no sign is known at all, a point of one sign proves nothing.
    proven[left] = _joined(found, len(left)) & (above | below)[left]
    return proven


def _exact_signs(
    grid: _VoxelGrid, cells: np.ndarray, open_corners: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """For each of the eight corners, the indices of cells with an open sign, and these signs in exact arithmetic.

    Corners beyond the largest amount of work are left out.
    """
    which, index = np.nonzero(open_corners)
    places = (cells[index] + CORNERS[which]).astype(np.int64)
    # One number for each corner: NumPy sorts those much faster than rows.
    keys, inverse = np.unique(places @ [1, _LARGEST, _LARGEST**2], return_inverse=True)
    keys = keys[: _EXACT // grid.exact.size]
    points = np.stack([keys // _LARGEST**i % _LARGEST for i in range(3)])
    signs = exact_polynomials.signs(grid.exact, 2 * points - grid.cells)
    for corner in range(8):
        there = (which == corner) & (inverse < len(keys))
        yield index[there], signs[inverse[there]]
