"""Path data: against fontTools as an independent reader, arcs against trigonometry, every error with its place."""

import math

import numpy as np
import pytest
from fontTools.pens.recordingPen import RecordingPen
from fontTools.svgLib.path import parse_path as fonttools_parse
from svgelements import Path as SvgelementsPath

from jhd._io.contours import assemble
from jhd._io.errors import ParseError
from jhd._io.path_text import contours_of_path

# A few roundings of numbers of order ten.
ROUNDING = 1e-14


def segments(d):
    """The control points of each segment, as lists of complex numbers, contours one after another."""
    return [list(points) for contour in contours_of_path(d) for points, _ in contour.segments]


def arc_curve(d):
    curve = assemble(contours_of_path(d))
    assert curve is not None
    return curve


def samples(curve, count=33):
    """Points of every segment, (segments, count, 2)."""
    t = np.linspace(0, 1, count)
    return np.stack([np.asarray(curve.point(k, t)) for k in range(curve.count)])


POLYNOMIAL_PATHS = {
    "absolute": "M 10 20 L 30 40 H 50 V 60 C 1 2 3 4 5 6 S 7 8 9 10 Q 11 12 13 14 T 15 16 Z",
    "relative": "m 10 20 l 30 40 h 50 v 60 c 1 2 3 4 5 6 s 7 8 9 10 q 11 12 13 14 t 15 16 z",
    "repeated": "M0 0 10 0 10 10 h1 2 3 v-1-2 c1,2,3,4,5,6 7,8,9,10,11,12 t1 2 3 4",
    "move repeated": "m1 1 2 0 0 2z m5 5 1 1",
    "after close": "M1 2 L3 4 L5 0 Z L 7 7 z l 1 1",
    "smooth after another kind": "M0 0 L1 1 S 2 2 3 0 T 5 5 S 6 6 7 7",
    "smooth chains": "M0 0 C0 1 1 1 1 0 S2 -1 2 0 3 1 3 0 M0 5 Q1 6 2 5 T4 5 6 5 8 5",
    "dense": "M.5.5-3e2 1.5e-1L-1-1+2.25.75l1e1-.5",
    "white space": "\n\tM 1\r\n2,3 ,4\n",
}


@pytest.mark.parametrize("name", POLYNOMIAL_PATHS)
def test_polynomial_commands_agree_with_fonttools(name):
    d = POLYNOMIAL_PATHS[name]
    pen = RecordingPen()
    fonttools_parse(d, pen)
    drawn, at, start = [], 0j, 0j
    for command, points in pen.value:
        ends = [complex(*point) for point in points]
        if command == "moveTo":
            start = ends[0]
        elif command in ("closePath", "endPath"):
            if command == "closePath" and at != start:
                drawn.append([at, start])
            at = start if command == "closePath" else at
            continue
        else:
            drawn.append([at, *ends])
        at = ends[-1]
    mine = segments(d)
    assert [len(points) for points in mine] == [len(points) for points in drawn]
    for ours, theirs in zip(mine, drawn, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=ROUNDING, atol=ROUNDING)


def test_numbers_keep_their_floats():
    assert segments("M0.1 1e-3L-.30000000000000004 7") == [[complex(0.1, 1e-3), complex(-0.30000000000000004, 7)]]


def test_closing_adds_a_line_only_where_the_end_is_away():
    assert segments("M0 0 H1 V1 Z")[-1] == [1 + 1j, 0j]
    assert len(segments("M0 0 H1 V1 L0 0 Z")) == 3


def test_a_gap_of_rounding_is_closed_by_moving_the_end():
    d = "m.1.1l.1.2.1-.3" + "l-.1.05" * 2 + "z"
    contour = contours_of_path(d)[0]
    assert len(contour.segments) == 4
    assert contour.segments[-1].points[-1] == contour.segments[0].points[0]


def test_lone_moves_draw_nothing():
    assert segments("M1 1 M2 2 Z M3 3") == []
    assert segments("") == []


ARCS = {
    "quarter": ((2, 2), 0, 0, 1, 0.0, 90.0),
    "quarter backwards": ((2, 2), 0, 0, 0, 0.0, -90.0),
    "half": ((2, 2), 0, 0, 1, 10.0, 190.0),
    "three quarters": ((2, 2), 0, 1, 1, -20.0, 250.0),
    "three quarters backwards": ((2, 2), 0, 1, 0, 250.0, -20.0),
    "almost full": ((2, 2), 0, 1, 1, 0.0, 359.99),
    "ellipse": ((3, 0.5), 0, 1, 1, 30.0, 300.0),
    "turned ellipse": ((3, 1), 35, 0, 1, -40.0, 95.0),
    "turned by a right angle": ((3, 1), 90, 0, 0, 40.0, -100.0),
    "small": ((1, 1), 0, 0, 1, 5.0, 5.001),
}


