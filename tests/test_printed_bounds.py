"""Bounds are true as printed: every interval in a text holds what is stored, in exact arithmetic."""

import json
import math
import re
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

import jhd
from jhd.__main__ import main
from jhd._cli import collected, commands, report
from jhd._distance.certificate.verification import Proven, sentence
from jhd._plot import pages
from jhd._results.solution import throw_unless_successful
from jhd._runtime.decimals import interval_text, lower_text, upper_text
from jhd.arithmetic import Interval
from jhd.progress import Progress
from tests.test_solution import a_solution

# Bounds that a rounding to the nearest prints wrongly on one side or on both.
BOUNDS = {
    "a third": (1 / 3, 1 / 3),
    "root of five": (5**0.5, math.nextafter(5**0.5, 3)),
    "tenth": (0.1, 0.1),
    "below the normal numbers": (1e-320, 3e-320),
    "huge": (2 / 3, 1e300),
    "the largest number": (math.nextafter(math.inf, 0), math.nextafter(math.inf, 0)),
    "signed": (-0.3, -0.1),
    "zero": (0.0, 0.0),
    "not proven from above": (2 / 3, math.inf),
}
# Made of parts whose number no checker of types can tell.
KINDS: Any = jhd
NUMBER = r"(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?|inf)"
INTERVAL = re.compile(
    "|".join(
        [
            rf"\[ *{NUMBER}, *{NUMBER}\]",
            rf"Interval\({NUMBER}, {NUMBER}\)",
            rf"lower=\[?{NUMBER}\]?, upper=\[?{NUMBER}\]?",
            rf"{NUMBER} (?:<= [hHd]\(A, B\) <=|≤ \$d\$\s≤) {NUMBER}",
            rf"\$d\$ (?:≥ {NUMBER}(\b)|= (?={NUMBER}){NUMBER})",
            rf"{NUMBER} to {NUMBER}",
            rf"(?:between|are) {NUMBER} and {NUMBER}",
            rf"lower    {NUMBER}\n  upper    {NUMBER}",
            rf"<th>lower</th><td>{NUMBER}</td></tr><tr><th>upper</th><td>{NUMBER}<",
            rf"(?m:^  \w[\w% ]+  {NUMBER}  +{NUMBER}(?:  |$))",
            rf"(?m:^[^\t\n]+\t{NUMBER}\t{NUMBER}\t)",
        ]
    )
)
VALUE = re.compile(rf"(?:value|distance)(?:=|    |</th><td>| ){NUMBER}|{NUMBER} (?:in )?\[|(?m:^{NUMBER}\t)")


def read(text: str) -> Fraction | float:
    return math.inf if text == "inf" else Fraction(text)


def intervals(text):
    """The ends of each interval in a text; a missing upper one is infinite."""
    text = text.replace("not certified by this method", "inf").replace("not certified", "inf")
    rows = [[end for end in found if end is not None] for found in (m.groups() for m in INTERVAL.finditer(text))]
    return [(read(low), read(high or "inf")) for low, high in rows]


def check(text, count, lower, upper):
    """That there are so many intervals, all of which hold both bounds and are but digits wider, and each value."""
    found = intervals(text)
    assert len(found) == count, text
    for low, high in found:
        assert low <= Fraction(lower), text
        assert high == upper == math.inf or Fraction(upper) <= high, text
        assert Fraction(lower) - low <= abs(Fraction(lower)) / 1000
        assert high == math.inf or high - Fraction(upper) <= abs(Fraction(upper)) / 1000
    for value in ([end for end in m.groups() if end][0] for m in VALUE.finditer(text)):
        assert all(low <= read(value) <= high for low, high in found), text


