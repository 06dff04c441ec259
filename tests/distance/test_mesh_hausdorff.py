"""The entries on meshes: both directions, decisions, derivatives, refusals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd

TRIANGLE = np.array([[0, 1, 2]])


def flat(height, size=1.0):
    """A triangle parallel to the plane z = 0."""
    return jhd.TriangleMesh([(0, 0, height), (size, 0, height), (0, size, height)], TRIANGLE)


def test_the_larger_direction_counts_and_is_named():
    small, large = flat(0.0), flat(0.5, 3.0)
    # The corner (3, 0) of the large one is nearest to the corner (1, 0) of the small one.
    exact = np.sqrt(4 + 0.25)
    there, back = jhd.hausdorff(small, large), jhd.hausdorff(large, small)
    for solution in (there, back):
        assert float(solution.lower) <= exact <= float(solution.upper)
        assert float(solution.upper - solution.lower) <= 1e-9
    assert there.direction == jhd.DIRECTIONS.b_to_a and back.direction == jhd.DIRECTIONS.a_to_b
    forward = jhd.directed_hausdorff(small, large)
    assert float(forward.lower) <= 0.5 <= float(forward.upper)


@pytest.mark.parametrize(("threshold", "answer"), [(2.0, "no"), (2.1, "yes")])
def test_decisions_are_proven(threshold, answer):
    assert jhd.hausdorff_at_most(flat(0.0), flat(0.5, 3.0), threshold).answer == getattr(jhd.ANSWERS, answer)


def test_the_derivative_agrees_with_differences():
    rng = np.random.default_rng(0)
    v, w, direction = rng.normal(size=(3, 6, 3))
    triangles = np.array([[0, 1, 2], [3, 4, 5]])

    def value(vertices):
        return jhd.hausdorff(jhd.TriangleMesh(vertices, triangles), jhd.TriangleMesh(w, triangles)).value

    slope = float(jnp.sum(jax.grad(value)(jnp.asarray(v)) * direction))
    difference = (float(value(v + 1e-6 * direction)) - float(value(v - 1e-6 * direction))) / 2e-6
    np.testing.assert_allclose(slope, difference, rtol=1e-6)


def test_other_shapes_and_methods_are_refused(as_a_user):
    mesh = flat(0.0)
    with pytest.raises(
        TypeError, match=r"method must be BranchAndBound\(\) for TriangleMesh and TriangleMesh; got TwoStep."
    ):
        jhd.hausdorff(mesh, mesh, jhd.published.TwoStep())
    with pytest.raises(ValueError, match="a has 3 coordinates a point and b has 2"):
        jhd.hausdorff(mesh, jhd.BezierCurve([(0, 0), (1, 1)]))