def on_ellipse(radii, rotation, degrees):
    turn = np.exp(1j * math.radians(rotation))
    angle = math.radians(degrees)
    return complex(4 - 3j + turn * (radii[0] * math.cos(angle) + 1j * radii[1] * math.sin(angle)))


@pytest.mark.parametrize("name", ARCS)
def test_an_arc_lies_on_its_ellipse_between_its_angles(name):
    radii, rotation, large, sweep, first, last = ARCS[name]
    start, end = on_ellipse(radii, rotation, first), on_ellipse(radii, rotation, last)
    d = f"M{start.real!r} {start.imag!r}A{radii[0]} {radii[1]} {rotation} {large} {sweep} {end.real!r} {end.imag!r}"
    points = samples(arc_curve(d))
    local = (points[..., 0] + 1j * points[..., 1] - (4 - 3j)) * np.exp(-1j * math.radians(rotation))
    unit = local.real / radii[0] + 1j * local.imag / radii[1]
    # End points are rounded, and a short chord determines its circle that much worse.
    amplified = max(1.0, 1 / abs(math.sin(math.radians(last - first) / 2)))
    np.testing.assert_allclose(np.abs(unit), 1.0, rtol=4 * ROUNDING * amplified)
    # Angles advance from the first to the last, and no piece turns by more than a quarter.
    angles = np.unwrap(np.angle(unit), axis=1)
    turns = angles[:, -1] - angles[:, 0]
    assert math.isclose(turns.sum(), math.radians(last - first), rel_tol=1e-9)
    assert np.abs(turns).max() <= math.pi / 2 + 1e-9
    assert (np.diff(angles, axis=1) * np.sign(last - first) > 0).all()
    assert (points[0, 0] == [start.real, start.imag]).all() and (points[-1, -1] == [end.real, end.imag]).all()


@pytest.mark.parametrize("name", ["half", "three quarters", "ellipse", "turned ellipse"])
def test_an_arc_agrees_with_svgelements(name):
    radii, rotation, large, sweep, first, last = ARCS[name]
    start, end = on_ellipse(radii, rotation, first), on_ellipse(radii, rotation, last)
    d = f"M{start.real!r} {start.imag!r}A{radii[0]} {radii[1]} {rotation} {large} {sweep} {end.real!r} {end.imag!r}"
    reference = SvgelementsPath(d)[1]
    theirs = np.array([complex(p.x, p.y) for p in map(reference.point, np.linspace(0, 1, 2001))])
    ours = samples(arc_curve(d)).reshape(-1, 2)
    gaps = np.abs(ours[:, 0, None] + 1j * ours[:, 1, None] - theirs)
    # Half of their sample spacing.
    assert gaps.min(axis=1).max() < 3 * 5 / 2000


def test_a_quarter_has_the_exact_control_points():
    curve = arc_curve("M1 0A1 1 0 0 1 0 1")
    np.testing.assert_allclose(curve.control_points, [[[1, 0], [1, 1], [0, 1]]], atol=2e-16)
    np.testing.assert_allclose(np.asarray(curve.weights), [[1, math.sqrt(0.5), 1]], rtol=4e-16)


def test_flags_need_no_separators():
    assert contours_of_path("M0 0a1 1 0 012 3")[0].segments == contours_of_path("M0 0a1 1 0 0 1 2 3")[0].segments
    assert contours_of_path("M0 0a1 1 0 1,0.5.5 1 1 0 000 1")[0].segments == (
        contours_of_path("M0 0 a 1 1 0 1 0 .5 .5 a 1 1 0 0 0 0 1")[0].segments
    )


@pytest.mark.parametrize("radii", ["0 1", "1 0", "0 0"])
def test_an_arc_with_a_zero_radius_is_a_line(radii):
    assert segments(f"M0 0A{radii} 0 0 1 3 4") == [[0j, 3 + 4j]]


def test_an_arc_to_where_it_starts_is_nothing():
    assert segments("M1 2A5 5 0 1 1 1 2") == []


