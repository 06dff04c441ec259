"""Files made to be misread, to take for ever or all memory: one line of refusal at once, or the right shape."""

import ast
import io
import json
import resource
import struct
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from fontTools.ttLib import newTable

import jhd
import jhd.io
from jhd._runtime.archives import read_arrays
from tests.io.scenes import glb, gltf, package, zipped

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
OFF = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n"
PLY = (
    "ply\nformat {} 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list {} int vertex_indices\nend_header\n"
)
ROWS = "0 0 0\n1 0 0\n0 1 0\n"
TEXT_PLY = PLY.format("ascii", "uchar") + ROWS
CLOUD = "ply\nformat binary_little_endian 1.0\n{}element vertex {}\n" + "".join(f"property float {x}\n" for x in "xyz")
HUGE = "1" + "0" * 20


def svg(content, start=""):
    names = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    return f"{start}<svg {names}>{content}</svg>"


def doubled(times):
    """Two uses of two uses of ...: 2^times drawings of one path."""
    groups = "".join(f'<g id="a{k + 1}"><use xlink:href="#a{k}"/><use xlink:href="#a{k}"/></g>' for k in range(times))
    return svg(f'<defs><g id="a0"><path d="M0 0L1 1"/></g>{groups}</defs><use xlink:href="#a{times}"/>')


def crowd(uses, paths):
    drawn = '<path d="M0 0L1 1"/>' * paths
    return svg(f'<defs><g id="a">{drawn}</g></defs>' + '<use xlink:href="#a"/>' * uses)


def member(shape, dtype="<f8", size=0):
    """An array in a file that says more of itself than it is."""
    header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00v\x00" + header + bytes(size)


def nested(times, inner=None):
    """Objects of two objects of two objects of ...; or objects that contain another one."""
    pair = "<component objectid='{}'/>" * 2
    return "".join(
        f'<object id="{k}"><components>{pair.replace("{}", inner or str(k - 1))}</components></object>'
        for k in range(1, times + 1)
    )


