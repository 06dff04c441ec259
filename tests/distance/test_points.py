"""Sets of points and every other kind of shape, either way: against whole numbers, closed forms, and differences."""

import itertools
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

import jhd
from jhd._distance.search.farthest_place import FarthestSearch
from jhd._results.solution import name_of
from tests.sweeps import swept

RNG = np.random.default_rng(31)
# A square of side 3 in the plane z = 0, as a patch and as a mesh, and the unit sphere.
GRID = np.stack([*np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), np.zeros((4, 4))], axis=-1)
SQUARE = jhd.BezierPatch(GRID)
FLAT = jhd.TriangleMesh([[0.0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0]], [[0, 1, 2], [0, 2, 3]])
SPHERE = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2, -2, -2], [2, 2, 2])
BUMPY = jhd.BezierPatches(np.stack([GRID, GRID + [3, 0, 0]]) + 0.3 * RNG.normal(size=(2, 4, 4, 3)))
CORNERS = np.array([[0.0, 0, 0], [3, 0, 0], [0, 3, 0], [3, 3, 0]])
AXES = np.concatenate([np.eye(3), -np.eye(3)])
UNEVEN = jhd.ImplicitSurface.parse("x**2 + 2*y**2 + 3*z**2 + x*y*z - 1", [-1.5, -0.4, -2], [2, 2, 2])


def assert_encloses(solution, square):
    """The bounds hold in rational numbers, without a tolerance."""
    lower, upper = (Fraction(float(x)) for x in (solution.lower, solution.upper))
    assert lower**2 <= square <= upper**2
    assert lower <= Fraction(float(solution.value)) <= upper


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize(("power", "offset"), [(0, 0), (0, 10**8), (-1000, 0), (900, 0)])
def test_points_among_themselves_are_exact_to_rounding_as_whole_numbers_say(dim, power, offset):
    x, y = (RNG.integers(-500, 500, size=(n, dim)) for n in (300, 400))
    x[:7], y[3:9] = x[0], y[0]  # some are there several times
    squares = np.sum((x[:, None] - y) ** 2, axis=-1)
    a, b = (jhd.point_set((z + offset) * 2.0**power) for z in (x, y))
    there, back, both = jhd.directed_hausdorff(a, b), jhd.directed_hausdorff(b, a), jhd.hausdorff(a, b)
    exact = [int(squares.min(axis=k).max()) * Fraction(2) ** (2 * power) for k in (1, 0)]
    assert_encloses(there, exact[0])
    assert_encloses(back, exact[1])
    assert_encloses(both, max(exact))
    assert float(there.upper - there.lower) <= 1e-14 * float(there.value)
    assert there.witness.feet.shape == (2, dim)
    assert name_of(there.event) == "a_end"
    assert int(squares[int(there.witness.element), int(there.witness.feet_elements[0])]) == squares.min(axis=1).max()


@pytest.mark.parametrize("square", [SQUARE, FLAT], ids=["patch", "mesh"])
def test_points_to_a_square_are_measured_as_its_formula_says(square):
    points = RNG.normal(size=(200, 3)) * 3
    found = jhd.directed_hausdorff(jhd.point_set(points), square)
    exact = max(
        sum((x - min(max(x, 0), 3)) ** 2 for x in map(Fraction, p[:2])) + Fraction(p[2]) ** 2 for p in points.tolist()
    )
    assert_encloses(found, exact)
    assert found.witness.feet.shape == (4, 3)
    assert float(found.upper - found.lower) < 1e-11
    np.testing.assert_array_equal(found.witness.point, points[int(found.witness.element)])


@pytest.mark.parametrize("square", [SQUARE, FLAT], ids=["patch", "mesh"])
@pytest.mark.parametrize(
    ("points", "exact"), swept([(CORNERS[:1], 18), (GRID, Fraction(1, 2)), (CORNERS, Fraction(9, 2))], 2)
)
def test_a_square_is_as_far_from_points_as_its_formula_says(square, points, exact):
    found = jhd.directed_hausdorff(square, jhd.point_set(points.reshape(-1, 3)))
    assert_encloses(found, exact)
    assert float(found.upper - found.lower) < 1e-9
    assert abs(float(jnp.sum(found.witness.multipliers)) - 1) < 1e-12


