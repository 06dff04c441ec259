"""IGES files: splines as the standard describes them, placed and cut; everything else is refused in one line."""

from typing import Any

import numpy as np
import pytest

import jhd
import jhd.io
from jhd._io.errors import ParseError
from jhd._io.iges import load_iges
from tests.io.iges_sheets import sheet

# A line from (0, 0, 0) to (1, 2, 3), written as it stands in a file: knots, weights, points, ends, normal.
LINE = "126,1,1,0,0,1,0,0.,0.,1.,1.,1.,1.,0.,0.,0.,1.,2.,3.,0.,1.,0.,0.,0.;"
# A quarter of a circle of radius 2 as a rational quadratic.
QUARTER = "126,2,2,1,0,0,0,0.,0.,0.,1.,1.,1.,1.,.70710678118654752D0,1.,2.,0.,0.,2.,2.,0.,0.,2.,0.,0.,1.,0.,0.,1.;"
# Two by three points: linear in u, quadratic in v; weights and points run along u first.
SHEET = (
    "128,1,2,1,2,0,0,1,0,0,0.,0.,1.,1.,0.,0.,0.,2.,2.,2.,1.,1.,1.,1.,1.,1.,"
    "0.,0.,0.,1.,0.,0.,0.,1.,5.,1.,1.,6.,0.,2.,7.,1.,2.,8.,0.,1.,0.,2.;"
)
# x -> (-y + 10, x, z + 1)
TURN = "124,0.,-1.,0.,10.,1.,0.,0.,0.,0.,0.,1.,1.;"
BY_HAND = """\
A line as it stands in the standard: two lines for the directory.       S      1
,,4Hline,8Hline.igs,3Hjhd,3H1.0,32,38,6,308,15,4Hline,1.0,2,2HMM,1,0.1, G      1
15H20260101.000000,0.001,10.0,2Hme,2Hus,11,0,15H20260101.000000;        G      2
     126       1       0       0       0       0       0       0   00000D      1
     126       0       0       3       0                    LINE       1D      2
126,1,1,1,0,1,0,0.0,0.0,1.0,                                           1P      1
1.0,1.0,1.0,-1.5D-1,.5E+1,0,7,8,9,                                     1P      2
0.0,1.0,0.0,0.0,1.0; a comment, which 5Hcounts for nothing;            1P      3
S      1G      2D      2P      3                                        T      1
"""


def written(folder, content):
    file = folder / "a.igs"
    file.write_bytes(content)
    return file


def shapes(folder, *entities, **options) -> list[Any]:
    return load_iges(written(folder, sheet(*entities, **options)))


def test_a_file_written_by_hand_is_read(tmp_path):
    (line,) = load_iges(written(tmp_path, BY_HAND.encode()))
    assert isinstance(line, jhd.BSplineCurve) and line.weights is None
    np.testing.assert_array_equal(line.control_points, [[-0.15, 5, 0], [7, 8, 9]])
    np.testing.assert_array_equal(line.knots, [0, 0, 1, 1])


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_the_ends_of_lines_do_not_matter(tmp_path, end):
    (line,) = shapes(tmp_path, LINE, end=end)
    np.testing.assert_array_equal(line.control_points, [[0, 0, 0], [1, 2, 3]])


@pytest.mark.parametrize(
    ("start", "parameter", "record"), [("1H|,1H/|".replace(",", "|"), "|", "/"), (",1H!,", ",", "!")]
)
def test_delimiters_are_those_of_the_global_section(tmp_path, start, parameter, record):
    found = shapes(tmp_path, LINE, SHEET, start=start, parameter=parameter, record=record)
    np.testing.assert_array_equal(found[0].control_points, [[0, 0, 0], [1, 2, 3]])
    np.testing.assert_array_equal(found[1].control_points[1], [[1, 0, 0], [1, 1, 6], [1, 2, 8]])


def test_rational_curves_keep_their_weights(tmp_path):
    (arc,) = shapes(tmp_path, QUARTER)
    np.testing.assert_array_equal(arc.weights, [1, np.sqrt(0.5), 1])
    np.testing.assert_allclose(np.linalg.norm(arc(np.linspace(0, 1, 7)), axis=1), 2, rtol=1e-15)