REFUSED = {
    "a.obj": (CORNERS + f"f 1 2 {HUGE}\n", "a.obj:4: a whole number is too large"),
    "b.obj": (CORNERS.replace("1", "1_0") + "f 1 2 3\n", "b.obj:2: needs a number; found '1_0'"),
    "c.obj": (CORNERS + "f 1 2 0_3\n", "c.obj:4: needs a whole number; found '0_3'"),
    "a.off": (OFF + f"3 0 1 {HUGE}\n", "a.off:6: a whole number is too large"),
    "b.off": (OFF + "3 0 1 2\n3 0 1 2\n", "b.off:7: a row follows 3 vertices and 1 faces"),
    "c.off": (OFF.replace("3 1", "3000000000 1", 1), "ends after 3 of 3000000000 vertices"),
    "a.ply": (TEXT_PLY + f"3 0 1 {HUGE}\n", "a.ply:13: a whole number is too large"),
    "b.ply": (TEXT_PLY + "3 0 1 2\n3 0 1 2\n", "b.ply:14: a row follows the last element"),
    "c.ply": (TEXT_PLY + "3 0 1 2 9\n", "c.ply:13: has 2 numbers; 'face' has 1 properties"),
    "d.ply": (PLY.format("ascii", "float") + ROWS + "3e300 0 1 2\n", "has a length that is not an integer"),
    "e.ply": (CLOUD.format("element none 2000000000\n", 1) + "end_header\n" + "\0" * 12, "000 rows of no property"),
    "f.ply": (CLOUD.format("", 2_000_000_000) + "end_header\n" + "\0" * 12, "ends after 1 of 2000000000 rows"),
    "g.ply": (CLOUD.format("", 1) + "element vertex 1\nproperty float x\nend_header\n", "g.ply: .*'vertex'"),
    "h.ply": (CLOUD.format("", 1) + "end_header\n" + "a" * 24, "12 bytes follow the last element"),
    "j.ply": (
        "ply\nformat ascii 1.0\n" + "".join(f"element e{k} 0\n" for k in range(50_000)) + "end_header\n",
        "j.ply: has no element 'vertex'",
    ),
    "a.stl": ("solid a\nfacet\n" + CORNERS.replace("v ", "vertex ") + "endfacet\n", "a.stl:6: ends without 'endsolid'"),
    "a.json": (
        json.dumps({"type": "BezierSegments", "control_points": [[[0, 0], [1, 1]]], "next_segment": [10**20]}),
        "a.json: .*too large",
    ),
    "b.json": ('{"type": "BezierCurve", "type": 1, "control_points": [[0, 0], [1, 1]]}', "'type' occurs twice"),
    "c.json": ('{"type": "BezierCurve", "control_points": [[true, 0], [1, 1]]}', "control_points holds true or false"),
    "d.json": ('{"type": "BezierCurve", "control_points": ' + "[" * 100_000, "d.json: JSON: .*recursion"),
    "e.json": ('{"type": "BezierCurve", "control_points": [[' + "9" * 5_000 + ", 0], [1, 1]]}", "JSON: .*digits"),
    "a.svg": (svg("<g>" * 1_000 + "</g>" * 1_000), "a.svg:1:.*inside 200 other elements"),
    "b.svg": (svg("<g>" * 100_000 + "</g>" * 100_000), "b.svg:1:.*inside 200 other elements"),
    "c.svg": (svg('<path d="M0 0L1 1"/>', '<?xml version="1.0" encoding="none-8"?>'), "unknown encoding: none-8"),
    "d.svg": (doubled(30), "is inside 8 uses of uses"),
    "f.svg": (svg('<rect width="' + "1" * 60_000 + 'x" height="1"/>'), r"^.{10,300}$"),
    "g.svg": (svg('<path transform="' + "scale(2)" * 2_000 + '" d="M0 0L1 1"/>'), "beyond the range of doubles"),
    "h.svg": (svg('<path d="M0 0A1e308 1e-20 0 0 1 1 1"/>'), "beyond the range of doubles"),
    "i.svg": (svg('<path transform="matrix(1e308 1e308 1e308 1e308 0 0)" d="M0 0L1 1e5"/>'), "beyond the range"),
    "l.svg": (svg('<circle r="' + "1" * 60_000 + '!"/>'), "has r '111.*needs a number"),
    "m.svg": (svg('<path d="M0 0A1e308 1e308 0 1 1 1e-20 0"/>'), "beyond the range of doubles"),
    "n.svg": (
        svg('<path d="M0 0&f;"/>', '<!DOCTYPE svg [<!ENTITY a "l1 1">' + "".join(
            f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcde", "bcdef", strict=True)
        ) + "]>"),
        "n.svg:1:.*<path> grows the file to more than 10 times its length, by entities",
    ),
    "o.svg": (svg("<path/>" * 20_000, '<!DOCTYPE svg [<!ATTLIST path d CDATA "M0 0' + "l1 1" * 100 + '">]>'), "grows"),
    "j.svg": (svg('<rect width="1e200%" height="1"/>'), "percentages need a viewBox"),
    "a.xyz": ("1_0 2 3\n", "a.xyz:1: needs numbers; found '1_0 2 3'"),
    "b.xyz": ("\u0663 2 3\n".encode().decode("latin-1"), "b.xyz:1: needs numbers"),
    "b.stl": ("\0" * 80 + "\1\0\0\0" + "\0" * 12 + "\0\0\xa0\x7f" * 9 + "\0\0", r"b.stl: .* is not finite"),
    "i.ply": (CLOUD.format("", 1) + "end_header\n" + "\0\0\xa0\x7f" * 3, r"i.ply: .*is not finite"),
    "a.csv": ("1_0,2\n", "a.csv:1: needs numbers; found '1_0 2'"),
    "b.csv": ("1" * 5_000 + "x,2\n", "b.csv:1: needs numbers; found '111"),
    "a.txt": ("\u0663 2 3\n".encode().decode("latin-1"), "a.txt:1: needs numbers"),
    "b.txt": ("1 2\n" * 10_000 + "0,5 2\n", "b.txt:10001: has commas next to blanks"),
    "a.glb": (glb()[:-60], "a.glb: byte .*: a chunk of .* bytes ends beyond the file"),
    "b.glb": (b"glTF" + struct.pack("<II", 1, 12), "b.glb: glTF: the version is 1; needs 2"),
    "c.glb": (b"glTF" + struct.pack("<II", 2, 12), "c.glb: glTF: has no JSON chunk"),
    "d.glb": (glb({("accessors", 0, "count"): 10**18}), r"accessors\[0\] does not fit its bufferView"),
    "e.glb": (glb({("bufferViews", 1, "byteLength"): 10**9}), "ends beyond its buffer of 72 bytes"),
    "f.glb": (glb({("nodes", 0, "mesh"): -1}), r"names meshes\[-1\]; there are 1"),
    "a.gltf": ("[" * 100_000, "a.gltf: glTF: .*recursion"),
    "b.gltf": (gltf({("asset",): None}), "b.gltf: glTF: the key 'asset' is missing"),
    "c.gltf": (gltf(nodes=[{"children": [1, 1]}, {"mesh": 0}]), r"nodes\[1\] has two parents"),
    "d.gltf": (gltf(nodes=[{"children": [1]}, {"children": [0]}]), r"nodes\[0\] has two parents"),
    "e.gltf": (gltf({("buffers", 0, "uri"): "../../etc/passwd"}), "needs a file next to this one"),
    "f.gltf": (gltf({("buffers", 0, "uri"): "/dev/zero"}), "needs a file next to this one"),
    "g.gltf": (gltf({("buffers", 0, "uri"): "https://a.org/b.bin"}), "needs a file next to this one"),
    "h.gltf": (gltf({("buffers", 0, "uri"): "data:;base64,!"}), "h.gltf: glTF: "),
    "i.gltf": (gltf({("accessors", 0, "sparse"): {"count": 1}}), r"accessors\[0\] is sparse"),
    "j.gltf": (gltf({("accessors", 0, "bufferView"): None}), r"accessors\[0\] is .*without data"),
    "k.gltf": (gltf(extensionsRequired=["KHR_draco_mesh_compression"]), "needs the extension 'KHR_draco"),
    "l.gltf": (gltf({("nodes", 0, "skin"): 0}), "has a skin, morph weights or instances"),
    "s.gltf": (gltf({("nodes", 0, "extensions"): {"EXT_mesh_gpu_instancing": {}}}), "has a skin, .* or instances"),
    "m.gltf": (gltf({("nodes", 0, "scale"): [1e308, 1, 1]}, nodes=[{"mesh": 0, "matrix": [1e308] * 16}]), "not finite"),
    "n.gltf": (gltf({("accessors", 0, "count"): 3}), "a triangle names vertex 3, counted from 0; there are 3"),
    "o.gltf": (gltf(scenes=[{"nodes": []}]), "o.gltf: holds no triangles"),
    "p.gltf": (gltf({("asset", "version"): "1.0"}), "the version is '1.0'; needs 2.0"),
    "q.gltf": (gltf({("bufferViews", 0, "byteStride"): -4}), "does not fit its bufferView"),
    "r.gltf": (gltf({("nodes", 0, "matrix"): [1, 2]}), "r.gltf: glTF: "),
    "a.3mf": ("PK\3\4 and nothing more", "a.3mf: 3MF: "),
    "b.3mf": (zipped({"a": "b"}), "b.3mf: 3MF: the package has no part '3D/3dmodel.model'"),
    "c.3mf": (package(items='<item objectid="2"/>'), "the object '2' in '3D/3dmodel.model' is not there"),
    "d.3mf": (package(nested(1, "1"), '<item objectid="1"/>'), "contains itself, or too many levels"),
    "e.3mf": (package('<object id="0">MESH</object>' + nested(40), '<item objectid="40"/>'), "has more than .* parts"),
    "f.3mf": (package('<object id="1"><mesh><vertices><vertex x="1_0" y="0" z="0"/></vertices></mesh></object>'),
        "line 1: needs a number; found '1_0'"),
    "g.3mf": (package('<object id="1"><mesh><triangle v1="0" v2="-1" v3="0"/></mesh></object>'), "needs a whole n"),
    "h.3mf": (package('<object id="1"><mesh><triangle v1="0" v2="1"/></mesh></object>'), "attribute 'v3' is missing"),
    "i.3mf": (package("<object>"), "i.3mf: 3MF: .*line 1"),
    "j.3mf": (zipped({"3D/3dmodel.model": '<!DOCTYPE a [<!ENTITY b "c">]><model>&b;</model>'}), "entities are not"),
    "k.3mf": (package(items='<item objectid="1" transform="1 2 3"/>'), "k.3mf: 3MF: .*line 1"),
    "l.3mf": (package(items=""), "l.3mf: holds no triangles"),
    "m.3mf": (package(items='<item objectid="1" transform="1e999 0 0 0 1 0 0 0 1 0 0 0"/>'), "not finite"),
    "n.3mf": (zipped({"3D/3dmodel.model": " " * (1 << 27)}), "would take 134217728 bytes in memory"),
    "p.3mf": (package(unit='xmlns:b="http://a/beamlattice/2017/02" requiredextensions="b"'), "extension 'http://a/beam"),
    "o.3mf": (package('<object id="1"><vertex x="0" y="0" z="0"/><triangle v1="0" v2="0" v3="7"/></object>'),
        "names vertex 7, counted from 0; there are 1"),
    "a.wkt": ("GEOMETRYCOLLECTION(" * 100_000, "a.wkt:1: brackets are nested deeper than 100"),
    "b.wkt": ("POINT (1 2)\nPOINT (1 x)\n", "b.wkt:2: .*Expected number"),
    "c.wkt": ("POINT (1e999 2)", "c.wkt: .*not finite"),
    "d.wkt": ("CIRCULARSTRING (0 0, 1 1, 2 0)", "d.wkt:1: .*[Nn]onlinear|d.wkt: .*CircularString"),
    "e.wkt": ("POINT EMPTY\n", "e.wkt: geometry is empty"),
    "f.wkt": ("POINT (1 2))\n", "f.wkt:1: a bracket closes nothing"),
    "g.wkt": ("\n # none\n" * 2, "g.wkt:2: "),
    "h.wkt": ("POINT (1 2" + "\n" * 100_000, "h.wkt:1: "),
    "a.geojson": ("[" * 100_000, "a.geojson: JSON: .*recursion"),
    "b.geojson": ('{"type": "Point", "coordinates": [NaN, 1]}', "b.geojson: "),
    "c.geojson": ('{"type": "Point", "type": "Point", "coordinates": [1, 1]}', "'type' occurs twice"),
    "d.geojson": ('{"type": "FeatureCollection", "features": [1]}', "d.geojson: 'features' is missing"),
    "e.geojson": ('{"type": "Feature", "geometry": null}', "e.geojson: holds no geometry"),
    "f.geojson": ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [0, 1]]]}', "f.geojson: .*closed"),
    "g.geojson": ('{"type": "Topology"}', "g.geojson: "),
    "h.geojson": ('{"type": "Point",\n "coordinates": [1, 2', "h.geojson:2:22: JSON: "),
    "i.geojson": ('{"type": "GeometryCollection", "geometries": [' * 300 + "]}" * 300, "i.geojson: "),
    "a.npy": (member("(1, 3)", "<f4", 0) + b"\0\0\xa0\x7f" * 3, r"a.npy: points\[0\] is not finite"),
    "b.npy": (member("(2,)", "|O", 16), "b.npy: not an array of numbers: .*Python objects"),
    "c.npy": (member("(9999999999999, 3)"), "c.npy: not an array of numbers: .*file size"),
    "k.svg": (
        svg('<desc>&i;</desc><path d="M0 0L1 1"/>', '<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa">' + "".join(
            f'<!ENTITY {chr(98 + k)} "{("&" + chr(97 + k) + ";") * 10}">' for k in range(8)
        ) + "]>"),
        "amplification",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_made_to_be_misread_is_refused_in_one_line_at_once(name, tmp_path, as_a_user):
    content, message = REFUSED[name]
    file = tmp_path / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    start = time.process_time()
    with pytest.raises(jhd.io.ParseError, match=message) as caught:
        jhd.io.load_shape(file)
    assert time.process_time() - start < 2
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400 + len(str(file))


def test_lines_that_go_on_are_joined_in_linear_time(tmp_path):
    file = tmp_path / "a.obj"
    file.write_bytes((CORNERS + "f 1 2 " + "\\\n" * 200_000 + "3\nf 3 2 1\n").encode())
    start = time.process_time()
    assert jhd.io.load_mesh(file).triangles.tolist() == [[0, 1, 2], [2, 1, 0]]
    assert time.process_time() - start < 2


def test_display_none_is_heeded_in_capitals(tmp_path):
    file = tmp_path / "a.svg"
    hidden = '<path style="DISPLAY : NONE" d="M0 0L1 1"/><path display="None" d="M0 0L3 1"/>'
    file.write_text(svg(hidden + '<path d="M0 0L2 2"/>'))
    assert jhd.io.load_svg(file).count == 1


def test_a_small_symbol_may_be_used_often(tmp_path):
    file = tmp_path / "a.svg"
    file.write_text(crowd(300, 3))
    assert jhd.io.load_svg(file).count == 900


def test_what_is_drawn_far_beyond_the_file_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("jhd._io.svg_document._ALWAYS_DRAWN", 100)
    file = tmp_path / "a.svg"
    file.write_text(crowd(20, 20))
    assert jhd.io.load_svg(file).count == 400
    file.write_text(crowd(40, 40))
    with pytest.raises(jhd.io.ParseError, match="is drawn after too many others"):
        jhd.io.load_shape(file)


def test_numbers_at_the_end_of_the_range_are_drawn():
    assert jhd.io.parse_path("M0 0L1.7e308 1.7e308Z").count == 2
    with pytest.raises(jhd.io.ParseError, match="needs a command"):
        jhd.io.parse_path("M0 0 \u017f 1 1 1 1")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x**1e000000000999999999", "outside the range"),
        ("x**" + "0" * 100_000 + "2", "outside the range"),
        ("x*1e-000000000999999999", "outside the range"),
        ("*".join(["(x + y + z + 1)"] * 40), "the degree is 33"),
        ("(" * 5_000 + "x" + ")" * 5_000, "nested deeper"),
        ("((((2**32)**32)**32)**32)*x", "bits"),
        ("x**" + "9" * 300, "the exponent is a number of very many digits"),
        ("x**1e400", "the exponent is a number of very many digits"),
        ("x**\u0663", "needs a number"),
        ("9e400", "above the largest double"),
    ],
)
def test_polynomials_that_would_take_for_ever_are_refused(text, message):
    start = time.process_time()
    with pytest.raises(ValueError, match=message) as caught:
        jhd.ImplicitSurface.parse(text, [-1] * 3, [1] * 3)
    assert time.process_time() - start < 2 and len(str(caught.value)) < 300


