"""The deviation of shapes whose distributions of distances are known, and what is refused."""

import itertools
import json
import math
import os
import re
import subprocess
import sys
from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.cells.mean_bounds import distances_over
from jhd._distance.search import distribution
from jhd._runtime.clock import Clock
from jhd._runtime.decimals import lower_text, upper_text
from tests.sweeps import swept

SEGMENT = [(0, 0), (1, 0)]
# A square, and below it a plane that falls by half.
SQUARE = np.array([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.0]])
PLANE = np.array([[-3, -3, 1.5], [4, -3, -2], [4, 4, -2], [-3, 4, 1.5]])
TRIANGLES = [[0, 1, 2], [0, 2, 3]]
# A turn in so many steps: sums of them err by far less than the bounds are apart.
TURN = np.linspace(0, 2 * np.pi, 200_001)[:-1]


def encloses(bounds, exact):
    return bounds.lower <= exact <= bounds.upper


def within(found, atol, rtol=1e-3):
    """Whether maximum, mean and root mean square are as close as was asked for."""
    return all(
        float(x.upper) - float(x.lower) <= max(atol, rtol * float(x.upper))
        for x in (found.maximum, found.mean, found.rms)
    )


@pytest.mark.parametrize("power", swept([0, -400, 400], 1, 2))
def test_a_segment_and_one_of_its_ends(power):
    unit = 2.0**power
    found = jhd.deviation(jhd.polyline(unit * np.array(SEGMENT)), jhd.point_set([(0, 0)]))
    assert encloses(found.mean, unit / 2) and encloses(found.rms, unit / math.sqrt(3)) and encloses(found.size, unit)
    assert within(found, 1e-6 * unit) and found.maximum.lower <= unit <= found.maximum.upper
    for q in (0.1, 0.5, 0.9, 1.0):
        assert encloses(found.quantile(q), q * unit) and found.quantile(q).upper - found.quantile(q).lower < 0.2 * unit
        assert encloses(found.fraction_within(q * unit), q)


def test_a_segment_above_a_line_that_rises():
    # The distance is (1 - x / 2) times the cosine of the slope.
    cosine = 1 / math.sqrt(1.25)
    found = jhd.deviation(jhd.polyline([(0, 1), (1, 1)]), jhd.polyline([(-3, -1.5), (3, 1.5)]))
    assert encloses(found.mean, 0.75 * cosine) and encloses(found.quantile(0.5), 0.75 * cosine) and within(found, 1e-5)
    assert encloses(found.rms, cosine * math.sqrt(7 / 12))
    assert encloses(found.fraction_within(0.75 * cosine), 0.5)


@pytest.mark.slow
def test_concentric_circles_are_everywhere_as_far():
    found = jhd.deviation(jhd.circle((0, 0), 1.0), jhd.circle((0, 0), 1.5), rtol=4e-3)
    # The stored circles are within roundings of circles.
    for bounds in (found.mean, found.rms, found.quantile(0.2), found.quantile(0.9)):
        assert bounds.lower <= 0.5 * (1 + 1e-14) and 0.5 * (1 - 1e-14) <= bounds.upper
        assert bounds.upper - bounds.lower < 5e-3
    assert encloses(found.size, 2 * math.pi) and within(found, 1e-5, 4e-3)


@pytest.mark.slow
def test_circles_that_cross_agree_with_a_dense_sum():
    found = jhd.deviation(jhd.circle((0, 0), 1.0), jhd.circle((0.3, 0), 1.0), rtol=4e-3)
    exact = np.abs(np.hypot(np.cos(TURN) - 0.3, np.sin(TURN)) - 1)
    assert encloses(found.mean, exact.mean()) and encloses(found.rms, np.sqrt(np.mean(exact**2)))
    assert encloses(found.quantile(0.5), np.median(exact)) and encloses(found.quantile(0.9), np.quantile(exact, 0.9))
    assert encloses(found.fraction_within(0.1), np.mean(exact <= 0.1)) and within(found, 1e-5, 4e-3)


