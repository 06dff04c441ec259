"""The two-step method against the whole table: values, bounds, events, witnesses, and what too few samples miss."""

from fractions import Fraction

import numpy as np
import pytest

import jhd
from jhd._results.solution import name_of
from tests.cases import CASES, EVENTS
from tests.distance import exact, pairs
from tests.sweeps import swept

# What the method promises of its values, in diagonals.
PROMISED = 1e-9
# Refined maxima reach 1e-12 of the diagonal; the proven bound lies below them by the rounding bounds of the search.
BOUND_BELOW = 2e-12
# The witness is computed in the common coordinates and moved back: roundings of the size of the coordinates.
ROUNDING = 1e-14
# Two feet are equally far up to what the refined parameter is off.
TIE = 1e-9

# Those that the quick tests solve, by one program; of the rest of the table one of each kind of program is slow.
QUICK = pairs.of_each_tag([c for c in CASES if pairs.is_quick(c) and c.a.weights is None and c.b.weights is None])


def parameters(cases, directions=("ab", "ba")):
    """Pairs of a name and a direction; the representative ones are quick, and a rational one is slow."""
    ways = [(case.name, way) for case in cases for way in directions]
    return swept(ways, [w for w in ways if w[0] in QUICK], [("circle_in_ellipse", "ab")])


def test_the_quick_cases_have_every_event():
    cases = [pairs.BY_NAME[name] for name in QUICK]
    assert set(EVENTS) <= set().union(*(case.tags for case in cases)) and len(cases) < len(CASES) / 2


@pytest.mark.parametrize(("name", "direction"), parameters(CASES))
def test_solutions_are_those_of_the_table(name, direction):
    tags = pairs.BY_NAME[name].tags
    value_agrees_with_the_table(name, direction)
    lower_bound_is_below_the_exact_distance_and_the_upper_one_is_open(name, direction)
    lower_bound_is_close_to_the_value(name, direction)
    witness_lies_on_both_curves_at_the_distance(name, direction)
    multipliers_are_weights_and_a_single_foot_is_repeated(name, direction)
    few_rounds_are_needed(name, direction)
    if direction == "ab" and tags & set(EVENTS):
        assert name_of(pairs.solved(name, direction).event) in tags
    if direction == "ab" and "one_to_two" in tags:
        multipliers_balance_the_slopes(name)
    # Close to b the direction of the foot is rounding, and at a cusp of a there is no tangent.
    if direction == "ab" and "antipodal" in tags and not tags & {"close", "cusp"}:
        assert abs(slopes(pairs.in_order(name, direction)[0], pairs.solved(name, direction).witness)[0]) <= 1e-6


def value_agrees_with_the_table(name, direction):
    lower, upper = pairs.bounds(pairs.in_order(name, direction)[2])
    value = Fraction(float(pairs.solved(name, direction)))
    accuracy = Fraction(PROMISED * pairs.diagonal(name))
    assert lower - accuracy <= value <= upper + accuracy


def lower_bound_is_below_the_exact_distance_and_the_upper_one_is_open(name, direction):
    solution = pairs.solved(name, direction)
    assert 0 <= Fraction(float(solution.lower)) <= pairs.bounds(pairs.in_order(name, direction)[2])[1]
    assert solution.lower <= solution.value
    assert solution.upper == np.inf
    assert name_of(solution.result) == "successful"


def lower_bound_is_close_to_the_value(name, direction):
    solution = pairs.solved(name, direction)
    case = pairs.BY_NAME[name]
    size = max(np.abs(shape.control_points).max() for shape in (case.a, case.b))
    # Far from the origin the common center is subtracted exactly, so the unit stays the diagonal.
    assert solution.value - solution.lower <= BOUND_BELOW * pairs.diagonal(name) + np.finfo(float).eps * size


def numbers(x):
    return np.asarray(x, dtype=float)


def witness_lies_on_both_curves_at_the_distance(name, direction):
    a, b, _ = pairs.in_order(name, direction)
    solution = pairs.solved(name, direction)
    witness, diagonal = solution.witness, pairs.diagonal(name)
    size = max(np.abs(shape.control_points).max() for shape in (a, b))
    off = ROUNDING * diagonal + 4 * np.finfo(float).eps * size
    assert 0 <= witness.element < len(a.control_points) and 0 <= witness.t <= 1
    point = on(a, int(witness.element), float(witness.t))
    np.testing.assert_allclose(witness.point, point, rtol=0, atol=off)
    for foot, segment, s, weight in zip(
        witness.feet, witness.feet_elements, witness.feet_params, witness.multipliers, strict=True
    ):
        assert 0 <= segment < len(b.control_points) and 0 <= s <= 1
        np.testing.assert_allclose(foot, on(b, int(segment), float(s)), rtol=0, atol=off)
        if weight > 0:
            distance = np.linalg.norm(numbers(witness.point) - numbers(foot))
            assert abs(distance - solution.value) <= TIE * diagonal + off


