"""Certificates in files and on the command line: exact round trips, and refusals with a status of their own."""

import json
from pathlib import Path

import numpy as np
import pytest

import jhd
from jhd.__main__ import main
from jhd.io import ParseError, load_certificate, save_curve

A = [[[0.1, 0.2], [1 / 3, 1.0], [0.7, 1.1], [1.0, 0.0]]]
B = [[[0.0, -0.1], [0.3, 0.2], [0.6, 0.2], [1.2, 1e-17]]]


@pytest.fixture(scope="module")
def made():
    a, b = jhd.BezierSegments(A), jhd.BezierSegments(B)
    return jhd.certify(a, b, jhd.hausdorff(a, b))


@pytest.fixture
def file(made, tmp_path):
    made.save(tmp_path / "proof.json")
    return tmp_path / "proof.json"


def edited(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


def run(capsys, *arguments):
    status = main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_what_is_saved_is_loaded_bit_for_bit(made, file):
    loaded = load_certificate(file)
    assert loaded == made
    assert loaded.verify() == made.verify()
    assert loaded.matches(jhd.BezierSegments(A), jhd.BezierSegments(B))


def test_an_interruption_leaves_the_stored_certificate_alone(made, tmp_path, monkeypatch):
    path = tmp_path / "proof.json"
    path.write_text("old", encoding="utf-8")

    def interrupted(self, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        made.save(path)
    assert path.read_text(encoding="utf-8") == "old" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize(
    ("new", "reason"),
    [
        ('"version": NaN', "NaN is no number of JSON"),
        ('"version": -Infinity', "-Infinity is no number of JSON"),
        ('"version": ', ":1:42: JSON: "),
        ('"version": ' + "[" * 100_000, "JSON: nested too deeply"),
        ('"version": ' + "1" * 5000, "JSON: "),
    ],
)
def test_what_is_no_json_is_no_certificate(file, new, reason):
    edited(file, '"version": 2', new)
    with pytest.raises(ParseError, match=reason):
        load_certificate(file)


def test_a_key_that_occurs_twice_is_refused(file):
    edited(file, '"version": 2', '"version": 2, "version": 2')
    with pytest.raises(jhd.CertificateError, match="'version' occurs twice"):
        load_certificate(file)


def test_verify_prints_what_is_proven(made, file, capsys):
    status, out, err = run(capsys, "verify", file)
    assert (status, err) == (0, "")
    assert out.startswith("proven: ") and f", {made.cells} cells, checked exactly in " in out
    status, out, _ = run(capsys, "verify", file, "--json")
    assert (status, json.loads(out)["proven"]) == (0, made.verify()._asdict())


def test_verify_shows_on_a_terminal_what_is_checked(made, file, capsys, monkeypatch):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert main(["verify", str(file)]) == 0
    err = capsys.readouterr().err
    assert "checking ..." in err and "cells.a_to_b[0] of " in err


def test_verify_compares_with_the_shapes_at_hand(made, file, tmp_path, capsys):
    for name, curve in (("a", A), ("b", B)):
        save_curve(tmp_path / f"{name}.json", jhd.BezierSegments(curve))
    status, out, err = run(capsys, "verify", file, tmp_path / "a.json", tmp_path / "b.json")
    assert (status, err) == (0, "") and out.startswith("proven: ")
    status, _, err = run(capsys, "verify", file, tmp_path / "a.json", tmp_path / "a.json")
    assert status == 4 and "the claim is proven, but B is another shape than the one given" in err
    status, _, err = run(capsys, "verify", file, tmp_path / "b.json", tmp_path / "a.json")
    assert (
        status == 4 and "A is another shape than the one given; the claim is about the shapes in the other order" in err
    )
    status, _, err = run(capsys, "verify", file, tmp_path / "a.json")
    assert status == 2 and "needs both shapes, or none" in err


def test_a_hash_that_is_not_that_of_the_arrays_is_refused(made, file):
    edited(file, made.content["a"]["sha256"], "0" * 64)
    with pytest.raises(jhd.CertificateError, match="a.sha256 is '0000.*, which is not the hash of its arrays"):
        load_certificate(file)


def test_verify_refuses_a_false_claim_with_a_status_of_its_own(file, capsys):
    edited(file, '"lower": ', '"lower": 1')
    status, out, err = run(capsys, "verify", file)
    assert (status, out) == (4, "")
    assert err.startswith(f"jhd: refused: {file}: witness: that the distance from the witness to piece 0 of ")
    assert err.count("\n") == 1


def test_verify_has_status_two_for_what_it_cannot_read(tmp_path, capsys):
    (tmp_path / "broken.json").write_text("{")
    for name, reason in (("broken.json", "JSON"), ("missing.json", "no such file")):
        status, out, err = run(capsys, "verify", tmp_path / name)
        assert (status, out) == (2, "")
        assert reason in err


@pytest.mark.parametrize("directed", [True, False])
def test_distance_writes_a_certificate(tmp_path, capsys, monkeypatch, directed):
    options = ["--directed"] if directed else []
    status, out, err = run(capsys, "distance", "M0 0 L4 0", "M0 0 L4 3", "--certificate", tmp_path / "p.json", *options)
    assert (status, err) == (0, "")
    assert f"proof      {Path(tmp_path / 'p.json').resolve()}" in out
    certificate = load_certificate(tmp_path / "p.json")
    assert certificate.directed is directed
    assert np.isclose(certificate.verify().lower, 2.4 if directed else 3.0)


def test_distance_without_a_certificate_says_so_with_status_one(tmp_path, capsys, monkeypatch):
    def refuse(*_, **_options):
        raise jhd.NotProvenError("no place.", jhd.point_set([(0, 0)]))

    monkeypatch.setattr(jhd, "certify", refuse)
    status, out, err = run(capsys, "distance", "M0 0 L4 0", "M0 0 L4 3", "--certificate", tmp_path / "p.json")
    assert (status, err) == (1, "jhd: no certificate: no place.\n")
    assert "value" in out and not (tmp_path / "p.json").exists()


def test_a_folder_that_is_missing_is_named_before_the_work(tmp_path, capsys, monkeypatch):
    status, _, err = run(capsys, "distance", "M0 0 L4 0", "M0 0 L4 3", "--certificate", tmp_path / "nowhere" / "p.json")
    assert status == 2 and "no such folder" in err
