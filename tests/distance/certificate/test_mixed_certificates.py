"""Certificates of points, curves, meshes and parametric surfaces in every mix: made, stored, checked from the file."""

import dataclasses
import os

import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.certificate import verification
from jhd._distance.certificate.certificate import certify
from jhd._distance.certificate.multipliers import sampled_multipliers
from jhd._distance.certificate.shape_side import ShapeSide
from jhd._distance.certificate.sides import plain_shape
from tests.distance.certificate.made import sampled, sampled_distance
from tests.processes import python
from tests.sweeps import swept

KINDS = ("points", "curve", "mesh", "patch", "rational")
# Pairs of meshes and points, whose searches are quick.
SEEDS = 10
# How much wider than the solution's the bounds may be, and the rounding of a sum, as shares of the diagonal.
SLACK, ROUNDING = 1e-9, 1e-15


def net(rng, height):
    x = np.linspace(0.0, 1.0, 4)
    return np.stack([*np.meshgrid(x, x, indexing="ij"), height + 0.2 * rng.normal(size=(4, 4))], axis=-1)


def shape(kind, seed, height=0.0):
    rng = np.random.default_rng(seed)
    if kind == "points":
        return jhd.point_set(rng.uniform(size=(20, 3)))
    if kind == "curve":
        return jhd.BezierSegments(rng.uniform(size=(2, 4, 3)))
    points = net(rng, height)
    if kind == "mesh":
        corners = [4 * i + j for i in range(3) for j in range(3)]
        halves = [([k, k + 4, k + 1], [k + 1, k + 4, k + 5]) for k in corners]
        return jhd.TriangleMesh(points.reshape(-1, 3), [triangle for pair in halves for triangle in pair])
    return jhd.BezierPatch(points, rng.uniform(0.5, 2.0, size=(4, 4)) if kind == "rational" else None)


def checked(a, b, solution, **options):
    certificate = certify(a, b, solution, **options)
    proven = certificate.verify()
    assert certificate.matches(a, b) and proven.cells == certificate.cells
    assert proven.upper is not None and proven.lower <= float(solution.value) <= proven.upper
    assert proven.upper - float(solution.upper) <= (SLACK + ROUNDING) * 3
    assert float(solution.lower) - proven.lower <= (SLACK + ROUNDING) * 3
    return certificate


@pytest.mark.parametrize(("unit", "far"), [(1.0, 1e12), (2.0**560, 0.0), (2.0**-600, 0.0)])
def test_bounds_are_widened_by_a_share_of_the_box_of_what_counts(unit, far):
    # The last vertex has no triangle.
    mesh = jhd.TriangleMesh(np.array([(0.0, 0, 0), (unit, 0, 0), (0, unit, 0), (far, far, far)]), [(0, 1, 2)])
    points = jhd.point_set(unit * np.array([(0.0, 0, 3)]))
    solution = jhd.minimum_distance(mesh, points)
    proven = certify(mesh, points, solution).verify()
    assert proven.upper is not None and proven.upper <= float(solution.upper) + 4e-9 * unit
    assert 3 * unit - 4e-9 * unit <= proven.lower < float(solution.lower)


def test_points_and_a_mesh_have_a_certificate_both_ways(tmp_path):
    a, b = shape("points", 1), shape("mesh", 2)
    certificate = checked(a, b, jhd.hausdorff(a, b))
    certificate.save(tmp_path / "proof.json.gz")
    file = str(tmp_path / "proof.json.gz")
    done = python("-I", "-S", os.path.dirname(verification.__file__), file, env={})
    assert done.stderr == "" and done.stdout == f"proven: {file}: {verification.sentence(certificate.verify())}\n"


@pytest.mark.slow
def test_a_witness_on_the_third_side_of_a_triangle_is_one_of_it():
    # The farthest place is there, and floats round one minus its parameter up or down.
    triangle = jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    for seed in range(4):
        x = np.random.default_rng(seed).uniform(0.7, 1.3)
        b = jhd.point_set([[0, 0, 0], [x, 0, 0], [0, 1, 0]])
        checked(triangle, b, jhd.directed_hausdorff(triangle, b))


def test_bounds_that_are_false_have_none():
    a, b = shape("points", 1), shape("mesh", 2)
    solution = jhd.hausdorff(a, b)
    for field, share, reason in (("upper", 0.99, "upper bound"), ("lower", 1.01, "lower bound")):
        false = dataclasses.replace(solution, **{field: getattr(solution, field) * share})
        with pytest.raises(jhd.NotProvenError, match=reason):
            certify(a, b, false)


