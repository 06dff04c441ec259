"""Meshes in files: what is written is read back, other programs' variants are understood, errors name their place."""

import struct

import numpy as np
import pytest

from jhd._io.errors import ParseError
from jhd._io.meshes import load_mesh, save_mesh
from jhd._io.polygons import fans
from jhd._shapes.mesh import TriangleMesh

CORNER = np.array([[0.1, 0, 0], [1, 1 / 3, 0], [0, 1e-300, -2], [1e17, 0, 1]])
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
SQUARE = [[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
HEADER = "ply\nformat {} 1.0\ncomment by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
FACES = "element face 1\nproperty list uchar int vertex_index\nend_header\n"


def written(folder, name, content):
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


@pytest.mark.parametrize(
    ("name", "text"), [("a.obj", False), ("a.off", False), ("a.ply", False), ("a.PLY", True)], ids=str
)
def test_what_is_written_is_read_back_to_the_last_bit(tmp_path, name, text):
    mesh = TriangleMesh(CORNER, TETRAHEDRON)
    save_mesh(tmp_path / name, mesh, text=text)
    again = load_mesh(tmp_path / name)
    np.testing.assert_array_equal(again.vertices, CORNER)
    np.testing.assert_array_equal(again.triangles, TETRAHEDRON)


@pytest.mark.parametrize(("text", "kept"), [(True, np.float64), (False, np.float32)])
def test_stl_keeps_corners_and_equal_ones_become_one_vertex(tmp_path, text, kept):
    mesh = TriangleMesh([*CORNER, [5, 5, 5]], TETRAHEDRON)
    save_mesh(tmp_path / "a.stl", mesh, text=text)
    again = load_mesh(tmp_path / "a.stl")
    np.testing.assert_array_equal(again.corners, CORNER.astype(kept)[TETRAHEDRON])
    assert again.vertices.shape == (4, 3) and again.is_closed


def test_a_file_can_be_named_by_text_and_replaces_one_that_exists(tmp_path):
    file = written(tmp_path, "a.obj", "rubbish " * 1000)
    save_mesh(str(file), TriangleMesh(CORNER, TETRAHEDRON))
    assert load_mesh(str(file)).count == 4


def test_meshes_of_other_packages_are_written_too(tmp_path):
    for name, mesh in {"a.ply": TriangleMesh(CORNER, TETRAHEDRON).to_trimesh(), "b.ply": (CORNER, TETRAHEDRON)}.items():
        save_mesh(tmp_path / name, mesh)
        again = load_mesh(tmp_path / name)
        np.testing.assert_array_equal(again.vertices, CORNER)
        np.testing.assert_array_equal(again.triangles, TETRAHEDRON)


def test_polygons_become_fans():
    assert fans(np.arange(9), np.array([4, 5])).tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7], [4, 7, 8]]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", "# by\no\nv 0 0 0 1.0\nv 1 0 0\nv 1 1 0 1 0 1\nv 0 1 0\nvn 0 0 1\nvt 0\nf 1/1/1 2//1 3/1 4\nl 1 2"),
        ("a.obj", "v 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\nf -4 -3 \\\r\n  -2 \\\r\n -1\r\n"),
        ("a.obj", "f 1 2 3 4\nv 0 0 0\nv 1 0 0 # second\nv 1 1 0\nv 0 1 \\\n 0"),
        ("a.off", "OFF 4 1 0\n0 0 0\n1 0 0\n\n1 1 0\n# a comment\n0 1 0\n4 0 1 2 3 255 0 0\n"),
        ("a.off", "COFF\n4 1\n0 0 0 1 1 1 1\n1 0 0 1 1 1 1\n1 1 0 1 1 1 1\n0 1 0 1 1 1 1\n4 0 1 2 3"),
        ("a.ply", HEADER.format("ascii") + FACES + "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"),
    ],
    ids="slashes backwards faces_first one_line colors ply".split(),
)  # fmt: skip
def test_variants_of_one_square_are_understood(tmp_path, name, content):
    mesh = load_mesh(written(tmp_path, name, content))
    np.testing.assert_array_equal(mesh.vertices, SQUARE)
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize(("order", "name"), [("<", "little"), (">", "big")])
@pytest.mark.parametrize("even", [True, False])
def test_binary_ply_of_either_byte_order_and_other_elements_are_understood(tmp_path, order, name, even):
    header = (
        f"ply\r\nformat binary_{name}_endian 1.0\r\nelement other 2\r\nproperty list uint8 int16 data\r\n"
        "element vertex 4\r\nproperty uchar red\r\nproperty double x\r\nproperty float y\r\nproperty float z\r\n"
        f"element face {1 if even else 2}\r\nproperty float q\r\nproperty list uchar uint32 vertex_indices\r\n"
        "end_header\r\n"
    )
    content = header.encode() + struct.pack(order + "BhB", 1, 7, 0)
    content += b"".join(struct.pack(order + "Bdff", 9, *row) for row in SQUARE)
    content += struct.pack(order + "fB4I", 0.5, 4, 0, 1, 2, 3)
    content += b"" if even else struct.pack(order + "fB3I", 0.5, 3, 3, 2, 1)
    mesh = load_mesh(written(tmp_path, "a.ply", content))
    np.testing.assert_array_equal(mesh.vertices, SQUARE)
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3]] + ([] if even else [[3, 2, 1]])


