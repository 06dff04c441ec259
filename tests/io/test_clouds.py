"""Points of text files and of NumPy's arrays are sets of points; what is none is refused with its line."""

import io
from typing import Any

import numpy as np
import pytest

import jhd.io

PLY = b"ply\nformat ascii 1.0\nelement vertex 2\n"
PLY += b"property double x\nproperty double y\nproperty double z\nproperty double quality\n"
ROWS = np.array([[0.1, 2.0, -3.0], [1e-3, 4.0, 5.5]])


def npy_header(shape):
    stream = io.BytesIO()
    header: Any = {"descr": "<f8", "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue()


def test_rows_of_text_and_arrays_are_points(tmp_path):
    text, array = tmp_path / "a.xyz", tmp_path / "a.npy"
    text.write_text("# x y z and a normal\n0.1 2 -3 0 0 1\n\n1e-3, 4 ,5.5, 0, 1, 0, # last\n")
    np.save(array, ROWS)
    for file in (text, array):
        cloud: Any = jhd.io.load_shape(str(file))
        assert cloud.degree == 0
        np.testing.assert_array_equal(cloud.control_points[:, 0], ROWS)


@pytest.mark.parametrize(
    "content",
    [
        "1 2 3\n4 5 6\n",
        "1\t2\t3\n4\t5\t6",
        "1, 2,3\n\n4,5,6 # last\n",
        "1;2;3\r\n4; 5;6\r\n",
        "\ufeffx,y,z\n1,2,3\n4,5,6\n",
        "# survey\n//Z X Y R\n3 1 2 255\n6 4 5 0\n",
        'id;"X [mm]";"Y [mm]";"z";note\nA 1;"1";"2";"3";first\nB;4;5;6;\n',
    ],
)
@pytest.mark.parametrize("suffix", [".csv", ".txt", ".TXT"])
def test_tables_of_text_are_points(suffix, content, tmp_path):
    file = tmp_path / f"a{suffix}"
    file.write_bytes(content.encode())
    cloud: Any = jhd.io.load_shape(file)
    assert cloud.control_points[:, 0].tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    file.write_text("y,x\n1,2\n")
    assert jhd.io.load_points(file).control_points.tolist() == [[[2.0, 1.0]]]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"0,5;1,5\n", "a.csv:1: has commas next to semicolons: '0,5;1,5'"),
        ("a.csv", b"0,5 1,5\n", "a.csv:1: has blanks next to commas: '0,5 1,5'"),
        ("a.csv", b"x;y\n1;2\n0,5;1,5\n", "a.csv:3: has commas next to semicolons"),
        ("a.csv", b"1,5,2,5\n", r"a.csv:1: 4 columns; needs 2 or 3, or a first line that names"),
        ("a.csv", b"1\n2\n", r"a.csv:1: 1 columns; needs 2 or 3"),
        ("a.txt", b"1 2\n3,4\n", "a.txt:2: has commas next to blanks: '3,4'"),
        ("a.txt", b"1,2\n3 4\n", "a.txt:2: has blanks next to commas: '3 4'"),
        ("a.txt", b"1;2\n3,4\n", "a.txt:2: has commas next to semicolons: '3,4'"),
        ("a.csv", b"# x\n\n1,2\n1,2,3\n", "a.csv:4: 3 cells; the lines before have 2"),
        ("a.csv", b"1,2\n3,4,\n", "a.csv:2: 3 cells; the lines before have 2"),
        ("a.csv", b"1,2,\n", "a.csv:1: needs numbers; found '1 2 '"),
        ("a.csv", b"1,two\n", "a.csv:1: needs numbers; found '1 two'"),
        ("a.csv", b"x,y\n1,two\n", "a.csv:2: needs numbers; found '1 two'"),
        ("a.csv", b"0,1\n0.5,0.25\n", "a.csv:1: 0, 1, ... may be a point or the numbers of columns"),
        ("a.csv", b"lon,lat\n1,2\n", "a.csv:1: needs numbers, or names with x, y .and z. once; found 'lon lat'"),
        ("a.csv", b"x,y,x\n1,2,3\n", "a.csv:1: needs numbers, or names"),
        ("a.csv", b"x,z\n1,2\n", "a.csv:1: needs numbers, or names"),
        ("a.csv", b"x,y\n", "at least 1"),
        ("a.txt", b"", "at least 1"),
        ("a.txt", b"1 nan\n", "not finite"),
        ("a.txt", b"1 2 # \xe9\n", "a.txt: byte 6 is not UTF-8 text"),
        ("a.csv", b"x" * 100_000, r"a.csv:1: needs numbers, or names .*xxx"),
        ("a.xyz", b"1 2 3\n1 two 3\n", "a.xyz:2.*two"),
        ("a.xyz", b"1 2 3\n" + b"x" * 10_000, r"a.xyz:2: needs numbers; found 'xxx+\.\.\."),
        ("a.xyz", b"1 2 3\n1 2\n", "a.xyz:2.*2 numbers; the lines before have 3"),
        ("a.xyz", b"0,5 1,25 2,75\n", "a.xyz:1: needs numbers; found '0,5 1,25 2,75'"),
        ("a.xyz", b"0,5, 1,25, 2,75\n", "a.xyz:1: needs numbers"),
        ("a.xyz", b"1,2,3\n1,,3,4\n", "a.xyz:2: needs numbers; found '1,,3,4'"),
        ("a.xyz", b"1, , 3, 4\n", "a.xyz:1: needs numbers"),
        ("a.xyz", b"# nothing\n", "at least 1"),
        ("a.xyz", b"1 2 3 # \xe9\n", "a.xyz: byte 8 is not UTF-8 text"),
        ("a.xyz", "1 2 3 # \u2028 4 5\nx".encode(), "a.xyz:2: needs numbers; found 'x'"),
        ("a.npy", b"nothing", "not an array of numbers"),
        ("a.npy", npy_header((1, 3)) + bytes(24 + 5), r"byte \d+: 5 bytes follow the array"),
        ("a.npy", npy_header((10**12, 3)) + bytes(48), "not an array of numbers"),
        (
            "a.ply",
            PLY + b"element face 1\nproperty list uchar int vertex_index\nend_header\n",
            "ends after 0 of 2 rows",
        ),
        ("a.ply", PLY + b"end_header\n0.1 2 -3 9\n", "ends after 1 of 2 rows of 'vertex'"),
        ("a.ply", PLY.replace(b" 2\n", b" 999999999999\n") + b"end_header\n0 0 0 0\n", "after 1 of 999999999999 rows"),
        (
            "a.ply",
            PLY.replace(b" 2\n", b" " + b"9" * 5000 + b"\n") + b"end_header\n",
            "cannot read 'element vertex 999",
        ),
        ("a.ply", PLY.replace(b" z", b" w") + b"end_header\n", "no property 'z'"),
        ("a.xyz", b"1 nan 3\n", "not finite"),
    ],
)
def test_what_holds_no_points_is_refused(tmp_path, name, content, message):
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(jhd.io.ParseError, match=message) as caught:
        jhd.io.load_points(file)
    assert "\n" not in str(caught.value) and len(caught.value.reason) < 300


