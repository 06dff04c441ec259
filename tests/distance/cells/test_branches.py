"""The upper bound of a cell: above the exact distance at every point of it, and sharp where cells are cut."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.cells.branches import (
    CurveCell,
    _FollowedBranch,
    _split_bound,
    cell_upper_bound,
    first_upper_bound,
)
from jhd._distance.nearest.curves import nearest
from jhd._distance.normalization.jets import jet
from tests.distance import exact

KINDS = ("smooth", "rational", "close", "extreme_weights")
bound = jax.jit(cell_upper_bound)
first = jax.jit(first_upper_bound)
find = jax.jit(lambda point, b: nearest(point, b.control_points, b.weights))


def pair(kind, seed):
    """Two single cubics with coordinates in [-1, 1]."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    a = rng.uniform(-1, 1, (1, 4, 2))
    b = np.clip(a + 1e-9 * rng.normal(size=a.shape), -1, 1) if kind == "close" else rng.uniform(-1, 1, (1, 4, 2))
    if kind in ("smooth", "close"):
        return jhd.BezierSegments(a), jhd.BezierSegments(b)
    spread = 1.0 if kind == "rational" else 7.0
    weights = np.exp(rng.uniform(-spread, spread, (2, 1, 4)))
    return jhd.BezierSegments(a, weights[0]), jhd.BezierSegments(b, weights[1])


def cell_of(a, b, t0, t1):
    """The cell [t0, t1] of the first segment with the nearest feet of its ends."""
    ends = jnp.array([t0, t1])
    points = jax.vmap(lambda t: jet(a.control_points[0], None if a.weights is None else a.weights[0], t).point)(ends)
    feet = [find(point, b) for point in points]
    numbers = (0, t0, t1, feet[0].segment, feet[0].t, feet[1].segment, feet[1].t)
    return CurveCell(*(jnp.asarray(x) for x in numbers))


def exact_distance_sq(a, b, t):
    """The squared distance from a's point at the fraction t, at most: refined in rationals from the best of samples."""
    weights = [None if c.weights is None else np.asarray(c.weights)[0] for c in (a, b)]
    query = exact.point(np.asarray(a.control_points)[0], weights[0], t)
    near = find(jnp.array([float(x) for x in query]), b)
    return exact.minimum_near(query, np.asarray(b.control_points)[0], weights[1], float(near.t))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(6))
def test_both_bounds_are_above_the_exact_distance(kind, seed):
    a, b = pair(kind, seed)
    t0, t1 = [(0.0, 1.0), (0.25, 0.75), (0.4, 0.41), (0.3, 0.3 + 1e-6), (0.0, 0.125), (0.5, 1.0)][seed]
    cell = cell_of(a, b, t0, t1)
    for upper in (bound(a, b, cell).upper, first(a, b, cell)):
        for share in (0, Fraction(1, 7), Fraction(1, 2), Fraction(6, 7), 1):
            t = Fraction(t0) + share * (Fraction(t1) - Fraction(t0))
            assert exact_distance_sq(a, b, t) <= Fraction(float(upper)) ** 2


@pytest.mark.parametrize("rising", [True, False])
def test_the_bound_is_the_larger_one_of_both_halves_wherever_the_cell_is_split(rising):
    ends = jnp.array([[0.0, 0.0], [0.0, 1.0]])
    e = jnp.stack([ends if rising else ends[::-1]] * 2)
    both = _FollowedBranch(e, None, jnp.zeros(2), jnp.zeros(2))
    assert 1.0 <= float(_split_bound(both, jnp.array(0.5), 1, 1)) <= 1.0 + 1e-12


def test_the_bound_is_exact_at_an_antipodal_peak():
    # The distance from the arch to the line is its height, 3/4 in the middle.
    arch = jhd.BezierSegments([[(-1, 0), (-0.5, 1), (0.5, 1), (1, 0)]])
    line = jhd.BezierSegments([[(-1, 0), (-1 / 3, 0), (1 / 3, 0), (1, 0)]])
    found = bound(arch, line, cell_of(arch, line, 0.0, 1.0))
    assert float(found.t) == pytest.approx(0.5, abs=1e-9)
    assert 0.75 <= float(found.upper) <= 0.75 + 1e-13


def test_the_bound_is_exact_at_a_crossing_of_two_branches():
    # From the middle of the segment both arms of the parabola are sqrt(7)/2 away.
    segment = jhd.BezierSegments([[(-0.5, 2), (-1 / 6, 2), (1 / 6, 2), (0.5, 2)]])
    parabola = jhd.BezierSegments([[(-2, 4), (0, -4), (2, 4)]]).elevate(3)
    found = bound(segment, parabola, cell_of(segment, parabola, 0.25, 0.75))
    assert float(found.t) == pytest.approx(0.5, abs=1e-9)
    assert 7**0.5 / 2 - 1e-15 <= float(found.upper) <= 7**0.5 / 2 + 1e-3


@pytest.mark.slow
def test_a_circle_against_itself_turned_is_bounded_by_its_rounding():
    # A Moebius map carries one rational parametrization of a circle exactly into another.
    circle = jhd.circle((0, 0), 1.0)
    turn = np.array([[np.cos(0.2), -np.sin(0.2)], [np.sin(0.2), np.cos(0.2)]])
    turned = circle.transform(turn)
    solution = jhd.directed_hausdorff(turned, circle)
    rows = np.concatenate([np.asarray(c.control_points).reshape(-1, 2) for c in (circle, turned)])
    assert solution.upper <= 1e-10 * np.linalg.norm(np.ptp(rows, axis=0))
    assert solution.stats["cells"] <= 200