def test_radii_that_are_too_small_are_scaled_up_to_a_half_turn():
    points = samples(arc_curve("M0 0A1 2 0 0 1 4 0"))
    # The ellipse of half axes 2 and 4 around (2, 0); in y-down coordinates sweep 1 goes over negative y first.
    np.testing.assert_allclose(((points[..., 0] - 2) / 2) ** 2 + (points[..., 1] / 4) ** 2, 1, rtol=ROUNDING)
    assert points[..., 1].min() == pytest.approx(-4, rel=ROUNDING)
    assert points[..., 1].max() <= 0


def test_signs_of_radii_do_not_matter():
    assert contours_of_path("M0 0A-1 -2 20 1 1 1 1")[0].segments == contours_of_path("M0 0A1 2 20 1 1 1 1")[0].segments


def test_a_flat_arc_far_from_its_center_keeps_its_sagitta():
    radius, chord = 1e9, 2.0
    points = samples(arc_curve(f"M0 0A{radius} {radius} 0 0 1 {chord} 0"))
    sagitta = (chord / 2) ** 2 / (2 * radius)
    assert points[..., 1].min() == pytest.approx(-sagitta, rel=1e-9)


def test_arcs_and_lines_share_a_degree_and_get_weights():
    curve = arc_curve("M0 0H2A1 1 0 0 1 2 2Z")
    assert curve.degree == 2
    np.testing.assert_array_equal(np.asarray(curve.weights)[0], 1.0)
    np.testing.assert_array_equal(curve.control_points[0], [[0, 0], [1, 0], [2, 0]])
    assert curve.next_segment.tolist() == [1, 2, 3, 0]


def test_arcs_and_cubics_share_a_degree_and_stay_the_same_curves():
    together, alone = arc_curve("M2 0A2 2 0 0 1 0 2C0 3 1 3 1 2"), arc_curve("M2 0A2 2 0 0 1 0 2")
    assert together.degree == 3
    np.testing.assert_allclose(samples(together)[0], samples(alone)[0], rtol=ROUNDING, atol=ROUNDING)
    np.testing.assert_array_equal(together.control_points[1], [[0, 2], [0, 3], [1, 3], [1, 2]])


def test_polynomial_paths_have_no_weights_and_the_least_degree():
    for d, degree in (("M0 0L1 1", 1), ("M0 0L1 1Q2 2 3 0", 2), ("M0 0L1 1Q2 2 3 0C1 1 2 2 3 3", 3)):
        curve = arc_curve(d)
        assert (curve.degree, curve.weights) == (degree, None)


def test_segments_that_stay_at_a_point_are_left_out_unless_alone():
    assert arc_curve("M0 0H1h0V1").count == 2
    assert arc_curve("M1 1h0").count == 1


def test_contours_that_touch_are_closed_on_themselves():
    curve = arc_curve("M0 0H1V1ZM0 0H-1V-1Z")
    assert curve.next_segment.tolist() == [1, 2, 0, 4, 5, 3]


def test_open_ends_that_meet_are_joined():
    assert arc_curve("M0 0H1M1 0H2").next_segment.tolist() == [1, -1]


@pytest.mark.parametrize(
    ("d", "line", "column", "message"),
    [
        ("L1 1", 1, 1, "must begin with M or m; found 'L'"),
        ("M0 0 X", 1, 6, "needs a command, one of M L H V C S Q T A Z or lower case; found 'X'"),
        ("M0", 1, 3, "needs a number; found the end"),
        ("M0 0L1,,2", 1, 8, "needs a number; found ','"),
        ("M0 0L,1 2", 1, 6, "needs a number; found ','"),
        ("M0 0L1 2,", 1, 9, "needs a command, one of .*; found ','"),
        ("M0 0C1 2 3 4 5", 1, 15, "needs a number; found the end"),
        ("M0 0\nL1 1\nL1 z", 3, 4, "needs a number; found 'z'"),
        ("M0 0A1 1 0 2 0 1 1", 1, 12, "needs an arc flag, 0 or 1; found '2'"),
        ("M0 0A1 1 0 0", 1, 13, "needs an arc flag, 0 or 1; found the end"),
        ("M0 0Z1 1", 1, 6, "needs a command, one of .*; found '1'"),
        ("M0 0L1e999 1", 1, 6, "the number 1e999 is too large"),
        ("M0 0Lnan 1", 1, 6, "needs a number; found 'n'"),
        ("M0 0L١ 1", 1, 6, "needs a number; found '١'"),
    ],
)
def test_errors_say_where_and_what(d, line, column, message):
    with pytest.raises(ParseError, match=f"^line {line}, column {column}: path data: {message}") as caught:
        contours_of_path(d)
    assert (caught.value.file, caught.value.line, caught.value.column) == (None, line, column)
