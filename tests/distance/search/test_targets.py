"""Nearest points of surfaces: proven, against closed forms in rational numbers at every scale; their derivatives."""

from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.normalization.net_jets import Net
from jhd._distance.search import targets
from jhd._distance.search.patch_samples import samples_of, starts_among
from jhd._distance.search.targets import target_of
from jhd._results.solution import RESULTS, name_of
from tests.differences import differences
from tests.sweeps import swept

RNG = np.random.default_rng(20)
# A square of side 3 in the plane z = 0: these floats are exact.
GRID = np.stack([*np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), np.zeros((4, 4))], axis=-1)
BUMPY = GRID + 0.4 * RNG.normal(size=GRID.shape)
SPHERE = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2, -2, -2], [2, 2, 2])


def from_square(point, scale, away=0.0):
    """The squared distance to the square times a power of two, moved along all axes, exactly."""
    p = [Fraction(float(x)) - Fraction(float(away)) for x in point]
    side = 3 * Fraction(float(scale))
    return sum((x - min(max(x, 0), side)) ** 2 for x in p[:2]) + p[2] ** 2


def encloses(found, squares):
    """Whether the bounds hold, in rational numbers, without a tolerance."""
    rows = zip(np.asarray(found.lower), np.asarray(found.upper), squares, strict=True)
    return all(
        Fraction(float(low)) ** 2 <= square and (np.isinf(high) or square <= Fraction(float(high)) ** 2)
        for low, high, square in rows
    )


# The last number says how far the square and the queries are from the origin, in its scale.
@pytest.mark.parametrize(
    ("patch", "query", "away"),
    [(0, 0, 0), (-990, -990, 0), (1000, 1000, 0), (0, 900, 0), (-900, 900, 0), (0, -600, 0)]
    + [(0, 0, 1e5), (0, 0, -1e8), (-100, -100, 1e8), (100, 100, 1e15), (0, 60, 1e8), (0, -600, 1e8), (-900, 900, 1e5)],
)
def test_distances_to_a_square_are_enclosed_at_every_scale_and_place(patch, query, away):
    s, q = 2.0**patch, 2.0**query
    special = [[0, 0, 0], [1, 2, 0], [3, 3, 1], [1, 1, 1e-9], [4, 4, 4]]
    points = np.concatenate([RNG.normal(size=(4, 3)) * 3, special]) * q + away * s
    found = jhd.project(points, jhd.BezierPatch((GRID + away) * s))
    squares = [from_square(p, s, away * s) for p in points]
    assert encloses(found, squares)
    exact = np.array([float(x / Fraction(q) ** 2) ** 0.5 for x in squares]) * q
    assert ends_of(found) == {"successful"}
    room = 1e-12 * (exact + 3 * s) + 4 * np.finfo(float).tiny
    assert np.all(np.asarray(found.upper) - exact <= room)
    assert np.all(exact - np.asarray(found.lower) <= room)


def ends_of(found):
    """The names of how each query ended."""
    return {name_of(jax.tree_util.tree_map(lambda x, k=k: x[k], found.result)) for k in range(len(found.lower))}


# Rounded to so few digits that they and their sums with the places below are exact.
NET, WEIGHTS = np.round(BUMPY * 2**20) / 2**20, np.random.default_rng(22).uniform(0.5, 2.0, GRID.shape[:2])


def ellipsoid(away):
    x, y, z = (f"({v} - {away:.0f})" for v in "xyz")
    return jhd.ImplicitSurface.parse(f"{x}**2 + {y}**2 + 2*{z}**2 - 4", [away - 3] * 3, [away + 3] * 3)


FAR = {
    "patch": lambda away: jhd.BezierPatch(NET + away),
    "rational": lambda away: jhd.BezierPatch(NET + away, WEIGHTS),
    "spline": lambda away: jhd.BSplineSurface.clamped(NET + away, (2, 2), WEIGHTS),
    "implicit": ellipsoid,
}


