"""The command line on lengths as shares, thresholds, and shapes of any kinds beside each other."""

import json
from argparse import ArgumentTypeError

import numpy as np
import pytest
from matplotlib.image import imread

import jhd
from jhd._cli.lengths import length, rounded_diagonal, share_text
from jhd._cli.options import kind_of
from jhd._cli.report import shape_line
from jhd._distance.decisions import decided
from jhd._results.solution import name_of
from jhd.io import save_mesh, save_surface

# A square of side 1 at height 1 above one at height 0: the distance is 1 both ways, the diagonal the root of 3.
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
TRIANGLES = [[0, 1, 2], [0, 2, 3]]
# The base and the diagonal of a rectangle 4 by 3 are 3 apart; the diagonal of the box is 5.
BASE, DIAGONAL = "M0 0 L4 0", "M0 0 L4 3"
PAIR = jhd.polyline([(0, 0), (4, 0)]), jhd.polyline([(0, 0), (4, 3)])
PATCH = jhd.BezierPatch([[[0, 0, 0], [0, 1, 0]], [[1, 0, 0], [1, 1, 0]]])


@pytest.fixture
def run(run):
    """Runs one command in a folder with two squares: exit status, standard output, standard error."""
    save_mesh("low.ply", jhd.TriangleMesh(SQUARE, TRIANGLES))
    save_mesh("high.ply", jhd.TriangleMesh(SQUARE + [0, 0, 1], TRIANGLES))
    np.save("corners.npy", SQUARE)
    return run


def test_a_length_is_a_number_or_a_share_of_the_diagonal():
    curve = jhd.polyline([(0, 0), (4, 3)])
    assert length("0.25").of(curve) == 0.25
    assert length(" 0.1%").of(curve) == 0.005
    # A share of a rounded diagonal could be less than a distance of just that share.
    assert length("100%").of(jhd.point_set([(0, 0), (1, 1)])) == np.sqrt(2)
    assert rounded_diagonal(jhd.polyline([(0, 0), (2, 0)]), jhd.polyline([(0, 1), (1, 1)])) == 2.236
    assert share_text(1.0, 0.0) == share_text(np.inf, 1.0) == "" and share_text(1 / 3, 2.0) == "16.7%"
    for text in ("%", "1%2", "a%", "", "-1", "nan"):
        with pytest.raises(ArgumentTypeError):
            length(text)


def test_a_tolerance_may_be_a_share_and_the_distance_is_printed_as_one(run):
    status, out, _ = run("hausdorff", "low.ply", "high.ply", "--atol", "0.1%")
    assert status == 0 and "  relative 57.7% of the diagonal\n" in out
    assert "diagonal   1.732, of the joint bounding box" in out
    status, out, _ = run("minimum", "low.ply", "high.ply", "--atol", "0.1%", "--json")
    context = json.loads(out)["context"]
    assert status == 0 and context["diagonal"] == 1.732


@pytest.mark.parametrize(("threshold", "answer", "status"), [("71%", "yes", 0), ("2.9", "no", 3)])
def test_a_threshold_is_answered_by_words_and_exit_status(run, threshold, answer, status):
    found, out, err = run("hausdorff", BASE, DIAGONAL, "--threshold", threshold)
    assert (found, err) == (
        status,
        "",
    ) and f"Hausdorff distance at most {length(threshold).of(*PAIR)!r}: {answer}" in out


def test_thresholds_of_one_direction_and_of_the_minimum_are_told_from_their_bounds(run):
    # From the base to the diagonal it is 2.4, both ways 3.
    assert run("hausdorff", BASE, DIAGONAL, "--directed", "--threshold", "2.5")[0] == 0
    status, out, _ = run("hausdorff", BASE, DIAGONAL, "--directed", "--threshold", "2.3", "--json")
    stored = json.loads(out)
    assert (status, stored["solution"]["answer"], stored["context"]["threshold"]) == (3, "no", 2.3)
    assert stored["solution"]["lower"] <= 2.4 <= stored["solution"]["upper"]
    status, out, _ = run("minimum", "low.ply", "high.ply", "--threshold", "0.5")
    assert status == 3 and "minimum distance at most 0.5: no" in out
    assert run("minimum", "low.ply", "high.ply", "--threshold", "1.5")[0] == 0


