"""The checker of certificates: what is exact is accepted, what is false or malformed is refused with a reason."""

import ast
import gzip
import json
import math
import shutil
import sys
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jhd._distance.certificate import verification
from jhd._distance.certificate.verification import CertificateError, Proven, digest, verify
from jhd._distance.certificate.verification.inequalities import slack_of
from jhd._distance.certificate.verification.pieces import common_power, composed, difference, pieces_of, simplex_map
from jhd._distance.certificate.verification.polynomials import combined, failure, from_coefficients
from jhd._distance.certificate.verification.reading import lines_of
from jhd._distance.certificate.verification.zeros import length_of
from tests.distance import exact
from tests.distance.certificate.made import (
    arch,
    at,
    between,
    changed,
    circles,
    facing,
    near_zero,
    numbers,
    sampled_distance,
    square,
)
from tests.processes import python
from tests.sweeps import swept

FOLDER = Path(verification.__file__).parent
# What every number of a certificate is moved by in turn.
MOVES = (0.0625, -0.0625, 3.0, -3.0)
CELL = ("cells", "a_to_b", 0)
FOOT = (*CELL, "feet", 0)


def test_an_exact_certificate_proves_its_claim():
    assert verify(arch()) == Proven("two_sided", 0.75, 0.75, 3)


def test_a_check_ends_at_its_limit_before_it_begins_or_within(monkeypatch):
    seen: list[str] = []
    assert verify(arch(), 60.0, seen.append).cells == 3
    assert seen[:3] == ["cells.a_to_b[0] of 2", "cells.a_to_b[1] of 2", "cells.b_to_a[0] of 1"]
    # Known from the number of cells and the degrees, before the first of them.
    large = arch()
    large["cells"]["a_to_b"] *= 50_000
    seen.clear()
    with pytest.raises(CertificateError, match=r"takes 3\.\d+ seconds or more; max_seconds is 2\.0"):
        verify(large, 2.0, seen.append)
    assert not seen
    clock = iter([0.0, 59.0, 61.0])
    monkeypatch.setattr("jhd._distance.certificate.verification.proofs.time.monotonic", lambda: next(clock))
    with pytest.raises(CertificateError, match=r"is not checked in 60.0 seconds; it ends at cells.a_to_b\[1\] of 2"):
        verify(arch(), 60.0)
    # And between the halves of one.
    clock = iter([0.0, 59.0, 61.0])
    with pytest.raises(CertificateError, match=r"seconds; it ends at cells.a_to_b\[0\] of 2"):
        verify(changed(arch(), (*CELL, "bound"), 0.7), 60.0)


@pytest.mark.parametrize("power", [-1000, 1000])
def test_lengths_of_any_size_are_short_numbers(power):
    content = arch()
    for name in "ab":
        points = content[name]["control_points"]
        content[name]["control_points"] = [[[math.ldexp(x, power) for x in row] for row in net] for net in points]
        pieces = pieces_of(content[name], common_power(content["a"]))
        assert max(abs(x) for piece in pieces for row in piece.rows for x in row) <= 2 and pieces[0].weight == (1,)
    size = math.ldexp(0.75, power)
    content["claim"] |= {"lower": size, "upper": size}
    for rows in content["cells"].values():
        for row in rows:
            row["bound"] = size
    assert verify(content) == Proven("two_sided", size, size, 3)
    content["claim"]["lower"] = math.nextafter(size, math.inf)
    with pytest.raises(CertificateError, match="witness: that the distance from the witness to piece 0 of b"):
        verify(content)


def test_a_rational_one_too():
    assert verify(circles()) == Proven("directed", 1.0, 1.0, 4)


def test_a_claim_of_one_bound_needs_nothing_for_the_other():
    upper_only = changed(changed(arch(), ("claim", "lower"), 0), ("witness",), None)
    assert verify(upper_only) == Proven("two_sided", 0.0, 0.75, 3)
    lower_only = changed(changed(arch(), ("claim", "upper"), None), ("cells",), None)
    assert verify(lower_only) == Proven("two_sided", 0.75, None, 0)


def test_patches_and_meshes_too():
    assert verify(square()) == Proven("two_sided", 1.0, 1.0, 5)


