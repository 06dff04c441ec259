"""The command line on meshes: distances, projections and fields."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

import jhd
from jhd._cli.report import place_text
from jhd.io import load_mesh, load_result, save_mesh

# A tetrahedron, and the same one moved by 1/4 along x: the corner (-1, 0, 0) of the first is farthest from the second.
CORNERS = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 1], [0, 1, -1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
ROUNDING = 1e-12


@pytest.fixture
def run(run):
    """Runs one command in a folder with two meshes: exit status, standard output, standard error."""
    save_mesh("a.ply", jhd.TriangleMesh(CORNERS, FACES))
    save_mesh("b.obj", jhd.TriangleMesh(CORNERS + [0.25, 0, 0], FACES))
    return run


def test_the_distance_of_meshes_is_printed_with_triangle_and_barycentric_coordinates(run):
    status, out, _ = run("hausdorff", "a.ply", "b.obj", "--directed", "--plot", "picture.png")
    assert status == 0
    assert "closed mesh of 4 triangles" in out and "directed distance from A to B" in out
    assert "witness  A triangle" in out and "at (-1, 0, 0)" in out
    assert imread("picture.png").std() > 0.01


def test_a_witness_is_named_by_its_kind_of_shape_without_padding(run):
    np.save("p.npy", [(0.0, 0, 0), (0, 0, 5)])
    status, out, _ = run("hausdorff", "p.npy", "a.ply", "--directed")
    assert status == 0 and "witness  A point 1, at (0, 0, 5)" in out and "foot     B triangle" in out
    place = place_text("B", ("patch", "u", "v"), 6, (0.5, 0.25, 0), (1, 2, 3))
    assert place == "B patch 6, t = (0.5, 0.25), at (1, 2, 3)"
    head, row = (line.split("\t") for line in run("project", "p.npy", "0", "0", "6")[1].splitlines())
    assert head == ["distance", "lower", "upper", "point", "foot x", "foot y", "foot z", "result"]
    assert (row[0], row[3], row[-1]) == ("1.0", "1", "successful")


def test_json_of_a_mesh_distance_is_a_saved_result(run, tmp_path):
    status, out, _ = run("hausdorff", "a.ply", "b.obj", "--json")
    (tmp_path / "r.json").write_text(out)
    solution: Any = load_result("r.json")["solution"]
    assert status == 0 and abs(solution["value"] - 0.25) <= ROUNDING
    assert len(solution["witness"]["t"]) == 3


def test_points_are_projected_on_a_mesh(run):
    status, out, _ = run("project", "a.ply", "2", "0", "0")
    header, row = (line.split("\t") for line in out.splitlines())
    assert status == 0 and header[3:7] == ["triangle", "t1", "t2", "t3"]
    assert np.allclose([float(x) for x in (row[0], *row[7:10])], [1, 1, 0, 0], rtol=0, atol=ROUNDING)
    status, out, _ = run("project", "a.ply", "2", "0", "0", "--method", "vertex-voxels")
    distance, lower, upper = map(float, out.splitlines()[1].split("\t")[:3])
    assert status == 0 and abs(distance - 1) <= ROUNDING and lower == 0 and upper >= 1


def test_the_distance_of_meshes_has_a_certificate(run):
    status, out, _ = run("hausdorff", "a.ply", "b.obj", "--certificate", "c.json.gz")
    assert status == 0 and "proof      " in out
    status, out, _ = run("verify", "c.json.gz", "--max-seconds", "60")
    assert status == 0 and out.startswith("proven: ")
    status, _, err = run("verify", "c.json.gz", "--max-seconds", "1e-9")
    assert status == 1 and " seconds or more; max_seconds is 1e-09" in err
    status, _, err = run("verify", "c.json.gz", "--max-seconds", "nan")
    assert status == 2 and "needs a positive number of seconds; got 'nan'" in err
    # Nothing that is read is written over, and a name is not empty.
    before = Path("a.ply").read_bytes()
    for words in (("--certificate", "a.ply"), ("--plot", "./a.ply"), ("--plot", "")):
        status, _, err = run("hausdorff", "a.ply", "b.obj", *words)
        assert status == 2 and ("would overwrite" in err) == bool(words[1]) and Path("a.ply").read_bytes() == before


def test_the_minimum_distance_of_meshes_has_one_too(run):
    status, out, _ = run("minimum", "a.ply", "b.obj", "--certificate", "m.json")
    assert status == 0 and "proof      " in out
    status, out, _ = run("verify", "m.json")
    assert status == 0 and " <= d(A, B) <= " in out
    status, _, err = run("verify", "m.json", "a.ply", "x**2 + y**2 + z**2 - 1", "--box", "-2", "2")
    assert status == 4 and "B is another shape" in err
    assert "no shape is not one" in run("verify", "m.json", "--box", "-2", "2")[2]
    status, _, err = run("minimum", "a.ply", "b.obj", "--certificate", "m.json", "--threshold", "1")
    assert status == 2 and "--certificate: with --threshold" in err


def test_a_field_that_is_out_of_time_is_not_written(run):
    status, _, err = run("field", "a.ply", "--tolerance", "0.1", "--out", "late.npz", "--max-seconds", "1e-9")
    assert status == 1 and "longer than max_seconds = 1e-09" in err and not Path("late.npz").exists()


@pytest.mark.slow
def test_a_field_is_stored_and_turned_into_a_mesh(run):
    status, out, _ = run(
        "field", "a.ply", "--tolerance", "0.1", "--out", "f.npz", "--surface", "s.stl", "--resolution", "16", "--json"
    )
    facts, field = json.loads(out), jhd.AdaptiveDistanceField.load("f.npz")
    assert status == 0 and facts["leaves"] == field.leaves and facts["sampled_error"] < 0.2
    assert load_mesh("s.stl").is_closed
    assert "leaves" in run("field", "a.ply", "--tolerance", "0.1", "--out", "f.npz")[1]
    # No test point of a leaf exceeds the tolerance, but a random one does.
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    save_mesh("t.obj", jhd.TriangleMesh(corners, [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]))
    status, out, _ = run("field", "t.obj", "--tolerance", "0.05", "--out", "f.npz", "--json")
    facts = json.loads(out)
    assert facts["unresolved"] == 0 and facts["sampled_error"] > 0.05 and status == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("hausdorff", "a.ply", "M0 0 L1 1"), "a has 3 coordinates a point and b has 2"),
        (("hausdorff", "a.ply", "b.obj", "--method", "two-step"), "for TriangleMesh and TriangleMesh; got TwoStep"),
        (("hausdorff", "a.ply", "c.stl"), "c.stl"),
        (("fit", "a.ply", "--tolerance", "1"), "TARGET is a mesh; needs a curve"),
        (("project", "a.ply", "1", "2"), "the mesh has 3"),
        (("project", "a.ply", "1", "2", "3", "--method", "newton-projection"), "for meshes"),
        (("field", "M0 0 L1 1", "--tolerance", "1", "--out", "f.npz"), "SURFACE is a curve; needs a mesh or"),
        (("field", "a.ply", "--tolerance", "-1", "--out", "f.npz"), "got '-1'"),
        (("field", "a.ply", "--tolerance", "1", "--out", "f.txt"), "must end in .npz"),
        (("field", "a.ply", "--tolerance", "1", "--out", "no/f.npz"), "no such folder"),
        (("field", "a.ply", "--tolerance", "1", "--out", "f.npz", "--surface", "s.stl"), "go together"),
    ],
)
def test_bad_input_is_one_line_with_status_two(run, arguments, message):
    status, out, err = run(*arguments)
    assert status == 2 and out == "" and message in err and err.count("\n") == 1
