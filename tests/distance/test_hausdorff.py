"""The entries: axioms of a distance, invariances, the same answer in every way of writing a curve, and refusals."""

import os
from functools import cache

import jax
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import jhd
from jhd._results.solution import name_of
from tests.cases import ARCH, CASES, LOOP, WAVE
from tests.distance import pairs
from tests.processes import python
from tests.sweeps import swept

# What the method promises of its values, in diagonals.
PROMISED = 1e-9
# Rotations and roundings of new control points, relative.
ROUNDING = 1e-12

SMALL = [c for c in CASES if pairs.is_quick(c)]
PLAIN = [c.name for c in SMALL if c.a.weights is None and c.b.weights is None]
RATIONAL = [c.name for c in SMALL if c.name not in PLAIN]
# Every kind of event, in the program of polynomial curves in the plane.
SOME = (
    "segment_over_parabola",
    "cusp_over_chord",
    "wave_over_line",
    "arch_and_wave",
    "loop_and_line",
    "b_end_at_corner",
    "roof_over_segment",
    "identical_wave",
    "hook",
    "degrees_3_and_3",
)


def distance(a, b):
    return float(jhd.hausdorff(a, b))


def close(x, y, name):
    assert abs(float(x) - float(y)) <= PROMISED * pairs.diagonal(name), (float(x), float(y))


@cache
def to_itself(name):
    """Both curves of a case against themselves; the two directions are one."""
    return [jhd.directed_hausdorff(curve, curve) for curve in pairs.both(pairs.BY_NAME[name])]


@pytest.mark.parametrize("name", swept(PLAIN + RATIONAL, SOME))
def test_the_distance_of_a_curve_to_itself_is_zero(name):
    for solution in to_itself(name):
        close(solution, 0.0, name)
        assert solution.lower == 0


@pytest.mark.parametrize("name", swept(PLAIN + RATIONAL, (*SOME, *RATIONAL[:2])))
def test_a_curve_coincides_with_itself(name):
    assert [name_of(solution.event) for solution in to_itself(name)] == ["coincident"] * 2


@pytest.mark.parametrize("name", swept(PLAIN + RATIONAL, SOME[::2], ("circle_in_ellipse", *SOME)))
def test_the_larger_direction_is_taken_and_named(name):
    there, back = (float(pairs.solved(name, direction)) for direction in ("ab", "ba"))
    a, b = pairs.of_one_size(pairs.BY_NAME[name])
    solution = jhd.hausdorff(a, b, jhd.published.TwoStep())
    assert float(solution) == max(there, back)
    assert name_of(solution.direction) == ("a_to_b" if there >= back else "b_to_a")
    assert solution.lower == max(float(pairs.solved(name, d).lower) for d in ("ab", "ba"))
    assert solution.upper == np.inf
    assert set(solution.stats) == {f"{d}_{k}" for d in ("a_to_b", "b_to_a") for k in pairs.solved(name).stats}


@pytest.mark.parametrize("name", SOME)
def test_the_distance_is_symmetric(name):
    a, b = pairs.both(pairs.BY_NAME[name])
    there, back = jhd.hausdorff(a, b), jhd.hausdorff(b, a)
    assert float(there) == float(back) and float(there.lower) == float(back.lower)
    # At a tie the first curve carries the witness.
    tie = float(pairs.solved(name)) == float(pairs.solved(name, "ba"))
    assert (name_of(there.direction) != name_of(back.direction)) or tie


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("exponent", swept([-300, -40, 1, 300], quick=[-300, 300]))
@pytest.mark.parametrize("method", [jhd.BranchAndBound(), jhd.published.TwoStep()], ids=lambda m: type(m).__name__)
def test_scaling_by_a_power_of_two_is_exact(name, exponent, method):
    a, b = pairs.both(pairs.BY_NAME[name])
    factor = 2.0**exponent
    p, q = (jhd.BezierSegments(c.control_points * factor) for c in (a, b))
    scaled, solution = jhd.directed_hausdorff(p, q, method), jhd.directed_hausdorff(a, b, method)
    assert float(scaled.value) == float(solution.value) * factor
    assert float(scaled.lower) == float(solution.lower) * factor
    assert float(scaled.upper) == float(solution.upper) * factor
    np.testing.assert_array_equal(scaled.witness.point, solution.witness.point * factor)
    assert name_of(scaled.event) == name_of(solution.event)


