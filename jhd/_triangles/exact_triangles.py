"""The distance of two triangles in exact rational arithmetic: its square, and the nearest points.

Two triangles that do not meet are nearest at a vertex and an edge, at two edges, or at a vertex and the inside of a
face. If two triangles meet and none of these pairs of features does, an edge of one triangle pierces the other. All
cases are tried, none is rounded, and degenerate triangles, which are segments or points, need no case of their own:
their faces have no inside.

One pair takes a millisecond or two, so this file decides only the questions that floating point leaves open: whether
triangles meet, and the last digits.

Source: Ericson, Real-Time Collision Detection (2005), chapter 5, for the nearest points of segments.
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

_Vector = tuple[Any, Any, Any]
_Triangle = Sequence[_Vector]
_CORNERS, _NEXT = range(3), (1, 2, 0)
_ZERO, _ONE = Fraction(0), Fraction(1)


class NearestPair(NamedTuple):
    """A nearest pair of points of two triangles, exactly."""

    square: Fraction  # the squared distance; zero if the triangles meet
    # Barycentric coordinates of the point of the first triangle; exactly 0 off the feature that holds it.
    weights_a: _Vector
    weights_b: _Vector  # barycentric coordinates of the point of the second triangle


def exact_pair(a: np.ndarray, b: np.ndarray) -> NearestPair:
    """A nearest pair of points of the triangles with these corners (3, 3), for the exact values of the floats."""
    rows = [[Fraction(x) for x in corner] for corner in np.concatenate([a, b]).astype(float).tolist()]
    # Integers multiply faster than fractions; a denominator is a power of two.
    scale = max(x.denominator for row in rows for x in row)
    corners: list[_Vector] = [(int(x * scale), int(y * scale), int(z * scale)) for x, y, z in rows]
    s, t = corners[:3], corners[3:]
    best = None
    for weights_a, weights_b in _candidates(s, t):
        square = _square(_minus(_point(s, weights_a), _point(t, weights_b)))
        if best is None or square < best.square:
            best = NearestPair(square, weights_a, weights_b)
        if square == 0:
            break
    # A vertex and an edge always give one.
    return best._replace(square=best.square / scale**2) if best else NearestPair(_ZERO, (_ONE, 0, 0), (_ONE, 0, 0))


class Planes(NamedTuple):
    """The planes through two nearest points, across the line that joins them."""

    normal: _Vector  # vector from the point of b to the point of a
    at_a: Fraction  # the scalar product of the normal and the points of the plane of a
    at_b: Fraction  # the scalar product of the normal and the points of the plane of b


def planes(a: np.ndarray, b: np.ndarray, nearest: NearestPair) -> Planes:
    """The planes of the nearest points of two triangles."""
    p, q = _point(_exactly(a), nearest.weights_a), _point(_exactly(b), nearest.weights_b)
    normal = _minus(p, q)
    return Planes(normal, _dot(normal, p), _dot(normal, q))


def is_behind(found: Planes, sign: int, triangle: np.ndarray) -> bool:
    """Whether a triangle of the mesh a (sign 1) or b (sign -1) lies behind its plane, or in it.

    The distance of two triangles that are both behind their planes is at least the distance of the planes.
    """
    limit = found.at_a if sign > 0 else found.at_b
    return all(sign * (_dot(found.normal, corner) - limit) >= 0 for corner in _exactly(triangle))


def _exactly(triangle: np.ndarray) -> list[_Vector]:
    return [(Fraction(x), Fraction(y), Fraction(z)) for x, y, z in np.asarray(triangle, float).tolist()]


def _candidates(s: _Triangle, t: _Triangle) -> Iterator[tuple[_Vector, _Vector]]:
    """Barycentric coordinates of candidate pairs that include a nearest pair."""
    yield from _piercing(s, t)
    yield from ((x, y) for y, x in _piercing(t, s))
    yield from _of_vertices(s, t)
    yield from ((x, y) for y, x in _of_vertices(t, s))
    yield from _of_edges(s, t)


def _piercing(s: _Triangle, t: _Triangle) -> Iterator[tuple[_Vector, _Vector]]:
    """Points at which edges of s meet the face of t, without edges in its plane."""
    normal = _cross(_minus(t[1], t[0]), _minus(t[2], t[0]))
    heights = [_dot(_minus(corner, t[0]), normal) for corner in s]
    for i in _CORNERS:
        low, high = heights[i], heights[_NEXT[i]]
        if low * high > 0 or low == high:
            continue
        weights = _on_edge(i, Fraction(low, low - high))
        inside = _in_face(_minus(_point(s, weights), t[0]), t, normal)
        if inside is not None:
            yield weights, inside


def _of_vertices(s: _Triangle, t: _Triangle) -> Iterator[tuple[_Vector, _Vector]]:
    """Every vertex of s with the nearest points of the edges of t, and with its foot on the face."""
    normal = _cross(_minus(t[1], t[0]), _minus(t[2], t[0]))
    for i in _CORNERS:
        vertex = _on_edge(i, _ZERO)
        for j in _CORNERS:
            side = _minus(t[_NEXT[j]], t[j])
            length_sq = _square(side)
            share = Fraction(_dot(_minus(s[i], t[j]), side), length_sq) if length_sq else _ZERO
            yield vertex, _on_edge(j, min(max(share, _ZERO), _ONE))
        inside = _in_face(_minus(s[i], t[0]), t, normal)
        if inside is not None:
            yield vertex, inside


def _of_edges(s: _Triangle, t: _Triangle) -> Iterator[tuple[_Vector, _Vector]]:
    """Nearest points of the lines through edges that are not parallel, if both are on their edges."""
    for i in _CORNERS:
        u = _minus(s[_NEXT[i]], s[i])
        for j in _CORNERS:
            v, w = _minus(t[_NEXT[j]], t[j]), _minus(s[i], t[j])
            a, b, c, d, e = _square(u), _dot(u, v), _square(v), _dot(u, w), _dot(v, w)
            area_sq = a * c - b * b
            first, second = b * e - c * d, a * e - b * d
            if area_sq > 0 and 0 < first < area_sq and 0 < second < area_sq:
                yield _on_edge(i, Fraction(first, area_sq)), _on_edge(j, Fraction(second, area_sq))


def _in_face(w: _Vector, t: _Triangle, normal: _Vector) -> _Vector | None:
    """Barycentric coordinates of the foot of t[0] + w on the plane of t; None if it is not in the triangle."""
    area_sq = _square(normal)
    if area_sq == 0:
        return None
    second = Fraction(_dot(_cross(w, _minus(t[2], t[0])), normal)) / area_sq
    third = Fraction(_dot(_cross(_minus(t[1], t[0]), w), normal)) / area_sq
    first = 1 - second - third
    return (first, second, third) if min(first, second, third) >= 0 else None


def _on_edge(i: int, share: Fraction) -> _Vector:
    """Barycentric coordinates of the point at the fraction `share` from corner i to the next one."""
    weights = [_ZERO, _ZERO, _ZERO]
    weights[i], weights[_NEXT[i]] = 1 - share, share
    return weights[0], weights[1], weights[2]


def _point(t: _Triangle, weights: _Vector) -> _Vector:
    x, y, z = (sum(w * corner[k] for w, corner in zip(weights, t, strict=True) if w) for k in range(3))
    return x, y, z


def _minus(x: _Vector, y: _Vector) -> _Vector:
    return x[0] - y[0], x[1] - y[1], x[2] - y[2]


def _dot(x: _Vector, y: _Vector) -> Any:
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


def _square(x: _Vector) -> Any:
    return _dot(x, x)


def _cross(x: _Vector, y: _Vector) -> _Vector:
    return x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]
