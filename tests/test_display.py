"""What objects print: a person sees kinds, counts and numbers, and printing never fails."""

import re
import sys
from html import escape
from typing import Any, cast
from xml.etree import ElementTree

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
import jhd.io
from jhd._distance.collections.pivots import PivotDistances
from jhd._results import display
from jhd._results.solution import name_of
from jhd._shapes import sketches
from jhd._shapes.polynomial_text import read, written
from tests.test_solution import a_solution

NET = np.arange(27.0).reshape(3, 3, 3)
KNOTS = [0.0, 0, 0, 1, 1, 1]
SHOWN = {
    "BezierCurve(degree 2, in the plane, box (0, 0) to (2, 1))": lambda: jhd.BezierCurve([(0, 0), (1, 1), (2, 0)]),
    "BezierCurve(degree 1, rational, in space, box (0, 0, 0) to (1, 2, 3))": lambda: jhd.BezierCurve(
        [(0, 0, 0), (1, 2, 3)], [1, 2]
    ),
    "BSplineCurve(degree 2, 3 control points, open, in the plane, box (0, 0) to (2, 1))": lambda: jhd.BSplineCurve(
        [(0, 0), (1, 1), (2, 0)], KNOTS
    ),
    "BezierSegments(3 segments of degree 1, closed, in the plane, box (0, 0) to (1, 1))": lambda: jhd.polyline(
        [(0, 0), (1, 0), (1, 1)], closed=True
    ),
    "BezierSegments(2 segments of degree 1, open, in the plane, box (0, 0) to (1, 1))": lambda: jhd.polyline(
        [(0, 0), (1, 0), (1, 1)]
    ),
    "BezierSegments(2 segments of degree 1, 2 open ends, in the plane, box (0, 0) to (3, 0))": lambda: (
        jhd.BezierSegments([[(0, 0), (1, 0)], [(2, 0), (3, 0)]])
    ),
    "BezierSegments(1 point, in the plane, box (0.5, 2) to (0.5, 2))": lambda: jhd.point_set([(0.5, 2)]),
    "BezierPatch(degrees 2 x 2, in space, box (0, 1, 2) to (24, 25, 26))": lambda: jhd.BezierPatch(NET),
    "BezierPatches(1 patch, degrees 2 x 2, in space, box (0, 1, 2) to (24, 25, 26))": lambda: jhd.BezierPatches(
        NET[None]
    ),
    "BSplineSurface(3 x 3 control points, degrees 2 x 2, in space, box (0, 1, 2) to (24, 25, 26))": lambda: (
        jhd.BSplineSurface(NET, KNOTS, KNOTS)
    ),
    "TriangleMesh(3 vertices, 1 triangle, box (0, 0, 0) to (1, 1, 1))": lambda: jhd.TriangleMesh(
        np.eye(3), [[0, 1, 2]]
    ),
    "ImplicitSurface(x**2 + y**2 - 2*z - 0.5 = 0, box (-1, -1, -1) to (1, 1, 1))": lambda: jhd.ImplicitSurface.parse(
        "x^2 + y^2 - 2 z - 1/2".replace(" z", "*z"), [-1] * 3, [1] * 3
    ),
    "ImplicitSurface(polynomial of degree 4 with 15 terms, box (0, 0, 0) to (1, 1, 1))": lambda: (
        jhd.ImplicitSurface.parse("(x + y + z/3)**4 - 1/7*(x + y)**4 + 0*x", [0] * 3, [1] * 3)
    ),
    "BranchAndBound(rtol=0, atol=0.001, max_steps=4000, queue_size=512)": lambda: jhd.BranchAndBound(atol=1e-3),
    "PivotDistances(2 shapes from 4 points)": lambda: PivotDistances(
        np.zeros((4, 2)), np.zeros((2, 4)), np.zeros((2, 4)), np.zeros(2)
    ),
}


@pytest.mark.parametrize("text", SHOWN)
def test_objects_print_what_they_are(text):
    assert repr(SHOWN[text]()) == text


@pytest.mark.parametrize("make", SHOWN.values())
def test_objects_print_with_whatever_jax_puts_into_them(make):
    thing = make()
    arrays, static = eqx.partition(thing, eqx.is_array)
    seen = []

    def look(x):
        seen.append(repr(eqx.combine(x, static)))
        return x

    jax.eval_shape(look, arrays)
    jax.eval_shape(jax.vmap(look), jax.tree_util.tree_map(lambda x: np.stack([x, x]), arrays))
    seen.append(repr(jax.tree_util.tree_map(lambda x: object(), thing)))
    seen.append(repr(jax.tree_util.tree_map(lambda x: jax.ShapeDtypeStruct(np.shape(x), float), thing)))
    seen.append(repr(jax.tree_util.tree_map(lambda x: np.stack([x, x]), thing)))
    for text in seen:
        assert text.startswith(type(thing).__name__ + "(") and len(text) < 400
        assert not re.search(r"[fi]64\[|object at 0x|Traced<", text)


