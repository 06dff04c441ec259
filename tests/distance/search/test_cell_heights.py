"""Bounds over cells by heights, of random shapes beside each other: against dense sums of proven distances."""

from functools import partial
from typing import Any

import numpy as np
import pytest

import jhd
from jhd._distance.cells.mean_bounds import NEAR, distances_over
from jhd._distance.deviation import in_space
from jhd._distance.search.body import together
from tests.distance.test_nonisolated_maxima import torus
from tests.sweeps import swept

GRID = np.linspace(0, 1, 4)
# Places of Gauss along a parameter: where feet jump, or distances have kinks, two rules tell what the finer one is off
# by, nearly, and this is the share of what distances vary that is added to it.
NODES, FEW, ROOM = 20, 8, 5e-4
PAIRS = [
    ("bicubic", "triangles"),
    ("bicubic", "patches"),
    ("rational", "curves"),
    ("folded", "triangles"),
    ("pole", "triangles"),
    ("crease", "patches"),
    ("torus", "triangles"),
    ("torus", "rational patches"),
    ("curve", "curves"),
    ("rational curve", "triangles"),
    ("mesh", "patches"),
    ("mesh", "curves"),
]


def shape(random: np.random.Generator, kind: str) -> Any:
    x, y = np.meshgrid(GRID, GRID, indexing="ij")
    net = np.stack([x, y, 0 * x], axis=-1) + random.normal(size=(4, 4, 3)) * [0.06, 0.06, 0.15]
    if kind == "pole":
        net[0] = net[0, 0]
    if kind == "folded":
        net = 0.5 * random.normal(size=(4, 4, 3))
    if kind == "crease":
        sides = [np.stack([0.5 * (x + k - 1), y, np.abs(0.4 * (x + k - 1))], axis=-1) for k in range(2)]
        return jhd.BezierPatches(np.stack(sides))
    if kind == "torus":
        return torus(0.4)
    if kind.endswith("curve"):
        return jhd.BezierCurve(0.5 * random.normal(size=(4, 3)), random.uniform(0.3, 3, 4) if " " in kind else None)
    if kind == "mesh":
        index = np.arange(16).reshape(4, 4)
        faces = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:]], axis=-1).reshape(-1, 3)
        return jhd.TriangleMesh(net.reshape(-1, 3), faces)
    return jhd.BezierPatch(net, random.uniform(0.3, 3, (4, 4)) if kind == "rational" else None)