@pytest.mark.slow
@pytest.mark.parametrize("away", [1e5, 2.0**26])
@pytest.mark.parametrize("name", FAR)
def test_far_from_the_origin_bounds_are_as_close_as_about_it(name, away):
    points = np.round(np.random.default_rng(21).normal(size=(50, 3)) * 3 * 2**20) / 2**20
    surface = FAR[name](away)
    if name == "implicit":
        moved = ellipsoid(0.0)
    else:
        patches = surface.patches()
        moved = jhd.BezierPatches(np.asarray(patches.control_points) - away, patches.weights)
    here, there = jhd.project(points, moved, throw=False), jhd.project(points + away, surface)
    assert ends_of(there) == {"successful"}
    assert np.all((here.lower <= there.upper) & (there.lower <= here.upper))
    assert np.all(there.upper - there.lower <= 1e-12 * (there.upper + 3))
    # Feet are as good as coordinates there.
    far = np.abs(np.linalg.norm(np.asarray(there.foot) - points - away, axis=1) - np.asarray(there.distance))
    assert np.all(far <= 4 * np.finfo(float).eps * away)


@pytest.mark.slow
def test_feet_of_patches_are_points_of_the_piece_named_at_the_parameters_named():
    patches = jhd.BezierPatches(np.stack([BUMPY, BUMPY + [0, 0, 2.0], BUMPY + [3, 0, 0]]))
    points = RNG.normal(size=(3, 5, 3)) * 2 + [1, 1, 0]
    found = jhd.project(points, patches)
    assert found.distance.shape == (3, 5)
    assert found.t.shape == (3, 5, 2)
    there = patches.point(found.element, found.t[..., 0], found.t[..., 1])
    np.testing.assert_allclose(there, found.foot, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(np.asarray(found.foot) - points, axis=-1), found.distance, rtol=1e-13)
    u, v = np.meshgrid(np.linspace(0, 1, 90), np.linspace(0, 1, 90), indexing="ij")
    samples = np.concatenate([np.asarray(patches.point(k, u, v)).reshape(-1, 3) for k in range(3)])
    nearest = np.array([np.linalg.norm(samples - p, axis=1).min() for p in points.reshape(-1, 3)]).reshape(3, 5)
    assert np.all(np.asarray(found.lower) <= nearest)
    assert np.all(nearest <= np.asarray(found.upper) + 0.05)


@pytest.mark.slow
def test_a_quarter_of_a_cylinder_and_collapsed_edges_are_measured_as_their_formulas_say():
    w = np.sqrt(0.5)
    arc, weights = np.array([[1.0, 0], [1, 1], [0, 1]]), np.array([1, w, 1])
    cylinder = jhd.BezierPatch(
        np.stack([np.concatenate([arc, np.full((3, 1), z)], axis=1) for z in (0.0, 2.0)]), np.stack([weights] * 2)
    )
    points = np.abs(RNG.normal(size=(8, 3))) * [1, 1, 0.5]
    found = jhd.project(points, cylinder)
    inside = np.clip(points[:, 2], 0, 2) - points[:, 2]
    exact = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 1, inside)
    np.testing.assert_allclose(found.distance, exact, atol=1e-13)
    assert np.all(np.asarray(found.upper - found.lower) < 1e-11)
    fan = GRID * (np.arange(4.0) / 3)[:, None, None]  # the first edge is one point
    found = jhd.project([[-1.0, 0, 0], [0, 0, 1]], jhd.BezierPatch(fan))
    np.testing.assert_allclose(found.distance, [1, 1], atol=1e-13)