def test_bounds_on_both_sides_of_a_threshold_decide_nothing():
    solution = jhd.hausdorff(*PAIR)
    lower, upper = float(solution.lower), float(solution.upper)
    assert name_of(decided(solution, upper).answer) == "yes"
    assert name_of(decided(solution, np.nextafter(lower, 0)).answer) == "no"
    assert lower == upper or name_of(decided(solution, lower).answer) == "undecided"


def test_meshes_are_drawn_in_the_colors_of_their_distance_beside_any_shape(run):
    status, out, _ = run("hausdorff", "low.ply", "high.ply", "--directed", "--plot", "picture.png")
    assert status == 0 and "picture.png" in out
    red, green, blue = imread("picture.png")[:, :, :3].reshape(-1, 3).T
    # The yellow of the farthest, which all of the square is.
    assert np.count_nonzero((red > 0.9) & (green > 0.8) & (blue < 0.3)) > 1000


@pytest.mark.slow  # compiles the searches of a polynomial
def test_points_and_polynomials_are_measured_and_projected(run):
    status, out, _ = run("project", "z", "0.5", "0.25", "1.5", "--box", "-2", "2")
    header, row = (line.split("\t") for line in out.splitlines())
    assert status == 0 and header == ["distance", "lower", "upper", "foot x", "foot y", "foot z", "result"]
    assert np.allclose([float(x) for x in row[:-1]], [1.5, 1.5, 1.5, 0.5, 0.25, 0], rtol=0, atol=1e-9)
    status, out, _ = run("deviation", "corners.npy", "z - 1/2", "--box", "-2", "2", "--threshold", "30%")
    (line,) = (line for line in out.splitlines() if line.startswith("  mean"))
    lower, upper, share = line.split()[1:]
    assert status == 0 and float(lower) <= 0.5 <= float(upper) and share == "7.22%"
    assert "fraction within 2.078" in out


@pytest.mark.slow  # compiles the search of a patch
def test_a_parametric_surface_is_named_by_its_patches_and_parameters(run):
    assert kind_of(PATCH) == "parametric surface"
    assert shape_line("A", "a.json", PATCH) == "A  a.json: 1 patch of degrees 1 and 1"
    save_surface("a.json", PATCH)
    status, out, _ = run("project", "a.json", "0.5", "0.25", "2")
    header, row = (line.split("\t") for line in out.splitlines())
    assert status == 0 and header[3:6] == ["patch", "u", "v"]
    assert np.allclose([float(x) for x in row[:-1]], [2, 2, 2, 0, 0.5, 0.25, 0.5, 0.25, 0], rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("hausdorff", BASE, DIAGONAL, "--threshold", "-1"),
            "argument --threshold: needs a length of at least 0 in input units, or a percentage",
        ),
        (
            ("minimum", BASE, DIAGONAL, "--threshold", "nan"),
            "--threshold: needs a length of at least 0 in input units, or a percentage such as 0.1%; got 'nan'",
        ),
        (("hausdorff", BASE, DIAGONAL, "--threshold", "1", "--plot", "a.png"), "--plot: with --threshold the search"),
        (("hausdorff", BASE, DIAGONAL, "--threshold", "1", "--certificate", "a.json"), "--certificate: with --thresh"),
        (("hausdorff", BASE, DIAGONAL, "--threshold", "1", "--method", "TwoStep"), "TwoStep"),
        (("hausdorff", BASE, DIAGONAL, "--atol", "1%%"), "or a percentage such as 0.1%; got '1%%'"),
        (("minimum", BASE, "low.ply"), "a has 2 coordinates a point and b has 3; needs the same."),
        (("deviation", "z", "low.ply", "--box", "-2", "2"), "whose area is not certified"),
        (("deviation", "z", "low.ply"), "A is a polynomial; give the box of its surface"),
        (("project", "low.ply", "1", "2", "3", "--box", "0", "1"), "SHAPE is not one; leave it out"),
        (("project", "z", "1", "2", "3"), "SHAPE is a polynomial; give the box of its surface"),
        (("project", "z", "1", "2", "--box", "0", "1"), "a point has 2 coordinates; the implicit surface has 3."),
        (
            ("field", "corners.npy", "--tolerance", "1%", "--out", "f.npz"),
            "SURFACE is a set of points; needs a mesh or a surface.",
        ),
    ],
)
def test_what_is_refused_is_said_in_one_line(run, arguments, message):
    status, out, err = run(*arguments)
    assert (status, out) == (2, "") and message in err and err.count("\n") == 1