def test_two_feet_prove_what_neither_does():
    assert verify(between()) == Proven("directed", 1.25, 1.25, 1)
    for wrong in ([[3.0, 1.0], [1.0, 2.9375]], [[1.0], [1.0]], [[0.0, 1.0], [1.0, 3.0]], [[0.0], [1.0]]):
        with pytest.raises(CertificateError, match=r"is false|is not proven"):
            verify(changed(between(), (*CELL, "multipliers"), wrong))


def test_planes_prove_a_least_distance():
    assert verify(facing()) == Proven("minimum", 1.0, 1.0, 2)
    cut = [{"pair": letters, "plane": [0.0, 0.0, 2.0]} for letters in ("Xa", "Xbc", "Xbd", "YC", "YDA", "YDB")]
    assert verify(changed(facing(), ("cells", "apart"), cut)) == Proven("minimum", 1.0, 1.0, 6)
    upper_only = {**facing(), "cells": None, "claim": {"kind": "minimum", "lower": 0, "upper": 1.0}}
    assert verify(upper_only) == Proven("minimum", 0.0, 1.0, 0)
    lower_only = {**facing(), "witness": None, "claim": {"kind": "minimum", "lower": 1.0, "upper": None}}
    assert verify(lower_only) == Proven("minimum", 1.0, None, 2)


# How many samples each way on a piece of the one and of the other shape tell the distance how well.
SAMPLES = {
    arch: ((129, 2049), 1e-4),
    circles: ((17, 257), 1e-3),
    square: ((9, 33), 5e-3),
    between: ((257, 2), 1e-4),
    facing: ((9, 17), 5e-3),
}


@pytest.mark.parametrize("make", swept(SAMPLES, [facing], list(SAMPLES), ids=lambda make: make.__name__))
def test_every_number_that_is_moved_makes_it_refused_or_leaves_the_claim_true(make):
    refused, made, (counts, sampling) = 0, make(), SAMPLES[make]
    for path in numbers(made):
        for move in MOVES:
            content = changed(made, path, at(made, path) + move)
            try:
                proven = verify(content)
            except CertificateError:
                refused += 1
                continue
            distance = sampled_distance(content, counts)
            assert proven.lower <= distance + sampling, path
            assert proven.upper is not None and proven.upper >= distance - sampling, path
    assert refused >= 2 * len(numbers(made))


@pytest.mark.parametrize("move", [2.0**-50, 2.0**-30])
@pytest.mark.parametrize(("path", "sign"), [(("claim", "lower"), 1), (("cells", "b_to_a", 0, "bound"), -1)])
def test_a_bound_beyond_the_exact_one_is_refused_however_little(path, sign, move):
    content = changed(arch(), path, 0.75 + sign * move)
    with pytest.raises(CertificateError, match="is false|is not proven"):
        verify(content)


def test_the_reach_of_a_point_near_a_surface_widens_the_distance_that_it_shows():
    # The point is 0.875 below the other shape, its zero 1 below.
    assert verify(near_zero("minimum", (0, 1.125), 0.125)) == Proven("minimum", 0.0, 1.125, 0)
    with pytest.raises(CertificateError, match="witness: that the distance is at most 0.9375 is false"):
        verify(near_zero("minimum", (0, 0.9375), 0.125))
    # The point is 1.125 below.
    assert verify(near_zero("directed", (0.875, None))) == Proven("directed", 0.875, None, 0)
    with pytest.raises(CertificateError, match="is at least 1.0625 is false"):
        verify(near_zero("directed", (1.0625, None)))


def test_a_place_beyond_either_end_of_the_box_is_none_of_the_surface():
    for x in (-0.0625, 0.0625):
        with pytest.raises(CertificateError, match="witness is not in the box"):
            verify(changed(near_zero("directed", (0.5, None)), ("witness", "at", 0), x))


@pytest.mark.parametrize(("way", "square"), [([1.0, 1.0, 0.0], 2), ([3.0, 4.0, 0.0], 25)])
def test_the_length_of_a_way_is_rounded_up(way, square):
    assert square <= length_of(way) ** 2 <= square * (1 + Fraction(1, 2**60))