@pytest.mark.slow
def test_distances_to_a_sphere_are_those_of_its_formula_from_its_center_to_far_away():
    points = np.concatenate(
        [RNG.normal(size=(20, 3)), [[0, 0, 0], [1, 0, 0], [1e30, 0, 0], [0, 1e-200, 0], [0, 0, 1e300]]]
    )
    found = jhd.project(points, SPHERE)
    size = np.array([Fraction(0)] * len(points), object)
    for k, p in enumerate(points):
        size[k] = sum(Fraction(float(x)) ** 2 for x in p)
    for low, high, square in zip(np.asarray(found.lower), np.asarray(found.upper), size, strict=True):
        # | |p| - 1 | lies in [low, high]: |p| in [1 - high, 1 - low] or in [1 + low, 1 + high].
        low, high = Fraction(float(low)), Fraction(float(high))
        assert (1 + low) ** 2 <= square <= (1 + high) ** 2 or max(1 - high, 0) ** 2 <= square <= (1 - low) ** 2
    length = np.array([np.abs(p).max() * np.linalg.norm(p / max(np.abs(p).max(), 1e-300)) for p in points])
    np.testing.assert_allclose(found.distance, np.abs(length - 1), rtol=1e-12, atol=1e-12)
    assert np.all(np.asarray(found.upper - found.lower) <= 1e-12 * np.maximum(length, 4))
    assert np.all(np.asarray(found.element) == -1)
    assert np.all(np.isnan(found.t))
    np.testing.assert_allclose(np.linalg.norm(np.asarray(found.foot), axis=1), 1, atol=1e-14)


@pytest.mark.slow
def test_where_a_polynomial_does_not_change_its_sign_a_point_is_proven_or_only_a_lower_bound():
    corners = [-2, -2, -2], [2, 2, 2]
    center = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2", *corners)
    found = jhd.project([[1.0, 0, 0], [0, 0, 3]], center)
    assert np.all(np.asarray(found.lower) <= [1, 3]) and np.all([1, 3] <= np.asarray(found.upper))
    assert np.allclose(found.upper, [1, 3], rtol=1e-14, atol=0)
    # A fraction that no evaluation in floats finds to be a zero.
    hidden = jhd.ImplicitSurface.parse("(9973*x - 4000)**2 + 99460729*(y**2 + z**2)", *corners)
    found = jhd.project([[1.0, 0, 0], [0, 0, 3]], hidden, throw=False)
    assert [name_of(jax.tree_util.tree_map(lambda x, k=k: x[k], found.result)) for k in (0, 1)] == [
        "existence_not_certified"
    ] * 2
    assert np.all(np.isinf(found.upper))
    assert np.all(np.asarray(found.lower) <= [5973 / 9973, np.hypot(3, 4000 / 9973)])
    with pytest.raises(jhd.NotProvenError):
        jhd.project([1.0, 0, 0], hidden)


def test_surfaces_are_refused_where_they_have_no_point_and_methods_where_they_serve_curves():
    with pytest.raises(ValueError, match="empty"):
        jhd.project([0.0, 0, 0], jhd.ImplicitSurface.parse("x**2 + 1", [-1, -1, -1], [1, 1, 1]))
    with pytest.raises(TypeError, match="None for surfaces"):
        jhd.project([0.0, 0, 0], SPHERE, jhd.BestFirstProjection())
    with pytest.raises(ValueError, match="shape"):
        jhd.project([0.0, 0], jhd.BezierPatch(GRID))


STEP = 1e-4


def on_patch(points, net):
    found = jhd.project(points, jhd.BezierPatch(net))
    return found.distance, found.foot, found.t


def on_surface(points, coefficients, lower, upper):
    found = jhd.project(points, jhd.ImplicitSurface(coefficients, lower, upper, reduced=False))
    return found.distance, found.foot


BORDER = jhd.ImplicitSurface.parse("x**2 + 2*y**2 + 3*z**2 + x*y*z - 1", [-1.5, -0.4, -2], [2, 2, 2])


