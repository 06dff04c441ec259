"""The cases of the table as curves of the package, grouped by the compiled programs that they share."""

from decimal import Decimal
from fractions import Fraction
from functools import cache

import numpy as np

import jhd
from jhd._distance.normalization.curves import padded_count, raised_degree
from tests import reference
from tests.cases import CASES
from tests.sweeps import swept

BY_NAME = {case.name: case for case in CASES}
# Sizes whose programs the quick tests compile: segments of at most degree 3, at most four of them.
QUICK_DEGREE, QUICK_COUNT = 3, 4
# Numbers of segments of curves that take programs of their own: each method compiles one for each of these.
SIZES = (QUICK_COUNT, 96)
# One pair of each kind that needs programs of its own: contours, weights in space at a higher degree, long splines.
FURTHER = ("letter_contours", "rational_space_curves", "splines_90")
FURTHER_WAYS = [(name, "ba" if k % 2 else "ab") for k, name in enumerate(FURTHER)]


def curve(shape, rational=False):
    """The stored arrays as a curve; weights of one are added where asked for, which change no point."""
    weights = shape.weights
    if rational and weights is None:
        weights = np.ones(shape.control_points.shape[:-1])
    return jhd.BezierSegments(shape.control_points, weights)


def both(case):
    """The two curves, both rational if one is."""
    rational = case.a.weights is not None or case.b.weights is not None
    return curve(case.a, rational), curve(case.b, rational)


def is_quick(case):
    """Whether the pair runs in one of the few programs that the quick tests compile."""
    a, b = case.a.control_points.shape, case.b.control_points.shape
    small = max(a[1], b[1]) <= QUICK_DEGREE + 1 and max(a[0], b[0]) <= QUICK_COUNT
    # The least sizes that there are: of the search, and of methods and traced programs whose small sizes stay small.
    assert (raised_degree(0), padded_count(1, small=True)) == (QUICK_DEGREE, QUICK_COUNT)
    assert padded_count(QUICK_COUNT) == padded_count(1)
    return small and a[2] == 2


def parameters(cases, directions=("ab", "ba")):
    """Pairs of a name and a direction; of those that need a program of their own one of each kind is slow."""
    ways = [(case.name, direction) for case in cases for direction in directions]
    return swept(ways, [w for w in ways if is_quick(BY_NAME[w[0]])], [w for w in FURTHER_WAYS if w in ways])


def of_each_tag(cases):
    """The names of the first of these cases that has a tag, for all tags."""
    tags = sorted(set().union(*(case.tags for case in cases)))
    return {next(case.name for case in cases if tag in case.tags) for tag in tags}


def in_order(name, direction):
    """Both shapes of a case in the order of the direction, and what the table knows of their directed distance."""
    case = BY_NAME[name]
    return (case.a, case.b, case.exact_ab) if direction == "ab" else (case.b, case.a, case.exact_ba)


def bounds(exact):
    """The known value as an interval of fractions; decimals of 30 digits are taken as they are."""
    if isinstance(exact, tuple):
        return Fraction(exact[0]), Fraction(exact[1])
    return Fraction(Decimal(exact)), Fraction(Decimal(exact))


def of_one_size(case):
    """The two curves, which repeat their last segments up to one of two numbers: few programs for the whole table."""
    a, b = both(case)
    count = next(size for size in SIZES if size >= max(a.count, b.count))
    return a.pad(count), b.pad(count)


@cache
def solved(name, direction="ab"):
    """The directed distance of a case by the two-step method, once for all tests."""
    a, b = of_one_size(BY_NAME[name])
    return jhd.directed_hausdorff(*((a, b) if direction == "ab" else (b, a)), jhd.published.TwoStep())


def diagonal(name):
    """The unit of the accuracies: the diagonal of the box of both curves."""
    case = BY_NAME[name]
    return reference.diagonal(case.a, case.b)
