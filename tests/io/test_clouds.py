"""Points of text files and of NumPy's arrays are sets of points; what is none is refused with its line."""

from typing import Any

import numpy as np
import pytest

import jhd.io

ROWS = np.array([[0.1, 2.0, -3.0], [1e-3, 4.0, 5.5]])


def test_rows_of_text_and_arrays_are_points(tmp_path):
    text, array = tmp_path / "a.xyz", tmp_path / "a.npy"
    text.write_text("# x y z and a normal\n0.1 2 -3 0 0 1\n\n1e-3, 4, 5.5, 0, 1, 0  # last\n")
    np.save(array, ROWS)
    for file in (text, array):
        cloud: Any = jhd.io.load_shape(str(file))
        assert cloud.degree == 0
        np.testing.assert_array_equal(cloud.control_points[:, 0], ROWS)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.xyz", b"1 2 3\n1 two 3\n", "a.xyz:2.*two"),
        ("a.xyz", b"1 2 3\n1 2\n", "a.xyz:2.*2 numbers; the lines before have 3"),
        ("a.xyz", b"# nothing\n", "at least 1"),
        ("a.npy", b"nothing", "no array of numbers"),
        ("a.xyz", b"1 nan 3\n", "not finite"),
    ],
)
def test_what_holds_no_points_is_refused(tmp_path, name, content, message):
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(jhd.io.ParseError, match=message):
        jhd.io.load_points(file)
