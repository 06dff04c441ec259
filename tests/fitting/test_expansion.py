"""Gradients and Hessians of critical pairs against differences of their values, for every event, weights included."""

import numpy as np
import pytest

import jhd
from jhd._distance.witness.critical import local_pairs
from jhd._fitting.expansion import Moving, expand
from tests.distance.pairs import BY_NAME, curve
from tests.distance.witness.test_critical import STILL, cubic
from tests.sweeps import swept

# Step along a line of homogeneous control points; third and fourth derivatives and rounding leave these errors.
STEP, GRADIENT, HESSIAN = 1e-4, 1e-6, 1e-4
CAPACITY = 32
# Two feet, free and held; corners; ends; feet at ends; close curves.
NAMES = ("arch_and_wave", "foot_and_end_of_hook", "corner_of_cubics", "wave_over_line", "degrees_3_and_3")


def rational(homogeneous, following):
    weights = homogeneous[..., -1]
    return jhd.BezierSegments(homogeneous[..., :-1] / weights[..., None], weights, following)


@pytest.mark.parametrize(("name", "which"), swept([(name, which) for which in "ab" for name in NAMES], 1, 2))
def test_derivatives_of_all_pairs_agree_with_differences(name, which):
    case = BY_NAME[name]
    fixed, moving = curve(case.b, True), curve(case.a, True)
    if which == "b":
        fixed, moving = moving, fixed
    points = np.asarray(moving.homogeneous)
    direction = 0.3 * np.random.default_rng(3).normal(size=points.shape)
    # Joined segments stay joined: the ends move alike.
    direction[..., [0, -1], :] = [0.1, -0.2, 0.05]

    def pairs(x):
        return jhd.critical_pairs(fixed, rational(points + x * direction, moving.next_segment), CAPACITY)

    still = Moving(np.asarray(fixed.homogeneous), None, True)
    found = expand(pairs(0.0), still, Moving(points, direction[..., None], True), 1e-3)
    count = len(found.value)
    behind, ahead = (np.asarray(pairs(x).value)[:count] for x in (-STEP, STEP))
    # Equal values change places.
    apart = np.abs(np.diff(found.value)) > 1e2 * STEP
    apart = np.append(True, apart) & np.append(apart, True)
    near = apart & (np.abs(ahead - found.value) + np.abs(behind - found.value) < 1e2 * STEP)
    assert np.any(near)
    slope, bend = (ahead - behind) / (2 * STEP), (ahead - 2 * found.value + behind) / STEP**2
    size = 1 + np.abs(bend[near])
    hessians = np.array([found.hessian(weights)[0, 0] for weights in np.eye(count)])
    np.testing.assert_allclose(found.gradient[near, 0], slope[near], rtol=0, atol=1e2 * GRADIENT)
    assert np.max(np.abs(hessians[near] - bend[near]) / size) <= 1e2 * HESSIAN
    np.testing.assert_allclose(
        np.sum(found.cotangent * direction, axis=(1, 2, 3)), found.gradient[:, 0], rtol=0, atol=1e-12
    )


def test_a_foot_stays_at_an_end_that_stands_still_up_to_rounding():
    # The start of a is farthest, straight above the end of b, where the rounding of b' is across.
    a = jhd.BezierSegments([[[1, 1], [1, 0.9], [0.95, 0.3], [1, 0.1]]], np.ones((1, 4)))
    b = jhd.BezierSegments([[[0.8, -0.3], [0.9, -0.2], [np.nextafter(1, 0), 0], [1, 0]]], np.ones((1, 4)))
    tangent = np.zeros((1, 4, 3, 1))
    # Upwards, so that the foot is at the end still.
    tangent[0, 3, :2, 0] = [0.3, 1.0]
    pairs, _ = local_pairs(a, b, CAPACITY)
    moving = [Moving(np.asarray(x.homogeneous), t, True) for x, t in ((a, None), (b, tangent))]
    found = expand(pairs, moving[0], moving[1], 1e-3)
    bend = found.hessian(np.eye(len(found.value))[0])[0, 0]
    np.testing.assert_allclose([found.value[0], found.gradient[0, 0], bend], [1, -1, 0.09], rtol=1e-12)


@pytest.mark.parametrize("count", swept([1, 40], slow=[1]))
def test_derivatives_of_the_largest_pair_of_curves_that_stand_still_agree_with_differences(count):
    for kinds in STILL:
        rng = np.random.default_rng(9)
        for _ in range(count):
            fixed, moving = (cubic(kind(rng)) for kind in kinds)
            points, way = np.asarray(moving.homogeneous), np.append(rng.normal(size=(1, 4, 2)), np.zeros((1, 4, 1)), -1)

            def pairs(x, fixed=fixed, points=points, way=way):
                return jhd.critical_pairs(fixed, rational(points + x * way, None), CAPACITY)

            still = Moving(np.asarray(fixed.homogeneous), None, True)
            found = expand(pairs(0.0), still, Moving(points, way[..., None], True), 1e-3)
            ahead, behind = ((float(pairs(x).value[0]) - found.value[0]) / x for x in (1e-6, -1e-6))
            # Beside a tie of two maxima it is one of the one-sided slopes.
            assert min(ahead, behind) - 1e-4 <= found.gradient[0, 0] <= max(ahead, behind) + 1e-4, (fixed, moving)
