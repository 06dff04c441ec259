"""The command line on many shapes: tables, JSON, folders, patterns and fonts, and exit statuses."""

import csv
import json
import math
import re
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

import jhd
import jhd.io
from jhd._cli.collected import collected, short_name

# Sets of points, which take no program of curves: their distances along the first axis.
PLACES = {"a": 0.0, "b": 0.25, "c": 4.0}


@pytest.fixture
def run(run, tmp_path):
    """Runs one command beside a folder of three sets of points: status, standard output, standard error."""
    (tmp_path / "sets").mkdir()
    for name, x in PLACES.items():
        np.save(tmp_path / "sets" / f"{name}.npy", [[x, 0.0], [x, 1.0]])
    for name in ("notes.md", "notes.txt"):
        (tmp_path / "sets" / name).write_text("no shape")
    return run


def test_all_pairs_of_a_folder_are_printed_and_kept(run, tmp_path):
    status, out, _ = run("pairwise", "sets", "--store", "kept")
    rows = [line.split("\t") for line in out.splitlines()]
    assert status == 0 and [row[1:] for row in rows] == [
        [f"sets/{i}.npy", f"sets/{j}.npy"] for i, j in (("a", "b"), ("a", "c"), ("b", "c"))
    ]
    assert [float(row[0].split()[0]) for row in rows] == [0.25, 4.0, 3.75]
    assert (tmp_path / "kept" / "manifest.json").exists()
    status, out, _ = run("pairwise", "sets/*.npy", "--store", "kept", "--json")
    stored = json.loads(out)
    assert status == 0 and stored["solution"]["value"][0] == [0.0, 0.25, 4.0]
    assert stored["context"]["names"] == [f"sets/{name}.npy" for name in PLACES]


def test_the_nearest_shapes_are_printed(run):
    status, out, _ = run("nearest", "sets/b.npy", "sets/a.npy", "sets/c.npy")
    assert status == 0 and re.match(r"0\.25 \[0\.2(?:49+|5), 0\.250*1?\]\tsets/b\.npy\tsets/a\.npy\n", out)
    stored = json.loads(run("nearest", "sets/b.npy", "sets", "--count", 2, "--json")[1])
    assert stored["solution"]["index"] == [[1, 0]] and stored["solution"]["ties"] == [[]]


def test_the_nearest_shapes_are_drawn(run, tmp_path):
    status, out, _ = run("nearest", "sets/b.npy", "sets", "--count", 2, "--plot", "near.png", "--html", "near.html")
    assert status == 0
    assert out.endswith(f"picture    {tmp_path / 'near.png'}\npage       {tmp_path / 'near.html'}\n")
    page = (tmp_path / "near.html").read_text(encoding="utf-8")
    assert page.startswith("<!doctype html>") and page.count("<svg") == page.count("</svg>") == 1
    height, width, channels = imread(tmp_path / "near.png").shape
    assert width > height > 100 and channels == 4
    assert run("nearest", "sets/b.npy", "sets", "--plot", "near.none")[0] == 2


def test_a_picture_names_files_without_folders_and_letters_that_may_not_print_by_number():
    names = ("a/b.npy", "font:X:a", "font:X:\u03c9", "font:X::")
    assert [short_name(name) for name in names] == ["b.npy", "a", "U+03C9", ":"]


def test_near_duplicates_are_printed(run):
    status, out, _ = run("duplicates", "sets", "--threshold", 0.5)
    assert status == 0 and [line.split("\t")[1:] for line in out.splitlines()] == [["sets/a.npy", "sets/b.npy"]]
    stored = json.loads(run("duplicates", "sets", "--threshold", 0.1, "--json")[1])
    assert stored["solution"]["index"] == [] and stored["solution"]["result"] == "successful"


def test_what_is_refused_is_told_in_one_line(run):
    refusal = "none/*.svg: no file with a shape found; see jhd --help for the file formats."
    assert run("pairwise", "none/*.svg") == (2, "", f"jhd: error: {refusal}\n")
    assert run("nearest", "sets/a.npy", "sets", "-k", 9)[2] == "jhd: error: k is 9; there are 3 shapes.\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("pairwise", "sets", "--jobs", 0), "--jobs is 0; needs at least 1."),
        (("pairwise", "sets", "--method", "TwoStep", "--rtol", 1), "--rtol: TwoStep takes no tolerance; leave it out."),
        (("nearest", "sets/a.npy", "sets", "--method", "TwoStep"), "method must be BranchAndBound()"),
        (("duplicates", "sets", "--threshold", 1, "--method", "Guess"), "unknown method 'Guess'; there are "),
        (
            ("pairwise", "sets", "--rtol", "-1"),
            "argument --rtol: needs a number of at least 0, or a percentage such as 0.1%; got",
        ),
        (("pairwise", "sets", "-o", "a.txt"), "a.txt: the name must end in .csv or .json."),
        (("duplicates", "sets", "--threshold", 1, "--out", "none/a.csv"), "none/a.csv: no such folder."),
        (("pairwise", "sets", "--box", -2, 2), "--box is for implicit surfaces, and there is none among the shapes"),
        (("pairwise", "sets", "--box", 2), "--box has 1 numbers; needs 2, or 6"),
        (("pairwise", "a.npy", "-x**2 + y"), "a.npy: No such file"),
        (("pairwise", "sets/a.npy", "-x**2 + y"), "'-x**2 + y' is a polynomial; give the box of its surface"),
        (("nearest", "x", "x**2", "--box", -2, 2, "--plot", "a.png"), "draw no implicit surfaces; leave them out."),
    ],
)
def test_bad_options_are_refused_in_one_line(run, as_a_user, arguments, message):
    status, out, err = run(*arguments)
    assert (status, out, err.count("\n")) == (2, "", 1) and message in err


