"""Vertices and polygons of files, converted to triangle meshes; every error names the line or byte in the file.

A polygon is seen along the axis in which its normal is longest. Its triangles are a fan about the first corner if all
of them, and all triangles of the first side and another corner, turn the same way: then they do not overlap. From other
polygons, ears are cut off one by one: corners whose triangle turns as the polygon does and contains no further corner.
A corner that does not turn gives a triangle without area, so that sides keep the corners that other faces have there.

The triangles turn one way, are glued along their sides, and have the polygon as their border. A polygon that crosses
itself has no such triangles in general, and is refused. Ears are found in integers, so nothing rounds.

Source: Meisters, Polygons have ears, American Mathematical Monthly 82 (1975).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jhd._distance.certificate.verification.pieces import integers
from jhd._io.errors import ParseError, shown
from jhd._shapes.mesh import TriangleMesh, places_of

# Most corners of a polygon that is no fan: the search for ears among all of them takes a second or two.
_MOST_CORNERS = 1_000

_Place = tuple[int, int]
_Ear = tuple[int, int, int]


class Polygons(NamedTuple):
    """Vertices and polygons read from a file."""

    vertices: np.ndarray  # coordinates, (vertices, 3)
    corners: np.ndarray  # the indices of the corners of all polygons, one after the other
    sizes: np.ndarray  # the number of corners of each polygon
    vertex_places: Sequence[int] | np.ndarray  # line or byte of each vertex in the file
    polygon_places: Sequence[int] | np.ndarray  # line or byte of each polygon in the file
    by_line: bool = True  # whether these are lines, not bytes
    base: int = 0  # the number of the first vertex in the file


def mesh_of(file: object, found: Polygons) -> TriangleMesh:
    """The mesh of the polygons; polygons of more than three corners become triangles between corners, see `ears`.

    Raises:
        ParseError: no vertex, no polygon, a coordinate that is no finite number, a polygon of fewer than three corners,
            or a polygon that names a missing vertex, crosses itself, or is not convex and has very many
            corners.
    """
    vertices, corners, sizes = found.vertices, found.corners, found.sizes
    for name, rows in (("vertices", vertices), ("faces", sizes)):
        if not len(rows):
            raise ParseError(f"holds no {name}.", file)
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        shown = ", ".join(f"{x:g}" for x in vertices[bad[0]])
        raise _refusal(file, f"the vertex ({shown}) is not finite.", found.vertex_places[bad[0]], found.by_line)
    bad = np.flatnonzero(sizes < 3)
    if len(bad):
        message = f"a face has {sizes[bad[0]]} corners; needs at least 3."
        raise _refusal(file, message, found.polygon_places[bad[0]], found.by_line)
    bad = np.flatnonzero((corners < 0) | (corners >= len(vertices)))
    if len(bad):
        polygon = int(np.searchsorted(np.cumsum(sizes), bad[0], side="right"))
        named = f"{corners[bad[0]] + found.base}, counted from {found.base}"
        message = f"a face names vertex {named}; there are {len(vertices)}."
        raise _refusal(file, message, found.polygon_places[polygon], found.by_line)
    triangles, starts = fans(corners, sizes), np.cumsum(sizes) - sizes
    for polygon in _no_fans(vertices, corners, sizes):
        first, size = int(starts[polygon]), int(sizes[polygon])
        own = corners[first : first + size]
        cut = ears(vertices[own]) if size <= _MOST_CORNERS else None
        if cut is None:
            fault = "crosses itself" if size <= _MOST_CORNERS else f"is not convex and has more than {_MOST_CORNERS}"
            message = f"a face of {size} corners {fault}: cut it into triangles."
            raise _refusal(file, message, found.polygon_places[polygon], found.by_line)
        start = first - 2 * polygon
        triangles[start : start + size - 2] = own[np.array(cut)]
    return TriangleMesh(vertices, triangles)


def _no_fans(vertices: np.ndarray, corners: np.ndarray, sizes: np.ndarray) -> list[int]:
    """The polygons whose fans are not proven to be them."""
    several = np.flatnonzero(sizes > 3)
    if not len(several):
        return []
    own = np.repeat(sizes > 3, sizes)
    return several[~are_fans(vertices[corners[own]], sizes[several])].tolist()


def fans(corners: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The triangles (first, k, k + 1) of each polygon, polygons in their order: an array (triangles, 3)."""
    first = np.cumsum(sizes) - sizes
    counts = sizes - 2
    start = np.repeat(first, counts)
    step = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.stack([corners[start], corners[start + step + 1], corners[start + step + 2]], axis=1)