@pytest.mark.parametrize(
    ("function", "arrays"),
    swept(
        [
            (on_patch, (np.array([[1.0, 1, 2], [-1, 1, 1], [4, 5, 0], [2, 1, -1]]), BUMPY)),
            (on_surface, (np.array([[0.1, -0.9, 1.1], [1, 1, 1], [0.2, -2, 0]]), BORDER.coefficients, *BORDER.bounds)),
        ],
        slow=1,
    ),
)
def test_derivatives_of_nearest_points_are_those_of_differences_and_the_same_under_jit_and_vmap(function, arrays):
    arrays = [jnp.asarray(x) for x in arrays]
    directions = [jnp.asarray(RNG.normal(size=x.shape)) for x in arrays]
    value, change = jax.jvp(function, arrays, directions)
    for moved, seen in zip(change, differences(function, arrays, directions, STEP), strict=True):
        np.testing.assert_allclose(moved, seen, atol=1e-10)
    compiled = jax.jit(jax.value_and_grad(lambda *x: jnp.sum(function(*x)[0]), tuple(range(len(arrays)))))(*arrays)
    np.testing.assert_allclose(compiled[0], np.sum(value[0]), rtol=1e-14)
    along = sum(float(np.sum(x * d)) for x, d in zip(compiled[1], directions, strict=True))
    np.testing.assert_allclose(along, np.sum(change[0]), rtol=1e-10)
    alone = jax.vmap(lambda p: function(p, *arrays[1:])[0])(arrays[0])
    np.testing.assert_allclose(alone, value[0], rtol=1e-14)
    gradient = jax.grad(lambda p: function(p, *arrays[1:])[0])
    bent = jax.jvp(gradient, (arrays[0][0],), (directions[0][0],))[1]
    (seen,) = differences(lambda p: [gradient(p)], [arrays[0][0]], [directions[0][0]], STEP)
    np.testing.assert_allclose(bent, seen, atol=1e-9)


def unit_sphere():
    """Eight rational octants, each with one edge collapsed at a pole."""
    arc = np.array([1, np.sqrt(0.5), 1])
    w = np.outer(arc, arc)
    rows = np.array([[[x, y, 0], [x, y, 1], [0, 0, 1]] for x, y in ((1, 0), (1, 1), (0, 1))], float)
    signs = np.array(list(np.ndindex(2, 2, 2))) * 2 - 1
    return jhd.BezierPatches(rows * signs[:, None, None], np.stack([w] * 8))


def polar(angle, turn):
    """Points of the unit sphere about its pole (0, 0, 1)."""
    return np.stack([np.cos(turn) * np.sin(angle), np.sin(turn) * np.sin(angle), np.cos(angle)], axis=1)


def derivatives_beside_a_sphere(normal, distance):
    """Gradients, and second derivatives in units of the exact ones, at queries on some rays from the center."""
    ball = unit_sphere()
    value = lambda p: jhd.project(p, ball).distance  # noqa: E731
    foot = lambda p: jhd.project(p, ball).foot  # noqa: E731
    functions = jax.grad(value), jax.hessian(value), jax.jacobian(foot)
    gradient, hessian, moved = (np.asarray(jax.jit(jax.vmap(f))((1 + distance) * normal)) for f in functions)
    # The distance is |p| - 1, the foot p / |p|.
    exact = np.eye(3) - normal[:, :, None] * normal[:, None]
    return gradient, [(1 + distance) * found - exact for found in (hessian, moved)]