def test_results_are_written_as_tables_and_as_json(run, tmp_path):
    places = [f"sets/{name}.npy" for name in PLACES]
    commands = {
        ("pairwise", "sets"): (["value", "lower", "upper", "a", "b", "result"], [0.25, 4.0, 3.75]),
        ("nearest", places[1], "sets", "-k2"): (["value", "lower", "upper", "query", "shape", "result"], [0, 0.25]),
        ("duplicates", "sets", "--threshold", 0.5): (["lower", "upper", "a", "b", "answer"], [0.25]),
    }
    for command, (columns, exact) in commands.items():
        assert run(*command, "-o", "a.csv")[:2] == (0, f"results    {tmp_path / 'a.csv'}\n")
        with open(tmp_path / "a.csv", newline="", encoding="utf-8") as stream:
            head, *rows = csv.reader(stream)
        assert head == columns and len(rows) == len(exact)
        for row, distance in zip(rows, exact, strict=True):
            known = dict(zip(head, row, strict=True))
            assert float(known["lower"]) <= distance <= float(known["upper"]) and set(row[-3:-1]) <= set(places)
        printed = run(*command, "--out", "a.json", "--json")[1]
        assert (tmp_path / "a.json").read_text() == printed
        content: Any = jhd.io.load_result(tmp_path / "a.json")
        assert content["context"]["names"] == places


@pytest.mark.parametrize(
    ("entry", "command"),
    [
        ("pairwise", ["pairwise"]),
        ("nearest_shapes", ["nearest"]),
        ("pairs_within", ["duplicates", "--threshold", 1]),
    ],
)
def test_options_of_the_search_are_passed_on(entry, command, run, monkeypatch):
    known, seen = getattr(jhd, entry), {}

    def called(*arguments, executor, **options):
        method: Any = next(x for x in (*arguments, *options.values()) if isinstance(x, jhd.BranchAndBound))
        seen.update(threads=executor._max_workers, pool=type(executor), seconds=options["max_seconds"])
        seen.update(rtol=float(method.rtol), atol=float(method.atol), kinds=[type(x) for x in arguments[0]])
        points = [[jhd.point_set([(0.0, 0, 0)])] * len(some) for some in arguments if isinstance(some, list)]
        return known(*points, **{key: options[key] for key in ("threshold",) if key in options})

    monkeypatch.setattr(jhd, entry, called)
    options = "--rtol", 0.125, "--atol", "10%", "--jobs", 2, "--max-seconds", 30, "--box", -1, 1, "--json"
    status, out, _ = run(*command, "-x**2 - y**2 - z**2 + 1", "x + y", "x - y", *options)
    context = json.loads(out)["context"]
    assert status == 0 and set(seen["kinds"]) == {jhd.ImplicitSurface}
    assert (seen["threads"], seen["pool"], seen["rtol"], seen["seconds"]) == (2, ThreadPoolExecutor, 0.125, 30)
    assert seen["atol"] == context["atol"] == pytest.approx(0.2 * math.sqrt(3), rel=1e-15)  # of the diagonal 2 sqrt(3)
    assert (context["rtol"], context["jobs"], context["box"]) == (0.125, 2, [[-1.0] * 3, [1.0] * 3])


@pytest.mark.slow  # compiles the search of implicit surfaces
def test_implicit_surfaces_are_measured_in_a_box(run, tmp_path):
    np.save(tmp_path / "north.npy", [[0, 0, 1.5]])
    words = "north.npy", "x**2 + y**2 + z**2 - 1", "--box", -2, 2, "--rtol", 0.01, "--json"
    found = json.loads(run("pairwise", *words)[1])["solution"]
    assert found["lower"][0][1] <= 2.5 <= found["upper"][0][1] <= 2.5 * 1.02


def test_all_letters_of_a_font_are_taken():
    names, shapes = collected(["font:STIXSizeOneSym:*"])
    assert len(names) == len(set(names)) > 20 and names == sorted(names)
    letter = jhd.io.load_glyph("STIXSizeOneSym", names[3][-1])
    np.testing.assert_array_equal(shapes[3].control_points, letter.control_points)