def test_the_net_of_a_surface_runs_along_u_first(tmp_path):
    (surface,) = shapes(tmp_path, SHEET)
    assert surface.degrees == (1, 2) and surface.weights is None
    np.testing.assert_array_equal(
        surface.control_points, [[[0, 0, 0], [0, 1, 5], [0, 2, 7]], [[1, 0, 0], [1, 1, 6], [1, 2, 8]]]
    )
    weighted = SHEET.replace("0,0,1,0,0,", "0,0,0,0,0,").replace(
        "2.,2.,2.,1.,1.,1.,1.,1.,1.,", "2.,2.,2.,1.,2.,3.,4.,5.,6.,"
    )
    (rational,) = shapes(tmp_path, weighted)
    np.testing.assert_array_equal(rational.weights, [[1, 3, 5], [2, 4, 6]])


def test_matrices_move_shapes_and_each_other(tmp_path):
    far = "124,1.,0.,0.,100.,0.,1.,0.,0.,0.,0.,1.,0.;"
    moved, twice, surface = shapes(
        tmp_path,
        (LINE, {"matrix": 5}),
        (LINE, {"matrix": 7}),
        (TURN, {}),
        (TURN, {"matrix": 9}),
        far,
        (SHEET, {"matrix": 5}),
    )
    np.testing.assert_array_equal(moved.control_points, [[10, 0, 1], [8, 1, 4]])
    np.testing.assert_array_equal(twice.control_points, [[110, 0, 1], [108, 1, 4]])
    np.testing.assert_array_equal(surface.control_points[1, 2], [8, 1, 9])


@pytest.mark.slow
def test_curves_and_surfaces_are_cut_to_the_parameters_of_the_entity(tmp_path):
    part = QUARTER.replace("2.,0.,0.,1.,0.,0.,1.;", "2.,0.,0.25,.5,0.,0.,1.;")
    whole, cut = shapes(tmp_path, QUARTER, part)
    assert [float(x) for x in cut.domain] == [0.25, 0.5]
    np.testing.assert_allclose(cut(np.array([0.25, 0.4, 0.5])), whole(np.array([0.25, 0.4, 0.5])), atol=1e-15)
    small = SHEET.replace("8.,0.,1.,0.,2.;", "8.,0.5,1.,0.25,1.5;")
    whole, cut = shapes(tmp_path, SHEET, small)
    assert [[float(x) for x in ends] for ends in cut.domain] == [[0.5, 1], [0.25, 1.5]]
    u, v = np.meshgrid([0.5, 0.75, 1], [0.25, 0.7, 1.5])
    np.testing.assert_allclose(cut(u, v), whole(u, v), atol=1e-14)


def test_ends_that_were_rounded_beyond_the_knots_are_put_on_them(tmp_path):
    (line,) = shapes(tmp_path, LINE.replace("3.,0.,1.,", "3.,-1E-10,1.0000000001,"))
    assert line.control_points.tolist() == [[0, 0, 0], [1, 2, 3]] and line.domain == (0, 1)


def in_unit(tmp_path, unit, *entities):
    return written(tmp_path, sheet(*entities).replace(b"1.,2,2HMM", unit))


@pytest.mark.parametrize(
    ("unit", "millimeters"),
    [(b"1.,1,2HIN", 25.4), (b",1,4HINCH", 25.4), (b",,       ", 25.4), (b"1.,3,2HCM", 10), (b"1D0,6,1HM", 1000)],
)
def test_coordinates_are_converted_to_the_unit_asked_for(tmp_path, unit, millimeters):
    part = {"status": "00010000", "matrix": 7}
    file = in_unit(tmp_path, unit, (LINE, part), (LINE, part | {"status": "0"}), ("102,1,1;", {"matrix": 7}), TURN)
    plain, other, meters = (load_iges(file, unit) for unit in (None, "MM", "M"))
    for ours, theirs, also in zip(plain, other, meters, strict=True):
        points = np.asarray(ours.control_points)
        np.testing.assert_array_equal(theirs.control_points, points * millimeters)
        np.testing.assert_allclose(also.control_points, points * millimeters / 1000, rtol=1e-15)
    assert len(plain) == 2 and np.abs(plain[1].control_points).max() == 10


