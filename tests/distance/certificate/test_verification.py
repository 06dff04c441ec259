"""The checker of certificates: what is exact is accepted, what is false or malformed is refused with a reason."""

import ast
import copy
import json
import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jhd.distance.certificate import verification
from jhd.distance.certificate.verification import CertificateError, Proven, verify
from tests.distance import exact

FILE = Path(verification.__file__)
# What every number of a certificate is moved by in turn, and how well samples of the curves know their distance.
MOVES = (0.0625, -0.0625, 3.0, -3.0)
SAMPLING = 1e-4


def arch():
    """The arch over its chord, whose Hausdorff distance is its height 3/4, without any slack on either side."""
    halves = [([0.0, 0.5], [0.0, 0.125, 0.3125, 0.5]), ([0.5, 1.0], [0.5, 0.6875, 0.875, 1.0])]
    there = [
        {"segment": 0, "t": t, "foot": 0, "sigma": sigma, "sigma_weights": None, "bound": 0.75} for t, sigma in halves
    ]
    back = {"segment": 0, "t": [0, 1], "foot": 0, "sigma": [0, 1], "sigma_weights": None, "bound": 0.75}
    return {
        "format": "jhd-certificate",
        "version": 1,
        "claim": {"kind": "two_sided", "lower": 0.75, "upper": 0.75},
        "a": {"control_points": [[[-1.0, 0.0], [-0.5, 1.0], [0.5, 1.0], [1.0, 0.0]]], "weights": None},
        "b": {"control_points": [[[-1.0, 0.0], [1.0, 0.0]]], "weights": None},
        "cells": {"a_to_b": there, "b_to_a": [back]},
        "witness": {"direction": "a_to_b", "segment": 0, "t": 0.5, "cuts": [[0.0, 0.5, 1.0]]},
    }


def circles():
    """Concentric circles in quarters of weights 1, 1, 2: the distance of any point of the inner one is exactly 1."""
    corners = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)], dtype=float)
    quarters = np.stack([corners[i : i + 3] for i in (0, 2, 4, 6)])
    cells = [
        {"segment": k, "t": [0, 1], "foot": k, "sigma": [0, 1], "sigma_weights": weights, "bound": 1.0}
        for k, weights in enumerate([None, [1, 1], None, [1.0, 1.0]])
    ]
    a, b = ({"control_points": (r * quarters).tolist(), "weights": [[1.0, 1.0, 2.0]] * 4} for r in (1, 2))
    return {
        **arch(),
        **{"a": a, "b": b, "claim": {"kind": "directed", "lower": 1.0, "upper": 1.0}, "cells": {"a_to_b": cells}},
        "witness": {"direction": "a_to_b", "segment": 0, "t": 0.0, "cuts": [[0.0, 1.0]] * 4},
    }


def changed(content, path, value):
    """A copy with one entry replaced; a value of `...` takes it away."""
    content = copy.deepcopy(content)
    *parents, last = path
    place = content
    for key in parents:
        place = place[key]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return content


def numbers(value, path=()):
    """The paths of all numbers."""
    if isinstance(value, bool | str) or value is None:
        return []
    if isinstance(value, int | float):
        return [path]
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return [found for key, item in items for found in numbers(item, (*path, key))]


def at(content, path) -> Any:
    for key in path:
        content = content[key]
    return content


def sampled(curve, count):
    """Many points of a polynomial curve."""
    t = np.linspace(0.0, 1.0, count)[:, None]
    rows = np.array(curve["control_points"], dtype=float)
    n = rows.shape[1] - 1
    return np.concatenate(
        [sum(math.comb(n, i) * t**i * (1 - t) ** (n - i) * row[i] for i in range(n + 1)) for row in rows]
    )


def sampled_distance(content):
    """The two-sided distance of samples."""
    sets = [(sampled(content[x], 129), sampled(content[y], 2049)) for x, y in ("ab", "ba")]
    return max(np.sqrt(((p[:, None] - q) ** 2).sum(-1).min(1).max()) for p, q in sets)


