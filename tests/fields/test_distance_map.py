"""The distance map: the stated error holds, the nearest arc is the nearest, and tiles leave no trace."""

import importlib
from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd import BezierSegments, BSplineCurve, circle, point_set, polyline, project
from jhd._arithmetic.rounding import gamma
from jhd._fields import distance_map
from jhd._shapes import BiarcCurve, biarcs
from tests import reference
from tests.shapes.test_biarc import CASES, exact_distance, spline
from tests.sweeps import swept

module = importlib.import_module("jhd._fields.distance_map")

# The reference's distances, in units of the size of the configuration.
REFERENCE = 1e-12
# One rounding more or less where programs of another size fuse other operations.
ROUNDING = 1e-14
# What the module states for one distance, in coordinates of size one.
ALLOWED = gamma(module._ROUNDINGS, np.float64)
BOX = ([-6.0, -5.5], [6.0, 6.5])


def pixels(found, count, seed=0):
    """Indices of random pixels, and their centers."""
    rng = np.random.default_rng(seed)
    i, j = (rng.integers(0, n, count) for n in found.distance.shape)
    x, y = (np.asarray(c) for c in found.centers)
    return (i, j), np.stack([x[i], y[j]], axis=-1)


def every_distance(arcs, found):
    """Distances of all pixels to all arcs, (arcs, columns, rows), by the textbook's formula with the center."""
    x, y = (np.asarray(c) for c in found.centers)
    at = (x[:, None] + 1j * y)[None]
    start, end, center = ((np.asarray(p) @ [1, 1j])[:, None, None] for p in (arcs.start, arcs.end, arcs.center))
    bulge, radius = (np.asarray(p)[:, None, None] for p in (arcs.bulge, arcs.radius))
    assert np.all(bulge != 0)
    ends = np.minimum(np.abs(at - start), np.abs(at - end))
    turn = np.sign(bulge)
    sweep = 4 * np.arctan(np.abs(bulge))
    angle = np.mod(turn * np.angle((at - center) / (start - center)), 2 * np.pi)
    return np.where(angle <= sweep, np.abs(np.abs(at - center) - radius), ends)


def test_the_map_is_within_its_error_of_the_projected_distance():
    curve = spline(30)
    found = distance_map(curve, *BOX, 64)
    index, at = pixels(found, 128)
    exact, stored, error = project(at, curve), np.asarray(found.distance)[index], float(found.error)
    assert np.all(stored - error <= np.asarray(exact.upper)) and np.all(np.asarray(exact.lower) <= stored + error)
    # An eighth of a pixel was allowed, and the arcs used a part of it.
    assert 0.3 < error / (np.asarray(found.spacing).min() / 8) < 1.001


# The reference loses weights as uneven as those of one case.
@pytest.mark.parametrize("name", [name for name in CASES if name != "uneven weights"])
def test_the_map_of_every_kind_of_curve_is_within_its_error(name):
    curve = CASES[name]
    low, high = (np.asarray(x) for x in curve.bounds)
    side = float(np.max(high - low)) or 1.0
    found = distance_map(curve, low - 0.5 * side, high + 0.4 * side, (33, 20))
    index, at = pixels(found, 30)
    weights = None if curve.weights is None else np.asarray(curve.weights)
    # In units of the size, since the reference squares lengths and has tolerances for coordinates of size one.
    rows, at = (np.asarray(curve.control_points) - low) / side, (at - low) / side
    exact = side * reference.distance_profile(at, rows, weights)
    assert np.all(np.abs(np.asarray(found.distance)[index] - exact) <= float(found.error) + side * REFERENCE)


def test_the_nearest_arc_attains_the_distance_and_no_other_is_nearer():
    arcs = biarcs(spline(12), 1e-3)
    found = distance_map(arcs, *BOX, (90, 70))
    distances = every_distance(arcs, found)
    np.testing.assert_allclose(found.distance, distances.min(axis=0), rtol=0, atol=1e-12)
    attained = np.take_along_axis(distances, np.asarray(found.nearest)[None], axis=0)[0]
    np.testing.assert_allclose(attained, distances.min(axis=0), rtol=0, atol=1e-12)
    assert len(np.unique(found.nearest)) > 0.8 * arcs.count


