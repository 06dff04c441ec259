"""Multipliers at ends, corners, edges and vertices with equally near feet: between the one-sided derivatives.

Each random case is a short shape about the origin, and pieces of b that touch the unit sphere about it from outside, so
that their feet are equally near. The origin is the farthest point where each way into a brings one of the feet nearer.
"""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog

import jhd
from jhd._distance.witness.multipliers import balanced, share
from jhd._results.solution import name_of
from tests.sweeps import swept

# Differences are off by the curvature times the step, the search of meshes by its tolerance over the step.
STEP, CLOSE = 1e-6, 1e-4
MESH_STEP, MESH_CLOSE = 1e-5, 1e-3
CASES, FEET, DIRECTIONS = 8, 3, 6
LANES = 1 + 2 * DIRECTIONS


class Case(NamedTuple):
    """What is measured: the event expected, both shapes, and directions in which both are moved."""

    event: str
    shapes: list[np.ndarray]
    directions: list[np.ndarray]


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def touching(normals, rng, corners):
    """Segments or triangles that touch the unit sphere at the negative normals, in places near their middle."""
    dim = normals.shape[1]
    flat = rng.uniform(0.5, 1.0, (len(normals), 2, 1)) * np.array([[-1.0], [1.0]])
    if corners == 3:
        angles = 2 * np.pi * (np.arange(3) / 3 + rng.uniform(size=(len(normals), 1)))
        flat = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * rng.uniform(0.8, 1.2, (len(normals), 3, 1))
    frames = [np.linalg.qr(np.column_stack([n, rng.normal(size=(dim, dim - 1))]))[0][:, 1:corners] for n in normals]
    return -normals[:, None] + np.einsum("ncf,ndf->ncd", flat, frames)


def least_violation(slopes):
    """Of all multipliers of the feet the least of the largest slope along the rays; 0 if it falls."""
    count, feet = slopes.shape
    rows, sums = np.column_stack([slopes, -np.ones(count)]), np.append(np.ones(feet), 0.0)
    return linprog(np.eye(feet + 1)[-1], rows, np.zeros(count), sums[None], [1.0]).fun


def random_case(event, feet, dim, rng):
    """A polyline of two segments whose farthest point is its end or corner, and segments that hold two or three feet.

    With two feet both rays of a corner can ask for opposite things; three feet have multipliers here that serve both.
    """
    while True:
        normals, ways = unit(rng.normal(size=(feet, dim))), unit(rng.normal(size=(2, dim)))
        ways = ways if event == "corner" else ways[[0, 0]]
        slopes = ways @ normals.T
        common = least_violation(slopes + 0.02) == 0
        # Most feet alone would send the maximum away.
        misleading = np.sum(np.any(slopes > 0.1, axis=0)) >= feet - 1
        if np.all(slopes.min(axis=1) < -0.05) and misleading and (common or feet == 2):
            break
    rows = [0.1 * ways[0], np.zeros(dim), 0.1 * ways[1]]
    rows = rows if event == "corner" else [rows[1], rows[0], 2 * rows[0]]
    shapes = [np.stack(rows), touching(normals, rng, 2)[[0, 1, -1]]]
    # The one that is repeated has to move as one.
    directions = [rng.normal(size=(DIRECTIONS, *x.shape)) for x in shapes]
    directions[1] = directions[1][:, [0, 1, feet - 1]]
    return Case(event, shapes, directions)


def between_the_arms():
    """The upper end of a segment between the arms of a V; the first direction moves the segment to the right."""
    a = np.array([[0.0, 0.0], [0.6, -0.2], [1.2, -0.4]])
    b = np.array([[[-1.5, 0.5], [0.0, -1.0]], [[0.0, -1.0], [1.5, 0.5]], [[0.0, -1.0], [0.0, -1.0]]])
    directions = [np.zeros((DIRECTIONS, *x.shape)) for x in (a, b)]
    directions[0][:, :, 0] = 1.0
    return Case("a_end", [a, b], directions)


def sharp_corner(order):
    """A corner whose legs both ask for less of the first foot, one of them for more of that than the other."""
    normals = np.array([[1.0, 0.0], [-0.5, np.sqrt(0.75)]])
    # The slopes of both distances along the legs.
    legs = np.linalg.solve(normals, np.array([[0.5, -0.5], [0.4, -0.6]])[order].T).T
    across = 0.7 * np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    rows = np.stack([0.2 * legs[0], np.zeros(2), 0.2 * legs[1]])
    # The first foot is the nearest one by far more than rounding, and both count.
    feet = -normals * [[1 - 1e-13], [1.0]]
    arms = np.stack([feet - across, feet + across], axis=1)[[0, 1, 1]]
    rng = np.random.default_rng(order)
    directions = [rng.normal(size=(DIRECTIONS, *x.shape)) for x in (rows, arms)]
    return Case("corner", [rows, arms], [directions[0], directions[1][:, [0, 1, 1]]])


