"""Triangles for tensor-product patches, with a certified deviation, from an adaptive subdivision of the parameters.

Every patch is bisected, along the parameter in which it bends more, into rectangles whose triangles are close enough
(`jhd._shapes.patch_cells` has the proof). The sides of a rectangle contain the corners of all its neighbors. These
include neighbors across the border of two patches with the same control points there, in whichever direction they run.
Triangles are fans: from a corner whose sides have no further points, or from the only further point of a side, or else
from the middle. So there are no cracks.
"""

from typing import NamedTuple

import numpy as np

from jhd._runtime.arrays import joined
from jhd._shapes.approximation import check_count, chunks
from jhd._shapes.mesh import places_of
from jhd._shapes.patch_cells import HostPatches, PatchCells, with_bounds


class Tessellation(NamedTuple):
    """Corners, triangles, locations of the corners on the patches, and a bound of the deviation from the surface."""

    vertices: np.ndarray  # the corners, each once
    triangles: np.ndarray  # numbers of three corners, counter-clockwise in the parameters
    patch: np.ndarray  # a patch that each corner lies on
    u: np.ndarray  # its first parameter there
    v: np.ndarray  # its second one
    deviation: float  # the bound, in the user's unit


class _Loops(NamedTuple):
    """The points around rectangles, counter-clockwise in the parameters from the corner of least u and v."""

    node: np.ndarray  # numbers of points, one rectangle after the other; one point may have two numbers
    cell: np.ndarray  # the rectangle of each entry of `node`
    inner: np.ndarray  # how many entries lie inside each of the four sides (cells, 4)
    patch: np.ndarray  # a patch that each numbered point lies on
    u: np.ndarray  # its first parameter there
    v: np.ndarray  # its second one


def tessellate(points: np.ndarray, weights: np.ndarray | None, tolerance: float, most: int) -> Tessellation:
    """Triangles within tolerance of Bezier patches (patches, rows, columns, 3).

    Raises:
        ValueError: more than `most` triangles are needed, or rounding alone may exceed tolerance.
    """
    patches, off = HostPatches.of(points, weights), 0.0
    cells = patches.whole()
    while True:
        cells = _refined(patches, cells, tolerance, most, off)
        loops = _loops(patches, cells)
        triangles, middles = _fans(loops, patches.vertices(*loops[3:])[0])
        check_count(len(triangles), "max_triangles", most, tolerance)
        pairs = zip(loops[3:], cells.take(middles).middle(), strict=True)
        patch, u, v = (np.concatenate(pair) for pair in pairs)
        vertices, off = patches.vertices(patch, u, v)
        deviation = float(patches.in_user_units(np.max(cells.bound) + off))
        if deviation <= tolerance:
            _, once, names = np.unique(places_of(vertices), return_index=True, return_inverse=True)
            return Tessellation(vertices[once], names[triangles], patch[once], u[once], v[once], deviation)


def _refined(patches: HostPatches, cells: PatchCells, tolerance: float, most: int, off: float) -> PatchCells:
    """Rectangles bisected until their triangles are within tolerance, with vertices whose error is at most `off`."""
    found, count = [], 0
    while len(cells.patch):
        check_count(2 * (count + len(cells.patch)), "max_triangles", most, tolerance)
        enough = patches.in_local_units(tolerance) - off
        parts = [with_bounds(patches, cells.take(rows), enough) for rows in chunks(len(cells.patch))]
        cells = joined(parts)
        good = patches.in_user_units(cells.bound + off) <= tolerance
        found.append(cells.take(good))
        count += int(good.sum())
        cells = _checked(patches, cells.take(~good), tolerance, off).halves()
    return joined(found)


def _checked(patches: HostPatches, cells: PatchCells, tolerance: float, off: float) -> PatchCells:
    """The rectangles to bisect; ValueError if bisection cannot reach the tolerance."""
    width = np.where(cells.along_u, cells.u1 - cells.u0, cells.v1 - cells.v0)
    # Narrower rectangles have no exact ends: parameters near one have no more digits.
    if len(width) and (width.min() <= 2.0**-48 or not patches.in_user_units(patches.noise + off) <= tolerance):
        raise ValueError(f"tolerance is {tolerance:g}; rounding leaves more on this surface; raise it.")
    return cells