@pytest.mark.parametrize("tile", swept([1, 128, 7, 32], 0, 2))
def test_tiles_leave_no_trace(tile):
    arcs = biarcs(spline(12), 1e-4)
    size = (40, 24) if tile == 1 else (100, 60)
    whole, parts = (distance_map(arcs, *BOX, size, tile=t) for t in (512, tile))
    np.testing.assert_allclose(parts.distance, whole.distance, rtol=0, atol=ROUNDING)
    different = np.asarray(parts.nearest != whole.nearest)
    assert different.mean() < 1e-3


def test_small_batches_and_tiles_side_by_side_leave_no_trace(monkeypatch):
    arcs = biarcs(spline(12), 1e-5)
    whole = distance_map(arcs, *BOX, 128, tile=16)
    monkeypatch.setattr(module, "_PAIRS", 64)
    monkeypatch.setattr(module, "_TILES", 8)
    monkeypatch.setattr(module, "_BATCH", 4)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    parts = distance_map(arcs, *BOX, 128, tile=16)
    np.testing.assert_allclose(parts.distance, whole.distance, rtol=0, atol=ROUNDING)
    assert np.mean(np.asarray(parts.nearest != whole.nearest)) < 1e-3


def test_a_tile_meets_few_of_many_arcs():
    arcs = biarcs(spline(30), 1e-7)
    low, high = (np.asarray(x) for x in BOX)
    frame = module._PixelFrame.of(arcs, low, high)
    table, step = frame.table(arcs), np.ldexp((high - low) / 1024, -frame.first - frame.second)
    met = [counts for _, counts, _ in module._batches(table, step, [32, 32], 32)]
    assert sum(map(len, met)) == 32 * 32
    assert np.mean(np.concatenate(met)) < arcs.count / 8


one_arc = jax.jit(lambda table, x, y: module._distance(jnp, table, x, y))


@pytest.mark.parametrize("bulge", [0.0, 1e-40, -1e-17, 1e-9, -1e-4, 0.1, -0.3, 0.5])
def test_one_distance_errs_by_less_than_its_roundings(bulge):
    """Points anywhere, on the arc, on the rays of its ends, and about its center, against 45 digits."""
    rng = np.random.default_rng(3)
    start, end = rng.uniform(-1, 1, (2, 2))
    for chord in (1.0, 1e-3, 1e-9):
        stop = start + chord * (end - start)
        new = (jnp.asarray([x]) for x in (start, stop, bulge))
        arcs = replace(TEMPLATE, **dict(zip(("start", "end", "bulge"), new, strict=True)))
        z, w = start @ [1, 1j], (stop - start) @ [1, 1j]
        along = rng.uniform(-0.2, 1.2, 12)
        on = z + w * along + rng.normal(size=12) * 1e-9
        first = (stop - start) @ [1, 1j] * np.exp(-2j * np.arctan(bulge)) * 1j
        ray = z + first / abs(first) * rng.uniform(-1, 1, 12)
        at = np.concatenate([rng.uniform(-1, 1, 12) + 1j * rng.uniform(-1, 1, 12), on, ray])
        if bulge and abs(arcs.center).max() < 3:
            about = 10.0 ** rng.uniform(-16, -0.3, 20) * np.exp(2j * np.pi * rng.uniform(size=20))
            at = np.append(at, np.asarray(arcs.center)[0] @ [1, 1j] + about)
        frame = module._PixelFrame(np.zeros(2), 0, 0)
        found = one_arc(frame.table(arcs)[:, 0], np.resize(at, 64).real, np.resize(at, 64).imag)
        with localcontext() as context:
            context.prec = 150
            for p, value in zip(at, np.asarray(found)[: len(at)], strict=True):
                exact = exact_distance((Fraction(p.real), Fraction(p.imag)), start, stop, bulge)
                assert abs(exact - Decimal(float(value))) <= Decimal(ALLOWED)


