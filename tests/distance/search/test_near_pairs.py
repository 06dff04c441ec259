"""Implicit surfaces and shapes of many pieces: bounds hold closed forms and close, where they meet too."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.minimum import minimum_distance
from jhd._results.solution import name_of
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.simple_curves import polyline

BALL = ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-1.5] * 3, [1.5] * 3)
SIDE = 41


def square(height, cells=SIDE, scale=1.0):
    """A square mesh at a height, its vertices off the axis."""
    g = np.linspace(-2, 2, cells)
    x, y = np.meshgrid(g + 0.013, g + 0.027, indexing="ij")
    vertices = np.stack([x, y, np.full_like(x, height)], axis=-1).reshape(-1, 3) * scale
    i = np.arange(cells * cells).reshape(cells, cells)
    a, b, c, d = (k.ravel() for k in (i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]))
    return TriangleMesh(vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def holds(found, exact, width=1e-8):
    """lower <= exact <= upper without any tolerance, and closed."""
    near = float(found.upper - found.lower) <= width * max(1.0, exact)
    return found.lower <= exact <= found.upper and near and name_of(found.result) == "successful"


@pytest.mark.exhaustive
def test_a_mesh_of_thousands_of_triangles_beside_a_ball_and_across_it():
    mesh = square(3.0)
    found = minimum_distance(BALL, mesh)
    assert holds(found, 2.0)
    np.testing.assert_allclose(found.point_a, [0, 0, 1], atol=1e-5)
    # An edge crosses the surface: that alone proves that they meet.
    across = minimum_distance(square(0.25), BALL)
    assert across.lower == 0 and across.upper < 1e-300 and int(across.stats["pairs"]) == 0
    assert abs(float(np.linalg.norm(across.point_a)) - 1) < 1e-12
    np.testing.assert_allclose(across.point_a, across.point_b, atol=1e-12)


@pytest.mark.exhaustive
def test_a_mesh_that_touches_a_ball_and_one_beneath_its_top():
    assert holds(minimum_distance(square(1.0), BALL), 0.0)
    # The top of the ball pierces one triangle, and none of its edges.
    pierced = minimum_distance(square(1.0 - 2.0**-16), BALL, throw=False)
    assert pierced.lower == 0 and pierced.upper <= 2.0**-16


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [-300, 300])
def test_distances_of_meshes_and_balls_scale(exponent):
    # A mesh of 288 triangles: more than are searched each over the whole ball.
    scale = 2.0**exponent
    found = minimum_distance(BALL.transform(np.eye(3) * scale), square(3.0, 13, scale=scale))
    assert found.lower <= 2 * scale <= found.upper <= 2 * scale * (1 + 1e-8)


@pytest.mark.exhaustive
def test_curves_of_many_segments_beside_a_ball():
    line = polyline(np.stack([np.linspace(-2, 2, 301) + 0.0031, np.zeros(301), np.full(301, 3.0)], axis=1))
    assert holds(minimum_distance(BALL, line), 2.0)
    # All control points of the spline lie in the plane z = 3, and the curve crosses the axis.
    rows = np.stack([np.linspace(-2, 2, 201), np.linspace(-1, 1, 201), np.full(201, 3.0)], axis=1)
    found = minimum_distance(BSplineCurve.clamped(rows), BALL)
    assert holds(found, 2.0)


@pytest.mark.exhaustive
def test_derivatives_under_jit_are_those_of_the_nearest_points():
    mesh = square(3.0)

    def distance(vertices, radius):
        ball = ImplicitSurface(jnp.asarray(BALL.coefficients).at[0, 0, 0].set(-(radius**2)), BALL.lower, BALL.upper)
        return minimum_distance(TriangleMesh(vertices, mesh.triangles), ball).value

    value, (moved, grown) = jax.jit(jax.value_and_grad(distance, (0, 1)))(mesh.vertices, 1.0)
    assert abs(float(value) - 2) < 1e-8 and abs(float(grown) + 1) < 1e-6
    # The weights of the corners that hold the nearest point are one in all.
    np.testing.assert_allclose(jnp.sum(moved, axis=0), [0, 0, 1], atol=1e-6)
    unusable = jax.jit(lambda x: minimum_distance(TriangleMesh(x, mesh.triangles), BALL))
    found = unusable(mesh.vertices.at[3, 0].set(jnp.nan))
    assert name_of(found.result) == "nonfinite_value" and found.lower == 0 and np.isinf(found.upper)


@pytest.mark.slow
def test_a_surface_without_points_is_refused():
    nothing = ImplicitSurface.parse("x**2 + y**2 + z**2 + 1", [-1] * 3, [1] * 3)
    with pytest.raises(ValueError, match="proven to have no zero"):
        minimum_distance(square(3.0), nothing)
