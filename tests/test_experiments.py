"""Experiments and figures: each has its namesake, says what it is for, runs small, and what it claims holds."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
# Modules that experiments or figures share.
SHARED = "common"
# What TwoStep and the proven projections promise, in units of the coordinates (some hundred, and some).
ERROR = 1e-10


def scripts(folder):
    return sorted(p for p in (ROOT / folder).glob("*.py") if not p.stem.startswith(SHARED))


EXPERIMENTS, FIGURES = scripts("experiments"), scripts("paper_figs")


def names(paths):
    return [path.stem for path in paths]


def run(script, folder):
    command = [sys.executable, str(script.relative_to(ROOT)), "--smoke", "--out", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_there_are_experiments():
    assert len(EXPERIMENTS) >= 3


def test_every_experiment_has_its_figure_and_every_figure_its_experiment():
    assert names(EXPERIMENTS) == names(FIGURES)


@pytest.mark.parametrize("script", EXPERIMENTS, ids=names(EXPERIMENTS))
def test_an_experiment_states_question_claim_what_it_feeds_and_the_minutes(script):
    text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    assert text.split("\n")[0].endswith("?")
    assert re.search(r"Claims?:", text)
    assert re.search(r"^Feeds: ", text, re.MULTILINE)
    assert re.search(r"^Takes: .*(minute|second)", text, re.MULTILINE)


@pytest.mark.parametrize("script", FIGURES, ids=names(FIGURES))
def test_a_figure_says_what_it_shows(script):
    assert ast.get_docstring(ast.parse(script.read_text(encoding="utf-8")))


@pytest.mark.parametrize("script", [*EXPERIMENTS, *FIGURES], ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_script_computes_nothing_when_it_is_imported(script):
    body = ast.parse(script.read_text(encoding="utf-8")).body
    assert isinstance(body[-1], ast.If) and ast.unparse(body[-1].test) == "__name__ == '__main__'"


def check_origin(numbers, name):
    context = numbers["context"]
    assert context["experiment"] == name and context["smoke"] is True
    assert context["command"].startswith(f"python experiments/{name}.py --smoke")
    assert isinstance(context["seed"], int) and context["device"]
    assert {"python", "jhd", "jax", "numpy", "scipy"} <= context["versions"].keys()


def check_directed(numbers):
    for entry in numbers["directions"].values():
        found = entry["solution"]
        assert entry["error"] < ERROR
        assert 0 < found["value"] - ERROR <= found["lower"] <= found["value"]
        assert found["upper"] is None and found["result"] == "successful"
    # Candidates lie on the curve, so none is farther than the farthest point; the best of them is that one.
    best = max(c["solution"]["value"] for c in numbers["candidates"])
    chosen = numbers["directions"]["a_to_b"]
    assert abs(best - chosen["reference"]) < ERROR
    # The maximum may be flat: its place is known to the root of its error.
    assert min(abs(c["t"] - chosen["t"]) for c in numbers["candidates"]) < ERROR**0.5
    for candidate in numbers["candidates"]:
        assert candidate["solution"]["value"] >= candidate["distance"] - ERROR
    shown = numbers["stationary"]
    nearest = numbers["samples"]["distance"][shown["sample"]]
    assert abs(min(shown["distance"]) - nearest) < ERROR


def check_cao14_open_closed(numbers):
    check_directed(numbers)
    assert len(numbers["samples"]["t"]) == 11
    assert {c["solution"]["witness"]["event"] for c in numbers["candidates"]} == {"antipodal", "one_to_two"}


def check_cao14_closed_closed(numbers):
    check_directed(numbers)
    ours = [s for s in numbers["speeds"] if s["name"] == "TwoStep"]
    samples = [s for s in numbers["speeds"] if s["name"] != "TwoStep"]
    assert ours and samples
    assert all(max(s["errors"]) < ERROR for s in ours)
    assert all(min(s["errors"]) > ERROR for s in samples)
    assert all(s["seconds"] > 0 and s["ratio"] > 0 for s in numbers["speeds"])


def check_point_bezier(numbers):
    for name, entries in numbers["random"]["methods"].items():
        proven = name in ("ProjectedPolyhedron", "NearestSearch")
        for entry in entries:
            assert entry["lower_above"] < ERROR
            assert entry["wrong"] == 0 if proven else 0.01 < entry["wrong"] < 0.3
            assert not proven or entry["largest_error"] < ERROR
    for name in ("ProjectedPolyhedron", "NearestSearch"):
        assert np.max(np.abs(numbers["path"]["errors"][name])) < ERROR
    ours, *samples = numbers["speed"]["entries"]
    assert ours["error"] < ERROR and all(s["error"] > ERROR for s in samples)


def check_ranges(numbers):
    for ways in numbers["surfaces"].values():
        least = ways["bernstein"]["levels"][-1]
        assert all(way["proven"] <= least <= way["levels"][-1] for way in ways.values())
        assert all(way["rate"] > 0 and way["seconds"] > 0 for way in ways.values())


def holds(found, exact):
    return found["lower"] <= exact and (found["upper"] is None or exact <= found["upper"])


def check_spurious_cells(numbers):
    *counterexamples, empty = numbers["pairs"]
    for pair in counterexamples:
        assert not any(holds(found, pair["exact"]) for found in pair["paper"])
        assert all(holds(found, pair["exact"]) for found in pair["safe"])
    assert {found["result"] for found in empty["paper"]} == {"unproven"}
    assert {found["result"] for found in empty["safe"]} == {"unverified"}


def check_algsurf_table(numbers):
    assert all(holds(found, numbers["exact"]) for found in numbers["rules"])
    for found in numbers["rules"]:
        assert found["separable"] < numbers["paper"]["seconds"] / 1000


def check_surface_gallery(numbers):
    for pair in numbers["pairs"]:
        found = pair["solution"]
        assert 0 < found["lower"] <= found["value"] <= found["upper"] <= found["lower"] + 0.1
        assert pair["cubes"]["lower"] <= found["upper"] and found["lower"] <= pair["cubes"]["upper"]


def check_fit_quadric(numbers):
    assert all(end["lower"] <= end["value"] <= end["upper"] for end in numbers["ends"])
    assert np.all(np.diff(numbers["path"]) <= 0)


def check_lin03_field(numbers):
    for mesh in numbers["meshes"]:
        assert mesh["closed"] and 0 < mesh["sampled"] <= mesh["proven"]
        assert all(0 < way["lower"] <= way["upper"] < 4 * mesh["atol"] for way in mesh["hausdorff"].values())


def check_local_search_error(numbers):
    for mesh in numbers["meshes"]:
        assert [way["published"] for way in mesh["ways"]].count(True) == 1
        for way in mesh["ways"]:
            # Never below the exact distance, up to rounding; and often above.
            assert way["smallest"] > -1e-12 and way["largest"] > 1e-3
            assert 0.01 < way["wrong"] < 0.6 and way["wrong_signs"] < 0.01


def check_mesh_hausdorff_figure(numbers):
    for name, entry in numbers["directions"].items():
        found, rounds = entry["solution"], entry["rounds"]
        assert np.max(numbers[name[0]]["distance"]) <= found["upper"]
        assert 0 <= found["upper"] - found["lower"] <= 1e-8 * found["value"]
        assert np.all(np.diff([row["lower"] for row in rounds]) >= 0)
        assert np.all(np.diff([row["upper"] for row in rounds]) <= 0)


def check_mesh_peers(numbers):
    assert numbers["queries"][0]["name"] == "jhd"
    assert all(min(peer["rates"]) > 0 and peer["error"] < 1e-4 for peer in numbers["queries"])
    ours, *others = numbers["hausdorff"]
    assert ours["lower"] <= ours["value"] <= ours["upper"] <= ours["lower"] + 1e-8
    for way in others:
        # Points of the meshes against the other mesh are never too far.
        assert way["value"] <= ours["upper"] if way["name"] == "samples to meshes" else way["seconds"] > 0


CHECKS = {name.removeprefix("check_"): f for name, f in list(globals().items()) if name.startswith("check_")}


@pytest.mark.slow
@pytest.mark.parametrize("script", EXPERIMENTS, ids=names(EXPERIMENTS))
def test_an_experiment_runs_small_and_its_claims_hold(script, tmp_path):
    name = script.stem
    printed = run(script, tmp_path)
    assert (tmp_path / f"{name}.md").read_text(encoding="utf-8").strip() == printed.strip()
    numbers = json.loads((tmp_path / f"{name}.json").read_text(encoding="utf-8"))
    check_origin(numbers, name)
    CHECKS.get(name, lambda _: None)(numbers)


@pytest.mark.slow
@pytest.mark.parametrize("script", FIGURES, ids=names(FIGURES))
def test_a_figure_runs_its_experiment_and_draws(script, tmp_path):
    run(script, tmp_path)
    assert (tmp_path / f"{script.stem}.json").exists()
    assert (tmp_path / f"{script.stem}.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / f"{script.stem}.pdf").read_bytes()[:4] == b"%PDF"
    if script.stem == "point_bezier":
        assert (tmp_path / "point_bezier.gif").read_bytes()[:6] == b"GIF89a"