class Given:
    """Every kind of object with the same bounds."""

    def __init__(self, lower, upper):
        self.low, self.high = lower, upper
        middle = 0.5 * lower + 0.5 * upper
        self.value = middle if lower <= middle <= upper < math.inf else lower
        self.bounds = jhd.Bounds(lower, upper)
        numbers = [jnp.asarray(x) for x in (self.value, lower, upper)]
        plain, wide, first = a_solution(), jhd.RESULTS.gap_not_closed, jnp.array([0.5, 0])
        directed = KINDS.HausdorffSolution(*numbers, plain.witness, wide, {})
        self.hausdorff = KINDS.HausdorffSolution(*numbers, plain.witness, wide, {}, False, (directed, directed))
        self.minimum = KINDS.MinimumSolution(*numbers, first, first, wide, {})
        self.projection = KINDS.Projection(*numbers, first, jnp.int32(0), jnp.asarray(0.5), wide)
        self.decision = KINDS.Decision(jhd.ANSWERS.undecided, *numbers[1:], wide, {})
        self.measure = KINDS.StatisticSolution(*numbers, plain.direction, wide)
        witnesses = jax.tree_util.tree_map(lambda x: x[None], plain.witness)
        none, stats = jnp.zeros(1), {"steps": jnp.array(1)}
        pairs = KINDS.CriticalPairs(none, witnesses, none > 0, wide)
        line = jhd.polyline([(0, 0), (1, 0)])
        self.fit = KINDS.FitSolution(None, line, self.hausdorff, none[0], none, pairs, wide, stats, none, self.measure)
        part = KINDS.DistanceSamples(
            np.zeros((1, 2)), *(np.array([x]) for x in (lower, upper)), np.ones((1, 2)), np.zeros((1, 2, 2))
        )
        self.deviation = KINDS.Deviation(line, line, self.hausdorff, *[self.bounds] * 3, part, wide, {})
        self.many = [np.full((1, 2), x) for x in (self.value, lower, upper)]
        self.certificate = object.__new__(jhd.Certificate)
        claim = {"kind": "two_sided", "lower": lower, "upper": None if upper == math.inf else upper}
        object.__setattr__(self.certificate, "content", {"claim": claim, "cells": None})


@pytest.fixture(params=BOUNDS.values(), ids=list(BOUNDS))
def given(request):
    return Given(*request.param)


def refused(solution):
    with pytest.raises(jhd.NotProvenError) as caught:
        throw_unless_successful(solution)
    return str(caught.value)


def undecided(decision):
    with pytest.raises(ValueError, match="undecided") as caught:
        bool(decision)
    return str(caught.value)


def test_every_object_prints_bounds_that_hold_what_it_stores(given):
    ends = given.low, given.high
    kinds = (given.hausdorff, given.minimum, given.projection, given.decision, given.measure)
    for thing in (*kinds, given.bounds):
        check(repr(thing), 1, *ends)
        check(thing._repr_html_(), 1, *ends)
    for thing in kinds:
        check(refused(thing), 1, *ends)
    check(repr(given.fit), 2, *ends)
    check(given.fit._repr_html_(), 2, *ends)
    check(repr(given.deviation), 3, *ends)
    check(given.deviation._repr_html_(), 4, *ends)
    check(undecided(given.decision), 1, *ends)
    for thing in (given.hausdorff, given.minimum, given.measure, given.bounds):
        check(f"{thing:.9g}", 1, *ends)
        check(f"{thing:.3e}", 1, *ends)
    check(repr(given.certificate), 1, *ends)
    proven = Proven("minimum", given.low, None if given.high == math.inf else given.high, 1)
    check(sentence(proven).replace("d(A, B),", "d(A, B) <= inf,"), 1, *ends)
    for shape in ((), (1,)):
        interval = Interval(*(np.full(shape, x) for x in ends))
        check(repr(interval), 1, float(np.ravel(interval.lower)[0]), float(np.ravel(interval.upper)[0]))


def test_progress_tells_bounds_that_hold_what_is_known(given):
    for stage in ("a_to_b", "minimum"):
        check(report.progress_text(Progress(stage, 1, 3, given.low, given.high)), 1, given.low, given.high)


