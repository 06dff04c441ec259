"""The command line: each command in this process, and two runs as a user makes them."""

import json
import os
import re
import sys
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.image import imread

import jhd
import jhd.io
from jhd import __main__ as command_line
from jhd._cli import commands, comparisons
from jhd._cli.report import progress_text
from jhd._cli.warming import KINDS, Preparation, preparations
from jhd._distance import pairs
from jhd._fields.adaptive_build import MODES
from jhd._fields.adaptive_samples import SIGNS
from jhd._runtime import storage
from jhd.io import load_result
from jhd.progress import Progress
from tests.processes import python
from tests.sweeps import CPU_ONLY

# The base and the diagonal of a rectangle 4 by 3: the upper corner is 3 away from the base, the lower right corner
# 2.4 from the diagonal.
BASE, DIAGONAL = "M0 0 L4 0", "M0 0 L4 3"
SPACE = '{"type": "BezierSegments", "control_points": [[[0, 0, 0], [1, 1, 1]]]}'
ROUNDING = 1e-12


def unsuccessful(entry):
    """The entry, its result replaced by one that is not successful."""

    def call(*arguments, **options):
        return eqx.tree_at(lambda s: s.result, entry(*arguments, **options), jhd.RESULTS.gap_not_closed)

    return call


def subprocess_run(*arguments, cwd):
    environment = {**os.environ, "PYTHONPATH": str(Path(jhd.__file__).parents[1])}
    return python("-m", "jhd", *arguments, cwd=cwd, env=environment)


def test_the_distance_is_printed_with_bounds_event_and_witness(run):
    status, out, err = run("hausdorff", BASE, DIAGONAL)
    assert (status, err) == (0, "")
    lines = {line.split()[0]: line.split(maxsplit=1)[1] for line in out.splitlines() if line.strip()}
    assert float(lines["value"]) == pytest.approx(3.0, abs=ROUNDING)
    assert float(lines["lower"]) <= 3.0
    assert lines["upper"] == "not certified by this method" or float(lines["upper"]) >= 3.0
    assert lines["event"] == "a_end"
    assert lines["witness"] == "B segment 0, t = 1, at (4, 3)"
    assert lines["foot"].startswith("A segment 0, t = 1, at (4, 0)")
    assert "float64" in lines["device"]


def test_the_directed_distance_goes_from_a_to_b(run):
    status, out, _ = run("hausdorff", BASE, DIAGONAL, "--directed", "--json")
    content = json.loads(out)
    assert status == 0
    assert content["solution"]["value"] == pytest.approx(2.4, abs=ROUNDING)
    assert content["solution"]["witness"]["point"] == [4.0, 0.0]


def test_json_on_standard_output_is_a_saved_result(run):
    _, out, err = run("hausdorff", BASE, DIAGONAL, "--json")
    assert err == ""
    Path("result.json").write_text(out)
    content: Any = load_result("result.json")
    assert content["type"] == "HausdorffSolution"
    assert content["solution"]["witness"]["direction"] == "b_to_a"
    assert (content["context"]["a"], content["context"]["precision"]) == (BASE, "float64")


@pytest.mark.slow
def test_a_method_is_chosen_by_name_in_any_spelling(run):
    for name in ("TwoStep", "two-step", "two_step"):
        status, out, _ = run("hausdorff", BASE, DIAGONAL, "--method", name, "--json")
        assert (status, json.loads(out)["context"]["method"]) == (0, "TwoStep")


@pytest.mark.parametrize(("name", "starts"), [("picture.png", b"\x89PNG"), ("picture.pdf", b"%PDF")])
def test_a_picture_is_written_on_request(run, name, starts):
    status, out, _ = run("hausdorff", BASE, DIAGONAL, "--plot", name)
    assert status == 0
    assert Path(name).read_bytes().startswith(starts)
    assert str(Path(name).resolve()) in out


