"""Results, events, witnesses and solutions: what they say, and that they pass through transformations and JSON."""

import json
import operator
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

import jhd
from jhd._results.solution import name_of, result_where, throw_unless_successful, to_plain

RESULTS_OF_OUR_OWN = ("gap_not_closed", "capacity_reached", "nonfinite_value")
EVENTS = ("a_end", "corner", "b_end", "antipodal", "one_to_two", "coincident")


def a_solution(result=jhd.RESULTS.successful, upper=2.5, event=jhd.EVENTS.antipodal):
    witness = jhd.Witness(
        element=jnp.array(3),
        t=jnp.array(0.25),
        point=jnp.array([1.0, -2.0]),
        feet=jnp.array([[1.0, 0.0], [1.0, 0.0]]),
        feet_elements=jnp.array([0, 0]),
        feet_params=jnp.array([0.5, 0.5]),
        multipliers=jnp.array([1.0, 0.0]),
        event=event,
        direction=jhd.DIRECTIONS.a_to_b,
    )
    stats = {"rounds": jnp.array(2)}
    return jhd.HausdorffSolution(jnp.array(2.0), jnp.array(1.5), jnp.array(upper), witness, result, stats)


# ---- enumerations --------------------------------------------------------------------------------


def sentence_of(name):
    return jhd.RESULTS[getattr(jhd.RESULTS, name)]


def members(enumeration, names):
    return [(name, getattr(enumeration, name)) for name in names]


@pytest.mark.parametrize(
    ("name", "member"),
    members(jhd.RESULTS, RESULTS_OF_OUR_OWN)
    + members(jhd.EVENTS, EVENTS)
    + members(jhd.DIRECTIONS, ["a_to_b", "b_to_a"]),
)
def test_a_member_is_a_sentence_and_knows_its_name(name, member):
    sentence = str(member)
    assert sentence.split("<")[-1].rstrip(">")
    assert name_of(member) == name


@pytest.mark.parametrize("enumeration", [jhd.RESULTS, jhd.EVENTS, jhd.DIRECTIONS])
def test_sentences_are_complete_and_differ(enumeration):
    sentences = [text for text in enumeration._index_to_message if text]
    assert len(set(sentences)) == len(sentences)
    own = sentences if enumeration is not jhd.RESULTS else [sentence_of(name) for name in RESULTS_OF_OUR_OWN]
    for sentence in own:
        assert sentence[0].isupper() and sentence.endswith("."), sentence


@pytest.mark.parametrize("name", RESULTS_OF_OUR_OWN[:2])
def test_a_result_names_the_knob_to_turn(name):
    assert "raise " in sentence_of(name)


def test_results_extend_those_of_optimistix():
    assert jhd.RESULTS.promote(optx.RESULTS.successful) == jhd.RESULTS.successful
    assert name_of(jhd.RESULTS.successful) == "successful"
    promoted = jhd.RESULTS.promote(optx.RESULTS.nonlinear_max_steps_reached)
    assert name_of(promoted) == "nonlinear_max_steps_reached"


def test_events_are_chosen_under_jit():
    chosen = jax.jit(lambda x: jhd.EVENTS.where(x > 0, jhd.EVENTS.corner, jhd.EVENTS.b_end))
    assert name_of(chosen(1.0)) == "corner"
    assert name_of(chosen(-1.0)) == "b_end"


# ---- pytrees -------------------------------------------------------------------------------------


def test_a_solution_passes_through_jit():
    solution = jax.jit(lambda s: eqx.tree_at(lambda s: s.value, s, 2 * s.value))(a_solution())
    assert float(solution) == 4.0
    assert name_of(solution.event) == "antipodal"
    assert name_of(solution.result) == "successful"


def test_a_batch_of_solutions_is_a_solution_with_leading_axes():
    batch = jax.vmap(lambda x: eqx.tree_at(lambda s: s.value, a_solution(), x))(jnp.arange(3.0))
    np.testing.assert_array_equal(batch.value, [0.0, 1.0, 2.0])
    assert batch.witness.point.shape == (3, 2)
    assert repr(batch).count("\n") == 1 and "batch" in repr(batch)
    second = batch[1]
    assert float(second) == 1.0 and repr(second).startswith("HausdorffSolution(value=1.0,")
    assert float(batch[-1]) == 2.0 and batch[1:].value.tolist() == [1.0, 2.0]
    assert batch[np.array([True, False, True])].witness.point.shape == (2, 2)
    assert [float(each) for each in batch] == [0.0, 1.0, 2.0]
    assert float(jax.jit(lambda s, k: s[k].value)(batch, 2)) == 2.0


def test_only_a_batch_has_an_index_and_only_within():
    with pytest.raises(TypeError, match="this HausdorffSolution is a single result"):
        a_solution()[0]
    batch = jax.tree_util.tree_map(lambda x: jnp.stack([x, x]), a_solution())
    for index in (2, (0, 1)):
        with pytest.raises(IndexError):
            batch[index]
        with pytest.raises(IndexError):
            jax.jit(lambda s, index=index: s[index].value)(batch)