@pytest.mark.slow
def test_a_sphere_and_points_on_its_axes_are_as_far_as_their_formula_says():
    found = jhd.directed_hausdorff(SPHERE, jhd.point_set(AXES))
    # The farthest are at (1, 1, 1) / sqrt(3), up to signs: 2 - 2 / sqrt(3).
    lower, upper = (Fraction(float(x)) ** 2 for x in (found.lower, found.upper))
    assert (2 - upper) ** 2 * 3 <= 4 <= (2 - lower) ** 2 * 3
    assert float(upper - lower) < 1e-8
    np.testing.assert_allclose(np.abs(np.asarray(found.witness.point)), np.full(3, 3**-0.5), atol=1e-8)
    np.testing.assert_allclose(np.asarray(found.witness.multipliers)[:3], np.full(3, 1 / 3), atol=1e-6)
    back = jhd.directed_hausdorff(jhd.point_set(np.concatenate([AXES, 3 * AXES[:1]])), SPHERE)
    assert float(back.lower) <= 2 <= float(back.upper)
    assert int(back.witness.element) == 6


def test_both_directions_and_decisions_agree_with_the_directed_distances():
    points = jhd.point_set(CORNERS + [0, 0, 1.0])
    both = jhd.hausdorff(points, SQUARE)
    # From the middle of the square: 9/2 and the height.
    assert_encloses(both, Fraction(11, 2))
    assert name_of(both.direction) == "b_to_a"
    assert name_of(jhd.hausdorff_at_most(points, SQUARE, 2.4).answer) == "yes"
    assert name_of(jhd.hausdorff_at_most(SQUARE, points, 2.3).answer) == "no"


@pytest.mark.slow
def test_a_polynomial_without_a_proven_point_leaves_a_bound_missing():
    text = "(9973*x - 4000)**2 + 99460729*(y**2 + z**2)"
    hidden = jhd.ImplicitSurface.parse(text, [-2, -2, -2], [2, 2, 2])
    found = jhd.directed_hausdorff(jhd.point_set(CORNERS), hidden, throw=False)
    assert name_of(found.result) == "existence_not_certified"
    assert np.isinf(found.upper)
    found = jhd.directed_hausdorff(hidden, jhd.point_set(CORNERS), throw=False)
    assert name_of(found.result) == "existence_not_certified"


def test_points_are_refused_where_they_do_not_fit():
    with pytest.raises(ValueError, match="coordinates a point"):
        jhd.directed_hausdorff(jhd.point_set([[0.0, 0]]), SQUARE)
    with pytest.raises(TypeError, match="BranchAndBound"):
        jhd.directed_hausdorff(jhd.point_set(CORNERS), SPHERE, jhd.published.TwoStep())
    with pytest.raises(ValueError, match="empty"):
        jhd.directed_hausdorff(jhd.point_set(CORNERS), jhd.ImplicitSurface.parse("x**2 + 1", [-1] * 3, [1] * 3))


@pytest.mark.slow
def test_an_interruption_in_one_direction_keeps_the_bounds_of_both(monkeypatch):
    monkeypatch.setattr(FarthestSearch, "first_steps", 1)
    points, calls = jhd.point_set(np.random.default_rng(6).normal(size=(400, 3)) + [1.5, 1.5, 0]), []

    def interrupt(progress):
        calls.append(progress.stage)
        raise KeyboardInterrupt

    found = jhd.hausdorff(BUMPY, points, progress=interrupt, throw=False)
    whole = jhd.hausdorff(BUMPY, points)
    assert calls
    assert name_of(found.result) == "interrupted"
    assert float(found.lower) <= float(whole.upper)
    assert np.isfinite(found.upper) and float(found.upper) >= float(whole.lower)
    assert int(found.stats["a_to_b_steps"]) == 1 < int(whole.stats["a_to_b_steps"])
    # From points the first block is always measured, and no more of them here.
    assert int(found.stats["b_to_a_steps"]) == 1


