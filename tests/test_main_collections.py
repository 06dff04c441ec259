"""The command line on many shapes: tables, JSON, folders, patterns and fonts, and exit statuses."""

import json
import re

import numpy as np
import pytest
from matplotlib.image import imread

import jhd.io
from jhd.__main__ import main
from jhd._cli.collected import collected, short_name

# Sets of points, which take no program of curves: their distances along the first axis.
PLACES = {"a": 0.0, "b": 0.25, "c": 4.0}


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Runs one command beside a folder of three sets of points: status, standard output, standard error."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sets").mkdir()
    for name, x in PLACES.items():
        np.save(tmp_path / "sets" / f"{name}.npy", [[x, 0.0], [x, 1.0]])
    (tmp_path / "sets" / "notes.md").write_text("no shape")

    def call(*arguments):
        status = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call


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
    refusal = "none/*.svg: no file of a shape found; see jhd --help for the file formats."
    assert run("pairwise", "none/*.svg") == (2, "", f"jhd: error: {refusal}\n")
    assert run("nearest", "sets/a.npy", "sets", "--count", 9)[2] == "jhd: error: k is 9; there are 3 shapes.\n"


def test_all_letters_of_a_font_are_taken():
    names, shapes = collected(["font:STIXSizeOneSym:*"])
    assert len(names) == len(set(names)) > 20 and names == sorted(names)
    letter = jhd.io.load_glyph("STIXSizeOneSym", names[3][-1])
    np.testing.assert_array_equal(shapes[3].control_points, letter.control_points)