def archive(**members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(name + ".npy", content)
    return stream.getvalue()


@pytest.mark.parametrize(
    "text", ["+".join(["(x+y+1)**4*(x+z-1)**4"] * 90), "(x+y+z+1)**9" + "/3" * 400, "-".join(["(-(-(x+y+z)**9))"] * 90)]
)
def test_products_of_sums_have_a_budget(text, monkeypatch):
    monkeypatch.setattr("jhd._shapes.polynomial_text._MOST_PRODUCTS", 10_000)
    assert jhd.ImplicitSurface.parse("+".join(["(x+y+1)**4"] * 90), [-1] * 3, [1] * 3).degree == 1
    with pytest.raises(ValueError, match="too many terms for a text of this length") as caught:
        jhd.ImplicitSurface.parse(text, [-1] * 3, [1] * 3)
    assert len(str(caught.value)) < 300


FIELD = member("()", "<U25", 100)


def packed_by(method):
    """An archive that says of its member to be packed by another method."""
    content = archive(format=FIELD)
    for signature, at in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        start = content.index(signature) + at
        content = content[:start] + struct.pack("<H", method) + content[start + 2 :]
    return content


@pytest.mark.parametrize(
    "content",
    [
        b"", b"PK\x03\x04 and nothing more", b"none", archive(format=FIELD)[:-20], archive(format=FIELD)[40:],
        archive(format=b"none"), archive(other=FIELD), archive(format=member("(99999999999999,)")),
        archive(format=member("(-1,)")), archive(format=member("()", "|O", 8)), archive(format=member("(2,)", size=24)),
        archive(format=member("(99999, 99999, 99999, 99999, 99999)")), archive(format=member("()", "<U25", 96)),
        packed_by(99), packed_by(12),
    ],
)  # fmt: skip
def test_archives_that_are_none_are_refused(content, tmp_path):
    file = tmp_path / "a.npz"
    file.write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.npz: ") as caught:
        jhd.AdaptiveDistanceField.load(file)
    assert "\n" not in str(caught.value)
    with pytest.raises(jhd.io.ParseError, match=r"a\.npz: "):
        jhd.io.load_result(file)


def test_an_archive_with_objects_of_python_says_so(tmp_path):
    file = tmp_path / "a.npz"
    file.write_bytes(archive(format=member("()", "|O", 8)))
    with pytest.raises(ValueError, match="format.npy holds objects of Python, which are not read"):
        read_arrays(file, ["format"])


def test_an_archive_that_would_fill_the_memory_is_refused_before_it_is_read(tmp_path):
    file = tmp_path / "bomb.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as stream:
        with stream.open("a.npy", "w", force_zip64=True) as part:
            part.write(member("(25165824,)"))
            for _ in range(24):
                part.write(bytes(1 << 23))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match="would take 201326720 bytes in memory, from a file of"):
        read_arrays(file)
    unit = 1 if sys.platform == "darwin" else 1024
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * unit < 1 << 26


