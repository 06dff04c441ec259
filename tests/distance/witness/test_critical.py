"""Critical pairs: the largest is the Hausdorff distance, all are maxima, each once, and their gradients are right."""

from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.witness.critical import local_pairs
from jhd._results.solution import name_of
from tests.cases import CASES
from tests.distance.pairs import BY_NAME, both, curve, diagonal, is_quick
from tests.sweeps import swept

# Largest distances agree with proven ones to the tolerance of the search.
VALUE = 1e-10
# Gradients against central differences of the values.
GRADIENT, STEP = 1e-6, 1e-6
# Length of the list, the one that fits use: its programs are compiled there too.
CAPACITY = 32
# Quick cases of every event, among them two feet, corners and ends.
QUICK = (
    "arch_and_wave",
    "corner_of_cubics",
    "degrees_3_and_3",
    "foot_and_end_of_hook",
    "shared_stretch_of_waves",
    "wave_over_line",
    "quarter_circle_cubic",
)
OTHERS = [case.name for case in CASES if case.name not in QUICK and is_quick(case)]

# Random pairs of each kind below; the first ones run with the quick tests.
RANDOM, FEW = 60, 2
# Largest maxima between samples: beside an end of b, and at tips of folds that nearly coincide.
NARROW = (
    ([[-1, 0], [1, -1], [-1, 1], [1, 1]], [[1, 0], [0, 0], [-1, -1], [1, 1]], 1e-8),
    ([[-0.6, 0], [-1.1, 0], [0.1, 0], [-0.14, 0]], [[-0.6, 0], [-1.1, 0], [0.10000001, 0], [-0.14, 0]], 0.1),
)


def pair_of(name):
    """The curves of a case; quick ones with weights, so that they share the programs of the fits."""
    case = BY_NAME[name]
    return (curve(case.a, True), curve(case.b, True)) if name in QUICK else both(case)


@cache
def found(name):
    """The critical pairs of a case, once for all tests."""
    return jhd.critical_pairs(*pair_of(name), CAPACITY)


def events_of(pairs):
    count = int(jnp.sum(pairs.valid))
    return [name_of(jax.tree_util.tree_map(lambda x, k=k: x[k], pairs.witness.event)) for k in range(count)]


@pytest.mark.parametrize(
    "name", swept([*QUICK, *(name for name in OTHERS if BY_NAME[name].a.weights is None)], slow=QUICK)
)
def test_the_largest_pair_is_the_hausdorff_distance(name):
    solution = jhd.hausdorff(*pair_of(name))
    assert abs(float(found(name).value[0]) - float(solution.value)) <= VALUE * diagonal(name)


def folded_line(rng):
    return np.stack([rng.uniform(-1.2, 1.2, 4), np.zeros(4)], axis=1)


def oblique_line(rng):
    angle, points = rng.uniform(0, np.pi), folded_line(rng)
    return points[:, :1] * [np.cos(angle), np.sin(angle)] + rng.uniform(-0.3, 0.3, 2)


def free_cubic(rng):
    return rng.uniform(-1, 1, (4, 2)) * [1.2, 0.6]


def doubled_end(rng):
    return free_cubic(rng)[[0, 1, 2, 2]]


def doubled_start(rng):
    return free_cubic(rng)[[0, 0, 2, 3]]


STILL = (
    (free_cubic, folded_line),
    (free_cubic, oblique_line),
    (folded_line, free_cubic),
    (folded_line, folded_line),
    (doubled_end, free_cubic),
    (doubled_start, free_cubic),
    (free_cubic, doubled_end),
    (doubled_end, doubled_end),
)


def cubic(points):
    return jhd.BezierSegments(np.asarray(points, float)[None], np.ones((1, 4)))


@pytest.mark.parametrize("count", swept([FEW, RANDOM], slow=[FEW]))
def test_samples_alone_show_the_largest_maximum_where_a_curve_stands_still(count):
    for kinds in STILL:
        rng = np.random.default_rng(5)
        for _ in range(count):
            a, b = (cubic(kind(rng)) for kind in kinds)
            first = float(local_pairs(a, b, CAPACITY)[0].value[0])
            solution = jhd.hausdorff(a, b)
            assert solution.lower * (1 - 1e-9) - 1e-13 <= first <= solution.upper * (1 + 1e-9) + 1e-13, (a, b)


@jax.jit
@jax.vmap
def largest_and_bounds(a, b):
    a, b = jhd.BezierSegments(a[None]), jhd.BezierSegments(b[None])
    solution = jhd.hausdorff(a, b)
    return jhd.critical_pairs(a, b).value[0], solution.lower, solution.upper


@pytest.mark.exhaustive
@pytest.mark.parametrize("kinds", STILL)
def test_the_first_value_is_the_distance_of_two_thousand_pairs_of_each_kind(kinds):
    rng = np.random.default_rng(6)
    for _ in range(8):
        a, b = (np.stack([kind(rng) for _ in range(250)]) for kind in kinds)
        first, lower, upper = map(np.asarray, largest_and_bounds(a, b))
        missed = (first < lower * (1 - 1e-9) - 1e-13) | (first > upper * (1 + 1e-9) + 1e-13)
        assert not np.any(missed), (a[missed][:2], b[missed][:2])


