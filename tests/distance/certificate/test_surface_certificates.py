"""Certificates of implicit surfaces with shapes of every kind: what is true is proven sharply, the rest refused."""

import copy
import dataclasses
import itertools
import math
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.certificate.certificate import certify
from jhd._distance.certificate.shape_side import ShapeSide
from jhd._distance.certificate.verification import CertificateError, verify
from jhd._distance.certificate.verification.convexity import failure_in_space
from jhd._distance.certificate.verification.polynomials import elevated, from_coefficients, powers, total
from tests.distance.certificate.made import at, changed, numbers
from tests.sweeps import swept

# How much wider than the true distance the bounds are that are asked for.
SLACK = 1e-9


def flat(height, polynomial="z - {0}"):
    """A square, or what else a polynomial says, about a height."""
    return jhd.ImplicitSurface.parse(polynomial.format(height), [0, 0, height - 0.5], [1, 1, height + 0.5])


def claim(lower, upper, distance="directed", points=(None, None)):
    """An undecided decision: certificates of it prove both bounds."""
    low, high = (jnp.asarray(x, float) for x in (lower, upper))
    p, q = (None if x is None else jnp.asarray(x) for x in points)
    return jhd.Decision(jhd.ANSWERS.undecided, low, high, jhd.RESULTS.gap_not_closed, {}, distance, p, q)


def sharp(a, b, value, distance="directed", points=(None, None)):
    """The certificate of a known distance, checked from its file's text."""
    made = certify(a, b, claim(value - SLACK, value + SLACK, distance, points))
    proven = made.verify()
    assert proven == verify(made.content) and made.matches(a, b)
    assert (proven.kind, proven.lower, proven.upper) == (distance, value - SLACK, value + SLACK)
    return made


POINT = jhd.point_set([[0.25, 0.5, 1.0]])
# From the point to its foot, and from the farthest corners of the square.
THERE, BACK = 1.0, math.sqrt(0.75**2 + 0.5**2 + 1.0)


@pytest.mark.slow
def test_points_and_a_surface_both_ways():
    assert sharp(POINT, flat(0), THERE).cells <= 20
    sharp(flat(0), POINT, BACK)
    sharp(POINT, flat(0), BACK, "two_sided")


@pytest.mark.slow
def test_the_farthest_point_of_a_surface_may_lie_on_faces_of_its_box():
    # Bent down towards a corner of the box, so that the gradient there points out of both faces.
    bent = flat(0, "z - {0} + x^2/10 + x*y/20")
    solution = jhd.directed_hausdorff(bent, POINT)
    exact, proven = math.dist([1, 1, -0.15], [0.25, 0.5, 1.0]), certify(bent, POINT, solution).verify()
    assert proven.upper is not None and proven.lower <= exact <= proven.upper <= proven.lower + 10 * SLACK


@pytest.mark.slow  # programs of its own
def test_a_nearest_place_may_lie_next_to_a_face_of_the_box():
    # No way across the surface that leaves the box proves a zero; the place on the face is as near but for rounding.
    point, bent = jhd.point_set([[0.25, -0.5, 1.0]]), flat(0, "z - {0} - x^2/3 - y/7")
    nearest = jhd.minimum_distance(point, bent)
    places = np.array([0.25, -0.5, 1.0]), np.asarray(nearest.point_b) + [0, 1e-18, 0]
    made = certify(point, bent, claim(float(nearest.lower), float(nearest.upper), "minimum", places))
    content: Any = made.content
    assert content["witness"]["b"]["at"][1] == 0.0
    proven = made.verify()
    assert proven.upper is not None and proven.lower <= float(nearest.value) <= proven.upper


@pytest.mark.slow
def test_of_two_feet_about_as_near_the_nearer_one_counts():
    # Places of a face of a box, along the circle on which the middle of a curve is about as near as its end.
    end, top = [1.0, 0.5, 0.1], [[0.5, 0.9, 0.1], [1.0, 0.5, 0.2], [0.2, 0.5, 0.2]]
    curve = jhd.BezierCurve([end, *top], [1.7, 1.1, 0.8, 1.2])
    x, z = np.meshgrid(np.linspace(0.7, 0.8, 41), np.linspace(0.4, 0.6, 41))
    places = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], axis=1)
    samples = np.asarray(curve(np.linspace(0, 1, 4001)))
    dense = np.min(np.linalg.norm(places[:, None] - samples, axis=2), axis=1)
    side = ShapeSide(curve, 0)
    assert np.max(side.feet(places).distance - dense) > 1e-6
    found = side.feet_within(places, 0.0)
    np.testing.assert_allclose(found.distance, dense, rtol=0, atol=1e-6)
    there = side.points(found.piece, found.x)
    np.testing.assert_allclose(np.linalg.norm(there - places, axis=1), found.distance, rtol=1e-12)
    # What is near enough is left as it is.
    np.testing.assert_array_equal(side.feet_within(places, np.inf).x, side.feet(places).x)


