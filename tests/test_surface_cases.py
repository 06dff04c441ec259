"""The table of pairs of surfaces: what it says fits together, and dense samples do not refute it."""

from decimal import Decimal
from functools import partial
from math import comb

import jax.numpy as jnp
import numpy as np
import pytest
from mpmath import mp, mpf
from scipy.spatial import KDTree

from jhd._distance.nearest.surface_points import local_feet
from jhd._distance.normalization.surfaces import Side
from jhd._runtime.compiled import compiled
from tests.surface_cases import CASES
from tests.surface_reference import cloud, solve, values

TAGS = {
    *("smooth", "clipped", "two_foot", "three_foot", "degenerate", "singular", "tangent", "symmetric", "ghost"),
    *("boxes", "far", "scale", "close", "coincident"),
}
DIRECTIONS = [(case, turned) for case in CASES for turned in (False, True)]
# Largest error of a value at a rounded point, in units of the sum of its terms.
_ROUNDING = 1e-14
# Feet of samples satisfy the polynomial to this share of its terms.
_ON_SURFACE = 1e-12
_BLOCK = 512
_feet = compiled(partial(local_feet, steps=16))


def name_of(direction):
    return f"{direction[0].name}-{'ba' if direction[1] else 'ab'}"


def parts(direction):
    case, turned = direction
    return (case.b, case.a, case.ba) if turned else (case.a, case.b, case.ab)


def size(surface):
    return max(np.subtract(surface.upper, surface.lower))


def terms(surface, points):
    """Sums of the sizes of all terms of the polynomial."""
    return values(np.abs(surface.coefficients), np.abs(points))


def some_of(directions, quick=0):
    """Directions as parameters: the first ones are quick, of the others each eighth is slow and the rest exhaustive."""
    marks = [() if k < quick else pytest.mark.exhaustive if (k - quick) % 8 else pytest.mark.slow for k in range(999)]
    return [pytest.param(d, marks=mark, id=name_of(d)) for d, mark in zip(directions, marks, strict=False)]


def test_there_are_enough_cases_of_every_kind():
    assert len(CASES) >= 24 and len({case.name for case in CASES}) == len(CASES)
    assert {tag for case in CASES for tag in case.tags} == TAGS
    digits = [
        Decimal(m.value) for case in CASES for m in (case.ab, case.ba) if m.point and m.value not in ("1.0", "0.875")
    ]
    assert all(len(x.as_tuple().digits) >= 30 for x in digits)


@pytest.mark.parametrize("direction", DIRECTIONS, ids=name_of)
def test_points_and_feet_lie_on_their_surfaces_at_the_distance(direction):
    a, b, maximum = parts(direction)
    if maximum.point is None:
        assert direction[0].tags & {"degenerate", "singular", "symmetric"}
        return
    places = np.array([maximum.point, *maximum.feet])
    for surface, x in ((a, places[:1]), (b, places[1:])):
        assert np.all((x >= surface.lower) & (x <= surface.upper))
        assert np.all(np.abs(values(surface.coefficients, x)) <= _ROUNDING * terms(surface, x))
    exact = float(maximum.value)
    apart = np.linalg.norm(places[1:] - places[0], axis=1)
    np.testing.assert_allclose(apart, exact, rtol=1e-14, atol=1e-15 * np.max(np.abs(places)))
    assert {2: "two_foot", 3: "three_foot"}.get(len(maximum.feet), None) in (None, *direction[0].tags)


@pytest.mark.parametrize("direction", some_of(DIRECTIONS, 8))
def test_coarse_samples_agree_with_the_values(direction):
    """A sample is off by no more than the diagonals of the cells of both grids."""
    a, b, maximum = parts(direction)
    if "far" in direction[0].tags:
        a, b = (recentered(surface, direction[0]) for surface in (a, b))
    cells = 12
    distances, _ = KDTree(cloud(b, cells)).query(cloud(a, cells))
    slack = 2 * 3**0.5 * (size(a) + size(b)) / cells
    assert abs(np.max(distances) - float(maximum.value)) <= slack


def recentered(surface, case):
    """A far surface brought back, exactly."""
    offset = (np.array(case.a.lower) + np.array(case.a.upper)) / 2
    f = surface.coefficients
    # Of degree two: the value, the slopes and the curvatures at the new origin.
    grid = np.zeros((3, 3, 3))
    exact = {powers: mpf(c) for powers, c in np.ndenumerate(f) if c}
    with mp.workdps(60):
        for powers in np.ndindex(3, 3, 3):
            grid[powers] = float(
                mp.fsum(  # pyright: ignore[reportArgumentType]
                    c * mp.fprod(comb(n, k) * mpf(t) ** (n - k) for n, k, t in zip(q, powers, offset, strict=True))
                    for q, c in exact.items()
                    if all(n >= k for n, k in zip(q, powers, strict=True))
                )
            )
    return type(surface)(grid, tuple(np.array(surface.lower) - offset), tuple(np.array(surface.upper) - offset))


@pytest.mark.parametrize("direction", some_of(d for d in DIRECTIONS if parts(d)[2].point is not None))
def test_the_digits_are_those_of_the_lagrange_system(direction):
    a, b, maximum = parts(direction)
    known = solve(a, b, maximum.point, maximum.feet)
    with mp.workdps(60):
        assert abs(known.value - mpf(maximum.value)) <= mpf(10) ** -32 * known.value
    assert all(w > 0 for w in known.weights) and all(x >= -1e-15 for x in known.faces)


@pytest.mark.parametrize("direction", some_of(d for d in DIRECTIONS if "far" not in d[0].tags))
def test_dense_samples_find_nothing_farther_and_no_nearer_foot(direction):
    """Every foot is a point of b, so that its distance bounds that of the sample, whatever found it."""
    a, b, maximum = parts(direction)
    exact, scale = float(maximum.value), max(size(a), size(b))
    points, sample = cloud(a, 56), cloud(b, 56)
    tree = KDTree(sample)
    if maximum.point is not None:
        assert tree.query(maximum.point)[0] >= exact - 1e-12 * scale
    nearest, _ = tree.query(points)
    order = np.argsort(-nearest)[:_BLOCK]
    _, starts = tree.query(points[order], k=3)
    shape = 3 if max(b.coefficients.shape) <= 3 else 5
    f = np.pad(b.coefficients, [(0, shape - n) for n in b.coefficients.shape])
    side = Side(f, np.zeros_like(f), np.array(b.lower, float), np.array(b.upper, float), np.zeros((3, 3, 3), bool))
    bound = nearest[order]
    for start in np.asarray(starts).T:
        rows = [jnp.asarray(np.resize(x, (_BLOCK, 3)).T) for x in (points[order], sample[start])]
        foot = np.asarray(_feet(side, *rows)).T[: len(order)]
        on = np.abs(values(b.coefficients, foot)) <= _ON_SURFACE * terms(b, foot)
        bound = np.where(on, np.minimum(bound, np.linalg.norm(foot - points[order], axis=1)), bound)
    assert np.max(bound) <= exact + 1e-10 * scale
    # What was not looked at lies nearer than the sample's own bound.
    rest = np.sort(nearest)[::-1][_BLOCK:]
    assert len(rest) == 0 or rest[0] <= exact + 0.01 * scale
    assert np.max(bound) >= exact - 0.02 * scale
