"""The forgeries of the experiment on certificates: all are refused, and a checker that left a part out takes some."""

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from jhd._distance.certificate.verification import CertificateError, digest, proofs, structure, verify
from tests.distance.certificate.made import arch, between, facing, square

EXPERIMENTS = Path(__file__).resolve().parents[3] / "experiments"
MODULES = "common_certificates", "common_forgeries"
COUNT = 60
# What is left out, and the forgery that is then taken.
LEFT_OUT = [
    (arch, (proofs, "failure_of_witness"), {"lower bound too high", "another witness"}),
    (arch, (proofs, "failure_of_cell"), {"upper bound too low", "foot too far", "shape moved away"}),
    (between, (proofs, "failure_of_cell"), {"upper bound too low", "multipliers of one foot"}),
    (facing, (proofs, "failure_of_plane"), {"lower bound too high", "plane turned"}),
]


@pytest.fixture(scope="module")
def forged():
    """The forgeries of certificates made by hand, whose bounds are exact."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(EXPERIMENTS)
        common_certificates, common_forgeries = map(import_module, MODULES)
        found = {}
        for make in (arch, between, facing, square):
            content = make()
            for name in "ab":
                content[name] = {**content[name], "sha256": digest(content[name])}
            exact = (content["claim"]["lower"],) * 2
            kind = "a_to_b" if content["claim"]["kind"] == "directed" else content["claim"]["kind"]
            bounds = {"a_to_b": (0.0, exact[1]), "b_to_a": (0.0, exact[1]), kind: exact}
            seen = {name: common_certificates.places(content[name]) for name in "ab"}
            known = common_forgeries.Known(content, bounds, [], seen)
            found[make] = common_forgeries.forgeries(known, np.random.default_rng(0), COUNT)
        yield found
        for name in MODULES:
            del sys.modules[name]


def is_taken(forgery):
    """Whether it is accepted, but for what only a comparison with the shapes at hand refuses."""
    try:
        verify(forgery.content)
    except CertificateError:
        return False
    return not forgery.compared


def test_forgeries_are_many_and_all_refused(forged):
    for found in forged.values():
        assert len(found) == COUNT == len({repr(forgery.content) for forgery in found})
        assert {forgery.group for forgery in found} == {"claims", "proofs", "shapes"}
        assert [forgery.change for forgery in found if is_taken(forgery)] == []


@pytest.mark.parametrize(("make", "part", "changes"), LEFT_OUT, ids=lambda x: getattr(x, "__name__", ""))
def test_a_checker_that_leaves_a_proof_out_takes_some(forged, monkeypatch, make, part, changes):
    monkeypatch.setattr(*part, lambda *_, **__: None)
    assert changes <= {forgery.change for forgery in forged[make] if is_taken(forgery)}


def test_a_checker_that_leaves_the_cover_out_takes_some(forged, monkeypatch):
    def as_they_come(place, pieces, entries):
        return iter([(entry, place, None) for entry in entries])

    monkeypatch.setattr(proofs, "cover", as_they_come)
    monkeypatch.setattr(proofs, "failure_of_cell", lambda *_: None)
    assert {"cells removed", "a cell twice"} <= {each.change for each in forged[square] if is_taken(each)}


def test_a_checker_that_leaves_hashes_out_takes_some(forged, monkeypatch):
    # These certificates have no slack, so that other numbers are seen by the proofs too.
    for part in ("failure_of_witness", "failure_of_cell"):
        monkeypatch.setattr(proofs, part, lambda *_, **__: None)
    assert "number without its hash" not in {each.change for each in forged[arch] if is_taken(each)}
    monkeypatch.setattr(structure, "digest", lambda shape: shape.get("sha256"))
    assert "number without its hash" in {each.change for each in forged[arch] if is_taken(each)}