def test_what_a_batch_prints_says_how_many_there_are():
    curve = jhd.BezierCurve([(0, 0), (1, 1), (2, 0)])
    batch = jax.tree_util.tree_map(lambda x: np.stack([x, x + 1]), curve)
    assert repr(batch) == "BezierCurve(batch of 2, degree 2, in the plane, box (0, 0) to (3, 2))"


def test_a_polynomial_is_written_as_it_is_read():
    coefficients = np.zeros((2, 3, 2))
    coefficients[1, 2, 0], coefficients[0, 0, 1], coefficients[1, 0, 0], coefficients[0, 0, 0] = 1, -1, 0.25, -3
    text = written(coefficients)
    assert text == "x*y**2 + 0.25*x - z - 3"
    assert {index: float(x) for index, x in read(text).items()} == {
        tuple(int(i) for i in index): coefficients[tuple(index)] for index in np.argwhere(coefficients)
    }


def test_values_print_in_few_characters():
    assert display.value_text(np.float64(0.1) + 0.2) == "0.3"
    assert display.value_text(np.arange(3)) == "[0, 1, 2]"
    assert display.value_text(np.zeros((4, 3))) == "4 x 3 array"
    assert display.value_text(None) == "None"
    assert display.count_text(2, "patch", "patches") == "2 patches"


@pytest.mark.parametrize("name", ["max_steps", "queue_size"])
def test_an_option_of_the_method_says_where_it_belongs(name):
    line = jhd.polyline([(0, 0), (1, 0)])
    call: Any = jhd.hausdorff
    with pytest.raises(TypeError, match=rf"hausdorff\(\) takes no {name}: write method=jhd.BranchAndBound\({name}"):
        call(line, line, **{name: 1})


def test_a_degree_handed_to_a_spline_of_knots_says_what_takes_it():
    with pytest.raises(TypeError, match=r"BSplineCurve\(\) takes no degree: .*BSplineCurve.clamped"):
        jhd.BSplineCurve([(0, 0), (1, 1), (2, 0)], degree=2)  # pyright: ignore[reportCallIssue]


def test_lists_of_shapes_and_transposed_points_are_told_what_to_do():
    line = jhd.polyline([(0, 0), (1, 0)])
    with pytest.raises(TypeError, match=r"a: a list of 2 shapes is not one shape; use jhd.pairwise.* jhd.stack_curves"):
        jhd.hausdorff([line, line], line)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"shape is \(2, 4\); points are rows"):
        jhd.BezierCurve(np.zeros((2, 4)))
    with pytest.raises(ValueError, match=r"\(3, 9\).*Points are rows"):
        jhd.point_set(np.zeros((3, 9)))