def test_decisions_have_certificates_of_what_answers():
    a, b = shape("points", 1), shape("mesh", 2)
    distance = float(jhd.hausdorff(a, b).value)
    yes, no = (jhd.hausdorff_at_most(a, b, share * distance) for share in (1.1, 0.9))
    proven = certify(a, b, yes).verify()
    assert proven.lower == 0 and proven.upper == float(yes.upper) <= 1.1 * distance
    proven = certify(a, b, no).verify()
    assert proven.upper is None and proven.lower == float(no.lower) > 0.9 * distance
    directed = jhd.hausdorff_at_most(b, a, 1.1 * distance, directed=True)
    assert (yes.distance, directed.distance) == ("two_sided", "directed")
    assert certify(b, a, directed).directed


def test_a_decision_about_a_minimum_distance_is_proven_of_it():
    a, b = shape("points", 1), shape("mesh", 2, height=2.0)
    distance = float(jhd.minimum_distance(a, b).value)
    yes, no = (jhd.minimum_at_most(a, b, share * distance) for share in (1.1, 0.9))
    assert yes.distance == no.distance == "minimum" and "distance=minimum" in repr(yes)
    assert yes and not no
    proven = certify(a, b, yes).verify()
    assert proven.kind == "minimum" and proven.lower == 0
    assert proven.upper is not None and distance <= proven.upper <= 1.1 * distance
    proven = certify(a, b, no).verify()
    assert proven.kind == "minimum" and proven.upper is None and 0.9 * distance < proven.lower <= distance
    with pytest.raises(ValueError, match="directed is True, but a minimum distance has no direction"):
        certify(a, b, no, directed=True)


def test_minimum_distances_have_certificates():
    a, b = shape("points", 1), shape("mesh", 2, height=2.0)
    solution = jhd.minimum_distance(a, b)
    certificate = certify(a, b, solution)
    proven = certificate.verify()
    assert proven.kind == "minimum" and proven.upper is not None
    assert proven.lower <= float(solution.value) <= proven.upper <= proven.lower + 3 * (2 * SLACK + ROUNDING)
    assert " <= d(A, B) <= " in repr(certificate)
    below = dataclasses.replace(solution, upper=solution.upper * 0.99)
    above = dataclasses.replace(solution, lower=solution.lower * 1.01)
    for false, reason in ((below, "no points of these shapes are that near"), (above, "is not proven")):
        with pytest.raises(jhd.NotProvenError, match=reason):
            certify(a, b, false)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [13, 47])
def test_the_places_of_a_minimum_are_found_at_a_corner(seed):
    # A near foot of the corner is on the other segment, apart from it.
    rng = np.random.default_rng(seed)
    a, b = jhd.point_set(rng.normal(size=(4, 3))), jhd.polyline(rng.normal(size=(3, 3)) + [2, 0, 1.5])
    solution = jhd.minimum_distance(a, b, jhd.BranchAndBound(atol=1e-3))
    assert certify(a, b, solution).upper >= float(solution.upper)


@pytest.mark.slow
@pytest.mark.parametrize("other", [jhd.polyline([(-1.0, 3.0), (1.0, 4.0)]), jhd.point_set([(0.3, 3.0), (2.0, 5.0)])])
def test_minimum_distances_of_plane_curves_have_certificates(other):
    curve = jhd.BezierCurve([(0.0, 0.0), (1.0, 2.0), (2.0, -1.0), (3.0, 0.0)])
    for pair in ((curve, other), (other, curve)):
        solution = jhd.minimum_distance(*pair)
        proven = certify(*pair, solution).verify()
        assert proven.kind == "minimum" and proven.upper is not None
        # The box of both has a diagonal below 6.8, and the bounds of the solution are apart by 1e-10 of it.
        assert proven.lower <= float(solution.value) <= proven.upper <= proven.lower + 6.8 * 2.1 * SLACK


def test_shapes_that_meet_have_a_certificate_of_the_upper_bound_alone():
    a = jhd.TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    b = jhd.TriangleMesh([[0.2, 0.2, -1], [0.3, 0.2, 1], [0.2, 0.4, 1]], [[0, 1, 2]])
    proven = certify(a, b, jhd.minimum_distance(a, b)).verify()
    assert proven.lower == proven.cells == 0 and proven.upper is not None and proven.upper <= 3 * SLACK


def test_what_is_asked_for_is_checked(as_a_user):
    a, b = shape("points", 1), shape("mesh", 2)
    solution = jhd.hausdorff(a, b)
    with pytest.raises(ValueError, match="slack is -1; needs one number of at least 0"):
        certify(a, b, solution, slack=-1)
    with pytest.raises(TypeError, match="b must be points, a curve, a parametric surface .*; got HausdorffSolution"):
        certify(a, solution, solution)  # pyright: ignore[reportArgumentType]
    wide = certify(a, b, solution, slack=0.5)
    assert wide.upper == float(solution.upper) + 0.5 and wide.verify().lower == float(solution.lower) - 0.5


