"""Certified distances: lower <= exact <= upper with no tolerance and no exception, and what the search costs."""

import os
from fractions import Fraction
from functools import cache
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jhd
from jhd._arithmetic import bernstein
from jhd._results.solution import name_of
from tests import reference
from tests.cases import CASES, EVENTS
from tests.distance import exact, pairs
from tests.processes import python
from tests.sweeps import swept

# The default tolerance, in diagonals.
GAP = 1e-10
# What the reference, which samples and refines, is off by at most, in diagonals.
REFERENCE = 1e-9
# No pair of the table takes more cells than this; the most is a folded segment with about 900.
MOST_CELLS = 5000

EVERY = pairs.parameters(CASES)
WITH_EVENT = pairs.parameters([case for case in CASES if case.tags & set(EVENTS)], ("ab",))
# Shapes of one compiled program for the sweeps.
SAME = [case.name for case in CASES if pairs.is_quick(case) and case.a.weights is None and case.b.weights is None]
SAME = [name for name in SAME if pairs.BY_NAME[name].a.control_points.shape[2] == 2]


@cache
def certified(name, direction="ab"):
    """The directed distance of a case with the default options."""
    a, b = pairs.both(pairs.BY_NAME[name])
    return jhd.directed_hausdorff(*((a, b) if direction == "ab" else (b, a)), jhd.BranchAndBound())


@pytest.mark.parametrize(("name", "direction"), EVERY)
def test_the_bounds_enclose_the_exact_distance(name, direction):
    least, most = pairs.bounds(pairs.in_order(name, direction)[2])
    solution = certified(name, direction)
    assert Fraction(float(solution.lower)) <= most
    assert least <= Fraction(float(solution.upper))
    assert solution.lower <= solution.value <= solution.upper


@pytest.mark.parametrize(("name", "direction"), EVERY)
def test_the_default_gap_is_met_within_few_cells(name, direction):
    solution = certified(name, direction)
    assert name_of(solution.result) == "successful"
    assert solution.upper - solution.lower <= GAP * pairs.diagonal(name) * (1 + 1e-12)
    # Sets of points have no cells: of them the points that were measured count.
    assert solution.stats["measured" if "points" in solution.stats else "cells"] <= MOST_CELLS


@pytest.mark.parametrize(("name", "direction"), WITH_EVENT)
def test_the_event_is_that_of_the_table(name, direction):
    assert name_of(certified(name, direction).event) in pairs.BY_NAME[name].tags


@pytest.mark.parametrize("name", SAME)
@pytest.mark.parametrize("atol", swept([1e-1, 1e-4, 1e-8], quick=[1e-1, 1e-8]))
def test_every_tolerance_is_met_and_true(name, atol):
    a, b = pairs.both(pairs.BY_NAME[name])
    atol = atol * pairs.diagonal(name)
    solution = jhd.directed_hausdorff(a, b, jhd.BranchAndBound(atol=atol))
    least, most = pairs.bounds(pairs.BY_NAME[name].exact_ab)
    assert Fraction(float(solution.lower)) <= most
    assert least <= Fraction(float(solution.upper))
    assert solution.upper - solution.lower <= atol * (1 + 1e-12)


@pytest.mark.parametrize("steps", [0, 1, 2, 3])
@pytest.mark.parametrize("name", ["segment_over_parabola", "cusp_over_chord", "arch_and_wave", "degrees_3_and_3"])
def test_bounds_are_true_whenever_the_search_is_stopped(name, steps):
    a, b = pairs.both(pairs.BY_NAME[name])
    solution = jhd.directed_hausdorff(a, b, jhd.BranchAndBound(max_steps=steps), throw=False)
    least, most = pairs.bounds(pairs.BY_NAME[name].exact_ab)
    assert Fraction(float(solution.lower)) <= most
    assert least <= Fraction(float(solution.upper))


TRACED = []


@jax.jit
def traced(a, b, atol):
    """One program, of two cubics and the shortest table, for all that is asked of the search within jit."""
    TRACED.append(None)
    method = jhd.BranchAndBound(atol=atol, queue_size=16)
    return jhd.directed_hausdorff(jhd.BezierSegments(a), jhd.BezierSegments(b), method)


def cubics(name):
    """The control points of a case of single segments, as cubics."""
    return [np.asarray(curve.elevate(3).control_points) for curve in pairs.both(pairs.BY_NAME[name])]


@pytest.mark.slow
def test_a_full_table_is_folded_into_the_upper_bound():
    name = "segment_folded"
    a, b = cubics(name)
    solution = traced(b, a, 0.0)
    assert name_of(solution.result) == "capacity_reached"
    assert pairs.bounds(pairs.BY_NAME[name].exact_ba)[0] <= Fraction(float(solution.upper))


def test_bounds_that_stay_open_are_raised_with_the_solution():
    b, a = pairs.both(pairs.BY_NAME["segment_folded"])
    method = jhd.BranchAndBound(max_steps=5)
    solution = jhd.directed_hausdorff(a, b, method, throw=False)
    with pytest.raises(jhd.NotProvenError, match="raise max_steps") as caught:
        jhd.directed_hausdorff(a, b, method)
    assert caught.value.solution.upper == solution.upper