def test_a_picture_of_two_directions_that_are_known_searches_no_more(run, monkeypatch):
    searched = []
    monkeypatch.setattr(jhd, "directed_hausdorff", lambda *pair, **options: searched.append(pair))
    status, out, _ = run("hausdorff", BASE, DIAGONAL, "--plot", "a.png", "--html", "a.html")
    assert (status, searched) == (0, [])
    assert Path("a.html").read_text().startswith("<!doctype html>") and str(Path("a.html").resolve()) in out
    bounds = [
        [float(x) for x in line.split()[3::2]] for line in out.splitlines() if line.startswith(("A to B", "B to"))
    ]
    for (lower, upper), exact in zip(bounds, (2.4, 3.0), strict=True):
        assert lower <= exact * (1 + 1e-15) and exact * (1 - 1e-15) <= upper


@pytest.mark.parametrize(("pair", "known"), [((BASE, DIAGONAL), 2), (("M0 0 L4 0 L4 9", "M0 0 Q2 1 4 0"), 1)])
def test_a_picture_searches_each_direction_once_also_where_one_is_left_wide(run, monkeypatch, pair, known):
    searched, drawn = [], []
    drive, picture = pairs.drive, comparisons.picture
    monkeypatch.setattr(pairs, "drive", lambda *search: searched.append(search) or drive(*search))
    monkeypatch.setattr(comparisons, "picture", lambda *content: drawn.append(content[3]) or picture(*content))
    status, _, _ = run("hausdorff", *pair, "--plot", "a.png")
    assert (status, len(searched)) == (0, 2)
    assert [solution is not None for solution in drawn[0]] == [True] * known + [False] * (2 - known)


@pytest.mark.exhaustive  # one more program for three coordinates
def test_curves_in_space_have_a_picture_too(run):
    Path("a.json").write_text(SPACE)
    status, _, _ = run("hausdorff", "a.json", "a.json", "--directed", "--json", "--plot", "space.png")
    assert status == 0
    assert Path("space.png").exists()


def test_bounds_that_are_not_closed_are_printed_with_status_one(run, monkeypatch):
    monkeypatch.setattr(jhd, "hausdorff", unsuccessful(jhd.hausdorff))
    status, out, err = run("hausdorff", BASE, DIAGONAL)
    assert (status, err) == (1, "")
    assert "  lower    " in out
    assert "  result   gap_not_closed: The bounds are true" in out
    status, out, _ = run("hausdorff", BASE, DIAGONAL, "--json")
    assert (status, json.loads(out)["solution"]["result"]) == (1, "gap_not_closed")


def test_an_interrupted_search_prints_the_bounds_reached(run, monkeypatch):
    @contextmanager
    def interrupting(_):
        def interrupt(_):
            raise KeyboardInterrupt

        yield interrupt

    monkeypatch.setattr("jhd._cli.comparisons.busy", interrupting)
    # Zero is below what rounding leaves, so the search would go on.
    status, out, err = run("hausdorff", BASE, DIAGONAL, "--atol", "0", "--plot", "no.png", "--certificate", "no.json")
    assert (status, err) == (130, "") and not Path("no.png").exists() and not Path("no.json").exists()
    assert "the bounds reached" in out
    assert "interrupted: The search was interrupted" in out
    assert "upper    inf" not in out
    status, out, err = run("hausdorff", BASE, DIAGONAL, "--atol", "0", "--json")
    found = json.loads(out)["solution"]
    assert (status, err, found["result"]) == (130, "", "interrupted") and found["lower"] <= 3 <= found["upper"]
    status, out, _ = run("hausdorff", BASE, DIAGONAL, "--atol", "0", "--threshold", "3", "--json")
    assert (status, json.loads(out)["solution"]["result"]) == (130, "interrupted")


# Two spheres, the second polynomial beginning with a minus; the farthest point is 0.75 away.
SPHERES = "x**2 + y^2 + z**2 - 1", "-x^2 - (y - 1/4)^2 - z^2 + 2.25", "--box", "-2", "2"


