"""The command line on deviations: the table, JSON, the picture, and exit statuses."""

import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.image import imread

import jhd
from jhd.io import save_mesh


@pytest.fixture
def run(run):
    """Runs one command in a folder with a square above a tilted plane: status, standard output, standard error."""
    triangles = [[0, 1, 2], [0, 2, 3]]
    save_mesh("square.ply", jhd.TriangleMesh([[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], triangles))
    save_mesh("plane.obj", jhd.TriangleMesh([[-3, -3, 1.5], [4, -3, -2], [4, 4, -2], [-3, 4, 1.5]], triangles))
    return run


def numbers_of(out, name):
    """Both bounds in a row of the table."""
    (line,) = (line for line in out.splitlines() if line.startswith(f"  {name}"))
    return [float(word) for word in line.removeprefix(f"  {name}").split()[:2]]


def test_the_table_holds_proven_bounds_and_the_picture_is_written(run):
    status, out, _ = run(
        "deviation", "square.ply", "plane.obj", "--threshold", "1.118", "--plot", "picture.png", "--quantile", "0.625"
    )
    assert plt.get_fignums() == []
    cosine = 1 / np.sqrt(1.25)
    exact = {"mean": 1.25 * cosine, "rms": cosine * np.sqrt(1.25**2 + 1 / 48), "maximum": 1.5 * cosine}
    exact |= {
        "area of A": 1.0,
        "50% within": 1.25 * cosine,
        "62.5% within": 1.3125 * cosine,
        "fraction within 1.118": 2 * (1.118 / cosine - 1),
    }
    for name, value in exact.items():
        lower, upper = numbers_of(out, name)
        assert lower <= value <= upper, name
    assert status == 0 and imread("picture.png").std() > 0.01


def test_the_page_shows_the_mesh(run):
    pytest.importorskip("plotly")
    assert run("deviation", "square.ply", "plane.obj", "--html", "page.html")[0] == 0
    assert "mesh3d" in Path("page.html").read_text(encoding="utf-8")


def test_json_holds_the_same_and_what_was_asked(run):
    asked = "--json", "--threshold", "9", "--rtol", "0.01", "--quantile", "0.95"
    status, out, _ = run("deviation", "square.ply", "plane.obj", *asked)
    stored = json.loads(out)
    lower, upper = stored["solution"]["mean"].values()
    assert status == 0 and lower <= 1.25 / np.sqrt(1.25) <= upper
    assert stored["type"] == "Deviation" and stored["context"]["rtol"] == 0.01
    assert stored["solution"]["fraction_within"]["lower"] > 0.999
    lower, upper = stored["solution"]["quantiles"]["0.95"].values()
    assert lower <= 1.475 / np.sqrt(1.25) <= upper <= 1.01 * lower


def test_what_is_refused_is_told_in_one_line(run):
    status, out, err = run("deviation", "square.ply", "plane.obj", "--threshold", "-1")
    assert (status, out) == (2, "") and err.startswith("jhd: error: argument --threshold: needs a length of at least 0")
    assert run("deviation", "square.ply", "plane.obj", "--plot", "nowhere/picture.png")[0] == 2