def nested(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


REFUSED = [
    ((("format",), "other"), "no format"),
    ((("version",), 3), "version is 3"),
    ((("version",), True), "version is True"),
    ((("claim",), ...), "has no 'claim'"),
    ((("witness",), ...), "has no 'witness'"),
    ((("more",), 1), "unknown key 'more'"),
    ((("claim", "kind"), "both"), "claim.kind is 'both'"),
    ((("claim", "kind"), "directed"), "cells has an unknown key 'b_to_a'"),
    ((("claim", "lower"), True), "claim.lower holds True; needs a number"),
    ((("claim", "lower"), -1.0), "claim.lower holds -1.0"),
    ((("claim", "lower"), "0.5"), "claim.lower holds '0.5'"),
    ((("claim", "upper"), math.inf), "claim.upper holds inf"),
    ((("claim", "upper"), math.nan), "claim.upper holds nan"),
    ((("claim", "upper"), None), "cells must be null"),
    ((("claim", "upper"), 0.5), r"cells.a_to_b\[0\].bound is 0.75, above the upper bound 0.5"),
    ((("claim", "lower"), 0.76), r"witness: .* piece 0 of b is at least 0.76 is false"),
    ((("cells",), None), "cells is None; needs an object with a_to_b, b_to_a"),
    ((("cells", "b_to_a"), ...), "cells has no 'b_to_a'"),
    ((("cells", "b_to_a"), []), r"cells.b_to_a\[0\]: there is no further cell; piece 0 is not covered"),
    ((("cells", "b_to_a"), 1), "cells.b_to_a is int; needs a list of cells"),
    ((CELL, ...), r"cells.a_to_b\[0\] leaves piece 0 uncovered between 0.0 and 0.5"),
    ((("cells", "a_to_b", 1), ...), r"cells.a_to_b\[1\]: there is no further cell; piece 0 is not covered"),
    ((("cells", "a_to_b", 1, "cell"), [0.5625, 1.0]), r"\[1\] leaves piece 0 uncovered between 0.5 and 0.5625"),
    (((*CELL, "cell"), [0.5, 0.0]), "wrong order"),
    (((*CELL, "cell"), [-0.5, 0.5]), r"cells.a_to_b\[0\].cell holds -0.5"),
    (((*CELL, "cell"), [0.0]), r"needs a list of 2"),
    (((*CELL, "cell"), "a"), r"cell is 'a'; needs a list of 2"),
    (((*CELL, "piece"), 1), r"cells.a_to_b\[0\].piece is 1; needs a whole number from 0 to 0"),
    (((*CELL, "piece"), 0.0), r"piece is 0.0"),
    (((*CELL, "piece"), False), r"piece is False"),
    (((*FOOT, "piece"), -1), r"feet\[0\].piece is -1"),
    (((*CELL, "bound"), 0.7), r"cells.a_to_b\[0\]: that the distance is at most 0.7 is false"),
    (((*CELL, "bound"), None), r"bound holds None"),
    (((*CELL, "feet"), []), "feet is .*; needs a list of 1 to 4"),
    (((*CELL, "multipliers"), []), r"multipliers is \[\]; needs a list of 1"),
    (((*CELL, "multipliers"), [[0.0, 0.0]]), "multipliers are all zero"),
    (((*CELL, "multipliers"), [[1.0, -1.0]]), r"multipliers\[0\] holds -1.0"),
    (((*CELL, "multipliers"), [[1.0] * 3]), "needs a list of 1 to 2"),
    (((*FOOT, "map", 3), [1.5]), r"map\[3\] holds 1.5"),
    (((*FOOT, "map", 0), [-0.25]), r"map\[0\] holds -0.25"),
    (((*FOOT, "map", 0), 0.25), r"map\[0\] is 0.25; needs a list of 1"),
    (((*FOOT, "map"), [[0.25]]), r"cells.a_to_b\[0\]: that the distance is at most 0.75 is false"),
    (((*FOOT, "map"), []), "needs a list of at least 1"),
    (((*FOOT, "map"), [[0.5]] * 9), "map has 9 rows; needs one of 1, 2, 3, 4"),
    (((*FOOT, "weights"), [1.0] * 3), "needs a list of 4"),
    (((*FOOT, "weights"), [1.0, 1.0, 1.0, 0.0]), "holds 0.0; needs positive"),
    (((*FOOT, "weights"), [1.0, 1.0, 0.25, 1.0]), r"map\[2\] holds 0.3125; needs finite numbers from 0.0 to 0.25"),
    ((("witness",), None), "claim.lower is 0.75 and there is no witness"),
    ((("witness", "direction"), "a"), "witness.direction is 'a'; needs a_to_b or b_to_a"),
    ((("witness", "direction"), ["a_to_b"]), "witness.direction is"),
    ((("witness", "at"), [1.5]), "witness.at holds 1.5"),
    ((("witness", "at"), []), r"witness.at is \[\]; needs a list of 1"),
    ((("witness", "at"), [0.25]), "is at least 0.75 is false"),
    ((("witness", "cuts"), [[0.0, 1.0]]), "witness.cuts must be null"),
    ((("a", "control_points", 0, 1), [0.5]), r"a.control_points\[0\]\[1\] is \[0.5\]; needs a list of 2"),
    ((("a", "control_points", 0, 1, 0), "x"), r"a.control_points\[0\]\[1\] holds 'x'"),
    ((("a", "control_points", 0, 1, 0), 2**60), r"above 2\^53"),
    ((("a", "control_points"), []), "needs a list of at least 1"),
    ((("a", "control_points", 0), [[0.0, 0.0]] * 99), "needs a list of 1 to 31"),
    (((*CELL, "cell"), [5e-324, 0.5]), r"cells.a_to_b\[0\].cell holds 5e-324; needs multiples of 2\^-255"),
    (((*FOOT, "weights"), [1.0, 1.0, 1.0, 1e300]), "weights holds 1e.300; needs multiples of 2"),
    (((*FOOT, "piece"), nested(900)), r"piece is \[\[\[\[\[\[\[\.\.\.\]\]\]\]\]\]\]; needs a whole number"),
    ((("a", "weights"), [[1.0, 1.0, 1.0, -1.0]]), r"a.weights\[0\] holds -1.0; needs positive"),
    ((("a", "weights"), [[1.0, 1.0]]), r"a.weights\[0\] is \[1.0, 1.0\]; needs a list of 4"),
    ((("a", "kind"), "solid"), "a.kind is 'solid'; needs one of curve, patches, mesh"),
    ((("a",), 1), "a.kind is None"),
    ((("b", "control_points"), [[[0.0, 0.0, 0.0]] * 2]), "a has 2 coordinates a point and b has 3"),
]


@pytest.mark.parametrize(("change", "reason"), REFUSED, ids=[reason for _, reason in REFUSED])
def test_what_is_wrong_is_named(change, reason):
    with pytest.raises(CertificateError, match=reason):
        verify(changed(arch(), *change))


PATCH = ("cells", "a_to_b", 0)
OF_SURFACES = [
    ((PATCH, ...), r"cells.a_to_b\[0\].cell is '0d': at 'd' a half before it is left out"),
    ((("cells", "a_to_b", 1), ...), r"cells.a_to_b\[1\].cell is '1'; the next one begins with '0d'"),
    ((("cells", "a_to_b", 2), ...), r"cells.a_to_b\[2\]: there is no further cell; piece 0 is not covered"),
    ((("cells", "b_to_a", 0), ...), r"cells.b_to_a\[0\]: piece is 1; piece 0 is not covered"),
    (((*PATCH, "cell"), "0"), r"cells.a_to_b\[0\]: that the distance is at most 1.0 is false"),
    (((*PATCH, "cell"), [0.0, 1.0]), r"cell is \[0.0, 1.0\]; the next one begins with '0'"),
    (((*PATCH, "cell"), "0g"), "at 'g' a half"),
    (((*PATCH, "cell"), "0" + "a" * 52), "cell has 53 cuts"),
    (((*PATCH, "cell"), None), "cell is None"),
    (((*PATCH, "cell"), nested(900)), r"cell is \[\[\[\[\[\[\[\.\.\.\]\]\]\]\]\]\]; the next one"),
    (((*PATCH, "cell"), "x" * 10**6), r"cell is 'xxxxxxxxxxxx\.\.\.xxxxxxxxxxxxx'; the next one"),
    (((*PATCH, "feet", 0, "map", 0), [0.5, 0.75]), r"map\[0\] is \[0.5, 0.75\]; needs a sum of at most 1.0"),
    (((*PATCH, "feet", 0, "map", 0), [0.5]), r"map\[0\] is \[0.5\]; needs a list of 2"),
    (((*PATCH, "feet", 0, "map"), [[0, 0]] * 2), "map has 2 rows; needs one of 1, 3, 6, 10"),
    (((*PATCH, "multipliers"), [[1.0, 1.0]]), r"multipliers\[0\] is \[1.0, 1.0\]; needs a list of 1 or 3"),
    ((("cells", "b_to_a", 0, "feet", 0, "piece"), 1), "feet.* is 1; needs a whole number from 0 to 0"),
    ((("witness", "cuts"), [[0.0, 1.0]]), "cuts must be null"),
    ((("b", "triangles", 0, 0), 4), r"b.triangles\[0\] is 4; needs a whole number from 0 to 3"),
    ((("b", "triangles", 0, 0), True), r"b.triangles\[0\] is True"),
    ((("b", "triangles", 0), [0, 1]), r"b.triangles\[0\] is \[0, 1\]; needs a list of 3"),
    ((("b", "vertices", 0), [0, 1]), r"b.vertices\[0\] is \[0, 1\]; needs a list of 3"),
    ((("a", "control_points", 0, 1), [[0.0, 0.0, 0.0]]), r"a.control_points\[0\]\[1\] is .*; needs a list of 2"),
    ((("a", "weights"), [[[1.0, 1.0], [1.0, 0.0]]]), r"a.weights\[0\]\[1\] holds 0.0; needs positive"),
    ((("a", "weights"), [[[1.0, 1.0]]]), r"a.weights\[0\] is .*; needs a list of 2"),
    ((("a", "kind"), "curve"), r"a.control_points\[0\]\[0\] holds \[0.0, 0.0, 0.0\]; needs a number"),
]


@pytest.mark.parametrize(("change", "reason"), OF_SURFACES, ids=[reason for _, reason in OF_SURFACES])
def test_what_is_wrong_with_surfaces_is_named(change, reason):
    with pytest.raises(CertificateError, match=reason):
        verify(changed(square(), *change))


PAIR = ("cells", "apart", 0)
OF_MINIMA = [
    ((("claim", "lower"), 1.0000001), r"cells.apart\[0\]: that the distance is at least 1.0000001 is not proven by"),
    ((("claim", "upper"), 0.9999999), "witness: that the distance is at most 0.9999999 is false"),
    ((("claim", "lower"), 0.0), "cells are needed if claim.lower is above zero"),
    ((("claim", "upper"), None), "witness is needed if there is a claim.upper"),
    ((PAIR, ...), r"cells.apart\[0\].pair is 'Y': 'Y' is no first half there"),
    ((("cells", "apart", 1), ...), r"cells.apart\[1\]: there is no further pair; what begins with 'Y' is left"),
    (((*PAIR, "pair"), ""), r"cells.apart\[1\]: everything is covered already"),
    (((*PAIR, "pair"), "x"), "'x' is no first half there"),
    (((*PAIR, "pair"), "A"), "'A' is no first half there"),
    (((*PAIR, "pair"), "e"), "'e' is no first half there"),
    (((*PAIR, "pair"), "a"), r"cells.apart\[1\].pair is 'Y'; the next one begins with 'b'"),
    (((*PAIR, "pair"), "X" + "a" * 53), "has 54 cuts; needs fewer"),
    (((*PAIR, "pair"), "é"), "pair is 'é'; needs letters"),
    (((*PAIR, "pair"), None), "pair is None; needs letters"),
    (((*PAIR, "plane"), [0.0, 0.0, -2.0]), "is not proven by the plane"),
    (((*PAIR, "plane"), [0.0, 0.0, 0.0]), r"plane is \[0.0, 0.0, 0.0\]; needs a direction"),
    (((*PAIR, "plane"), [0.0, 1.0]), r"plane is \[0.0, 1.0\]; needs a list of 3"),
    ((("orders", "b"), [1, 1]), "orders.b names a piece twice"),
    ((("orders", "b"), [1]), r"orders.b is \[1\]; needs a list of 2"),
    ((("orders",), None), "orders is None; needs an object with a, b"),
    ((("witness", "b", "at"), [0.75, 0.5]), "needs a sum of at most 1.0"),
    ((("witness", "b", "piece"), 0), "witness: that the distance is at most 1.0 is false"),
    ((("claim", "kind"), "directed"), "orders must be null"),
]


@pytest.mark.parametrize(("change", "reason"), OF_MINIMA, ids=[reason for _, reason in OF_MINIMA])
def test_what_is_wrong_with_a_least_distance_is_named(change, reason):
    with pytest.raises(CertificateError, match=reason):
        verify(changed(facing(), *change))


def test_a_certificate_as_it_was_made_is_verified_and_a_file_name_is_named(as_a_user):
    content = facing()
    assert verify(SimpleNamespace(content=content)) == verify(content)
    with pytest.raises(CertificateError, match="a text is no certificate: read the file with jhd.io.load_certificate"):
        verify("proof.json")


@pytest.mark.parametrize("content", [None, [], "x", 1, {}])
def test_what_is_no_certificate_is_refused(content):
    with pytest.raises(CertificateError, match="is no certificate"):
        verify(content)


def test_what_only_touches_is_given_up_after_a_limited_work():
    # The point (0, 0) is 1 away from the line through (-1, 1) and (2, 1), whose foot is at 1/3, between all halvings.
    content = changed(circles(), ("a",), {"kind": "curve", "control_points": [[[0.0, 0.0]]], "weights": None})
    line = [[[-1.0, 1.0], [2.0, 1.0]]]
    content = changed(content, ("b",), {"kind": "curve", "control_points": line, "weights": None})
    content |= {"cells": None, "claim": {"kind": "directed", "lower": 1.0, "upper": None}}
    content = changed(content, ("witness", "at"), [])
    with pytest.raises(CertificateError, match="is not proven in"):
        verify(content)


grid = st.integers(-32, 32).map(lambda k: k / 8)
weight = st.integers(1, 64).map(lambda k: k / 8)
share = st.integers(0, 8).map(lambda k: k / 8)


@st.composite
def segments(draw, rational):
    degree = draw(st.integers(0, 4))
    rows = draw(st.lists(st.tuples(grid, grid), min_size=degree + 1, max_size=degree + 1))
    weights = draw(st.lists(weight, min_size=degree + 1, max_size=degree + 1)) if rational else None
    weights = None if weights is None else [weights]
    return {"kind": "curve", "control_points": [list(map(list, rows))], "weights": weights}


def value(terms, u):
    """The value at the share u of the second corner of a polynomial on an interval."""
    return sum(c * (1 - u) ** (i & 255) * u ** (i >> 8) for i, c in terms.items())


def in_powers(coefficients):
    """The polynomial on an interval of Bernstein coefficients, which are whole numbers."""
    return from_coefficients(coefficients, (0, 1), len(coefficients) - 1)


def of_quadratic(coefficients, u):
    """The value at u of the quadratic with these Bernstein coefficients, products of two eighths."""
    whole = [int(64 * x) for x in coefficients]
    assert whole == [64 * x for x in coefficients]
    return value(in_powers(whole), u) / 64


def rows_of(piece, parameters):
    """The parameters in rows; a point has none."""
    return [[x] for x in parameters] if piece.corners else [[]]


@given(st.data(), st.booleans(), st.booleans(), st.booleans())
@settings(max_examples=60)
def test_the_squared_distance_is_that_of_fractions(data, rational_a, rational_b, moebius):
    a, b = data.draw(segments(rational_a)), data.draw(segments(rational_b))
    weights = data.draw(st.lists(weight, min_size=3, max_size=3)) if moebius else None
    sigma = [data.draw(share) * w for w in (weights or [1.0] * 3)]
    t0, t1 = data.draw(share), data.draw(share)
    pieces = [pieces_of(curve)[0] for curve in (a, b)]
    maps = [simplex_map(pieces[0], 2, rows_of(pieces[0], [t0, t1]))]
    maps.append(simplex_map(pieces[1], 2, rows_of(pieces[1], sigma), weights if pieces[1].corners else None))
    apart = difference(*(composed(x, to) for x, to in zip(pieces, maps, strict=True)))
    below, above = (slack_of(apart, bound).terms for bound in (0.0, 1.0))
    weight_sq = combined(above, 1, below, -1)
    u = Fraction(data.draw(st.integers(0, 7)), 7)
    s = of_quadratic(sigma, u) / of_quadratic(weights or [1.0] * 3, u)
    points = [
        exact.point(curve["control_points"][0], None if curve["weights"] is None else curve["weights"][0], at)
        for curve, at in ((a, Fraction(t0) + u * (Fraction(t1) - Fraction(t0))), (b, s))
    ]
    assert -value(below, u) / value(weight_sq, u) == sum((p - q) ** 2 for p, q in zip(*points, strict=True))


@given(st.lists(st.integers(-3, 9), min_size=1, max_size=8))
def test_a_polynomial_that_passes_is_nowhere_negative(coefficients):
    terms, domain = in_powers(coefficients), ((0, 1),)
    least = min(value(terms, Fraction(k, 32)) for k in range(33))
    if failure(terms, domain, (len(coefficients) - 1,)) is None:
        assert least >= 0
    if least < 0:
        assert failure(terms, domain, (len(coefficients) - 1,)) is not None


@pytest.mark.parametrize("coefficients", [(143, -49, 15), (15, -49, 143)])
def test_both_halves_of_a_polynomial_are_looked_at(coefficients):
    # 16 (4 x - 3)^2 - 1 and its mirror image are negative about 3/4 and 1/4 alone.
    assert failure(in_powers(coefficients), ((0, 1),), (2,)) is not None
    assert failure(in_powers([c + 1 for c in coefficients]), ((0, 1),), (2,)) is None


def test_the_checker_imports_nothing_but_the_standard_library_and_itself():
    nodes = [node for file in FOLDER.glob("*.py") for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))]
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    others = {str(name) for name in names if not str(name).startswith("jhd._distance.certificate.verification")}
    assert {name.split(".")[0] for name in others} <= set(sys.stdlib_module_names)


