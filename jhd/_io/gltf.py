"""Triangles of glTF 2.0 files: .gltf with its buffers inside or next to it, and binary .glb.

Follows the Khronos specification glTF 2.0. Materials, normals, lines, points and animations are dropped. Files whose
geometry needs more than triangles of floats are refused: skins, morphs, sparse accessors and compressed data.
"""

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from jhd._io.errors import ParseError, read_bytes, shown
from jhd._io.scenes import ScenePart, joined
from jhd._shapes.mesh import TriangleMesh

_MAGIC, _JSON, _BINARY = b"glTF", b"JSON", b"BIN\0"
_FLOAT, _INDICES = 5126, {5121: "u1", 5123: "<u2", 5125: "<u4"}
_STRIP, _FAN = 5, 6
# Extensions that leave the triangles as they are.
_HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp")


def read_gltf(file: str, content: bytes) -> TriangleMesh:
    """The triangles of the default scene of the file, in the coordinates of the scene.

    Raises:
        FileNotFoundError: a buffer next to the file does not exist.
        ParseError: content that is no glTF, or has a feature that is not read.
    """
    text, binary = _chunks(file, content) if content.startswith(_MAGIC) else (content, None)
    try:
        header = json.loads(text)
        return joined(file, _parts(_Scene(file, header, binary)))
    except (ParseError, FileNotFoundError):
        raise
    except KeyError as error:
        raise ParseError(f"glTF: the key {error} is missing.", file) from None
    except (ValueError, TypeError, AttributeError, IndexError, OverflowError, RecursionError) as error:
        # JSON of another structure fails in many ways.
        raise ParseError(f"glTF: {' '.join(str(error)[:200].split())}", file) from None


def _chunks(file: str, content: bytes) -> tuple[bytes, bytes | None]:
    """The JSON chunk and the binary chunk of a .glb file."""
    version = int.from_bytes(content[4:8], "little")
    if version != 2:
        raise ParseError(f"glTF: the version is {version}; needs 2.", file)
    found: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= len(content):
        size, kind = int.from_bytes(content[place : place + 4], "little"), content[place + 4 : place + 8]
        if place + 8 + size > len(content):
            raise ParseError(f"byte {place}: a chunk of {size} bytes ends beyond the file.", file)
        found.setdefault(kind, content[place + 8 : place + 8 + size])
        place += 8 + size
    if _JSON not in found:
        raise ParseError("glTF: has no JSON chunk.", file)
    return found[_JSON], found.get(_BINARY)


class _Scene:
    """The content of a file by the lists of its header."""

    def __init__(self, file: str, header: dict[str, Any], binary: bytes | None):
        self.file, self.header, self.binary = file, header, binary
        self.known: dict[int, bytes] = {}
        version = str(header["asset"]["version"])
        if not version.startswith("2."):
            raise ParseError(f"glTF: the version is {shown(version)}; needs 2.0.", file)
        for name in header.get("extensionsRequired", []):
            if not name.startswith(_HARMLESS):
                raise ParseError(f"glTF: needs the extension {shown(name)}, which is not read.", file)

    def entry(self, name: str, index: Any) -> dict[str, Any]:
        """An entry of a list of the header."""
        entries = self.header[name]
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(entries):
            raise ParseError(f"glTF: names {name}[{shown(index)}]; there are {len(entries)}.", self.file)
        return entries[index]

    def rows(self, index: Any, kinds: dict[int, str], columns: int) -> np.ndarray:
        """The rows of an accessor, (count, columns)."""
        found = self.entry("accessors", index)
        if "sparse" in found or "bufferView" not in found or found["componentType"] not in kinds:
            kind = "sparse" if "sparse" in found else f"of type {found['componentType']}, or without data"
            raise ParseError(f"glTF: accessors[{index}] is {kind}, which is not read.", self.file)
        if found["type"] != ("SCALAR", "", "VEC3")[columns - 1]:
            raise ParseError(
                f"glTF: accessors[{index}] is a {shown(found['type'])}; needs {columns} columns.", self.file
            )
        view = self.entry("bufferViews", found["bufferView"])
        dtype = np.dtype(kinds[found["componentType"]])
        row = columns * dtype.itemsize
        start, size = view.get("byteOffset", 0) + found.get("byteOffset", 0), view["byteLength"]
        stride, count = view.get("byteStride", row), found["count"]
        end = found.get("byteOffset", 0) + (count - 1) * stride + row
        data = self.buffer(view["buffer"])
        if not (count > 0 and stride >= row and start >= 0 and end <= size and start - found.get("byteOffset", 0) >= 0):
            raise ParseError(f"glTF: accessors[{index}] does not fit its bufferView.", self.file)
        if view.get("byteOffset", 0) + size > len(data):
            raise ParseError(f"glTF: a bufferView ends beyond its buffer of {len(data)} bytes.", self.file)
        return np.ndarray((count, columns), dtype, data, start, (stride, dtype.itemsize))

    def buffer(self, index: Any) -> bytes:
        """The bytes of a buffer: of the binary chunk, in the JSON itself, or of a file in the same folder."""
        found = self.entry("buffers", index)
        if index not in self.known:
            uri = found.get("uri")
            if uri is None and (index or self.binary is None):
                raise ParseError(f"glTF: buffers[{index}] has no data.", self.file)
            self.known[index] = self.binary or b"" if uri is None else self.named(uri)
        return self.known[index]

    def named(self, uri: str) -> bytes:
        """The bytes that a URI stands for."""
        if uri.startswith("data:"):
            head, _, data = uri.partition(",")
            if not head.endswith(";base64"):
                raise ParseError(f"glTF: a buffer is {shown(head)}; needs base64.", self.file)
            return base64.b64decode(data, validate=True)
        name = unquote(uri)
        path = Path(self.file).parent / name
        if (
            ".." in Path(name).parts
            or Path(name).is_absolute()
            or ":" in name
            or (path.exists() and not path.is_file())
        ):
            raise ParseError(f"glTF: a buffer is {shown(uri)}; needs a file next to this one.", self.file)
        return read_bytes(path)