def test_archives_are_read_as_numpy_reads_them(tmp_path):
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.array("text"),
        "c": np.asfortranarray(np.eye(3, 4)),
        "d": np.array([]),
    }
    for write in (np.savez, np.savez_compressed):
        write(tmp_path / "a.npz", **arrays)
        found = read_arrays(tmp_path / "a.npz")
        assert list(found) == list(arrays)
        for name, array in arrays.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array)
    assert list(read_arrays(tmp_path / "a.npz", ["c"])) == ["c"]
    with pytest.raises(ValueError, match="has no 'e'"):
        read_arrays(tmp_path / "a.npz", ["a", "e"])


def font(folder, letters):
    """A font whose letter a is the last of these lists: corners of a contour, or names of the parts it is made of."""
    names = [".notdef", *letters]
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder(names)
    builder.setupCharacterMap({ord("a"): names[-1]})
    glyphs = {".notdef": TTGlyphPen(None).glyph()}
    for name, content in letters.items():
        pen = TTGlyphPen(dict.fromkeys(names))
        if isinstance(content[0], str):
            for part in content:
                pen.addComponent(part, (1, 0, 0, 1, 0, 0))
        else:
            pen.moveTo(content[0])
            for corner in content[1:]:
                pen.lineTo(corner)
            pen.closePath()
        glyphs[name] = pen.glyph()
    for glyph in glyphs.values():
        glyph.xMin = glyph.yMin = glyph.xMax = glyph.yMax = 0
    table: Any = newTable("glyf")
    table.glyphs, table.glyphOrder = glyphs, names
    builder.font["glyf"], builder.font["loca"] = table, newTable("loca")
    builder.setupHorizontalMetrics(dict.fromkeys(names, (600, 0)))
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    # Bounds and counts of what is made of parts would take as long as drawing it.
    builder.font.recalcBBoxes = False
    counts: Any = builder.font["maxp"]
    counts.recalc = lambda _: None
    builder.save(folder / "a.ttf")
    return folder / "a.ttf"


