"""SVG files: placement against hand-computed matrices and svgelements, round trips, every error with its place."""

import math

import numpy as np
import pytest
import svgelements

from jhd._io.errors import ParseError
from jhd._io.svg import load_svg, parse_path, save_svg
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.curve import BezierSegments
from jhd._shapes.simple_curves import circle, point_set, polyline

# What placement may cost: a few roundings of coordinates of order one hundred.
PLACEMENT = 1e-12
# Where the tests run with types checked at every call, that check comes first.
TYPE_CHECKED = "|^Type-check error"


def written(folder, body, attributes=""):
    file = folder / "drawing.svg"
    file.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" {attributes}>{body}</svg>',
        encoding="utf-8",
    )
    return file


def read(folder, body, attributes="", **options):
    return load_svg(written(folder, body, attributes), **options)


def starts(curve):
    return np.asarray(curve.control_points)[:, 0]


def matrix(a, b, c, d, e, f):
    return np.array([[a, c, e], [b, d, f], [0, 0, 1.0]])


def rotation(degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return matrix(c, s, -s, c, 0, 0)


def image(of, *rows):
    return np.array([(of @ [x, y, 1])[:2] for x, y in rows])


def test_path_reads_path_data():
    curve = parse_path("M0 0H2V1Z")
    np.testing.assert_array_equal(curve.control_points, [[[0, 0], [2, 0]], [[2, 0], [2, 1]], [[2, 1], [0, 0]]])
    assert curve.next_segment.tolist() == [1, 2, 0]


def test_path_refuses_what_draws_nothing_and_what_is_no_text():
    with pytest.raises(ParseError, match="draws nothing"):
        parse_path("M1 2")
    with pytest.raises(ParseError, match="^line 1, column 7: path data: needs a number"):
        parse_path("M1 2 L")
    with pytest.raises(TypeError, match="d must be a string of SVG path data; got int" + TYPE_CHECKED):
        parse_path(3)  # pyright: ignore[reportArgumentType]


def test_a_drawing_without_groups_keeps_its_numbers_whatever_the_paper(tmp_path):
    d = "M0.1 0.2L30.7 1e-3"
    curve = read(tmp_path, f'<path d="{d}"/>', 'width="10cm" height="5cm" viewBox="-7 3 100 50"')
    np.testing.assert_array_equal(curve.control_points, parse_path(d).control_points)


def test_nested_transforms_compose_from_outside_in(tmp_path):
    body = """
      <g transform="translate(10, 20) rotate(30)"><g transform="scale(2 -3)">
        <path transform="matrix(1 0.5 -0.25 2 3 4) skewX(20)" d="M1 2L3 4"/>
      </g></g><g transform="rotate(40 5 6),skewY(-10)"><line x1="1" y1="2" x2="7" y2="8"/></g>"""
    curve = read(tmp_path, body)
    first = matrix(1, 0, 0, 1, 10, 20) @ rotation(30) @ matrix(2, 0, 0, -3, 0, 0) @ matrix(1, 0.5, -0.25, 2, 3, 4)
    first = first @ matrix(1, 0, math.tan(math.radians(20)), 1, 0, 0)
    second = matrix(1, 0, 0, 1, 5, 6) @ rotation(40) @ matrix(1, 0, 0, 1, -5, -6)
    second = second @ matrix(1, math.tan(math.radians(-10)), 0, 1, 0, 0)
    np.testing.assert_allclose(curve.control_points[0], image(first, (1, 2), (3, 4)), rtol=PLACEMENT)
    np.testing.assert_allclose(curve.control_points[1], image(second, (1, 2), (7, 8)), rtol=PLACEMENT)


def test_the_style_of_the_root_may_give_the_size_of_the_paper_and_no_place(tmp_path):
    body = '<path d="M0 0L1 0"/>'
    sized = 'width="7" height="3" style="width:100%;height:auto"'
    assert read(tmp_path, body, sized).count == 1
    with pytest.raises(ParseError, match="percentages need a viewBox"):
        read(tmp_path, body + '<line x2="1%"/>', sized)
    with pytest.raises(ParseError, match="<svg> has scale in its style"):
        read(tmp_path, body, 'style="scale:2"')
    with pytest.raises(ParseError, match="draws no path"):
        read(tmp_path, body, 'style="display:none"')


def test_turns_by_right_angles_are_exact(tmp_path):
    curve = read(tmp_path, '<path transform="rotate(90) rotate(180) rotate(-450)" d="M1 2L3 4"/>')
    np.testing.assert_array_equal(curve.control_points, [[[-1, -2], [-3, -4]]])


def test_arcs_stay_exact_under_any_affine_map(tmp_path):
    curve = read(tmp_path, '<g transform="matrix(2 1 -0.5 3 10 20)"><path d="M3 0A3 3 0 1 1 0 -3"/></g>')
    inverse = np.linalg.inv(matrix(2, 1, -0.5, 3, 10, 20))
    t = np.linspace(0, 1, 17)
    for k in range(curve.count):
        local = image(inverse, *np.asarray(curve.point(k, t)))
        np.testing.assert_allclose(np.linalg.norm(local, axis=1), 3.0, rtol=PLACEMENT)


def test_use_places_a_copy_with_its_own_transform(tmp_path):
    body = """
      <defs><g id="pair"><path id="one" transform="scale(2)" d="M1 1L2 1"/></g></defs>
      <use href="#pair" x="10" y="20" transform="rotate(90)"/><use xlink:href="#one"/>"""
    curve = read(tmp_path, body)
    np.testing.assert_array_equal(curve.control_points, [[[-22, 12], [-22, 14]], [[2, 2], [4, 2]]])


def test_definitions_symbols_and_hidden_elements_are_not_drawn(tmp_path):
    body = """
      <defs><path d="M9 9L8 8"/></defs><symbol id="s"><path d="M7 7L6 6"/></symbol>
      <clipPath id="c"><path d="M5 5L4 4"/></clipPath><g display="none"><path d="M3 3L2 2"/></g>
      <g style="fill:red; display : none"><path d="M3 3L2 2"/></g><text>a</text><path d="none"/><path/>
      <path visibility="hidden" d="M1 1L2 2"/>
      <path style="/*;*/ Visibility: COLLAPSE" visibility="visible" d="M1 1L2 2"/>
      <g visibility="hidden"><path d="M1 1L2 2"/><use href="#v"/>
        <path style="visibility:visible!important" d="M1 0L2 0"/></g>
      <style>.a:hover, path { fill: red; stroke-width: 2px; visibility: visible } /* r: 1 */</style>
      <g style="display:inline"><path d="M0 0L1 0" id="v"/></g>"""
    assert starts(read(tmp_path, body)).tolist() == [[1, 0], [0, 0]]


def test_drawings_of_visible_groups_keep_their_numbers(tmp_path):
    body = '<g style="display:inline"><path d="M0 0L1 0"/></g>'
    np.testing.assert_array_equal(read(tmp_path, body).control_points, [[[0, 0], [1, 0]]])


# Where the corners of a box of 10 x 10 come to lie in a viewport of 40 x 20.
ASPECTS = {
    "": [[10, 0], [30, 20]],
    "xMinYMin": [[0, 0], [20, 20]],
    "xMaxYMax meet": [[20, 0], [40, 20]],
    "xMidYMid slice": [[0, -10], [40, 30]],
    "xMinYMax slice": [[0, -20], [40, 20]],
    "none": [[0, 0], [40, 20]],
}


@pytest.mark.parametrize("aspect", ASPECTS)
@pytest.mark.parametrize("kind", ["svg", "symbol"])
def test_nested_view_boxes_are_scaled_to_their_size(tmp_path, kind, aspect):
    shape, size = '<path d="M5 5L15 15"/>', 'x="100" y="200" width="40" height="20"'
    par = f'preserveAspectRatio="{aspect}"' if aspect else ""
    if kind == "svg":
        body = f'<svg {size} viewBox="5 5 10 10" {par}>{shape}</svg>'
    else:
        body = f'<use href="#s" {size}/><symbol id="s" viewBox="5 5 10 10" {par}>{shape}</symbol>'
    curve = read(tmp_path, body)
    np.testing.assert_allclose(curve.control_points[0], np.array(ASPECTS[aspect]) + [100, 200], rtol=PLACEMENT)


def test_lengths_have_units_and_percentages_of_the_nearest_viewport(tmp_path):
    body = """<line x1="1in" y1="2.54cm" x2="50%" y2="25%"/>
      <svg width="20" height="10" viewBox="0 0 4 2"><line x1="100%" y1="100%" x2="25.4mm" y2="3pt"/></svg>"""
    curve = read(tmp_path, body, 'viewBox="0 0 200 80"')
    expected = [[[96, 96], [100, 20]], [[20, 10], [480, 20]]]
    np.testing.assert_allclose(curve.control_points, expected, rtol=1e-15)
    sized = read(tmp_path, '<circle cx="50%" cy="50%" r="10%"/>', 'width="30" height="40"')
    radius = 0.1 * math.sqrt((30**2 + 40**2) / 2)
    np.testing.assert_allclose(starts(sized)[0], [15 + radius, 20], rtol=1e-15)
    # 50 times a hundredth of 7 is 3.5000000000000004.
    assert read(tmp_path, '<line x2="50%"/>', 'width="7" height="1"').control_points[0, 1, 0] == 3.5
    huge = read(tmp_path, '<circle r="1%"/>', 'width="1e200" height="1e200"')
    np.testing.assert_allclose(starts(huge)[0], [1e198, 0], rtol=1e-15)


SHAPES = {
    "rect": '<rect x="1" y="2" width="30" height="10"/>',
    "rect with round corners": '<rect x="1" y="2" width="30" height="10" rx="3" ry="2"/>',
    "rect with one radius": '<rect x="1" y="2" width="30" height="10" rx="3"/>',
    "rect that is all corners": '<rect x="0.1" y="0.2" width="0.3" height="0.7" rx="9" ry="9"/>',
    "circle": '<circle cx="4" cy="5" r="3"/>',
    "ellipse": '<ellipse cx="4" cy="5" rx="3" ry="1"/>',
    "line": '<line x1="1" y1="2" x2="3" y2="5"/>',
    "polyline": '<polyline points="1,2 3,4,5-6 7 8"/>',
    "polygon": '<polygon points="1,2 3,4 5 -6"/>',
    "path with arcs": '<path d="M1 1a4 2 30 1 0 2 3zq1 2 3 4t1 1l-3 2z"/>',
}


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_agree_with_svgelements(tmp_path, name):
    placed = f'<g transform="rotate(25) translate(3 4)">{SHAPES[name]}</g>'
    file = written(tmp_path, placed)
    curve = load_svg(file)
    shape = next(e for e in svgelements.SVG.parse(str(file)).elements() if isinstance(e, svgelements.Shape))
    segments = [
        s for s in svgelements.Path(shape).segments() if not isinstance(s, svgelements.Move) and s.length() > 1e-9
    ]
    fine = [segment.point(t) for segment in segments for t in np.linspace(0, 1, 400)]
    theirs = np.array([complex(p.x, p.y) for p in fine])
    t = np.linspace(0, 1, 13)
    sampled = np.concatenate([np.asarray(curve.point(k, t)) for k in range(curve.count)])
    ours = sampled[:, 0] + 1j * sampled[:, 1]
    spacing = np.abs(np.diff(theirs)).max() if len(segments) == 1 else 40 / 399
    gaps = np.abs(ours[:, None] - theirs)
    assert gaps.min(axis=1).max() <= spacing
    # And the corners of theirs are corners of ours.
    ends = np.array([complex(s.end.x, s.end.y) for s in segments])
    assert np.abs(ends[:, None] - ours).min(axis=1).max() <= 1e-9


@pytest.mark.parametrize("name", ["rect", "rect with round corners", "circle", "ellipse", "polygon"])
def test_closed_shapes_are_one_closed_contour(tmp_path, name):
    curve = read(tmp_path, SHAPES[name])
    assert curve.next_segment.tolist() == [*range(1, curve.count), 0]


def test_a_rectangle_that_is_all_corners_has_no_sides_of_an_ulp(tmp_path):
    assert read(tmp_path, SHAPES["rect that is all corners"]).count == 4


def test_circles_are_the_package_circles(tmp_path):
    ours, own = read(tmp_path, SHAPES["circle"]), circle([4, 5], 3)
    np.testing.assert_array_equal(ours.control_points, own.control_points)
    np.testing.assert_array_equal(ours.weights, own.weights)


def test_shapes_without_size_are_not_drawn(tmp_path):
    body = '<rect width="0" height="3"/><circle r="0"/><ellipse rx="1" ry="0"/><polyline points=""/>'
    assert read(tmp_path, body + '<line x2="1"/>').count == 1


def test_shapes_of_one_file_are_joined_in_one_degree(tmp_path):
    curve = read(tmp_path, '<line x2="1"/><path d="M5 5Q6 6 7 5"/><circle r="2"/>')
    assert (curve.degree, curve.count) == (2, 6)
    assert curve.next_segment.tolist() == [-1, -1, 3, 4, 5, 2]


def test_elements_are_chosen_by_id(tmp_path):
    body = """<g id="group" transform="translate(10)"><path id="a" d="M0 0L1 0"/><path id="b" d="M2 0L3 0"/></g>
      <use id="copy" href="#a"/>"""
    file = written(tmp_path, body)
    for ids, first in (("a", [10, 0]), ("b", [12]), ("group", [10, 12]), ("copy", [0]), (["b", "copy"], [12, 0])):
        assert starts(load_svg(file, ids))[:, 0].tolist() == first
    with pytest.raises(ParseError, match="drawing.svg: draws nothing of id 'c'; ids that draw: a, b, copy, group"):
        load_svg(file, ids=["a", "c"])


def test_y_up_mirrors(tmp_path):
    np.testing.assert_array_equal(
        read(tmp_path, '<path d="M1 2L3 4"/>', y_up=True).control_points[0], [[1, -2], [3, -4]]
    )


def awkward(shape, seed=7):
    """Floats of many sizes, all of their digits in use."""
    random = np.random.default_rng(seed)
    return random.normal(size=shape) * 10.0 ** random.integers(-9, 9, size=shape)


@pytest.mark.parametrize("degree", [1, 2, 3])
@pytest.mark.parametrize("y_up", [False, True])
def test_what_is_written_is_read_back_bit_for_bit(tmp_path, degree, y_up):
    curve = BezierSegments(awkward((5, degree + 1, 2)))
    save_svg(tmp_path / "out.svg", curve, y_up=y_up)
    again = load_svg(tmp_path / "out.svg", y_up=y_up)
    np.testing.assert_array_equal(again.control_points, curve.control_points)
    np.testing.assert_array_equal(again.next_segment, curve.next_segment)
    assert again.weights is None


def test_contours_and_joints_survive_the_round_trip(tmp_path):
    square, open_line = polyline(awkward((4, 2)), closed=True), polyline(awkward((3, 2), seed=8))
    spline = BSplineCurve.uniform(np.random.default_rng(3).normal(size=(6, 2)), periodic=True)
    for curve in (BezierSegments.join([square, open_line, square]), spline.segments()):
        save_svg(tmp_path / "out.svg", curve)
        again = load_svg(tmp_path / "out.svg")
        np.testing.assert_array_equal(again.control_points, curve.control_points)
        np.testing.assert_array_equal(again.next_segment, curve.next_segment)


def test_several_curves_are_paths_of_their_own(tmp_path):
    curves = [BezierCurve([[0, 0], [1, 2], [2, 0]]), polyline([[0, 0], [3, 1]])]
    save_svg(tmp_path / "out.svg", curves)
    for index, curve in enumerate(curves):
        again = load_svg(tmp_path / "out.svg", ids=f"curve{index}")
        np.testing.assert_array_equal(again.control_points, curve.segments().control_points)


def test_the_text_is_returned_and_other_readers_agree(tmp_path):
    text = save_svg(None, polyline([[0, 0], [3, 1], [1, 2]], closed=True))
    assert 'd="M0.0,0.0 L3.0,1.0 L1.0,2.0 L0.0,0.0 Z"' in text
    assert 'viewBox="-0.15 -0.15 3.3 2.3"' in text
    (tmp_path / "out.svg").write_text(text, encoding="utf-8")
    shapes = [e for e in svgelements.SVG.parse(str(tmp_path / "out.svg")).elements() if isinstance(e, svgelements.Path)]
    assert len(shapes) == 1


@pytest.mark.parametrize(
    ("curves", "error", "message"),
    [
        (
            BezierCurve([[0, 0], [1, 2], [2, 0]], [1, 3, 1]),
            ValueError,
            "the curve is rational; .* give tolerance for cubics",
        ),
        (point_set([[0, 0]]), ValueError, r"curves\[0\] has degree 0; SVG paths hold no points"),
        (BezierCurve(np.ones((5, 2))), ValueError, "the curve has degree 4; .* give tolerance"),
        (polyline([[0, 0, 0], [1, 1, 1]]), ValueError, r"curves\[0\] has 3 coordinates a point; SVG needs 2"),
        ([], ValueError, "curves is empty"),
        ([3], TypeError, r"curves\[0\] must be a curve" + TYPE_CHECKED),
    ],
)
def test_what_path_data_cannot_hold_is_refused(curves, error, message):
    with pytest.raises(error, match=message):
        save_svg(None, curves)


ERRORS = {
    "transform in a style": (
        '<g style="transform:translate(1px)"/>',
        "<g> has transform in its style, which is not read",
    ),
    "rotate in a style": ('<path style="rotate: 9deg"/>', "<path> has rotate in its style"),
    "no transform in a style": (
        '<path transform="scale(2)" style="transform:none"/>',
        "<path> has transform in its style",
    ),
    "origin": ('<g transform="scale(2)" transform-origin="4 0"/>', "<g> has transform-origin, which is not read"),
    "size in a style": ('<circle r="2" style="fill:red;R:5px"/>', "<circle> has r in its style"),
    "path in a style": ("<path style=\"d:parse_path('M0 0L1 1')\"/>", "<path> has d in its style"),
    "sheet that hides": (
        "<style>.a{fill:red}.b{display:none}</style>",
        "<style> sets 'display: *none', and style sheets",
    ),
    "sheet elsewhere": ("<style>@import url(a.css);</style>", "<style> sets '@import url.a.css.', and style sheets"),
    "language": ('<path systemLanguage="de" d="M0 0L1 1"/>', "<path> has systemLanguage, which is not read"),
    "sheet that moves": ("<style>.a { fill:red; Transform : scale(2) }</style>", "<style> sets 'transform :'"),
    "long length": ('<line x1="1e999"/>', "<line> has x1 '1e999', which is beyond the range of doubles"),
    "far side": ('<rect x="1e308" width="1.7e308" height="1"/>', "<rect> draws points beyond the range"),
    "path": ('<path d="M0 0\nL1 x"/>', "<path> path data: needs a number; found 'x'. .column 9 of d."),
    "unknown transform": ('<g transform="turn(3)"/>', r"<g> has transform 'turn\(3\)'; known are matrix of 6"),
    "transform values": ('<g transform="matrix(1 2 3)"/>', r"<g> has transform 'matrix\(1 2 3\)'; known are"),
    "transform text": ('<g transform="scale(2"/>', r"<g> has transform 'scale\(2'; needs functions"),
    "transform number": ('<g transform="scale(a)"/>', "<g> transform: needs a number; found 'a'"),
    "unit": ('<line x1="3em"/>', "<line> has x1 '3em'; needs a number, perhaps with px, in, cm, mm, pt, pc or %"),
    "no length": ('<circle r="big"/>', "<circle> has r 'big'; needs a number"),
    "percentage": ('<line x1="3%"/>', "<line> has x1 '3%'; percentages need a viewBox"),
    "negative size": ('<rect width="-1" height="2"/>', "<rect> has width -1; needs a length that is not negative"),
    "negative radius": ('<circle r="-1"/>', "<circle> has r -1; needs a length that is not negative"),
    "points": ('<polyline points="1 2 3"/>', "<polyline> has 3 numbers in points; needs pairs"),
    "points text": ('<polygon points="1 2;3"/>', "<polygon> points: needs a number; found ';'"),
    "outside": ('<use href="b.svg#x"/>', "<use> refers to 'b.svg#x'; only elements of the same file"),
    "missing": ('<use href="#x"/>', "<use> refers to '#x'; the file has no element of that id"),
    "cycle": ('<g id="x"><use href="#x"/></g>', "<use> refers to '#x', which uses itself"),
    "view box": ('<svg viewBox="0 0 0 1"/>', "<svg> has viewBox '0 0 0 1'; needs x, y and a positive"),
    "aspect": (
        '<svg width="1" height="1" viewBox="0 0 1 1" preserveAspectRatio="mid"/>',
        "<svg> has preserveAspectRatio 'mid'; needs for example",
    ),
}


def test_of_a_switch_the_first_child_whose_conditions_hold_is_drawn(tmp_path):
    body = """<switch><title>t</title><path requiredExtensions="x" systemLanguage="de" d="M5 0L6 0"/>
      <path d="M1 0L2 0"/><path systemLanguage="de" d="M3 0L4 0"/></switch>
      <path requiredExtensions="x" d="M7 0L8 0"/>"""
    assert starts(read(tmp_path, body)).tolist() == [[1, 0]]


def test_a_style_sheet_in_another_file_is_refused(tmp_path):
    text = '<?xml-stylesheet href="a.css"?>\n<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0L1 1"/></svg>'
    (tmp_path / "a.svg").write_text(text)
    with pytest.raises(ParseError, match=r"a\.svg:1:1: names a style sheet, which is not read"):
        load_svg(tmp_path / "a.svg")


@pytest.mark.parametrize("name", ERRORS)
def test_errors_name_the_file_the_line_the_column_and_the_element(tmp_path, name):
    body, message = ERRORS[name]
    file = written(tmp_path, "\n<g>\n  " + body + "</g>")
    with pytest.raises(ParseError, match=rf"drawing\.svg:3:\d+: {message}") as caught:
        load_svg(file)
    assert (caught.value.file, caught.value.line) == (str(file), 3)
    assert caught.value.column in (3, 3 + body.find("<use"))
    assert "\n" not in str(caught.value)


def test_broken_xml_has_its_line_and_column(tmp_path):
    file = written(tmp_path, "\n<g></path>")
    with pytest.raises(ParseError, match=r"drawing\.svg:2:6: XML: mismatched tag\.$"):
        load_svg(file)
    file.write_text("", encoding="utf-8")
    with pytest.raises(ParseError, match=r"drawing\.svg:1:1: XML: no element found\.$"):
        load_svg(file)


def test_files_that_are_missing_or_no_svg_or_empty_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.svg: no such file\.$"):
        load_svg(tmp_path / "none.svg")
    file = written(tmp_path, "")
    with pytest.raises(ParseError, match=r"drawing\.svg: draws no path, rect"):
        load_svg(file)
    file.write_text("<html/>", encoding="utf-8")
    with pytest.raises(ParseError, match=r"drawing\.svg:1:1: <html> is the root; an SVG file has <svg> there"):
        load_svg(file)


def test_declared_encodings_and_entities_are_read(tmp_path):
    file = tmp_path / "latin.svg"
    text = '<?xml version="1.0" encoding="ISO-8859-1"?><!DOCTYPE svg [<!ENTITY two "2">]>'
    text += '<svg><path id="é" d="M0 0L&two; 0"/></svg>'
    file.write_bytes(text.encode("latin-1"))
    np.testing.assert_array_equal(load_svg(file, ids="é").control_points, [[[0, 0], [2, 0]]])