def _parts(scene: _Scene) -> Iterator[ScenePart]:
    """The triangles of each node of the scene."""
    header = scene.header
    if header.get("scenes"):
        roots = scene.entry("scenes", header.get("scene", 0)).get("nodes", [])
    else:
        children = {child for node in header.get("nodes", []) for child in node.get("children", [])}
        roots = [k for k in range(len(header.get("nodes", []))) if k not in children]
    waiting, seen = [(root, np.eye(4)) for root in reversed(roots)], set()
    known: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
    while waiting:
        index, above = waiting.pop()
        node = scene.entry("nodes", index)
        if index in seen:
            raise ParseError(f"glTF: nodes[{index}] has two parents.", scene.file)
        seen.add(index)
        with np.errstate(all="ignore"):
            matrix = above @ _matrix(node)
        waiting += [(child, matrix) for child in reversed(node.get("children", []))]
        if "mesh" not in node:
            continue
        mesh = scene.entry("meshes", node["mesh"])
        many = "EXT_mesh_gpu_instancing" in node.get("extensions", {})
        if many or "skin" in node or any(node.get("weights", mesh.get("weights", []))):
            message = f"glTF: nodes[{index}] has a skin, morph weights or instances, which are not read."
            raise ParseError(message, scene.file)
        if node["mesh"] not in known:
            surfaces = [primitive for primitive in mesh["primitives"] if primitive.get("mode", 4) >= 4]
            known[node["mesh"]] = [_triangles(scene, primitive) for primitive in surfaces]
        for points, triangles in known[node["mesh"]]:
            yield ScenePart(points, triangles, matrix)


def _matrix(node: dict[str, Any]) -> np.ndarray:
    """The map of a node: its matrix, stored by columns, or translation times rotation times scale."""
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    matrix = np.eye(4)
    if "rotation" in node:
        x, y, z, w = np.array(node["rotation"], float)
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    matrix[:3, :3] *= np.array(node.get("scale", [1.0, 1.0, 1.0]), float).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", [0.0, 0.0, 0.0]), float).reshape(3)
    return matrix


def _triangles(scene: _Scene, primitive: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """The points of a primitive and the corners of its triangles."""
    points = scene.rows(primitive["attributes"]["POSITION"], {_FLOAT: "<f4"}, 3).astype(float)
    if "indices" in primitive:
        corners = scene.rows(primitive["indices"], _INDICES, 1)[:, 0].astype(np.int64)
    else:
        corners = np.arange(len(points))
    if primitive.get("mode", 4) == _STRIP:
        k = np.arange(max(len(corners) - 2, 0))
        rows = np.stack([corners[k], corners[k + 1 + k % 2], corners[k + 2 - k % 2]], axis=1)
    elif primitive.get("mode", 4) == _FAN:
        rows = np.stack([corners[1:-1], corners[2:], np.full(max(len(corners) - 2, 0), corners[0])], axis=1)
    else:
        if len(corners) % 3:
            raise ParseError(f"glTF: triangles have {len(corners)} corners; needs a multiple of 3.", scene.file)
        return points, corners.reshape(-1, 3)
    # Strips repeat a corner to begin anew.
    whole = (rows[:, 0] != rows[:, 1]) & (rows[:, 1] != rows[:, 2]) & (rows[:, 2] != rows[:, 0])
    return points, rows[whole]
