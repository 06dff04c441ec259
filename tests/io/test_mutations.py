"""Files that are nearly right: whatever is changed in them, readers read or refuse in one line, quickly."""

import random
import re
import time

import numpy as np
import pytest

import jhd
import jhd.io
from tests.io.scenes import glb, gltf, package
from tests.sweeps import swept

CURVE = jhd.io.parse_path("M0 0C1 2 3 4 5 0A2 1 0 0 1 7 0L3 3Z")
MESH = jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
PATCH = jhd.BezierPatch(np.arange(27.0).reshape(3, 3, 3) ** 1.5, np.ones((3, 3)))
PLANE = jhd.polyline([(0, 0), (1, 0)])
DRAWING = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 10 10"><defs><symbol id="a" viewBox="0 0 2 2">
<rect x="1" y="1" width="50%" height="2mm" rx="1"/></symbol></defs><g transform="rotate(30,1,2) scale(2)"><use
href="#a" x="3"/><ellipse cx="1" cy="2" rx="1e1" ry=".5"/></g><path d="M0 0C1 2 3 4 5 0A2 1 0 0 1 7 0z"/></svg>"""
SAVED = {
    "a.json": lambda file: jhd.io.save_curve(file, CURVE),
    "b.json": lambda file: jhd.io.save_surface(file, PATCH),
    "b.svg": lambda file: jhd.io.save_svg(file, CURVE),
    "a.igs": lambda file: jhd.io.save_iges(file, CURVE),
    "b.igs": lambda file: jhd.io.save_iges(file, PATCH),
    **{f"a{kind}": lambda file: jhd.io.save_mesh(file, MESH) for kind in (".obj", ".off", ".ply", ".stl")},
    **{f"b{kind}": lambda file: jhd.io.save_mesh(file, MESH, text=True) for kind in (".ply", ".stl")},
    "a.svg": lambda file: file.write_text(DRAWING),
    "a.xyz": lambda file: file.write_text("0 0 0\n1 2 3\n# c\n4,5,6\n"),
    "a.csv": lambda file: file.write_text("id,x,y,z\n1,0,0,0\n2,1,2.5,3\n# c\n3,4,5,6\n"),
    "a.txt": lambda file: file.write_text("0 0 0\n1 2.5 3\n# c\n4 5 6\n"),
    "a.wkt": lambda file: file.write_text("LINESTRING (0 0, 1 2, 3 4)\nSRID=4326;POLYGON ((0 0, 1 0, 0 1, 0 0))\n"),
    "a.geojson": lambda file: file.write_text(
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {"a": [1]}, "geometry": '
        '{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [0.5, 1], [0, 0]]]}}]}'
    ),
    "a.glb": lambda file: file.write_bytes(glb(nodes=[{"mesh": 0, "translation": [1, 2, 3], "scale": [1, 2, 3]}])),
    "a.gltf": lambda file: file.write_bytes(gltf()),
    "a.3mf": lambda file: file.write_bytes(package()),
    "a.npy": lambda file: np.save(file, np.eye(3)),
    "r.json": lambda file: jhd.io.save_result(file, PLANE),
    "r.npz": lambda file: jhd.io.save_result(file, PLANE),
    "path": lambda file: file.write_text("M 0 0 C 1 2 3 4 5 0 A 2 1 0 0 1 7 0 L 3 3 Z m 1 1 q 2 3 4 5 t 1 1 h 3 v -4"),
    "polynomial": lambda file: file.write_text("(x**2 + y**2/4 - 1.5e0)*(z - 3)^2 + x*y*z - 7"),
}
WORDS = """1e308 -1e308 1e-320 nan inf 99999999999999999999 -1 0 1e400 [ { " null true <g> </g> <use/> \0 \xff ** ( ) /0
2147483648 4294967295 element 100% em matrix(1 &#x0; , 1_0 2e9 0x1 1e-999 #a"""
PIECES = [word.encode("latin-1") for word in WORDS.split()]
PIECES += [b"\n", b" ", b"property list uchar int x\n", b"\\\n", b"9" * 400]
NUMBER = re.compile(rb"-?\d+\.?\d*(e-?\d+)?")


def mutated(content, chance):
    """The content with some bytes changed, pieces put in, left out, doubled or cut off."""
    made = bytearray(content)
    for _ in range(chance.choice([1, 1, 2, 3, 6])):
        kind, count = chance.random(), max(len(made), 1)
        at = chance.randrange(count)
        if kind < 0.25:
            made[at : at + 1] = bytes([chance.randrange(256)])
        elif kind < 0.5:
            made[at : at + chance.randrange(9)] = chance.choice(PIECES)
        elif kind < 0.6:
            del made[at : at + chance.randrange(1, 20)]
        elif kind < 0.7:
            start = chance.randrange(count)
            made[at:at] = made[start : start + chance.randrange(1, 60)]
        elif kind < 0.75:
            del made[at:]
        elif kind < 0.9:
            found = NUMBER.search(made, at)
            if found:
                made[found.start() : found.end()] = chance.choice(PIECES)
        else:
            made[at:at] = bytes(made[at : at + 5]) * chance.randrange(1, 500)
    return bytes(made)


def read(file, content):
    if file.name == "path":
        return jhd.io.parse_path(content.decode("latin-1"))
    if file.name == "polynomial":
        return jhd.ImplicitSurface.parse(content.decode("latin-1"), [-1] * 3, [1] * 3)
    file.write_bytes(content)
    return jhd.io.load_result(file) if file.name.startswith("r.") else jhd.io.load_shape(file)


def check_mutations(file, seeds):
    SAVED[file.name](file)
    right = file.read_bytes()
    read(file, right)
    refused = 0
    for seed in seeds:
        content = mutated(right, random.Random(seed))
        start = time.process_time()
        try:
            read(file, content)
        except (ValueError, TypeError, OSError) as error:
            told, refused = str(error).replace(str(file), file.name), refused + 1
            assert "\n" not in told and len(told) < 500, (seed, told)
        assert time.process_time() - start < 2, seed
    assert refused > len(seeds) / 4


@pytest.mark.parametrize("name", SAVED)
def test_a_few_mutations_of_every_kind_of_file_are_read_or_refused(name, tmp_path):
    check_mutations(tmp_path / name, range(30))


@pytest.mark.parametrize("count", swept([100, 400], 0, 1))
@pytest.mark.parametrize("name", SAVED)
def test_mutations_of_every_kind_of_file_are_read_or_refused(name, count, tmp_path):
    check_mutations(tmp_path / name, range(1_000, 1_000 + count))