def run(folder, *arguments):
    """The checker in a copy of its folder that stands alone, without any other package."""
    return python("-I", "-S", str(folder / "checker"), *map(str, arguments), status=None, cwd=folder)


def test_the_checker_is_a_program_that_runs_by_itself(tmp_path):
    shutil.copytree(FOLDER, tmp_path / "checker", ignore=shutil.ignore_patterns("__pycache__"))
    broken = changed(arch(), ("claim", "upper"), arch()["claim"]["upper"] * 0.99)
    old, good = json.dumps(arch(), indent=1), "".join(lines_of(arch()))
    files = {"good": good, "old": old, "bad": "".join(lines_of(broken)), "torn": good[:-9], "deep": "[" * 10**5}
    files |= {"short": good[: good[:-1].rfind("\n")], "long": good + "{}", "twice": '{"claim": 1, "claim": 1}'}
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "packed").write_bytes(gzip.compress(good.encode()))
    (tmp_path / "cut").write_bytes(gzip.compress(good.encode())[:-20])
    proven = run(tmp_path, "good", "old", "packed")
    assert (proven.returncode, proven.stderr) == (0, "")
    claim = "0.75 <= H(A, B) <= 0.75, 3 cells\n"
    assert proven.stdout == "".join(f"proven: {name}: {claim}" for name in ("good", "old", "packed"))
    refused = run(tmp_path, "good", "bad", "twice", "short", "long")
    assert refused.returncode == 4 and refused.stderr.count("refused: ") == 4 and refused.stdout.count("proven") == 1
    unread = run(tmp_path, "torn", "deep", "missing", "cut", "good")
    assert unread.returncode == 2 and unread.stderr.count("not read: ") == 4 and unread.stdout.count("proven") == 1
    told = run(tmp_path, "--shapes", "good", "old").stdout.splitlines()
    assert told[1:3] == told[4:6] == [f"  {name.upper()} has SHA-256 {digest(arch()[name])}" for name in "ab"]
    late = run(tmp_path, "--max-seconds", "1e-9", "good")
    assert late.returncode == 1 and " seconds or more; max_seconds is 1e-09" in late.stderr
    assert run(tmp_path, "good", "--max-seconds", "1e-9", "old").stderr.count("max_seconds is 1e-09") == 2
    asked = [(), ("--max-seconds", "x", "good"), ("--max-seconds", "nan", "good")]
    assert [run(tmp_path, *each).returncode for each in asked] == [2, 2, 2]


def test_its_process_holds_nothing_of_the_package(tmp_path):
    (tmp_path / "good").write_text("".join(lines_of(arch())), encoding="utf-8")
    code = (
        f"import runpy, sys; sys.argv = ['checker', {str(tmp_path / 'good')!r}]\n"
        f"try: runpy.run_path({str(FOLDER)!r}, run_name='__main__')\n"
        "except SystemExit as end: print(end.code, any(x in sys.modules for x in ('jax', 'numpy', 'jhd._runtime')))"
    )
    done = python("-I", "-S", "-c", code)
    assert (done.stdout.split()[-2:], done.stderr) == (["0", "False"], "")
