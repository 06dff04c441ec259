"""Triangle meshes in files: OBJ, STL (text and binary), PLY (text and binary, either byte order), OFF, glTF and 3MF.

Polygons become triangles between their corners, convex ones fans about the first corner. Data other than the surface
(normals, colors, textures, lines, materials) are dropped; free-form surfaces are refused. STL files have no common
vertices, so equal coordinates become one vertex.
"""

from codecs import BOM_UTF8
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from jhd._io.errors import ParseError, numbered_lines, read_bytes, shown
from jhd._io.gltf import read_gltf
from jhd._io.model_packages import read_3mf
from jhd._io.ply import read_ply, write_ply
from jhd._io.polygons import Polygons, coordinates_in, in_doubles, indices_in, merged, mesh_of
from jhd._runtime.files import replace_file
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.mesh import TriangleMesh, check_mesh

_STL_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEADER = 80
# Parts of a surface in OBJ files other than faces: free-form ones, faces by an older name, and other files.
_UNREAD = ("surf", "fo", "bsp", "bzp", "cdp", "call")


def load_mesh(file: str | Path) -> TriangleMesh:
    """Load a triangle mesh from an OBJ, STL, PLY, OFF, glTF or 3MF file.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> triangle = jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> with TemporaryDirectory() as folder:
    ...     jhd.io.save_mesh(f"{folder}/triangle.off", triangle)
    ...     jhd.io.load_mesh(f"{folder}/triangle.off").triangles.tolist()
    [[0, 1, 2]]

    Args:
        file: name with the suffix .obj, .stl, .ply, .off, .glb, .gltf or .3mf.

    Returns:
        The mesh; polygons are split into triangles. A scene (.glb, .gltf, .3mf) becomes one mesh: every part at its
        place, in the coordinates and the unit of the scene.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: another suffix, or content that cannot be read, with the line or byte.
    """
    suffix = Path(file).suffix.lower()
    if suffix in _SCENES:
        return _SCENES[suffix](str(file), read_bytes(file))
    if suffix not in _READERS:
        known = ", ".join((*MESH_SUFFIXES, *SCENE_SUFFIXES))
        raise ParseError(f"the suffix is {suffix!r}; a mesh is a file {known}.", file)
    return mesh_of(file, _READERS[suffix](file, read_bytes(file)))


def save_mesh(file: str | Path, mesh: ShapeLike, *, text: bool = False) -> None:
    """Write a triangle mesh to an OBJ, STL, PLY or OFF file.

    `load_mesh` reads the same mesh back bit for bit, with two exceptions: STL files store corners instead of common
    vertices, and binary STL files have single precision.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> triangle = jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> with TemporaryDirectory() as folder:
    ...     jhd.io.save_mesh(f"{folder}/triangle.ply", triangle)
    ...     jhd.io.load_mesh(f"{folder}/triangle.ply").vertices.tolist()
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]

    Args:
        file: name with the suffix .obj, .stl, .ply or .off. An existing file is replaced.
        mesh: a TriangleMesh, or an object that `jhd.as_shape` converts to one.
        text: whether to write STL and PLY files as text instead of binary; OBJ and OFF files are always text.

    Returns:
        None.

    Raises:
        TypeError: not a mesh.
        ValueError: another suffix, or coordinates beyond the range of a binary STL file.
    """
    taken = taken_as("mesh", mesh)
    check_mesh("mesh", taken)
    suffix = Path(file).suffix.lower()
    if suffix not in _WRITERS:
        raise ValueError(f"the suffix of {file} is {suffix!r}; a mesh is a file {_KNOWN}.")
    replace_file(file, _WRITERS[suffix](np.asarray(taken.vertices), np.asarray(taken.triangles), text))


def _lines(content: bytes) -> Iterator[tuple[int, list[str]]]:
    """The words of each line that has some, comments left out, and the number of the line."""
    for number, line in numbered_lines(content.removeprefix(BOM_UTF8)):
        words = (line.partition("#")[0] if "#" in line else line).split()
        if words:
            yield number, words


def _polygons(points: np.ndarray, corners: list, sizes: list, vertex_lines: list, polygon_lines: list) -> Polygons:
    return Polygons(points, np.array(corners, np.int64), np.array(sizes, np.int64), vertex_lines, polygon_lines)