def test_multipliers_grow_with_their_slacks():
    # Above the middle between two points: slacks -x (2 + x) and x (2 - x) on [-1, 1], a little raised.
    def slack(shares):
        x = shares @ np.array([-1.0, 1.0])
        return np.stack([-x * (2 + x), x * (2 - x)]) + 1e-9

    grid = np.stack([np.linspace(1, 0, 13), np.linspace(0, 1, 13)], axis=1)
    rows = sampled_multipliers(slack, grid)
    assert rows is not None
    shares = np.stack([np.linspace(1, 0, 2001), np.linspace(0, 1, 2001)], axis=1)
    assert np.min(np.array(rows)) >= 0
    assert np.min(np.sum(np.array(rows) @ shares.T * slack(shares), axis=0)) > 0
    assert sampled_multipliers(lambda shares: slack(shares) - 0.1, grid) is None


def test_feet_on_triangles_are_the_nearest_places():
    rng = np.random.default_rng(3)
    mesh = jhd.TriangleMesh(rng.normal(size=(6, 3)), [[0, 1, 2], [3, 4, 5], [0, 0, 1]])
    side = ShapeSide(mesh, 0)
    piece, points = rng.integers(0, 3, 60), 2 * rng.normal(size=(60, 3))
    found = side.local(piece, np.zeros((60, 2)), points)
    shares = rng.dirichlet(np.ones(3), size=400)
    others = np.einsum("sk,nkd->nsd", shares, np.asarray(mesh.corners)[piece])
    assert np.all(found.distance <= np.linalg.norm(others - points[:, None], axis=-1).min(axis=1) + ROUNDING * 10)
    assert np.all(found.x >= 0) and np.all(found.x.sum(axis=1) <= 1 + ROUNDING)


# The distance of samples is known to this.
SAMPLING = 0.06


@pytest.fixture(scope="module")
def solutions():
    """A largest and a least distance of a cheap pair, whose numbers are replaced by those of other pairs."""
    a, b = shape("points", 1), shape("mesh", 2, height=2.0)
    return jhd.hausdorff(a, b), jhd.minimum_distance(a, b)


@pytest.mark.slow
@pytest.mark.parametrize("second", ["points", "mesh"])
def test_ten_pairs_have_certificates_of_their_sharp_bounds(second):
    for seed in range(SEEDS):
        a, b = shape("mesh", 2 * seed), shape(second, 2 * seed + 1, height=0.3)
        checked(a, b, jhd.hausdorff(a, b))
    a, b = shape("mesh", 0), shape(second, 1, height=0.3)
    assert checked(b, a, jhd.directed_hausdorff(b, a)).directed


@pytest.mark.parametrize(
    ("first", "second"),
    # Of each kind with itself and with the next one; meshes are beside patches of both kinds.
    swept(
        [(x, y) for k, x in enumerate(KINDS) for y in KINDS[k:]],
        slow=[*((x, x) for x in KINDS), *zip(KINDS[:-1], KINDS[1:], strict=True), ("mesh", "rational")],
    ),
)
def test_pairs_of_every_kind_have_certificates_of_what_samples_say(first, second, solutions):
    a, b = shape(first, 0), shape(second, 1, height=1.7)
    plain = [plain_shape(x) for x in (a, b)]
    value = sampled_distance({"claim": {"kind": "two_sided"}, "a": plain[0], "b": plain[1]}, (13, 25))
    nowhere = dataclasses.replace(solutions[0].witness, element=jnp.asarray(-1))
    bounds = {name: jnp.asarray(value) for name in ("value", "lower", "upper")}
    found = certify(a, b, dataclasses.replace(solutions[0], witness=nowhere, **bounds), slack=SAMPLING)
    assert found.verify()[:3] == ("two_sided", value - SAMPLING, value + SAMPLING)
    places = [sampled(x, 13) for x in plain]
    gaps = np.linalg.norm(places[0][:, None] - places[1], axis=-1)
    i, j = np.unravel_index(np.argmin(gaps), gaps.shape)
    points = {"point_a": jnp.asarray(places[0][i]), "point_b": jnp.asarray(places[1][j])}
    bounds = {name: jnp.asarray(gaps[i, j]) for name in ("value", "lower", "upper")}
    found = certify(a, b, dataclasses.replace(solutions[1], **points, **bounds), slack=SAMPLING)
    assert found.verify()[:3] == ("minimum", max(gaps[i, j] - SAMPLING, 0.0), gaps[i, j] + SAMPLING)