def on(shape, segment, t):
    weights = None if shape.weights is None else shape.weights[segment]
    return np.array([float(x) for x in exact.point(shape.control_points[segment], weights, Fraction(t))])


def multipliers_are_weights_and_a_single_foot_is_repeated(name, direction):
    witness = pairs.solved(name, direction).witness
    assert (witness.multipliers >= 0).all()
    assert abs(witness.multipliers.sum() - 1) <= 4 * np.finfo(float).eps
    # At an end or a corner of a several feet may be equally near, as they are at one_to_two events.
    if name_of(witness.event) not in ("one_to_two", "a_end", "corner"):
        np.testing.assert_array_equal(witness.multipliers, [1, 0])
    if witness.multipliers[1] == 0:
        np.testing.assert_array_equal(witness.feet[0], witness.feet[1])


def slopes(a, witness):
    """d/dt of the distances to both feet, in units of the speed of a."""
    weights = None if a.weights is None else a.weights[int(witness.element)]
    points = a.control_points[int(witness.element)]
    tangent = np.array([float(x) for x in exact.jet(points, weights, Fraction(float(witness.t)))[1]])
    offsets = numbers(witness.point) - numbers(witness.feet)
    return offsets @ tangent / np.linalg.norm(offsets, axis=1) / np.linalg.norm(tangent)


def multipliers_balance_the_slopes(name):
    a, _, _ = pairs.in_order(name, "ab")
    witness = pairs.solved(name).witness
    slope = slopes(a, witness)
    assert slope[0] * slope[1] < 0
    assert abs(numbers(witness.multipliers) @ slope) <= 1e-6


def test_known_multipliers():
    # y = x^2 from (0, 2) symmetrically; and the line under the cusp.
    np.testing.assert_allclose(pairs.solved("segment_over_parabola").witness.multipliers, [0.5, 0.5], atol=1e-9)
    witness = pairs.solved("segment_over_parabola").witness
    np.testing.assert_allclose(np.abs(numbers(witness.feet)), [[np.sqrt(1.5), 1.5]] * 2, atol=1e-9)


# ---- what it does not promise --------------------------------------------------------------------

# A line with a gap of width 1/50 about x = 0.3, whose middle is 1/100 from its ends; and a line that rises above it,
# so that the samples on either side of the gap show a distance that only grows.
GAP = jhd.BezierSegments([[[0.0, 0.0], [0.29, 0.0]], [[0.31, 0.0], [1.0, 0.0]]])
RISING = jhd.polyline([[0.0, 0.0], [1.0, 0.001]])
ACROSS = np.hypot(0.01, 0.0003)
FEW = jhd.published.TwoStep(samples=4)


@pytest.mark.exhaustive  # programs of its own
def test_too_few_samples_miss_a_narrow_maximum_and_say_nothing_false():
    missed = jhd.directed_hausdorff(RISING, GAP, FEW)
    assert abs(float(missed) - 0.001) <= 1e-12
    assert missed.lower <= missed.value and missed.upper == np.inf
    assert abs(float(jhd.directed_hausdorff(RISING, GAP)) - ACROSS) <= 1e-9


@pytest.mark.slow  # a program of its own
def test_few_samples_leave_every_lower_bound_true():
    for case in CASES:
        if pairs.is_quick(case) and case.a.weights is None and case.b.weights is None:
            solution = jhd.directed_hausdorff(*pairs.both(case), FEW)
            assert Fraction(float(solution.lower)) <= pairs.bounds(case.exact_ab)[1], case.name
            assert solution.value <= float(pairs.bounds(case.exact_ab)[1]) + PROMISED * pairs.diagonal(case.name)


@pytest.mark.exhaustive  # a program of its own
def test_samples_by_curvature_find_the_same_values():
    method = jhd.published.TwoStep(samples=64, spacing="curvature")
    for case in CASES:
        if pairs.is_quick(case) and case.a.weights is None and case.b.weights is None:
            solution = jhd.directed_hausdorff(*pairs.both(case), method)
            lower, upper = pairs.bounds(case.exact_ab)
            accuracy = Fraction(PROMISED * pairs.diagonal(case.name))
            assert lower - accuracy <= Fraction(float(solution.value)) <= upper + accuracy, case.name
            assert Fraction(float(solution.lower)) <= upper, case.name


@pytest.mark.exhaustive
def test_without_rounds_of_refinement_the_best_sample_is_left():
    a, b = pairs.both(pairs.BY_NAME["segment_over_parabola"])
    solution = jhd.directed_hausdorff(a, b, jhd.published.TwoStep(samples=3, max_rounds=0))
    assert solution.value < 1.3 and solution.lower <= solution.value
    assert solution.stats["rounds"] == 0


# ---- as published --------------------------------------------------------------------------------

PAPER = jhd.published.TwoStep(samples=10, variant="paper")