def test_beyond_the_center_of_a_short_arc_its_ends_are_the_nearest():
    """Of an arc of radius one and length 1e-9 both rays are one line there, up to rounding."""
    rng = np.random.default_rng(4)
    for angle in rng.uniform(0, 2 * np.pi, 10):
        turn = np.exp(1j * angle)
        start, end = (np.array([z.real, z.imag]) for z in (turn * np.exp(-0.5e-9j), turn * np.exp(0.5e-9j)))
        new = (jnp.asarray([x]) for x in (start, end, 0.25e-9))
        arcs = replace(TEMPLATE, **dict(zip(("start", "end", "bulge"), new, strict=True)))
        left = 1j * ((end - start) @ [1, 1j])
        beyond = np.asarray(arcs.center)[0] @ [1, 1j] + left / abs(left) * 10.0 ** rng.uniform(-10, -1, 64)
        table = module._PixelFrame(np.zeros(2), 0, 0).table(arcs)[:, 0]
        expected = np.abs(beyond - start @ [1, 1j])
        np.testing.assert_allclose(one_arc(table, beyond.real, beyond.imag), expected, rtol=0, atol=ALLOWED)


TEMPLATE = biarcs(polyline([[0, 0], [1, 0]]), 1e-3)


def test_points_and_lines_have_their_exact_distances():
    rng = np.random.default_rng(5)
    rows = rng.uniform(-5, 5, (20, 2))
    found = distance_map(point_set(rows), *BOX, 50)
    x, y = (np.asarray(c) for c in found.centers)
    expected = np.hypot(x[:, None, None] - rows[:, 0], y[None, :, None] - rows[:, 1])
    np.testing.assert_allclose(found.distance, expected.min(axis=-1), rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(found.nearest, expected.argmin(axis=-1))
    square = polyline([[-1, -1], [1, -1], [1, 1], [-1, 1]], closed=True)
    found = distance_map(square, [-2, -2], [2, 2], 32)
    outside = np.maximum(np.abs(np.stack(np.meshgrid(*found.centers, indexing="ij"))) - 1, 0)
    inside = 1 - np.abs(np.stack(np.meshgrid(*found.centers, indexing="ij"))).max(axis=0)
    np.testing.assert_allclose(found.distance, np.where(inside > 0, inside, np.hypot(*outside)), rtol=0, atol=ROUNDING)
    assert float(found.error) < 1e-11


def test_the_first_axis_is_x_and_pixels_have_their_centers_inside():
    found = distance_map(point_set([[0.0, 0.0]]), [0, 0], [4, 1], (8, 4))
    assert found.distance.shape == found.nearest.shape == (8, 4)
    np.testing.assert_array_equal(found.spacing, [0.5, 0.25])
    np.testing.assert_array_equal(found.centers[0][:2], [0.25, 0.75])
    np.testing.assert_allclose(found.distance[7, 0], np.hypot(3.75, 0.125), rtol=1e-14)


def test_anywhere_in_a_pixel_the_distance_is_within_reach_and_enclosed():
    curve = spline(12)
    found = distance_map(curve, *BOX, 64)
    rng = np.random.default_rng(2)
    at = rng.uniform(*BOX, (200, 2))
    exact = reference.distance_profile(at, np.asarray(curve.segments().control_points))
    index = tuple(np.floor((at - np.asarray(found.lower)) / np.asarray(found.spacing)).astype(int).T)
    assert np.all(np.abs(np.asarray(found.distance)[index] - exact) <= float(found.max_error) + REFERENCE)
    bounds = found.enclose(at)
    assert np.all(np.asarray(bounds.lower) <= exact + REFERENCE) and np.all(
        exact - REFERENCE <= np.asarray(bounds.upper)
    )
    assert np.all(np.asarray(bounds.upper - bounds.lower) <= 2 * float(found.max_error) + REFERENCE)
    far = found.enclose([[100.0, 0.0]])
    exact = reference.distance_profile(np.array([[100.0, 0.0]]), np.asarray(curve.segments().control_points))
    assert float(far.lower[0]) <= exact[0] <= float(far.upper[0])
    center = np.stack([np.asarray(found.centers[0])[3], np.asarray(found.centers[1])[5]])
    at_center = jax.jit(lambda x: found.enclose(x))(center)
    assert float(at_center.upper) - float(found.distance[3, 5]) < 1.001 * float(found.error)


@pytest.mark.parametrize("scale", [1e-150, 1e150, 2.0**1000])
def test_scale_changes_nothing(scale):
    curve = spline(12)
    plain = distance_map(curve, *BOX, 40)
    scaled = distance_map(curve.transform(scale * np.eye(2)), scale * np.array(BOX[0]), scale * np.array(BOX[1]), 40)
    np.testing.assert_allclose(scaled.distance / scale, plain.distance, atol=2 * float(plain.error))
    np.testing.assert_allclose(float(scaled.error) / scale, float(plain.error), rtol=1e-3)


def test_far_from_the_origin_the_error_is_that_of_the_box():
    shift = np.array([1e8, -1e8])
    found = distance_map(circle(shift, 1), shift - 2, shift + 2, 32)
    index, at = pixels(found, 50)
    exact = np.abs(np.hypot(*(at - shift).T) - 1)
    assert np.all(np.abs(np.asarray(found.distance)[index] - exact) <= float(found.error) + 1e-7)
    arcs = biarcs(polyline([shift, shift + [1, 0]]), 1e-3)
    assert float(distance_map(arcs, shift - 2, shift + 2, 8).error) < 1e-11


def test_more_arcs_bring_the_map_nearer():
    errors = [float(distance_map(spline(12), *BOX, 16, tolerance=tolerance).error) for tolerance in (1e-2, 1e-4, 1e-6)]
    assert np.all(np.array(errors) <= [1e-2 + 1e-10, 1e-4 + 1e-10, 1e-6 + 1e-10])


def test_many_copies_of_one_arc_count_as_the_first():
    rows = BezierSegments(np.tile([[[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]]], (50, 1, 1)))
    found = distance_map(rows, [-1, -1], [3, 2], 32, tile=8)
    assert int(found.nearest.max()) < found.arcs.count // 50


def test_what_makes_no_map_is_refused(as_a_user):
    curve, arcs = spline(12), TEMPLATE
    for lower, upper, message in (
        ([0, 0], [0, 1], "empty or upside down"),
        ([1, 1], [0, 0], "empty or upside down"),
        ([np.nan, 0], [1, 1], "lower is not finite|lower\\[0\\] is not finite"),
        ([0, 0], [1, np.inf], "upper"),
        ([0, 0, 0], [1, 1, 1], r"lower has shape \(3,\)"),
    ):
        with pytest.raises(ValueError, match=message):
            distance_map(curve, lower, upper, 8)
    for resolution in (0, (4, 0), (4, 4, 4), -3):
        with pytest.raises(ValueError, match="resolution is"):
            distance_map(curve, *BOX, resolution)  # pyright: ignore[reportArgumentType]
    for resolution in (4.0, "8", (2, 2.5), True):
        with pytest.raises(TypeError, match="resolution must be"):
            distance_map(curve, *BOX, resolution)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="tile is 0"):
        distance_map(curve, *BOX, 8, tile=0)
    with pytest.raises(ValueError, match="tolerance is for a curve"):
        distance_map(arcs, *BOX, 8, tolerance=1e-3)
    with pytest.raises(ValueError, match="tolerance is -1.0; needs one positive number"):
        distance_map(curve, *BOX, 8, tolerance=-1)
    with pytest.raises(TypeError, match="curve must be a curve"):
        distance_map(3.0, *BOX, 8)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="coordinates a point"):
        distance_map(point_set(np.zeros((2, 3))), *BOX, 8)
    with pytest.raises(TypeError, match="traced"):
        jax.jit(lambda a: distance_map(a, *BOX, 8).distance)(arcs)
    with pytest.raises(TypeError, match="known lower"):
        jax.jit(lambda x: distance_map(curve, x, BOX[1], 8).distance)(jnp.zeros(2))
    found = distance_map(arcs, *BOX, 8)
    with pytest.raises(ValueError, match="points has shape"):
        found.enclose([0.0, 1.0, 2.0])
    with pytest.raises(ValueError, match="not finite"):
        found.enclose([0.0, np.nan])


def test_the_arcs_come_with_the_map():
    found = distance_map(BSplineCurve.clamped([[0, 0], [1, 2], [3, 1], [4, 3]]), [0, 0], [4, 3], 16)
    assert isinstance(found.arcs, BiarcCurve)
    assert int(found.nearest.max()) < found.arcs.count
