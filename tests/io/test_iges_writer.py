"""Splines written to IGES files: the layout by columns, the same floats back, and the same curve to another reader."""

import re

import numpy as np
import pytest
from scipy.interpolate import BSpline, NdBSpline

import jhd
import jhd.io
from jhd._io.iges import load_iges
from jhd._io.iges_writer import save_iges
from tests.io.iges_sheets import entities_of

RANDOM = np.random.default_rng(31)
KNOTS = np.sort(RANDOM.normal(size=9))
KNOTS_U, KNOTS_V = np.sort(RANDOM.normal(size=7)), np.sort(RANDOM.normal(size=5))


def awkward(*shape):
    """Floats of many sizes, all of their digits in use."""
    return RANDOM.normal(size=shape) * 10.0 ** RANDOM.integers(-9, 9, size=shape)


EXACT = {
    "B-spline": jhd.BSplineCurve(awkward(5, 3), KNOTS),
    "NURBS": jhd.BSplineCurve(awkward(5, 3), KNOTS, np.abs(awkward(5))),
    "periodic": jhd.BSplineCurve.uniform(awkward(5, 3), periodic=True),
    "periodic NURBS": jhd.BSplineCurve.uniform(awkward(5, 3), periodic=True, weights=np.abs(awkward(5))),
    "surface": jhd.BSplineSurface(awkward(4, 3, 3), KNOTS_U, KNOTS_V),
    "rational surface": jhd.BSplineSurface(awkward(4, 3, 3), KNOTS_U, KNOTS_V, np.abs(awkward(4, 3))),
    "segments": jhd.BezierSegments(awkward(3, 4, 3), np.abs(awkward(3, 4))),
    "patches": jhd.BezierPatches(awkward(2, 3, 2, 3), np.abs(awkward(2, 3, 2))),
    "extremes": jhd.BSplineCurve([[5e-324, 1e308, -0.0], [1e16, -1e-5, 123456789.0]], [0, 0, 1e-300, 1e-300]),
}


@pytest.mark.parametrize("name", EXACT)
def test_what_is_written_is_read_back_bit_for_bit(tmp_path, name):
    shape, file = EXACT[name], tmp_path / "a.igs"
    save_iges(file, shape)
    again = jhd.io.load_shape(str(file))
    assert type(again) is type(shape)
    for field in shape.__dataclass_fields__:
        ours, theirs = getattr(shape, field), getattr(again, field)
        assert (ours is None) == (theirs is None), field
        if ours is not None:
            np.testing.assert_array_equal(theirs, ours)


def test_joined_segments_are_one_composite_curve(tmp_path):
    rows = [[[0, 0, 0], [1, 0, 0]], [[1, 0, 0], [1, 1, 0]], [[5, 5, 5], [6, 6, 6]]]
    curve = jhd.BezierSegments(rows)
    save_iges(tmp_path / "a.igs", curve)
    found = entities_of((tmp_path / "a.igs").read_bytes())
    assert [(kind, status) for kind, _, status, _, _ in found] == [
        (126, "00010000"), (126, "00010000"), (102, "00000000"), (126, "00000000"),
    ]  # fmt: skip
    assert found[2][4] == [2, 1, 3]
    joined, single = load_iges(tmp_path / "a.igs")
    assert isinstance(joined, jhd.BezierSegments) and isinstance(single, jhd.BSplineCurve)
    np.testing.assert_array_equal(joined.next_segment, [1, -1])


def test_plane_curves_lie_in_the_plane_z_0_and_say_so(tmp_path):
    save_iges(tmp_path / "a.igs", [jhd.BezierCurve([[1, 2], [3, 4], [1, 2]])])
    ((kind, matrix, _, form, words),) = entities_of((tmp_path / "a.igs").read_bytes())
    assert (kind, matrix, form) == (126, 0, 0)
    # K, M, plane, closed, polynomial, not periodic; knots; weights; points; ends; normal.
    assert words[:6] == [2, 2, 1, 1, 1, 0] and words[6:12] == [0, 0, 0, 1, 1, 1] and words[12:15] == [1, 1, 1]
    assert words[15:24] == [1, 2, 0, 3, 4, 0, 1, 2, 0] and words[24:] == [0, 1, 0, 0, 1]