@pytest.mark.parametrize("name", SOME)
def test_rigid_motions_and_reflections_change_nothing(name):
    a, b = pairs.both(pairs.BY_NAME[name])
    cosine, sine = np.cos(0.7), np.sin(0.7)
    for matrix in ([[cosine, -sine], [sine, cosine]], [[0.0, 1.0], [1.0, 0.0]], [[-1.0, 0.0], [0.0, -1.0]]):
        p, q = (curve.transform(matrix, [3.0, -5.0]) for curve in (a, b))
        close(jhd.directed_hausdorff(p, q), pairs.solved(name), name)


def halves(curve):
    """Every segment cut in two."""
    return jhd.BezierSegments.join([curve.restrict(0.0, 0.375), curve.restrict(0.375, 1.0)])


REWRITTEN = {
    "elevated": lambda curve: curve.elevate(3),
    "reversed": lambda curve: curve.reverse(),
    "padded": lambda curve: curve.pad(4),
    "split": halves,
    "written twice": lambda curve: jhd.BezierSegments.join([curve, curve]),
}


@pytest.mark.parametrize("name", ["segment_over_parabola", "cusp_over_chord", "arch_and_wave", "loop_and_line", "hook"])
@pytest.mark.parametrize("how", REWRITTEN)
def test_the_way_a_curve_is_written_changes_nothing(name, how):
    a, b = pairs.both(pairs.BY_NAME[name])
    p, q = (REWRITTEN[how](curve) if curve.count <= 2 else curve for curve in (a, b))
    solution = jhd.directed_hausdorff(p, q)
    close(solution, pairs.solved(name), name)
    close(jhd.directed_hausdorff(p, b), pairs.solved(name), name)
    assert name_of(solution.event) == name_of(pairs.solved(name).event)


@pytest.mark.parametrize("name", ["cusp_over_chord", "arch_and_wave", "degrees_3_and_3"])
def test_the_cuts_of_a_curve_are_no_ends_and_no_corners(name):
    a, b = pairs.both(pairs.BY_NAME[name])
    event = name_of(jhd.directed_hausdorff(halves(a), halves(b)).event)
    assert event == name_of(pairs.solved(name).event)


coordinates = st.lists(st.integers(-8, 8), min_size=8, max_size=8)


def cubic(integers):
    return jhd.BezierSegments(np.reshape(integers, (1, 4, 2)) / 4.0)


@settings(max_examples=40)
@given(coordinates, coordinates, coordinates)
def test_the_triangle_inequality_holds(first, second, third):
    a, b, c = map(cubic, (first, second, third))
    assert distance(a, c) <= distance(a, b) + distance(b, c) + PROMISED * 12


@settings(max_examples=40)
@given(coordinates, coordinates)
def test_nothing_is_nan_and_bounds_are_in_order(first, second):
    solution = jhd.hausdorff(cubic(first), cubic(second))
    for leaf in jax.tree_util.tree_leaves(solution):
        assert not np.isnan(np.asarray(leaf, dtype=float)).any()
    assert 0 <= solution.lower <= solution.value <= solution.upper


@settings(max_examples=30)
@given(coordinates, st.integers(-64, 64), st.integers(-64, 64))
def test_a_shift_moves_a_curve_by_at_most_its_length(integers, x, y):
    a = cubic(integers)
    shift = np.array([x, y]) / 64
    moved = jhd.BezierSegments(a.control_points + shift)
    length = float(np.hypot(*shift))
    assert distance(a, moved) <= length + PROMISED * 12
    # Along the shift the farther support line moves by exactly its length.
    assert distance(a, moved) >= length * (1 - 1e-9) - PROMISED * 12


