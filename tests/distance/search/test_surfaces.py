"""Distances of implicit surfaces with a proof: true bounds, published examples, what has no distance, and programs."""

import math
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._results.solution import ANSWERS, name_of
from jhd._shapes import ImplicitSurface
from tests import surface_cases
from tests.sweeps import swept

LOWER, UPPER = [-2.0] * 3, [2.0] * 3


def parsed(text, lower=LOWER, upper=UPPER):
    return ImplicitSurface.parse(text, lower, upper)


CONES = parsed("x^2/4 + y^2/4 - z^2/9"), parsed("x^2/16 + y^2/4 - z^2/9")
EXACT_H21, EXACT_H12 = (math.sqrt(43) - 4) / 3, 0.798859586020371
SPHERE = parsed("x^2 + y^2 + z^2 - 1")
NOWHERE = parsed("x^2 + y^2 + z^2 + 1e-4")


def check(solution, exact, gap):
    assert float(solution.lower) <= exact <= float(solution.upper)
    assert float(solution.lower) <= float(solution.value) <= float(solution.upper)
    assert float(solution.upper) - float(solution.lower) <= gap


@pytest.mark.slow
def test_the_published_cones_are_proven_to_ten_digits():
    solution = jhd.hausdorff(*CONES)
    check(solution, EXACT_H21, 1e-10 * 4 * math.sqrt(3))
    witness = solution.witness
    assert name_of(solution.result) == "successful" and name_of(solution.event) == "a_end"
    assert name_of(solution.direction) == "b_to_a"
    # A corner of the second cone in two faces of the box; all four are as far.
    assert np.allclose(np.abs(witness.point), [2, math.sqrt(7) / 3, 2], atol=1e-12)
    assert witness.feet.shape == (4, 3) and witness.multipliers.tolist() == [1, 0, 0, 0]
    assert int(witness.element) == -1 and np.isnan(witness.t)
    assert abs(np.linalg.norm(witness.point - witness.feet[0]) - EXACT_H21) < 1e-12
    assert int(solution.stats["a_to_b_cells"]) < 2000 > int(solution.stats["b_to_a_cells"])


@pytest.mark.slow
def test_two_feet_of_the_first_cone_balance():
    solution = jhd.directed_hausdorff(*CONES)
    check(solution, EXACT_H12, 1e-10 * 4 * math.sqrt(3))
    witness = solution.witness
    assert name_of(solution.event) == "one_to_two"
    assert np.allclose(np.abs(witness.point), [4 / 3, 0, 2], atol=1e-9)
    assert np.allclose(witness.multipliers, [0.5, 0.5, 0, 0], atol=1e-6)
    feet = np.linalg.norm(np.asarray(witness.point - witness.feet), axis=1)
    assert np.allclose(feet[:2], EXACT_H12, atol=1e-9)
    assert np.array_equal(witness.feet[2], witness.feet[0]) and np.array_equal(witness.feet[3], witness.feet[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "answer"), [(0.9, ANSWERS.no), (1.1, ANSWERS.yes), (1.0, ANSWERS.undecided)], ids=["no", "yes", "open"]
)
def test_a_threshold_is_decided_with_less_work(factor, answer):
    threshold = EXACT_H21 * factor
    decision = jhd.hausdorff_at_most(*CONES, threshold)
    assert decision.answer == answer
    assert float(decision.lower) <= EXACT_H21 <= float(decision.upper)
    if factor > 1:
        assert int(decision.stats["b_to_a_cells"]) < 200


def test_a_surface_proven_empty_is_refused_and_under_a_trace_has_a_code():
    with pytest.raises(ValueError, match="b: the surface is empty"):
        jhd.hausdorff(SPHERE, NOWHERE)
    with pytest.raises(ValueError, match="a: the surface is empty"):
        jhd.directed_hausdorff(NOWHERE, SPHERE)


@pytest.mark.slow
def test_a_single_line_gets_no_number():
    line = parsed("x^2 + y^2")
    with pytest.raises(jhd.NotProvenError, match="does not change its sign"):
        jhd.directed_hausdorff(SPHERE, line)
    for pair in ((SPHERE, line), (line, SPHERE)):
        solution = jhd.directed_hausdorff(*pair, throw=False)
        assert name_of(solution.result) == "existence_not_certified" and np.isnan(solution.value)
        assert (float(solution.lower), float(solution.upper)) == (0.0, math.inf)


@pytest.mark.slow
def test_a_single_point_is_a_surface_where_the_stored_polynomial_has_it():
    point = parsed("(x - 0.25)^2 + y^2 + z^2")
    check(jhd.directed_hausdorff(point, SPHERE), 0.75, 1e-9)
    with pytest.raises(ValueError, match="b: the surface is empty"):
        # The stored coefficients are rounded, and their polynomial is above zero everywhere.
        jhd.directed_hausdorff(SPHERE, parsed("(x - 0.3)^2 + y^2 + z^2"))