def test_joints_of_b_cost_few_cells():
    # A copy in 44 unequal parts; of a line all joints are passed over at once, of a cubic each costs a few cells.
    ends = np.arange(45) ** 1.5 / 44**1.5
    for points, most in (([(0, 0), (2, 1)], 8), ([(0, 0), (1, 2), (2, -1), (3, 1)], 400)):
        a = np.array(points, float)
        parts = [np.array(bernstein.restrict(jnp.asarray(a), *part, axis=0)) for part in pairwise(ends)]
        for part, following in pairwise(parts):
            following[0] = part[-1]
        solution = jhd.directed_hausdorff(jhd.BezierSegments(a[None]), jhd.BezierSegments(np.stack(parts)))
        assert solution.lower == 0
        assert solution.stats["cells"] <= most


def test_a_relative_tolerance_saves_steps():
    a, b = pairs.both(pairs.BY_NAME["degrees_3_and_3"])
    rough = jhd.directed_hausdorff(a, b, jhd.BranchAndBound(rtol=0.2))
    assert rough.upper - rough.lower <= 0.2 * rough.upper
    assert rough.stats["steps"] <= certified("degrees_3_and_3").stats["steps"]


@st.composite
def lattice_cubics(draw):
    """Control points on half integers: ties, cusps, straight and pointlike cubics are frequent."""
    number = st.integers(-4, 4).map(lambda n: n / 2)
    rows = draw(st.lists(st.tuples(number, number), min_size=8, max_size=8))
    return np.array(rows).reshape(2, 1, 4, 2)


@given(lattice_cubics(), st.sampled_from([0.0, 1e6, -3e8]), st.sampled_from([1.0, 2.0**-40, 2.0**40]))
@settings(max_examples=60)
@pytest.mark.slow
def test_bounds_of_lattice_cubics_hold_against_the_reference(pair, offset, scale):
    a, b = (rows * scale + offset * scale for rows in pair)
    solution = jhd.directed_hausdorff(jhd.BezierSegments(a), jhd.BezierSegments(b), throw=False)
    # The reference rounds too, by a few units of its coordinates.
    found = reference.directed_hausdorff((a, None), (b, None), accuracy=1e-6, budget=300)
    rounding = 1e-14 * max(np.abs(a).max(), np.abs(b).max()) if offset == 0 else 1e-15 * np.abs(a).max() * 64
    assert solution.lower <= found.upper + rounding
    assert found.value - rounding <= solution.upper
    diagonal = reference.diagonal((a, None), (b, None))
    assert name_of(solution.result) == "successful" or solution.upper - solution.lower > GAP * diagonal


