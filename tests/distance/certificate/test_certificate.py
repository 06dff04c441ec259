"""Certificates of solutions: made, checked by the independent checker, and refused where they do not fit."""

import dataclasses
import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.certificate.certificate import Certificate, certify
from tests.cases import CASES
from tests.distance.pairs import BY_NAME, both, is_quick, of_each_tag
from tests.processes import python
from tests.sweeps import swept

# Pairs of the few programs that quick tests compile, one of each kind of difficulty.
QUICK = ["arch_and_wave", "circle_in_ellipse", "segment_to_points"]
OTHERS = ["halved_wave", "arch_and_wave_small"]
# Slow ones: in the plane one of each tag.
SLOW = {*of_each_tag([c for c in CASES if is_quick(c)]), *OTHERS}
# A two-sided certificate covers both curves; of the directed ones every other case has either.
EVERY = [(case.name, kind) for k, case in enumerate(CASES) for kind in (("ab", "ba")[k % 2], "two_sided")]
# Cells of a pair of the table: the most was a few hundred for a thousand segments.
MOST_CELLS = 5000


def solved(name, kind):
    """The curves of a case in the order of the kind, and their solution."""
    a, b = both(BY_NAME[name])
    a, b = (b, a) if kind == "ba" else (a, b)
    entry = jhd.hausdorff if kind == "two_sided" else jhd.directed_hausdorff
    return a, b, entry(a, b, throw=False)


def checked(a, b, solution):
    """The certificate, after its checks: it claims the bounds of the solution, of these curves."""
    certificate = certify(a, b, solution, max_cells=MOST_CELLS)
    proven = certificate.verify()
    assert (proven.lower, proven.upper) == (float(solution.lower), float(solution.upper))
    assert (proven.kind == "directed") == solution.directed == certificate.directed
    assert proven.cells == certificate.cells
    assert certificate.matches(a, b)
    return certificate


@pytest.mark.parametrize(
    ("name", "kind"), swept([(name, ("two_sided", "ab")[k % 2]) for k, name in enumerate(QUICK)], 1)
)
def test_the_bounds_of_a_solution_are_proven(name, kind):
    assert is_quick(BY_NAME[name])
    checked(*solved(name, kind))


@pytest.mark.parametrize(("name", "kind"), swept(EVERY, slow=[x for x in EVERY if x[0] in SLOW]))
def test_the_bounds_of_all_cases_are_proven(name, kind):
    checked(*solved(name, kind))


@pytest.fixture(scope="module")
def made():
    """A pair with its two-sided solution and certificate."""
    a, b, solution = solved("arch_and_wave", "two_sided")
    return a, b, solution, certify(a, b, solution)


def test_a_certificate_shows_its_claim(made):
    a, b, solution, certificate = made
    with pytest.raises(ValueError, match=r"the solution is two-sided: pass the one of jhd\.directed_hausdorff"):
        certify(a, b, solution, directed=True)
    assert repr(certificate).endswith(f", {certificate.cells} cells)") and " <= H(A, B) <= " in repr(certificate)
    assert (certificate.lower, certificate.upper) == (float(solution.lower), float(solution.upper))


def test_it_matches_no_other_curves(made):
    a, b, _, certificate = made
    assert not certificate.matches(b, a)
    assert not certificate.matches(
        a, eqx.tree_at(lambda c: c.control_points, b, b.control_points.at[0, 0, 0].add(1e-12))
    )


@pytest.mark.slow
def test_a_place_is_found_where_the_witness_does_not_prove_the_lower_bound(made):
    a, b, solution, _ = made
    elsewhere = eqx.tree_at(lambda s: s.witness.t, solution, jnp.asarray(0.123))
    assert certify(a, b, elsewhere).verify().lower == float(solution.lower)
    without = dataclasses.replace(elsewhere, upper=jnp.asarray(jnp.inf))
    assert certify(a, b, without).verify() == ("two_sided", float(solution.lower), None, 0)


@pytest.mark.parametrize(
    ("field", "share", "reason"),
    [
        ("upper", 0.9, "upper bound"),
        pytest.param("lower", 1.1, "lower bound", marks=pytest.mark.slow),
    ],
)
def test_a_false_bound_has_no_certificate(made, field, share, reason):
    a, b, solution, _ = made
    false = dataclasses.replace(solution, **{field: getattr(solution, field) * share})
    with pytest.raises(jhd.NotProvenError, match=reason) as caught:
        certify(a, b, false)
    assert caught.value.solution is false