NO_FACES = b"element face 0\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize("faces", [b"", NO_FACES, NO_FACES + b"element edge 1\nproperty uchar vertex1\n"])
@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_a_ply_file_without_faces_is_a_point_cloud(tmp_path, order, faces):
    rows = np.column_stack([ROWS, [7, 8]])
    code = ">f8" if order.startswith("binary_big") else "<f8"
    content = b"0.1 2 -3 7\n0.001 4 5.5 8\n" if order == "ascii" else rows.astype(code).tobytes()
    if b"edge" in faces:
        content += b"0\n" if order == "ascii" else b"\0"
    file = tmp_path / "a.ply"
    file.write_bytes(PLY.replace(b"ascii", order.encode()) + faces + b"end_header\n" + content)
    for cloud in (jhd.io.load_points(file), jhd.io.load_shape(str(file))):
        shape: Any = cloud
        np.testing.assert_array_equal(shape.control_points[:, 0], ROWS)
    with pytest.raises(jhd.io.ParseError, match="holds no faces"):
        jhd.io.load_mesh(file)


def test_a_ply_file_with_faces_is_no_point_cloud(tmp_path):
    file = tmp_path / "a.ply"
    jhd.io.save_mesh(file, jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    assert isinstance(jhd.io.load_shape(str(file)), jhd.TriangleMesh)
    with pytest.raises(jhd.io.ParseError, match="holds 1 faces; load_mesh reads the mesh"):
        jhd.io.load_points(file)


def test_rows_of_no_property_are_refused_at_once(tmp_path):
    file = tmp_path / "a.ply"
    start = PLY.replace(b"ascii", b"binary_little_endian").replace(b"element", b"element none 999999999999\nelement", 1)
    file.write_bytes(start + b"end_header\n" + np.ones((2, 4)).tobytes())
    with pytest.raises(jhd.io.ParseError, match="'none' has 999999999999 rows of no property"):
        jhd.io.load_points(file)
