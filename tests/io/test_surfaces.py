"""Parametric surfaces as JSON: exact round trips, one format with curves, and messages that name the file and key."""

import json
from typing import Any

import numpy as np
import pytest

import jhd.io
from jhd._io.described import load_surface, save_surface, surface_from_dict, surface_to_dict
from jhd._io.errors import ParseError
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.patch import BezierPatch, BezierPatches

RANDOM = np.random.default_rng(12)


def awkward(*shape):
    """Floats of many sizes, all of their digits in use."""
    return RANDOM.normal(size=shape) * 10.0 ** RANDOM.integers(-9, 9, size=shape)


KNOTS_U, KNOTS_V = np.sort(RANDOM.normal(size=7)), np.sort(RANDOM.normal(size=5))
SURFACES = {
    "patch": BezierPatch(awkward(3, 2, 3)),
    "rational patch": BezierPatch(awkward(2, 3, 3), np.abs(awkward(2, 3))),
    "B-spline": BSplineSurface(awkward(4, 3, 3), KNOTS_U, KNOTS_V),
    "NURBS": BSplineSurface(awkward(4, 3, 3), KNOTS_U, KNOTS_V, np.abs(awkward(4, 3))),
    "patches": BezierPatches(awkward(2, 2, 3, 3), np.abs(awkward(2, 2, 3))),
}


def test_the_suffix_names_the_kind_of_file_that_is_written(tmp_path):
    surface = BezierPatch([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 2.5]]])
    save_surface(tmp_path / "a.iges", surface)
    found: Any = jhd.io.load_shape(tmp_path / "a.iges")
    np.testing.assert_array_equal(found.control_points, surface.control_points)
    with pytest.raises(ValueError, match=r"is '.ply'; a surface is written as .json, .igs, .iges"):
        save_surface(tmp_path / "a.ply", surface)


@pytest.mark.parametrize("name", SURFACES)
def test_what_is_saved_is_loaded_bit_for_bit(tmp_path, name):
    surface = SURFACES[name]
    file = tmp_path / "surface.json"
    save_surface(file, surface)
    for again in (load_surface(file), jhd.io.load_shape(str(file))):
        assert type(again) is type(surface)
        for field in surface.__dataclass_fields__:
            ours, theirs = getattr(surface, field), getattr(again, field)
            assert (ours is None) == (theirs is None)
            if ours is not None:
                np.testing.assert_array_equal(theirs, ours)


def test_one_file_format_holds_curves_and_surfaces(tmp_path):
    file = tmp_path / "a.json"
    jhd.io.save_curve(file, BezierCurve([[0, 0], [1, 2]]))
    with pytest.raises(ParseError, match=r"a\.json: type is 'BezierCurve'; needs one of BezierPatch, BSplineSurface"):
        load_surface(file)
    file.write_text(json.dumps({"type": "surface"}), encoding="utf-8")
    with pytest.raises(ParseError, match=r"type is 'surface'; needs one of BezierCurve, .*, circle, BezierPatch, "):
        jhd.io.load_shape(str(file))


NET = [[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 1]]]
WRONG = {
    "missing key": ({"type": "BSplineSurface", "control_points": NET}, "BSplineSurface has no key 'knots_u'"),
    "unknown key": ({"type": "BezierPatch", "control_points": NET, "degree": 1}, "unknown key 'degree'"),
    "plane": ({"type": "BezierPatch", "control_points": [[[0, 0]]]}, "control_points has 2 coordinates a point"),
    "axes": ({"type": "BezierPatches", "control_points": NET}, r"control_points has shape \(2, 2, 3\)"),
    "ragged": ({"type": "BezierPatch", "control_points": [[[0, 0, 0]], []]}, "must be a rectangular array"),
    "not finite": (
        {"type": "BezierPatch", "control_points": [[[0, 0, float("nan")]]]},
        r"control_points\[0, 0\] is not finite",
    ),
    "huge": ({"type": "BezierPatch", "control_points": [[[0, 0, 10**400]]]}, "control_points must be real numbers"),
    "weights": ({"type": "BezierPatch", "control_points": NET, "weights": [[1, 1], [1, 0]]}, "is not positive: 0"),
    "knots": (
        {"type": "BSplineSurface", "control_points": NET, "knots_u": [0, 0, 1, 1], "knots_v": [0, 1, 0, 1]},
        r"knots_v\[2\] is 0; needs at least knots_v\[1\] = 1",
    ),
    "long text": ({"type": "x" * 10_000}, r"type is 'xxx+\.\.\.; needs"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_content_is_refused_in_one_short_line(tmp_path, name):
    content, message = WRONG[name]
    with pytest.raises(ValueError, match=message):
        surface_from_dict(content)
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ParseError, match=rf"wrong\.json: .*{message}") as caught:
        load_surface(file)
    assert "\n" not in str(caught.value) and len(caught.value.reason) < 300


@pytest.mark.parametrize(
    ("text", "message"),
    [("[" * 100_000, "JSON: "), ('{"type": ' + "9" * 5000 + "}", "JSON: "), ('{"type"', r"wrong\.json:1:8: JSON: ")],
)
def test_what_json_cannot_hold_is_refused(tmp_path, text, message):
    file = tmp_path / "wrong.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ParseError, match=message) as caught:
        jhd.io.load_shape(str(file))
    assert "\n" not in str(caught.value)


def test_only_parametric_surfaces_are_written():
    curve: Any = BezierCurve([[0, 0], [1, 2]])
    with pytest.raises(TypeError, match="files of surfaces hold BezierPatch.*; got BezierCurve|^Type-check error"):
        surface_to_dict(curve)
