"""Vertices and polygons as files hold them, made into triangle meshes; every refusal names the place in the file."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jhd.io.ears import are_fans, ears
from jhd.io.errors import ParseError, shown
from jhd.shapes.mesh import TriangleMesh, places_of

# Of indices and counts; less than 64 bits hold.
_MOST = 1 << 62
# Corners of a polygon that is no fan: ears are looked for among all of them, in a second or two.
_MOST_CORNERS = 1_000


class Polygons(NamedTuple):
    """What a file holds.

    Args:
        vertices: coordinates, (vertices, 3).
        corners: the indices of the corners of all polygons, one after the other.
        sizes: the number of corners of each polygon.
        vertex_places: where each vertex is in the file: its line, or its byte.
        polygon_places: the same of each polygon.
        by_line: whether places are lines.
    """

    vertices: np.ndarray
    corners: np.ndarray
    sizes: np.ndarray
    vertex_places: Sequence[int] | np.ndarray
    polygon_places: Sequence[int] | np.ndarray
    by_line: bool = True


def mesh_of(file: object, found: Polygons) -> TriangleMesh:
    """The mesh of the polygons; those of more than three corners become triangles between their corners, see `ears`.

    Raises:
        ParseError: no vertex, no polygon, a coordinate that is no finite number, a polygon of fewer than three corners,
            or one that names a vertex that is not there, that crosses itself, or that is not convex and has very many
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
        message = f"a face names vertex {corners[bad[0]]}, counted from 0; there are {len(vertices)}."
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
        # Where something is wrong it is looked for, which takes longer than reading.
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
    if numbers is None or _has_underscore(words) or max(map(abs, numbers), default=0) >= _MOST:
        _check_words(file, int, words, line)
        raise ParseError(f"a whole number is too large: {shown(' '.join(words))}.", file, line)
    return numbers


def _check_words(file: object, kind: type, words: Sequence[str], line: int) -> None:
    for word in words:
        if not _is(kind, word):
            needed = "number" if kind is float else "whole number"
            raise ParseError(f"needs a {needed}; found {shown(word)}.", file, line)


def _has_underscore(words: Sequence[str]) -> bool:
    """Whether there is one, which Python takes between digits and files do not."""
    return "_" in "".join(words)


def _is(kind: type, word: str) -> bool:
    try:
        kind(word)
    except ValueError:
        return False
    return "_" not in word


def _refusal(file: object, message: str, place: Any, by_line: bool) -> ParseError:
    return ParseError(message, file, int(place)) if by_line else ParseError(f"byte {place}: {message}", file)
