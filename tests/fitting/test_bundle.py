"""Fits of surfaces and meshes, of which one maximum of each direction is known."""

import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._fitting.bundle import STATIONARY, evaluated, motions

# A tetrahedron about the origin.
CORNERS = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
TETRAHEDRON = jhd.TriangleMesh(CORNERS, FACES)


def moved(offset):
    return jhd.TriangleMesh(jnp.asarray(CORNERS) + offset, FACES)


def scaled(factors):
    return jhd.TriangleMesh(jnp.asarray(CORNERS) * factors, FACES)


@pytest.mark.slow
def test_a_moved_mesh_finds_its_place():
    seen = []
    fit = jhd.minimize_hausdorff(moved, np.array([0.3, -0.2, 0.1]), TETRAHEDRON, stop_below=1e-3, progress=seen.append)
    assert fit.result == jhd.RESULTS.successful
    assert float(fit.error.upper) <= 1e-3 + 1e-9
    assert np.max(np.abs(fit.parameters)) <= 2e-3
    assert [p.done for p in seen] == sorted(p.done for p in seen)
    assert seen[-1].details["value"] == float(fit.history[-1])
    assert np.all(np.diff(fit.history) <= 0) and int(fit.stats["evaluations"]) <= 61


@pytest.mark.slow
def test_a_mesh_between_two_others_ends_where_its_maxima_cancel():
    # The distance of a tetrahedron stretched by s along x from two copies 0.5 apart along x is never zero.
    two = jhd.TriangleMesh(
        np.concatenate([CORNERS - [0.25, 0, 0], CORNERS + [0.25, 0, 0]]), np.concatenate([FACES, FACES + 4])
    )
    fit = jhd.minimize_hausdorff(moved, np.array([0.2, 0.05, -0.05]), two, max_steps=40)
    gradients = [cut.gradient for cut in evaluated(moved, two, np.asarray(fit.parameters)).cuts]
    assert fit.result == jhd.RESULTS.successful
    assert float(fit.optimality) <= STATIONARY * max(np.linalg.norm(g) for g in gradients)
    assert abs(float(fit.parameters[0])) <= 1e-2
    assert float(fit.history[0]) > float(fit.error.value) > 0.1


@pytest.mark.slow
def test_the_pairs_of_a_fit_are_both_directions():
    fit = jhd.minimize_hausdorff(scaled, np.array([1.2, 1.0, 0.9]), TETRAHEDRON, max_steps=2)
    assert fit.pairs.value.shape == fit.multipliers.shape == (2,)
    assert float(fit.pairs.value[0]) >= float(fit.pairs.value[1])
    assert len(set(np.asarray(fit.pairs.witness.direction._value).tolist())) == 2
    assert fit.result == jhd.RESULTS.fit_steps_exhausted


@pytest.mark.slow
def test_parameters_count_by_how_far_they_move_the_shape():
    np.testing.assert_allclose(motions(moved, np.zeros(3)), np.ones(3))
    np.testing.assert_allclose(motions(lambda p: moved(10 * p), np.zeros(3)), np.full(3, 0.1))

    def sphere(p):
        grid = jnp.zeros((3, 3, 3)).at[2, 0, 0].set(1.0).at[0, 2, 0].set(1.0).at[0, 0, 2].set(1.0)
        return jhd.ImplicitSurface(grid.at[0, 0, 0].set(-(p[0] ** 2)), [-2] * 3, [2] * 3)

    # The radius moves every point by as much.
    np.testing.assert_allclose(motions(sphere, np.array([1.0])), [1.0], rtol=0.1)


@pytest.mark.exhaustive
def test_an_ellipsoid_is_fitted_to_a_sphere():
    def ellipsoid(p):
        grid = jnp.zeros((3, 3, 3)).at[0, 0, 0].set(-1.0)
        return jhd.ImplicitSurface(
            grid.at[2, 0, 0].set(p[0]).at[0, 2, 0].set(p[1]).at[0, 0, 2].set(p[2]), [-2] * 3, [2] * 3
        )

    target = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", [-2] * 3, [2] * 3)
    fit = jhd.minimize_hausdorff(ellipsoid, np.array([0.8, 1.1, 1.3]), target, stop_below=1e-3, max_steps=30)
    assert float(fit.error.upper) <= 1e-3 + 1e-6
    np.testing.assert_allclose(fit.parameters, np.ones(3), atol=5e-3)


@pytest.mark.slow
def test_shapes_of_another_kind_are_refused():
    with pytest.raises(TypeError, match="TriangleMesh"):
        jhd.minimize_hausdorff(lambda p: jhd.point_set(p), np.zeros((1, 3)), TETRAHEDRON)
    with pytest.raises(TypeError, match="target"):
        jhd.minimize_hausdorff(moved, np.zeros(3), "a mesh")  # pyright: ignore[reportArgumentType]