@pytest.mark.slow
def test_options_are_leaves_and_a_new_tolerance_does_not_compile_again():
    a, b = cubics("arch_and_wave")
    rough = traced(a, b, 1e-1)
    before = len(TRACED)
    fine = traced(a, b, 1e-9)
    assert len(TRACED) == before
    assert fine.upper - fine.lower <= 1e-9 < rough.upper - rough.lower <= 1e-1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"atol": -1e-3}, "atol is -0.001; needs a number of at least 0"),
        ({"rtol": -1.0}, "rtol is -1; needs a number of at least 0"),
        ({"atol": float("nan")}, "atol is not finite: nan"),
        ({"atol": [1.0, 2.0]}, r"atol has shape \(2,\); needs a scalar"),
        ({"max_steps": -1}, "max_steps is -1; needs a whole number of at least 0"),
        ({"queue_size": 3}, "queue_size is 3; needs a whole number of at least 16"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        jhd.BranchAndBound(**options)


SINGLE = """
import numpy as np
import jhd
from fractions import Fraction
from tests.distance import pairs
for name in {names!r}:
    case = pairs.BY_NAME[name]
    a, b = (np.asarray(x.control_points, np.float32).astype(float) for x in (case.a, case.b))
    if not (np.array_equal(a, case.a.control_points) and np.array_equal(b, case.b.control_points)):
        continue
    solution = jhd.directed_hausdorff(jhd.BezierSegments(a), jhd.BezierSegments(b), throw=False)
    assert solution.upper.dtype == np.float32
    least, most = pairs.bounds(case.exact_ab)
    assert Fraction(float(solution.lower)) <= most, name
    assert least <= Fraction(float(solution.upper)), name
    print(name)
"""


# The entries' test in single precision has these bounds too.
@pytest.mark.exhaustive
def test_bounds_hold_in_single_precision():
    environment = {**os.environ, "JAX_ENABLE_X64": "0"}
    assert len(python("-c", SINGLE.format(names=SAME), env=environment).stdout.split()) >= 20


# Input on which several cells followed one wrong foot until they could not be cut any more.
WRONG_FEET = {
    "point beside a loop": (
        [[[0.0, 0.0], [0.0, 0.0]]],
        [
            [
                [-0.16562128497504833, -0.6399333061634052],
                [-0.4057032590245457, 0.04938460226862738],
                [0.33075594543170794, 1.3916958141835247],
                [0.19010351305384077, -1.7112966367125264],
            ]
        ],
    ),
    "part of a parabola": (
        [
            [
                [0.011553658356274546, 0.3887912280821764],
                [-0.04600608435845748, 0.38193087899062117],
                [-0.09374308138254589, 0.376687781818159],
            ]
        ],
        [
            [
                [1.3829317964295942, 0.5762263434216522],
                [-1.4907249200742059, 0.16113477350383856],
                [0.4685626766846063, 0.5417564096134483],
            ]
        ],
    ),
}


@pytest.mark.parametrize("name", WRONG_FEET)
def test_wrong_feet_are_repaired(name):
    a, b = (jhd.BezierSegments(rows) for rows in WRONG_FEET[name])
    solution = jhd.directed_hausdorff(a, b)
    assert name_of(solution.result) == "successful"
    assert solution.stats["cells"] <= 40


@pytest.mark.parametrize("weight", [1e-8, 1e-30, 1e-49])
def test_tiny_weights_do_not_vanish(weight):
    # The nearest point of the segment is its end at the origin, where the arch's middle is 0.3 away.
    a = jhd.BezierSegments([[[0.1, -0.1], [0.5, 0.0], [0.1, 0.1]]])
    b = jhd.BezierSegments([[[0.0, 0.0], [-1.0, 0.0]]], [[weight, 1.0]])
    solution = jhd.directed_hausdorff(a, b)
    assert solution.lower <= 0.3 <= solution.upper
    assert solution.upper <= 0.3 + 1e-9


def test_weights_of_too_large_a_ratio_are_refused():
    with pytest.raises(ValueError, match="weights range from 1e-60 to 1; their ratio must be at most 1e"):
        jhd.BezierCurve([[0.0, 0.0], [1.0, 0.0]], [1e-60, 1.0])


def test_a_distance_beyond_the_largest_float_has_a_finite_lower_bound():
    far = 1.7e308
    a, b = (jhd.polyline([[x, 0.0], [x, 1e300]]) for x in (-far, far))
    assert jhd.directed_hausdorff(a, b, throw=False).lower == np.finfo(float).max


@pytest.mark.parametrize("scale", [1e-307, 1e-310])
@pytest.mark.slow
def test_upper_bounds_of_subnormal_coordinates_are_true_under_jit(scale):
    x = np.linspace(0.0, 1.0, 4)
    low, high = (np.stack([x, np.full(4, y)], axis=1)[None] * scale for y in (0.0, 2.0))
    # No tolerance: both are segments along x over the same interval.
    assert float(np.asarray(traced(low, high, 0.0).upper)) >= 2.0 * scale


# ---- random pairs --------------------------------------------------------------------------------


def random_pair(seed):
    rng = np.random.default_rng(seed)
    return tuple(rng.normal(size=(rng.integers(1, 4), rng.integers(1, 5), 2)) for _ in range(2))


@pytest.mark.parametrize("seed", range(12))
def test_bounds_of_random_pairs_hold_the_reference_and_the_distance_of_the_witness(seed):
    a, b = random_pair(seed)
    solution = jhd.directed_hausdorff(jhd.BezierSegments(a), jhd.BezierSegments(b))
    expected = reference.directed_hausdorff((a, None), (b, None))
    accuracy = REFERENCE * reference.diagonal((a, None), (b, None))
    assert expected.value - accuracy <= solution.value <= expected.upper + accuracy
    assert solution.lower <= expected.upper and expected.value - accuracy <= solution.upper
    # The lower bound is below the exact distance of the place that the solution names.
    point = exact.point(a[int(solution.witness.element)], None, Fraction(float(solution.witness.t)))
    point = np.array([float(x) for x in point])
    _, segment, s = reference.project(point, b)
    assert Fraction(float(solution.lower)) ** 2 <= exact.minimum_near(point, b[segment], None, s)


@pytest.mark.slow
def test_a_batch_under_jit_and_vmap_is_its_single_calls_and_what_is_not_finite_stays_in_its_lane():
    a, b = np.random.default_rng(3).normal(size=(2, 4, 1, 4, 2))
    a[1, 0, 0, 0] = np.nan
    found = jax.jit(jax.vmap(lambda x, y: jhd.hausdorff(jhd.BezierSegments(x), jhd.BezierSegments(y))))(a, b)
    lanes = [jax.tree_util.tree_map(lambda x, k=k: x[k], found) for k in range(4)]
    assert [name_of(lane.result) for lane in lanes] == ["successful", "nonfinite_value", "successful", "successful"]
    assert float(lanes[1].lower) == 0 and float(lanes[1].upper) == np.inf
    for k in (0, 2, 3):
        one = jhd.hausdorff(jhd.BezierSegments(a[k]), jhd.BezierSegments(b[k]))
        np.testing.assert_allclose(lanes[k].value, one.value, rtol=1e-12)
        np.testing.assert_allclose(lanes[k].lower, one.lower, rtol=1e-11)
        assert (name_of(lanes[k].event), name_of(lanes[k].direction)) == (name_of(one.event), name_of(one.direction))
