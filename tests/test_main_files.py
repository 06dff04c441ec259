"""The command line on files of CAD and point clouds: read wherever shapes are read, refused in one line."""

import json

import numpy as np
import pytest

import jhd
import jhd.io

NET = [[[0.0, 0, 1], [0, 2, 1]], [[2, 0, 1], [2, 2, 1]]]


@pytest.fixture
def run(run, tmp_path):
    """Runs one command in a folder with a flat surface and one that is trimmed: status, standard output and error."""
    jhd.io.save_iges("flat.igs", jhd.BezierPatch(NET))
    content = (tmp_path / "flat.igs").read_text(encoding="ascii")
    (tmp_path / "trimmed.iges").write_text(content.replace(" 128 ", " 144 ").replace("128,", "144,"), encoding="ascii")
    (tmp_path / "short.igs").write_text(content[:-200], encoding="ascii")
    return run


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("trimmed.iges", r"trimmed.iges:4: entity 144 (D1), trimmed surface, is not read"),
        ("short.igs", "short.igs:"),
        ("none.igs", "none.igs: no such file."),
    ],
)
def test_files_that_cannot_be_read_are_one_line_with_status_two(run, file, message):
    status, out, err = run("hausdorff", file, "flat.igs")
    assert status == 2 and out == "" and err.count("\n") == 1 and message in err


@pytest.mark.slow
def test_points_are_projected_onto_surfaces_of_files(run):
    status, out, _ = run("project", "flat.igs", "1", "0.5", "3")
    assert status == 0
    names, values = (line.split("\t") for line in out.splitlines())
    row = dict(zip(names, values, strict=True))
    assert row["patch"] == "0" and float(row["lower"]) <= 2 <= float(row["upper"])
    np.testing.assert_allclose([float(row["u"]), float(row["v"])], [0.5, 0.25], atol=1e-6)


@pytest.mark.slow
def test_a_point_cloud_is_measured_against_a_surface_of_a_file(run, tmp_path):
    rows = [[0.5, 0.5, 1.25], [1, 1, 0.5], [1.5, 0.25, 1]]
    head = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
    )
    (tmp_path / "scan.ply").write_text(head + "\n".join(" ".join(map(str, row)) for row in rows), encoding="utf-8")
    status, out, _ = run("hausdorff", "scan.ply", "flat.igs", "--directed", "--json")
    found = json.loads(out)["solution"]
    assert status == 0 and found["lower"] <= 0.5 <= found["upper"]