TRIANGLE = [(0, 0), (0, 500), (500, 0)]


def test_a_letter_of_parts_is_drawn_and_one_of_very_many_is_refused_at_once(tmp_path):
    assert jhd.io.load_glyph(font(tmp_path, {"b0": TRIANGLE, "b1": ["b0", "b0"]}), "a").count == 6
    doubling = {f"b{k + 1}": [f"b{k}"] * 2 for k in range(40)}
    for first in ({"b0": TRIANGLE}, {"b0": ["none"]}):
        file = font(tmp_path, {"none": TRIANGLE[:1], **first, **doubling})
        start = time.process_time()
        with pytest.raises(jhd.io.ParseError, match="a.ttf: a letter has more than 1000 parts"):
            jhd.io.load_glyph(file, "a")
        assert time.process_time() - start < 2 and file.stat().st_size < 4_000


def test_a_letter_of_very_many_points_is_refused(tmp_path):
    wide = font(tmp_path, {"b0": [(k % 2, 0) for k in range(700)], "b1": ["b0"] * 99})
    with pytest.raises(jhd.io.ParseError, match="a.ttf: a letter has more than 65536 pieces"):
        jhd.io.load_glyph(wide, "a")


@pytest.mark.parametrize("seed", range(8))
def test_damaged_fonts_are_refused_or_drawn(seed, tmp_path):
    random = np.random.default_rng(seed)
    content = bytearray(Path(matplotlib.get_data_path(), "fonts", "ttf", "cmtt10.ttf").read_bytes())
    for at in random.integers(0, 3_000, 40):
        content[at] = random.integers(256)
    file = tmp_path / "a.ttf"
    file.write_bytes(content if seed % 2 else content[: random.integers(len(content))])
    try:
        assert jhd.io.load_glyph(file, "a").count > 0
    except (jhd.io.ParseError, ValueError) as error:
        assert "\n" not in str(error)