def test_a_batch_counts_what_did_not_succeed():
    names = ("successful", "gap_not_closed", "successful", "gap_not_closed", "capacity_reached")
    each = [a_solution(getattr(jhd.RESULTS, name)) for name in names]
    batch = jax.tree_util.tree_map(lambda *x: jnp.stack(x), *each)
    assert batch.ok.tolist() == [True, False, True, False, False]
    assert repr(batch).split("\n") == [
        "HausdorffSolution(batch of 5, value from 2 to 2,",
        "  3 of 5 not successful: 2 gap_not_closed, 1 capacity_reached; index it)",
    ]
    assert repr(batch[::2][:2]).endswith("\n  all successful; index it)") and bool(batch[0].ok)


def test_every_kind_of_solution_is_a_batch_in_the_same_way():
    def spread(member, *shape):
        return jax.tree_util.tree_map(lambda x: jnp.broadcast_to(x, (*shape, *jnp.shape(x))), member)

    numbers, places, success = jnp.arange(2.0), jnp.zeros((2, 3)), spread(jhd.RESULTS.successful, 2)
    witness, whole, valid = spread(a_solution().witness, 2, 3), jnp.zeros(2, int), places == 0
    batches = [
        jhd.MinimumSolution(numbers, numbers, numbers, places, places, success, {}),
        jhd.Projection(numbers, numbers, numbers, places, whole, numbers, success),
        jhd.StationaryPoints(valid.astype(int), places, places, places, places, valid, success),
        jhd.CriticalPairs(places, witness, valid, success),
        jhd.Decision(spread(jhd.ANSWERS.yes, 2), numbers, numbers, success, {}),
        jhd.StatisticSolution(numbers, numbers, numbers, spread(jhd.DIRECTIONS.a_to_b, 2), success),
    ]
    for batch in batches:
        assert batch.ok.tolist() == [True, True] and batch[1].ok.shape == ()
        assert repr(batch).startswith(f"{type(batch).__name__}(batch of 2, ") and "all successful" in repr(batch)
        assert "successful" in repr(batch[1]) and "f64" not in repr(batch[1])


def test_the_span_of_a_padded_batch_is_that_of_its_entries():
    distance, valid = jnp.array([[2.0, jnp.inf], [1.0, 3.0]]), jnp.array([[True, False], [True, True]])
    result = jax.tree_util.tree_map(lambda x: jnp.stack([x, x]), jhd.RESULTS.successful)
    batch = jhd.StationaryPoints(valid.astype(int), distance, distance, distance, distance, valid, result)
    assert "distance from 1 to 3," in repr(batch)


def test_a_batch_holds_results_of_several_kinds():
    batch = jax.vmap(lambda full: a_solution(result_where(full, jhd.RESULTS.capacity_reached, jhd.RESULTS.successful)))
    plain = json.loads(batch(jnp.array([False, True])).to_json())
    assert plain["result"] == ["successful", "capacity_reached"]
    assert plain["witness"]["event"] == ["antipodal", "antipodal"]


# ---- what is shown -------------------------------------------------------------------------------


def test_a_solution_is_shown_in_two_lines():
    assert repr(a_solution()).split("\n") == [
        "HausdorffSolution(value=2.0, lower=1.5, upper=2.5,",
        "  antipodal at (1, -2), a_to_b, successful)",
    ]


def test_a_solution_without_numbers_can_be_shown():
    solution, shown = a_solution(), []
    show = lambda s: shown.extend([repr(s), s._repr_html_(), repr(s.witness)])  # noqa: E731
    jax.jit(show)(solution)
    show(jax.eval_shape(lambda: solution))
    shown.append(repr(eqx.partition(solution, eqx.is_array)[1]))
    for text in shown:
        assert "HausdorffSolution(value=" in text or text.startswith("Witness(t=")
        assert "traced" in text


def test_the_float_of_a_solution_is_its_value():
    assert float(a_solution()) == 2.0
    with pytest.raises(TypeError):
        float(jax.tree_util.tree_map(lambda x: jnp.stack([x, x]), a_solution()))


def test_event_and_direction_are_those_of_the_witness():
    solution = a_solution()
    assert solution.event == jhd.EVENTS.antipodal
    assert solution.direction == jhd.DIRECTIONS.a_to_b


def test_json_holds_every_field_and_null_for_what_is_not_proven():
    plain = json.loads(a_solution(upper=jnp.inf).to_json())
    assert plain == {
        "value": 2.0,
        "lower": 1.5,
        "upper": None,
        "witness": {
            "element": 3,
            "t": 0.25,
            "point": [1.0, -2.0],
            "feet": [[1.0, 0.0], [1.0, 0.0]],
            "feet_elements": [0, 0],
            "feet_params": [0.5, 0.5],
            "multipliers": [1.0, 0.0],
            "event": "antipodal",
            "direction": "a_to_b",
        },
        "result": "successful",
        "stats": {"rounds": 2},
        "directed": True,
    }


