"""PLY files: a header that names elements and their properties, then their rows as text or as bytes.

Only the coordinates of `vertex` and the corners of `face` are kept; other elements are skipped. The layout follows the
Stanford 3D Scanning Repository (Turk 1994); `vertex_index` and `vertex_indices` are both in use. A file without faces
is a point cloud.
"""

import re
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from jhd._io.errors import ParseError, numbered_lines, shown
from jhd._io.polygons import Polygons, coordinates_in, in_doubles, indices_in

_TYPES = {
    name: code
    for names, code in (
        ("char int8", "i1"), ("uchar uint8", "u1"), ("short int16", "i2"), ("ushort uint16", "u2"),
        ("int int32", "i4"), ("uint uint32", "u4"), ("float float32", "f4"), ("double float64", "f8"),
    )
    for name in names.split()
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS = ("vertex_indices", "vertex_index")
# Largest number of rows; more than any file has bytes.
_DIGITS = 18


class _Property(NamedTuple):
    name: str
    type: str
    # The type of the length of a list, empty for a single number.
    length: str


class _PlyElement(NamedTuple):
    name: str
    count: int
    properties: list[_Property]

    def place(self, name: str) -> int:
        """Index of the property of this name, or -1."""
        return next((k for k, p in enumerate(self.properties) if p.name == name), -1)


def read_ply(file: object, content: bytes) -> Polygons:
    """The vertices and polygons of a PLY file; no polygons if it has no element `face`.

    Raises:
        ParseError: a header or rows that cannot be read, with line or byte.
    """
    order, elements, lines, start = _header(file, content)
    rows, end = _binary(file, content, start, order) if order else _text(file, content, start, lines)
    found = {}
    for element in elements:
        found[element.name] = rows(element)
    end()
    if "vertex" not in found:
        raise ParseError("has no element 'vertex'.", file)
    none = np.zeros(0, np.int64)
    vertices, _, vertex_places = found["vertex"]
    corners, sizes, polygon_places = found.get("face", (none, none, none))
    return Polygons(vertices, corners, sizes, vertex_places, polygon_places, by_line=not order)


def write_ply(vertices: np.ndarray, triangles: np.ndarray, text: bool) -> bytes:
    """The bytes of a PLY file; little endian unless it is to be text."""
    types = "double" if vertices.dtype.itemsize == 8 else "float"
    header = [
        "ply",
        f"format {'ascii' if text else 'binary_little_endian'} 1.0",
        f"element vertex {len(vertices)}",
        *(f"property {types} {axis}" for axis in "xyz"),
        f"element face {len(triangles)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    start = "\n".join(header).encode()
    if text:
        lines = [" ".join(map(repr, row)) for row in vertices.tolist()]
        lines += ["3 " + " ".join(map(str, row)) for row in triangles.tolist()]
        return start + ("\n".join(lines) + "\n").encode()
    faces = np.empty(len(triangles), [("size", "u1"), ("corners", "<i4", 3)])
    faces["size"], faces["corners"] = 3, triangles
    return start + vertices.astype(vertices.dtype.newbyteorder("<")).tobytes() + faces.tobytes()


def _header(file: object, content: bytes) -> tuple[str, list[_PlyElement], int, int]:
    """The byte order (empty for text), the elements, the number of lines, and the start of the rows."""
    end = re.search(rb"(?:^|\n|\r)end_header[ \t]*(\r\n|\n|\r)", content[: 1 << 20])
    if not content.startswith(b"ply") or end is None:
        raise ParseError("is not a PLY file: needs 'ply' at its start and a line 'end_header'.", file, 1)
    lines = list(numbered_lines(content[: end.start() + 1]))
    order, elements = None, []
    for number, line in lines[1:]:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format":
            if len(words) < 2 or words[1] not in _ORDERS:
                raise ParseError(f"needs a format of {', '.join(_ORDERS)}; found {shown(line)}.", file, number)
            order = _ORDERS[words[1]]
        elif words[0] == "element" and len(words) == 3 and words[2].isdecimal() and len(words[2]) <= _DIGITS:
            elements.append(_PlyElement(words[1], int(words[2]), []))
        elif words[0] == "property" and elements:
            elements[-1].properties.append(_property(file, words, number))
        else:
            raise ParseError(f"cannot read {shown(line)} in the header.", file, number)
    if order is None:
        raise ParseError("has no line 'format'.", file, 1)
    before: set[str] = set()
    for element in elements:
        _check_properties(file, element, before)
        before.add(element.name)
    return order, elements, len(lines) + 1, end.end()


def _property(file: object, words: list[str], line: int) -> _Property:
    listed = len(words) == 5 and words[1] == "list"
    types = words[2:4] if listed else words[1:2]
    if len(words) != (5 if listed else 3) or any(name not in _TYPES for name in types):
        raise ParseError(f"cannot read the property {shown(' '.join(words[1:]))}.", file, line)
    codes = [_TYPES[name] for name in types]
    return _Property(words[-1], codes[-1], codes[0] if listed else "")


def _check_properties(file: object, element: _PlyElement, before: set[str]) -> None:
    """Raise ParseError if a vertex has no coordinates, a face no corners, or rows are empty."""
    if element.name in before:
        raise ParseError(f"has two elements {shown(element.name)}.", file)
    if element.count and not element.properties:
        raise ParseError(f"the element {shown(element.name)} has {element.count} rows of no property.", file)
    if element.count and element.name == "tristrips":
        raise ParseError("holds 'tristrips', which are not read; needs faces.", file)
    if len({p.name for p in element.properties}) < len(element.properties):
        raise ParseError(f"the element {shown(element.name)} has two properties of one name.", file)
    for p in element.properties:
        if p.length and "f" in p.length:
            raise ParseError(f"the list {shown(p.name)} has a length that is not an integer.", file)
    _check_known(file, element)


def _check_known(file: object, element: _PlyElement) -> None:
    if element.name == "vertex":
        for axis in "xyz":
            if element.place(axis) < 0 or element.properties[element.place(axis)].length:
                raise ParseError(f"vertices have no property {axis!r} that is one number.", file)
    if element.name == "face":
        place = _corners_of(element)
        if place < 0 or not element.properties[place].length or "f" in element.properties[place].type:
            raise ParseError("faces have no list of whole numbers 'vertex_indices'.", file)


def _corners_of(element: _PlyElement) -> int:
    return max(element.place(name) for name in _CORNERS)


# The rows of an element: the coordinates, or the corners and their counts, and the positions of the rows.
_Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


# Two functions: one reads the rows of the next element; one raises ParseError if data follow the last element.
_Reader = tuple[Callable[[_PlyElement], _Rows], Callable[[], None]]


def _text(file: object, content: bytes, start: int, header_lines: int) -> _Reader:
    """A reader of the elements in their order from lines."""
    lines = numbered_lines(content[start:], header_lines + 1)
    filled = ((number, words) for number, line in lines if (words := line.split()))

    def rows(element: _PlyElement) -> _Rows:
        values, sizes, places = [], [], []
        vertex = element.name == "vertex"
        wanted = [element.place(axis) for axis in "xyz"] if vertex else [_corners_of(element)]
        plain = not any(p.length for p in element.properties)
        for k in range(element.count):
            number, words = next(filled, (0, []))
            if not words:
                raise ParseError(f"ends after {k} of {element.count} rows of {shown(element.name)}.", file)
            if element.name not in ("vertex", "face"):
                continue
            fields = [[word] for word in words] if plain else _fields(file, words, element, number)
            if len(fields) != len(element.properties):
                message = f"has {len(fields)} numbers; {shown(element.name)} has {len(element.properties)} properties."
                raise ParseError(message, file, number)
            chosen = [word for place in wanted for word in fields[place]]
            values.extend([chosen] if vertex else indices_in(file, chosen, number))
            sizes.append(len(chosen))
            places.append(number)
        if vertex:
            return coordinates_in(file, values, places), np.array(sizes), np.array(places)
        return np.array(values, np.int64), np.array(sizes, np.int64), np.array(places)

    def end() -> None:
        number, words = next(filled, (0, []))
        if words:
            raise ParseError(f"a row follows the last element: {shown(' '.join(words[:9]))}.", file, number)

    return rows, end


def _fields(file: object, words: list[str], element: _PlyElement, line: int) -> list[list[str]]:
    """The words of each property."""
    fields, at = [], 0
    for p in element.properties:
        size = 1
        if p.length:
            size = indices_in(file, words[at : at + 1], line)[0] if at < len(words) else 0
            at += 1
        if size < 0 or at + size > len(words):
            raise ParseError(f"ends within {shown(p.name)}, which has {size} numbers.", file, line)
        fields.append(words[at : at + size])
        at += size
    # Words left over become one more field.
    return [*fields, words[at:]] if at < len(words) else fields


def _binary(file: object, content: bytes, start: int, order: str) -> _Reader:
    """A reader of the elements in their order from bytes."""
    at = start

    def rows(element: _PlyElement) -> _Rows:
        nonlocal at
        table = _even(content, at, order, element)
        if table is not None:
            places = at + table.dtype.itemsize * np.arange(element.count)
            at += table.nbytes
            return _columns(element, table, places)
        parts, at = _uneven(file, content, at, order, element)
        return parts

    def end() -> None:
        if content[at:].strip():
            raise ParseError(f"byte {at}: {len(content) - at} bytes follow the last element.", file)

    return rows, end


def _even(content: bytes, at: int, order: str, element: _PlyElement) -> np.ndarray | None:
    """The rows as a table if all lists are as long as in the first row; None otherwise, or if there are no rows."""
    if not element.count:
        return None
    types, sizes, offset = [], [], at
    for k, p in enumerate(element.properties):
        if p.length:
            counted = np.dtype(order + p.length)
            if offset + counted.itemsize > len(content):
                return None
            size = int(np.frombuffer(content, counted, 1, offset)[0])
            if size < 0 or offset + size > len(content):
                return None
            types.append((f"size{k}", counted))
            sizes.append((f"size{k}", size))
            offset += counted.itemsize
            types.append((f"value{k}", np.dtype(order + p.type), size))
            offset += np.dtype(p.type).itemsize * size
        else:
            types.append((f"value{k}", np.dtype(order + p.type)))
            offset += np.dtype(p.type).itemsize
    row = np.dtype(types)
    if not row.itemsize or at + row.itemsize * element.count > len(content):
        return None
    table = np.frombuffer(content, row, element.count, at)
    return table if all(np.all(table[name] == size) for name, size in sizes) else None


def _columns(element: _PlyElement, table: np.ndarray, places: np.ndarray) -> _Rows:
    if element.name == "vertex":
        points = np.stack([table[f"value{element.place(axis)}"] for axis in "xyz"], axis=1)
        return in_doubles(points), np.full(len(table), 3), places
    if element.name == "face":
        corners = table[f"value{_corners_of(element)}"].reshape(len(table), -1)
        return corners.astype(np.int64).ravel(), np.full(len(table), corners.shape[1]), places
    return np.zeros(0), np.zeros(0, np.int64), places


def _uneven(file: object, content: bytes, at: int, order: str, element: _PlyElement) -> tuple[_Rows, int]:
    """The rows, read one by one, and the position after them."""
    values, sizes, places = [], [], []
    wanted = [element.place(axis) for axis in "xyz"] if element.name == "vertex" else [_corners_of(element)]
    # Rows without properties take no bytes, so the file does not bound their number.
    for k in range(element.count if element.properties else 0):
        places.append(at)
        fields = []
        for array, end in _read(content, at, order, element):
            if array is None:
                raise ParseError(f"byte {at}: ends after {k} of {element.count} rows of {shown(element.name)}.", file)
            fields.append(array)
            at = end
        if element.name in ("vertex", "face"):
            chosen = np.concatenate([fields[place] for place in wanted])
            values.append(chosen)
            sizes.append(len(chosen))
    if element.name == "vertex":
        return (np.array(values, float).reshape(-1, 3), np.array(sizes), np.array(places)), at
    corners = np.concatenate([np.zeros(0, np.int64), *values]).astype(np.int64)
    return (corners, np.array(sizes, np.int64), np.array(places)), at


def _read(content: bytes, at: int, order: str, element: _PlyElement) -> Iterator[tuple[np.ndarray | None, int]]:
    """The numbers of each property of one row, each with the position after them; None if the content ends."""
    for p in element.properties:
        size = 1
        if p.length:
            counted = np.dtype(order + p.length)
            size = -1
            if at + counted.itemsize <= len(content):
                size = int(np.frombuffer(content, counted, 1, at)[0])
                at += counted.itemsize
        kind = np.dtype(order + p.type)
        if size < 0 or at + size * kind.itemsize > len(content):
            yield None, at
            return
        array = np.frombuffer(content, kind, size, at)
        at += size * kind.itemsize
        yield array, at