def test_an_exact_certificate_proves_its_claim():
    assert verify(arch()) == Proven("two_sided", 0.75, 0.75, 3)


def test_a_rational_one_too():
    assert verify(circles()) == Proven("directed", 1.0, 1.0, 4)


def test_a_claim_of_one_bound_needs_nothing_for_the_other():
    upper_only = changed(changed(arch(), ("claim", "lower"), 0), ("witness",), None)
    assert verify(upper_only) == Proven("two_sided", 0.0, 0.75, 3)
    lower_only = changed(changed(arch(), ("claim", "upper"), None), ("cells",), None)
    assert verify(lower_only) == Proven("two_sided", 0.75, None, 0)


def test_every_number_that_is_moved_makes_it_refused_or_leaves_the_claim_true():
    refused = 0
    for path in numbers(arch()):
        for move in MOVES:
            content = changed(arch(), path, at(arch(), path) + move)
            try:
                proven = verify(content)
            except CertificateError:
                refused += 1
                continue
            distance = sampled_distance(content)
            assert proven.lower <= distance + SAMPLING, path
            assert proven.upper is not None and proven.upper >= distance - SAMPLING, path
    assert refused >= 3 * len(numbers(arch()))


@pytest.mark.parametrize("move", [2.0**-50, 2.0**-30])
@pytest.mark.parametrize(("path", "sign"), [(("claim", "lower"), 1), (("cells", "b_to_a", 0, "bound"), -1)])
def test_a_bound_beyond_the_exact_one_is_refused_however_little(path, sign, move):
    content = changed(arch(), path, 0.75 + sign * move)
    with pytest.raises(CertificateError, match="is false|is not proven"):
        verify(content)


def nested(depth):
    value = []
    for _ in range(depth):
        value = [value]
    return value