@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_marks_and_comments_in_other_letters_leave_lines_what_they_are(tmp_path, mark, end):
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    # Byte 133, at which Python ends lines, is a part of two of these letters.
    comment = "# \u00c5 v 9 9 9 \u0445\x0c f 1 2 1\n# C:\\scans\\\n"
    rows = "".join("v {} {} {}\n".format(*row) for row in corners)
    mesh = load_mesh(written(tmp_path, "a.obj", f"{mark}{rows}{comment}f -3 -2 \\\n-1\n".replace("\n", end)))
    assert mesh.vertices.tolist() == corners and mesh.triangles.tolist() == [[0, 1, 2]]
    with pytest.raises(ParseError, match=r"a\.obj:6: needs a whole number"):
        load_mesh(written(tmp_path, "a.obj", f"{mark}{rows}{comment}f x\n".replace("\n", end)))
    assert load_mesh(written(tmp_path, "a.stl", (mark + FACET.format(1)).replace("\n", end))).count == 1
    header = HEADER.format("ascii").replace("ascii 1.0\n", "ascii 1.0\ncomment \u00c5 \u0445\n")
    content = (header + FACES + "0 0 0\n" * 4 + "3 0 1 2\n").replace("\n", end)
    assert load_mesh(written(tmp_path, "a.ply", content)).count == 1


L_SHAPE = [[0, 0, 0], [4, 0, 0], [4, 1, 0], [1, 1, 0], [1, 4, 0], [0, 4, 0]]
# A frame as one ring: the bridge between both rings is walked along twice. Its width is 1.
FRAME = [*SQUARE, SQUARE[0]] + [[0.25, 0.25, 0], [0.25, 0.75, 0], [0.75, 0.75, 0], [0.75, 0.25, 0], [0.25, 0.25, 0]]
# Straight corners, repeated ones, and one that goes back on its way.
SPIKED = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 0], [2, 2, 0], [2, 3, 0], [2, 2, 0], [0, 2, 0]]
# Corners, the area, and the unit of both.
POLYGONS = {"L": (L_SHAPE, 7, 1), "frame": (FRAME, 0.75, 1), "spiked": (SPIKED, 4, 1), "tiny": (L_SHAPE, 7, 2.0**-700)}


def as_text(kind, corners):
    rows, numbers = [" ".join(map(repr, map(float, row))) for row in corners], range(len(corners))
    if kind == "obj":
        return "\n".join([*(f"v {row}" for row in rows), "f " + " ".join(str(i + 1) for i in numbers)])
    face = f"{len(corners)} " + " ".join(map(str, numbers))
    start = f"OFF\n{len(corners)} 1 0" if kind == "off" else HEADER.format("ascii") + FACES.rstrip()
    start = start.replace("vertex 4", f"vertex {len(corners)}").replace("float", "double")
    return "\n".join([start, *rows, face])


@pytest.mark.parametrize("kind", ["obj", "off", "ply"])
@pytest.mark.parametrize("name", POLYGONS)
def test_polygons_are_read_as_what_they_bound(tmp_path, name, kind):
    corners, area, unit = POLYGONS[name]
    turn = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    for first in range(len(corners)):
        rows = unit * np.roll(np.asarray(corners, float), first, axis=0) @ turn
        mesh = load_mesh(written(tmp_path, f"a.{kind}", as_text(kind, rows)))
        assert mesh.count == len(rows) - 2
        # Nothing lies over another part: the areas add up; and nothing is left out or beyond: so do the signed ones.
        a, b, c = (np.asarray(mesh.corners)[:, k] / unit for k in range(3))
        doubled = np.cross(b - a, c - a) @ turn[2]
        assert np.abs(doubled).sum() == doubled.sum() == 2 * area