@pytest.mark.parametrize(
    ("unit", "message"),
    [
        (b"2.,2,2HMM", r"a\.igs:2: the model space scale is '2\.'; needs 1"),
        (b"1.,1,2HMM", r"a\.igs:2: the unit has the flag '1' and the name 'MM'; needs one of IN, MM"),
        (b"1.,3,2HXX", "the flag '3' and the name 'XX'"),
        (b"1.,12,1HM", "the flag '12'"),
        (b"1.,x,2HMM", "the flag 'x'"),
    ],
)
def test_units_that_are_not_understood_are_refused(tmp_path, unit, message):
    file = in_unit(tmp_path, unit, LINE)
    with pytest.raises(ParseError, match=message):
        load_iges(file)
    assert len(load_iges(file, None)) == 1
    with pytest.raises(ValueError, match="unit is 'mm'; needs one of IN, MM, .*, or None"):
        load_iges(file, "mm")


def test_periodic_curves_whose_points_repeat_are_closed(tmp_path):
    ring = "126,4,1,0,1,1,1,-1.,0.,1.,2.,3.,4.,5.,1.,1.,1.,1.,1.,0.,0.,0.,4.,0.,0.,4.,3.,0.,0.,3.,0.,0.,0.,0.,0.,4.;"
    (closed,) = shapes(tmp_path, ring)
    assert closed.periodic and closed.control_points.shape == (4, 3) and closed.segments().count == 4
    (opened,) = shapes(tmp_path, ring.replace("126,4,1,0,1,1,1,", "126,4,1,0,1,1,0,"))
    assert not opened.periodic and opened.control_points.shape == (5, 3)


def test_composite_curves_are_joined_and_their_parts_are_no_shapes_of_their_own(tmp_path):
    second = LINE.replace("0.,0.,0.,1.,2.,3.", "1.,2.,3.,1.,2.,9.")
    part = {"status": "00010000"}
    (joined,) = shapes(tmp_path, (LINE, part), (second, part | {"matrix": 0}), ("102,2,1,3;", {"matrix": 7}), TURN)
    assert isinstance(joined, jhd.BezierSegments)
    np.testing.assert_array_equal(joined.control_points[:, :, 2], [[1, 4], [4, 10]])
    assert np.asarray(joined.next_segment).tolist() == [1, -1]


def test_lines_and_circular_arcs_are_curves(tmp_path):
    straight, arc, ring = shapes(
        tmp_path,
        ("110,0.,0.,0.,1.,2.,3.;", {"matrix": 7}),
        "100,5.,1.,2.,3.,2.,1.,0.;",
        "100,5.,1.,2.,3.,2.,3.,2.;",
        TURN,
    )
    np.testing.assert_array_equal(straight.control_points, [[[10, 0, 1], [8, 1, 4]]])
    t = np.linspace(0, 1, 33)
    for curve, count in ((arc, 3), (ring, 4)):
        points = np.asarray(curve.point(np.arange(count)[:, None], t))
        assert curve.count == count and np.all(curve.control_points[..., 2] == 5)
        np.testing.assert_allclose(np.hypot(points[..., 0] - 1, points[..., 1] - 2), 2, rtol=1e-15)
        # Counter-clockwise: angles grow.
        angles = np.unwrap(np.arctan2(points[..., 1] - 2, points[..., 0] - 1).ravel())
        assert np.all(np.diff(angles) > -1e-15) and abs(np.ptp(angles) - count * np.pi / 2) < 1e-14
    np.testing.assert_array_equal(arc.control_points[-1, -1], [1, 0, 5])
    np.testing.assert_array_equal(ring.next_segment, [1, 2, 3, 0])


def test_lines_and_arcs_are_joined_with_splines(tmp_path):
    part = {"status": "00010000"}
    entities = [
        "110,0.,0.,0.,2.,0.,0.;",
        "100,0.,2.,1.,2.,0.,2.,2.;",
        LINE.replace("0.,0.,0.,1.,2.,3.", "2.,2.,0.,0.,2.,0."),
    ]
    (joined,) = shapes(tmp_path, *((text, part) for text in entities), "102,3,1,3,5;")
    assert joined.degree == 2 and np.asarray(joined.next_segment).tolist() == [1, 2, 3, -1]
    np.testing.assert_allclose(
        joined.point([0, 1, 2, 3], 0.5),
        [[1, 0, 0], [2 + 0.5**0.5, 1 - 0.5**0.5, 0], [2 + 0.5**0.5, 1 + 0.5**0.5, 0], [1, 2, 0]],
        atol=1e-15,
    )