def test_every_command_prints_bounds_that_hold_what_was_found(given, monkeypatch, capsys):
    line, ends = "M 0 0 L 1 0", (given.low, given.high)
    ended = jax.tree_util.tree_map(lambda x: jnp.full((1, 2), x), jhd.RESULTS.successful)
    neighbors = KINDS.Neighbors(np.array([[0, 1]]), *given.many, jhd.RESULTS.successful, (np.array([], int),), 1)
    pairs = KINDS.PairsWithin(np.array([[0, 1]]), *(x[0, :1] for x in given.many[1:]), np.zeros((0, 2), int), ended, 1)
    table = KINDS.Pairwise(*(np.tile(x, (2, 1)) for x in given.many), jhd.RESULTS.successful, 1)
    points = jax.tree_util.tree_map(lambda x: x[None], given.projection)
    entries = {
        **{"hausdorff": given.hausdorff, "directed_hausdorff": given.hausdorff, "minimum_distance": given.minimum},
        **{"hausdorff_at_most": given.decision, "minimum_at_most": given.decision, "deviation": given.deviation},
        **{"project": points, "nearest_shapes": neighbors, "pairs_within": pairs, "pairwise": table},
        **{"fit_outline": [SimpleNamespace(shape=jhd.polyline([(0, 0), (1, 0)]))]},
    }
    for name, found in entries.items():
        monkeypatch.setattr(jhd, name, lambda *_, found=found, **__: found)
    monkeypatch.setattr(collected, "names_of", lambda result: ["successful"] * np.size(table.value))
    proven = Proven("minimum", given.low, None if given.high == math.inf else given.high, 1)
    monkeypatch.setattr(commands, "verify_file", lambda *_: proven)
    asked = {
        **{("hausdorff", line, line): 3, ("hausdorff", line, line, "--directed"): 3, ("minimum", line, line): 1},
        **{("hausdorff", line, line, "--threshold", "1"): 1, ("minimum", line, line, "--threshold", "1"): 1},
        **{("deviation", line, line): 7, ("project", line, "0", "0"): 1, ("verify", "proof.json"): 1},
        **{("nearest", line, line, line): 2, ("pairwise", line, line): 1},
        **{("duplicates", line, line, "--threshold", "1"): 1, ("fit", line, "--tolerance", "1"): 1},
    }
    for words, count in asked.items():
        assert main(list(words)) in (0, 1, 3), words
        check(capsys.readouterr().out.replace("d(A, B),", "d(A, B) <= inf,"), count, *ends)


def test_a_picture_tells_bounds_that_hold_what_was_found(given):
    for solution in (given.hausdorff, given.minimum):
        ax = Figure().add_subplot()
        jhd.plot.witness(solution, ax)
        for text in [ax.texts[0].get_text(), ax.get_legend_handles_labels()[1][-1]]:
            # Where both bounds round to the same digits, the picture says so and no interval.
            assert text.startswith("$d$ ≈ ") or check(text, 1, given.low, given.high) is None


def test_a_page_tells_bounds_that_hold_what_was_found(given, monkeypatch):
    ends = (jnp.full(2, x) for x in (given.value, given.low, given.high))
    walked = KINDS.DistanceProfile(jnp.arange(2.0), jnp.zeros((2, 2)), *ends, jnp.zeros((2, 2)), jhd.RESULTS.successful)
    monkeypatch.setattr(pages, "distance_profile", lambda *_, **__: walked)
    line = jhd.polyline([(0, 0), (1, 0)])
    text = jhd.plot.page(line, line, given.hausdorff)
    check(text.split("<svg")[0], 1, given.low, given.high)
    data = json.loads(re.findall(r'id="data">(.*?)</script>', text)[0])
    for walk in data["walks"]:
        assert len(walk["lower"]) == len(walk["upper"]) == 3
        for ends in zip(walk["lower"], walk["upper"], strict=True):
            check(f"[{ends[0]}, {ends[1] or 'inf'}]", 1, given.low, given.high)


def test_what_is_at_most_a_number_is_at_most_what_is_printed(given):
    upper, zeros, square, index = jnp.full(2, given.high), jnp.zeros(2), jnp.zeros((2, 2)), jnp.zeros(2, int)
    arcs = KINDS.BiarcCurve(square, square, zeros, index, zeros, zeros, upper, index)
    things = (
        KINDS.DistanceProfile(zeros, square, upper, upper, upper, square, jhd.RESULTS.successful),
        KINDS.DistanceTransform(upper, index[:, None]),
        KINDS.DistanceMap(square, jnp.zeros((2, 2), int), zeros, zeros, upper[0], arcs),
        arcs,
    )
    for thing in things:
        (text,) = re.findall(rf"(?:up to |at most |error=){NUMBER}", repr(thing))
        assert (read(text) == math.inf) == (given.high == math.inf)
        if given.high < math.inf:
            assert 0 <= read(text) - Fraction(given.high) <= abs(Fraction(given.high)) / 1000


def test_digits_in_full_give_the_same_number_back_and_are_rounded_outward():
    draw = np.random.default_rng(0)
    numbers = draw.integers(-(2**63), 2**63 - 1, 2000).view(np.float64)
    for x in map(float, [*numbers[np.isfinite(numbers)], *draw.uniform(-10, 10, 2000)]):
        low, high = lower_text(x), upper_text(x)
        assert float(low) == x == float(high)
        assert Fraction(low) <= Fraction(x) <= Fraction(high) and Fraction(low) <= Fraction(repr(x)) <= Fraction(high)
    assert interval_text(math.nan, math.inf, ".9g") == "[nan, inf]"