CELL = ("cells", "a_to_b", 0)
REFUSED = [
    ((("format",), "other"), "no format"),
    ((("version",), 2), "version is 2"),
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
    ((("claim", "lower"), 0.76), r"witness: .* segment 0 of b between 0.0 and 0.5 is at least 0.76 is false"),
    ((("cells",), None), "cells is None; needs an object with a_to_b, b_to_a"),
    ((("cells", "b_to_a"), ...), "cells has no 'b_to_a'"),
    ((("cells", "b_to_a"), []), r"cells.b_to_a is \[\]; needs a list of at least 1"),
    ((CELL, ...), "cells.a_to_b leave segment 0 of a uncovered between 0.0 and 0.5"),
    ((("cells", "a_to_b", 1), ...), "cells.a_to_b leave segment 0 of a uncovered between 0.5 and 1.0"),
    (((*CELL, "t"), [0.0, 0.4375]), "uncovered between 0.4375 and 0.5"),
    (((*CELL, "t"), [0.5, 0.0]), "wrong order"),
    (((*CELL, "t"), [-0.5, 0.5]), r"cells.a_to_b\[0\].t holds -0.5"),
    (((*CELL, "t"), [0.0]), r"needs a list of 2"),
    (((*CELL, "segment"), 1), r"cells.a_to_b\[0\].segment is 1; needs a whole number from 0 to 0"),
    (((*CELL, "segment"), 0.0), r"segment is 0.0"),
    (((*CELL, "segment"), False), r"segment is False"),
    (((*CELL, "foot"), -1), r"foot is -1"),
    (((*CELL, "bound"), 0.7), r"cells.a_to_b\[0\]: that the distance is at most 0.7 is false"),
    (((*CELL, "bound"), None), r"bound holds None"),
    (((*CELL, "sigma"), [0.0, 0.125, 0.3125, 1.5]), r"sigma holds 1.5"),
    (((*CELL, "sigma"), [-0.25, 0.125, 0.3125, 0.5]), r"sigma holds -0.25"),
    (((*CELL, "sigma"), [0.25]), r"cells.a_to_b\[0\]: that the distance is at most 0.75 is false"),
    (((*CELL, "sigma"), []), "needs a list of 1 to"),
    (((*CELL, "sigma"), [0.5] * 9), "needs a list of 1 to"),
    (((*CELL, "sigma_weights"), [1.0] * 3), "needs a list of 4"),
    (((*CELL, "sigma_weights"), [1.0, 1.0, 1.0, 0.0]), "holds 0.0; needs positive"),
    (((*CELL, "sigma_weights"), [1.0, 1.0, 0.25, 1.0]), r"sigma holds 0.3125; needs finite numbers from 0.0 to 0.25"),
    ((("witness",), None), "claim.lower is 0.75 and there is no witness"),
    ((("witness", "direction"), "a"), "witness.direction is 'a'; needs a_to_b or b_to_a"),
    ((("witness", "direction"), ["a_to_b"]), "witness.direction is"),
    ((("witness", "t"), 1.5), "witness.t holds 1.5"),
    ((("witness", "t"), 0.25), "is at least 0.75 is false"),
    ((("witness", "cuts"), []), "needs a list of 1"),
    ((("witness", "cuts", 0), [0.0, 0.5]), r"witness.cuts\[0\] is \[0.0, 0.5\]; needs cuts in order from 0 to 1"),
    ((("witness", "cuts", 0), [0.0, 0.75, 0.5, 1.0]), "needs cuts in order"),
    ((("a", "control_points", 0, 1), [0.5]), r"a.control_points\[0\]\[1\] is \[0.5\]; needs a list of 2"),
    ((("a", "control_points", 0, 1, 0), "x"), r"a.control_points\[0\]\[1\] holds 'x'"),
    ((("a", "control_points", 0, 1, 0), 2**60), r"above 2\^53"),
    ((("a", "control_points"), []), "needs a list of at least 1"),
    ((("a", "control_points", 0), [[0.0, 0.0]] * 99), "needs a list of 1 to 31"),
    (((*CELL, "t"), [5e-324, 0.5]), r"cells.a_to_b\[0\].t holds 5e-324; needs multiples of 2\^-255"),
    (((*CELL, "sigma_weights"), [1.0, 1.0, 1.0, 1e300]), "sigma_weights holds 1e.300; needs multiples of 2"),
    (((*CELL, "foot"), nested(900)), r"foot is \[\[\[\[\[\[\[\.\.\.\]\]\]\]\]\]\]; needs a whole number"),
    ((("a", "weights"), [[1.0, 1.0, 1.0, -1.0]]), r"a.weights\[0\] holds -1.0; needs positive"),
    ((("a", "weights"), [[1.0, 1.0]]), r"a.weights\[0\] is \[1.0, 1.0\]; needs a list of 4"),
    ((("b", "control_points"), [[[0.0, 0.0, 0.0]]]), "a has 2 coordinates a point and b has 3"),
]


@pytest.mark.parametrize(("change", "reason"), REFUSED, ids=[reason for _, reason in REFUSED])
def test_what_is_wrong_is_named(change, reason):
    with pytest.raises(CertificateError, match=reason):
        verify(changed(arch(), *change))


@pytest.mark.parametrize("content", [None, [], "x", 1, {}])
def test_what_is_no_certificate_is_refused(content):
    with pytest.raises(CertificateError, match="is no certificate"):
        verify(content)


def test_what_only_touches_is_given_up_after_a_limited_work():
    # The point (0, 0) is 1 away from the line through (-1, 1) and (2, 1), whose foot is at 1/3, between all halvings.
    content = changed(circles(), ("a",), {"control_points": [[[0.0, 0.0]]], "weights": None})
    content = changed(content, ("b",), {"control_points": [[[-1.0, 1.0], [2.0, 1.0]]], "weights": None})
    content |= {"cells": None, "claim": {"kind": "directed", "lower": 1.0, "upper": None}}
    content = changed(content, ("witness", "cuts"), [[0.0, 1.0]])
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
    return {"control_points": [list(map(list, rows))], "weights": None if weights is None else [weights]}


def value(scaled, u):
    """The value at u of a polynomial from its coefficients times binomials."""
    n = len(scaled) - 1
    return sum(c * u**i * (1 - u) ** (n - i) for i, c in enumerate(scaled))


