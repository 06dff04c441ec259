"""Gradients at feet that Newton's method tells badly: next to centers of curvature, at points of zero speed, at ties.

Each case is a segment of a, three segments of b of degree three, and the gradient in a shift of a in closed form, so
that all kinds of cases share one program. All are turned, moved and scaled at random.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from tests.sweeps import swept

# Gradients are smooth along the degenerate places, so they are as good there as elsewhere.
CLOSE = 1e-6
# Control points of a cubic from its coefficients.
POWERS = np.array([[1, 0, 0, 0], [1, 1 / 3, 0, 0], [1, 2 / 3, 1 / 3, 0], [1, 1, 1, 1]])


class FootCase(NamedTuple):
    """Both shapes, (2, 2) and (3, 4, 2), and the gradient of the distance in a shift of a."""

    a: np.ndarray
    b: np.ndarray
    gradient: np.ndarray


def unit(x):
    return x / np.linalg.norm(x)


def cubic(points):
    """A line of two points, or a parabola of three, as a cubic."""
    p = np.asarray(points, float)
    if len(p) == 2:
        return np.stack([p[0], (2 * p[0] + p[1]) / 3, (p[0] + 2 * p[1]) / 3, p[1]])
    return np.stack([p[0], (p[0] + 2 * p[1]) / 3, (2 * p[1] + p[2]) / 3, p[2]])


def beside_a_vertex(rng):
    """A line across the axis of y = x^2 at a height about that of the center of curvature, 1/2.

    The foot is where the parabola is parallel to the line, or the feet are +-sqrt(y - 1/2) and the line crosses the
    axis where they are equally near.
    """
    y = 0.5 + 10.0 ** rng.uniform(-14, -1) * rng.choice([-1, 0, 1])
    slope = 10.0 ** rng.uniform(-8, -1) * rng.choice([-1, 0, 1])
    two = y > 0.5 and abs(slope) < 2 * np.sqrt(y - 0.5)
    normal = np.array([-slope, 1.0])
    gradient = normal / (2 * np.sqrt(y - 0.25)) if two else unit(normal)
    a = np.array([[-0.3, y - 0.3 * slope], [0.3, y + 0.3 * slope]])
    return FootCase(a, np.stack([cubic([[-2, 4], [0, -4], [2, 4]])] * 3), gradient)


def beyond_a_tip(rng):
    """The end of a segment beyond the tip of a fold, a cusp, or an end whose control point is doubled or tripled."""
    kind = rng.integers(4)
    while True:
        if kind == 0:
            # (1 - tip)^2 - (t - tip)^2 along an axis, so that it turns round at t = tip.
            tip = rng.uniform(0.2, 0.8)
            b = POWERS @ np.array([[1 - 2 * tip, 0], [2 * tip, 0], [-1, 0], [0, 0]])
            foot, outward = np.array([(1 - tip) ** 2, 0.0]), np.array([1.0, 0.0])
        elif kind == 1:
            # p + q (t - tip)^2 + r (t - tip)^3
            tip, (p, q, r) = rng.uniform(0.2, 0.8), rng.normal(size=(3, 2))
            b = POWERS @ np.stack([p + q * tip**2 - r * tip**3, 3 * tip**2 * r - 2 * tip * q, q - 3 * tip * r, r])
            foot, outward = p, -unit(q)
        else:
            b = rng.normal(size=(4, 2))
            b[1:kind] = b[0]
            foot, outward = b[0], unit(b[0] - b[kind])
        away = unit(outward + rng.uniform(-0.8, 0.8) * np.array([-outward[1], outward[0]]))
        end = foot + rng.uniform(0.2, 1.5) * away
        t = np.linspace(0, 1, 4001)[:, None]
        points = (1 - t) ** 3 * b[0] + 3 * t * (1 - t) ** 2 * b[1] + 3 * t**2 * (1 - t) * b[2] + t**3 * b[3]
        if np.min(np.linalg.norm(points - end, axis=1)) >= np.linalg.norm(end - foot) - 1e-15:
            return FootCase(np.stack([end - 0.1 * away, end]), np.stack([b] * 3), away)


def beside_an_edge_and_a_vertex(rng):
    """A segment whose distance to a nearly parallel line rises to where a vertex is as near."""
    while True:
        slope = 10.0 ** rng.uniform(-6, -1) * rng.choice([-1, 1])
        a = np.array([[-1, 0], [1, 0]]) + 0.05 * rng.normal(size=(2, 2))
        vertex, far = np.array([rng.uniform(0.3, 1.2), -rng.uniform(0.2, 0.95)]), np.array([9.0, -3.0])
        edge = np.array([[-3, 1 - 3 * slope], [3, 1 + 3 * slope]])
        rows = tied(a, edge[0], unit(np.array([slope, -1.0])), vertex)
        # The vertex is nearer than the edge that begins there.
        if rows is not None and (a[1] - vertex) @ (far - vertex) <= 0:
            b = [edge, [edge[1], far], [far, vertex]]
            return FootCase(a, np.stack([cubic(x) for x in b]), balanced(rows, a))


def tied(a, on_flat, normal, vertex):
    """Both gradients where a segment is farthest from a flat and a vertex, equally near there; None if nowhere."""
    towards = a[1] - a[0]
    flat = lambda t: (a[0] + t * towards - on_flat) @ normal  # noqa: E731
    near = lambda t: np.linalg.norm(a[0] + t * towards - vertex)  # noqa: E731
    # Both distances change their order once on the left of the vertex, where that to it falls.
    low, high = 0.0, np.clip((vertex - a[0]) @ towards / (towards @ towards), 0.0, 1.0)
    if not flat(low) < near(low) or not flat(high) > near(high) or min(flat(low), flat(high)) < 0.05:
        return None
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if flat(middle) < near(middle) else (low, middle)
    rows = np.stack([normal, unit(a[0] + low * towards - vertex)])
    # The distance to the flat rises to there, and no end is farther than the tie.
    farthest = rows[0] @ towards > 1e-8 and min(flat(1.0), near(1.0)) < flat(low)
    return rows if farthest else None


def balanced(rows, a):
    """The combination of two gradients that does not change along a."""
    along = rows @ (a[1] - a[0])
    return (along[1] * rows[0] - along[0] * rows[1]) / (along[1] - along[0])


KINDS = (beside_a_vertex, beyond_a_tip, beside_an_edge_and_a_vertex)
# Cases of each kind that are measured side by side.
LANES = 50


@jax.jit
@jax.vmap
def from_segments(a, b, weights):
    """Gradients of the distances of the segments."""
    value = lambda a: jhd.directed_hausdorff(jhd.BezierSegments(a[None]), jhd.BezierSegments(b, weights)).value  # noqa: E731
    return jnp.sum(jax.grad(value)(a), axis=0)


@jax.jit
@jax.vmap
def from_ends(a, b, weights):
    """Gradients of the distances of their second ends."""
    return jax.grad(lambda point: jhd.project(point, jhd.BezierSegments(b, weights)).distance)(a[1])


@jax.jit
@jax.vmap
def from_means(a, b, weights):
    """Gradients of the mean distance of their second ends, which is that of one point."""
    points = lambda point: jhd.BezierSegments(point[None, None])  # noqa: E731
    curve = jhd.BezierSegments(b, weights)
    return jax.grad(lambda point: jhd.MeanDistance(True).estimate(points(point), curve))(a[1])


def attack(kinds, seed, measured=from_segments, rational=False, dim=2):
    """Compares gradients with those of closed forms; rational segments are the same curves at other speeds."""
    rng = np.random.default_rng(seed)
    cases = [_moved(kind(rng), rng, dim) for kind in kinds for _ in range(LANES)]
    weights = rng.uniform(0.5, 2, (len(cases), 1, 1)) ** np.arange(4) * np.ones((3, 1)) if rational else None
    a, b, expected = (np.stack([getattr(case, name) for case in cases]) for name in FootCase._fields)
    found = jax.tree_util.tree_map(np.asarray, measured(*jax.tree_util.tree_map(jnp.asarray, (a, b, weights))))
    off = np.max(np.abs(found - expected), axis=1)
    assert np.all(off < CLOSE), [(k, off[k], cases[k]) for k in np.flatnonzero(~(off < CLOSE))[:3]]


def _moved(case, rng, dim):
    """The case turned, moved and scaled, in the plane or in space."""
    turn = np.linalg.qr(rng.normal(size=(dim, dim)))[0][:2]
    scale, shift = 10.0 ** rng.uniform(-2, 2), rng.normal(size=dim)
    return FootCase(scale * (case.a @ turn + shift), scale * (case.b @ turn + shift), case.gradient @ turn)


@pytest.mark.parametrize("seed", swept(range(40), slow=1))
def test_gradients_at_degenerate_feet_are_those_of_closed_forms(seed):
    attack(KINDS, seed)


@pytest.mark.parametrize("seed", swept(range(40)))
def test_gradients_of_rational_curves_at_degenerate_feet_are_those_of_closed_forms(seed):
    attack(KINDS, seed, rational=True)


@pytest.mark.parametrize(("seed", "rational"), swept([(k, r) for k in range(40) for r in (False, True)], quick=1))
def test_gradients_of_nearest_points_at_tips_are_those_of_closed_forms(seed, rational):
    attack([beyond_a_tip], seed, from_ends, rational)


def beside_a_cusp_of_centers(rng):
    """A line as in `beside_a_vertex`, so flat that bounds meet beside the axis, where only one of both feet exists."""
    y = 0.5 + 10.0 ** rng.uniform(-6.5, -4.5)
    slope = 2 * np.sqrt(y - 0.5) * rng.uniform(-0.97, 0.97)
    a = np.array([[-0.3, y - 0.3 * slope], [0.3, y + 0.3 * slope]])
    b = np.stack([cubic([[-2, 4], [0, -4], [2, 4]])] * 3)
    return FootCase(a, b, np.array([-slope, 1.0]) / (2 * np.sqrt(y - 0.25)))


@pytest.mark.parametrize(("seed", "dim"), swept([(k, d) for k in range(40) for d in (2, 3)], slow=1))
def test_gradients_are_right_where_bounds_close_before_the_second_foot_appears(seed, dim):
    attack([beside_a_cusp_of_centers] * 3, seed, dim=dim)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(40))
def test_gradients_in_space_at_degenerate_feet_are_those_of_closed_forms(seed):
    attack(KINDS, seed, dim=3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(40))
def test_gradients_of_means_at_tips_are_those_of_closed_forms(seed):
    attack([beyond_a_tip], seed, from_means)


def beside_a_plane_and_a_vertex(rng):
    """A segment, a mesh, and the gradients of its two distances: the same tie in space."""
    while True:
        slope = 10.0 ** rng.uniform(-4, -0.5, 2) * rng.choice([-1, 1], 2)
        corners = np.array([[-4, -4], [4, -4], [-4, 4], [4, 4.0]])
        vertex = np.array([rng.uniform(0.3, 1.2), rng.uniform(-0.3, 0.3), -rng.uniform(0.3, 1.0)])
        a = np.array([[-1, -0.5, 0], [1, -0.4, 0]]) + 0.03 * rng.normal(size=(2, 3))
        rows = tied(a, np.array([0, 0, 1.0]), unit(np.append(slope, -1.0)), vertex)
        if rows is not None:
            flat = np.column_stack([corners, 1 + corners @ slope])
            away = vertex + np.array([[0, 0, 0], [3, 0, -1], [3, 1, -1.5]])
            b = jhd.TriangleMesh(np.concatenate([flat, away]), [[0, 1, 2], [1, 3, 2], [4, 5, 6]])
            return a, b, rows


@pytest.mark.parametrize("seed", swept(range(40), slow=1))
def test_gradients_at_ties_of_a_mesh_are_those_of_closed_forms(seed):
    rng = np.random.default_rng(seed)
    for _ in range(LANES):
        a, b, rows = beside_a_plane_and_a_vertex(rng)
        value = lambda shift, a=a, b=b: jhd.directed_hausdorff(jhd.polyline(jnp.asarray(a) + shift), b).value  # noqa: E731
        np.testing.assert_allclose(jax.grad(value)(jnp.zeros(3)), balanced(rows, a), atol=CLOSE)


def way_down(rng, a, rows, vertex):
    """A direction along which both distances fall, about where a segment is farthest and at its end; None if none."""
    for way in rng.normal(size=(100, 3)):
        way = unit(way)
        if np.all(rows @ way < -0.2) and (a[1] - vertex) @ way < -0.05:
            return way
    return None


@pytest.mark.parametrize("seed", swept(range(40), slow=1))
def test_gradients_at_ties_of_a_patch_beside_a_mesh_are_those_of_closed_forms(seed):
    rng, done = np.random.default_rng(seed), 0
    while done < LANES:
        a, b, rows = beside_a_plane_and_a_vertex(rng)
        way = way_down(rng, a, rows, np.asarray(b.vertices)[4])
        if way is None:
            continue
        # A patch is farthest on the edge that is the segment.
        net = jnp.asarray(np.stack([a, a + 0.05 * way], axis=1))
        value = lambda shift, net=net, b=b: jhd.directed_hausdorff(jhd.BezierPatch(net + shift), b).value  # noqa: E731
        np.testing.assert_allclose(jax.grad(value)(jnp.zeros(3)), balanced(rows, a), atol=CLOSE)
        done += 1