def test_surfaces_are_polynomials_with_a_box(run, monkeypatch):
    options = (*SPHERES, "--method", "CubeIntervals")
    status, out, err = run("hausdorff", *options, "--json", "--plot", "spheres.png")
    content = json.loads(out)
    assert (status, err) == (0, "")
    assert content["solution"]["lower"] <= 0.75 <= content["solution"]["upper"]
    assert content["context"]["b"] == SPHERES[1]
    assert content["context"]["box"] == [[-2.0] * 3, [2.0] * 3]
    assert Path("spheres.png").exists()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    status, out, err = run("hausdorff", *options[:3], "-2", "-2", "-2", "2", "2", "2", *options[5:])
    assert status == 0
    assert "B  -x^2 - (y - 1/4)^2 - z^2 + 2.25: surface of degree 2 in [-2, 2] x [-2, 2] x [-2, 2]" in out
    assert "  witness  B at (" in out and "nan" not in out
    assert f"levels [{24 * '#'}] 6/6, tested " in err
    assert err.endswith("\r\x1b[K")


@pytest.mark.exhaustive  # compiles the search
def test_the_default_method_closes_the_bounds_of_surfaces(run):
    status, out, err = run("hausdorff", *SPHERES, "--atol", "1e-3", "--json")
    content = json.loads(out)
    assert (status, err) == (0, "")
    assert content["solution"]["upper"] - 1e-3 <= content["solution"]["lower"] <= 0.75 <= content["solution"]["upper"]