def test_too_many_cells_are_an_error(made):
    a, b, solution, _ = made
    with pytest.raises(jhd.NotProvenError, match="raise max_cells"):
        certify(a, b, solution, max_cells=1)


def test_a_time_limit_is_an_error_that_counts_the_cells(made):
    a, b, solution, _ = made
    with pytest.raises(jhd.NotProvenError, match="no certificate after 1e-09 seconds: .* are left"):
        certify(a, b, solution, max_seconds=1e-9)
    with pytest.raises(ValueError, match="max_seconds is 0"):
        certify(a, b, solution, max_seconds=0)
    rows, moved = jhd.polyline([(0, 0), (1, 2), (2, 0)]), jhd.polyline([(0, 1), (1, 3), (2, 1)])
    with pytest.raises(jhd.NotProvenError, match=r"\d+ pairs are proven and \d+ are left"):
        certify(rows, moved, jhd.minimum_distance(rows, moved), max_seconds=1e-9)


def test_progress_counts_the_cells_of_each_direction(made):
    a, b, solution, certificate = made
    seen = []
    certify(a, b, solution, progress=seen.append)
    assert [entry.stage for entry in seen] == sorted(entry.stage for entry in seen)
    last = {entry.stage: entry for entry in seen}
    assert sum(entry.done for entry in last.values()) == certificate.cells
    assert all(entry.total == entry.done for entry in last.values())


def test_arguments_of_another_kind_are_refused(made, as_a_user):
    a, b, solution, certificate = made
    with pytest.raises(TypeError, match="b must be points, a curve, a parametric surface"):
        certify(a, 1.0, solution)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="solution must be a HausdorffSolution .*; got Certificate"):
        certify(a, b, certificate)
    with pytest.raises(TypeError, match="index a batch first"):
        certify(a, b, jax.tree_util.tree_map(lambda x: jnp.stack([x, x]), solution))
    with pytest.raises(ValueError, match="max_cells is 0"):
        certify(a, b, solution, max_cells=0)
    with pytest.raises(ValueError, match="a has 2 coordinates a point and b has 3"):
        certify(a, jhd.point_set([[0.0, 0.0, 0.0]]), solution)
    with pytest.raises(ValueError, match="slack is 'x'; needs one number"):
        certify(a, b, solution, slack="x")  # pyright: ignore[reportArgumentType]
    with pytest.raises(jhd.CertificateError, match="is no certificate"):
        Certificate({})


def test_the_same_segments_have_a_certificate_of_zero():
    a = jhd.BezierSegments(np.random.default_rng(5).normal(size=(3, 4, 2)))
    solution = dataclasses.replace(jhd.directed_hausdorff(a, a), lower=jnp.zeros(()), upper=jnp.zeros(()))
    assert certify(a, a, solution).verify() == ("directed", 0.0, 0.0, 3)


@pytest.mark.exhaustive
def test_single_precision_has_certificates_too():
    code = (
        "import numpy as np, jhd; rows = np.random.default_rng(2).normal(size=(2, 3, 4, 2));"
        "a, b = (jhd.BezierSegments(x) for x in rows); assert a.control_points.dtype == 'float32';"
        "c = jhd.certify(a, b, s := jhd.hausdorff(a, b)); p = c.verify();"
        "print(p.lower == float(s.lower), p.upper == float(s.upper), c.matches(a, b))"
    )
    environment = {**os.environ, "JAX_ENABLE_X64": "0"}
    assert python("-c", code, env=environment).stdout.split() == ["True"] * 3


@pytest.mark.parametrize("seed", swept(range(40), slow=range(8)))
def test_random_pairs_have_certificates(seed):
    rng = np.random.default_rng(seed)
    shapes = [rng.normal(size=(int(rng.integers(1, 5)), int(rng.integers(1, 5)), 2)) for _ in range(2)]
    spread = rng.uniform(0, 3.5)
    weights = [10 ** rng.uniform(-spread, spread, x.shape[:2]) if seed % 2 else None for x in shapes]
    a, b = (jhd.BezierSegments(x * 10.0 ** rng.integers(-3, 4), w) for x, w in zip(shapes, weights, strict=True))
    checked(a, b, jhd.hausdorff(a, b, throw=False))