def merged(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and their indices from the coordinates (corners, 3): equal ones become one vertex."""
    numbers = places_of(corners)
    vertices = np.empty((int(numbers.max(initial=-1)) + 1, 3))
    vertices[numbers] = corners
    return vertices, numbers


def coordinates_in(file: object, rows: Sequence[Sequence[str]], lines: Sequence[int]) -> np.ndarray:
    """The first three words of each row as floats, (rows, 3).

    Raises:
        ParseError: fewer than three words, or one that is no number.
    """
    try:
        numbers = [float(word) for row in rows for word in row[:3]]
    except ValueError:
        numbers = []
    if len(numbers) < 3 * len(rows) or any(_has_underscore(row[:3]) for row in rows):
        # An error is located only after reading has failed, as this takes longer.
        for row, line in zip(rows, lines, strict=True):
            if len(row) < 3:
                raise ParseError(f"a vertex has {len(row)} coordinates; needs 3.", file, line)
            _check_words(file, float, row[:3], line)
    return np.array(numbers, float).reshape(-1, 3)


def in_doubles(coordinates: np.ndarray) -> np.ndarray:
    """Coordinates of a binary file as doubles, without NumPy's warning of signalling NaNs, which are refused later."""
    with np.errstate(invalid="ignore"):
        return coordinates.astype(float)


def indices_in(file: object, words: Sequence[str], line: int) -> list[int]:
    """The words as integers.

    Raises:
        ParseError: a word that is no integer.
    """
    try:
        numbers = [int(word) for word in words]
    except ValueError:
        numbers = None
    # Largest index or count, within 64 bits.
    if numbers is None or _has_underscore(words) or max(map(abs, numbers), default=0) >= (1 << 62):
        _check_words(file, int, words, line)
        raise ParseError(f"a whole number is too large: {shown(' '.join(words))}.", file, line)
    return numbers


def _check_words(file: object, kind: type, words: Sequence[str], line: int) -> None:
    for word in words:
        if not _is(kind, word):
            needed = "number" if kind is float else "whole number"
            raise ParseError(f"needs a {needed}; found {shown(word)}.", file, line)


def _has_underscore(words: Sequence[str]) -> bool:
    """Whether a word has an underscore, which Python accepts between digits but no file format does."""
    return "_" in "".join(words)


def _is(kind: type, word: str) -> bool:
    try:
        kind(word)
    except ValueError:
        return False
    return "_" not in word


def _refusal(file: object, message: str, place: Any, by_line: bool) -> ParseError:
    return ParseError(message, file, int(place)) if by_line else ParseError(f"byte {place}: {message}", file)


def are_fans(corners: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Whether each polygon is proven to be the union of its fan; False if floats do not decide.

    Args:
        corners: the coordinates of the corners of all polygons, one after the other, (corners, 3).
        sizes: number of corners of each polygon, at least 3.
    """
    first = np.cumsum(sizes) - sizes
    counts = sizes - 2
    start = np.cumsum(counts) - counts
    polygon = np.repeat(np.arange(len(sizes)), counts)
    k = first[polygon] + 1 + np.arange(counts.sum()) - start[polygon]
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        origin = corners[first][polygon]
        here, after, side = corners[k] - origin, corners[k + 1] - origin, corners[first + 1][polygon] - origin
        normal = np.add.reduceat(np.cross(here, after), start, axis=0)
        axis = np.argmax(np.abs(normal), axis=1)
        ahead = np.sign(np.take_along_axis(normal, axis[:, None], 1)[:, 0])[polygon]
        columns = np.stack([axis + 1, axis + 2], axis=1)[polygon] % 3
        here, after, side = (np.take_along_axis(x, columns, 1) for x in (here, after, side))
        good = _turns(here, after, ahead) & _turns(side, after, ahead)
    return np.logical_and.reduceat(good, start)


def _turns(p: np.ndarray, q: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    left, right = p[:, 0] * q[:, 1], p[:, 1] * q[:, 0]
    # Rounding of the difference of two products of differences, as a fraction of the sum of both: four units in the
    # last place; and a bound of what underflow loses.
    return ahead * (left - right) > (8 * 2.0**-53) * (np.abs(left) + np.abs(right)) + 1e-300


def ears(corners: np.ndarray) -> list[_Ear] | None:
    """Triangulate one polygon with corners (corners, 3) by ears, without new points; None if it crosses itself."""
    flat, _ = integers(corners.ravel().tolist())
    rows = [tuple(flat[k : k + 3]) for k in range(0, len(flat), 3)]
    fan = [(0, k, k + 1) for k in range(1, len(rows) - 1)]
    doubled = [[_area([rows[i][u] for i in f], [rows[i][v] for i in f]) for f in fan] for u, v in _SEEN]
    normal = [sum(areas) for areas in doubled]
    axis = max(range(3), key=lambda k: abs(normal[k]))
    if not normal[axis]:
        # A polygon on a line is its own fan. Any other polygon of area zero crosses itself.
        return None if any(map(any, doubled)) else fan
    u, v = _SEEN[axis] if normal[axis] > 0 else _SEEN[axis][::-1]
    return _cut([(row[u], row[v]) for row in rows])


# For each viewing axis, the two axes that are seen.
_SEEN = ((1, 2), (2, 0), (0, 1))


def _area(x: Sequence[int], y: Sequence[int]) -> int:
    """Twice the area of a triangle, positive if it turns from x towards y."""
    return (x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0])


def _turn(p: _Place, q: _Place, r: _Place) -> int:
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


def _cut(places: Sequence[_Place]) -> list[_Ear] | None:
    """The ears of a plane polygon of positive area, in the order of cutting; None if it crosses itself."""
    left, found, at, missed = list(range(len(places))), [], 0, 0
    straight = False
    while len(left) > 3:
        ear = (left[at - 1], left[at], left[(at + 1) % len(left)])
        if _is_ear(places, left, ear, straight):
            found.append(ear)
            del left[at]
            # The next corner but one: ears in turn make no thin triangles about one corner.
            at, missed, straight = (at + 1) % len(left), 0, False
            continue
        at, missed = (at + 1) % len(left), missed + 1
        if missed == len(left):
            if straight:
                return None
            missed, straight = 0, True
    last = (left[0], left[1], left[2])
    return None if _turn(*(places[k] for k in last)) < 0 else [*found, last]


def _is_ear(places: Sequence[_Place], left: Sequence[int], ear: _Ear, straight: bool) -> bool:
    """Whether a corner can be cut off; if `straight`, only a corner that does not turn can."""
    p, q, r = (places[k] for k in ear)
    turn = _turn(p, q, r)
    if straight or turn <= 0:
        return straight and turn == 0
    low, high = min(p[0], q[0], r[0]), max(p[0], q[0], r[0])
    for k in left:
        s = places[k]
        if low <= s[0] <= high and s not in (p, q, r):
            if _turn(p, q, s) >= 0 and _turn(q, r, s) >= 0 and _turn(r, p, s) >= 0:
                return False
    return True