STEP = 1e-5


MOVED = {"patches": BUMPY, "polynomial": UNEVEN, "mesh": FLAT}


@pytest.mark.parametrize(
    ("name", "turned"),
    swept(itertools.product(MOVED, [False, True]), slow=[("mesh", True)]),
)
def test_derivatives_in_points_and_shape_are_those_of_differences(name, turned):
    leaves, tree = jax.tree_util.tree_flatten(MOVED[name])
    points = RNG.normal(size=(12, 3)) * [1.5, 1, 1] + [1, 1, 0]
    method = jhd.BranchAndBound(atol=1e-11)

    def distance(points, leaf):
        pair = jhd.point_set(points), jax.tree_util.tree_unflatten(tree, [leaf, *leaves[1:]])
        a, b = pair[::-1] if turned else pair
        return jhd.directed_hausdorff(a, b, method, throw=False).value

    arrays = jnp.asarray(points), jnp.asarray(leaves[0])
    directions = tuple(jnp.asarray(RNG.normal(size=x.shape)) for x in arrays)
    value, change = jax.jvp(distance, arrays, directions)
    ahead, behind = (distance(*(x + s * STEP * d for x, d in zip(arrays, directions, strict=True))) for s in (1, -1))
    np.testing.assert_allclose(change, (ahead - behind) / (2 * STEP), atol=2e-5)
    compiled, gradient = jax.jit(jax.value_and_grad(distance))(*arrays)
    np.testing.assert_allclose(compiled, value, rtol=1e-13)
    np.testing.assert_allclose(gradient, jax.grad(distance)(*arrays), atol=1e-12)


@pytest.mark.slow
def test_batches_of_sets_of_points_are_measured_one_after_the_other():
    sets = RNG.normal(size=(3, 6, 3))
    found = jax.vmap(lambda p: jhd.directed_hausdorff(jhd.point_set(p), SQUARE).value)(sets)
    np.testing.assert_allclose(found, [float(jhd.directed_hausdorff(jhd.point_set(p), SQUARE)) for p in sets])
    bad = jax.jit(lambda p: jhd.directed_hausdorff(SQUARE, jhd.point_set(p)))(jnp.full((4, 3), jnp.nan))
    assert name_of(bad.result) == "nonfinite_value"
    assert np.isinf(bad.upper)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_minimum_distance_of_many_points_is_exact_as_whole_numbers_say(dim):
    x, y = (RNG.integers(-9000, 9000, size=(n, dim)) for n in (300, 500))
    found = jhd.minimum_distance(jhd.point_set(x), jhd.point_set(y))
    square = int(np.sum((x[:, None] - y) ** 2, axis=-1).min())
    assert_encloses(found, square)
    assert found.point_a.shape == (dim,)
    assert float(jnp.sum((found.point_a - found.point_b) ** 2)) == square


@pytest.mark.parametrize("shape", swept([BUMPY, SPHERE], slow=1))
def test_the_minimum_distance_of_many_points_and_a_surface_is_the_least_of_all(shape):
    points = RNG.normal(size=(2000, 3)) * 4
    points = points[np.linalg.norm(points, axis=1) > 1.2] + [0, 0, 2.5]
    found, back = jhd.minimum_distance(jhd.point_set(points), shape), jhd.minimum_distance(shape, jhd.point_set(points))
    single = jhd.project(points, shape)
    least = int(np.argmin(single.distance))
    assert float(found.lower) <= float(single.upper[least])
    assert float(single.lower[least]) <= float(found.upper)
    assert float(back.lower) <= float(found.upper)
    assert np.argmin(np.linalg.norm(points - np.asarray(found.point_a), axis=1)) == least
    slope = jax.grad(lambda p: jhd.minimum_distance(jhd.point_set(p), shape).value)(jnp.asarray(points))
    np.testing.assert_allclose(np.linalg.norm(slope[least]), 1, atol=1e-6)
    assert np.count_nonzero(np.asarray(slope)) <= 3