def test_progress_is_shown_on_a_terminal_and_wiped(run, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    status, _, err = run("hausdorff", BASE, DIAGONAL)
    assert status == 0
    assert "a_to_b: [" in err and "/10 digits, " in err
    assert "b_to_a: [" in err
    assert err.endswith("\r\x1b[K")


def test_progress_of_every_kind_is_one_line_that_says_how_much_is_done():
    search = Progress("a_to_b", 3, 8, 0.9991, 1.0)
    text = f"a_to_b: [{7 * '#'}{17 * '.'}] 3/10 digits, 0.999099999 to 1, step 3, 5 open cells"
    assert progress_text(search) == text
    for lower, upper, digits in ((0, np.inf, 0), (0, 0, 10), (1, 1, 10), (1, 1 + 1e-14, 10)):
        assert f" {digits}/10 digits" in progress_text(search._replace(lower=lower, upper=upper))
    fit = Progress("start 1", 15, 60, details={"value": 0.5, "optimality": 0.25})
    assert progress_text(fit) == f"start 1 [{6 * '#'}{18 * '.'}] 15/60, value 0.5, optimality 0.25"
    assert progress_text(Progress("a_to_b", 0, 0)).startswith("a_to_b [....")
    assert progress_text(Progress("bounds", 6, 12)) == f"bounds [{12 * '#'}{12 * '.'}] 6/12"
    assert progress_text(Progress("cells.a_to_b[0] of 2", 0)) == "cells.a_to_b[0] of 2"


def test_an_interrupt_ends_with_one_line(run, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(jhd, "hausdorff", interrupted)
    assert run("hausdorff", BASE, DIAGONAL) == (130, "", "jhd: interrupted\n")


def test_points_are_projected(run):
    status, out, err = run("project", BASE, "1", "-2.5e0")
    assert (status, err) == (0, "")
    header, row = (line.split("\t") for line in out.splitlines())
    assert header == ["distance", "lower", "upper", "segment", "t", "foot x", "foot y", "result"]
    assert row.pop() == "successful"
    np.testing.assert_allclose([float(x) for x in row], [2.5, 2.5, 2.5, 0, 0.25, 1, 0], atol=1e-9)


def test_results_are_written_to_files(run):
    for command in (("hausdorff", DIAGONAL), ("minimum", DIAGONAL), ("hausdorff", DIAGONAL, "--threshold", 3.5)):
        tolerances = "--rtol", "1e-3", "--atol", "0.1%"
        status, out, _ = run(command[0], BASE, *command[1:], *tolerances, "-o", "result.json")
        stored: Any = load_result("result.json")["context"]
        assert status == 0 and out.endswith(f"result     {Path('result.json').resolve()}\n")
        assert (stored["a"], stored["rtol"], stored["atol"]) == (BASE, 1e-3, 0.005)
    assert run("project", BASE, "1", "-2", "-o", "foot.csv")[:2] == (0, f"result     {Path('foot.csv').resolve()}\n")
    head, row = (line.split(",") for line in Path("foot.csv").read_text().splitlines())
    assert head == ["distance", "lower", "upper", "segment", "t", "foot x", "foot y", "result"]
    assert float(row[1]) <= 2 <= float(row[2]) and row[-1] == "successful"
    printed = run("project", BASE, "1", "-2", "-o", "foot.json", "--json")[1]
    assert Path("foot.json").read_text() == printed


def test_a_relative_tolerance_ends_the_search_of_a_distance(run):
    def found(command, text, tolerance):
        stored = json.loads(run(command, "M0 0 Q2 1 4 0", "M0 5 C1 4 3 6 4 5", "--rtol", text, "--json")[1])
        assert stored["context"]["rtol"] == tolerance
        return stored["solution"]["upper"], stored["solution"]["upper"] - stored["solution"]["lower"]

    for command in ("hausdorff", "minimum"):
        (upper, wide), (_, narrow) = found(command, "10%", 0.1), found(command, "1e-9", 1e-9)
        assert narrow < wide <= 0.1 * upper


def test_points_come_from_a_file_or_standard_input(run, monkeypatch):
    rows = "# x y\n1 2\n\n3, -1  # below\n"
    Path("points.dat").write_text(rows)
    _, from_file, _ = run("project", BASE, "--points", "points.dat", "--json")
    Path("points.csv").write_text("y;x;id\n2;1;a\n-1;3;b\n")
    assert run("project", BASE, "--points", "points.csv", "--json")[1] == from_file
    Path("points.txt").write_text("x;y\n1;2\n3;-1\n")
    assert run("project", BASE, "--points", "points.txt", "--json")[1] == from_file
    with open("points.dat") as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        _, from_input, _ = run("project", BASE, "--json")
    content = json.loads(from_file)
    assert content == json.loads(from_input)
    assert content["context"]["points"] == [[1.0, 2.0], [3.0, -1.0]]
    np.testing.assert_allclose(content["solution"]["foot"], [[1.0, 0.0], [3.0, 0.0]], atol=1e-9)
    Path("points.dat").write_bytes(b"1 2 \xff\n")
    with open("points.dat", encoding="utf-8") as stream:
        monkeypatch.setattr(sys, "stdin", stream)
        status, _, err = run("project", BASE)
    assert status == 2 and "standard input: byte 4 is not UTF-8 text" in err


def test_points_that_are_finished_in_time_are_printed(run, monkeypatch):
    Path("points.txt").write_text("1 2\n3 -1\n2 5\n")
    monkeypatch.setattr(comparisons, "_MANY_POINTS", 1)
    status, out, _ = run("project", BASE, "--points", "points.txt", "--max-seconds", "1e-9", "--json")
    assert status == 1 and json.loads(out)["context"]["points"] == [[1.0, 2.0]]


def test_many_points_are_projected_some_at_a_time_and_an_interrupt_keeps_what_is_done(run, monkeypatch):
    Path("points.txt").write_text("1 2\n3 -1\n2 5\n")
    asked = "project", BASE, "--points", "points.txt"
    whole = run(*asked)
    monkeypatch.setattr(comparisons, "_MANY_POINTS", 1)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    status, out, err = run(*asked)
    assert (status, out) == whole[:2] and f"points [{24 * '#'}] 3/3" in err and err.endswith("\r\x1b[K")
    project, calls = jhd.project, iter(range(3))

    def interrupted(*arguments, **options):
        if next(calls) == 2:
            raise KeyboardInterrupt
        return project(*arguments, **options)

    monkeypatch.setattr(jhd, "project", interrupted)
    status, out, _ = run(*asked)
    assert (status, out.splitlines()) == (130, whole[1].splitlines()[:3])


def test_the_doctor_names_versions_devices_and_precision_and_checks_itself(run):
    status, out, err = run("doctor")
    assert (status, err) == (0, "")
    named = [line.split("  ")[0] for line in out.splitlines()]
    assert named[:2] == ["jhd", "python"]
    assert {
        "jax",
        "jaxlib",
        "equinox",
        "optimistix",
        "numpy",
        "matplotlib",
        "devices",
        "functions",
        "JAX's cache",
    } <= set(named)
    assert any(line.startswith("self-check ") and " passed: " in line for line in out.splitlines())
    status, out, _ = run("doctor", "--json")
    assert (status, json.loads(out)["passed"]) == (0, True)


@CPU_ONLY
def test_the_doctor_says_what_is_kept_and_why_a_folder_is_not_used(run, monkeypatch, tmp_path):
    def said():
        return next(line for line in run("doctor")[1].splitlines() if line.startswith("functions  ")).split(maxsplit=1)[
            1
        ]

    # Else the self-check would compile its program again for the folder.
    solution = jhd.hausdorff(jhd.io.parse_path(BASE), jhd.io.parse_path(DIAGONAL))
    monkeypatch.setattr(jhd, "hausdorff", lambda a, b, throw: solution)
    assert said() == "not kept: JHD_CACHE is 0, or there is no home folder"
    monkeypatch.setenv("JHD_CACHE", str(tmp_path))
    monkeypatch.setattr("jhd._cli.console.switch_cache_on", lambda: None)
    folder = tmp_path / "programs"
    storage.write(folder, "one", bytes(10**6))
    assert said().startswith(f"{folder} (1.0 MB in 1 files, at most ")
    if os.name == "posix":
        folder.chmod(0o777)
        assert said() == f"{folder} (not used: others can write to it)"


@CPU_ONLY
def test_warm_keeps_the_programs_of_the_kinds_that_are_named(run, monkeypatch, tmp_path):
    monkeypatch.setenv("JHD_CACHE", str(tmp_path / "kept"))
    monkeypatch.setattr("jhd._cli.console.switch_cache_on", lambda: None)
    calls = []
    prepared = [Preparation(f"{kind}: one", partial(calls.append, kind)) for kind in ("plane", "meshes")]
    monkeypatch.setattr(commands, "preparations", lambda kinds, degree: calls.append((kinds, degree)) or prepared)
    status, out, err = run("precompile", "plane", "meshes", "--degree", "4")
    assert (status, err) == (0, "")
    assert calls == [(["plane", "meshes"], 4), "plane", "meshes"]
    assert [line.split(": one")[0] for line in out.splitlines()[:2]] == ["plane", "meshes"]
    assert f"functions  {tmp_path / 'kept' / 'programs'} (0.0 MB in 0 files" in out
    status, out, _ = run("precompile", "--json")
    assert json.loads(out)["kinds"] == list(KINDS) and json.loads(out)["degree"] is None
    assert calls[3] == (list(KINDS), None)
    assert [row["name"] for row in json.loads(out)["prepared"]] == ["plane: one", "meshes: one"]


@CPU_ONLY
def test_warm_shows_a_bar(run, monkeypatch, tmp_path):
    monkeypatch.setenv("JHD_CACHE", str(tmp_path))
    monkeypatch.setattr("jhd._cli.console.switch_cache_on", lambda: None)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(commands, "preparations", lambda kinds, degree: [Preparation(x, int) for x in ("one", "two")])
    err = run("precompile", "plane")[2]
    assert f"one [{'.' * 24}] 0/2" in err
    assert f"two [{'#' * 12}{'.' * 12}] 1/2" in err


@CPU_ONLY
def test_warm_says_where_nothing_can_be_kept(run, monkeypatch, tmp_path):
    assert run("precompile")[2] == (
        "jhd: error: JHD_CACHE is 0, or there is no home folder; set JHD_CACHE=FOLDER to keep compiled functions.\n"
    )
    monkeypatch.setenv("JHD_CACHE", str(tmp_path))
    monkeypatch.setattr("jhd._cli.console.switch_cache_on", lambda: None)
    (tmp_path / "programs").write_text("")
    status, _, err = run("precompile")
    assert status == 2 and err.endswith("compiled functions are not kept there: it is no folder.\n")
    (tmp_path / "programs").unlink()
    assert "unknown kind 'cubes'; there are plane, space" in run("precompile", "cubes")[2]
    assert "--degree is 0; needs at least 1." in run("precompile", "--degree", "0")[2]


@pytest.mark.slow
def test_each_kind_to_prepare_has_its_calls():
    named = [x.name for x in preparations(list(KINDS))]
    assert len(set(named)) == len(named) == 4 * len(KINDS) + 3
    # Of meshes they are quick: what they return is what the entries do.
    for prepared in preparations(["meshes"]):
        prepared.run()


def test_the_doctor_fails_where_the_known_distance_comes_out_wrong(run, monkeypatch):
    right, wrong = jhd.hausdorff, jnp.array(2.0)
    monkeypatch.setattr(jhd, "hausdorff", lambda a, b, throw: eqx.tree_at(lambda s: s.value, right(a, b), wrong))
    status, out, _ = run("doctor")
    assert status == 5
    assert "FAILED" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["measure"], "invalid choice: 'measure'"),
        (["hausdorff", BASE], "the following arguments are required: B"),
        (
            ["hausdorff", BASE, DIAGONAL, "--atol", "small"],
            "argument --atol: needs a length of at least 0 in input units, or a percentage such as 0.1%; got 'small'",
        ),
        (["hausdorff", BASE, "missing.svg"], "missing.svg: no such file"),
        (["hausdorff", BASE, "broken.svg"], "broken.svg:"),
        (["hausdorff", BASE, "notes.txt"], "notes.txt:2: needs numbers; found 'three four'"),
        (["hausdorff", BASE, "notes.dat"], "notes.dat: the suffix is '.dat'"),
        (["hausdorff", BASE, "font:No Such Font:a"], "No Such Font"),
        (["hausdorff", BASE, "space.json"], "needs the same"),
        (["hausdorff", BASE, DIAGONAL, "--method", "Guess"], "unknown method 'Guess'; there are "),
        (["hausdorff", BASE, DIAGONAL, "--plot", "no/folder/a.png"], "no/folder/a.png: no such folder"),
        (
            ["hausdorff", BASE, DIAGONAL, "--method", "TwoStep", "--atol", "1"],
            "--atol: TwoStep takes no tolerance; leave it out.",
        ),
        (
            ["hausdorff", BASE, DIAGONAL, "--method", "TwoStep", "--rtol", "0.1", "--atol", "1%"],
            "--rtol and --atol: ",
        ),
        (
            ["hausdorff", BASE, DIAGONAL, "--rtol", "-1"],
            "argument --rtol: needs a number of at least 0, or a percentage",
        ),
        (["minimum", BASE, DIAGONAL, "--out", "a.csv"], "a.csv: the name must end in .json."),
        (["hausdorff", BASE, DIAGONAL, "-o", "none/a.json"], "none/a.json: no such folder."),
        (["project", BASE, "1", "2", "-o", "a.txt"], "a.txt: the name must end in .csv or .json."),
        (["hausdorff", BASE, DIAGONAL, "--plot", "a.xyz"], "a.xyz: the suffix is '.xyz'; pictures are stored as "),
        (["hausdorff", BASE, DIAGONAL, "--html", "a.png"], "a.png: the name must end in .html or .htm."),
        (["hausdorff", *SPHERES[:2]], "A is a polynomial; give the box of its surface: --box LOWER UPPER."),
        (["hausdorff", *SPHERES, "3"], "--box has 3 numbers; needs 2, or 6"),
        (["hausdorff", *SPHERES[:3], "2", "-2"], "A: lower[0] is 2 and upper[0] is -2; needs lower < upper."),
        (["hausdorff", SPHERES[0], "x**2 + sin(y)", "--box", "-2", "2"], "B: column 8: found 'sin'"),
        (["hausdorff", *SPHERES[:3], "-2e400", "2"], "not finite"),
        (["hausdorff", *SPHERES, "--method", "TwoStep"], "got TwoStep"),
        (["hausdorff", *SPHERES[2:], *SPHERES[:2], "--method", "TwoStep"], "got TwoStep"),
        (["hausdorff", "--box", *SPHERES[:2]], "--box: needs numbers, as in --box -2 2; got 'x**2 + y^2 + z**2 - 1'"),
        (
            ["hausdorff", BASE, DIAGONAL, "--frob", "3"],
            "jhd hausdorff does not know: --frob 3 (see jhd hausdorff --help)",
        ),
        (["hausdorff", BASE, DIAGONAL, "--treshold", "3"], "--treshold 3; nearest is --threshold (see"),
        (["-o", "a.png", "hausdorff", BASE, DIAGONAL], "--out in front of hausdorff is for the demonstration"),
        (["-o", "a.xyz"], "a.xyz: the suffix is '.xyz'; pictures are stored as "),
        (["--frob"], "jhd does not know: --frob (see jhd --help)"),
        (["minimum", BASE, DIAGONAL, "--plot", "a.xyz"], "a.xyz: the suffix is '.xyz'; pictures are stored as "),
        (["minimum", BASE, DIAGONAL, "--plot", "a.png", "--threshold", "1"], "--plot: with --threshold the nearest"),
        (["project", BASE, "1"], "a point has 1 coordinates; the curve has 2"),
        (["project", BASE, "1", "2", "3"], "a point has 3 coordinates; the curve has 2"),
        (["project", BASE, "1", "nan"], "not finite"),
        (["project", BASE, "1", "two"], "invalid float value: 'two'"),
        (["project", BASE, "1", "2", "--points", "notes.txt"], "not both"),
        (["project", BASE, "--points", "notes.txt"], "notes.txt:2: needs numbers; found"),
        (["project", BASE, "--points", "ragged.txt"], "ragged.txt:2: 3 cells; the lines before have 2"),
        (["project", BASE, "--points", "empty.txt"], "empty.txt: points has 0 points"),
        (["project", BASE, "1", "2", "--method", "Guess"], "unknown method 'Guess'; there are "),
    ],
)
def test_bad_input_is_one_line_on_standard_error_with_status_two(run, arguments, message):
    Path("broken.svg").write_text("<svg><path d='M 0 0 L 1'")
    Path("notes.txt").write_text("1 2\nthree four\n")
    Path("notes.dat").write_text("1 2\n")
    Path("ragged.txt").write_text("1 2\n1 2 3\n")
    Path("empty.txt").write_text("# nothing\n")
    Path("space.json").write_text(SPACE)
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert err.startswith("jhd: error: ")
    assert err.count("\n") == 1
    assert message in err