MESH = jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
LINE = jhd.polyline([(0, 0), (1, 0)])
# A call with a usual slip, and what is said.
SLIPS: dict[str, tuple[Any, str]] = {
    "project": (
        lambda: jhd.project(cast(Any, MESH), [(0.0, 0, 0)]),
        "points is a TriangleMesh; project takes an array .* first",
    ),
    "signed": (
        lambda: jhd.signed_distance(cast(Any, MESH), [(0.0, 0, 0)]),
        "a TriangleMesh; signed_distance takes an array",
    ),
    "stationary": (
        lambda: jhd.stationary_points(cast(Any, LINE), [(0.0, 0)]),
        "a BezierSegments; stationary_points takes",
    ),
    "mesh alone": (
        lambda: cast(Any, jhd.TriangleMesh)(MESH),
        r"TriangleMesh\(\) needs 2 arguments, got one: .*as_shape",
    ),
    "scipy": (lambda: jhd.io.to_scipy(cast(Any, MESH)), "shape must be a curve or a parametric surface; got"),
    "svg": (lambda: jhd.io.save_svg(None, cast(Any, MESH)), "must be a curve .* got TriangleMesh"),
    "saved": (lambda: jhd.io.save_curve("none.svg", cast(Any, MESH)), "curve must be a curve .* got TriangleMesh"),
    "neighbors": (
        lambda: jhd.plot.neighbors(cast(Any, None), [LINE], cast(Any, [LINE])),
        "found is a list; needs the result of jhd.nearest_shapes",
    ),
    "color": (lambda: cast(Any, jhd.plot.meshes)([MESH], color="red"), r"meshes\(\) takes no color: write colors="),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_usual_slips_are_named_with_the_way_out(slip):
    call, message = SLIPS[slip]
    with pytest.raises(TypeError, match=f"{message}|^Type-check error"):
        call()


def test_meshes_of_other_packages_are_told_how_to_install_them(monkeypatch):
    for name, extra in (("pyvista", "pyvista"), ("trimesh", "mesh")):
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(ImportError, match=rf"pip install jhd\[{extra}\]"):
            getattr(MESH, f"to_{name}")()


@pytest.mark.parametrize("text", SHOWN)
def test_notebooks_see_a_picture_of_every_shape_that_has_lines(text):
    picture = getattr(SHOWN[text](), "_repr_svg_", lambda: None)()
    if not text.startswith(("Bezier", "BSpline", "TriangleMesh")):
        assert picture is None
        return
    root = ElementTree.fromstring(str(picture))
    assert root.tag.endswith("svg") and root[0].text == text
    numbers = [float(x) for x in re.findall(r"-?\d+\.\d", " ".join(str(child.attrib) for child in root.iter()))]
    width, height = float(root.attrib["width"]), float(root.attrib["height"])
    assert min(numbers) >= 0 and max(numbers) <= max(width, height) + 1
    assert round(max(width, height)) == (16 if "1 point" in text else 296)


def test_the_picture_of_a_curve_passes_through_it():
    quarter = jhd.BezierCurve([(1, 0), (1, 1), (0, 1)], [1, np.sqrt(0.5), 1])
    places = sketches.along(np.asarray(quarter.control_points)[None], np.asarray(quarter.weights)[None])
    assert np.allclose(np.linalg.norm(places, axis=-1), 1)
    sheet = np.stack([np.asarray(quarter.segments().control_points)[0]] * 2)
    sheet = np.concatenate([sheet, np.array([0.0, 1.0])[:, None, None] * np.ones((2, 3, 1))], axis=-1)[None]
    lines = sketches.across(sheet, np.stack([np.asarray(quarter.weights)] * 2)[None])
    assert lines.shape == (10, sketches.PLACES, 3)
    assert np.allclose(np.linalg.norm(lines[..., :2], axis=-1), 1)


def test_what_is_not_known_has_no_picture():
    curve = jhd.BezierCurve([(0, 0), (1, 1), (2, 0)])
    batch = jax.tree_util.tree_map(lambda x: np.stack([x, x + 1]), curve)
    seen = []
    jax.eval_shape(lambda x: seen.append(x._repr_svg_()), curve)
    assert seen == [None] and batch._repr_svg_() is None
    crowd = jhd.polyline(np.random.default_rng(0).random((20_000, 2)))
    assert len(str(crowd._repr_svg_())) < 200_000


def test_how_something_ended_prints_a_sentence_also_where_all_went_well():
    for kind in (jhd.RESULTS, jhd.EVENTS):
        for member in kind._name_to_item.values():
            assert re.fullmatch(rf".*{kind.__name__}<[A-Z(`].{{10,}}>", repr(member), re.DOTALL)


def test_notebooks_see_a_table_of_a_solution_and_the_lines_of_a_batch():
    solution = a_solution()
    table = {row[0].text: row[1].text for row in ElementTree.fromstring(solution._repr_html_()) if len(row)}
    assert table["value"] == repr(float(solution.value)) and table["upper"] == repr(float(solution.upper))
    assert str(table["witness"]).startswith("at (") and table["event"] == name_of(solution.event)
    assert table["result"] == "successful"
    many = jax.tree_util.tree_map(lambda x: np.stack([x, x]), solution)
    assert many._repr_html_() == f"<pre>{escape(repr(many))}</pre>"
    one, half, first = jnp.float64(1), jnp.array([0.5, 0]), jnp.int32(0)
    nearest = jhd.Projection(one, one, one, half, first, one / 2, jhd.RESULTS.successful)
    assert "<tr><th>foot</th><td>(0.5, 0)</td></tr>" in nearest._repr_html_()


@pytest.mark.parametrize("entry", [jhd.fit_curve, jhd.fit_outline])
def test_a_fit_inside_jit_says_that_it_cannot_be_there(entry):
    more = {"degree": 1} if entry is jhd.fit_curve else {"tolerance": 0.1}
    with pytest.raises(TypeError, match=rf"{entry.__name__}\(\) is a search on the host, which cannot run inside jit"):
        jax.jit(lambda p: entry(jhd.BezierCurve(p), **more))(np.eye(2))


def test_numpy_inside_build_is_named():
    line = jhd.polyline([(0, 0), (1, 0)])
    for build in (lambda p: jhd.polyline(np.array(p)), lambda p: jhd.polyline([(float(p[0, 0]), 0), (1, 0)])):
        with pytest.raises(TypeError, match="build is traced, .* write it in jax.numpy, without NumPy, float"):
            jhd.minimize_hausdorff(build, np.eye(2), line)