@pytest.mark.exhaustive
def test_a_ball_about_a_point():
    sphere = jhd.ImplicitSurface.parse("x^2 + y^2 + z^2 - 1", [0, 0, 0], [1.5] * 3)
    center = jhd.point_set([[0.5, 0.5, 0.5]])
    # Its corner on an axis is the farthest, its middle the nearest.
    sharp(sphere, center, math.sqrt(0.75))
    middle = 1 - math.sqrt(0.75)
    sharp(center, sphere, middle)
    sharp(center, sphere, middle, "minimum", (np.full(3, 0.5), np.full(3, math.sqrt(1 / 3))))


TRIANGLE = jhd.TriangleMesh([[0.25, 0.25, 1.0], [0.75, 0.5, 1.25], [0.25, 0.75, 1.125]], [[0, 1, 2]])
# The corner of the triangle that is nearest to the square, and its foot.
CLOSE = np.array([0.25, 0.25, 1.0]), np.array([0.25, 0.25, 0.0])


@pytest.mark.slow
def test_a_segment_beside_a_surface():
    sharp(jhd.polyline([[0.25, 0.25, 1.0], [0.75, 0.5, 1.5]]), flat(0), 1.5)


@pytest.mark.slow
def test_a_triangle_beside_a_surface():
    sharp(TRIANGLE, flat(0), 1.25)


@pytest.mark.slow
def test_the_least_distance_of_a_triangle_and_a_surface():
    sharp(TRIANGLE, flat(0), 1.0, "minimum", CLOSE)


def test_a_part_without_zeros_is_apart_from_several_pieces():
    points = jhd.point_set([[0.25, 0.5, 1.0], [0.75, 0.5, 1.25]])
    made: Any = certify(points, flat(0), claim(0.25, math.inf, "minimum", (np.zeros(3), np.zeros(3)))).content
    (whole,) = made["cells"]["apart"]
    names = ["XX" + "".join(letters) for letters in itertools.product("AB", repeat=5)]
    rows, taken = [{**whole, "pair": name} for name in (*names, "XY", "Y")], 0
    for k, name in enumerate(names):
        cells = [*rows[:k], {"pair": name, "free": 1}, *rows[k + 1 :]]
        try:
            taken += verify(changed(made, ("cells", "apart"), cells)).cells == len(rows)
        except CertificateError as error:
            assert "the part may hold a zero" in str(error)
    assert 0 < taken < len(names)
    several = [{**whole, "pair": "X"}, {"pair": "Y", "free": 1}]
    with pytest.raises(CertificateError, match="a part has several pieces"):
        verify(changed(made, ("cells", "apart"), several))


@pytest.mark.slow
def test_two_surfaces():
    cap = jhd.ImplicitSurface.parse("z + x^2/8 - 1", [0, 0, 0.75], [0.25, 0.25, 1.25])
    above = jhd.ImplicitSurface.parse("z - 1.5", [0, 0, 1.25], [0.25, 0.25, 1.75])
    sharp(cap, above, 0.5 + 0.25**2 / 8)


def test_a_point_that_is_a_zero_of_an_even_polynomial_is_proven_exactly():
    single = jhd.ImplicitSurface.parse("(x - 1/2)^2 + y^2 + z^2", [-1] * 3, [1] * 3)
    place = {"at": [0.5, 0.0, 0.0], "way": [0.0, 0.0, 0.0]}
    points = np.array([0.25, 0.5, 1]), np.array([0.25, 0.5, 0])
    made: Any = certify(POINT, flat(0), claim(0.0, 1.5, "minimum", points))
    surface = {"kind": "surface", "lower": [-1.0] * 3, "upper": [1.0] * 3}
    surface["coefficients"] = np.asarray(single.coefficients).tolist()
    content = {**made.content, "b": surface, "witness": {**made.content["witness"], "b": place}}
    assert verify(content).upper == 1.5
    with pytest.raises(CertificateError, match="no change of sign there"):
        verify(changed(content, ("witness", "b", "at", 0), 0.25))