def test_a_surface_on_itself_is_at_distance_zero():
    for surface in (SPHERE, CONES[0]):
        solution = jhd.hausdorff(surface, surface)
        check(solution, 0.0, 1e-10 * 4 * math.sqrt(3))
        assert name_of(solution.event) == "coincident"


@pytest.mark.exhaustive  # programs of its own
def test_planes_cylinders_and_surfaces_in_faces_are_surfaces():
    plane, tilted = parsed("z - 0.5"), parsed("z - 0.5 - x/8")
    solution = jhd.directed_hausdorff(plane, tilted, jhd.BranchAndBound(atol=1e-4), throw=False)
    check(solution, 0.25 / math.sqrt(1 + 1 / 64), 1e-2)
    face = parsed("z - 2")
    solution = jhd.directed_hausdorff(face, plane)
    check(solution, 1.5, 1e-9)
    check(jhd.directed_hausdorff(plane, face), 1.5, 1e-9)
    outer = jhd.directed_hausdorff(parsed("x^2 + y^2 - 4/9"), SPHERE, throw=False)
    check(outer, math.hypot(2 / 3, 2) - 1, 1e-2)


@pytest.mark.parametrize(("other", "exact"), swept([("z + 1", 2.0), ("z", 1.0), ("x - 1", 2.0)]))
def test_planes_in_faces_of_their_boxes_are_as_far_as_they_are_apart(other, exact):
    box = [-1.0] * 3, [1.0] * 3
    face, plane = parsed("z - 1", *box), parsed(other, *box)
    for pair in ((face, plane), (plane, face)):
        check(jhd.directed_hausdorff(*pair), exact, 1e-9)


def test_far_from_the_origin_nothing_is_lost():
    shift = 2.0**20
    moved = [cone.transform(np.eye(3), [shift, 0.0, -shift]) for cone in CONES]
    # The stored coefficients are those of the moved cones exactly: all digits of the shift are in them.
    solution = jhd.hausdorff(moved[0], moved[1])
    check(solution, EXACT_H21, 1e-9)


@pytest.mark.slow
def test_progress_is_reported_and_an_interruption_ends_with_true_bounds():
    seen = []
    jhd.directed_hausdorff(*CONES, progress=seen.append)
    assert seen and seen[-1].stage == "a_to_b"
    assert seen[-1].lower <= EXACT_H12 <= seen[-1].upper

    def stop(_):
        raise KeyboardInterrupt

    hard = parsed("x^2 + y^2 + z^2 - 1.21")
    stopped = jhd.hausdorff(SPHERE, hard, throw=False, progress=stop)
    assert name_of(stopped.result) == "interrupted"
    assert float(stopped.lower) <= math.sqrt(1.21) - 1 <= float(stopped.upper) < math.inf


@pytest.mark.exhaustive
def test_more_room_closes_the_gap_where_a_circle_of_feet_is_as_near():
    """From the poles of the ellipsoid all of a circle of the torus is nearest."""
    box, exact = ([-4] * 3, [4] * 3), math.sqrt(5) - 1
    ellipsoid, torus = parsed("x^2/9 + y^2/4 + z^2 - 1", *box), parsed("(x^2 + y^2 + z^2 + 3)^2 - 16*(x^2 + y^2)", *box)
    gaps = []
    for capacity in (512, 2048):
        solution = jhd.directed_hausdorff(ellipsoid, torus, jhd.BranchAndBound(queue_size=capacity), throw=False)
        check(solution, exact, 1e-5)
        assert name_of(solution.result) == "capacity_reached"
        gaps.append(float(solution.upper - solution.lower))
    assert gaps[1] < 0.25 * gaps[0]


def test_too_little_room_leaves_true_bounds_and_says_so():
    inner, outer = SPHERE, parsed("x^2 + y^2 + z^2 - 1.5625")
    solution = jhd.directed_hausdorff(inner, outer, jhd.BranchAndBound(max_steps=60), throw=False)
    check(solution, 0.25, 0.1)
    assert name_of(solution.result) in ("gap_not_closed", "nonisolated_maxima", "capacity_reached")


@pytest.mark.parametrize("name", swept(surface_cases.BY_NAME, slow=surface_cases.SLOW[::2]))
def test_bounds_hold_the_exact_distances(name):
    case = surface_cases.BY_NAME[name]
    a, b = (ImplicitSurface(*surface) for surface in (case.a, case.b))
    degenerate = case.tags & {"degenerate", "coincident"}
    for pair, maximum in (((a, b), case.ab), ((b, a), case.ba)):
        solution = jhd.directed_hausdorff(*pair, jhd.BranchAndBound(max_steps=300 if degenerate else 4000), throw=False)
        exact = Fraction(maximum.value)
        assert Fraction(float(solution.lower)) <= exact <= Fraction(float(solution.upper))
        diagonal = float(jnp.linalg.norm(jnp.maximum(a.upper, b.upper) - jnp.minimum(a.lower, b.lower)))
        gap = float(solution.upper - solution.lower) / diagonal
        # What is asked for by default, and the rounding of this quotient.
        asked = 1e-10 * (1 + 1e-12)
        assert gap <= (1e-2 if degenerate else asked)
        assert (gap <= asked) == (solution.result == jhd.RESULTS.successful)


