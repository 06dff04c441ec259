"""Derivatives at a given witness of any pair of shapes: close, singular, clipped, padded and refused ones."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.normalization.implicit_derivatives import TouchedRows, following
from jhd._distance.search.bodies import body_of
from jhd._distance.witness import balance
from jhd._distance.witness.mixed_derivatives import with_place_derivatives
from jhd._distance.witness.rows import CornerRows, NetRows, Polynomial
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, HausdorffSolution, MinimumSolution, Witness
from tests.sweeps import swept

NORMAL = np.array([0.6, 0.0, 0.8])


def found_at(point, feet, weights, t: Any = np.nan, params: Any = np.nan, dtype: Any = float):
    """A solution from a to b with this witness, of which the first foot is repeated."""
    unused = 4 - len(feet)
    rows = lambda x: jnp.asarray(np.concatenate([x, np.repeat(np.asarray(x)[:1], unused, axis=0)]), dtype)  # noqa: E731
    witness = Witness(
        element=jnp.asarray(0),
        t=jnp.asarray(t, dtype),
        point=jnp.asarray(point, dtype),
        feet=rows(feet),
        feet_elements=jnp.zeros(4, int),
        feet_params=jnp.asarray(np.broadcast_to(params, (4, *np.shape(params))), dtype),
        multipliers=jnp.asarray(np.append(weights, np.zeros(unused)), dtype),
        event=EVENTS.antipodal,
        direction=DIRECTIONS.a_to_b,
    )
    value = jnp.asarray(np.linalg.norm(np.subtract(point, feet[0])), dtype)
    return HausdorffSolution(value, value, value, witness, RESULTS.successful, {})


def sphere(radius, center, scale=1.0, dtype: Any = float):
    """The coefficients of scale (|x - center|^2 - radius^2)."""
    center = jnp.asarray(center, dtype)
    f = jnp.zeros((3, 3, 3), dtype).at[0, 0, 0].set(center @ center - radius**2)
    f = f.at[1, 0, 0].set(-2 * center[0]).at[0, 1, 0].set(-2 * center[1]).at[0, 0, 1].set(-2 * center[2])
    return scale * f.at[2, 0, 0].set(1.0).at[0, 2, 0].set(1.0).at[0, 0, 2].set(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("x", [0.0, 1e3], ids=["origin", "far"])
def test_close_spheres_have_the_derivatives_of_their_closed_form(x):
    # The sphere of radius 1 + gap about c + 2 gap n is 3 gap away: h = |center - c| + gap.
    gap, center = 1e-6, np.array([x, -x / 2, x / 3])
    found = found_at(center + (1 + 3 * gap) * NORMAL, [center + NORMAL], [1.0])

    def value(move):
        a = sphere(1 + gap, center + 2 * gap * NORMAL + move)
        a, b = (jhd.ImplicitSurface(f, center - 3, center + 3, reduced=False) for f in (a, sphere(1.0, center)))
        return with_place_derivatives(found, a, b).value

    np.testing.assert_allclose(jax.grad(value)(jnp.zeros(3)), NORMAL, atol=1e-12)
    expected = (np.eye(3) - np.outer(NORMAL, NORMAL)) / (2 * gap)
    np.testing.assert_allclose(jax.jit(jax.hessian(value))(jnp.zeros(3)) * 2 * gap, expected * 2 * gap, atol=1e-6)


@pytest.mark.slow
def test_at_the_apex_of_a_cone_the_foot_and_not_the_noise_of_a_gradient_tells_the_direction():
    cone = jhd.ImplicitSurface.parse("x**2 + y**2 - z**2", [-3, -3, 0], [3, 3, 3])
    found = found_at([0.3, 0.0, -0.4], [[1e-9, -2e-9, 1e-9]], [1.0], [0.5, 0.25, 0.25])

    def value(move):
        corners = jnp.asarray([[0.3, 0, -0.4], [0.3, 1, -0.4], [0.3, -1, -0.4]]) + move
        return with_place_derivatives(found, jhd.TriangleMesh(corners, [[0, 1, 2]]), cone).value

    np.testing.assert_allclose(jax.grad(value)(jnp.zeros(3)), [0.6, 0.0, -0.8], atol=1e-7)


@pytest.mark.slow
def test_points_beside_a_mesh_are_triangles_that_have_no_coordinates():
    corners, point = np.array([[3.0, 1, 2], [6, 0, -1], [4, -1, 0]]), np.array([2.0, 2.5, 1])
    speeds = np.array([[0.2, 0.1, -0.3], [0.3, -0.1, 0.2], [0.1, 0.4, 0.1]]), np.array([-0.2, 0.1, 0.3])
    found = found_at(corners[1], [point], [1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])

    def value(s):
        a = jhd.TriangleMesh(corners + s * speeds[0], [[0, 1, 2]])
        return with_place_derivatives(found, a, body_of(jhd.point_set((point + s * speeds[1])[None])).triangles()).value

    apart, speed = corners[1] - point, speeds[0][1] - speeds[1]
    far = np.linalg.norm(apart)
    np.testing.assert_allclose(jax.grad(value)(0.0), speed @ apart / far, rtol=1e-13)
    expected = (speed @ speed - (speed @ apart / far) ** 2) / far
    np.testing.assert_allclose(jax.hessian(value)(0.0), expected, rtol=1e-12)


def in_single(scale=1.0, point: Any = (0.0, 0.0, 2.0), foot: Any = (0.0, 0.0, 1.0)):
    """A point above a unit sphere of a box, and the numbers as functions of both, in single precision."""
    single = np.float32
    surface = Polynomial(
        jnp.asarray(sphere(1.0, np.zeros(3), scale, single)), jnp.full(3, -2, single), jnp.asarray([2, 2, 0.3], single)
    )
    rows = CornerRows(jnp.asarray([point, point, point], single)), surface
    found = found_at(point, [foot], [1.0], [1.0, 0.0, 0.0], dtype=single)
    return rows, (found.value, found.witness)


@pytest.mark.slow
def test_a_foot_that_rounding_keeps_from_a_face_moves_with_it():
    # Single precision knows the height 0.3 to 3e-8, and the foot to a little less.
    foot = np.array([np.sqrt(1 - 0.09), 0, 0.3 * (1 - 2e-6)])
    rows, constants = in_single(point=(2.0, 0, 0.9), foot=foot)
    value = lambda upper: balance.from_place((rows[0], replace(rows[1], upper=upper)), constants).numbers["value"]  # noqa: E731
    pull = np.array([2.0, 0, 0.9]) - foot
    # The foot slides along the sphere as the face rises.
    along = np.array([-0.3 / foot[0], 0, 1.0])
    expected = -pull @ along / np.linalg.norm(pull)
    np.testing.assert_allclose(jax.jit(jax.grad(value))(rows[1].upper)[2], expected, rtol=1e-4)


@pytest.mark.parametrize("scale", [1.0, 1e-25])
def test_derivatives_in_coefficients_do_not_vanish_where_squares_of_gradients_do(scale):
    rows, constants = in_single(scale)

    def value(coefficients):
        moving = rows[0], replace(rows[1], coefficients=coefficients, upper=jnp.full(3, 2, np.float32))
        return balance.from_place(moving, constants).numbers["value"]

    # The foot rises by -df / |grad f| = -df / (2 scale).
    change = jax.jit(jax.grad(value))(rows[1].coefficients)[0, 0, 0] * scale
    np.testing.assert_allclose(change, 0.5, rtol=1e-5)


@pytest.mark.slow
def test_feet_that_do_not_count_stay_where_they_are():
    # Two points above a sphere; the third and fourth foot have no multiplier, and lie on no face.
    feet = np.array([[0.0, 0, 1], NORMAL])
    a = jhd.TriangleMesh([[0.8, 0, 2.4], [0.9, 1, 2.4], [0.9, -1, 2.4]], [[0, 1, 2]])
    found = found_at([0.8, 0, 2.4], feet, [0.5, 0.5], [1.0, 0, 0], [0.0, 0, 0])

    def moved(lower, upper):
        b = jhd.ImplicitSurface(sphere(1.0, np.zeros(3)), lower, upper, reduced=False)
        return with_place_derivatives(found, a, b).witness.feet

    box = jnp.full(3, -2.0), jnp.full(3, 2.0)
    assert not any(np.any(x) for x in jax.jacrev(moved, (0, 1))(*box))
    second = jax.jit(jax.jacfwd(jax.jacrev(moved, (0, 1)), (0, 1)))(*box)
    assert not any(np.any(x) for x in jax.tree_util.tree_leaves(second))


@pytest.mark.parametrize("nowhere", swept([np.nan, np.inf], quick=1, slow=1))
def test_refused_pairs_have_the_derivative_zero_in_reverse_mode_too(nowhere):
    nothing, infinite = jnp.full(3, nowhere), jnp.asarray(jnp.inf)
    solution = MinimumSolution(infinite, infinite * 0 + 0, infinite, nothing, nothing, RESULTS.nonfinite_value, {})

    @jax.jit
    def value(coefficients, points):
        surface = Polynomial(*(TouchedRows(x) for x in (coefficients, jnp.full(3, -2.0), jnp.full(3, 2.0))))
        parts = NetRows(TouchedRows(points, jnp.asarray(0)), None), surface
        constants = solution, jnp.full(5, nowhere), infinite
        return following(balance.from_pair, {"value": infinite}, parts, constants)["value"]

    slopes = jax.jit(jax.grad(value, (0, 1)))(jnp.full((3, 3, 3), nowhere), jnp.ones((1, 3, 3, 3)))
    assert not any(np.any(x) for x in slopes)


@pytest.mark.slow
def test_second_derivatives_at_a_collapsed_edge_are_refused():
    # An octant of the unit sphere, whose last edge is the pole.
    s = np.sqrt(0.5)
    points = np.array(
        [[[1, 0, 0], [1, 0, 1], [0, 0, 1]], [[1, 1, 0], [1, 1, 1], [0, 0, 1]], [[0, 1, 0], [0, 1, 1], [0, 0, 1]]]
    )
    b = jhd.BezierPatches(points[None].astype(float), np.outer([1, s, 1], [1, s, 1])[None])
    found = found_at([0.0, 0, 2], [[0.0, 0, 1]], [1.0], params=[0.5, 1.0])
    value = lambda point: with_place_derivatives(found, jhd.point_set(point[None]), b).value  # noqa: E731
    point = jnp.asarray([0.0, 0, 2])
    np.testing.assert_allclose(jax.jit(jax.grad(value))(point), [0, 0, 1], atol=1e-12)
    assert np.all(np.isnan(jax.jit(jax.hessian(value))(point)[:2, :2]))