def _loops(patches: HostPatches, cells: PatchCells) -> _Loops:
    """The points around each rectangle: the corners of all that lie on its sides.

    A side lies on a line: a curve of `patches.borders`, or a parameter of a patch. Points are numbered by their line
    and their parameter there.
    """
    patch = np.repeat(cells.patch[:, None], 4, axis=1)
    level = np.stack([cells.v0, cells.u1, cells.v1, cells.u0], axis=1)
    start = np.stack([cells.u0, cells.v0, cells.u1, cells.v1], axis=1)
    end = np.stack([cells.u1, cells.v1, cells.u0, cells.v0], axis=1)
    # The side of the patch, if the side of the rectangle lies on it.
    side = np.array([2, 0, 2, 0]) + (level == 1)
    border = (level == 0) | (level == 1)
    ends = np.stack([np.where(border, patches.borders.along(patch, side, t), t) for t in (start, end)])
    values = np.unique(np.append(ends, level))
    count = len(values)
    within = (2 * patch + side // 2) * count + np.searchsorted(values, level)
    line = np.where(border, 2 * len(patches.net) * count + patches.borders.number[patch, side], within)
    keys, index, number = np.unique(
        line * count + np.searchsorted(values, ends), return_index=True, return_inverse=True
    )
    first, last = number.reshape(2, -1)
    steps = np.abs(last - first)
    entry, step = _counted(steps)
    node = first[entry] + np.sign(last - first)[entry] * step
    places = (np.stack([np.stack(cells.corner((k + e) % 4), 1) for k in range(4)], axis=1) for e in (0, 1))
    of_patch, u, v = np.concatenate([x.reshape(-1, 3) for x in places])[index].T
    return _Loops(node, entry // 4, steps.reshape(-1, 4) - 1, of_patch.astype(int), u, v)


def _counted(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Row numbers, each repeated by its count, and the numbers 0, 1, ... within each row."""
    row = np.repeat(np.arange(len(counts)), counts)
    return row, np.arange(len(row)) - (np.cumsum(counts) - counts)[row]


def _fans(loops: _Loops, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The triangles of all rectangles, and which of these have a middle; the middles count on from the numbered points.

    Args:
        loops: the points around the rectangles.
        vertices: the numbered points.
    """
    size = loops.inner.sum(axis=1) + 4
    first = np.cumsum(size) - size
    corner = np.cumsum(np.pad(loops.inner[:, :3] + 1, ((0, 0), (1, 0))), axis=1)
    apex = _apexes(loops.inner, corner, vertices[loops.node[first[:, None] + corner]])
    place = np.arange(len(loops.node)) - first[loops.cell]
    after = np.where(place + 1 == size[loops.cell], 0, place + 1)
    at = apex[loops.cell]
    middles = np.flatnonzero(apex < 0)
    start = loops.node[first + np.maximum(apex, 0)]
    start[middles] = len(loops.u) + np.arange(len(middles))
    corners = [start[loops.cell], loops.node, loops.node[first[loops.cell] + after]]
    return np.stack(corners, axis=1)[(place != at) & (after != at)], middles


def _apexes(inner: np.ndarray, corner: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The entry of each loop that its fan starts from; -1 for its middle. No triangle of the fan lies on one side.

    Args:
        inner: the numbers of points inside the sides; side k begins at corner k.
        corner: the entries of the corners.
        points: the corners (cells, 4, 3).
    """
    near = points.astype(np.float64)
    # Half of each, so that nothing overflows.
    rising, falling = (np.abs(0.5 * near[:, k + 2] - 0.5 * near[:, k]).max(axis=1) for k in (0, 1))
    clear = (inner == 0) & (np.roll(inner, 1, axis=1) == 0)
    # Without more points: the shorter diagonal.
    conditions = [np.all(clear, axis=1), *(inner == 1).T, *clear.T]
    choices = [(falling < rising).astype(int), *(corner + 1).T, *corner.T]
    return np.select(conditions, choices, default=-1)