def beside(case, step):
    """The shapes, those moved along the directions, and those moved against them."""
    pairs = zip(case.shapes, case.directions, strict=True)
    return [np.concatenate([x[None], x + step * v, x - step * v]) for x, v in pairs]


def assert_between(rule, values, step, close):
    """The derivatives along the directions lie between the one-sided differences; both of these are given back."""
    here, ahead, behind = values[0], *np.split(values[1:], 2)
    sides = np.sort(np.stack([ahead - here, here - behind]) / step, axis=0)
    assert np.all(rule >= sides[0] - close) and np.all(rule <= sides[1] + close)
    return sides


def along(gradients, directions):
    """The derivatives along directions that belong to gradients."""
    return sum(np.tensordot(v, np.asarray(g), axes=np.ndim(g)) for g, v in zip(gradients, directions, strict=True))


@jax.jit
@jax.vmap
def measured(a, b):
    def value(shapes):
        solution = jhd.directed_hausdorff(jhd.polyline(shapes[0]), jhd.BezierSegments(shapes[1]))
        return solution.value, solution.witness

    return jax.value_and_grad(value, has_aux=True)((a, b))


@cache
def solved(dim):
    """The cases of a dimension with their values, witnesses and derivatives, all from one program."""
    rng = np.random.default_rng(dim)
    cases = [random_case(("a_end", "corner")[k % 2], 2 + k // 4, dim, rng) for k in range(CASES)]
    if dim == 2:
        cases[0] = between_the_arms()
        cases[1], cases[3] = sharp_corner([0, 1]), sharp_corner([1, 0])
    shapes = zip(*(beside(case, STEP) for case in cases), strict=True)
    (values, witness), gradients = measured(*(jnp.asarray(np.concatenate(x)) for x in shapes))
    split = [[x[k * LANES : (k + 1) * LANES] for x in (np.asarray(values), *gradients)] for k in range(CASES)]
    witnesses = [jax.tree_util.tree_map(lambda x, k=k: x[k * LANES], witness) for k in range(CASES)]
    return list(zip(cases, witnesses, split, strict=True))


@pytest.mark.parametrize("dim", swept([2, 3], slow=1))
def test_at_ends_and_corners_of_curves_the_derivative_is_between_the_one_sided_ones(dim):
    shared = 0
    for case, witness, (values, *gradients) in solved(dim):
        assert name_of(witness.event) == case.event
        np.testing.assert_allclose(witness.point, 0.0, atol=1e-12)
        sides = assert_between(along([g[0] for g in gradients], case.directions), values, STEP, CLOSE)
        assert np.any(sides[1] - sides[0] > 0.1)
        shared += bool(np.all(np.asarray(witness.multipliers) > 0.01))
    assert shared >= 2


@pytest.mark.slow
def test_the_end_between_the_arms_of_a_v_has_the_derivative_of_both_arms():
    case, witness, (values, *gradients) = solved(2)[0]
    sides = assert_between(along([g[0] for g in gradients], case.directions), values, STEP, CLOSE)
    np.testing.assert_allclose(sides[:, 0], [-np.sqrt(0.5), np.sqrt(0.5) / 3], atol=1e-5)
    # Two thirds of the arm that goes away: no more is allowed, and of the nearest foot the most is taken.
    np.testing.assert_allclose(witness.multipliers, [2 / 3, 1 / 3], atol=1e-12)
    np.testing.assert_allclose(gradients[0][0, 0], np.array([1 / 3, 1.0]) * np.sqrt(0.5), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("which", [1, 3])
def test_the_multipliers_of_a_corner_serve_both_of_its_legs(which):
    case, witness, (_, *gradients) = solved(2)[which]
    assert case.event == name_of(witness.event) == "corner"
    # More of the first foot would send the maximum along one of the legs.
    np.testing.assert_allclose(witness.multipliers, [0.5, 0.5], atol=1e-12)
    np.testing.assert_allclose(gradients[0][0, 1], [0.25, np.sqrt(3 / 16)], atol=1e-12)


@pytest.mark.slow
def test_at_an_end_with_two_feet_there_are_second_derivatives():
    case = between_the_arms()
    a, b = (jnp.asarray(x) for x in case.shapes)

    def gradient(a):
        value = lambda a: jhd.directed_hausdorff(jhd.polyline(a), jhd.BezierSegments(b)).value  # noqa: E731
        return jax.grad(value)(a)

    _, second = jax.jvp(gradient, (a,), (jnp.asarray(case.directions[0][0]),))
    # Distances to lines are linear in the point.
    np.testing.assert_allclose(second, 0.0, atol=1e-10)


def test_the_share_of_a_foot_is_the_largest_that_no_ray_forbids():
    for first, second, known in (
        ([1.0, -1.0], [-1.0, 1.0], 0.5),  # inside of a curve: the slopes cancel
        ([1.0, 0.0], [-3.0, 0.0], 0.75),  # an end
        ([-1.0, 0.0], [-3.0, 0.0], 1.0),
        ([1.0, 2.0], [-1.0, -3.0], 0.5),  # a corner: both rays ask for less of the first foot
        ([1.0, -1.0], [-3.0, 3.0], 0.75),
        ([0.0, 0.0], [0.0, 0.0], 1.0),
    ):
        assert float(share(jnp.array(first), jnp.array(second))) == pytest.approx(known, abs=1e-15)


def test_multipliers_in_space_are_admissible_wherever_some_are():
    rng = np.random.default_rng(0)
    found = 0
    for _ in range(100):
        feet, count = rng.integers(1, 9), rng.integers(1, 16)
        units, rays = (
            unit(rng.normal(size=(feet, 3))),
            unit(rng.normal(size=(count, 3)) + np.array([0, 0, rng.integers(3)])),
        )
        weights = balanced(units, rays, np.zeros(feet))
        assert np.all(weights >= 0) and weights.sum() == pytest.approx(1.0) and np.count_nonzero(weights) <= 4
        admissible = least_violation(rays @ units.T) < 1e-12
        found += admissible
        if admissible:
            assert np.max(rays @ units.T @ weights) < 4e-6
    assert 20 < found < 100


def mesh_case(event, rng):
    """Two triangles that meet at an edge about the origin, or at it, and triangles that hold the feet of the origin."""
    while True:
        normals = unit(rng.normal(size=(FEET, 3)))
        way, sides = unit(rng.normal(size=3)), unit(rng.normal(size=(3, 3)))
        vertices = np.stack([np.zeros(3), *sides]) if event == "corner" else np.stack([-way, way, *sides[:2]])
        triangles = np.array([[0, 1, 2], [0, 2, 3]] if event == "corner" else [[0, 1, 2], [0, 1, 3]])
        places = np.einsum("nk,tkd->tnd", rng.dirichlet(np.full(3, 0.5), 2000), vertices[triangles]).reshape(-1, 3)
        places = np.concatenate([unit(places), unit(vertices[np.any(vertices != 0, axis=1)])])
        slopes = places @ normals.T
        alone = np.all(slopes < 0, axis=0)
        farthest = np.all(slopes.min(axis=1) < -0.05) and not np.any(alone)
        if farthest and least_violation(slopes[-200:]) < 1e-9:
            break
    shapes = [0.1 * vertices, touching(normals, rng, 3)]
    return Case(event, shapes, [rng.normal(size=(DIRECTIONS, *x.shape)) for x in shapes]), triangles


@pytest.mark.parametrize("event", ["corner", "one_to_two"])
@pytest.mark.slow
def test_at_edges_and_vertices_of_meshes_the_derivative_is_between_the_one_sided_ones(event):
    rng, kinks = np.random.default_rng(len(event)), 0
    for _ in range(4):
        case, triangles = mesh_case(event, rng)
        own = np.arange(3 * FEET).reshape(-1, 3)

        def solution(a, b, triangles=triangles, own=own):
            return jhd.directed_hausdorff(jhd.TriangleMesh(a, triangles), jhd.TriangleMesh(b.reshape(-1, 3), own))

        values = [float(solution(*x).value) for x in zip(*beside(case, MESH_STEP), strict=True)]
        here = solution(*case.shapes)
        assert name_of(here.event) == event
        np.testing.assert_allclose(here.witness.point, 0.0, atol=1e-9)
        gradients = jax.grad(lambda shapes: solution(*shapes).value)(tuple(jnp.asarray(x) for x in case.shapes))
        sides = assert_between(along(gradients, case.directions), np.array(values), MESH_STEP, MESH_CLOSE)
        kinks += np.any(sides[1] - sides[0] > 0.1)
    assert kinks >= 2
