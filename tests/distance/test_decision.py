"""Whether a distance is at most a threshold: proven answers, and steps saved far from the distance."""

import jax
import numpy as np
import pytest

import jhd
from jhd._distance.search.search import Listener, Watch
from jhd._results.solution import name_of
from jhd._runtime.clock import Clock
from jhd._runtime.decimals import lower_text
from jhd.progress import Progress
from tests.distance import pairs
from tests.sweeps import swept

SOME = ("segment_over_parabola", "cusp_over_chord", "arch_and_wave", "loop_and_line", "degrees_3_and_3", "hook")
# The larger of both exact distances, as a float: thresholds keep away from it by far more than its rounding.
EXACT = {
    name: max(float(pairs.bounds(e)[0]) for e in _exacts)
    for name, _exacts in ((name, (pairs.BY_NAME[name].exact_ab, pairs.BY_NAME[name].exact_ba)) for name in SOME)
}


@pytest.mark.parametrize("name", swept(SOME, 2))
@pytest.mark.parametrize(("factor", "answer"), [(0.5, "no"), (1 - 1e-6, "no"), (1 + 1e-6, "yes"), (2.0, "yes")])
def test_answers_are_right_on_both_sides(name, factor, answer):
    decision = jhd.hausdorff_at_most(*pairs.both(pairs.BY_NAME[name]), EXACT[name] * factor)
    assert name_of(decision.answer) == answer
    assert name_of(decision.result) == "successful"
    assert decision.lower <= EXACT[name] * (1 + 1e-15)
    assert EXACT[name] * (1 - 1e-15) <= decision.upper


def test_a_threshold_inside_the_gap_is_undecided():
    a, b = pairs.both(pairs.BY_NAME["degrees_3_and_3"])
    decision = jhd.hausdorff_at_most(a, b, EXACT["degrees_3_and_3"])
    assert name_of(decision.answer) == "undecided"
    assert name_of(decision.result) == "gap_not_closed"
    assert decision.lower <= EXACT["degrees_3_and_3"] <= decision.upper


def test_a_decision_counts_as_what_it_answers_and_an_undecided_one_as_nothing():
    a, b = pairs.both(pairs.BY_NAME["degrees_3_and_3"])
    assert jhd.hausdorff_at_most(a, b, 2 * EXACT["degrees_3_and_3"])
    assert not jhd.hausdorff_at_most(a, b, EXACT["degrees_3_and_3"] / 2)
    undecided = jhd.hausdorff_at_most(a, b, EXACT["degrees_3_and_3"])
    with pytest.raises(
        ValueError, match=f"undecided: the distance lies between {lower_text(undecided.lower)} and .* atol"
    ):
        bool(undecided)
    batch = jax.tree_util.tree_map(lambda x: jax.numpy.stack([x, x]), undecided)
    with pytest.raises(ValueError, match="there are 2 decisions"):
        bool(batch)
    with pytest.raises(jax.errors.TracerBoolConversionError):
        jax.jit(lambda d: 1 if d else 0)(undecided)


def test_a_decision_shows_its_answer_its_bounds_and_how_it_ended():
    lower, upper = (jax.numpy.array(x, float) for x in (1.5, 2.0))
    decision = jhd.Decision(jhd.ANSWERS.undecided, lower, upper, jhd.RESULTS.gap_not_closed, {})
    assert repr(decision) == "Decision(undecided, lower=1.5, upper=2.0, gap_not_closed, distance=two_sided)"
    shown = [repr(jax.tree_util.tree_map(lambda x: jax.numpy.stack([x, x]), decision))]
    jax.jit(lambda d: shown.append(repr(d)))(decision)
    assert (
        shown[0] == "Decision(batch of 2, lower from 1.5 to 1.5,\n  2 of 2 not successful: 2 gap_not_closed; index it)"
    )
    assert shown[1].startswith("Decision(lower=f64[]") and "traced" in shown[1]


def test_zero_is_an_answer():
    a = jhd.BezierCurve([(0, 0), (1, 1), (2, 0)])
    assert name_of(jhd.hausdorff_at_most(a, a.transform(np.eye(2), (0, 1)), 0).answer) == "no"


def steps(found):
    """Steps of both directions."""
    return int(found.stats["a_to_b_steps"]) + int(found.stats["b_to_a_steps"])


@pytest.mark.slow
def test_a_shape_is_within_zero_of_its_copy():
    # The bounds of a search leave the rounding of coordinates open.
    curve = lambda: jhd.BezierCurve([(0, 0), (1, 2), (2, -1), (3, 1)])  # noqa: E731
    assert jhd.hausdorff_at_most(curve(), curve(), 0) and jhd.hausdorff_at_most(curve(), curve(), 0, directed=True)
    other = curve().transform(np.eye(2), (0, 1e-13))
    found = jhd.pairs_within([curve(), other, curve()], threshold=0)
    assert found.index.tolist() == [[0, 2]] and not len(found.undecided)