def test_a_format_of_numbers_is_that_of_both_bounds_rounded_outward():
    solution = eqx.tree_at(lambda s: (s.lower, s.upper), a_solution(), (jnp.asarray(1.2349), jnp.asarray(1.2351)))
    assert f"{solution:.3f}" == "[1.234, 1.236]" and f"{solution:>8.1e}" == "[  1.2e+0,   1.3e+0]"
    assert f"{eqx.tree_at(lambda s: s.upper, solution, jnp.asarray(jnp.inf)):.2f}" == "[1.23, inf]"
    assert f"{solution}" == repr(solution)
    with pytest.raises(TypeError, match="one number"):
        f"{jax.tree_util.tree_map(lambda x: x[None], solution):.3f}"
    line = jhd.polyline([(0, 0), (1, 0)])
    # The mean of its distances is one, the largest two.
    found = [jhd.deviation(jhd.polyline([(0, 0), (0, 2)]), line), jhd.project((0, 1), line)]
    for one in (*found, jhd.hausdorff_at_most(line, line, 1)):
        assert f"{one:.1f}" in ("[0.9, 1.1]", "[1.0, 1.0]", "[0.0, 0.1]", "[0.0, 0.0]")


def test_a_dictionary_holds_what_json_holds_for_every_kind_of_solution():
    line = jhd.polyline([(0, 0), (1, 0)])
    kinds = [a_solution(), jhd.project([(0, 1)], line), jhd.hausdorff_at_most(line, line, 1)]
    kinds += [jhd.pairwise([line]), jhd.nearest_shapes([line], [line]), jhd.pairs_within([line, line], threshold=1)]
    for solution in kinds:
        assert json.loads(solution.to_json()) == solution.to_dict() and solution.to_dict()["result"]
        assert np.all(solution.ok) and solution._repr_html_()


@pytest.mark.parametrize("compare", [operator.lt, operator.le, operator.gt, operator.ge])
def test_an_order_of_distances_is_refused_with_what_decides(compare):
    for other in (1, 2.0, a_solution()):
        nearest = jhd.project((0, 1), jhd.polyline([(0, 0), (1, 0)]))
        for bounded in (a_solution(), jhd.Bounds(0, 2), nearest):
            with pytest.raises(TypeError, match="is not a number: .* hausdorff_at_most"):
                compare(bounded, other)


def test_bounds_are_a_number_and_no_tuple():
    bounds = jhd.Bounds(0, 1 / 3)
    assert float(bounds) == bounds.value == 1 / 6 and f"{bounds:.2f}" == "[0.00, 0.34]"
    assert repr(bounds) == "Bounds(lower=0.0, upper=0.33333333333333332)" and bounds == jhd.Bounds(0.0, 1 / 3)
    assert bounds.to_dict() == {"lower": 0.0, "upper": 1 / 3} and "<th>value</th>" in bounds._repr_html_()
    calls = [lambda x: 2 * x, lambda x: x + x, tuple, lambda x: x[0], len]
    for call in calls:
        with pytest.raises(TypeError):
            call(cast(Any, bounds))


def test_json_takes_the_options_of_json_dumps():
    assert a_solution().to_json(indent=2).startswith('{\n  "value": 2.0')


def test_nan_and_infinity_become_null_wherever_they_are():
    assert to_plain({"x": jnp.array([[1.0, jnp.inf], [jnp.nan, -jnp.inf]]), "y": np.inf, "z": [np.float64("nan")]}) == {
        "x": [[1.0, None], [None, None]],
        "y": None,
        "z": [None],
    }


# ---- throw ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", RESULTS_OF_OUR_OWN)
def test_an_error_says_the_sentence_and_carries_the_solution(name):
    solution = a_solution(getattr(jhd.RESULTS, name))
    with pytest.raises(jhd.NotProvenError) as caught:
        throw_unless_successful(solution)
    assert caught.value.solution is solution
    wide = name in ("gap_not_closed", "capacity_reached", "nonisolated_maxima")
    more = " Pass atol=1 to accept them." if wide else ""
    assert str(caught.value) == f"{sentence_of(name)} The bounds reached are 1.5 and 2.5.{more}"
    assert isinstance(caught.value, RuntimeError)


def test_one_failure_in_a_batch_is_thrown():
    batch = jax.vmap(lambda wide: a_solution(result_where(wide, jhd.RESULTS.gap_not_closed, jhd.RESULTS.successful)))
    with pytest.raises(jhd.NotProvenError, match="raise max_steps"):
        throw_unless_successful(batch(jnp.array([False, True, False])))
    throw_unless_successful(batch(jnp.array([False, False])))


def test_success_and_tracers_are_not_thrown():
    assert throw_unless_successful(a_solution()) is None
    failed = a_solution(jhd.RESULTS.gap_not_closed)
    with pytest.raises(jhd.NotProvenError):
        throw_unless_successful(failed)
    assert jax.jit(lambda s: throw_unless_successful(s) or s.value)(failed) == failed.value


def test_a_witness_is_shown_in_numbers():
    a, b = jhd.polyline([(0, 0), (1, 0)]), jhd.polyline([(0, 1), (1, 2)])
    shown = repr(jhd.directed_hausdorff(a, b).witness)
    assert "point=[1.0, 0.0]" in shown
    assert "event=a_end" in shown
    assert "direction=a_to_b" in shown