def test_the_version_is_printed(run):
    assert run("--version") == (0, f"jhd {jhd.__version__}\n", "")


def test_help_names_what_there_is():
    assert (command_line._KINDS, command_line._MODES, command_line._SIGNS) == (tuple(KINDS), MODES, SIGNS)


@pytest.mark.slow  # a process that compiles the search
def test_the_demonstration_prints_both_distances_and_writes_its_picture(tmp_path):
    done = subprocess_run("-o", tmp_path / "demo.png", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    there, back = done.stdout.index("directed distance from A to B"), done.stdout.index("directed distance from B to A")
    assert there < back < done.stdout.index("Hausdorff distance, the larger of the two")
    assert done.stdout.count("  lower    ") == done.stdout.count("  upper    ") == 2
    assert str(tmp_path / "demo.png") in done.stdout
    height, width, _ = imread(tmp_path / "demo.png").shape
    assert min(height, width) > 700


@pytest.mark.exhaustive
def test_a_fit_is_written_with_its_proven_distance(run, tmp_path):
    outline = "M0 0 C 1 2 3 2 4 0 L 4 -1 L 0 -1 Z"
    status, out, err = run("fit", outline, "--tolerance", "0.01", "--degree", "2", "--out", "fit.svg", "--json")
    assert (status, err) == (0, "")
    answer = json.loads(out)
    assert answer["context"]["within"]
    assert answer["solution"]["upper"] <= 0.01
    curve = jhd.io.load_svg(tmp_path / "fit.svg")
    assert curve.count == sum(answer["context"]["segments"])
    assert float(jhd.hausdorff(jhd.io.parse_path(outline), curve).upper) <= 0.0101


def test_a_fit_hears_its_limits_and_names_its_results(run, monkeypatch):
    seen = {}

    def fitted(target, tolerance, **options):
        seen.update(options, tolerance=tolerance)
        curve = jhd.polyline([(0, 0), (4, 0)])
        return [SimpleNamespace(shape=curve, result=jhd.RESULTS.out_of_time)]

    monkeypatch.setattr(jhd, "fit_outline", fitted)
    asked = "--tolerance", "25%", "--max-seconds", "1.5", "--smooth", "-o", "fit.json", "--json"
    status, out, _ = run("fit", BASE, *asked)
    del seen["progress"]
    known = {"tolerance": 1.0, "degree": 3, "smooth": True, "max_seconds": 1.5}
    context = json.loads(out)["context"]
    assert status == 0 and seen == known == {name: context[name] for name in known}
    assert context["within"] and context["results"] == ["out_of_time"]
    assert jhd.io.load_curve("fit.json").segments().count == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--tolerance", "0"), "tolerance is 0.0; needs one positive number."),
        (
            ("--tolerance", "1", "--max-seconds", "0"),
            "argument --max-seconds: needs a positive number of seconds; got '0'",
        ),
        (("--tolerance", "1", "--out", "fit.txt"), "fit.txt: the name must end in .svg or .json."),
        (("--tolerance", "1", "--out", "none/fit.svg"), "none/fit.svg: no such folder."),
        ((), "--tolerance"),
    ],
)
def test_bad_options_of_a_fit_are_refused(run, options, message):
    status, out, err = run("fit", BASE, *options)
    assert (status, out) == (2, "")
    assert message in err


