"""Curves as JSON: exact round trips, and messages that name the file and the key."""

import json
from typing import Any

import numpy as np
import pytest

from jhd._io.described import curve_from_dict, curve_to_dict, load_curve, save_curve
from jhd._io.errors import ParseError
from jhd._io.load import load_shape
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.simple_curves import circle, point_set, polyline

RANDOM = np.random.default_rng(11)


def awkward(*shape):
    """Floats of many sizes, all of their digits in use."""
    return RANDOM.normal(size=shape) * 10.0 ** RANDOM.integers(-9, 9, size=shape)


KNOTS = np.sort(RANDOM.normal(size=9))
CURVES = {
    "Bezier": BezierCurve(awkward(4, 2)),
    "rational Bezier": BezierCurve(awkward(3, 3), weights=np.abs(awkward(3))),
    "B-spline": BSplineCurve(awkward(5, 2), KNOTS),
    "NURBS": BSplineCurve(awkward(5, 2), KNOTS, weights=np.abs(awkward(5))),
    "periodic B-spline": BSplineCurve.uniform(awkward(5, 2), periodic=True),
    "segments": BezierSegments(awkward(4, 3, 2)),
    "segments with joints": BezierSegments(awkward(3, 2, 2), next_segment=[2, -1, 0]),
    "polyline": polyline(awkward(4, 3), closed=True),
    "points": point_set(awkward(3, 2)),
    "circle": circle([1, 2], 0.1),
}


@pytest.mark.parametrize("name", CURVES)
def test_what_is_saved_is_loaded_bit_for_bit(tmp_path, name):
    curve = CURVES[name]
    save_curve(tmp_path / "curve.json", curve)
    again = load_curve(tmp_path / "curve.json")
    assert type(again) is type(curve)
    for field in curve.__dataclass_fields__:
        ours, theirs = getattr(curve, field), getattr(again, field)
        assert (ours is None) == (theirs is None)
        if ours is not None:
            np.testing.assert_array_equal(theirs, ours)


def test_the_suffix_names_the_kind_of_file_that_is_written_and_read(tmp_path):
    curve = BezierCurve(awkward(4, 2))
    save_curve(tmp_path / "curve.SVG", curve)
    assert (tmp_path / "curve.SVG").read_text(encoding="utf-8").startswith("<svg")
    drawn: Any = load_curve(tmp_path / "curve.SVG"), load_shape(tmp_path / "curve.SVG")
    for again in drawn:
        np.testing.assert_array_equal(again.segments().control_points[0], curve.control_points)
    save_curve(tmp_path / "curve.igs", curve)
    found: Any = load_shape(tmp_path / "curve.igs")
    np.testing.assert_array_equal(found.control_points[:, :2], curve.control_points)
    with pytest.raises(TypeError, match="file is a BezierCurve; pass the file first, then the curve|parameter 'file'"):
        save_curve(BezierCurve([[0, 0], [1, 1]]), "a.json")  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"the suffix of .* is '.obj'; a curve is written as .json, .svg, .igs, .iges"):
        save_curve(tmp_path / "curve.obj", curve)
    assert not (tmp_path / "curve.obj").exists()


def test_files_are_readable_json_with_one_key_a_line(tmp_path):
    save_curve(tmp_path / "curve.json", BezierCurve([[0, 0], [1, 2]], weights=[1, 0.5]))
    text = (tmp_path / "curve.json").read_text(encoding="utf-8")
    assert text.splitlines()[1:4] == [
        '  "type": "BezierCurve",',
        '  "control_points": [[0.0, 0.0], [1.0, 2.0]],',
        '  "weights": [1.0, 0.5]',
    ]


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ({"type": "polyline", "points": [[0, 0], [1, 0], [1, 1]]}, polyline([[0, 0], [1, 0], [1, 1]])),
        (
            {"type": "polyline", "points": [[0, 0], [1, 0], [1, 1]], "closed": True, "comment": "a triangle"},
            polyline([[0, 0], [1, 0], [1, 1]], closed=True),
        ),
        ({"type": "points", "points": [[0, 0, 1]]}, point_set([[0, 0, 1]])),
        ({"type": "circle", "center": [1, 2], "radius": 3}, circle([1, 2], 3)),
        ({"type": "BezierCurve", "control_points": [[0, 0], [1, 0]], "weights": None}, BezierCurve([[0, 0], [1, 0]])),
    ],
)
def test_kinds_written_by_hand_are_built(content, expected):
    curve = curve_from_dict(content)
    assert curve_to_dict(curve) == curve_to_dict(expected)


