"""Kernels in narrow formats: what they are seen to err by is below the derived errors, and below the constants.

With few digits roundings are large beside everything else, and where all of them go one way they add up. A number that
is rounded one way is off by as much as one rounded to nearest with a digit less.
"""

from itertools import product

import numpy as np
import pytest

from jhd._arithmetic import bernstein, rounding
from tests.rounding import curve_kernels, shape_kernels
from tests.rounding.enclosed import Enclosed
from tests.rounding.interpreter import evaluate
from tests.rounding.margins import traced_anew
from tests.rounding.numbers import Rounded

# Digits of the format in which all numbers of a grid are tried, and of that in which bounds have room for constants.
FEW, SOME = 8, 17
# Derived errors are no wild guess: this share of the largest one is seen.
SEEN = 0.15
# As exact as needed beside these.
EXACT = Rounded(53)
WAYS = ("nearest", "down", "up", "zero", "away")


def format_of(digits, way):
    """A format whose roundings are at most 2^-digits, the way they go."""
    return Rounded(digits + (way != "nearest"), way)


def value(c, t):
    return bernstein.evaluate(c, t, axis=0)


def part(c, t):
    return bernstein.restrict(c, t[0], t[1], axis=0)


def product_of(f, g):
    return bernstein.multiply(f.T, g.T)


GRID = np.array([-1, -0.6875, -0.125, 0.3125, 0.8125, 1])
SHARES = np.array([0, 0.1875, 0.5, 0.6875, 1])
LINES, CURVES = (np.array(list(product(GRID, repeat=n))).T for n in (2, 4))
FORMS = {
    "value": (value, [np.repeat(CURVES, len(SHARES), axis=1), np.tile(SHARES, CURVES.shape[1])]),
    "part": (part, [CURVES, np.array([0.1875, 0.6875])]),
    "product": (
        product_of,
        [np.repeat(LINES, LINES.shape[1], axis=1), np.tile(LINES, LINES.shape[1])],
    ),
}


@pytest.mark.parametrize("name", FORMS)
def test_on_all_numbers_of_a_grid_errors_are_below_the_derived_ones(name):
    function, inputs = FORMS[name]
    inputs = [x.astype(np.float32) for x in inputs]
    derived = evaluate(function, Enclosed(2.0**-FEW, 0.0), inputs, [None] * len(inputs)).error
    exact = evaluate(function, EXACT, inputs, [None] * len(inputs))
    seen = [abs(evaluate(function, format_of(FEW, way), inputs, [None] * len(inputs)) - exact) for way in WAYS]
    assert np.all(np.max(seen, axis=0) <= derived)
    assert np.max(seen) >= SEEN * np.max(derived)


def room_of(function, inputs, modules, sign, monkeypatch):
    """The least that a bound with constants for the narrow format is beyond the exact one without any, of all ways."""
    inputs = [Rounded(SOME - 1).rounded(np.asarray(x, float)).astype(np.float32) for x in inputs]
    nothing = [None] * len(inputs)
    with traced_anew(modules, False):
        exact = evaluate(lambda *x: function(*x), EXACT, inputs, nothing)
    monkeypatch.setattr(rounding, "unit_roundoff", lambda dtype: 2.0**-SOME)
    for module in modules:
        if hasattr(module, "unit_roundoff"):
            monkeypatch.setattr(module, "unit_roundoff", lambda dtype: 2.0**-SOME)
    with traced_anew(modules, True):
        found = [evaluate(lambda *x: function(*x), format_of(SOME, way), inputs, nothing) for way in WAYS]
    return np.min(sign * (np.array(found) - exact))


@pytest.mark.slow
@pytest.mark.parametrize("rational", (False, True))
@pytest.mark.parametrize("name", curve_kernels.BOUNDS)
def test_bounds_of_cells_of_curves_hold_in_a_narrow_format(name, rational, monkeypatch):
    function, modules, sign = curve_kernels.BOUNDS[name]
    pairs = curve_kernels.Pairs((2, 1), 2, rational)
    assert room_of(function, pairs.inputs, modules, sign, monkeypatch) >= 0


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in shape_kernels.BOUNDS if name not in shape_kernels.SLOW])
def test_bounds_of_kernels_hold_in_a_narrow_format(name, monkeypatch):
    function, inputs, modules, sign = shape_kernels.BOUNDS[name]
    assert room_of(function, inputs, modules, sign, monkeypatch) >= 0
