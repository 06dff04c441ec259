"""One text to one curve, and one line for every text that is none."""

from typing import Any

import numpy as np
import pytest

from jhd._io.described import save_curve
from jhd._io.errors import ParseError
from jhd._io.glyphs import load_glyph
from jhd._io.load import load_shape
from jhd._io.svg import save_svg
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.simple_curves import polyline


def segments(text):
    shape: Any = load_shape(text)
    return shape.segments()


def test_json_files_are_read(tmp_path):
    curve = BezierCurve([[0, 0], [1, 2], [2, 0]])
    save_curve(tmp_path / "M1.json", curve)
    again = load_shape(str(tmp_path / "M1.json"))
    assert isinstance(again, BezierCurve)
    np.testing.assert_array_equal(again.control_points, curve.control_points)


def test_svg_files_are_read_whatever_the_case_of_the_suffix(tmp_path):
    save_svg(tmp_path / "a.SVG", polyline([[0, 0], [1, 2]]))
    assert segments(str(tmp_path / "a.SVG")).count == 1


def test_letters_of_fonts_are_read():
    expected = load_glyph("DejaVu Sans", "a").control_points
    np.testing.assert_array_equal(segments("font:DejaVu Sans:a").control_points, expected)


@pytest.mark.parametrize("text", ["M0 0L1 1", " m.5-1 2 3", "M\n+1,2 3 4"])
def test_path_data_is_read(text):
    assert segments(text).count == 1


def test_a_name_that_looks_like_path_data_is_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_curve("M1.json", polyline([[0, 0], [1, 2]]))
    assert segments("M1.json").count == 1


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("none.json", FileNotFoundError, r"none\.json: no such file\.$"),
        ("none.svg", FileNotFoundError, r"none\.svg: no such file\.$"),
        (
            "none.dat",
            FileNotFoundError,
            r"none\.dat: no such file; a curve is a \.json, \.svg, \.igs, ",
        ),
        ("nothing", FileNotFoundError, "nothing: no such file; a curve is"),
        ("", FileNotFoundError, ": no such file; a curve is"),
        ("Mary", FileNotFoundError, "Mary: no such file"),
        ("x" * 5000, FileNotFoundError, "no such file"),
        ("M0 0 L1", ParseError, "^line 1, column 8: path data: needs a number; found the end"),
        ("M0 0", ParseError, "path data: draws nothing"),
        ("font:DejaVu Sans", ParseError, "needs font:NAME:LETTER"),
        ("font:Nowhere:a", ValueError, "'Nowhere' is not a font known to matplotlib"),
    ],
)
def test_other_texts_are_refused_in_one_line(tmp_path, monkeypatch, text, error, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=message) as caught:
        load_shape(text)
    assert "\n" not in str(caught.value)


def test_an_unknown_suffix_names_what_is_accepted(tmp_path):
    file = tmp_path / "curve.dat"
    file.write_text("0,0", encoding="utf-8")
    with pytest.raises(ParseError, match=r"curve\.dat: the suffix is '\.dat'; a curve is a \.json, \.svg, \.igs, "):
        load_shape(str(file))
