"""Saved results: what is read back is what was saved, in JSON and in npz."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.deviation_solution import Deviation, DistanceSamples
from jhd._io import results
from jhd._io.errors import ParseError
from jhd._io.results import save_result
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, Bounds, HausdorffSolution, Projection, Witness
from jhd._shapes.simple_curves import circle, polyline

# Of its contents only these tests know the types.
load_result: Any = results.load_result


def witness(batch=()):
    whole, real = jnp.zeros(batch, dtype=int), jnp.full(batch, 0.1)
    return Witness(
        element=whole,
        t=real,
        point=jnp.full((*batch, 2), 1 / 3),
        feet=jnp.ones((*batch, 2, 2)),
        feet_elements=jnp.zeros((*batch, 2), dtype=int),
        feet_params=jnp.ones((*batch, 2)),
        multipliers=jnp.full((*batch, 2), 0.5),
        event=EVENTS.antipodal,
        direction=DIRECTIONS.b_to_a,
    )


def solution():
    return HausdorffSolution(
        value=jnp.array(2 / 3),
        lower=jnp.array(0.6),
        upper=jnp.array(jnp.inf),
        witness=witness(),
        result=RESULTS.gap_not_closed,
        stats={"steps": jnp.array(7)},
    )


def batch():
    good = jnp.array([True, False])
    return Projection(
        distance=jnp.array([0.1, 0.2]),
        lower=jnp.zeros(2),
        upper=jnp.array([0.1, jnp.inf]),
        foot=jnp.ones((2, 2)),
        element=jnp.array([0, 3]),
        t=jnp.array([0.5, 0.25]),
        result=jax.vmap(
            lambda good: RESULTS.where(good, RESULTS.successful, RESULTS.capacity_reached)  # pyright: ignore[reportArgumentType]
        )(good),
    )


def test_json_holds_names_and_null_for_what_is_not_finite(tmp_path):
    file = tmp_path / "result.json"
    save_result(file, solution(), seed=3, command=["python", "x.py"], device="cpu")
    content = load_result(file)
    assert content["type"] == "HausdorffSolution"
    assert content["context"] == {"seed": 3, "command": ["python", "x.py"], "device": "cpu"}
    saved = content["solution"]
    assert (saved["value"], saved["upper"], saved["result"]) == (2 / 3, None, "gap_not_closed")
    assert (saved["witness"]["event"], saved["witness"]["direction"]) == ("antipodal", "b_to_a")
    assert saved["witness"]["point"] == [1 / 3, 1 / 3]
    assert saved["stats"] == {"steps": 7}


def test_npz_holds_arrays_and_keeps_what_is_not_finite(tmp_path):
    file = tmp_path / "result.npz"
    save_result(file, solution(), seed=3)
    content = load_result(file)
    assert (content["type"], content["context"]) == ("HausdorffSolution", {"seed": 3})
    saved = content["solution"]
    assert np.isinf(saved["upper"]) and saved["value"] == 2 / 3
    np.testing.assert_array_equal(saved["witness"]["feet"], np.ones((2, 2)))
    assert (str(saved["result"]), str(saved["witness"]["event"])) == ("gap_not_closed", "antipodal")
    assert saved["stats"]["steps"] == 7


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_batches_are_saved_whole(tmp_path, suffix):
    file = tmp_path / f"batch{suffix}"
    save_result(file, batch())
    saved = load_result(file)["solution"]
    assert list(saved["result"]) == ["successful", "capacity_reached"]
    np.testing.assert_array_equal(saved["element"], [0, 3])


def test_context_may_hold_arrays_tuples_paths_and_numbers_of_numpy(tmp_path):
    context = {
        "array": np.array([1.0, np.nan]),
        "traced": jnp.arange(2),
        "pair": (np.int64(3), np.float64("inf"), np.True_),
        "file": Path("a/b"),
        "nested": {"none": None, "text": "x"},
    }
    expected = {
        "array": [1.0, None],
        "traced": [0, 1],
        "pair": [3, None, True],
        "file": str(Path("a/b")),
        "nested": {"none": None, "text": "x"},
    }
    for name in ("result.json", "result.npz"):
        save_result(tmp_path / name, solution(), **context)
        assert load_result(tmp_path / name)["context"] == expected


def test_fields_without_value_are_null_in_json_and_absent_in_npz(tmp_path):
    curve = polyline([[0, 0], [1, 1]])
    save_result(tmp_path / "curve.json", curve)
    save_result(tmp_path / "curve.npz", curve)
    assert load_result(tmp_path / "curve.json")["solution"]["weights"] is None
    assert "weights" not in load_result(tmp_path / "curve.npz")["solution"]
    save_result(tmp_path / "circle.npz", circle([0, 0], 1))
    assert load_result(tmp_path / "circle.npz")["solution"]["weights"].shape == (4, 3)


def test_what_cannot_be_saved_is_refused_by_name(tmp_path):
    with pytest.raises(TypeError, match="solution must be a result of this package; got float|^Type-check error"):
        save_result(tmp_path / "x.json", 3.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"x\.txt: the suffix is '.txt'; results are stored as .json or .npz"):
        save_result(tmp_path / "x.txt", solution())
    with pytest.raises(TypeError, match=r"steps\['a'\]\[0\] is a set; needs numbers, texts"):
        save_result(tmp_path / "x.json", solution(), steps={"a": [{1}]})
    assert list(tmp_path.iterdir()) == []


def test_files_that_hold_something_else_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"x\.json: no such file"):
        load_result(tmp_path / "x.json")
    with pytest.raises(FileNotFoundError, match=r"x\.npz: no such file"):
        load_result(tmp_path / "x.npz")
    with pytest.raises(ValueError, match="the suffix is '.csv'"):
        load_result(tmp_path / "x.csv")
    (tmp_path / "x.json").write_text('{"type":\n}', encoding="utf-8")
    with pytest.raises(ParseError, match=r"x\.json:2:1: JSON: Expecting value"):
        load_result(tmp_path / "x.json")
    (tmp_path / "x.json").write_text("[]", encoding="utf-8")
    with pytest.raises(ParseError, match=r"x\.json: is not a saved result: it is not a JSON object"):
        load_result(tmp_path / "x.json")
    (tmp_path / "x.json").write_text('{"type": "a", "solution": {}}', encoding="utf-8")
    with pytest.raises(ParseError, match=r"x\.json: is not a saved result: it has no 'context'"):
        load_result(tmp_path / "x.json")
    (tmp_path / "x.json").write_text('{"type": "a", "type": "b", "solution": {}, "context": {}}', encoding="utf-8")
    with pytest.raises(ParseError, match=r"x\.json: JSON: .*'type'"):
        load_result(tmp_path / "x.json")
    (tmp_path / "x.npz").write_bytes(b"junk")
    with pytest.raises(ParseError, match=r"x\.npz: is not an npz file"):
        load_result(tmp_path / "x.npz")
    np.savez(tmp_path / "x.npz", a=np.ones(2))
    with pytest.raises(ParseError, match=r"x\.npz: is not a saved result: it has no 'context'"):
        load_result(tmp_path / "x.npz")


@pytest.mark.parametrize("suffix", [".json", ".npz"])
def test_every_result_of_the_entries_is_kept(suffix, tmp_path):
    both = solution()
    both = HausdorffSolution(
        both.value, both.lower, both.upper, both.witness, both.result, both.stats, False, (both, both)
    )
    save_result(tmp_path / f"a{suffix}", both)
    assert load_result(tmp_path / f"a{suffix}")["solution"].keys() == {
        "value", "lower", "upper", "witness", "result", "stats", "directed"
    }  # fmt: skip
    nothing = DistanceSamples(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    bounds = Bounds(1.0, 2.0), Bounds(3.0, 4.0), Bounds(5.0, 6.0)
    line = polyline([[0, 0], [1, 1]])
    found = Deviation(line, line, both, *bounds, nothing, RESULTS.successful, {"parts": 3})
    save_result(tmp_path / f"b{suffix}", found)
    mean = load_result(tmp_path / f"b{suffix}")["solution"]["mean"]
    assert [float(x) for x in mean.values()] == [1.0, 2.0]