# ---- minimum and mixed kinds ---------------------------------------------------------------------


def test_the_minimum_distance_is_printed_with_its_bounds_and_points(run):
    status, out, err = run("minimum", BASE, "M1 2 L5 3")
    assert (status, err) == (0, "")
    printed = re.search(r"minimum distance\n  value    (\S+)\n", out)
    assert printed and float(printed[1]) == pytest.approx(2.0, rel=1e-15) and "point    B at (1, 2)" in out
    status, out, _ = run("minimum", BASE, "M1 2 L5 3", "--plot", "nearest.svg")
    assert status == 0 and "nearest.svg" in out and 'id="joining_lines"' in Path("nearest.svg").read_text()
    status, out, _ = run("minimum", BASE, "M1 2 L5 3", "--json")
    stored = json.loads(out)
    assert status == 0 and stored["type"] == "MinimumSolution"
    assert stored["solution"]["lower"] <= 2.0 <= stored["solution"]["upper"]


def test_beside_a_polynomial_any_file_is_a_shape(run, monkeypatch):
    Path("line.json").write_text(SPACE)
    seen = []

    def entry(a, b, **options):
        seen.extend([a, b])
        zero = jnp.zeros(())
        return jhd.MinimumSolution(zero, zero, zero, jnp.zeros(3), jnp.ones(3), jhd.RESULTS.successful, {})

    monkeypatch.setattr(jhd, "minimum_distance", entry)
    status, out, _ = run("minimum", "line.json", "x**2 + y**2 + z**2 - 1", "--box", -2, 2, "--json")
    assert status == 0 and json.loads(out)["context"]["box"] == [[-2.0] * 3, [2.0] * 3]
    assert [type(shape) for shape in seen] == [jhd.BezierSegments, jhd.ImplicitSurface]
    missing = run("minimum", "bunny.ply", "x - 1", "--box", -2, 2)
    assert missing[0] == 2 and "bunny.ply" in missing[2] and "column" not in missing[2]
    neither = run("hausdorff", "line.json", "line.json", "--box", -2, 2)
    assert neither[0] == 2 and "--box is for implicit surfaces" in neither[2]


def test_what_nobody_foresaw_is_one_line_and_a_status_of_its_own(run, monkeypatch):
    def broken(options):
        raise OverflowError("too\nlarge")

    monkeypatch.setattr(commands, "verify", broken)
    monkeypatch.delenv("JHD_TRACEBACK", raising=False)
    status, out, error = run("verify", "proof.json")
    assert (status, out, error.count("\n")) == (70, "", 1)
    assert error.startswith("jhd: failed: OverflowError: too large (set JHD_TRACEBACK=1")
    monkeypatch.setenv("JHD_TRACEBACK", "1")
    with pytest.raises(OverflowError):
        run("verify", "proof.json")
