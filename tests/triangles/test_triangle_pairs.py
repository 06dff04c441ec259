"""Distances of triangles: the exact ones carry their own proof, and those in floating point enclose them."""

from fractions import Fraction

import jax
import numpy as np
import pytest

from jhd._triangles.exact_triangles import exact_pair
from jhd._triangles.triangle_pairs import lower_bounds, pair_bounds
from tests.sweeps import swept
from tests.triangles.exact_triangles import hard_triangles

COUNT = 96
# Fair triangles that are apart by about one are known to this many digits.
CLOSE = 1e-13


def hard_pairs(seed, count=COUNT):
    """Pairs of triangles at all distances: apart, close, sharing corners, in one plane, through each other."""
    rng = np.random.default_rng(seed)
    a, b = hard_triangles(rng, count), hard_triangles(rng, count)[::-1].copy()
    kind = np.arange(count) % 7
    b[kind == 1] += 10.0 ** rng.uniform(-15, 1, (np.sum(kind == 1), 1, 1))
    b[kind == 2, 0] = a[kind == 2, 1]
    b[kind == 3, :, 2] = a[kind == 3, :, 2] = 0.25
    b[kind == 4] = a[kind == 4] + np.array([0, 0, 1]) * 10.0 ** rng.uniform(-16, 0, (np.sum(kind == 4), 1, 1))
    b[kind == 5] = a[kind == 5][:, ::-1]
    b[kind == 6] += 1e6
    size = np.abs(np.concatenate([a, b])).max()
    return a / 2 ** np.ceil(np.log2(size)), b / 2 ** np.ceil(np.log2(size))


def beside_corners(seed):
    """Pairs whose nearest points are a corner of each, closer to each other than to the corners that are given first.

    Errors of the gap then have either sign; between parallel faces the extreme corners hide them.
    """
    rng = np.random.default_rng(seed)
    towards = rng.normal(size=(COUNT, 1, 3))
    towards /= np.linalg.norm(towards, axis=2, keepdims=True)
    arms = np.array([1.0, 0.0, 0.5])[:, None] * (towards + 0.2 * rng.uniform(-1, 1, (2, COUNT, 3, 3)))
    b = rng.uniform(-0.1, 0.1, (COUNT, 1, 3)) + 0.4 * arms[0]
    return b[:, 1:2] - 10.0 ** rng.uniform(-15, -8, (COUNT, 1, 1)) * towards - 0.4 * arms[1], b


def fractions(rows):
    return [[Fraction(float(x)) for x in row] for row in rows]


def combined(weights, corners):
    assert sum(weights) == 1 and min(weights) >= 0
    return [sum(w * corner[k] for w, corner in zip(weights, corners, strict=True)) for k in range(3)]


def is_nearest(a, b, found):
    """Whether two points are nearest: the planes through them across the line that joins them part the triangles."""
    a, b = fractions(a), fractions(b)
    p, q = combined(found.weights_a, a), combined(found.weights_b, b)
    e = [x - y for x, y in zip(p, q, strict=True)]
    beyond = [sum(x * (y - z) for x, y, z in zip(e, corner, p, strict=True)) for corner in a]
    before = [sum(x * (y - z) for x, y, z in zip(e, corner, q, strict=True)) for corner in b]
    return min(beyond) >= 0 and max(before) <= 0 and sum(x * x for x in e) == found.square


@pytest.mark.parametrize("seed", range(2))
def test_exact_pairs_are_nearest_by_a_proof_that_knows_nothing_of_how_they_were_found(seed):
    a, b = hard_pairs(seed)
    assert all(is_nearest(x, y, exact_pair(x, y)) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize(
    ("b", "square"),
    [
        ([[1, 1, 1], [1, 1, 2], [2, 1, 1]], 1),  # the foot is inside
        ([[1, 1, -1], [1, 1, 2], [1, 2, 1]], 0),  # an edge goes through the face
        ([[4, 0, 0], [8, 0, 0], [8, 4, 0]], 0),  # a corner is shared
        ([[5, 0, 0], [8, 0, 0], [8, 4, 0]], 1),  # in one plane
        ([[2, 2, 0], [5, 5, 0], [5, 4, 0]], 0),  # a corner on an edge
        ([[1, 1, 0], [1, 1, 0], [1, 1, 0]], 0),  # a point in the face
        ([[1, 1, -1], [1, 1, 1], [1, 1, 1]], 0),  # a segment through the face
        ([[6, 0, -1], [6, 0, 1], [6, 0, 1]], 4),  # a segment beside it
        ([[-1, -1, 0], [9, -1, 0], [-1, 9, 0]], 0),  # one inside the other
        ([[2, -1, 3], [2, 5, 3], [2, 2, 9]], 9),
    ],
)
def test_distances_of_integers(b, square):
    a = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
    for turned in (b, b[::-1], b[1:] + b[:1]):
        assert exact_pair(a, np.array(turned)).square == square == exact_pair(np.array(turned), a).square


def test_numbers_at_both_ends_of_the_range_are_measured():
    a, b = np.full((3, 3), 2.0**1000), np.full((3, 3), 2.0**-1070)
    gap = Fraction(2) ** 1000 - Fraction(2) ** -1070
    assert exact_pair(a, b).square == 3 * gap**2


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("seed", swept([2, 3], 1))
def test_bounds_hold_the_exact_distance(seed, dtype):
    hard = zip(hard_pairs(seed), beside_corners(seed), strict=True)
    a, b = (np.concatenate(x).astype(dtype) for x in hard)
    rows = [np.moveaxis(x, 0, -1) for x in (a, b)]
    found, quick = jax.jit(pair_bounds)(*rows), np.asarray(jax.jit(lower_bounds)(*rows))
    for k, square in enumerate(exact_pair(x, y).square for x, y in zip(a, b, strict=True)):
        for low in (found.lower[k], quick[k]):
            assert low >= 0 and Fraction(float(low)) ** 2 <= square
        assert Fraction(float(found.upper[k])) ** 2 >= square
        assert square > 0 or found.gap[k] <= CLOSE or dtype == np.float32


def test_fair_triangles_are_known_to_the_last_digits():
    rng = np.random.default_rng(7)
    a, b = rng.uniform(-0.5, 0.5, (2, 3, 3, COUNT))
    found = jax.jit(pair_bounds)(a, b)
    apart = np.asarray(found.gap) > 1e-3
    assert apart.sum() > COUNT // 4 and np.all((found.upper - found.lower)[apart] < CLOSE)
