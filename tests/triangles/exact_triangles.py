"""Squared distances of points to triangles in rational numbers, and meshes that are hard on rounding."""

from fractions import Fraction

import numpy as np


def exact_square(point, corners):
    """The squared distance of a point to a triangle, exactly, of floats taken as they are."""
    p, *abc = ([Fraction(float(x)) for x in row] for row in (point, *corners))
    squares = [_edge(p, abc[i], abc[i - 1]) for i in range(3)]
    u, v, w = _minus(abc[1], abc[0]), _minus(abc[2], abc[0]), _minus(p, abc[0])
    uu, uv, vv, wu, wv = _dot(u, u), _dot(u, v), _dot(v, v), _dot(w, u), _dot(w, v)
    det = uu * vv - uv * uv
    if det:
        s, r = (wu * vv - wv * uv) / det, (wv * uu - wu * uv) / det
        if s >= 0 and r >= 0 and s + r <= 1:
            foot = [s * x + r * y for x, y in zip(u, v, strict=True)]
            squares.append(_square(_minus(w, foot)))
    return min(squares)


def exact_distance_sq(point, corners):
    """The least of them over many triangles."""
    return min(exact_square(point, triangle) for triangle in corners)


def _edge(p, a, b):
    u, w = _minus(b, a), _minus(p, a)
    uu = _dot(u, u)
    t = min(max(_dot(w, u) / uu, 0), 1) if uu else 0
    return _square(_minus(w, [t * x for x in u]))


def _minus(x, y):
    return [a - b for a, b in zip(x, y, strict=True)]


def _dot(x, y):
    return sum(a * b for a, b in zip(x, y, strict=True))


def _square(x):
    return _dot(x, x)


def hard_triangles(rng, count):
    """Random triangles: fair ones, slivers of all thicknesses, needles, segments, points, huge and tiny ones."""
    a, b, c = rng.normal(size=(3, count, 3))
    kind = np.arange(count) % 8
    thin = 10.0 ** rng.uniform(-18, -3, (count, 1))
    share = rng.uniform(-0.2, 1.2, (count, 1))
    c = np.where((kind == 1)[:, None], a + share * (b - a) + thin * c, c)
    c = np.where((kind == 2)[:, None], b + thin * c, c)
    c = np.where((kind == 3)[:, None], a + np.round(4 * share) / 4 * (b - a), c)
    c, b = (np.where((kind == 4)[:, None], x, y) for x, y in ((a, c), (a, b)))
    size = np.where(kind == 5, 1e3, np.where(kind == 6, 1e-9, 1.0))[:, None]
    return np.stack([a, a + size * (b - a), a + size * (c - a)], axis=1)


def hard_points(rng, corners, count):
    """Points near and far, on corners, on edges and in faces, and hardly off them."""
    of = corners[rng.integers(0, len(corners), count)]
    weights = rng.dirichlet(np.ones(3), count)
    kind = np.arange(count) % 6
    weights[kind == 1] = np.eye(3)[rng.integers(0, 3, np.sum(kind == 1))]
    weights[kind == 2, 0] = 0
    weights /= weights.sum(axis=1, keepdims=True)
    on = np.einsum("nk,nkd->nd", weights, of)
    off = rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-17, 1, (count, 1))
    return np.where((kind < 3)[:, None], on, np.where((kind == 5)[:, None], 100 * off, on + off))