@pytest.mark.slow
def test_a_largest_maximum_between_samples_comes_first():
    for *points, least in NARROW:
        a, b = (cubic(rows) for rows in points)
        samples, solution = local_pairs(a, b, CAPACITY)[0], jhd.hausdorff(a, b)
        pairs = jhd.critical_pairs(a, b, CAPACITY)
        assert samples.value[0] < solution.lower * (1 - least)
        assert solution.lower <= pairs.value[0] <= solution.upper
        assert int(jnp.sum(pairs.valid)) == int(jnp.sum(samples.valid)) + 1
        np.testing.assert_array_equal(pairs.witness.point[0], solution.witness.point)
        np.testing.assert_array_equal(pairs.value[1:], samples.value[:-1])
        assert name_of(pairs.result) == "successful"


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_each_pair_is_the_proven_distance_of_its_point(name):
    (a, b), pairs = pair_of(name), found(name)
    turned = pairs.witness.direction == jhd.DIRECTIONS.b_to_a
    there = jhd.project(pairs.witness.point, b).distance
    back = jhd.project(pairs.witness.point, a).distance
    expected = jnp.where(pairs.valid, jnp.where(turned, back, there), 0.0)
    np.testing.assert_allclose(pairs.value, expected, rtol=0, atol=1e-12 * diagonal(name))
    assert np.all(np.diff(np.asarray(pairs.value)) <= 0)


def test_every_kind_of_event_is_found():
    assert {event for name in QUICK for event in events_of(found(name))} >= {
        "a_end",
        "corner",
        "b_end",
        "antipodal",
        "one_to_two",
    }


def test_a_corner_between_two_arms_counts_the_feet_on_both():
    # Along either leg of the corner one arm of the V goes away, so neither foot can stand alone.
    legs, arms = [[0.6, -0.2], [0.0, 0.0], [-0.6, -0.2]], [[-1.5, 0.5], [0.0, -1.0], [1.5, 0.5]]
    a, b = (jhd.BezierSegments(jhd.polyline(rows).control_points, np.ones((2, 2))) for rows in (legs, arms))
    pairs = jhd.critical_pairs(a, b, CAPACITY)
    at = [k for k in np.flatnonzero(pairs.valid) if np.allclose(pairs.witness.point[k], 0.0, atol=1e-12)]
    assert len(at) == 1 and events_of(pairs)[at[0]] == "corner"
    offsets = np.asarray(pairs.witness.point[at[0]] - pairs.witness.feet[at[0]])
    pull = pairs.witness.multipliers[at[0]] @ (offsets / np.linalg.norm(offsets, axis=1, keepdims=True))
    assert np.all(np.array([legs[0], legs[2]]) @ pull <= 1e-12)


def test_the_maxima_of_a_quarter_circle_come_once_each():
    pairs = found("quarter_circle_cubic")
    assert events_of(pairs) == ["antipodal"] * 3
    np.testing.assert_allclose(pairs.value[:3], 1.96076469877e-4, rtol=1e-6)


def test_smooth_seams_carry_no_maxima():
    first = jhd.BezierSegments([[[0, 0], [1, 1], [2, 2]], [[2, 2], [3, 3], [4, 4]]], jnp.ones((2, 3)))
    second = jhd.BezierSegments([[[0, 1], [1, 2], [2, 2]], [[2, 2], [3, 2], [4, 3]]], jnp.ones((2, 3)))
    assert "corner" not in events_of(jhd.critical_pairs(first, second, CAPACITY))


@pytest.mark.exhaustive
def test_what_does_not_fit_is_said():
    pairs = jhd.critical_pairs(*pair_of("shared_stretch_of_waves"), capacity=2)
    assert bool(jnp.all(pairs.valid)) and name_of(pairs.result) == "capacity_reached"


def test_there_are_fewer_maxima_than_places():
    pairs = found("wave_over_line")
    assert not bool(jnp.all(pairs.valid)) and name_of(pairs.result) == "successful"
    assert bool(jnp.all(jnp.where(pairs.valid, 0.0, pairs.value) == 0))


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["arch_and_wave", "corner_of_cubics"])
def test_values_have_their_derivatives(name):
    a, b = pair_of(name)
    direction = np.random.default_rng(7).normal(size=b.control_points.shape)

    def values(x):
        moved = eqx.tree_at(lambda c: c.control_points, b, b.control_points + x * direction)
        return jhd.critical_pairs(a, moved, CAPACITY).value

    step = STEP * diagonal(name)
    _, tangent = jax.jvp(jax.jit(values), (jnp.array(0.0),), (jnp.array(1.0),))
    center, ahead, behind = values(0.0), values(step), values(-step)
    # Where the number of maxima changes the list shifts; near zero they come and go.
    same = (center > 1e-3 * diagonal(name)) & (np.abs(ahead - center) + np.abs(behind - center) < 1e2 * step)
    assert np.sum(same) >= 1
    difference = (ahead - behind) / (2 * step)
    np.testing.assert_allclose(np.asarray(tangent)[same], difference[same], rtol=0, atol=1e2 * GRADIENT)


@pytest.mark.exhaustive
def test_a_batch_gives_what_single_pairs_give():
    a, b = pair_of("arch_and_wave")
    moves = jnp.linspace(0.0, 0.1, 3)
    points = b.control_points + moves[:, None, None, None]

    def values(p):
        return jhd.critical_pairs(a, eqx.tree_at(lambda c: c.control_points, b, p), CAPACITY).value

    for row, p in zip(jax.vmap(values)(points), points, strict=True):
        single = values(p)
        np.testing.assert_allclose(row, single, rtol=0, atol=1e-12)


@pytest.mark.parametrize("capacity", [0, 1.5, True])
def test_a_capacity_that_is_no_length_is_refused(capacity, as_a_user):
    a, b = pair_of("arch_and_wave")
    with pytest.raises(ValueError, match="capacity is .*; needs a whole number of at least 1"):
        jhd.critical_pairs(a, b, capacity)


def test_a_capacity_may_be_a_whole_number_of_numpy(as_a_user):
    a, b = pair_of("arch_and_wave")
    capacity: Any = np.int64(16)
    assert jhd.critical_pairs(a, b, capacity).value.shape == (16,)