@pytest.mark.slow
def test_what_is_false_has_none():
    for value, reason in ((THERE - 1e-6, "upper bound"), (THERE + 1e-6, "lower bound")):
        with pytest.raises(jhd.NotProvenError, match=reason):
            certify(POINT, flat(0), claim(value - SLACK, value + SLACK))
    with pytest.raises(jhd.NotProvenError, match="farther from the other shape"):
        certify(flat(0), POINT, claim(0.0, BACK - 1e-6))
    with pytest.raises(jhd.NotProvenError, match=r"the point of piece 0 at parameters \[\d\.\d+, \d\.\d+\] is farther"):
        certify(TRIANGLE, flat(0), claim(0.0, 0.9))
    with pytest.raises(ValueError, match=r"b has degrees \(0, 0, 11\); certificates go up to 10 in each variable"):
        certify(POINT, flat(0, "z^11 - 1/2"), claim(0.0, 2.0))


def test_where_sheets_touch_nothing_is_proven():
    # A line without a change of sign, which is a part of the set but cannot be proven to be one.
    line = jhd.ImplicitSurface.parse("(x - 1/3)^2 + z^2", [0, 0, -0.5], [1, 1, 0.5])
    with pytest.raises(jhd.NotProvenError, match="no change of sign of its polynomial was found"):
        certify(POINT, line, claim(0.0, 2.0))
    # Nor can a point of the line prove a lower bound.
    apart = dataclasses.replace(claim(0.5, 2.0), answer=jhd.ANSWERS.no)
    with pytest.raises(jhd.NotProvenError, match="no point of these shapes is that far"):
        certify(line, POINT, apart)


@pytest.fixture(scope="module")
def contents():
    """Certificates with cells of all kinds and proofs of all kinds."""
    curved = flat(0, "z - x^2/8 - {0}")
    made = [sharp(POINT, flat(0), BACK, "two_sided")]
    made.append(sharp(TRIANGLE, flat(0), 1.0, "minimum", CLOSE))
    made.append(sharp(POINT, curved, nearest_of_curved()))
    return [each.content for each in made]


def nearest_of_curved():
    """The distance of the point to z = x^2 / 8, whose foot has y = 1/2."""
    x, best = np.linspace(0.0, 1.0, 1001), 0.0
    for _ in range(3):
        best = float(x[np.argmin((x - 0.25) ** 2 + (x * x / 8 - 1) ** 2)])
        x = np.linspace(best - 2 * (x[1] - x[0]), best + 2 * (x[1] - x[0]), 1001)
    return float(math.hypot(best - 0.25, best * best / 8 - 1))