def _read_obj(file: object, content: bytes) -> Polygons:
    """OBJ: indices count from 1, or backwards from the last vertex so far; texture and normal are left out.

    A backslash at the end of a line joins the next line to it, except in comments, in which it may end a folder name.
    """
    vertices, corners, sizes, vertex_lines, polygon_lines = [], [], [], [], []
    if b"\\" in content:
        content = _joined(content)
    for number, words in _lines(content):
        if words[0] == "v":
            vertices.append(words[1:4])
            vertex_lines.append(number)
        elif words[0] in _UNREAD:
            raise ParseError(f"holds {words[0]!r}, which is not read; needs faces, 'f'.", file, number)
        elif words[0] == "f":
            named = indices_in(file, [word.partition("/")[0] for word in words[1:]], number)
            corners.extend(_counted(file, named, len(vertices), number))
            sizes.append(len(named))
            polygon_lines.append(number)
    points = coordinates_in(file, vertices, vertex_lines)
    return _polygons(points, corners, sizes, vertex_lines, polygon_lines)._replace(base=1)


def _joined(content: bytes) -> bytes:
    """Join continued lines, followed by empty lines, so that line numbers stay."""
    joined, parts = [], []
    for line in content.splitlines():
        parts.append(line.rstrip())
        if parts[-1].endswith(b"\\") and b"#" not in parts[-1]:
            parts[-1] = parts[-1][:-1]
            continue
        joined += [b" ".join(parts), *[b""] * (len(parts) - 1)]
        parts = []
    return b"\n".join([*joined, b" ".join(parts)])


def _counted(file: object, named: list[int], count: int, line: int) -> list[int]:
    """Indices from 0; too large ones are checked later, since vertices may follow."""
    if min(named, default=1) > 0:
        return [i - 1 for i in named]
    for i in named:
        if i == 0 or i < -count:
            message = f"a face names vertex {i}; needs 1 to {count}" + (f", or -{count} to -1." if count else ".")
            raise ParseError(message, file, line)
    return [i - 1 if i > 0 else count + i for i in named]


def _read_off(file: object, content: bytes) -> Polygons:
    """OFF: the numbers of vertices, faces and edges, then the rows; colors and normals behind coordinates go."""
    lines = _lines(content)
    number, words = next(lines, (1, []))
    keyword = words[0] if words else ""
    if keyword.upper().lstrip("STCN") != "OFF" or "BINARY" in words:
        raise ParseError(f"needs OFF and text in its first line; found {' '.join(words)[:40]!r}.", file, number)
    words = words[1:]
    if not words:
        number, words = next(lines, (number, []))
    counts = indices_in(file, words[:3], number)
    if len(counts) < 2 or min(counts) < 0:
        raise ParseError("needs the numbers of vertices, faces and edges.", file, number)
    vertices, corners, sizes, vertex_lines, polygon_lines = [], [], [], [], []
    for number, words in lines:
        if len(vertices) < counts[0]:
            vertices.append(words[:3])
            vertex_lines.append(number)
        elif len(sizes) < counts[1]:
            size = indices_in(file, words[:1], number)[0]
            if not 0 <= size < len(words):
                raise ParseError(f"announces {size} corners; the line has {len(words) - 1} numbers.", file, number)
            corners.extend(indices_in(file, words[1 : size + 1], number))
            sizes.append(size)
            polygon_lines.append(number)
        else:
            message = f"a row follows {counts[0]} vertices and {counts[1]} faces: {shown(' '.join(words[:9]))}."
            raise ParseError(message, file, number)
    for name, found, wanted in (("vertices", vertices, counts[0]), ("faces", sizes, counts[1])):
        if len(found) < wanted:
            raise ParseError(f"ends after {len(found)} of {wanted} {name}.", file, number)
    points = coordinates_in(file, vertices, vertex_lines)
    return _polygons(points, corners, sizes, vertex_lines, polygon_lines)


def _read_stl(file: object, content: bytes) -> Polygons:
    """STL of either kind. Binary files may begin with "solid" too: letters as a number of triangles are billions."""
    size, start = len(content), _STL_HEADER + 4
    count = int(np.frombuffer(content, "<u4", 1, _STL_HEADER)[0]) if size >= start else 0
    needed = start + _STL_ROW.itemsize * count
    is_text = size < needed and b"\0" not in content[:start]
    if is_text and content.removeprefix(BOM_UTF8).lstrip()[:5].lower() == b"solid":
        return _stl_text(file, content)
    if size < start:
        raise ParseError(f"byte {size}: ends within the header of {start} bytes.", file)
    if size < needed:
        whole = (size - start) // _STL_ROW.itemsize
        raise ParseError(f"byte {size}: ends after {whole} of {count} triangles.", file)
    # Some programs append bytes of their own, but no triangles.
    more, rest = divmod(size - needed, _STL_ROW.itemsize)
    if more and not rest and any(content[needed:]):
        raise ParseError(f"byte {needed}: {count} triangles are announced, and {more} more follow.", file)
    return _stl_rows(content, start, count)