def test_points_are_counted_and_not_cut():
    rows = [(0.0, 1.0), (0.5, 2.0), (0.75, 4.0), (2.0, 0.0)]
    found = jhd.deviation(jhd.point_set(rows), jhd.polyline(SEGMENT))
    assert encloses(found.mean, 2.0) and encloses(found.rms, math.sqrt(22 / 4)) and found.size == jhd.Bounds(4.0, 4.0)
    assert encloses(found.quantile(0.5), 1.0) and encloses(found.quantile(0.75), 2.0)
    assert found.fraction_within(1.5).upper == pytest.approx(0.5) and found.mean.upper - found.mean.lower < 1e-11
    assert np.all(np.asarray(found.at().distance) == pytest.approx([1, 2, 4, 1]))


@pytest.mark.parametrize("power", [-1074, -1070, -500, 0, 500, 1022])
@pytest.mark.parametrize("weights", [(1, 1, 1), (1, 2, 3), (3, 1, 2)])
def test_points_count_by_weights_of_any_size(weights, power):
    given, exact = [math.ldexp(w, power) for w in weights], [Fraction(w) for w in weights]
    assert [Fraction(x) for x in given] == [w * Fraction(2) ** power for w in exact]
    far, total = (0, 1, 5), sum(exact)
    found = jhd.deviation(jhd.point_set([(x, 0) for x in far]), jhd.point_set([(0, 0)]), weights=given)
    assert encloses(found.mean, sum(w * x for w, x in zip(exact, far, strict=True)) / total)
    square = sum(w * x * x for w, x in zip(exact, far, strict=True)) / total
    assert Fraction(found.rms.lower) ** 2 <= square <= Fraction(found.rms.upper) ** 2
    assert encloses(found.fraction_within(2), (exact[0] + exact[1]) / total)
    assert encloses(found.quantile(0.9), 5) and encloses(found.size, total * Fraction(2) ** power)
    assert within(found, 1e-5)


def test_the_size_of_weighted_points_is_the_exact_sum_of_the_weights():
    # As floats the sums are whole.
    for weights in ([0.1, 1.9, 1.0], [0.3, 1.7, 1.0], [1 / 3, 5 / 3, 1.0], [1 + 2**-52, 1 - 2**-53, 1.0]):
        found = jhd.deviation(jhd.point_set([(x, 0) for x in (0, 1, 5)]), jhd.point_set([(0, 0)]), weights=weights).size
        assert encloses(found, sum(map(Fraction, weights))) and found.upper == math.nextafter(found.lower, math.inf)


@pytest.mark.slow
def test_lengths_below_the_normal_numbers_are_rounded_outward():
    tiny = 5e-324
    found = jhd.deviation(jhd.polyline([(0, 0, 0), (tiny, tiny, tiny)]), jhd.point_set([(0, 0, 0)]), throw=False)
    assert (Fraction(found.size.lower) / Fraction(tiny)) ** 2 <= 3 <= (Fraction(found.size.upper) / tiny) ** 2


SINGLE = """
import math, jhd, numpy as np
tiny = 2.0**-149
far = jhd.point_set(np.array([(3, 0), (0, 7), (5, 5)], np.float32) * np.float32(tiny))
found = jhd.deviation(far, jhd.point_set([(0, 0)]), throw=False)
mean, median = (10 + math.sqrt(50)) / 3 * tiny, 7 * tiny
assert found.mean.lower <= mean <= found.mean.upper, found.mean
assert found.quantile(0.5).lower <= median <= found.quantile(0.5).upper
assert found.quantile(1.0).lower <= math.sqrt(50) * tiny <= found.quantile(1.0).upper, found.quantile(1.0)
for side in (1.0, 3.0, 11.0, 1e30):
    corners = np.array([(0, 0, 0), (side, 0, 0), (0, side, 0)]) * tiny
    a, b = (jhd.TriangleMesh(np.array(x, np.float32), [[0, 1, 2]]) for x in (corners, corners[:, [2, 0, 1]]))
    # The corner on the axis that the other one does not reach, and its other two corners.
    far = jhd.directed_hausdorff(a, b, throw=False)
    assert float(far.lower) <= side * tiny <= float(far.upper), far
# Common coordinates in single precision would leave more than a hundredth of the length open.
found = jhd.arc_length(jhd.circle((0, 0), 1.0))
assert found.lower <= 2 * math.pi <= found.upper <= found.lower * (1 + 1.1e-6), found
print("done")
"""