def test_dictionaries_hold_plain_numbers():
    content = curve_to_dict(CURVES["periodic B-spline"])
    assert content["periodic"] is True
    assert json.loads(json.dumps(content)) == content


CONTENT_ERRORS = {
    "no type": ({}, "The key 'type' is missing; needs one of BezierCurve, BSplineCurve, .*circle"),
    "unknown type": ({"type": "spline"}, "type is 'spline'; needs one of BezierCurve"),
    "type is a list": ({"type": ["a"]}, r"type is \['a'\]; needs one of"),
    "missing key": (
        {"type": "BSplineCurve", "control_points": []},
        "BSplineCurve has no key 'knots'; needs control",
    ),
    "unknown key": (
        {"type": "BezierCurve", "control_points": [[0, 0]], "weight": [1]},
        "BezierCurve has an unknown key 'weight'; known are control_points, weights",
    ),
    "null for a needed key": ({"type": "points", "points": None}, "points has no key 'points'"),
    "wrong shape": ({"type": "BezierCurve", "control_points": [0, 1]}, r"control_points has shape \(2,\)"),
    "ragged": ({"type": "BezierCurve", "control_points": [[0, 1], [2]]}, "control_points must be a rectangular array"),
    "text": ({"type": "points", "points": [["a", "b"]]}, "points must be real numbers"),
    "not finite": ({"type": "points", "points": [[0, float("nan")]]}, r"points\[0\] is not finite"),
    "weights": (
        {"type": "BezierCurve", "control_points": [[0, 0], [1, 1]], "weights": [1]},
        "weights has 1 entries; control_points has 2 points",
    ),
    "flag": ({"type": "polyline", "points": [[0, 0], [1, 1]], "closed": "no"}, "closed is 'no'; needs true or false"),
    "joints": (
        {"type": "BezierSegments", "control_points": [[[0, 0], [1, 1]]], "next_segment": [5]},
        r"next_segment\[0\] is 5; needs -1 or a segment below 1",
    ),
    "radius": ({"type": "circle", "center": [0, 0], "radius": -1}, "radius is not positive: -1"),
}


@pytest.mark.parametrize("name", CONTENT_ERRORS)
def test_wrong_content_names_the_key_and_in_files_the_file(tmp_path, name):
    content, message = CONTENT_ERRORS[name]
    with pytest.raises(ValueError, match=f"^{message}"):
        curve_from_dict(content)
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ParseError, match=rf"wrong\.json: {message}") as caught:
        load_curve(file)
    assert caught.value.file == str(file)
    assert "\n" not in str(caught.value)


def test_broken_json_has_its_line_and_column(tmp_path):
    file = tmp_path / "broken.json"
    file.write_text('{\n "type": "points",\n "points": [1,]\n}', encoding="utf-8")
    with pytest.raises(ParseError, match=r"broken\.json:3:\d+: JSON: ") as caught:
        load_curve(file)
    assert caught.value.line == 3


def test_files_that_are_missing_or_no_text_or_no_object_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.json: no such file\.$"):
        load_curve(tmp_path / "none.json")
    file = tmp_path / "bytes.json"
    file.write_bytes(b"{\xff}")
    with pytest.raises(ParseError, match=r"bytes\.json: byte 1 is not UTF-8 text"):
        load_curve(file)
    with pytest.raises(ParseError, match=r"bytes\.stl: byte 1 .*; load_shape reads formats other than JSON"):
        load_curve(file.rename(tmp_path / "bytes.stl"))
    file.write_text("[1, 2]", encoding="utf-8")
    with pytest.raises(ParseError, match="A curve is a JSON object with a key 'type'; got list"):
        load_curve(file)


def test_only_curves_are_written():
    with pytest.raises(TypeError, match="curve must be a curve|^Type-check error"):
        curve_to_dict([[0, 0]])  # pyright: ignore[reportArgumentType]

    class Strange(BezierCurve):
        pass

    strange: AbstractCurve = Strange([[0, 0]], None)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="files of curves hold BezierCurve, BSplineCurve, BezierSegments; got Strange"):
        curve_to_dict(strange)