# What runs or imports what it is handed, or reads objects of Python.
RUNNING = set("""
    eval exec compile __import__ globals setattr pickle marshal shelve dill joblib importlib runpy subprocess ctypes
    system popen import_module attrgetter methodcaller
""".split())  # fmt: skip
PACKAGE = Path(jhd.__file__).parent
READERS = [
    *PACKAGE.glob("_io/*.py"),
    # The checker runs without the package too: its command line loads its own modules from beside itself.
    *(path for path in PACKAGE.glob("_distance/certificate/verification/*.py") if path.name != "__main__.py"),
    *(PACKAGE / name for name in ("_runtime/archives.py", "_shapes/polynomial_text.py", "_fields/adaptive.py")),
]


@pytest.mark.parametrize("path", READERS, ids=lambda path: path.stem)
def test_readers_neither_import_nor_run_anything_and_read_no_objects(path):
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {node.id for node in nodes if isinstance(node, ast.Name)}
    names |= {node.attr for node in nodes if isinstance(node, ast.Attribute) and getattr(node.value, "id", "") != "re"}
    imported = [node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]
    modules = [alias.name for node in imported for alias in node.names] + [getattr(x, "module", "") for x in imported]
    assert not (names | {part for module in modules for part in (module or "").split(".")}) & RUNNING
    for call in (node for node in nodes if isinstance(node, ast.Call)):
        if ast.unparse(call.func) == "np.load":
            assert "allow_pickle=False" in ast.unparse(call)
