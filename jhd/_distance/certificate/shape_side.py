"""Points, curves, parametric surfaces and meshes on the host: their points, and feet of points on them.

Coordinates are moved to a center and divided by a power of two that leaves at most about one, so that squares neither
overflow nor vanish. The proposals made here are checked in integers on the stored arrays; nothing is proven here.
"""

import itertools
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from typing_extensions import override

from jhd._arithmetic.bernstein import basis
from jhd._arithmetic.scaling import unit_weights
from jhd._distance.certificate.sides import AbstractSide, FootMap, NearMaps, ShapePlace, plain_shape
from jhd._distance.certificate.verification.pieces import pieces_of
from jhd._distance.certificate.verification.proofs import point_of
from jhd._distance.certificate.verification.zeros import NearZero
from jhd._distance.nearest.feet import equation_of, gauss_newton
from jhd._distance.nearest.target import curve_in_space, in_space
from jhd._distance.normalization.jets import CurveJet, polynomial_jet, quotient
from jhd._distance.search.targets import target_of
from jhd._shapes.as_shape import Shape
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.mesh import TriangleMesh

# Steps of Newton's method for a foot, and the fractions of a step that are tried.
_STEPS, _SHARES = 10, (1.0, 0.3, 0.05)
# Parameters nearer than this to an end of their interval are put on it.
_SNAP = 1e-15


class NearFeet(NamedTuple):
    """Points of a shape near given points: pieces, parameters and distances."""

    piece: np.ndarray
    x: np.ndarray
    distance: np.ndarray