def test_what_is_no_shape_of_its_own_is_left_out(tmp_path):
    silent = ["314,1.,2.,3.;", "406,1,5Ha,b;c;", "212,1,4,1.,1.,1,1.57,0.,0,0,0.,0.,0.,4Htext;"]
    hidden, uv, note = ({"status": status} for status in ("01000000", "00000500", "00000100"))
    found = shapes(tmp_path, *silent, ("110,0.,0.,0.,1.,1.,1.;", hidden), (LINE, uv), ("110,0.;", note), LINE)
    assert len(found) == 1


def test_one_text_names_all_shapes_of_a_file(tmp_path):
    def of(*entities) -> Any:
        return jhd.io.load_shape(str(written(tmp_path, sheet(*entities))))

    assert isinstance(of(LINE), jhd.BSplineCurve) and isinstance(of(SHEET), jhd.BSplineSurface)
    curves = of(LINE, LINE)
    assert isinstance(curves, jhd.BezierSegments) and (curves.count, curves.degree) == (2, 1)
    surfaces = of(SHEET, SHEET)
    assert isinstance(surfaces, jhd.BezierPatches) and (surfaces.count, surfaces.degrees) == (2, (1, 2))
    np.testing.assert_array_equal(surfaces.control_points[1], surfaces.control_points[0])
    with pytest.raises(ParseError, match=r"a\.igs: holds 1 curve and 2 surfaces; use load_iges to get them one by one"):
        of(LINE, SHEET, SHEET)