def test_far_thresholds_take_far_fewer_steps():
    # Two wavy closed curves: their full distance takes several steps in each direction.
    angle = 2 * np.pi * np.arange(30) / 30
    ring = [
        np.stack([(1 + w * np.cos(k * angle)) * np.cos(angle), (1 + w * np.sin(k * angle)) * np.sin(angle)], axis=1)
        for w, k in ((0.1, 5), (0.15, 7))
    ]
    a, b = (jhd.BSplineCurve.uniform(rows, periodic=True).segments() for rows in ring)
    # Each direction alone: of the second one the two-sided distance finds out only what the first leaves open.
    full = sum(int(jhd.directed_hausdorff(*pair).stats["steps"]) for pair in ((a, b), (b, a)))
    distance = float(jhd.hausdorff(a, b))
    assert full >= 6
    assert steps(jhd.hausdorff_at_most(a, b, 3 * distance)) <= full / 3
    assert steps(jhd.hausdorff_at_most(a, b, distance / 3)) <= full / 3


def test_the_second_direction_is_not_searched_if_the_first_one_exceeds_the_threshold():
    # From the diagonal to the base it is 3, back it is 2.4.
    base, diagonal = jhd.polyline([(0, 0), (4, 0)]), jhd.polyline([(0, 0), (4, 3)])
    assert int(jhd.directed_hausdorff(base, diagonal).stats["steps"]) > 0
    decision = jhd.hausdorff_at_most(diagonal, base, 1.0)
    assert name_of(decision.answer) == "no" and int(decision.stats["b_to_a_steps"]) == 0


@pytest.mark.exhaustive  # a program of its own
def test_decisions_under_jit_are_those_of_plain_calls():
    a, b = pairs.both(pairs.BY_NAME["arch_and_wave"])
    decide = jax.jit(lambda threshold: jhd.hausdorff_at_most(a, b, threshold))
    for threshold, answer in ((1e-3, "no"), (1e3, "yes")):
        plain = jhd.hausdorff_at_most(a, b, threshold)
        assert name_of(decide(threshold).answer) == name_of(plain.answer) == answer


def test_bad_thresholds_and_methods_are_refused():
    a, b = pairs.both(pairs.BY_NAME["arch_and_wave"])
    with pytest.raises(ValueError, match="needs one number of at least 0"):
        jhd.hausdorff_at_most(a, b, -1.0)
    with pytest.raises(ValueError, match="threshold is not finite"):
        jhd.hausdorff_at_most(a, b, float("nan"))
    with pytest.raises(TypeError, match=r"method must be BranchAndBound\(\)"):
        jhd.hausdorff_at_most(a, b, 1.0, jhd.published.TwoStep())


def test_one_direction_may_be_asked_for():
    # From the base to the diagonal it is 2.4, both ways 3.
    base, diagonal = jhd.polyline([(0, 0), (4, 0)]), jhd.polyline([(0, 0), (4, 3)])
    assert jhd.hausdorff_at_most(base, diagonal, 2.5, directed=True)
    assert not jhd.hausdorff_at_most(base, diagonal, 2.5)
    assert not jhd.hausdorff_at_most(base, diagonal, 2.3, directed=True)
    far = jhd.hausdorff_at_most(base, diagonal, 1e3, directed=True)
    assert int(far.stats["steps"]) < int(jhd.directed_hausdorff(base, diagonal).stats["steps"])


def test_a_minimum_distance_is_decided_by_fewer_steps():
    # Many pairs of triangles of two crumpled sheets are nearly equally far.
    random = np.random.default_rng(0)
    x, y = np.meshgrid(*[np.arange(12.0)] * 2, indexing="ij")
    corner = (12 * np.arange(11)[:, None] + np.arange(11)).ravel()
    triangles = np.concatenate([corner[:, None] + [0, 12, 13], corner[:, None] + [0, 13, 1]])
    a, b = (
        jhd.TriangleMesh(np.stack([x, y, z + 0.01 * random.normal(size=x.shape)], axis=-1).reshape(-1, 3), triangles)
        for z in (0.0, 9.0)
    )
    method = jhd.BranchAndBound(atol=1e-13)
    full = jhd.minimum_distance(a, b, method)
    for factor, answer in ((0.5, "no"), (2.0, "yes")):
        found = jhd.minimum_at_most(a, b, factor * float(full.value), method)
        assert name_of(found.answer) == answer and name_of(found.result) == "successful"
        assert found.lower <= full.upper and full.lower <= found.upper
        assert int(found.stats["steps"]) < int(full.stats["steps"])
    with pytest.raises(ValueError, match="needs one number of at least 0"):
        jhd.minimum_at_most(a, b, -1.0)
    with pytest.raises(TypeError, match=r"method must be BranchAndBound\(\)|^Type-check error"):
        jhd.minimum_at_most(a, b, 1.0, jhd.published.VoxelPairs(8))  # pyright: ignore[reportArgumentType]


def test_a_threshold_ends_a_search_when_it_is_passed():
    heard = []
    ends = Watch(heard.append, Clock(), 1.0)
    for lower, upper, passed in ((0.0, 2.0, False), (0.0, 1.0, True), (1.0, 2.0, False), (1.5, 2.0, True)):
        ends(Progress("minimum", 0, 0, lower, upper))
        assert ends.passed == passed and Listener(ends).satisfied == passed
    assert len(heard) == 4 and not Listener(heard.append).satisfied