def stl(count, *rows):
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *np.ravel(row), 0) for row in rows)
    return b"solid by a program that says so".ljust(80) + struct.pack("<I", count) + body


def test_a_binary_stl_that_begins_as_a_text_is_read_with_and_without_a_tail(tmp_path):
    for tail in (b"", b"\0", b"\r\n", b"a tail of many bytes"):
        assert load_mesh(written(tmp_path, "a.stl", stl(1, SQUARE[:3]) + tail)).count == 1


FACET = (
    "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 {} 0\nendloop\nendfacet\nendsolid\n"
)
STAR = [[np.cos(0.8 * np.pi * k), np.sin(0.8 * np.pi * k), 0] for k in range(5)]
COMB = [[k, k % 2, 0] for k in range(1000)] + [[1000, -1, 0], [0, -1, 0]]
NAN = [[0, 0, 0], [1, 0, 0], [0, np.nan, 0]]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.xyz", "", r"a\.xyz: the suffix is '\.xyz'; a mesh is a file \.obj"),
        ("a.obj", "", r"a\.obj: holds no vertices"),
        ("a.obj", "v 0 0 0", "holds no faces"),
        ("a.obj", "v 0 0 0\nv 1 x 0", r"a\.obj:2: needs a number; found 'x'"),
        ("a.obj", "v 0 0\nf 1 1 1", r"a\.obj:1: a vertex has 2 coordinates; needs 3"),
        ("a.obj", "v 0 0 0\nv 0 nan 0\nf 1 2 1", r"a\.obj:2: the vertex \(0, nan, 0\) is not finite"),
        ("a.obj", "v 0 0 0\nf 1 1 2", r"a\.obj:2: a face names vertex 2, counted from 1; there are 1"),
        ("a.obj", "v 0 0 0\nf 1 1 0", r"a\.obj:2: a face names vertex 0; needs 1 to 1, or -1 to -1"),
        ("a.obj", "v 0 0 0\nf 1 1 -2", r"a\.obj:2: a face names vertex -2"),
        ("a.obj", "v 0 0 0\n\nf 1 1", r"a\.obj:3: a face has 2 corners; needs at least 3"),
        ("a.obj", "v 0 0 0\nf 1 1.5 1", r"a\.obj:2: needs a whole number; found '1\.5'"),
        ("a.obj", "v 0 0 0\nf 1 1 1\nsurf 0 1 0 1 1\n", r"a\.obj:3: holds 'surf', which is not read; needs faces, 'f'"),
        ("a.obj", as_text("obj", np.roll(SQUARE, 1, 0)[[0, 2, 1, 3]]), r"a\.obj:5: a face of 4 corners crosses itself"),
        ("a.off", as_text("off", STAR), r"a\.off:8: a face of 5 corners crosses itself: cut it into triangles"),
        ("a.ply", as_text("ply", STAR), r"a\.ply:16: a face of 5 corners crosses itself"),
        ("a.obj", as_text("obj", COMB), r"a\.obj:1003: a face of 1002 corners is not convex and has more than 1000"),
        ("a.off", "", r"a\.off:1: needs OFF and text in its first line; found ''"),
        ("a.off", "OFF BINARY\n", "needs OFF and text"),
        ("a.off", "OFF\nx 1 0", r"a\.off:2: needs a whole number; found 'x'"),
        ("a.off", "OFF\n2", "needs the numbers of vertices"),
        ("a.off", "OFF\n2 1 0\n0 0 0\n", r"a\.off:3: ends after 1 of 2 vertices"),
        ("a.off", "OFF\n1 1 0\n0 0 0\n3 0 0\n", r"a\.off:4: announces 3 corners; the line has 2 numbers"),
        ("a.off", "OFF\n1 2 0\n0 0 0\n3 0 0 0\n", r"a\.off:4: ends after 1 of 2 faces"),
        ("a.off", "OFF\n1 1 0\n0 0 0\n3 0 0 -1\n", r"a\.off:4: a face names vertex -1"),
        ("a.stl", b"", r"a\.stl: byte 0: ends within the header of 84 bytes"),
        ("a.stl", b"x" + stl(2, SQUARE[:3])[1:], r"a\.stl: byte 134: ends after 1 of 2 triangles"),
        ("a.stl", stl(2, SQUARE[:3]), r"a\.stl: byte 134: ends after 1 of 2 triangles"),
        ("a.stl", stl(2, SQUARE[:3], NAN), r"a\.stl: byte 134: the vertex \(0, nan, 0\) is not finite"),
        ("a.stl", stl(1, SQUARE[:3], SQUARE[1:]), "byte 134: 1 triangles are announced, and 1 more follow"),
        ("a.stl", FACET.format("1 0"), r"a\.stl:6: a vertex has 4 coordinates; needs 3"),
        ("a.stl", FACET.format("x"), r"a\.stl:6: needs a number; found 'x'"),
        ("a.stl", FACET.format("inf"), r"a\.stl:6: the vertex \(0, inf, 0\) is not finite"),
        ("a.stl", FACET.format("1 0\nvertx"), r"a\.stl:7: needs facet, outer, vertex or their ends; found 'vertx'"),
        ("a.stl", FACET.replace("vertex 1 0 0\n", "").format(1), r"a\.stl:2: a face has 2 corners"),
        ("a.stl", "solid\nendsolid\n", "holds no vertices"),
        ("a.ply", "plx", r"a\.ply:1: is not a PLY file"),
        ("a.ply", "ply\nformat ascii 2\nelement vertex x\nend_header\n", r"a\.ply:3: cannot read 'element vertex x'"),
        ("a.ply", "ply\nformat utf 1.0\nend_header\n", r"a\.ply:2: needs a format of ascii"),
        ("a.ply", "ply\nend_header\n", "has no line 'format'"),
        ("a.ply", HEADER.format("ascii") + "end_header\n" + "0 0 0\n" * 4, "holds no faces"),
        ("a.ply", HEADER.format("ascii").replace("float y", "float x") + "end_header\n", "two properties of one name"),
        ("a.ply", HEADER.format("ascii").replace("float z", "half z") + FACES, r"a\.ply:7: cannot read the property"),
        ("a.ply", HEADER.format("ascii").replace("float z", "float w") + FACES, "vertices have no property 'z'"),
        ("a.ply", HEADER.format("ascii") + FACES.replace("vertex_index", "strips"), "no list of whole numbers"),
        ("a.ply", HEADER.format("ascii") + FACES + "0 0 0\n", "ends after 1 of 4 rows of 'vertex'"),
        ("a.ply", HEADER.format("ascii") + FACES + "0 0\n", r"a\.ply:11: has 2 numbers; 'vertex' has 3 properties"),
        ("a.ply", HEADER.format("ascii") + FACES + "0 0 0\n" * 4 + "4 0 1 2", r"a\.ply:15: ends within 'vertex_index'"),
        ("a.ply", HEADER.format("ascii") + FACES + "0 0 0\n" * 4 + "3 0 1 4", r"a\.ply:15: a face names vertex 4"),
        ("a.ply", HEADER.format("ascii") + FACES.replace("face", "tristrips") + "0 0 0\n" * 4, "holds 'tristrips'"),
        (
            "a.ply",
            (HEADER.format("binary_big_endian") + FACES).encode() + bytes(49),
            r"a\.ply: byte \d+: a face has 0 corners; needs at least 3",
        ),
        ("a.ply", (HEADER.format("binary_little_endian") + FACES).encode() + bytes(30), "ends after 2 of 4 rows"),
        (
            "a.ply",
            (HEADER.format("binary_little_endian") + FACES).encode() + bytes(48) + b"\x03" + bytes(8),
            "ends after 0 of 1 rows of 'face'",
        ),
        (
            "a.ply",
            (HEADER.format("binary_little_endian") + FACES).encode() + bytes(48) + b"\x03" + bytes(12) + b"xy",
            "2 bytes follow the last element",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_in_one_line_with_its_place(tmp_path, name, content, message):
    with pytest.raises(ParseError, match=message) as caught:
        load_mesh(written(tmp_path, name, content))
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.obj: no such file"):
        load_mesh(tmp_path / "none.obj")


def test_what_cannot_be_written_is_refused(tmp_path, as_a_user):
    mesh = TriangleMesh(CORNER * 1e30, TETRAHEDRON)
    with pytest.raises(ValueError, match=r"the suffix of .* is '\.xyz'; a mesh is a file"):
        save_mesh(tmp_path / "a.xyz", mesh)
    with pytest.raises(ValueError, match=r"a coordinate is 1e\+47; a binary STL file holds at most 3\.4"):
        save_mesh(tmp_path / "a.stl", mesh)
    with pytest.raises(TypeError, match="mesh must be a TriangleMesh"):
        save_mesh(tmp_path / "a.stl", SQUARE)  # pyright: ignore[reportArgumentType]
    assert not list(tmp_path.iterdir())