@pytest.mark.parametrize(("many", "distance"), swept([(False, 1.0), *((True, d) for d in (1.0, 1e-3, 99.0))], slow=1))
def test_second_derivatives_beside_a_pole_are_right_and_unknown_on_it(many, distance):
    angle = np.array([0.0, 3e-10, 1e-9, 1e-8, 1e-7, 3e-7, 1e-6, 1e-4, 0.3])
    turn = np.full(len(angle), np.arctan2(0.8, 0.6))
    if many:
        rng = np.random.default_rng(7)
        angle = np.append(0.0, 10.0 ** rng.uniform(-9.5, -0.5, 4000))
        turn = rng.uniform(0, 2 * np.pi, len(angle))
    normal = polar(angle, turn)
    gradient, offs = derivatives_beside_a_sphere(normal, distance)
    unknown = np.isnan(offs[0][:, 0, 0])
    np.testing.assert_allclose(gradient[~unknown], normal[~unknown], atol=1e-12)
    # So near to the pole that distances do not tell the octant of the foot, it may be unknown.
    told = 1e-6 if distance > 1 else 1e-7
    np.testing.assert_allclose(gradient, normal, atol=told if many else 1e-12)
    assert unknown[0]
    assert np.all(angle[unknown] < told)
    assert np.sum(unknown) <= len(angle) / 100 + 1
    for off in offs:
        assert np.all(np.isnan(off[unknown]))
        np.testing.assert_allclose(off[~unknown], 0, atol=2e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("distance", [1e-3, 1.0, 99.0])
def test_derivatives_beside_a_border_of_two_patches_are_those_of_the_surface(distance):
    rng = np.random.default_rng(4)
    beside = 10.0 ** rng.uniform(-9, -5, 1000) * rng.choice([-1, 1], 1000)
    along = rng.uniform(0.1, 1.4, 1000)
    # The places are beside a side of two octants, and beside the equator.
    for normal in (polar(along, beside), polar(np.pi / 2 + beside, along)):
        gradient, offs = derivatives_beside_a_sphere(normal, distance)
        np.testing.assert_allclose(gradient, normal, atol=1e-12)
        for off in offs:
            np.testing.assert_allclose(off, 0, atol=1e-6)


@pytest.mark.slow
def test_a_border_of_another_piece_is_nearest_also_beside_a_query_from_afar():
    # The first feet are on the larger piece; the unit of queries is that of the one from afar.
    below = [[[x, y, -0.5] for y in (-1.0, 1.0)] for x in (-1.0, 1.0)]
    beside = [[[x, y, 0.45 + y] for y in (0.0, 1.0)] for x in (-10.0, 10.0)]
    both = jhd.BezierPatches(np.array([below, beside]))
    alone = jhd.project(np.array([[0.37, -0.02, 0.0]]), both)
    found = jhd.project(np.array([[0.37, -0.02, 0.0], [1e285, 0.0, 0.0]]), both)
    np.testing.assert_allclose(alone.distance, np.hypot(0.45, 0.02), rtol=1e-12)
    np.testing.assert_allclose([found.lower[0], found.upper[0]], alone.distance[0], rtol=1e-11)


@pytest.mark.slow
def test_beyond_a_long_side_of_a_narrow_patch_second_derivatives_are_known():
    strip = jhd.BezierPatch(np.array([[[x, y, 0.0] for y in (0.0, 5e-8)] for x in (0.0, 1.0)]))
    hessian = jax.hessian(lambda p: jhd.project(p, strip).distance)(jnp.array([0.4, 1.0, 0.5]))
    way = np.array([0.0, 1.0, 0.5]) / np.sqrt(1.25)
    exact = (np.diag([0.0, 1.0, 1.0]) - np.outer(way, way)) / np.sqrt(1.25)
    np.testing.assert_allclose(hessian, exact, atol=1e-6)


@pytest.mark.slow
def test_above_an_apex_feet_are_not_looked_for_all_around(monkeypatch):
    corners = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    cone = jhd.BezierPatches(
        np.array([[[[0, 0, 1.0], p], [[0, 0, 1.0], np.roll(corners, -1, 0)[k]]] for k, p in enumerate(corners)])
    )
    counts: list[int] = []
    target: Any = target_of(cone)
    moved = target._moved
    monkeypatch.setattr(target, "_moved", lambda points, *given: counts.append(len(points)) or moved(points, *given))
    queries = np.array([0, 0, 2.0]) + 0.1 * np.random.default_rng(0).normal(size=(50, 3))
    found = target.near(queries)
    np.testing.assert_allclose(found.distance, np.linalg.norm(queries - [0, 0, 1.0], axis=1), rtol=1e-12)
    # The first feet, and those from the same place on the neighbors.
    assert sum(counts) <= 4 * len(queries)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_samples_around_a_pole_are_all_known_in_every_precision(dtype):
    rng = np.random.default_rng(1)
    for _ in range(20):
        points, weights = rng.uniform(-1, 1, (4, 3, 3, 3)), rng.uniform(0.5, 2, (4, 3, 3))
        points[:, :, 0] = rng.uniform(-1, 1, 3)
        net: Any = Net(*(jnp.asarray(x, dtype) for x in (points, weights)))
        samples = samples_of(jax.tree_util.tree_map(np.asarray, net), np.linspace(0, 1, 6))
        poles = starts_among(samples.reshape(4, 6, 6, 3)).poles
        assert poles.shape == (1, 24)
        assert set(poles[0]) == {36 * piece + 6 * k for piece in range(4) for k in range(6)}


@pytest.mark.slow
def test_a_batch_of_points_under_vmap_is_one_call_of_the_host(monkeypatch):
    calls = []
    answer = targets._answer
    monkeypatch.setattr(targets, "_answer", lambda *given: calls.append(len(given[0])) or answer(*given))
    rng = np.random.default_rng(0)
    points, nets = jnp.asarray(rng.normal(size=(3, 5, 2, 3))), jnp.asarray(rng.normal(size=(3, 4, 4, 3)))
    distance = lambda p, net: jhd.project(p, jhd.BezierPatch(net)).distance  # noqa: E731
    over_points = jax.vmap(jax.vmap(distance, (0, None)), (0, None))
    found = jax.jit(jax.vmap(over_points))(points, nets)
    assert calls == [10] * 3
    calls.clear()
    alone = [jax.jit(over_points)(p, net) for p, net in zip(points, nets, strict=True)]
    assert calls == [10] * 3
    plain = [distance(p.reshape(-1, 3), net).reshape(5, 2) for p, net in zip(points, nets, strict=True)]
    for values in (found, jnp.stack(alone)):
        np.testing.assert_array_equal(values, jnp.stack(plain))


@pytest.mark.slow
def test_at_distance_zero_and_where_all_of_the_surface_is_nearest_derivatives_are_finite():
    for query, expected in (([1.0, 0, 0], 0.0), ([0.0, 0, 0], 1.0)):
        gradient = jax.grad(lambda p: jhd.project(p, SPHERE).distance)(jnp.asarray(query))
        assert abs(float(jnp.linalg.norm(gradient)) - expected) < 1e-9


@pytest.mark.slow
def test_where_no_point_is_proven_derivatives_are_finite():
    line = jhd.ImplicitSurface.parse("x**2 + y**2", [-2, -2, -2], [2, 2, 2])

    def distance(point, coefficients):
        surface = jhd.ImplicitSurface(coefficients, line.lower, line.upper, reduced=False)
        return jhd.project(point, surface, throw=False).distance

    for slope in jax.grad(distance, (0, 1))(jnp.array([1.0, 0.5, 0]), line.coefficients):
        assert bool(jnp.all(slope == 0))


@pytest.mark.slow
def test_under_jit_what_is_no_number_is_said_to_be_none():
    found = jax.jit(lambda p: jhd.project(p, SPHERE))(jnp.array([[jnp.nan, 0, 0], [2.0, 0, 0]]))
    names = [RESULTS.nonfinite_value, RESULTS.successful]
    assert bool(jnp.all(found.result == jax.tree_util.tree_map(lambda *x: jnp.stack(x), *names)))
    assert np.isinf(found.upper[0])
    assert float(found.lower[0]) == 0


@pytest.mark.slow
def test_a_target_says_upper_bounds_at_once_and_stops_where_enough_is_known():
    points = RNG.normal(size=(30, 3)) + [1, 1, 0]
    for shape in (jhd.BezierPatch(BUMPY), SPHERE, jhd.point_set(BUMPY.reshape(-1, 3))):
        target = target_of(shape)
        found = target.nearest(points)
        assert np.all(target.feet(points) >= np.asarray(found.lower))
        some = target.nearest(points, float(np.median(np.asarray(found.upper))))
        assert np.all(np.asarray(some.lower) <= np.asarray(found.upper))
        top = np.asarray(found.lower) > np.median(np.asarray(found.upper))
        np.testing.assert_allclose(np.asarray(some.lower)[top], np.asarray(found.lower)[top], atol=1e-11)