def _stl_rows(content: bytes, start: int, count: int) -> Polygons:
    table = np.frombuffer(content, _STL_ROW, count, start)
    vertices, numbers = merged(in_doubles(table["corners"].reshape(-1, 3)))
    places = start + _STL_ROW.itemsize * np.arange(count)
    of_vertices = np.zeros(len(vertices), np.int64)
    of_vertices[numbers[::-1]] = np.repeat(places, 3)[::-1]
    return Polygons(vertices, numbers, np.full(count, 3), of_vertices, places, by_line=False)


def _stl_text(file: object, content: bytes) -> Polygons:
    corners, lines, facets, keyword, number = [], [], [], "", 1
    for number, words in _lines(content):
        keyword = words[0].lower()
        if keyword == "vertex":
            if len(words) > 4:
                raise ParseError(f"a vertex has {len(words) - 1} coordinates; needs 3.", file, number)
            corners.append(words[1:])
            lines.append(number)
        elif keyword == "facet":
            facets.append((number, len(corners)))
        elif keyword not in ("solid", "outer", "endloop", "endfacet", "endsolid") and facets:
            raise ParseError(f"needs facet, outer, vertex or their ends; found {shown(words[0])}.", file, number)
    if facets and keyword != "endsolid":
        raise ParseError("ends without 'endsolid'.", file, number)
    sizes = np.diff([start for _, start in facets] + [len(corners)])
    if facets and facets[0][1]:
        raise ParseError("a vertex stands before the first facet.", file, lines[0])
    points = coordinates_in(file, corners, lines)
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if not len(points) or not facets or len(bad):
        # Coordinates that are not finite are refused by their own line, before equal vertices become one.
        return Polygons(points, np.arange(len(points)), sizes, lines, [n for n, _ in facets])
    vertices, numbers = merged(points)
    return Polygons(vertices, numbers, sizes, lines, [number for number, _ in facets])


def _write_obj(vertices: np.ndarray, triangles: np.ndarray, text: bool) -> bytes:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {i} {j} {k}" for i, j, k in (triangles + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


def _write_off(vertices: np.ndarray, triangles: np.ndarray, text: bool) -> bytes:
    lines = ["OFF", f"{len(vertices)} {len(triangles)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"3 {i} {j} {k}" for i, j, k in triangles.tolist()]
    return ("\n".join(lines) + "\n").encode()


def _write_stl(vertices: np.ndarray, triangles: np.ndarray, text: bool) -> bytes:
    corners = vertices[triangles].astype(float)
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(doubled, axis=1, keepdims=True)
    normals = doubled / np.where(length > 0, length, 1.0)
    if text:
        lines = ["solid mesh"]
        for normal, rows in zip(normals.tolist(), corners.tolist(), strict=True):
            lines += ["facet normal {!r} {!r} {!r}".format(*normal), "outer loop"]
            lines += ["vertex {!r} {!r} {!r}".format(*row) for row in rows]
            lines += ["endloop", "endfacet"]
        return ("\n".join([*lines, "endsolid mesh"]) + "\n").encode()
    limit = float(np.finfo(np.float32).max)
    if np.abs(corners).max() > limit:
        raise ValueError(f"a coordinate is {np.abs(corners).max():g}; a binary STL file holds at most {limit:g}.")
    table = np.zeros(len(triangles), _STL_ROW)
    table["normal"], table["corners"] = normals, corners
    return b"binary".ljust(_STL_HEADER) + np.array(len(table), "<u4").tobytes() + table.tobytes()


_READERS: dict[str, Callable[[object, bytes], Polygons]] = {
    ".obj": _read_obj, ".off": _read_off, ".ply": read_ply, ".stl": _read_stl,
}  # fmt: skip
_WRITERS: dict[str, Callable[[np.ndarray, np.ndarray, bool], bytes]] = {
    ".obj": _write_obj, ".off": _write_off, ".ply": write_ply, ".stl": _write_stl,
}  # fmt: skip
# Files that are read and not written.
_SCENES: dict[str, Callable[[str, bytes], TriangleMesh]] = {".glb": read_gltf, ".gltf": read_gltf, ".3mf": read_3mf}
MESH_SUFFIXES, SCENE_SUFFIXES = tuple(_READERS), tuple(_SCENES)
_KNOWN = f"{', '.join(MESH_SUFFIXES[:-1])} or {MESH_SUFFIXES[-1]}"