@pytest.mark.slow  # a program of its own
def test_the_printed_steps_find_events_of_both_kinds_to_the_printed_accuracy():
    """In a square, whose sides are one away from the origin, the farthest place has the largest coordinate least."""
    square = jhd.polyline([[-1.0, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    crossing, dip = jhd.polyline([[0.5, 0.3], [-0.6, 0.2]]), jhd.BezierCurve([[-0.5, 0.6], [0.0, 0.0], [0.5, 0.5]])
    for a, distance, event in ((crossing, 23 / 30, "one_to_two"), (dip, 8 / 11, "antipodal")):
        solution = jhd.directed_hausdorff(a, square, PAPER)
        assert abs(float(solution.value) - distance) <= 1e-10 and name_of(solution.event) == event
        assert float(solution.lower) <= distance and solution.upper == np.inf
        assert name_of(solution.result) == "not_certified"


@pytest.mark.slow  # the program of the test before
def test_the_printed_rule_for_ends_of_b_names_a_distance_that_a_does_not_have():
    """a lies on b, whose ends are far from a: the distance from a to b is zero, and the rule says one."""
    a, b = jhd.polyline([[1.0, 0.0], [2.0, 0.0]]), jhd.polyline([[0.0, 0.0], [3.0, 0.0]])
    solution = jhd.directed_hausdorff(a, b, PAPER)
    assert abs(float(solution.value) - 1) <= PROMISED and float(solution.lower) <= 1e-12


# ---- counts --------------------------------------------------------------------------------------


@pytest.mark.exhaustive  # programs of their own
def test_samples_are_counted_once_and_without_padding():
    """Ten steps of one segment are eleven samples; 90 of a closed curve of 90 segments are 90, however asked for."""
    one = jhd.BezierCurve([[0.0, 0.0], [1.0, 2.0], [2.0, -1.0], [3.0, 1.0]])
    for method in (jhd.published.TwoStep(samples=10), jhd.published.TwoStep(samples=10, per="curve"), PAPER):
        assert int(jhd.directed_hausdorff(one, one.transform(np.eye(2), [0.0, 1.0]), method).stats["samples"]) == 11
    angle = 2 * np.pi * np.arange(90) / 90
    ring = jhd.BSplineCurve.uniform(np.stack([3 * np.cos(angle), np.sin(angle)], axis=1), periodic=True)
    wide = jhd.BSplineCurve.uniform(np.stack([3 * np.cos(angle), 2 * np.sin(angle)], axis=1), periodic=True)
    found = [
        jhd.directed_hausdorff(ring, wide, m)
        for m in (jhd.published.TwoStep(90, per="curve"), jhd.published.TwoStep(1))
    ]
    assert [int(x.stats["samples"]) for x in found] == [90, 90]
    assert abs(float(found[0]) - float(found[1])) <= PROMISED


@pytest.mark.slow  # the program of few samples, which are as near here as ten of the whole curve
def test_a_branch_that_ends_inside_an_interval_hides_no_event():
    """The nearest foot at t = 0.2 disappears before 0.3; the maximum, at 0.223, is where the other one takes over."""
    a = jhd.BezierCurve([[0.0, 0.0], [1.0, 2.0], [2.0, -1.0], [3.0, 1.0]]).segments().restrict(0.0, 0.4)
    b = jhd.BezierCurve([[0.0, 0.5], [1.0, -1.0], [2.0, 2.0], [3.0, 0.0]])
    assert abs(float(jhd.directed_hausdorff(a, b, FEW)) - 0.63649209417456) <= PROMISED


def few_rounds_are_needed(name, direction):
    stats = pairs.solved(name, direction).stats
    # One or two rounds of eight intervals suffice but where the distance is constant along a stretch.
    flat = pairs.BY_NAME[name].tags & {"flat", "coincident", "close", "tie", "center"}
    assert stats["rounds"] <= (16 if flat else 4)


# ---- refusals ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": 0}, "samples is 0; needs a whole number of at least 1."),
        ({"samples": 2.5}, "samples is 2.5; needs a whole number of at least 1."),
        ({"samples": "many"}, "samples is 'many'; needs a whole number of at least 1."),
        ({"spacing": "dense"}, "spacing is 'dense'; needs 'uniform' or 'curvature'."),
        ({"per": "curve"}, "samples is None; per='curve' needs a whole number of at least 1."),
        (
            {"samples": 9, "per": "curve", "spacing": "curvature"},
            "spacing is 'curvature'; per='curve' and variant='paper' need 'uniform'.",
        ),
        ({"variant": "printed"}, "variant is 'printed'; needs 'ours' or 'paper'."),
        ({"max_rounds": -1}, "max_rounds is -1; needs a whole number of at least 0."),
        ({"max_rounds": 1.0}, "max_rounds is 1.0; needs a whole number of at least 0."),
    ],
    ids=str,
)
def test_options_out_of_range_are_refused(options, message, as_a_user):
    with pytest.raises(ValueError) as caught:
        jhd.published.TwoStep(**options)
    assert str(caught.value) == message