def beside(random: np.random.Generator, b: Any, kind: str) -> Any:
    """Small pieces near a place of b, above it by about the square of their size."""
    low, high = (np.asarray(end) for end in b.bounds)
    place = jhd.project(random.uniform(low, high, (8, 3)), b).foot
    size = 10.0 ** random.uniform(-2, -0.5)
    u, v = np.linspace(0, 1, 3)[:, None], np.linspace(0, 1, 3)
    rows = []
    for middle in np.asarray(place):
        ends = np.asarray(jhd.project(middle + size * random.normal(size=(4, 3)), b).foot)
        ends = ends + size**2 * random.normal(size=(4, 3))
        shares = [(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v]
        rows.append(sum(share[..., None] * end for share, end in zip(shares, ends, strict=True)))
    net = np.stack(rows)
    if kind == "triangles":
        return jhd.TriangleMesh(net[:, [0, 0, 2], [0, 2, 0]].reshape(-1, 3), np.arange(24).reshape(-1, 3))
    if kind == "curves":
        return jhd.BezierSegments(net[:, :, 1])
    net = net + 0.3 * size**2 * random.normal(size=net.shape)
    return jhd.BezierPatches(net, random.uniform(0.5, 2, net.shape[:3]) if kind == "rational patches" else None)


def nodes(shape: Any, moved: Any, cells: Any, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (cells, places, 3) of the cells in common coordinates, and the shares of the places."""
    x, w = np.polynomial.legendre.leggauss(count)
    x, w = 0.5 * (x + 1), 0.5 * w
    low, size = cells.low[:, None], (cells.high - cells.low)[:, None]
    if cells.low.shape[1] == 1:
        segments = jhd.BezierSegments(moved.points[:, :, 0])
        return np.asarray(segments.point(cells.piece[:, None], low[..., 0] + size[..., 0] * x)), w
    u, v, shares = np.repeat(x, count), np.tile(x, count), np.outer(w, w).ravel()
    if isinstance(shape, jhd.TriangleMesh):
        v, shares = v * (1 - u), shares * (1 - u) * 2
        corners = moved[np.asarray(shape.triangles)][cells.piece][:, None]
        s, t = (low[..., k] + size[..., k] * z for k, z in enumerate((u, v)))
        steps = [corners[:, :, k] - corners[:, :, 0] for k in (1, 2)]
        return corners[:, :, 0] + s[..., None] * steps[0] + t[..., None] * steps[1], shares
    patches = jhd.BezierPatches(moved.points, moved.weights)
    s, t = (low[..., k] + size[..., k] * z for k, z in enumerate((u, v)))
    return np.asarray(patches.point(cells.piece[:, None], s, t)), shares


@pytest.mark.parametrize(
    ("kind", "source"),
    swept(PAIRS, slow=[("curve", "curves")]),
)
def test_bounds_hold_beside_shapes_of_all_kinds(kind, source):
    random = np.random.default_rng(100 * len(kind) + len(source))
    b = in_space(shape(random, kind))
    a = in_space(beside(random, b.shape, source))
    pair = together(a, b)
    measured, target = a.measured(pair.a, pair.moved, None), b.target_in(pair.b)[0]
    heights, cells = a.heights(b, pair, target), measured.cover()
    assert heights is not None
    for _ in range(2):
        flat = measured.flat(cells)
        near = np.full(len(cells.piece), NEAR)
        over = distances_over(flat, target, np.dtype(float), near, 1e-9, partial(heights.over, cells))
        found = target.near(np.mean(flat.corners, axis=1))
        even = heights.over(cells, flat, type(found)(*(np.array(x) for x in found)), over.upper)
        sums = []
        for count in (FEW, NODES):
            points, shares = nodes(a.shape, pair.a, cells, count)
            proven = target.nearest(points.reshape(-1, 3))
            distance = 0.5 * (proven.lower + proven.upper).reshape(points.shape[:2])
            sums.append((distance @ shares, distance**2 @ shares))
        off = 1e-12 + np.max(proven.upper - proven.lower)
        for least, most in ((even.least, even.most), (over.lower, over.upper)):
            assert np.all(least <= np.min(distance, axis=1) + off) and np.all(np.max(distance, axis=1) - off <= most)
        (coarse, coarse_square), (mean, square) = sums
        room = np.abs(mean - coarse) + ROOM * np.std(distance, axis=1) + off
        wide = np.abs(square - coarse_square) + 2 * np.max(distance, axis=1) * room
        assert np.all(even.least_mean <= mean + room) and np.all(mean - room <= even.most_mean)
        assert np.all(even.least_square <= square + wide) and np.all(square - wide <= even.most_square)
        cells, _ = measured.cut(cells, flat)


@pytest.mark.slow
def test_gaps_over_triangles_beside_a_paraboloid_fall_with_the_fourth_power():
    ends = {-1.0: 1.0, 0.0: -1.0, 1.0: 1.0}
    b = in_space(jhd.BezierPatch([[[x, y, ends[x] + ends[y]] for y in ends] for x in ends]))
    gaps = []
    for size in (0.1, 0.05, 0.025):
        corners = np.array([[0.2, 0.1], [0.2 + size, 0.1], [0.2, 0.1 + size]])
        corners = np.column_stack([corners, np.sum(corners**2, axis=1)])
        # The middle part, where the distance is nowhere zero.
        a = in_space(jhd.TriangleMesh(0.5 * (np.sum(corners, axis=0) - corners), [[0, 1, 2]]))
        pair = together(a, b)
        measured, target = a.measured(pair.a, pair.moved, None), b.target_in(pair.b)[0]
        heights, cells = a.heights(b, pair, target), measured.cover()
        assert heights is not None
        near = np.full(1, NEAR)
        bounds = partial(heights.over, cells)
        over = distances_over(measured.flat(cells), target, np.dtype(float), near, 1e-9, bounds)
        gaps.append(float(over.mean[0, 1] - over.mean[0, 0]))
    assert gaps[1] < gaps[0] / 10 and gaps[2] < gaps[1] / 10 and gaps[0] < 1e-4