class ShapeSide(AbstractSide):
    """A shape of a pair.

    Args:
        shape: points, a curve, a parametric surface or a mesh.
        exponent: coordinates are divided by two to this power.
        center: subtracted before the division.
    """

    def __init__(self, shape: Shape, exponent: int = 0, center: np.ndarray | float = 0.0):
        plain = plain_shape(shape)
        self.exponent, self.center = exponent, center
        self.exact = pieces_of(plain)
        self.corners, self.degrees = self.exact[0].corners, self.exact[0].degrees
        self.cell_corners = 1 if not self.corners else 2 if self.corners == (2,) else 3
        self.cell_degree = sum(self.degrees)
        self._triangles = isinstance(shape, TriangleMesh)
        if self._triangles:
            points = np.asarray(plain["vertices"], float)[np.asarray(plain["triangles"])]
        else:
            points = np.asarray(plain["control_points"], float)
        points = self.scaled(points)
        weights = np.ones(points.shape[:-1])
        self.is_rational = plain.get("weights") is not None
        if self.is_rational:
            weights = unit_weights(np.asarray(plain["weights"]), tuple(range(points.ndim - 1)))
        self.rows = np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)
        # Feet on curves are searched in space, about the center; feet on other shapes by the target of the search.
        self._is_curve = isinstance(shape, AbstractCurve)
        if self._is_curve:
            shape = curve_in_space(BezierSegments(points, plain["weights"]))
        self._target = target_of(shape)
        self.hulls = points.reshape(len(points), -1, points.shape[-1])

    @override
    def scaled(self, points: np.ndarray) -> np.ndarray:
        return np.ldexp(points - self.center, -self.exponent)

    def stored(self, points: np.ndarray) -> np.ndarray:
        """Return points in the unit of the stored arrays."""
        return np.ldexp(points, self.exponent) + self.center

    @property
    def parameters(self) -> int:
        """Number of parameters of a point of a piece."""
        return self.exact[0].parameters

    @override
    def points(self, piece: np.ndarray, x: np.ndarray) -> np.ndarray:
        return self.jets(piece, x, 0)[0]

    def weights(self, piece: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the weights at parameters of pieces, times one number for all pieces."""
        if self._triangles:
            return np.ones(len(piece))
        if not self.parameters:
            return self.rows[piece, 0, -1]
        bases = [_bases(degree, x[:, k], 0)[0] for k, degree in enumerate(self.degrees)]
        return _contracted(self.rows[piece], bases)[:, -1]

    def feet(self, points: np.ndarray, proven: bool = False) -> NearFeet:
        """Return feet of points: near ones, or, if `proven`, the nearest, which takes longer."""
        count = len(points)
        # From this number on, points measured at once are padded to powers of two, for which there are few compiled
        # functions.
        rows = points[np.minimum(np.arange(max(64, 1 << (count - 1).bit_length())), count - 1)]
        queries = in_space(rows) if self._is_curve else self.stored(rows)
        found = self._target.nearest(queries) if proven else self._target.near(queries)
        t = np.asarray(found.t, float).reshape(len(rows), np.size(found.t) // len(rows))[:count]
        x = t[:, 1:] if self._triangles else t[:, : self.parameters]
        return self.local(np.array(found.segment)[:count], np.clip(x, 0.0, 1.0), points)

    def feet_within(self, points: np.ndarray, limit: float) -> NearFeet:
        """Return near feet; points for which these are farther than `limit` get the nearest feet."""
        feet = self.feet(points)
        far = np.flatnonzero(feet.distance > limit)
        if len(far):
            again = self.feet(points[far], proven=True)
            nearer = again.distance < feet.distance[far]
            for mine, found in zip(feet, again, strict=True):
                mine[far[nearer]] = found[nearer]
        return feet

    @override
    def distance(self, point: np.ndarray) -> float:
        return float(np.ldexp(self.feet(self.scaled(point)[None]).distance[0], self.exponent))

    @override
    def place(self, point: np.ndarray) -> ShapePlace | None:
        # Points of a shape are this near to their feet, in units of the largest coordinate.
        found = self.feet_within(self.scaled(point)[None], 1e-9)
        return self.named(int(found.piece[0]), found.x[0])

    @override
    def named(self, piece: int, t: np.ndarray, point: np.ndarray | None = None) -> ShapePlace | None:
        if not 0 <= piece < len(self.exact):
            return None
        x = np.clip(t[1:] if self._triangles and len(t) == 3 else t[: self.parameters], 0.0, 1.0)
        # Parameters below this are zero in certificates: tiny numbers would make long integers.
        x = np.where(x < 1e-15, 0.0, x)
        at = (on_triangle(x) if self._triangles else x).tolist()
        return ShapePlace({"piece": piece, "at": at}, NearZero(point_of(self.exact[piece], at), Fraction(0)))

    @override
    def samples(self, draw: np.random.Generator, count: int) -> np.ndarray:
        piece = draw.integers(0, len(self.exact), count)
        x = draw.uniform(size=(count, self.parameters))
        x = np.where(draw.uniform(size=x.shape) < 0.3, np.round(x), x)
        if self._triangles:
            x = np.where(x.sum(axis=1, keepdims=True) > 1, 1 - x, x)
        return self.stored(self.points(piece, x))

    @override
    def beside(self, points: np.ndarray) -> np.ndarray:
        found = self.feet(self.scaled(points))
        return self.stored(self.points(found.piece, found.x))

    def local(self, piece: np.ndarray, x: np.ndarray, points: np.ndarray) -> NearFeet:
        """Return feet of points on given pieces, near the parameters x; on triangles the nearest points."""
        if self._triangles:
            x = _on_triangles(self.rows[piece, :, :-1], points)
        elif self.parameters == 1:
            x = self._on_curve(piece, x, points)
        elif self.parameters:
            x = self._stationary(piece, x, points)
        e = self.points(piece, x) - points
        return NearFeet(piece, x, np.sqrt(np.sum(e * e, axis=-1)))

    def _on_curve(self, piece: np.ndarray, x: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Return the parameters at which Newton's method ends, or the start if it is nearer."""
        s = x[:, 0]
        # Steps of Newton's method for a foot on a curve.
        for _ in range(6):
            s = gauss_newton(s, equation_of(points, self.curve_jet(piece, s)))
        ended = np.where(s < _SNAP, 0.0, np.where(s > 1 - _SNAP, 1.0, s))[:, None]
        before, after = (np.sum((self.points(piece, each) - points) ** 2, axis=-1) for each in (x, ended))
        return np.where((before < after)[:, None], x, ended)

    def curve_jet(self, piece: np.ndarray, s: np.ndarray) -> CurveJet:
        """Return points, velocities and accelerations of a curve at one parameter each."""
        rows = polynomial_jet(np.moveaxis(self.rows[piece], -2, 0), s[:, None])
        return quotient(CurveJet(*(x[:, :-1] for x in rows)), CurveJet(*(x[:, -1:] for x in rows)))

    def _stationary(self, piece: np.ndarray, x: np.ndarray, points: np.ndarray) -> np.ndarray:
        for _ in range(_STEPS):
            value, first, second = self.jets(piece, x, 2)
            e = value - points
            slope = np.einsum("nd,nid->ni", e, first)
            held = ((x <= 0) & (slope > 0)) | ((x >= 1) & (slope < 0))
            step = _newton_step(slope, first, np.einsum("nd,nijd->nij", e, second), held)
            tried = [np.clip(x + share * step, 0.0, 1.0) for share in (0.0, *_SHARES)]
            offsets = [self.points(piece, each) - points for each in tried]
            best = np.argmin([np.sum(offset * offset, axis=-1) for offset in offsets[::-1]], axis=0)
            x = np.stack(tried[::-1])[best, np.arange(len(x))]
        return np.where(x < _SNAP, 0.0, np.where(x > 1 - _SNAP, 1.0, x))

    def jets(self, piece: np.ndarray, x: np.ndarray, order: int) -> list[np.ndarray]:
        """Return points and derivatives up to `order` in the parameters, (n, i, dim) and (n, i, j, dim)."""
        rows = self.rows[piece]
        if self._triangles:
            shares = np.concatenate([1 - x.sum(axis=1, keepdims=True), x], axis=1)
            return [np.einsum("ni,nid->nd", shares, rows[..., :-1])]
        if not self.parameters:
            return [rows[:, 0, :-1] / rows[:, 0, -1:]]
        bases = [_bases(degree, x[:, k], order) for k, degree in enumerate(self.degrees)]
        value, count = _derivative(rows, bases), len(bases)
        weight = value[:, -1:]
        found = [value[:, :-1] / weight]
        if order:
            first = [_derivative(rows, bases, i) for i in range(count)]
            firsts = [(f[:, :-1] - found[0] * f[:, -1:]) / weight for f in first]
            found.append(np.stack(firsts, axis=1))
        if order > 1:
            seconds = []
            for i, j in itertools.product(range(count), repeat=2):
                f = _derivative(rows, bases, i, j)
                top = f[:, :-1] - firsts[i] * first[j][:, -1:] - firsts[j] * first[i][:, -1:] - found[0] * f[:, -1:]
                seconds.append(top / weight)
            found.append(np.stack(seconds, axis=1).reshape(len(x), count, count, -1))
        return found

    # ---- cells, and maps of cells into the shape -----------------------------------------------------

    @override
    def weights_at(self, piece: int, x: np.ndarray) -> np.ndarray:
        exact = self.exact[piece]
        first = self.rows[piece].reshape(-1, self.rows.shape[-1])[0, -1]
        return self.weights(np.full(len(x), piece), x) * (exact.weight[0] / 2.0**exact.bits / first)

    @override
    def maps_near(self, corners: np.ndarray, points: np.ndarray, limit: float) -> list[NearMaps]:
        near = self.feet_within(points, limit)
        rows = zip(near.distance.tolist(), near.piece.tolist(), near.x, strict=True)
        return [NearMaps(distance, [self._map(corners, piece, x)]) for distance, piece, x in rows]

    def _map(self, corners: np.ndarray, piece: int, x: np.ndarray, u: np.ndarray | None = None) -> FootMap:
        """Return the map that follows the foot at x to the corners of a cell, moved so that it takes u to x."""
        count = len(corners)
        followed = self.local(np.full(count, piece), np.tile(x, (count, 1)), corners).x
        followed = followed if u is None else followed + (x - u @ followed)
        # Parameters of maps are rounded to multiples of this, which keeps integers short: the distance changes by its
        # square.
        return FootMap(piece, self.rounded(followed, 2.0**40), np.zeros(3))

    @override
    def moved(self, corners: np.ndarray, foot: FootMap, u: np.ndarray, point: np.ndarray, position: float) -> FootMap:
        x = self.local(np.array([foot.piece]), (u @ foot.rows)[None], point[None]).x[0]
        return self._map(corners, foot.piece, x, u)

    @override
    def feet_at(self, foot: FootMap, shares: np.ndarray) -> np.ndarray:
        return self.points(np.full(len(shares), foot.piece), shares @ foot.rows)

    def rounded(self, x: np.ndarray, unit: float) -> np.ndarray:
        """Return parameters as multiples of 1 / unit, inside their domain."""
        x = np.clip(np.round(x * unit) / unit, 0.0, 1.0)
        if self.corners == (3,):
            x[:, 1] = np.minimum(x[:, 1], 1 - x[:, 0])
        return x


def on_triangle(x: np.ndarray) -> np.ndarray:
    """Return both parameters of a point of a triangle, with a sum of at most one: 1 - x may be rounded up."""
    most = 1 - x[0]
    if Fraction(float(most)) + Fraction(float(x[0])) > 1:
        most = np.nextafter(most, 0.0)
    return np.array([x[0], min(x[1], most)])


def _bases(degree: int, t: np.ndarray, order: int) -> list[np.ndarray]:
    """Return the Bernstein polynomials of a degree and their derivatives up to an order, (n, degree + 1) each."""
    found = [basis(degree, t)]
    for k in range(1, order + 1):
        if degree < k:
            found.append(np.zeros_like(found[0]))
            continue
        values = basis(degree - k, t)
        for n in range(degree - k + 1, degree + 1):
            lower, values = values, np.zeros((len(t), n + 1))
            values[:, 1:] += n * lower
            values[:, :-1] -= n * lower
        found.append(values)
    return found


def _derivative(rows: np.ndarray, bases: list[list[np.ndarray]], *axes: int) -> np.ndarray:
    """Return the sums of control points times the derivatives of their polynomials in some parameters."""
    return _contracted(rows, [b[axes.count(k)] for k, b in enumerate(bases)])


def _contracted(rows: np.ndarray, bases: list[np.ndarray]) -> np.ndarray:
    """Return the sums of control points (n, i, dim) or (n, i, j, dim) times the values of their polynomials."""
    for values in bases:
        rows = np.einsum("ni...,ni->n...", rows, values)
    return rows


def _newton_step(slope: np.ndarray, first: np.ndarray, bent: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return Newton's steps, or Gauss-Newton steps if the distance is not convex; zero for held parameters.

    Args:
        slope: the gradients of half the squared distance.
        first: the derivatives of the points.
        bent: terms that the second derivatives add to the products of the first ones.
        held: parameters that stay fixed.
    """
    count = slope.shape[1]
    flat = np.einsum("nid,njd->nij", first, first)
    free = ~held
    mask = free[:, :, None] & free[:, None, :]
    identity = np.eye(count) * np.maximum(1e-14 * np.einsum("nii->n", flat), 1e-300)[:, None, None]
    hessian = np.where(mask, flat + bent, 0.0)
    low = np.linalg.eigvalsh(np.where(mask, hessian, np.eye(count) * np.einsum("nii->n", flat)[:, None, None]))[:, 0]
    convex = low > 1e-6 * np.einsum("nii->n", flat)
    chosen = np.where(convex[:, None, None], hessian, np.where(mask, flat, 0.0) + identity)
    chosen = np.where(mask, chosen, np.eye(count))
    step = np.linalg.solve(chosen, -np.where(held, 0.0, slope)[..., None])[..., 0]
    return np.where(np.isfinite(step), step, 0.0)


def _on_triangles(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the last two barycentric coordinates of the nearest points of triangles, one for each point."""
    origin, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    e = points - origin
    dots = [np.sum(x * y, axis=-1) for x, y in ((u, u), (u, v), (v, v), (e, u), (e, v))]
    uu, uv, vv, eu, ev = dots
    det = uu * vv - uv * uv
    safe = np.where(det > 1e-14 * uu * vv, det, 1.0)
    s, t = (vv * eu - uv * ev) / safe, (uu * ev - uv * eu) / safe
    inside = (det > 1e-14 * uu * vv) & (s >= 0) & (t >= 0) & (s + t <= 1)
    along = [np.clip(x / np.where(y > 0, y, 1.0), 0.0, 1.0) for x, y in ((eu, uu), (ev, vv))]
    across = uu - 2 * uv + vv
    third = np.clip((ev - eu + uu - uv) / np.where(across > 0, across, 1.0), 0.0, 1.0)
    zero = np.zeros_like(s)
    sides = [(along[0], zero), (zero, along[1]), (1 - third, third), (np.where(inside, s, 0.0), np.where(inside, t, 0))]
    offsets = [e - x[:, None] * u - y[:, None] * v for x, y in sides]
    best = np.argmin([np.sum(offset * offset, axis=-1) for offset in offsets[::-1]], axis=0)
    return np.stack([np.stack(side, axis=-1) for side in sides[::-1]])[best, np.arange(len(points))]