def zeros_of(shape, count=9):
    """Samples of a surface where its polynomial changes its sign along the edges of a grid."""
    low, high = np.array(shape["lower"]), np.array(shape["upper"])
    axes = [np.linspace(x, y, count) for x, y in zip(low, high, strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    x, y, z = np.moveaxis(nodes, -1, 0)
    values = np.polynomial.polynomial.polyval3d(x, y, z, np.array(shape["coefficients"]))
    found = [nodes[values == 0]]
    for axis in range(3):
        x, f = np.moveaxis(nodes, axis, 0), np.moveaxis(values, axis, 0)
        crossed = f[:-1] * f[1:] < 0
        share = (f[:-1] / np.where(crossed, f[:-1] - f[1:], 1.0))[crossed][:, None]
        found.append(x[:-1][crossed] * (1 - share) + x[1:][crossed] * share)
    return np.concatenate(found)


def sampled(shape):
    if shape["kind"] == "surface":
        return zeros_of(shape)
    if shape["kind"] == "curve":
        return np.array(shape["control_points"])[:, 0]
    corners = np.array(shape["vertices"])[np.array(shape["triangles"])]
    shares = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12
    return np.einsum("ki,nid->nkd", shares, corners).reshape(-1, 3)


def distances(content):
    """Between which bounds the distance lies, as far as samples tell."""
    a, b = sampled(content["a"]), sampled(content["b"])
    if not len(a) or not len(b):
        return None
    gaps = np.linalg.norm(a[:, None] - b, axis=-1)
    kinds = {"minimum": gaps.min(), "directed": gaps.min(axis=1).max()}
    kinds["two_sided"] = max(kinds["directed"], gaps.min(axis=0).max())
    return float(kinds[content["claim"]["kind"]])


# Samples of shapes as curved as these tell their distance to this.
SAMPLING = 0.02


@pytest.mark.parametrize("seed", swept(range(4), slow=[0]))
def test_random_mutations_are_refused_or_leave_the_claim_true(contents, seed):
    draw = np.random.default_rng([5, seed])
    for made in contents:
        paths, refused = numbers(made), 0
        for _ in range(18):
            path = paths[draw.integers(len(paths))]
            move = float(draw.choice([-1, 1]) * 2.0 ** draw.integers(-8, 3))
            content = changed(made, path, at(made, path) + move)
            try:
                proven = verify(content)
            except CertificateError:
                refused += 1
                continue
            found = distances(content)
            assert found is not None, path
            assert proven.lower <= found + SAMPLING, path
            assert proven.upper is not None and proven.upper >= found - SAMPLING, path
        assert refused > 5


@pytest.mark.slow
def test_cells_that_are_left_out_or_called_free_are_refused(contents):
    refused = 0
    for made in contents:
        for section, cells in made["cells"].items():
            for k, cell in enumerate(cells):
                wrong = [changed(made, ("cells", section, k), ...)]
                if "zero" in cell and cell["zero"] is not None:
                    empty = {**cell, "zero": None, "feet": [], "multipliers": None}
                    wrong.append(changed(made, ("cells", section, k), empty))
                if "pair" in cell and "zeros" in cell:
                    free = {"pair": cell["pair"], "free": int(made["b"]["kind"] == "surface")}
                    wrong.append(changed(made, ("cells", section, k), free))
                for content in wrong:
                    with pytest.raises(CertificateError):
                        verify(content)
                    refused += 1
    assert refused > 20


def first(made, section, key):
    """The path of the first entry that has a proof of a kind."""
    return ("cells", section, next(k for k, cell in enumerate(made["cells"][section]) if cell.get(key) is not None))


@pytest.mark.slow
def test_what_is_wrong_with_a_surface_is_named(contents):
    made, foot = contents[0], ("cells", "a_to_b", 0, "feet", 0)
    cell = first(made, "b_to_a", "zero")
    wrong = [
        ((*foot, "way"), [0.0, 0.0, 0.0], "has no change of sign"),
        ((*foot, "way"), [0.0, 0.0, 2.0], "foot 0 leaves the box"),
        ((*foot, "way", 2), -at(made, (*foot, "way", 2)), "has no change of sign"),
        ((*foot, "zero"), [0.0] * 3, "needs a list of 1 to 2"),
        ((*foot, "map"), [[0.0] * 3] * 2, "has 2 rows; needs one of 1, 1"),
        ((*cell, "zero"), [0.0], "is false|is not proven"),
        ((*cell, "multipliers"), [[0.0]], "multipliers are all zero"),
        (("b", "upper", 0), 0.0, "b.lower is not below b.upper"),
        (("b", "coefficients"), [[[1.0]]], "b.coefficients are of degree 0"),
        (("b", "coefficients"), [[[0.0] * 20]], "needs a list of 1 to 11"),
        (("witness", "direction"), "c", "witness.direction is 'c'"),
        (("witness",), None, "there is no witness"),
    ]
    for path, value, reason in wrong:
        if path == (*foot, "way") and value == [0.0, 0.0, 0.0]:
            content = changed(changed(made, path, value), (*foot, "map", 0, 2), 0.125)
        else:
            content = changed(made, path, value)
        with pytest.raises(CertificateError, match=reason):
            verify(content)


def test_multipliers_that_vanish_at_a_corner_prove_nothing_of_a_surface():
    made = copy.deepcopy(sharp(flat(0), POINT, BACK).content)
    path = first(made, "a_to_b", "zero")
    cell = at(made, path)
    both = {**cell, "feet": cell["feet"] * 2, "multipliers": [[1.0, 1.0, 1.0, 0.0]] * 2}
    with pytest.raises(CertificateError, match="multipliers are all zero at a corner"):
        verify(changed(made, path, both))


def test_a_polynomial_next_to_zero_inside_is_proven_by_a_plane():
    # (x - 1/3)^2 + e on an interval times (y - 1/3)^2: halving would take a part for every other digit.
    def quadratic(variables, least):
        # On [0, 1], times 9 2^40: (3 x - 1)^2 has the Bernstein coefficients 1, -2, 4.
        return from_coefficients([(c << 40) + least for c in (1, -2, 4)], variables, 2)

    assert failure_in_space(quadratic((0, 1), 1), ((0, 1),), (2,), most_parts=1) is None
    assert failure_in_space(quadratic((0, 1), -1), ((0, 1),), (2,)) is not None


def test_a_tangent_plane_proves_nothing_of_what_is_not_convex():
    # 1 + v - 20 v^2 + 20 v^3 for v = (2 x - 1)^2: a valley above zero between two below, and above zero at both ends.
    domain, v = ((0, 1),), from_coefficients((1, -1, 1), (0, 1), 2)
    terms = zip((1, 1, -20, 20), powers(v, 3), strict=True)
    raised = [(c, elevated(f, domain, (2 * k,), (6,))) for k, (c, f) in enumerate(terms)]
    assert failure_in_space(total([{i: c * x for i, x in f.items()} for c, f in raised]), domain, (6,)) is not None