@pytest.mark.slow
def test_another_reader_finds_the_same_curve(tmp_path):
    curve = jhd.BSplineCurve(RANDOM.normal(size=(6, 3)), np.sort(RANDOM.normal(size=10)), RANDOM.uniform(0.5, 2, 6))
    save_iges(tmp_path / "a.igs", curve)
    (words,) = (entity[4] for entity in entities_of((tmp_path / "a.igs").read_bytes()))
    last, degree, knots = int(words[0]), int(words[1]), np.array(words[6:16])
    weights, points = np.array(words[16:22]), np.reshape(words[22:40], (6, 3))
    t = np.linspace(words[40], words[41], 9)
    assert (last, degree) == (5, 3)
    h = BSpline(knots, np.column_stack([points * weights[:, None], weights]), degree)(t)
    np.testing.assert_allclose(h[:, :3] / h[:, 3:], np.asarray(curve(t)), rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_another_reader_finds_the_same_surface(tmp_path):
    surface = jhd.BSplineSurface(RANDOM.normal(size=(4, 3, 3)), KNOTS_U, KNOTS_V, RANDOM.uniform(0.5, 2, (4, 3)))
    save_iges(tmp_path / "a.igs", surface)
    (words,) = (entity[4] for entity in entities_of((tmp_path / "a.igs").read_bytes()))
    assert words[:9] == [3, 2, 2, 1, 0, 0, 0, 0, 0]
    in_u, in_v = np.array(words[9:16]), np.array(words[16:21])
    # The sum of section 4.24, where the first index of weights and points runs first.
    weights = np.reshape(words[21:33], (4, 3), order="F")
    points = np.stack([np.reshape(words[33 + axis : 69 : 3], (4, 3), order="F") for axis in range(3)], axis=-1)
    u, v = (
        x.ravel()
        for x in np.meshgrid(np.linspace(words[69], words[70], 4)[1:-1], np.linspace(words[71], words[72], 5)[1:-1])
    )
    net = np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)
    h = NdBSpline((in_u, in_v), net, (2, 1))(np.stack([u, v], axis=-1))
    np.testing.assert_allclose(h[:, :3] / h[:, 3:], np.asarray(surface(u, v)), rtol=1e-12, atol=1e-12)


def test_several_shapes_the_unit_and_the_version_stand_in_the_file(tmp_path):
    file = tmp_path / "größe, 1;.igs"
    save_iges(file, [EXACT["B-spline"], EXACT["surface"], EXACT["NURBS"]], unit="IN")
    text = file.read_text(encoding="ascii")
    start = "".join(line[:72] for line in text.splitlines() if line[72] == "G").rstrip()
    assert start.startswith("1H,,1H;,3Hjhd,13Hgr??e, 1;.igs,3Hjhd,") and ",1.,1,2HIN," in start
    assert re.search(r",11,0,15H[0-9]{8}\.[0-9]{6},;$", start)
    assert [type(shape).__name__ for shape in load_iges(file)] == ["BSplineCurve", "BSplineSurface", "BSplineCurve"]


@pytest.mark.parametrize(
    ("shapes", "options", "error", "message"),
    [
        ([], {}, ValueError, "shapes is empty"),
        (
            jhd.point_set([[0, 0]]),
            {},
            ValueError,
            r"shapes\[0\] has degree 0; the splines of IGES have degree 1 at least",
        ),
        (jhd.BezierPatch([[[0, 0, 0]]]), {}, ValueError, "degree 0"),
        ([EXACT["surface"], 5], {}, TypeError, r"shapes\[1\] must be a curve or a parametric surface; got int"),
        ([EXACT["surface"]], {"unit": "mm"}, ValueError, "unit is 'mm'; needs one of IN, MM"),
    ],
)
def test_what_iges_cannot_hold_is_refused_and_no_file_is_left(tmp_path, shapes, options, error, message):
    with pytest.raises((error, TypeError), match=f"{message}|^Type-check error"):
        save_iges(tmp_path / "a.igs", shapes, **options)
    assert not list(tmp_path.iterdir())
