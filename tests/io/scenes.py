"""Small glTF and 3MF files."""

import base64
import io
import json
import struct
import zipfile

import numpy as np

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def header(changes=None, data=b"", **others):
    """The header of a glTF file of one tetrahedron; changes are (key, ...): value, and None removes a key."""
    points, indices = CORNERS.astype("<f4").tobytes(), TRIANGLES.astype("<u2").tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data or points + indices).decode()
    made = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(indices)},
        ],
        "buffers": [{"uri": uri, "byteLength": len(points) + len(indices)}],
        **others,
    }
    for path, value in (changes or {}).items():
        inner = made
        for key in path[:-1]:
            inner = inner[key]
        if value is None:
            del inner[path[-1]]
        else:
            inner[path[-1]] = value
    return made


def gltf(changes=None, **others):
    return json.dumps(header(changes, **others)).encode()


def glb(changes=None, **others):
    """The same in a binary file, its buffer in a chunk."""
    made = header(changes, **others)
    data = base64.b64decode(made["buffers"][0].pop("uri").partition(",")[2])
    text = json.dumps(made).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def package(objects=None, items='<item objectid="1"/>', unit="", **members):
    """A 3MF file of one tetrahedron, or of other objects."""
    vertices = "".join(f'<vertex x="{x:g}" y="{y:g}" z="{z:g}"/>' for x, y, z in CORNERS)
    triangles = "".join(f'<triangle v1="{i}" v2="{j}" v3="{k}"/>' for i, j, k in TRIANGLES)
    mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
    content = f'<object id="1" type="model">{mesh}</object>' if objects is None else objects.replace("MESH", mesh)
    return zipped({"3D/3dmodel.model": model(content, items, unit), **members})


def model(objects, items="", unit=""):
    names = 'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
    names += 'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'
    return f"<model {names} {unit}><resources>{objects}</resources><build>{items}</build></model>"


def zipped(members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return stream.getvalue()