@pytest.mark.parametrize("offset", [1e6, -1e8])
def test_a_common_offset_does_not_blur_a_distance(offset):
    a, b = (shape.control_points + np.array([offset, -offset]) for shape in (ARCH, WAVE))
    a_local, b_local = (x - np.array([offset, -offset]) for x in (a, b))
    pairs_of_curves = ((a, b), (a_local, b_local))
    far, near = (jhd.directed_hausdorff(jhd.BezierSegments(x), jhd.BezierSegments(y)) for x, y in pairs_of_curves)
    assert abs(float(far) - float(near)) <= ROUNDING * 4


@pytest.mark.parametrize("exponent", [-1070, 1018])
def test_the_largest_and_smallest_floats_have_distances(exponent):
    factor = np.ldexp(1.0, exponent)
    a, b = jhd.polyline(np.array([[0, 0], [4, 0]]) * factor), jhd.polyline(np.array([[0, 3], [4, 1]]) * factor)
    solution = jhd.directed_hausdorff(a, b)
    assert np.isfinite(np.asarray(solution.value)) and np.asarray(solution.lower) <= np.asarray(solution.value)
    # The farthest point of a is its start, 3 * 4 / sqrt(20) from the line of b.
    np.testing.assert_allclose(np.ldexp(np.asarray(solution.value), -exponent), 12 / np.sqrt(20), rtol=0.1)


@pytest.mark.parametrize(
    ("a", "b", "value"),
    [
        (jhd.point_set([[0, 0]]), jhd.point_set([[3, 4]]), 5.0),
        (jhd.point_set([[0, 0], [0, 0]]), jhd.point_set([[0, 0]]), 0.0),
        (jhd.BezierSegments(np.ones((1, 4, 2))), jhd.point_set([[1, 1]]), 0.0),
        (jhd.polyline([[0, 0], [0, 0]]), jhd.polyline([[1, 0], [1, 0]]), 1.0),
    ],
    ids=["points", "one place", "point-curve", "lines of no length"],
)
def test_degenerate_curves_have_distances(a, b, value):
    solution = jhd.hausdorff(a, b)
    np.testing.assert_allclose(float(solution), value, rtol=ROUNDING, atol=1e-15)
    assert not any(np.isnan(np.asarray(leaf, dtype=float)).any() for leaf in jax.tree_util.tree_leaves(solution))


def test_every_kind_of_curve_is_accepted():
    rows = [[0.0, 0.0], [1.0, 2.0], [3.0, -1.0], [4.0, 0.0]]
    kinds = (
        jhd.BezierCurve(rows),
        jhd.BSplineCurve.clamped(rows),
        pairs.curve(WAVE),
        jhd.polyline(rows),
        jhd.point_set(rows),
        jhd.circle([1.0, 2.0], 3.0),
    )
    for curve in kinds:
        assert distance(curve, curve.segments()) <= 1e-12, curve
        # Moved aside, a curve is as far from itself as it was moved, or nearer.
        found = jhd.directed_hausdorff(curve, curve.transform(np.eye(2), [0.0, 0.25]), throw=False)
        assert 0 < found.value <= 0.25 + 1e-12, curve


@pytest.mark.exhaustive
def test_curves_in_space_have_the_distance_of_the_plane():
    def lifted(shape):
        return jhd.BezierSegments(np.pad(shape.control_points, ((0, 0), (0, 0), (0, 1))))

    flat = jhd.directed_hausdorff(pairs.curve(LOOP), pairs.curve(WAVE))
    space = jhd.directed_hausdorff(lifted(LOOP), lifted(WAVE))
    assert abs(float(flat) - float(space)) <= ROUNDING * 4


def test_a_second_pair_of_the_same_size_compiles_nothing():
    rng = np.random.default_rng(0)
    a, b = (jhd.BezierSegments(rng.normal(size=(1, 4, 2))) for _ in range(2))
    jhd.hausdorff(a, b)
    with jax.log_compiles(True):
        compiled = []

        def listen(event, duration_secs, **_):
            compiled.append(event) if "backend_compile" in event else None

        jax.monitoring.register_event_duration_secs_listener(listen)
        # Two segments of degree 2 share the program.
        jhd.hausdorff(jhd.BezierSegments(rng.normal(size=(2, 3, 2))), b)
        jax.monitoring.clear_event_listeners()
    assert not compiled


# ---- refusals ------------------------------------------------------------------------------------

