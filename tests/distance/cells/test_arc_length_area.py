"""Lengths and areas of parts, and flat pieces beside them, against dense sums."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import jhd
from jhd._distance.cells.arc_length_area import off_by, restricted
from jhd._distance.normalization.net_jets import Net
from jhd._distance.search.weighted_cells import MeasuredNet

GRID = 200


def pieces(rows, columns, rational, seed) -> Any:
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.linspace(-0.4, 0.4, rows), np.linspace(-0.4, 0.4, columns), indexing="ij")
    points = np.stack([u, v, 0 * u], axis=-1) + 0.1 * rng.normal(size=(rows, columns, 3))
    return points[None], rng.uniform(0.5, 1.0, (1, rows, columns)) if rational else None


def samples(points, weights):
    """Points on a grid of parameters, at the corners of its cells."""
    t = np.linspace(0, 1, GRID + 1)
    if points.shape[2] == 1:
        curve = jhd.BezierSegments(points[:, :, 0], None if weights is None else weights[:, :, 0])
        return np.asarray(curve(t))[:, None]
    return np.asarray(jhd.BezierPatch(points[0], None if weights is None else weights[0])(t[:, None], t))


def dense(points):
    """Sums of chords, or of the areas of the triangles of a grid."""
    if points.shape[1] == 1:
        return np.sum(np.linalg.norm(np.diff(points[:, 0], axis=0), axis=-1))
    p, q, r, s = points[:-1, :-1], points[1:, :-1], points[:-1, 1:], points[1:, 1:]
    areas = [np.linalg.norm(np.cross(x - z, y - z), axis=-1) for x, y, z in ((q, r, p), (q, r, s))]
    return 0.5 * sum(np.sum(x) for x in areas)


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize(("rows", "columns"), [(4, 1), (3, 1), (2, 2), (3, 4)])
def test_measures_enclose_dense_sums_and_close_with_the_square_of_the_size(rows, columns, rational):
    points, weights = pieces(rows, columns, rational, 8 * rows + columns)
    source = MeasuredNet(Net(points, weights), 1e-16)
    cells = source.cover()
    gaps = []
    for _ in range(5):
        flat = source.flat(cells)
        gaps.append(flat.upper.sum() - flat.lower.sum())
        cells, _ = source.cut(cells, flat)
    exact = dense(samples(points, weights))
    # Sums of chords and of flat triangles are off by the square of their size.
    room = 20 * exact / GRID**2
    assert flat.lower.sum() <= exact + room and exact - room <= flat.upper.sum()
    # Each cut into halves leaves a quarter, once the parts are small; cuts along one parameter alone leave more.
    assert gaps[-1] < 0.45 * gaps[-2] and gaps[-1] < 0.1 * exact


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize(("rows", "columns"), [(4, 1), (3, 4)])
def test_parts_are_as_near_to_their_flat_pieces_as_they_say(rows, columns, rational):
    points, weights = pieces(rows, columns, rational, rows)
    source = MeasuredNet(Net(points, weights), 1e-16)
    cells = source.cover()
    for _ in range(2):
        cells, _ = source.cut(cells, source.flat(cells))
    flat = source.flat(cells)
    on = samples(points, weights)
    t = np.linspace(0, 1, GRID + 1)
    for low, high, corners, slack in zip(cells.low, cells.high, flat.corners, flat.slack, strict=True):
        inside = [np.flatnonzero((t >= a) & (t <= b)) for a, b in zip(low, high, strict=True)]
        shares = [(t[k] - a) / (b - a) for k, a, b in zip(inside, low, high, strict=True)]
        if columns == 1:
            there = corners[0] + shares[0][:, None] * (corners[1] - corners[0])
            apart = np.linalg.norm(on[inside[0], 0] - there, axis=-1)
        else:
            u, v = shares[0][:, None, None], shares[1][None, :, None]
            there = corners[0] + u * (corners[2] - corners[0]) + v * (corners[1] - corners[0])
            apart = np.linalg.norm(on[np.ix_(*inside)] - there, axis=-1)
        assert np.max(apart) <= slack
        assert np.max(apart) > 0.1 * slack


def test_a_density_is_as_uneven_as_the_bound_says():
    # x = t + t^2 / 2 has the density (1 + t) / 1.5, whose distance from one is 1/6 in the mean.
    points: Any = np.array([[[[0, 0, 0]], [[0.5, 0, 0]], [[1.5, 0, 0]]]]) / 2
    source = MeasuredNet(Net(points, None), 0.0)
    flat = source.flat(source.cover())
    assert 1 / 6 <= flat.uneven[0] < 0.7
    assert flat.lower[0] <= 0.75 <= flat.upper[0] and flat.upper[0] - flat.lower[0] < 1e-10


def exactly_restricted(rows, low, high):
    """The coefficients on [low, high] as exact fractions, by blossoms."""
    found = []
    for j in range(len(rows)):
        c = [Fraction(float(x)) for x in rows]
        for k in range(len(rows) - 1):
            t = Fraction(float(low if k < len(rows) - 1 - j else high))
            c = [(1 - t) * x + t * y for x, y in zip(c, c[1:], strict=False)]
        found.append(c[0])
    return found


@pytest.mark.parametrize("degree", [1, 3, 12])
@pytest.mark.parametrize("ratio", [1.0, 1e8, 1e40])
def test_weights_of_parts_are_off_by_as_much_relative_to_them_however_uneven_they_are(degree, ratio):
    rows = ratio ** -np.linspace(0, 1, degree + 1)
    for low, high in ((0.25, 0.375), (1 - 2.0**-30, 1 - 2.0**-31), (1 - 2.0**-40, 1.0), (0.0, 2.0**-40), (0.7, 0.7)):
        for weights in (rows, rows[::-1]):
            part = restricted(weights[None, :, None, None], np.array([[low]]), np.array([[high]]))[0, :, 0, 0]
            for x, exact in zip(part, exactly_restricted(weights, low, high), strict=True):
                assert abs(Fraction(float(x)) - exact) <= Fraction(off_by((degree, 0))) * exact