@given(st.data(), st.booleans(), st.booleans(), st.booleans())
@settings(max_examples=60)
def test_the_squared_distance_is_that_of_fractions(data, rational_a, rational_b, moebius):
    a, b = data.draw(segments(rational_a)), data.draw(segments(rational_b))
    weights = data.draw(st.lists(weight, min_size=3, max_size=3)) if moebius else None
    sigma = [data.draw(share) * w for w in (weights or [1.0] * 3)]
    t0, t1 = data.draw(share), data.draw(share)
    parts = [verification.segments_of(curve)[0] for curve in (a, b)]
    squares, weight_sq = verification.distance_sq(
        verification.restricted(parts[0], [t0, t1]), verification.restricted(parts[1], sigma, weights)
    )
    u = Fraction(data.draw(st.integers(0, 7)), 7)
    s = value([c * math.comb(2, i) * Fraction(x) for i, (c, x) in enumerate(zip([1] * 3, sigma, strict=True))], u)
    s /= value([math.comb(2, i) * Fraction(x) for i, x in enumerate(weights or [1.0] * 3)], u)
    points = [
        exact.point(curve["control_points"][0], None if curve["weights"] is None else curve["weights"][0], at)
        for curve, at in ((a, Fraction(t0) + u * (Fraction(t1) - Fraction(t0))), (b, s))
    ]
    assert value(squares, u) / value(weight_sq, u) == sum((p - q) ** 2 for p, q in zip(*points, strict=True))


@given(st.lists(st.integers(-3, 9), min_size=1, max_size=8))
def test_a_polynomial_that_passes_is_nowhere_negative(coefficients):
    scaled = [c * math.comb(len(coefficients) - 1, i) for i, c in enumerate(coefficients)]
    squares, whole = scaled, [math.comb(len(coefficients) - 1, i) for i in range(len(coefficients))]
    least = min(value(squares, Fraction(k, 32)) for k in range(33))
    if verification.failure_at_least(squares, [0] * len(whole), 1.0) is None:
        assert least >= 0
    if least < 0:
        assert verification.failure_at_least(squares, [0] * len(whole), 1.0) is not None


def test_the_checker_imports_nothing_but_the_standard_library():
    nodes = list(ast.walk(ast.parse(FILE.read_text(encoding="utf-8"))))
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    assert {str(name).split(".")[0] for name in names} <= set(sys.stdlib_module_names)


def test_the_checker_runs_by_itself(tmp_path):
    (tmp_path / "verification.py").write_text(FILE.read_text(encoding="utf-8"), encoding="utf-8")
    code = (
        f"import json, sys; sys.path.insert(0, {str(tmp_path)!r}); import verification;"
        "print(verification.verify(json.load(sys.stdin)).cells, any(x in sys.modules for x in ('jax', 'numpy', 'jhd')))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code], input=json.dumps(arch()), capture_output=True, text=True, check=False
    )
    assert (done.stdout.split(), done.stderr) == (["3", "False"], "")


def test_the_checker_is_a_program(tmp_path):
    broken = changed(arch(), ("claim", "upper"), arch()["claim"]["upper"] * 0.99)
    files = {
        "good": json.dumps(arch()),
        "bad": json.dumps(broken),
        "torn": json.dumps(arch())[:-9],
        "deep": "[" * 10**5,
    }
    files["twice"] = '{"claim": 1, "claim": 1}'
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")

    def run(*names):
        arguments = [sys.executable, "-I", "-S", str(FILE), *names]
        return subprocess.run(arguments, capture_output=True, text=True, check=False, cwd=tmp_path)

    done = run("good")
    assert done.returncode == 0 and done.stderr == ""
    assert done.stdout.startswith("proven: good: ") and done.stdout.endswith("3 cells\n")
    done = run("good", "bad", "twice")
    assert done.returncode == 1 and done.stderr.count("refused: ") == 2 and done.stdout.count("proven") == 1
    done = run("torn", "deep", "missing", "good")
    assert done.returncode == 2 and done.stderr.count("not read: ") == 3 and done.stdout.count("proven") == 1
    assert run().returncode == 2