ENTITIES = {
    "trimmed": (["144,1,0,0;"], r"a\.igs:3: entity 144 \(D1\), trimmed surface, is not read"),
    "bounded": (["143,0,1,0;"], "bounded surface"),
    "on a surface": (["142,0,1,0,3,1;"], "curve on a parametric surface"),
    "plane": (
        [LINE, "108,0.,0.,1.,1.;"],
        r"a\.igs:5: entity 108 \(D3\), plane, is not read; needs lines \(110\), circ",
    ),
    "line without an end": ([("110,0.,0.,0.,1.,1.,1.;", {"form": 1})], "is of form 1, a line without an end"),
    "arc out of round": (["100,0.,0.,0.,1.,0.,0.,1.01;"], "ends 1 and 1.01 from its center"),
    "arc of no radius": (["100,0.,1.,1.,1.,1.,1.,1.;"], "ends 0 and 0 from its center"),
    "unknown": (["5001,1;"], "entity 5001 .*another kind"),
    "nothing": (["314,1.,2.,3.;"], "holds no curve or surface"),
    "another type": ([("128" + LINE[3:], {}), LINE], r"entity 128 \(D1\) has degree 0 and 2 points"),
    "huge count": ([LINE.replace("126,1,1", "126,999999999,1")], r"has 23 parameters; needs 5000000010"),
    "huger count": ([LINE.replace("126,1,1", "126,99999999999999,1")], "parameter 1 '99999999999999'; needs an int"),
    "huge surface": ([SHEET.replace("1,2,1,2", "999999999,999999999,1,2", 1)], "has 47 parameters; needs 4000000"),
    "negative": ([LINE.replace("126,1,1", "126,-5,1")], "has degree 1 and -4 points"),
    "degree 0": ([LINE.replace("126,1,1", "126,1,0")], "has degree 0 and 2 points"),
    "degree too high": ([LINE.replace("126,1,1", "126,1,2")], "has degree 2 and 2 points"),
    "short": ([LINE.replace(",0.,1.,0.,0.,0.;", ";")], r"has 18 parameters; needs 20"),
    "nan": ([LINE.replace("2.,3.", "NaN,3.")], "parameter 17 'NaN'; needs a number"),
    "inf": ([LINE.replace("2.,3.", "1D999,3.")], r"control_points\[1\] is not finite"),
    "infinite knot": ([LINE.replace("1.,1.,1.", "1.,1E999,1.", 1)], r"knots\[3\] is not finite"),
    "word": ([LINE.replace("2.,3.", "two,3.")], "parameter 17 'two'; needs a number"),
    "python": ([LINE.replace("2.,3.", "1_0,3.")], "'1_0'"),
    "string": ([LINE.replace("2.,3.", "3Ha,b,3.")], "'3Ha,b'; needs a number"),
    "blank inside": ([LINE.replace("2.,3.", "2. 5,3.")], r"'2\. 5'"),
    "flag": ([LINE.replace("0,0,1,0,", "0,0,2,0,")], "parameter 5 2; needs 0 or 1"),
    "knots": ([LINE.replace("0.,0.,1.,1.", "0.,0.,1.,.5", 1)], r"knots\[3\] is 0\.5; needs at least knots\[2\] = 1"),
    "weights": ([LINE.replace("1.,1.,1.,1.,", "1.,1.,1.,0.,").replace("0,0,1,0,", "0,0,0,0,")], "not positive: 0"),
    "polynomial": ([LINE.replace("1.,1.,1.,1.,", "1.,1.,1.,2.,")], "polynomial, and its weights differ"),
    "beyond": ([LINE.replace("3.,0.,1.,", "3.,0.,2.,")], "runs from 0 to 2; its knots have the domain 0 to 1"),
    "a bit beyond": ([LINE.replace("3.,0.,1.,", "3.,0.,1.00000001,")], r"from 0 to 1\.00000001; .* domain 0 to 1"),
    "backwards": ([LINE.replace("3.,0.,1.,", "3.,1.,0.,")], "runs from 1 to 0"),
    "no end": ([LINE.replace(";", ",")], "a record has no end at ''; needs ';'"),
    "long string": (["126,70000Habc;"], "a record has no end at '70000Habc;'"),
    "no matrix": ([(LINE, {"matrix": 3})], "D3, the matrix of D1, is not a transformation matrix"),
    "matrix of another type": ([(LINE, {"matrix": 1})], "D1, the matrix of D1, is not a"),
    "matrix of itself": ([(LINE, {"matrix": 3}), (TURN, {"matrix": 5}), (TURN, {"matrix": 3})], "refers to itself"),
    "form of a matrix": ([(LINE, {"matrix": 3}), (TURN, {"form": 11})], r"entity 124 \(D3\) is of form 11"),
    "matrix not finite": ([(LINE, {"matrix": 3}), TURN.replace("10.", "1E999")], "not finite"),
    "moved beyond": (
        [(LINE, {"matrix": 3}), TURN.replace("10.,1.", "1E308,1E308").replace("-1.", "-1E308")],
        "not finite",
    ),
    "short matrix": ([(LINE, {"matrix": 3}), "124,1.,0.;"], "has 2 parameters; needs 12"),
    "composite of planes": (["102,1,3;", "108,0.;"], r"names D3, entity 108; its parts must be lines \(110\), circ"),
    "composite of nothing": (["102,1,9;"], "names D9, which is not there"),
    "empty composite": (["102,0;"], "has 0 parts"),
    "short composite": (["102,999999999,1;"], "has 2 parameters; needs 1000000000"),
    "part twice": (
        ["102,2,3,3;", (LINE, {"status": "00010000"})],
        "names D3, which is part of a composite curve already",
    ),
    "status": ([(LINE, {"status": "0000000x"})], r"the status of D1 is '0000000x'; needs 8 digits"),
    "long number": ([LINE.replace("2.,3.", "1" * 60_000 + "x,3.")], r"'111+\.\.\.; needs a number"),
    "long text": ([LINE.replace("2.,3.", "x" * 5000 + ",3.")], r"'xxx+\.\.\.; needs a number"),
}


@pytest.mark.parametrize("name", ENTITIES)
def test_entities_that_cannot_be_read_are_refused_by_name_and_line(tmp_path, name):
    entities, message = ENTITIES[name]
    with pytest.raises(ParseError, match=message) as caught:
        load_iges(written(tmp_path, sheet(*entities)))
    assert str(caught.value).count("\n") == 0 and len(caught.value.reason) < 300