@pytest.mark.slow
def test_in_single_precision_bounds_below_the_normal_numbers_stay_true():
    environment = os.environ | {"JAX_ENABLE_X64": "0"}
    done = subprocess.run([sys.executable, "-c", SINGLE], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stdout.strip() == "done", done.stdout + done.stderr


def test_a_box_whose_diagonal_is_no_float_has_a_default_tolerance():
    ends = jhd.point_set([(-8e307, -1e308), (8e307, 1e308), (6e307, 1e308)])
    found = jhd.deviation(ends, jhd.point_set([(0, 0), (0, 1e308)]))
    assert encloses(found.maximum, math.hypot(8e307, 1e308)) and encloses(found.quantile(0.6), 8e307)
    assert 0 < found.mean.upper - found.mean.lower < 1e303


def test_a_square_above_a_tilted_plane():
    # The distance is (1 + x / 2) times the cosine of the slope, and the measure the area.
    square, plane = jhd.TriangleMesh(SQUARE, TRIANGLES), jhd.TriangleMesh(PLANE, TRIANGLES)
    found, cosine = jhd.deviation(square, plane), 1 / math.sqrt(1.25)
    assert encloses(found.mean, 1.25 * cosine) and encloses(found.rms, cosine * math.sqrt(1.25**2 + 1 / 48))
    assert encloses(found.size, 1.0) and encloses(found.quantile(0.5), 1.25 * cosine) and within(found, 1e-5)
    assert np.asarray(found.at().distance) == pytest.approx(cosine * np.array([1, 1.5, 1.5, 1]))


def test_a_triangle_that_crosses_a_plane_is_known_up_to_rounding():
    # Its heights are -1/2, 1/4 and 3/4 at the corners, and below zero over 4/15 of it.
    tilted = jhd.TriangleMesh([[1, 0, -0.5], [0, 0, 0.25], [0, 1, 0.75]], [[0, 1, 2]])
    plane = jhd.TriangleMesh(PLANE * [1, 1, 0], TRIANGLES)
    found = jhd.deviation(tilted, plane)
    exact = (found.mean, 23 / 90), (found.rms, math.sqrt(3 / 32)), (found.fraction_within(0.25), 8 / 15)
    for bounds, value in exact:
        assert encloses(bounds, value) and bounds.upper - bounds.lower < 1e-11
    # Up to 1/4 the share is (16 / 15) ((1/2 + t)^2 - (1/2 - t)^2) = 32 t / 15.
    level = found.quantile(0.4)
    assert encloses(level, 3 / 16) and level.upper - level.lower < 1e-7
    assert encloses(found.size, math.sqrt(0.25 + 0.75**2 + 1) / 2) and found.stats["cells"] < 12


def ball(levels: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices on the unit sphere, and the triangles of an octahedron that is divided so often."""
    corners = np.array([[[x, 0, 0], [0, y, 0], [0, 0, z]] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    for _ in range(levels):
        a, b, c = np.moveaxis(corners, 1, 0)
        ab, bc, ca = ((x + y) / 2 for x, y in ((a, b), (b, c), (c, a)))
        corners = np.concatenate([np.stack(x, axis=1) for x in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), index.reshape(-1, 3)


@pytest.mark.slow
def test_meshes_that_cross_each_other_close_with_few_cells_and_agree_with_a_dense_sum():
    vertices, triangles = ball(3)
    a = jhd.TriangleMesh(vertices * (1 + 0.02 * np.sin(9 * vertices[:, :1])), triangles)
    b = jhd.TriangleMesh(vertices, triangles)
    found = jhd.deviation(a, b)
    shares, corners = middles_of_parts(13), np.asarray(a.corners)
    points = np.einsum("sk,tkd->tsd", shares, corners).reshape(-1, 3)
    sides = corners[:, 1:] - corners[:, :1]
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    weights, distance = np.repeat(areas, len(shares)), np.asarray(jhd.project(points, b).distance)
    # Of so many samples the mean and the shares are good to a few thousandths.
    assert found.mean.value == pytest.approx(np.average(distance, weights=weights), rel=3e-3)
    for level in (0.003, 0.01, 0.016):
        share = found.fraction_within(level)
        assert share.upper - share.lower < 3e-3
        assert share.value == pytest.approx(np.sum(weights[distance <= level]) / np.sum(weights), abs=3e-3)
    assert encloses(found.size, np.sum(areas)) and within(found, 1e-5) and found.stats["cells"] < 3000
    median = found.quantile(0.5)
    assert median.upper - median.lower < 5e-3 * float(found.maximum.upper)


def test_a_square_beside_points_closes_with_few_cells_where_the_nearest_one_changes():
    # The nearest point changes at 1/3, so that all of the square is three rectangles beside a corner of each.
    square, width = jhd.TriangleMesh(SQUARE * [1, 1, 0], TRIANGLES), 1 / 3
    found = jhd.deviation(square, jhd.point_set([(0, 0, 0), (2 * width, 0, 0)]))
    mean = (math.hypot(1, width) + width**2 / 2 * math.asinh(1 / width) + math.asinh(width) / (2 * width)) / 3
    assert encloses(found.mean, mean) and encloses(found.rms, math.sqrt((1 + width**2) / 3)) and within(found, 1e-5)
    assert found.stats["cells"] < 2000
    share = found.fraction_within(width)
    assert encloses(share, math.pi / 4 * width) and share.upper - share.lower < 1e-3


def test_a_shape_deviates_from_itself_by_nothing():
    mesh = jhd.TriangleMesh([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.5]], [[0, 1, 2], [0, 2, 3]])
    found = jhd.deviation(mesh, mesh)
    assert found.mean.lower == found.rms.lower == 0 and found.rms.upper < 2e-6
    assert found.fraction_within(1e-5).lower > 1 - 1e-10


@pytest.mark.exhaustive
def test_a_flat_patch_and_a_paraboloid_agree_with_a_dense_sum():
    ends = {-1.0: 1.0, 0.0: -1.0, 1.0: 1.0}
    bowl = jhd.BezierPatch([[[x, y, ends[x] + ends[y] - 0.3] for y in ends] for x in ends])
    patch = jhd.BezierPatch([[[x, y, 0.0] for y in (-0.5, 0.5)] for x in (-0.5, 0.5)])
    found = jhd.deviation(patch, bowl, rtol=1e-2)
    x = (np.arange(1000) + 0.5) / 2000
    radius = np.linspace(0, 0.75, 4001)
    exact = np.interp(np.hypot(*np.meshgrid(x, x)), radius, from_a_parabola(radius))
    assert encloses(found.mean, exact.mean()) and encloses(found.rms, np.sqrt(np.mean(exact**2)))
    assert encloses(found.quantile(0.5), np.median(exact)) and encloses(found.quantile(0.9), np.quantile(exact, 0.9))
    assert encloses(found.fraction_within(0.1), np.mean(exact <= 0.1)) and within(found, 1e-5, 1e-2)


def from_a_parabola(radius):
    """The distance of (r, 0) from z = s^2 - 0.3 with 0 <= s: the least at the real roots of its derivative in s."""
    found = np.empty_like(radius)
    for k, r in enumerate(radius):
        roots = np.roots([2, 0, 0.4, -r])
        s = np.append(roots[np.abs(roots.imag) < 1e-9].real, 0.0)
        found[k] = np.sqrt(np.min((s - r) ** 2 + (s**2 - 0.3) ** 2))
    return found


@pytest.mark.slow
def test_an_octahedron_and_a_polynomial_sphere_agree_with_a_dense_sum():
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    faces = [[i, j, k] for i in (0, 3) for j in (1, 4) for k in (2, 5)]
    sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", -1.5 * np.ones(3), 1.5 * np.ones(3))
    found = jhd.deviation(jhd.TriangleMesh(axes, faces), sphere, rtol=0.05)
    n = 400
    u, v = (x.ravel() for x in np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) / n))
    # Half of the square is folded onto the other, so that its points fill the triangle evenly.
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    exact = 1 - np.linalg.norm(np.stack([u, v, 1 - u - v]), axis=0)
    assert encloses(found.mean, exact.mean()) and encloses(found.rms, np.sqrt(np.mean(exact**2)))
    assert encloses(found.quantile(0.5), np.median(exact)) and encloses(found.size, 4 * math.sqrt(3))


def test_results_are_told_and_written():
    found = jhd.deviation(jhd.polyline(SEGMENT), jhd.point_set([(0, 0)]))
    stored = json.loads(found.to_json())
    assert stored["mean"] == found.mean.to_dict() and stored["result"] == "successful"
    assert stored["quantiles"]["0.5"] == found.quantile(0.5).to_dict()
    assert "mean in [0.49" in repr(found) and float(found) == found.mean.value


def test_a_tolerance_that_is_not_reached_is_told_with_true_bounds():
    shapes = jhd.polyline(SEGMENT), jhd.point_set([(0, 0)])
    with pytest.raises(jhd.NotProvenError) as caught:
        jhd.deviation(*shapes, rtol=1e-9, atol=0, max_cells=16)
    found = caught.value.solution
    assert encloses(found.mean, 0.5) and encloses(found.rms, 1 / math.sqrt(3)) and not within(found, 0, 1e-9)
    found = jhd.deviation(*shapes, rtol=1e-9, atol=0, max_cells=16, throw=False)
    assert found.result == jhd.RESULTS.capacity_reached


def test_an_unreached_tolerance_names_the_bounds_and_one_that_they_meet():
    shapes = jhd.polyline(SEGMENT), jhd.point_set([(0, 0)])
    with pytest.raises(jhd.NotProvenError) as caught:
        jhd.deviation(*shapes, rtol=1e-9, atol=0, max_cells=16, quantile=0.5)
    found, message = caught.value.solution, str(caught.value)
    for of, ends in {"the mean": found.mean, "the quantile 0.5": found.quantile(0.5)}.items():
        assert f"{lower_text(ends.lower)} and {upper_text(ends.upper)} for {of}" in message
    named = re.search(r"Pass rtol=([^ ]+) to accept them", message)
    assert named is not None
    assert jhd.deviation(*shapes, rtol=float(named[1]), atol=0, max_cells=16, quantile=0.5).stats["cells"] <= 64


@pytest.mark.slow
def test_curves_that_end_near_and_cross_each_other_close_with_few_cells():
    first, second = (jhd.BezierSegments(np.random.default_rng(k).normal(size=(k + 2, 4, 2))) for k in (0, 1))
    for a, b in ((first, second), (second, first)):
        assert jhd.deviation(a, b).stats["cells"] < 700


@pytest.mark.slow
def test_the_maximum_and_distances_at_places_are_differentiable():
    height = np.array([0.0, 0.0, 1.0])

    def of(x):
        mesh = jhd.TriangleMesh(SQUARE + x * height, TRIANGLES)
        found = jhd.deviation(mesh, jhd.TriangleMesh(PLANE, TRIANGLES))
        return found.maximum.value + jnp.sum(found.at().distance)

    # Five distances grow with the cosine of the slope.
    assert float(jax.grad(of)(0.0)) == pytest.approx(5 / math.sqrt(1.25))
    line = jhd.deviation(jhd.polyline(SQUARE[:2]), jhd.TriangleMesh(PLANE, TRIANGLES))
    assert np.asarray(line.at([0.0, 0.5, 1.0]).distance) == pytest.approx(np.array([1, 1.25, 1.5]) / math.sqrt(1.25))


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda a, b: jhd.deviation(a, a.count), TypeError, "b must be a shape"),
        (lambda a, b: jhd.deviation(a, b, rtol=-1), ValueError, "rtol"),
        (lambda a, b: jhd.deviation(a, b, atol=-1), ValueError, "atol"),
        (lambda a, b: jhd.deviation(a, b, max_cells=0), ValueError, "max_cells"),
        (lambda a, b: jhd.deviation(a, jhd.point_set([(0, 0, 0)])), ValueError, "coordinates"),
        (lambda a, b: jhd.deviation(jhd.polyline([(1, 1), (1, 1)]), b), ValueError, "a has no length"),
        (lambda a, b: jhd.deviation(jhd.BezierPatch([[[0, 0, 0]], [[1, 0, 0]]]), b), ValueError, "a has no area"),
        (lambda a, b: jhd.deviation(a, b).quantile(0), ValueError, "q is 0"),
        (lambda a, b: jhd.deviation(a, b).fraction_within(-1), ValueError, "threshold is -1"),
        (lambda a, b: jhd.deviation(a, b).at(), ValueError, "params is missing"),
        (lambda a, b: jhd.deviation(b, a).at([0]), ValueError, "params is for curves"),
        (lambda a, b: jhd.deviation(a, b).to_trimesh(), TypeError, "a is BezierSegments"),
    ],
)
@pytest.mark.usefixtures("as_a_user")
def test_what_cannot_be_measured_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        call(jhd.polyline(SEGMENT), jhd.point_set([(0, 0)]))


def test_an_implicit_surface_has_no_proven_area():
    sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", -1.5 * np.ones(3), 1.5 * np.ones(3))
    with pytest.raises(TypeError, match="whose area is not certified"):
        jhd.deviation(sphere, jhd.point_set([(0, 0, 0)]))


def test_traced_shapes_are_refused():
    with pytest.raises(TypeError, match="needs concrete shapes"):
        jax.jit(lambda x: jhd.deviation(jhd.polyline(x), jhd.point_set([(0.0, 0.0)])).mean)(np.array(SEGMENT, float))


def test_a_mean_under_grad_is_a_number_without_a_derivative():
    def mean(x, of):
        return of(jhd.deviation(jhd.polyline(x), jhd.point_set([(0.0, 0.0)])).mean)

    with pytest.raises(TypeError, match="no derivative: use jhd.MeanDistance"):
        jax.grad(mean)(np.array(SEGMENT, float), lambda bounds: bounds.value)
    plain = mean(np.array(SEGMENT, float), lambda bounds: bounds)
    _, traced = jax.grad(lambda x: (x[0, 0], mean(x, lambda bounds: bounds)), has_aux=True)(np.array(SEGMENT, float))
    assert (repr(traced), float(traced), traced.to_dict()) == (repr(plain), float(plain), plain.to_dict())


def test_a_time_limit_ends_a_step_and_leaves_true_bounds():
    zigzag = jhd.polyline([(0.0, 0.0), (1.0, 0.0), (0.0, 0.0), (-1.0, 0.0), (0.0, 0.0)])
    for after in (0, 1, 3, 8):
        calls, bounded = itertools.count(), []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Clock, "is_over", lambda clock, after=after, calls=calls: next(calls) >= after)
            patch.setattr(distribution, "_AT_ONCE", 2)
            counted = lambda *x, bounded=bounded: bounded.append(len(x[3])) or distances_over(*x)  # noqa: E731
            patch.setattr(distribution, "distances_over", counted)
            found = jhd.deviation(zigzag, jhd.point_set([(0.0, 0.0)]), rtol=1e-9, max_seconds=60, throw=False)
            # Each look at the clock lets two cells through at most; the first ones are of the search for the maximum.
            assert sum(bounded) <= 2 * after
            known = jhd.MeanDistance()(zigzag, jhd.point_set([(0.0, 0.0)]), rtol=1e-9, max_seconds=60, throw=False)
        assert found.result == jhd.RESULTS.out_of_time
        assert encloses(found.mean, 0.5) and encloses(found.rms, 3**-0.5)
        assert encloses(found.quantile(0.5), 0.5) and encloses(found.fraction_within(0.25), 0.25)
        assert known.result == jhd.RESULTS.out_of_time and known.lower <= 0.5 <= known.upper


def triangulated(net: np.ndarray, count: int) -> tuple[Any, jhd.TriangleMesh]:
    """A uniform bicubic surface of a net, and a mesh of so many squares along each side whose vertices lie on it."""
    knots = np.arange(len(net) + 4.0)
    surface, pieces = jhd.BSplineSurface(net, knots, knots), len(net) - 3
    u = np.arange(count + 1) * pieces / count
    k = np.minimum(u.astype(int), pieces - 1)
    patches: Any = surface.patches()
    vertices = patches.point(k[:, None] * pieces + k, (u - k)[:, None], u - k)
    index = np.arange((count + 1) ** 2).reshape(count + 1, -1)
    sides = [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]]
    faces = np.concatenate([np.stack(x, axis=-1).reshape(-1, 3) for x in (sides[:3], [sides[0], *sides[2:]])])
    return surface, jhd.TriangleMesh(np.asarray(vertices).reshape(-1, 3), faces)


def middles_of_parts(n):
    """Barycentric coordinates of the middles of the n^2 equal parts of a triangle."""
    i, j = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    upward, downward = i + j < n, i + j < n - 1
    rows = [np.stack([i[at], j[at]], axis=1) + k / 3 for at, k in ((upward, 1), (downward, 2))]
    rows = np.concatenate(rows) / n
    return np.column_stack([1 - np.sum(rows, axis=1), rows])


@pytest.mark.exhaustive
@pytest.mark.parametrize("back", [False, True])
def test_a_surface_and_its_triangulation_close_and_agree_with_a_dense_sum(back):
    x, y = np.meshgrid(*[(np.arange(6) - 1) / 3] * 2, indexing="ij")
    surface, mesh = triangulated(np.stack([x, y, 0.15 * np.sin(4 * x + 1) * np.cos(3 * y)], axis=-1), 7)
    a, b = (surface, mesh) if back else (mesh, surface)
    found = jhd.deviation(a, b, rtol=0.02)
    shares = middles_of_parts(24)
    corners = np.asarray(mesh.corners)
    points = np.einsum("sk,tkd->tsd", shares, corners).reshape(-1, 3)
    sides = corners[:, 1:] - corners[:, :1]
    weights = np.repeat(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1), len(shares))
    if back:
        n = 120
        middles = (np.arange(n) + 0.5) / n
        u, v = (z.ravel() for z in np.meshgrid(middles, middles))
        patches: Any = surface.patches()
        k = np.arange(patches.count)[:, None]
        points = np.asarray(patches.point(k, u, v)).reshape(-1, 3)
        steps = [
            np.asarray(patches.point(k, u + i, v + j)) - np.asarray(patches.point(k, u - i, v - j))
            for i, j in ((1e-5, 0), (0, 1e-5))
        ]
        weights = np.linalg.norm(np.cross(steps[0], steps[1]), axis=-1).ravel()
    distance = np.asarray(jhd.project(points, b).distance)
    mean = np.average(distance, weights=weights)
    # Of so many samples the mean is good to a few thousandths.
    assert found.mean.lower <= 1.005 * mean and 0.995 * mean <= found.mean.upper
    assert within(found, 2e-6, 0.02) and found.stats["cells"] < (40_000 if back else 8_000)
