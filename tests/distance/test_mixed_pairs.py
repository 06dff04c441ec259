"""Shapes of two kinds, and parametric surfaces: against closed forms, dense samples, and differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._results.solution import name_of
from tests.differences import differences
from tests.sweeps import swept

RNG = np.random.default_rng(12)
GRID = np.stack([*np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), np.zeros((4, 4))], axis=-1)
# The square [-2, 2]^2 in the plane z = 0 three times: a patch, a mesh with a vertex that has no triangle, and a
# polynomial in its box.
PLANES = {
    "patch": jhd.BezierPatch((GRID - [1.5, 1.5, 0]) * [4 / 3, 4 / 3, 1]),
    "mesh": jhd.TriangleMesh([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0], [1e12] * 3], [[0, 1, 2], [0, 2, 3]]),
    "polynomial": jhd.ImplicitSurface.parse("z", [-2, -2, -3], [2, 2, 4]),
}
SPHERE = jhd.ImplicitSurface.parse("x**2 + y**2 + (z - 5)**2 - 1", [-2, -2, 3], [2, 2, 7])
ROUND = jhd.circle([0.0, 0.0], 1.0)
# A circle about (0, 0, 2), tilted so that its highest point is 4 / 5 above the middle; one that is not.
TILTED = ROUND.transform([[1.0, 0], [0, 0.6], [0, 0.8]], [0.0, 0.0, 2.0])
LEVEL = ROUND.transform([[1.0, 0], [0, 1], [0, 0]], [0.0, 0.0, 2.0])
WIDE = jhd.BezierSegments(np.array([[[-2.0, 0, 1], [2, 0, 1]]]))
ARC = np.sqrt(0.5)
# A quarter of a cylinder of radius one about the z axis.
CYLINDER = jhd.BezierPatch(
    np.array([[[1.0, 0, z], [1, 1, z], [0, 1, z]] for z in (0.0, 2.0)]), np.array([[1, ARC, 1]] * 2)
)
# References are rounded by a few units of the last place, and the stored arcs are as far from circles.
EXACT = 4e-15

BUMPY = jhd.BezierPatches(np.stack([GRID, GRID + [3, 0, 0]]) + 0.3 * RNG.normal(size=(2, 4, 4, 3)))
ROUGH = GRID.reshape(-1, 3) * [2, 1, 1] + 0.2 * RNG.normal(size=(16, 3))
CORNERS = np.array([(4 * i + j, 4 * i + j + 4, 4 * i + j + 1) for i in range(3) for j in range(3)])
COARSE = jhd.TriangleMesh(ROUGH, np.concatenate([CORNERS, CORNERS[:, [1, 1, 2]] + [0, 1, 0]]))
CURVE = jhd.BezierSegments(RNG.normal(size=(2, 4, 3)) + [2, 1, 0.5])
SADDLE = jhd.ImplicitSurface.parse("z - 0.1*x*y + 0.2*x - 0.03*y**3", [0, 0, -3], [5, 3, 3])
BENT = jhd.BezierPatches(BUMPY.control_points + 0.3 * RNG.normal(size=(2, 4, 4, 3)))
SHAPES = {"patches": BUMPY, "others": BENT, "mesh": COARSE, "curve": CURVE, "polynomial": SADDLE}
MIXES = [("patches", "others"), *[(a, b) for a in SHAPES for b in SHAPES if a != b and "others" not in (a, b)]]
# The quick tests measure one of them. With the slow ones each kind is on either side; patches as targets have
# derivatives in a test of their own.
SLOW = [("mesh", "curve"), ("patches", "mesh")]


def assert_is(solution, exact):
    """The bounds hold but for the rounding of the reference, and are as close as they are meant to be."""
    assert name_of(solution.result) == "successful"
    assert float(solution.lower) <= exact + EXACT * exact and exact - EXACT * exact <= float(solution.upper)
    assert float(solution.upper - solution.lower) < 1e-8
    assert solution.lower <= solution.value <= solution.upper


@pytest.mark.parametrize("plane", swept(PLANES, ["patch", "mesh"], ["polynomial"]))
def test_answers_beside_points_have_one_form_in_compiled_functions_too(plane):
    pair = PLANES[plane], jhd.point_set([[0.0, 0.0, 2.0], [1.0, 0.0, 1.0]])
    found, known = jax.jit(jhd.hausdorff)(*pair), jhd.hausdorff(*pair)
    assert (found.value, found.lower, found.upper) == (known.value, known.lower, known.upper)


@pytest.mark.exhaustive
@pytest.mark.parametrize("plane", PLANES)
def test_curves_and_planes_are_as_far_as_their_formulas_say(plane):
    flat = PLANES[plane]
    found = jhd.directed_hausdorff(TILTED, flat)
    assert_is(found, 2.8)
    np.testing.assert_allclose(found.witness.point, [0, 0.6, 2.8], atol=1e-4)
    assert found.witness.t.shape == ()
    assert_is(jhd.directed_hausdorff(LEVEL, flat), 2.0)
    # A corner of the square is farthest from the circle.
    assert_is(jhd.directed_hausdorff(flat, LEVEL), np.sqrt(4 + (np.sqrt(8) - 1) ** 2))
    assert_is(jhd.hausdorff(flat, WIDE), np.sqrt(5.0))


@pytest.mark.exhaustive
@pytest.mark.parametrize("plane", ["patch", "mesh"])
def test_spheres_and_cylinders_are_as_far_from_planes_as_their_formulas_say(plane):
    flat = PLANES[plane]
    assert_is(jhd.directed_hausdorff(SPHERE, flat), 6.0)
    assert_is(jhd.directed_hausdorff(flat, SPHERE), np.sqrt(33.0) - 1)
    assert_is(jhd.directed_hausdorff(CYLINDER, flat), 2.0)
    # From (-2, -2) to the nearest end of the arc.
    assert_is(jhd.directed_hausdorff(flat, CYLINDER), np.sqrt(13.0))


@pytest.mark.exhaustive
@pytest.mark.parametrize("height", [1.0, 0.5], ids=["face", "inside"])
def test_flat_shapes_beside_a_plane_as_large_as_its_box_are_bounded_in_few_cells(height):
    plane = jhd.ImplicitSurface.parse(f"z - {height}", [-1, -1, -1], [1, 1, 1])
    corners = [[-1.0, -1.0, 0.0], [-1.0, 1.0, 0.2], [1.0, -1.0, 0.0], [1.0, 1.0, 0.2]]
    patch = jhd.BezierPatch(np.array(corners).reshape(2, 2, 3))
    for shape in (patch, jhd.TriangleMesh(corners, [[0, 1, 2], [1, 3, 2]]), jhd.BezierCurve(corners[::3])):
        found = jhd.directed_hausdorff(shape, plane)
        assert_is(found, height)
        assert int(found.stats["cells"]) < 10


@pytest.mark.exhaustive
def test_a_farthest_point_on_a_ridge_of_an_implicit_surface_takes_few_cells():
    # An ellipsoid under an arch, beside its plane of symmetry: two points of the arch are equally near.
    surface = jhd.ImplicitSurface.parse("(x - 0.17)**2 + 1.5*y**2 + 2*(z - 0.1)**2 - 0.3", (-1.5,) * 3, (1.5,) * 3)
    arch = jhd.BezierCurve([(-1.0, 0, 0.2), (-0.9, 0.1, 2.6), (0.9, 0.1, 2.6), (1.0, 0, 0.2)])
    found = jhd.directed_hausdorff(surface, arch)
    assert name_of(found.witness.event) == "one_to_two"
    # The place has to be polished as soon as that leads to the ridge: 160 000 otherwise.
    assert int(found.stats["cells"]) < 20_000


def dome(height):
    """Bilinear patches over the four quarters of a square, whose heights are those of its corners and middles."""
    places = [[(i, j) for j in (-1, 0, 1)] for i in (-1, 0, 1)]
    points = np.array([[(*place, height(*place)) for place in row] for row in places], float)
    return jhd.BezierPatches([points[i : i + 2, j : j + 2] for i in (0, 1) for j in (0, 1)])


def smooth(height):
    """A cubic spline surface over a square, with a knot in the middle of both parameters."""
    xs, knots = np.linspace(-1, 1, 5), [0, 0, 0, 0, 0.5, 1, 1, 1, 1]
    return jhd.BSplineSurface([[(x, y, height(x, y)) for y in xs] for x in xs], knots, knots)


# Shapes with their highest point, and what that is.
TOPS = {
    "apex of a mesh": (
        jhd.TriangleMesh([(0, 0, 1), (-1, -1, 0), (1, -1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3), (0, 3, 1)]),
        "corner",
    ),
    "corner of a curve": (jhd.polyline([(-1, 0, 0), (0, 0, 1), (1, 0.5, 0)]), "corner"),
    "end of a curve": (jhd.polyline([(-1, 0, 0), (0, 0, 1)]), "a_end"),
    "knot of a curve": (
        jhd.BSplineCurve([(-1, 0, 0), (-0.5, 0, 1), (0, 0, 1), (0.5, 0, 1), (1, 0, 0)], [0, 0, 0, 0, 0.5, 1, 1, 1, 1]),
        "b_end",
    ),
    "apex of patches": (dome(lambda x, y: 1 - 0.5 * (abs(x) + abs(y))), "corner"),
    "end of a ridge": (dome(lambda x, y: 1 - 0.5 * abs(x) - 0.2 * y), "a_end"),
    "corner of patches": (dome(lambda x, y: 0.4 * x + 0.3 * y), "a_end"),
    "knot of a surface": (smooth(lambda x, y: 1 - 0.2 * (x * x + y * y)), "b_end"),
}


@pytest.mark.slow
def test_the_farthest_place_on_a_border_of_a_piece_is_an_end_a_corner_or_neither():
    for name, (top, event) in TOPS.items():
        for plane in ("patch", "mesh") if name == "apex of patches" else ("patch",):
            found = jhd.directed_hausdorff(top, PLANES[plane])
            assert name_of(found.witness.event) == event, (name, plane)


@pytest.mark.parametrize(
    ("a", "b"),
    swept([("patch", "mesh"), ("mesh", "patch"), ("patch", "patch"), ("polynomial", "mesh")]),
)
def test_the_same_square_in_three_forms_is_nowhere_far_from_itself(a, b):
    found = jhd.directed_hausdorff(PLANES[a], PLANES[b])
    assert float(found.lower) == 0.0 and float(found.upper) < 1e-9


@pytest.mark.slow
def test_a_line_beside_a_cone_is_as_far_as_its_formula_says():
    cone = jhd.ImplicitSurface.parse("x**2 + y**2 - z**2", [-3, -3, 0.5], [3, 3, 3])
    line = jhd.BezierSegments(np.array([[[3.0, 0, 0.75], [3, 0, 1.25]]]))
    assert_is(jhd.directed_hausdorff(line, cone), 2.25 * np.sqrt(0.5))


@pytest.mark.slow
def test_a_line_below_the_apex_of_a_cone_is_as_far_as_its_ends():
    cone = jhd.ImplicitSurface.parse("x**2 + y**2 - z**2", [-3, -3, 0], [3, 3, 3])
    line = jhd.BezierSegments(np.array([[[-1.0, 0, -2], [1, 0, -2]]]))
    # The gradient vanishes at the apex, which is the nearest point of all of the line.
    found = jhd.directed_hausdorff(line, cone)
    assert_is(found, np.sqrt(5))
    assert int(found.stats["cells"]) < 200


def samples_of(shape, count=3000):
    """Points of a shape, about."""
    share = np.random.default_rng(3)
    if isinstance(shape, jhd.TriangleMesh):
        weights, k = share.dirichlet([0.7] * 3, size=count), share.integers(shape.count, size=count)
        return np.concatenate(
            [np.einsum("nk,nkd->nd", weights, np.asarray(shape.corners)[k]), np.asarray(shape.vertices)]
        )
    if isinstance(shape, jhd.BezierSegments):
        t = np.linspace(0, 1, count // 2)
        return np.concatenate([np.asarray(jhd.BezierCurve(x)(t)) for x in np.asarray(shape.control_points)])
    if isinstance(shape, jhd.BezierPatches):
        u, v = np.meshgrid(*[np.linspace(0, 1, int(np.sqrt(count / 2)))] * 2)
        return np.concatenate([np.asarray(shape.point(k, u, v)).reshape(-1, 3) for k in range(2)])
    x, y = np.meshgrid(np.linspace(0, 5, 60), np.linspace(0, 3, 50))
    points = np.stack([x, y, 0.1 * x * y - 0.2 * x + 0.03 * y**3], axis=-1).reshape(-1, 3)
    return points[np.all((points >= np.asarray(shape.lower)) & (points <= np.asarray(shape.upper)), axis=1)]


@pytest.mark.parametrize(("a", "b"), swept(MIXES, slow=SLOW))
def test_bounds_hold_of_samples_and_close(a, b):
    first, second = SHAPES[a], SHAPES[b]
    rough = jhd.directed_hausdorff(first, second, jhd.BranchAndBound(max_steps=2), throw=False)
    found = jhd.directed_hausdorff(first, second)
    there = samples_of(first)
    nearest = np.min(np.linalg.norm(there[:, None] - samples_of(second, 1500)[None], axis=-1), axis=1)
    # Of the samples that seem farthest the distance is proven.
    most = np.max(np.asarray(jhd.project(there[np.argsort(-nearest)[:20]], second).lower))
    for solution in (rough, found):
        assert most <= float(solution.upper) * (1 + 1e-12)
        assert solution.lower <= solution.value <= solution.upper
    assert float(rough.lower) <= float(found.upper) and float(found.lower) <= float(rough.upper)
    assert float(found.upper - found.lower) < 1e-9
    # The witness is a point of a as far away as is claimed; its feet are points of b.
    at = jhd.project(found.witness.point, first), jhd.project(found.witness.point, second)
    assert float(at[0].lower) < 1e-12 and float(at[1].upper) >= float(found.lower) * (1 - 1e-12)
    assert np.max(np.asarray(jhd.project(found.witness.feet, second).lower)) < 1e-8
    assert abs(float(jnp.sum(found.witness.multipliers)) - 1) < 1e-12


@pytest.mark.slow
def test_both_directions_and_decisions_agree_with_the_directed_distances():
    there, back, both = (
        jhd.directed_hausdorff(BUMPY, COARSE),
        jhd.directed_hausdorff(COARSE, BUMPY),
        jhd.hausdorff(BUMPY, COARSE),
    )
    larger = max(float(there), float(back))
    assert abs(float(both) - larger) < 1e-9
    assert both.witness.t.shape == (3,) and both.witness.feet_params.shape == (4, 3)
    assert name_of(jhd.hausdorff_at_most(BUMPY, COARSE, larger * 1.01).answer) == "yes"
    assert name_of(jhd.hausdorff_at_most(BUMPY, COARSE, larger * 0.99).answer) == "no"


@pytest.mark.slow
@pytest.mark.parametrize("power", [-530, 500])
def test_distances_scale_with_the_shapes(power):
    scale = 2.0**power
    plain, found = (
        jhd.directed_hausdorff(
            jhd.BezierPatches(BUMPY.control_points * s), jhd.TriangleMesh(ROUGH * s, COARSE.triangles)
        )
        for s in (1.0, scale)
    )
    assert float(found.lower) == float(plain.lower) * scale and float(found.upper) == float(plain.upper) * scale


# What differences leave.
DERIVATIVE = 1e-7


def assert_derivative_is(change, function, arrays, directions):
    """A derivative along directions is that of differences."""
    (expected,) = differences(lambda *x: [function(*x)], arrays, directions, step=1e-6)
    np.testing.assert_allclose(change, expected, rtol=DERIVATIVE, atol=DERIVATIVE)


@pytest.mark.parametrize(("a", "b"), swept(MIXES, slow=SLOW[1:]))
def test_derivatives_in_both_shapes_are_those_of_differences(a, b):
    given = [jax.tree_util.tree_flatten(SHAPES[name]) for name in (a, b)]

    def distance(*arrays):
        p, q = (
            jax.tree_util.tree_unflatten(tree, [x, *leaves[1:]])
            for x, (leaves, tree) in zip(arrays, given, strict=True)
        )
        return jhd.directed_hausdorff(p, q).value

    arrays = [jnp.asarray(leaves[0]) for leaves, _ in given]
    directions = [jnp.asarray(np.random.default_rng(4).normal(size=x.shape)) for x in arrays]
    value, change = jax.jvp(distance, arrays, directions)
    assert_derivative_is(change, distance, arrays, directions)
    compiled, gradient = jax.jit(jax.value_and_grad(distance))(*arrays)
    np.testing.assert_allclose(compiled, value, rtol=1e-13)
    np.testing.assert_allclose(gradient, jax.grad(distance)(*arrays), atol=1e-12)


# Steps of differences of first derivatives, and what these know of second ones.
_STEP, _KNOWN = 1e-4, 1e-6
POINTED = {**SHAPES, "points": jhd.point_set(RNG.normal(size=(3, 3)) + [2, 1, 2.5])}
KINDS = [(a, b) for a in POINTED for b in POINTED if a != "others"]


@pytest.mark.parametrize(
    ("entry", "a", "b"),
    swept(
        [(entry, a, b) for entry in ("directed_hausdorff", "minimum_distance") for a, b in KINDS],
        slow=[("directed_hausdorff", "mesh", "patches"), ("minimum_distance", "points", "polynomial")],
    ),
)
def test_second_derivatives_of_all_kinds_are_those_of_differences(entry, a, b):
    shapes = [POINTED[a], POINTED[b if b != a else "others" if a == "patches" else b]]
    given = [jax.tree_util.tree_flatten(shape) for shape in shapes]
    rng = np.random.default_rng(4)
    # A shape and itself are apart after its numbers have moved.
    start = [np.asarray(leaves[0]) for leaves, _ in given]
    start = [x + (0.4 * rng.normal(size=x.shape) * (x != 0) if a == b and k else 0.0) for k, x in enumerate(start)]
    speeds = [0.3 * rng.normal(size=x.shape) * (x != 0) for x in start]

    @jax.grad
    def slope(s):
        moved = [
            jax.tree_util.tree_unflatten(tree, [x + s * speed, *leaves[1:]])
            for x, speed, (leaves, tree) in zip(start, speeds, given, strict=True)
        ]
        return getattr(jhd, entry)(*moved).value

    (expected,) = differences(lambda s: [slope(s)], [0.0], [1.0], _STEP)
    np.testing.assert_allclose(jax.jacfwd(slope)(0.0), expected, rtol=_KNOWN, atol=_KNOWN)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", [0, 5, 10])
def test_two_feet_on_one_patch_that_are_equally_near_share_the_derivative(seed):
    def bumpy(k):
        rng = np.random.default_rng(k)
        return jnp.asarray((GRID / 3 + rng.normal(size=(4, 4, 3)) * [0.1, 0.1, 0.3])[None])

    def distance(p, q):
        return jhd.directed_hausdorff(jhd.BezierPatches(p), jhd.BezierPatches(q)).value

    nets = bumpy(seed), bumpy(seed + 50)
    found = jhd.directed_hausdorff(jhd.BezierPatches(nets[0]), jhd.BezierPatches(nets[1]))
    assert np.count_nonzero(np.asarray(found.witness.multipliers) > 0.1) == 2
    towards = tuple(jnp.asarray(np.random.default_rng(4).normal(size=x.shape)) for x in nets)
    change = jax.jvp(distance, nets, towards)[1]
    assert_derivative_is(change, distance, nets, towards)


@pytest.mark.slow
def test_a_foot_with_a_small_multiplier_is_found_where_the_place_leads_to_it():
    # At the farthest place, on a side of the patch, another triangle counts with a share of 0.024.
    rng = np.random.default_rng(1)
    ends = np.linspace(0, 1, 3), np.linspace(0, 1, 4)
    grids = [np.stack([*np.meshgrid(x, x, indexing="ij"), 0 * x[:, None] * x], axis=-1) for x in ends]
    vertices, net = (grid + 0.25 * rng.normal(size=grid.shape) * [0.3, 0.3, 1] for grid in grids)
    triangles = [[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4], [3, 4, 6], [4, 7, 6], [4, 5, 7], [5, 8, 7]]

    def found(net, vertices):
        return jhd.directed_hausdorff(jhd.BezierPatch(net), jhd.TriangleMesh(vertices, triangles))

    nets = jnp.asarray(net), jnp.asarray(vertices.reshape(-1, 3))
    np.testing.assert_allclose(np.sort(found(*nets).witness.multipliers)[-2:], [0.024, 0.976], atol=1e-3)
    towards = tuple(jnp.asarray(np.random.default_rng(4).normal(size=x.shape)) for x in nets)
    change = jax.jvp(lambda *x: found(*x).value, nets, towards)[1]
    assert_derivative_is(change, lambda *x: found(*x).value, nets, towards)


@pytest.mark.parametrize("seed", swept([2, 7], slow=[7]))
def test_a_place_on_a_face_of_the_box_is_as_far_from_two_points(seed):
    surface = jhd.ImplicitSurface.parse("x**2 + 2*y**2 + z**2 + x*y*z/2 - 1", [-2, -2, -0.5], [2, 2, 0.5])

    def found(points):
        return jhd.directed_hausdorff(surface, jhd.point_set(points))

    points = jnp.asarray(np.random.default_rng(seed).normal(size=(5, 3)))
    witness = found(points).witness
    assert float(witness.point[2]) == 0.5 and np.count_nonzero(np.asarray(witness.multipliers)) == 2
    towards = (jnp.asarray(np.random.default_rng(4).normal(size=points.shape)),)
    change = jax.jvp(lambda x: found(x).value, (points,), towards)[1]
    assert_derivative_is(change, lambda x: found(x).value, (points,), towards)


@pytest.mark.slow
def test_triangles_that_meet_at_a_small_angle_share_the_derivative():
    # Two patches above a valley; the slope of the one is a quarter of that of the other.
    high, along, up = 6e-4, 0.005, 0.02
    share = np.linspace(0, 1, 4)
    basis = np.stack([[1, 3, 3, 1][k] * share**k * (1 - share) ** (3 - k) for k in range(4)], axis=1)
    nets = []
    for low, wide in ((-0.03, 0.05), (0.02, 0.01)):
        x, y = np.meshgrid(low + wide * share, 0.05 * share - 0.02, indexing="ij")
        heights = np.stack([x, y, high + along * x - 0.2 * (x**2 + y**2)])
        nets.append(np.moveaxis(np.linalg.inv(basis) @ heights @ np.linalg.inv(basis).T, 0, -1))
    sides = [[x, y, up * abs(x)] for x in (0.0, 0.1, -0.1) for y in (-0.1, 0.1)]
    valley = jhd.TriangleMesh(sides, [[0, 2, 1], [2, 3, 1], [0, 1, 4], [4, 1, 5]])
    # A gap of this size leaves the place a few millionths of the distance beside the bottom.
    found = jhd.directed_hausdorff(jhd.BezierPatches(np.stack(nets)), valley, jhd.BranchAndBound(atol=1e-9))
    np.testing.assert_allclose(found.value, high / np.sqrt(1 + up**2), rtol=1e-11)
    np.testing.assert_allclose(np.sort(found.witness.multipliers), [0, 0, 0.375, 0.625], atol=1e-6)


def test_shapes_that_are_none_and_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="a has 3 coordinates a point and b has 2"):
        jhd.directed_hausdorff(COARSE, ROUND)
    with pytest.raises(TypeError, match="BranchAndBound.. for BezierPatches and TriangleMesh"):
        jhd.hausdorff(BUMPY, COARSE, jhd.published.TwoStep())
    with pytest.raises(ValueError, match="empty"):
        jhd.directed_hausdorff(jhd.ImplicitSurface.parse("x**2 + 1", [-1] * 3, [1] * 3), COARSE)
    bad = jax.jit(lambda p: jhd.directed_hausdorff(jhd.BezierPatches(p), COARSE))(jnp.full((1, 2, 2, 3), jnp.nan))
    assert name_of(bad.result) == "nonfinite_value" and np.isinf(bad.upper)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("seed", "near"), [(3, True), (4, False)])
def test_an_implicit_surface_farthest_where_two_feet_are_as_near_closes_with_few_cells(seed, near):
    # About such places feet that samples lead to are not the nearest ones: of tens of thousands of cells, once.
    random = np.random.default_rng(seed)
    bent, plane = random.normal(size=(4, 4, 3)), np.stack([*np.mgrid[-1:1:4j, -1:1:4j], np.zeros((4, 4))], axis=-1)
    patch = jhd.BezierPatch(plane + 0.3 * bent if near else 0.7 * random.normal(size=(4, 4, 3)))
    ellipsoid = jhd.ImplicitSurface.parse("x**2 + y**2/2 + z**2/3 - 1", [-2] * 3, [2] * 3)
    found = jhd.directed_hausdorff(ellipsoid, patch)
    assert int(found.stats["cells"]) < 12_000 and name_of(found.witness.event) == "one_to_two"
    away = np.linalg.norm(np.asarray(found.witness.feet[:2]) - found.witness.point, axis=1)
    np.testing.assert_allclose(away, float(found.value), rtol=1e-9)
