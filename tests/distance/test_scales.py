"""Bounds and signs hold at every scale: shapes times powers of two, from subnormal numbers to near overflow."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.cells.pairs import newton_step
from jhd._distance.normalization.surfaces import prepare_surfaces
from jhd._fields.adaptive import AdaptiveDistanceField
from tests.sweeps import swept

RANDOM = np.random.default_rng(0)
# An octahedron, closed, its normals outward; and points inside and outside of it.
VERTICES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float) * [1, 0.75, 0.5]
FACES = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
QUERIES = RANDOM.normal(size=(300, 3)).astype(np.float32).astype(float)
POWERS = (-1040, -560, -370, 350, 1000)


def octahedron(power):
    return jhd.TriangleMesh(np.ldexp(VERTICES, power), FACES)


@pytest.mark.parametrize("sign", ["winding", "pseudonormal"])
@pytest.mark.parametrize("power", swept(POWERS, 2))
def test_signs_do_not_depend_on_the_unit(sign, power):
    expected = np.where(np.abs(QUERIES / VERTICES.max(axis=0)).sum(axis=1) < 1, -1, 1)
    # What is rounded there is as far from the surface as it was.
    found = np.asarray(jhd.signed_distance(np.ldexp(QUERIES, power), octahedron(power), sign))
    np.testing.assert_array_equal(np.sign(found), expected)
    assert 0 < np.sum(expected < 0) < len(QUERIES)


def test_points_of_any_size_are_asked_for_at_once():
    mesh = octahedron(-1000)
    found = np.asarray(jhd.signed_distance([[1e300, 0, 0], [0, 0, 0]], mesh))
    assert found[0] == pytest.approx(1e300) and found[1] < 0
    near = jhd.project(QUERIES, octahedron(-1060))
    length = np.linalg.norm(QUERIES, axis=1)
    assert np.all(near.lower <= length * (1 + 1e-15)) and np.all(near.upper >= length * (1 - 1e-15))


@pytest.mark.parametrize("power", swept(POWERS[1:], 0, 1))
def test_an_adaptive_field_and_its_proven_error_do_not_depend_on_the_unit(power):
    fields = [AdaptiveDistanceField.build(octahedron(k), np.ldexp(0.05, k), max_depth=2) for k in (0, power)]
    plain, scaled = (np.ldexp(np.asarray(f(np.ldexp(QUERIES, k))), -k) for f, k in zip(fields, (0, power), strict=True))
    np.testing.assert_array_equal(plain, scaled)
    proven = fields[1].proven_error(octahedron(power), max_boxes=2000)
    assert fields[1].sampled_error(octahedron(power), 500) <= proven
    assert np.ldexp(proven, -power) == pytest.approx(fields[0].proven_error(octahedron(0), max_boxes=2000))
    assert fields[0].to_mesh(8).count == fields[1].to_mesh(8).count


@pytest.mark.slow
@pytest.mark.parametrize("compiled", [False, True])
def test_a_tiny_triangle_does_not_loosen_what_is_known_of_others(compiled):
    tiny = [[0.1, 0.1, 0.0], [0.1, 0.1, 3e-170], [0.1, 0.1, 1e-171]]
    others = [[3.0, 0, 0], [3, 1, 0], [3, 0, 1]]
    mesh = jhd.TriangleMesh(tiny + others, [[0, 1, 2], [3, 4, 5]])
    found = (jax_project if compiled else jhd.project)(QUERIES[:8], mesh)
    assert np.all(np.asarray(found.upper - found.lower) < 1e-11)
    assert np.all(np.asarray(found.lower) <= np.linalg.norm(QUERIES[:8] - tiny[0], axis=1))


def jax_project(points, mesh):
    return jax.jit(jhd.project)(points, mesh)


@pytest.mark.parametrize("power", POWERS)
def test_a_mesh_of_a_patch_is_as_good_at_every_scale(power):
    saddle = np.array([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 1]]], float)
    mesh, deviation = jhd.BezierPatch(np.ldexp(saddle, power)).to_mesh(np.ldexp(0.3, power))
    # Two triangles are off by a quarter of the twist.
    assert mesh.count == 2 and np.ldexp(0.25, power) <= deviation <= np.ldexp(0.26, power)


def test_a_mesh_of_a_patch_that_is_small_beside_its_place_claims_no_better():
    saddle = np.array([[[0, 0, 0], [0, 1, 0]], [[0, 0, 1], [0, 1, 3]]], float) * 1e-200 + [1, 0, 0]
    assert 0.25e-200 <= jhd.BezierPatch(saddle).to_mesh(1e-200).deviation <= 1e-200


CONTROL, WEIGHTS = RANDOM.normal(size=(4, 2)), RANDOM.uniform(0.5, 2.0, size=4)


@pytest.mark.slow
def test_a_common_factor_of_the_weights_changes_nothing():
    one, other = (jhd.BezierCurve(CONTROL, np.ldexp(WEIGHTS, k)) for k in (0, -1015))
    for ask in (jhd.project, jhd.stationary_points):
        found, again = ask(QUERIES[:8, :2], one), ask(QUERIES[:8, :2], other)
        for x, y in zip(jax.tree_util.tree_leaves(found), jax.tree_util.tree_leaves(again), strict=True):
            np.testing.assert_array_equal(x, y)


@pytest.mark.exhaustive  # programs of its own
def test_a_common_factor_of_the_weights_changes_no_distance_to_a_surface():
    sphere = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", [-1, -1, -1], [1, 1, 1])
    rows = np.array([[2.0, 0, 0], [2, 1, 0], [3, 1, 0]])
    found = jhd.minimum_distance(jhd.BezierCurve(rows, np.ldexp([1, 0.5, 1], -1015)), sphere)
    assert found.lower <= 1 <= found.upper <= 1 + 1e-8


@pytest.mark.parametrize(("power", "of_weights"), [(-1000, -100), (-1030, 0), (900, 900)])
def test_a_spline_has_the_same_segments_in_every_unit(power, of_weights):
    plain = jhd.BSplineCurve.clamped(CONTROL, 2, WEIGHTS).segments()
    scaled = jhd.BSplineCurve.clamped(np.ldexp(CONTROL, power), 2, np.ldexp(WEIGHTS, of_weights)).segments()
    back = np.ldexp(np.asarray(scaled.control_points), -power)
    np.testing.assert_allclose(back, plain.control_points, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(np.ldexp(np.asarray(scaled.weights), -of_weights), plain.weights)


def test_a_surface_made_of_splines_has_the_same_patches_in_every_unit():
    net, weights = RANDOM.normal(size=(3, 3, 3)), RANDOM.uniform(0.5, 2.0, size=(3, 3))
    plain, scaled = (
        jhd.BSplineSurface.clamped(np.ldexp(net, k), (2, 1), np.ldexp(weights, k)).patches() for k in (0, -1000)
    )
    np.testing.assert_array_equal(np.ldexp(np.asarray(scaled.control_points), 1000), plain.control_points)


@pytest.mark.slow
def test_subnormal_coefficients_count_under_jit():
    # z = 1e-20 x^4 up to x = 4e6, where the second term is half as large as the first.
    coefficients = np.zeros((5, 1, 2))
    coefficients[0, 0, 1], coefficients[4, 0, 0] = 1e-300, -1e-320

    def side(c):
        surface = jhd.ImplicitSurface(c, [0.0, 0, 0], [4e6] * 3)
        return prepare_surfaces(surface, surface)[0]

    known, compiled = side(coefficients), jax.jit(side)(coefficients)
    ratio = Fraction(1e-320) / Fraction(1e-300) * Fraction(2) ** (3 * 22)
    for found in (known, compiled):
        first, second = (Fraction(float(found.coefficients[i])) for i in ((0, 0, 1), (4, 0, 0)))
        errors = [Fraction(float(found.error[i])) for i in ((0, 0, 1), (4, 0, 0))]
        assert abs(second + ratio * first) <= errors[1] + ratio * errors[0]


def test_decisions_about_subnormal_lengths_are_true():
    least = 5e-324
    a, b = jhd.point_set([[0.0, 0.0]]), jhd.point_set([[3 * least, 0.0]])
    answers = [jhd.hausdorff_at_most(a, b, k * least) for k in range(6)]
    for k, found in enumerate(answers):
        assert found.answer != (jhd.ANSWERS.yes if k < 3 else jhd.ANSWERS.no)
        assert not (found.answer == jhd.ANSWERS.yes and float(found.lower) > k * least)
    assert answers[0].answer == jhd.ANSWERS.no and answers[5].answer == jhd.ANSWERS.yes
    # The larger of two directions, of which one is zero.
    both = jhd.point_set([[0.0, 0.0], [3 * least, 0.0]])
    assert all(np.asarray(jhd.hausdorff(*pair).upper) >= 3 * least for pair in ((a, both), (both, a)))
    far = jhd.hausdorff_at_most(a, b, 1e308)
    assert far.answer == jhd.ANSWERS.yes


def test_a_step_of_newton_is_finite_in_single_precision():
    # Zeros of the second derivatives are no pivots.
    zero = np.zeros(2, np.float32)
    step = newton_step(jnp.asarray(zero), jnp.zeros((2, 2), np.float32), jnp.zeros(2, bool))
    np.testing.assert_array_equal(step, zero)


@pytest.mark.parametrize("power", swept([-1026, -1040], 1))
def test_compiled_functions_call_a_host_that_keeps_subnormal_numbers(power):
    mesh = jhd.TriangleMesh(np.ldexp([(0.0, 0, 0), (1, 0, 0), (0, 1, 0)], power), [(0, 1, 2)])
    line = jhd.polyline(np.ldexp([(0.0, 0), (1, 0)], power))
    for shape, query in ((line, (0.0, 3.0)), (mesh, (0.0, 0.0, 3.0))):
        project = lambda q, shape=shape: jhd.project(q, shape)  # noqa: E731
        for called in (project, jax.jit(project)):
            found = called(np.ldexp(query, power))
            lower, upper = (np.ldexp(np.asarray(x), -power) for x in (found.lower, found.upper))
            assert lower <= 3 <= upper and (shape is mesh or upper - lower < 0.1)
