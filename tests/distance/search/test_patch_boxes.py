"""Boxes of parts of patches, and searches in which they rule out all but the part about a foot."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import jhd
from jhd._arithmetic.bernstein import basis
from jhd._distance.normalization.net_jets import Net
from jhd._distance.search import on_patches, patch_boxes
from jhd._distance.search.on_patches import NetTarget
from jhd._distance.search.patch_boxes import PatchBoxes, SettledParts
from tests.distance.test_nonisolated_maxima import sphere, torus
from tests.sweeps import swept

# More points than nodes are cut for, on more pieces than one box holds.
POINTS, PIECES, SAMPLES = 150, 20, 9
FLAT = np.stack([*np.meshgrid(np.arange(4.0), np.arange(4.0), indexing="ij"), np.zeros((4, 4))], axis=-1) / 3


BUMPS = FLAT * 3 + [0.0, 0.0, 0.2] * np.sin(FLAT[..., :1] * 6) * np.cos(FLAT[..., 1:2] * 4)


def net_of(points: Any, weights: Any = None) -> Net:
    return Net(points, weights)


def random_net(kind):
    rng = np.random.default_rng(len(kind))
    points = FLAT + 0.2 * rng.normal(size=(PIECES, 4, 4, 3)) + rng.uniform(-2, 2, (PIECES, 1, 1, 3))
    weights = 10.0 ** rng.uniform(-2, 0, points.shape[:-1]) if "rational" in kind else None
    if "collapsed" in kind:
        points[:, 0] = points[:, :1, 0]
        points[:5] = points[:5, :1, :1]
    if kind == "closed":
        points[:, -1], points[:, :, -1] = points[:, 0], points[:, :, 0]
    points = points[:, :, :1] if kind == "curves" else points
    return net_of(points / np.max(np.abs(points)), weights)


def points_of(net, x):
    """Points of all pieces at parameters (count, 2), (pieces, count, 3)."""
    weights = np.ones(net.points.shape[:-1]) if net.weights is None else net.weights
    along = np.einsum("ni,nj,kij->knij", *(basis(n, t) for n, t in zip(net.degrees, x.T, strict=True)), weights)
    return np.einsum("knij,kijd->knd", along, net.points) / np.sum(along, axis=(2, 3))[..., None]


@pytest.mark.parametrize("power", [0, 40])
@pytest.mark.parametrize("kind", ["surfaces", "rational", "collapsed", "rational collapsed", "closed", "curves"])
def test_every_point_within_the_distance_is_in_a_part_that_is_found_or_settled(kind, power):
    net, rng = random_net(kind), np.random.default_rng(1)
    n = net.parameters
    ends = np.linspace(0, 1, SAMPLES)
    x = np.stack(np.meshgrid(ends, ends if n == 2 else ends[:1], indexing="ij"), axis=-1).reshape(-1, 2)
    on = points_of(net, x)
    at = np.ldexp(on[rng.integers(0, PIECES, POINTS), rng.integers(0, len(x), POINTS)], -power)
    at += np.ldexp(rng.choice([0.0, 1e-9, 0.1, 3.0], (POINTS, 1)) * rng.normal(size=(POINTS, 3)), -power)
    far = np.linalg.norm(np.ldexp(on, -power)[None] - at[:, None, None], axis=-1)
    upper = np.min(far, axis=(1, 2)) * rng.uniform(1, 2, POINTS)
    piece = np.where(rng.uniform(size=POINTS) < 0.9, np.argmin(np.min(far, axis=2), axis=1), -1)
    low = rng.integers(0, 8, (POINTS, n)) / 8.0
    settled = SettledParts(piece, low, low + 0.125)
    boxes = PatchBoxes(net)
    found = boxes.near(at, upper, power, settled, upper)
    inside = np.all((x[:, :n] >= low[:, None]) & (x[:, :n] <= low[:, None] + 0.125), axis=2)
    missing = far <= upper[:, None, None]
    missing[np.arange(POINTS), piece] &= ~(inside & (piece >= 0)[:, None])
    for who, k, first, last, lower in zip(*found, strict=True):
        within = np.all((x[:, :n] >= first) & (x[:, :n] <= last), axis=1)
        missing[who, k] &= ~within
        assert np.all(lower <= far[who, k, within] * (1 + 1e-12) + 1e-14)
    assert not np.any(missing)
    assert np.max(boxes._nodes.first) > PIECES and np.any(found.high - found.low < 1)
    assert np.all((found.high - found.low == 1) | (piece[found.who] >= 0)[:, None])


def square_of_patches():
    """The unit square as sixteen patches, bicubic and exact."""
    corners = np.stack(np.meshgrid(np.arange(4), np.arange(4), [0], indexing="ij"), axis=-1).reshape(-1, 1, 1, 3)
    whole = np.stack([*np.meshgrid(np.arange(4), np.arange(4), indexing="ij"), np.zeros((4, 4))], axis=-1)
    return (3 * corners + whole) / 16


@pytest.mark.parametrize(("power", "away"), [(0, 0), (-900, -900), (900, 900), (0, 940), (-500, 460)])
def test_many_distances_to_a_square_of_patches_are_enclosed_in_rational_numbers(power, away):
    rng, side = np.random.default_rng(4), Fraction(3, 4)
    points = rng.uniform(-0.5, 1.5, (200, 3))
    # Above the sides and the corners that patches share, and on the square.
    points[:60, :2] = rng.integers(0, 9, (60, 2)) * 0.09375
    points[40:80, 2] = 0.0
    found = jhd.project(np.ldexp(points, away), jhd.BezierPatches(np.ldexp(square_of_patches(), power)))
    for p, lower, upper in zip(points, np.asarray(found.lower), np.asarray(found.upper), strict=True):
        x = [Fraction(float(c)) for c in p]
        limit = side * Fraction(2) ** (power - away)
        square = sum((c - min(max(c, 0), limit)) ** 2 for c in x[:2]) + x[2] ** 2
        assert Fraction(float(np.ldexp(lower, -away))) ** 2 <= square <= Fraction(float(np.ldexp(upper, -away))) ** 2


def surfaces():
    rng = np.random.default_rng(9)
    bumpy = FLAT + 0.15 * rng.normal(size=(4, 4, 4, 3)) + np.arange(4)[:, None, None, None] * [1.0, 0.0, 0.0]
    collapsed = bumpy.copy()
    collapsed[:, 0], collapsed[:, :, -1] = collapsed[:, :1, 0], collapsed[:, -1:, -1]
    yield "bumpy", net_of(bumpy)
    yield "rational", net_of(bumpy, rng.uniform(0.1, 1.0, bumpy.shape[:-1]))
    yield "collapsed", net_of(collapsed)
    smooth = BUMPS / 3 + np.arange(4)[:, None, None, None] * [1.0, 0.0, 0.0]
    yield "smooth", net_of(smooth)
    yield "twice", net_of(bumpy[[0, 1, 0, 1]])
    yield "flattened", net_of(bumpy * [1.0, 0.0, 0.0])
    for name, round_ in (("sphere", sphere(1.0)), ("torus", torus(0.25))):
        patches = round_.patches()
        yield name, net_of(np.asarray(patches.control_points), np.asarray(patches.weights))


SURFACES = dict(surfaces())


def queries(net, rng, count):
    x = rng.uniform(0, 1, (count, 2))
    x[: count // 8] = np.rint(x[: count // 8])
    x[count // 8 : count // 4, 0] = 0.0
    on = points_of(net, x)[rng.integers(0, len(net.points), count), np.arange(count)]
    return on + rng.choice([0.0, 1e-9, 1e-3, 0.1, 0.5], (count, 1)) * rng.normal(size=(count, 3))


@pytest.mark.parametrize("name", swept(SURFACES, ["rational"], list(SURFACES)))
def test_bounds_overlap_with_those_of_a_search_that_cuts_whole_pieces(name, monkeypatch):
    net, rng = SURFACES[name], np.random.default_rng(2)
    points = queries(net, rng, 120)
    quick = NetTarget(net).nearest(points)
    monkeypatch.setattr(on_patches, "_REACHES", ())
    slow = NetTarget(net).nearest(points)
    assert np.all(quick.lower <= slow.upper) and np.all(slow.lower <= quick.upper)
    assert np.all(quick.closed[slow.closed])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most"), [("bumpy", 0.15), ("rational", 0.3), ("sphere", 0.1), ("smooth", 0.03)])
def test_nearly_all_points_are_decided_by_the_part_about_their_foot_and_by_boxes(name, most, monkeypatch):
    net, rng = SURFACES[name], np.random.default_rng(3)
    points = queries(net, rng, 500)[125:]
    points += 0.01 * rng.normal(size=points.shape)
    left, near = [], PatchBoxes.near

    def counting(self, points, upper, power, settled, goal):
        found = near(self, points, upper, power, settled, goal)
        left.extend(np.unique(found.who[found.lower < goal[found.who]]))
        return found

    monkeypatch.setattr(PatchBoxes, "near", counting)
    assert np.all(NetTarget(net).nearest(points).closed)
    assert len(left) <= most * len(points)


def test_where_there_is_room_for_no_more_boxes_bounds_are_as_good(monkeypatch):
    net, rng = SURFACES["rational"], np.random.default_rng(4)
    points = queries(net, rng, 120)
    roomy = NetTarget(net).nearest(points)
    monkeypatch.setattr(patch_boxes, "_MOST", 0)
    tight = NetTarget(net).nearest(points)
    assert np.all(tight.lower <= roomy.upper) and np.all(roomy.lower <= tight.upper)
    assert np.all(tight.closed)


def test_about_a_center_boxes_are_not_cut_without_end():
    patches = sphere(1.0).patches()
    boxes = PatchBoxes(net_of(np.asarray(patches.control_points), np.asarray(patches.weights)))
    points = np.zeros((100, 3))
    nothing = SettledParts(np.zeros(100, int), np.zeros((100, 2)), np.zeros((100, 2)))
    found = boxes.near(points, np.full(100, 1.1), 0, nothing, np.full(100, 1.1))
    assert np.max(np.bincount(found.who)) <= 4 * patch_boxes._CROWD