def changed(old, new, count=1):
    content = sheet(LINE)
    assert old in content
    return content.replace(old, new, count)


LAYOUTS = {
    "empty": (b"", "has no start section"),
    "a picture": (b"\x89PNG\r\n\x1a\n", r"a\.igs:1: a line of IGES has 80 columns; this one has 4"),
    "truncated": (sheet(LINE)[:-120], r"a\.igs:6: a line of IGES has 80 columns; this one has 42"),
    "without its end": (sheet(LINE)[:-81], r"a\.igs:6: has no terminate section \(T\)"),
    "short line": (changed(b" G", b"G"), "this one has 79"),
    "lower case": (
        changed(b"G      1", b"g      1"),
        r"a\.igs:2: column 73 is 'g'; needs the letter of a section, S, G, D, P, T",
    ),
    "order": (changed(b"D      2", b"G      2"), r"a\.igs:4: column 73 is 'G'; needs .* D, P, T"),
    "numbers of lines": (changed(b"D      2", b"D      3"), r"a\.igs:4: columns 74 to 80 are '      3'; needs 2"),
    "compressed": (changed(b"S      1", b"C      1"), "binary and the compressed format"),
    "terminate": (changed(b"D0000002", b"D0000004"), "the terminate section has 'D0000004'; there are 2 lines of D"),
    "behind the end": (sheet(LINE) + sheet(LINE)[-81:], "columns 74 to 80 are '      1'; needs 2"),
    "delimiters": (changed(b"1H,,1H;,", b"1H,,1H,,"), "cannot be used"),
    "digits as delimiters": (changed(b"1H,,1H;,", b"1H1,1H;1"), "needs 1H,, or a comma"),
    "no delimiters": (changed(b"1H,,1H;,", b"part,,;,"), "the global section begins with 'part,,;,4Hpa'"),
    "global without an end": (changed(b"2HMM;", b"2HMM,"), r"a\.igs:2: a record has no end at ''"),
    "count of lines": (
        changed(b"       0       2       0", b"       0       9       0"),
        r"a\.igs:3: D1 points to 9 parameter lines",
    ),
    "no count": (changed(b"       0       2       0", b"       0       0       0"), "D1 points to 0 parameter lines"),
    "pointer": (
        changed(b"     126       1", b"     126  999999"),
        "D1 points to 2 parameter lines from 999999; there are 2",
    ),
    "pointer to no number": (
        changed(b"     126       1", b"     126       x"),
        r"a\.igs:3: columns 9 to 16 are 'x'; needs an int",
    ),
    "back pointer": (changed(b"       1P", b"       3P"), r"a\.igs:5: a parameter line of D1 names '3'"),
    "types differ": (
        changed(b"     126       0", b"     128       0"),
        r"a\.igs:4: D1 is of type 126; its second line differs",
    ),
    "another type of parameters": (changed(b"126,1,1", b"128,1,1"), r"entity 126 \(D1\) begins with '128'"),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_layout_that_is_not_that_of_the_standard_is_refused_with_its_line(tmp_path, name):
    content, message = LAYOUTS[name]
    with pytest.raises(ParseError, match=message) as caught:
        load_iges(written(tmp_path, content))
    assert str(caught.value).count("\n") == 0 and len(caught.value.reason) < 300


def test_a_directory_entry_of_one_line_is_refused(tmp_path):
    lines = sheet(LINE).splitlines(keepends=True)
    text = b"".join(lines[:3] + lines[4:]).replace(b"D0000002", b"D0000001")
    with pytest.raises(ParseError, match="a directory entry has two lines; the last one has one"):
        load_iges(written(tmp_path, text))


def test_a_long_run_of_blanks_and_a_long_chain_of_matrices_take_their_length(tmp_path):
    chain = [(TURN, {"matrix": 2 * k + 5}) for k in range(100)] + [TURN]
    (line,) = shapes(tmp_path, (LINE, {"matrix": 3}), *chain)
    assert np.isfinite(line.control_points).all()
    with pytest.raises(ParseError, match="a record has no end"):
        load_iges(written(tmp_path, sheet("126,1H" + " " * 200_000)))


def test_a_file_that_is_missing_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.igs: no such file\.$"):
        jhd.io.load_shape(str(tmp_path / "none.igs"))