GHOSTS = {
    "cells of b without a point": ("x^2 + y^2 + z^2 - 1", "((x - 1.2)^2 + y^2 + z^2 + 1e-4)*(x + 1.5)", 2.5, 1e-9),
    "cells of a without a point": (
        "((x - 1.7)^2 + y^2 + z^2 + 1e-4)*(x^2 + y^2 + z^2 - 1)",
        "x^2 + y^2 + z^2 - 1.21",
        0.1,
        2e-2,
    ),
}


@pytest.mark.parametrize("name", swept(GHOSTS))
def test_cells_without_a_point_do_not_count(name):
    a, b, exact, gap = GHOSTS[name]
    check(jhd.directed_hausdorff(parsed(a), parsed(b), jhd.BranchAndBound(atol=gap / 2), throw=False), exact, gap)


@pytest.mark.exhaustive
def test_one_program_gives_the_same_under_jit_vmap_and_grad():
    def distance(coefficients):
        a = ImplicitSurface(coefficients, LOWER, UPPER, reduced=False)
        return jhd.directed_hausdorff(a, CONES[1]).value

    a = CONES[0].coefficients
    value, slope = jax.jit(jax.value_and_grad(distance))(a)
    assert abs(float(value) - EXACT_H12) < 1e-9
    assert np.all(np.isfinite(slope)) and np.any(slope != 0)

    def outcome(coefficients):
        a = ImplicitSurface(coefficients, LOWER, UPPER, reduced=False)
        solution = jhd.directed_hausdorff(a, CONES[1])
        return solution.result._value, solution.lower, solution.upper, solution.value

    # Two of no distance in one batch with three of the same.
    result, lower, upper, values = jax.jit(jax.vmap(outcome))(
        jnp.stack([a, 3 * a, -a, NOWHERE.coefficients, a * np.nan])
    )
    assert np.allclose(values[:3], EXACT_H12, atol=1e-9)
    names = ("successful", "successful", "successful", "empty_surface", "nonfinite_value")
    assert result.tolist() == [int(getattr(jhd.RESULTS, name)._value) for name in names]
    assert lower[3:].tolist() == [0.0, 0.0] and upper[3:].tolist() == [math.inf, math.inf]


@pytest.mark.exhaustive
def test_both_directions_under_jit_are_those_from_the_host():
    known = jhd.hausdorff(*CONES)
    found = jax.jit(lambda x: jhd.hausdorff(ImplicitSurface(x, LOWER, UPPER, reduced=False), CONES[1]))(
        CONES[0].coefficients
    )
    assert known.directions is not None and found.directions is not None
    for there, here in zip((known, *known.directions), (found, *found.directions), strict=True):
        assert abs(float(there.value) - float(here.value)) < 1e-9
        assert max(float(there.lower), float(here.lower)) <= min(float(there.upper), float(here.upper))
        assert int(there.direction._value) == int(here.direction._value)


FAMILIES = {
    "cylinders": ("x^2 + y^2 - 1", "x^2 + y^2 - 1.5625", 0.25),
    "spheres": ("x^2 + y^2 + z^2 - 1", "x^2 + y^2 + z^2 - 1.5625", 0.25),
    "tori": ("(x^2 + y^2 + z^2 + 0.9375)^2 - 4*x^2 - 4*y^2", "(x^2 + y^2 + z^2 + 0.859375)^2 - 4*x^2 - 4*y^2", 0.125),
}


@pytest.mark.parametrize("name", swept(FAMILIES, slow=["cylinders"]))
def test_what_is_equally_far_everywhere_closes_to_a_millionth_of_the_diagonal(name):
    first, second, exact = FAMILIES[name]
    a, b, gap = parsed(first), parsed(second), 1e-6 * 4 * math.sqrt(3)
    solution = jhd.directed_hausdorff(a, b, jhd.BranchAndBound(atol=gap))
    check(solution, exact, gap)
    assert int(solution.stats["cells"]) < 30_000
    if name == "cylinders":
        # What does not close by default says so, and has bounds.
        found = jhd.directed_hausdorff(a, b, jhd.BranchAndBound(max_steps=20), throw=False)
        assert name_of(found.result) == "nonisolated_maxima" and float(found.lower) <= exact <= float(found.upper)
