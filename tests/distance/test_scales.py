"""Bounds and signs hold at every scale: shapes times powers of two, from subnormal numbers to near overflow."""

import jax
import numpy as np
import pytest

import jhd
from jhd.fields.adaptive import AdaptiveDistanceField

RANDOM = np.random.default_rng(0)
# An octahedron, closed, its normals outward; and points inside and outside of it.
VERTICES = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float) * [1, 0.75, 0.5]
FACES = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
QUERIES = RANDOM.normal(size=(300, 3)).astype(np.float32).astype(float)
POWERS = (-1040, -560, -370, 350, 1000)


def octahedron(power):
    return jhd.TriangleMesh(np.ldexp(VERTICES, power), FACES)


@pytest.mark.parametrize("sign", ["winding", "pseudonormal"])
@pytest.mark.parametrize("power", POWERS)
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


@pytest.mark.parametrize("power", POWERS[1:])
def test_an_adaptive_field_and_its_proven_error_do_not_depend_on_the_unit(power):
    fields = [AdaptiveDistanceField.build(octahedron(k), np.ldexp(0.05, k), max_depth=2) for k in (0, power)]
    plain, scaled = (np.ldexp(np.asarray(f(np.ldexp(QUERIES, k))), -k) for f, k in zip(fields, (0, power), strict=True))
    np.testing.assert_array_equal(plain, scaled)
    proven = fields[1].proven_error(octahedron(power), max_boxes=2000)
    assert fields[1].sampled_error(octahedron(power), 500) <= proven
    assert np.ldexp(proven, -power) == pytest.approx(fields[0].proven_error(octahedron(0), max_boxes=2000))
    assert fields[0].to_mesh(8).count == fields[1].to_mesh(8).count


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