ONE, SPACE = jhd.point_set([[0.0, 0.0]]), jhd.point_set([[0.0, 0.0, 0.0]])


@pytest.mark.parametrize("entry", [jhd.hausdorff, jhd.directed_hausdorff])
@pytest.mark.parametrize(
    ("a", "b", "name"),
    [
        (3.0, ONE, "a"), (ONE, {"a": 1}, "b"), (ONE, None, "b"), (b"M0 0", ONE, "a"),
        (trimesh.Scene(trimesh.creation.box()), SPACE, "a"),
    ],
)  # fmt: skip
def test_what_is_no_shape_is_refused(entry, a, b, name, as_a_user):
    given = a if name == "a" else b
    with pytest.raises(TypeError, match=rf"^{name} must be a shape of jhd, an array of points, .* a mesh .*") as caught:
        entry(a, b)
    way = ": call its to_mesh()" if isinstance(given, trimesh.Scene) else ""
    assert str(caught.value).endswith(f"; got {type(given).__name__}{way}.")


@pytest.mark.parametrize("entry", [jhd.hausdorff, jhd.directed_hausdorff])
def test_curves_of_different_dimensions_are_refused(entry):
    with pytest.raises(ValueError) as caught:
        entry(ONE, SPACE)
    assert str(caught.value) == "a has 2 coordinates a point and b has 3; needs the same."


@pytest.mark.parametrize("entry", [jhd.hausdorff, jhd.directed_hausdorff])
@pytest.mark.parametrize(
    "method", ["two_step", jhd.published.TwoStep, jhd.BestFirstProjection()], ids=["text", "class", "projection"]
)
def test_what_is_no_method_is_refused(entry, method, as_a_user):
    with pytest.raises(TypeError) as caught:
        entry(ONE, ONE, method)
    known = "BranchAndBound(), TwoStep(), BiarcTrimming() or AlgebraicEvents()"
    kinds = "BezierSegments and BezierSegments"
    came = "the class TwoStep: call it" if method is jhd.published.TwoStep else type(method).__name__
    assert str(caught.value) == f"method must be {known} for {kinds}; got {came}."


def test_a_tolerance_in_the_place_of_a_method_and_text_in_that_of_a_shape_are_named(as_a_user):
    with pytest.raises(TypeError, match=r"got 0\.001: as a tolerance it is atol=0\.001"):
        jhd.hausdorff(ONE, ONE, 1e-3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match=r"a: text is not a shape: jhd\.io\.load_shape reads .* SVG path data"):
        jhd.hausdorff("M0 0", ONE)  # pyright: ignore[reportArgumentType]


# ---- single precision ----------------------------------------------------------------------------

SINGLE = """
import numpy as np, jhd
from fractions import Fraction
from tests.distance import pairs
for case in [c for c in pairs.CASES if pairs.is_quick(c)]:
    a, b = pairs.both(case)
    assert a.control_points.dtype == np.float32
    stored = [np.asarray(x, dtype=float) for c in (a, b) for x in (c.control_points, c.weights) if x is not None]
    given = [np.asarray(x) for s in (case.a, case.b) for x in (s.control_points, s.weights) if x is not None]
    if case.a.weights is None and case.b.weights is not None or case.b.weights is None and case.a.weights is not None:
        continue
    # The table is true of the floats that are stored, so what float32 rounds is left out.
    if not all(np.array_equal(x, y) for x, y in zip(stored, given, strict=True)):
        continue
    solution = jhd.directed_hausdorff(a, b)
    lower, upper = pairs.bounds(case.exact_ab)
    assert Fraction(float(solution.lower)) <= upper, (case.name, float(solution.lower))
    assert lower <= Fraction(float(solution.upper)), (case.name, float(solution.upper))
    assert abs(float(solution.value) - float(lower)) <= 1e-4 * pairs.diagonal(case.name), (case.name, float(solution))
print("done")
"""


@pytest.mark.slow
def test_in_single_precision_the_lower_bounds_stay_true():
    environment = os.environ | {"JAX_ENABLE_X64": "0"}
    assert python("-c", SINGLE, env=environment).stdout.strip() == "done"