def test_the_smallest_distance_of_many_mingled_points_looks_at_few_pairs():
    generator = np.random.default_rng(8)
    a, b = generator.normal(size=(2, 3000, 3))
    found = jhd.minimum_distance(jhd.point_set(a), jhd.point_set(b))
    nearest = KDTree(b).query(a)[0].min()
    assert float(found.lower) <= nearest * (1 + 1e-15) and nearest <= float(found.upper) * (1 + 1e-15)
    assert int(found.stats["exact"]) <= 4


@pytest.mark.parametrize("height", swept([1e-170, 1e-160, 1e-100], slow=[1e-170]))
def test_a_point_nearly_on_a_plane_has_a_true_upper_bound_where_squares_vanish(height):
    plane = jhd.ImplicitSurface.parse("x", [-1.0] * 3, [1.0] * 3)
    found = jhd.project(np.array([[height, 0.0, 0.0]]), plane)
    assert float(found.lower[0]) <= height <= float(found.upper[0])


@pytest.mark.slow
def test_of_points_that_are_one_only_one_is_searched_beside_a_long_curve():
    angles, rows = np.arange(101) * 2 * np.pi / 100, np.zeros((300, 2))
    ring = jhd.polyline(np.c_[np.cos(angles), np.sin(angles)])
    # All in the middle, and one of them halfway to a corner.
    for x, share in ((0.0, 1.0), (0.5, 0.5)):
        rows[200, 0], exact = x, share * np.cos(np.pi / 100)
        found = jhd.minimum_distance(jhd.point_set(rows), ring)
        assert float(found.lower) <= exact * (1 + 1e-15) and exact <= float(found.upper)
        assert int(found.stats["pairs"]) < 2_000


@pytest.mark.parametrize("exponent", [-1030, -1000, 0, 1000])
def test_sets_of_points_agree_with_all_pairs_at_any_size(exponent):
    rng = np.random.default_rng(4)
    # What is left of the digits at this size.
    a, b = (np.ldexp(np.ldexp(rng.normal(size=(count, 2)), exponent), -exponent) for count in (700, 90))
    b[50:60] = b[49]
    table = np.linalg.norm(a[:, None] - b, axis=-1)
    p, q = (jhd.point_set(np.ldexp(x, exponent)) for x in (a, b))
    for solution, exact in (
        (jhd.directed_hausdorff(p, q), table.min(axis=1).max()),
        (jhd.directed_hausdorff(q, p), table.min(axis=0).max()),
    ):
        ends = np.ldexp(np.asarray([solution.lower, solution.upper]), -exponent)
        np.testing.assert_allclose(ends, exact, rtol=1e-11)
        # Most points are closed by their first bounds.
        assert solution.stats["measured"] <= 0.5 * solution.stats["points"]


@pytest.mark.parametrize("exponent", [-1030, 0])
def test_a_set_of_points_is_at_most_zero_from_itself_in_any_order(exponent):
    x = np.ldexp(np.random.default_rng(8).normal(size=(300, 3)), exponent)
    found = jhd.hausdorff(jhd.point_set(x), jhd.point_set(x[::-1]))
    assert float(found.lower) == float(found.upper) == 0.0
    assert jhd.hausdorff_at_most(jhd.point_set(x), jhd.point_set(x[::-1]), 0.0)


def test_points_beyond_all_measure_of_a_surface_are_refused_a_number():
    ball = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2.0] * 3, [2.0] * 3)
    found = jhd.directed_hausdorff(ball, jhd.point_set([[0.0, 0.0, 1e200]]), throw=False)
    assert name_of(found.result) == "existence_not_certified" and float(found.lower) <= 1e200 <= float(found.upper)
