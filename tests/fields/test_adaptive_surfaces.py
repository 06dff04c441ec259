"""Adaptive distance fields of parametric and implicit surfaces, against closed forms."""

import numpy as np
import pytest

import jhd
from jhd._fields.adaptive import AdaptiveDistanceField
from tests.sweeps import swept


def near_sphere(count):
    """Points within a twentieth of the unit sphere, and their signed distances."""
    random = np.random.default_rng(1)
    directions = random.normal(size=(count, 3))
    height = random.uniform(-0.05, 0.05, size=count)
    points = (1 + height)[:, None] * directions / np.linalg.norm(directions, axis=1)[:, None]
    return points, height


@pytest.mark.parametrize("text", swept(["x^2 + y^2 + z^2 - 1", "1 - x^2 - y^2 - z^2"], 0, 1))
def test_a_polynomial_sphere_is_negative_inside_whatever_the_sign_of_the_polynomial(text):
    sphere = jhd.ImplicitSurface.parse(text, [-2, -2, -2], [2, 2, 2])
    field = AdaptiveDistanceField.build(sphere, 0.1)
    points, height = near_sphere(2000)
    assert float(field([0.0, 0.0, 0.0])) < -0.5 and field.unresolved == 0
    # A mesh of the coarse tolerance alone would be off by more where its triangles are flat.
    assert np.abs(np.asarray(field(points)) - height).max() <= 0.1


@pytest.mark.exhaustive
def test_the_proven_error_of_a_polynomial_sphere_holds_for_its_closed_form():
    sphere = jhd.ImplicitSurface.parse("1 - x^2 - y^2 - z^2", [-2, -2, -2], [2, 2, 2])
    field = AdaptiveDistanceField.build(sphere, 0.1)
    proven, (points, height) = field.proven_error(sphere), near_sphere(4000)
    seen = np.abs(np.asarray(field(points)) - height).max()
    assert 0.1 * proven < seen <= proven < 0.16
    assert field.sampled_error(sphere, 2000) < proven
    # The deviation of the mesh is a part of the bound.
    mesh, deviation = sphere.to_mesh(0.25 * 0.1)
    flipped = jhd.TriangleMesh(mesh.vertices, np.asarray(mesh.triangles)[:, ::-1])
    assert deviation > 0 and proven == pytest.approx(field.proven_error(flipped) + deviation, rel=1e-12)


@pytest.mark.exhaustive
def test_a_parametric_torus_has_the_field_of_its_closed_form():
    turn = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], float)
    knots, weights = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], np.array([1, np.sqrt(0.5)] * 4 + [1])
    ring = turn * 0.5 + [2.0, 0.0]
    around = np.concatenate([turn[:, None] * ring[None, :, :1], np.broadcast_to(ring[:, 1:], (9, 9, 1))], axis=-1)
    torus = jhd.BSplineSurface(around, knots, knots, weights[:, None] * weights)
    field = AdaptiveDistanceField.build(torus, 0.04)
    proven = field.proven_error(torus)
    x, y, z = points = np.random.default_rng(0).uniform([-2.6, -2.6, -0.6], [2.6, 2.6, 0.6], size=(40000, 3)).T
    exact = np.hypot(np.hypot(x, y) - 2, z) - 0.5
    band = np.abs(exact) < 0.02
    seen = np.abs(np.asarray(field(points.T[band])) - exact[band]).max()
    assert band.sum() > 500 and 0.1 * proven < seen <= proven < 0.08


# The unit square in the plane z = 0, flat and with its control points unevenly.
SQUARE = jhd.BezierPatch([[[0, 0, 0], [0, 0.3, 0], [0, 1, 0]], [[1, 0, 0], [1, 0.3, 0], [1, 1, 0]]])


def from_square(points):
    """Distances to the unit square."""
    return np.linalg.norm(points - np.clip(points, [0, 0, 0], [1, 1, 0]), axis=1)


@pytest.mark.slow
def test_an_open_patch_has_no_inside_and_its_field_is_without_signs():
    with pytest.raises(ValueError, match="the surface is open, so it has no inside; the sign 'none'"):
        AdaptiveDistanceField.build(SQUARE, 0.1)
    field = AdaptiveDistanceField.build(SQUARE, 0.1, mode="full", sign="none")
    points = np.random.default_rng(0).uniform(field.lower, field.upper, size=(4000, 3))
    off = np.abs(np.asarray(field(points)) - from_square(points)).max()
    proven = field.proven_error(SQUARE)
    assert field.unresolved == 0 and float(field.values.min()) >= 0
    assert 0.3 * proven < off <= proven < 0.2 and field.sampled_error(SQUARE, 500) <= proven
    with pytest.raises(ValueError, match="the field has no signs"):
        field.to_mesh(16)
