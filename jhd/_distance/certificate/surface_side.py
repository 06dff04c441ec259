"""An implicit surface on the host: its points, feet of points on it, and its pieces in integers.

Points of the surface are found where the polynomial changes its sign along the lines of a grid, including lines in the
faces of the box. A foot is followed by Newton's method for the equations of Lagrange, along the faces of the box that
it has reached. Nothing is proven here; if a point seems to be too far away, the certified search is used.
"""

import math
from typing import NamedTuple, cast

import numpy as np
from numpy.polynomial import polynomial
from typing_extensions import override

from jhd._distance.certificate.cutting import grid
from jhd._distance.certificate.sides import AbstractSide, FootMap, NearMaps, ShapePlace, plain_shape
from jhd._distance.certificate.verification.pieces import Part, pieces_of
from jhd._distance.certificate.verification.values import CertificateError
from jhd._distance.certificate.verification.zeros import ZeroSet, is_free, place_of, zeros_of
from jhd._distance.search.targets import target_of
from jhd._shapes.implicit import ImplicitSurface

# Steps towards a foot, and the number of surface points from which the search starts.
_STEPS, _STARTS = 12, 3
# Lengths of vectors across the surface that are tried, as fractions of the size of its box.
_WAYS = (0.0, *(2.0**k for k in range(-52, -24, 3)))
# How much longer a vector across the surface is than its samples need, and the least length, as a fraction of the size.
_WIDER, _THIN = 1.5, 2.0**-26
# Degrees of the grids in cells on which maps are compared with the surface, by the number of corners.
_GRIDS = {1: 2, 2: 7, 3: 4, 4: 3}


class SurfaceFoot(NamedTuple):
    """A foot on a surface, which of its coordinates are held on a face of the box, and its derivative in the point."""

    point: np.ndarray
    held: np.ndarray
    moves: np.ndarray
    distance: float


class SurfaceSide(AbstractSide):
    """An implicit surface of a pair, in the unit of its coordinates.

    Args:
        surface: the surface.
        hints: points on the surface or near it, found by the search.
    """

    zeros: ZeroSet

    def __init__(self, surface: ImplicitSurface, hints: np.ndarray):
        plain = plain_shape(surface)
        self.exact, self.zeros = pieces_of(plain), cast(ZeroSet, zeros_of(plain))
        self.cell_corners, self.cell_degree, self.exponent = 4, 1, 0
        self.lower, self.upper = (np.asarray(plain[end], float) for end in ("lower", "upper"))
        self.size = float(np.linalg.norm(self.upper - self.lower))
        rows = np.asarray(plain["coefficients"], float)
        self.scale = 1 / float(np.max(np.abs(rows)))
        self._rows = rows * self.scale
        self._slopes = [_derivative(self._rows, i) for i in range(3)]
        # Values, first and second derivatives of the powers of a coordinate are these times powers.
        self._powers = [_falling(n) for n in self._rows.shape]
        self._ends = np.array([[[float(x) for x in row] for row in piece.rows] for piece in self.exact])
        self._ends /= np.array([float(piece.weight[0]) for piece in self.exact])[:, None, None]
        self.hulls = np.swapaxes(self._ends, 1, 2)
        self._shape = surface
        self._samples = np.concatenate([self._on_grid(), self._on_surface(hints)])

    def values(self, points: np.ndarray) -> np.ndarray:
        """Return the values of the polynomial, divided by its largest coefficient, at points (..., 3)."""
        x, y, z = np.moveaxis(points, -1, 0)
        return np.asarray(polynomial.polyval3d(x, y, z, self._rows))

    def slopes(self, points: np.ndarray) -> np.ndarray:
        """Return the gradients of the polynomial."""
        x, y, z = np.moveaxis(points, -1, 0)
        return np.stack([polynomial.polyval3d(x, y, z, row) + 0 * x for row in self._slopes], axis=-1)

    def jet(self, q: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return value, gradient and Hessian at one point."""
        found = self._rows
        for x, (exponents, factors) in zip(q, self._powers, strict=True):
            powers = factors * x**exponents
            found = np.tensordot(found, powers, (0, 1))
        slope = np.array([found[1, 0, 0], found[0, 1, 0], found[0, 0, 1]])
        bend = np.empty((3, 3))
        bend[0, 0], bend[1, 1], bend[2, 2] = found[2, 0, 0], found[0, 2, 0], found[0, 0, 2]
        bend[0, 1] = bend[1, 0] = found[1, 1, 0]
        bend[0, 2] = bend[2, 0] = found[1, 0, 1]
        bend[1, 2] = bend[2, 1] = found[0, 1, 1]
        return float(found[0, 0, 0]), slope, bend

    @override
    def points(self, piece: np.ndarray, x: np.ndarray) -> np.ndarray:
        shares = np.concatenate([1 - x.sum(axis=1, keepdims=True), x], axis=1)
        return np.einsum("ndk,nk->nd", self._ends[piece], shares)

    @override
    def shares_on(self, corners: np.ndarray, shares: np.ndarray) -> np.ndarray:
        u = shares
        for _ in range(_STEPS):
            points = u @ corners
            slopes = self.slopes(points) @ corners.T
            along = u * (slopes - np.sum(u * slopes, axis=1, keepdims=True))
            rise = np.sum(slopes * along, axis=1)
            u = u - (self.values(points) / np.where(rise != 0, rise, 1.0))[:, None] * along
        points = u @ corners
        good = np.abs(self.values(points)) <= 1e-12 * np.sum(np.abs(self.slopes(points)), axis=-1) * self.size
        return u[good & np.all(u >= 0, axis=1)]

    def inside(self, corners: np.ndarray) -> np.ndarray:
        """Return barycentric coordinates of at most 20 samples of the surface in a tetrahedron."""
        x = np.linalg.solve((corners[1:] - corners[0]).T, (self._samples - corners[0]).T).T
        shares = np.concatenate([1 - x.sum(axis=1, keepdims=True), x], axis=1)
        return shares[np.all(shares >= 0, axis=1)][:20]

    def near(self, point: np.ndarray) -> list[SurfaceFoot]:
        """Return local feet of a point, followed from the nearest samples, the nearest foot first."""
        e = self._samples - point
        order = np.argsort(np.sum(e * e, axis=1))
        starts: list[np.ndarray] = []
        for k in order[:400]:
            # Neighboring samples lead to the same foot.
            if all(np.max(np.abs(self._samples[k] - q)) > 0.15 * self.size for q in starts):
                starts.append(self._samples[k])
            if len(starts) == _STARTS:
                break
        found: list[SurfaceFoot] = []
        for start in starts:
            foot = self.foot(point, start)
            # Feet within this fraction of the box are one foot.
            if foot is not None and all(np.max(np.abs(foot.point - x.point)) > 1e-7 * self.size for x in found):
                found.append(foot)
        return sorted(found, key=lambda foot: foot.distance)

    def without_tiny(self, x: np.ndarray) -> np.ndarray:
        """Return the coordinates with tiny ones set to zero, which would make long integers."""
        # Coordinates below this fraction of the size count as zero.
        return np.where(np.abs(x) < 2.0**-70 * self.size, 0.0, x)

    @override
    def samples(self, draw: np.random.Generator, count: int) -> np.ndarray:
        return self._samples[draw.permutation(len(self._samples))[:count]]

    @override
    def beside(self, points: np.ndarray) -> np.ndarray:
        found = (self.foot(point, point) for point in points)
        return np.array([foot.point for foot in found if foot is not None]).reshape(-1, 3)

    @property
    @override
    def is_found(self) -> bool:
        return len(self._samples) > 0

    @override
    def proven_distance(self, point: np.ndarray, distance: float) -> float:
        return float(target_of(self._shape).nearest(point[None]).lower[0])

    @override
    def distance(self, point: np.ndarray) -> float:
        feet = self.near(point)
        return feet[0].distance if feet else math.inf

    @override
    def named(self, piece: int, t: np.ndarray, point: np.ndarray | None = None) -> ShapePlace | None:
        return None if point is None else self.place(point)

    @override
    def place(self, point: np.ndarray) -> ShapePlace | None:
        foot = self.foot(point, point)
        if foot is None:
            return None
        # Points this near to a face of the box, as a fraction of its size, are searched on the face.
        for near in (2.0**-44 * self.size, 0.0):
            low, high = foot.point - self.lower <= near, self.upper - foot.point <= near
            at = np.where(low, self.lower, np.where(high, self.upper, foot.point))
            # A way across a face would leave the box.
            slope = np.where(low | high, 0.0, self.slopes(at))
            length = float(np.linalg.norm(slope))
            for share in _WAYS if length > 0 else _WAYS[:1]:
                way = share * self.size * slope / max(length, 1e-300)
                place = {"at": self.without_tiny(at).tolist(), "way": self.without_tiny(way).tolist()}
                try:
                    return ShapePlace(place, place_of(self.zeros, place, "witness"))
                except CertificateError:
                    continue
        return None

    def foot(self, point: np.ndarray, start: np.ndarray) -> SurfaceFoot | None:
        """Return the local foot of a point near a start, in the box; None if there is none."""
        q = np.clip(start, self.lower, self.upper)
        held = np.zeros(3, bool)
        moves, factor = np.zeros((3, 3)), None
        for _ in range(4 * _STEPS):
            value, slope, bend = self.jet(q)
            free = ~held
            square = float(slope[free] @ slope[free])
            if square == 0:
                return None if value else SurfaceFoot(q, held, moves, float(np.linalg.norm(q - point)))
            if factor is None:
                factor = -float((q - point)[free] @ slope[free]) / square
            step, factor, moves = _step(q - point, value, slope, np.eye(3) + factor * bend, held)
            share, hit = 1.0, None
            for i in np.flatnonzero(free & (step != 0)):
                end = self.upper[i] if step[i] > 0 else self.lower[i]
                if (end - q[i]) / step[i] < share:
                    share, hit = max((end - q[i]) / step[i], 0.0), i
            q = q + share * step
            if hit is not None:
                q[hit] = self.upper[hit] if step[hit] > 0 else self.lower[hit]
                held[hit], factor = True, None
                continue
            if np.max(np.abs(step)) <= 1e-14 * self.size:
                released = self._released(point, q, held)
                if released is None:
                    break
                held[released], factor = False, None
        small = abs(float(self.values(q))) <= 1e-11 * (1e-3 + float(np.linalg.norm(self.slopes(q)))) * self.size
        return SurfaceFoot(q, held, moves, float(np.linalg.norm(q - point))) if small else None

    def _released(self, point: np.ndarray, q: np.ndarray, held: np.ndarray) -> int | None:
        """Return the held coordinate that the distance most wants to leave its face; None if there is none."""
        slope = self.slopes(q)
        free = ~held
        square = float(slope[free] @ slope[free])
        if not held.any() or square == 0:
            return None
        pull = (q - point) - float((q - point)[free] @ slope[free]) / square * slope
        inward = np.where(q == self.lower, 1.0, -1.0)
        wants = np.where(held, -pull * inward, -np.inf)
        best = int(np.argmax(wants))
        return best if wants[best] > 1e-9 * self.size else None

    # ---- cells, and maps of cells into the surface ---------------------------------------------------

    @override
    def weights_at(self, piece: int, x: np.ndarray) -> np.ndarray:
        return np.ones(len(x))

    @override
    def values_at(self, points: np.ndarray) -> np.ndarray:
        return self.values(points)

    @override
    def is_empty(self, part: Part, points: np.ndarray) -> bool:
        values = self.values(points)
        return bool(np.min(values) * np.max(values) > 0) and is_free(self.zeros, part)

    @override
    def shares_in(self, corners: np.ndarray, shares: np.ndarray) -> np.ndarray:
        return np.concatenate([self.shares_on(corners, shares), self.inside(corners)])

    @override
    def maps_near(self, corners: np.ndarray, points: np.ndarray, limit: float) -> list[NearMaps]:
        found = []
        for point in points:
            feet = self.near(point)
            # Feet that are followed for each point of a cell; for a single point, the nearest.
            maps = (self._map(corners, point, foot) for foot in feet[: 1 if len(corners) == 1 else 2])
            found.append(NearMaps(feet[0].distance if feet else math.inf, [each for each in maps if each is not None]))
        return found

    def _map(
        self, corners: np.ndarray, point: np.ndarray, foot: SurfaceFoot, u: np.ndarray | None = None
    ) -> FootMap | None:
        """Return the map that follows the foot of a point, with a vector across the surface; None if it fails."""
        free = ~foot.held
        slope = np.where(free, self.slopes(foot.point), 0.0)
        length = float(np.linalg.norm(slope))
        moved = foot.point + (corners - point) @ foot.moves.T
        moved = moved if u is None else moved + (foot.point - u @ moved)
        if length == 0:
            is_zero = float(self.values(foot.point)) == 0
            return FootMap(0, np.tile(foot.point, (len(corners), 1)), np.zeros(3)) if is_zero else None
        normal = slope / length
        rows = np.clip(moved, self.lower, self.upper)
        for _ in range(2):
            s = self._along(grid(len(corners), _GRIDS[len(corners)]) @ rows, normal)
            if s is None:
                return None
            reach = _WIDER * float(np.max(np.abs(s))) + _THIN * self.size
            way = normal * reach
            low, high = self.lower + np.abs(way), self.upper - np.abs(way)
            if np.any(low > high):
                return None
            rows = np.where(free, np.clip(rows, low, high), foot.point)
        # The points of feet are rounded to multiples of this fraction of the size.
        unit = 2.0 ** np.ceil(np.log2(self.size)) / 2.0**40
        rounded = np.where(free, np.round(rows / unit) * unit, foot.point)
        rounded = np.where(free & ((rounded < low) | (rounded > high)), rows, rounded)
        return FootMap(0, rounded, self.without_tiny(np.where(free, way * (1 - 1e-9), 0.0)))

    @override
    def moved(
        self, corners: np.ndarray, foot: FootMap, u: np.ndarray, point: np.ndarray, position: float
    ) -> FootMap | None:
        found = self.foot(point, u @ foot.rows + position * foot.way)
        return None if found is None else self._map(corners, point, found, u)

    @override
    def feet_at(self, foot: FootMap, shares: np.ndarray) -> np.ndarray:
        return shares @ foot.rows

    @override
    def crossings(self, foot: FootMap, feet: np.ndarray) -> np.ndarray | None:
        length = float(np.linalg.norm(foot.way))
        if length == 0 or not len(feet):
            return np.zeros(len(feet))
        s = self._along(feet, foot.way / length)
        return None if s is None else s / length

    def _along(self, q: np.ndarray, normal: np.ndarray) -> np.ndarray | None:
        """Return the distances along the normal from points to the surface; None if Newton's method finds none."""
        s = np.zeros(len(q))
        # Steps of Newton's method along a line.
        for _ in range(8):
            at = q + s[:, None] * normal
            slope = self.slopes(at) @ normal
            s = s - self.values(at) / np.where(slope != 0, slope, 1.0)
            if np.max(np.abs(s)) > self.size:
                return None
        good = np.abs(self.values(q + s[:, None] * normal)) <= 1e-9 * (1e-3 + np.abs(slope)) * self.size
        return s if np.all(good & (slope > 0)) else None

    def _on_grid(self) -> np.ndarray:
        """Return zeros on the edges of a grid, and nodes that are zeros."""
        # Nodes of the grid along each axis.
        axes = [np.linspace(low, high, 17) for low, high in zip(self.lower, self.upper, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        values = self.values(nodes)
        found = [nodes[values == 0]]
        for axis in range(3):
            first, last = (np.moveaxis(nodes, axis, 0)[part].reshape(-1, 3) for part in (slice(-1), slice(1, None)))
            below = np.moveaxis(values, axis, 0)[:-1].ravel()
            above = np.moveaxis(values, axis, 0)[1:].ravel()
            change = below * above < 0
            first, last, sign = first[change], last[change], np.sign(below[change])
            # Halvings of the edges of the grid.
            for _ in range(48 if len(first) else 0):
                middle = 0.5 * (first + last)
                same = (np.sign(self.values(middle)) == sign)[:, None]
                first, last = np.where(same, middle, first), np.where(same, last, middle)
            found.append(first)
        return np.concatenate(found)

    def _on_surface(self, hints: np.ndarray) -> np.ndarray:
        inside = np.all((hints >= self.lower) & (hints <= self.upper), axis=1)
        near = np.abs(self.values(hints)) <= 1e-7 * (1e-3 + np.linalg.norm(self.slopes(hints), axis=-1)) * self.size
        return hints[inside & near]


def _derivative(rows: np.ndarray, axis: int) -> np.ndarray:
    if rows.shape[axis] == 1:
        return np.zeros_like(rows)
    return polynomial.polyder(rows, axis=axis)


def _falling(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return exponents and factors of the powers below `count` and of their first two derivatives, (3, count) each."""
    n, k = np.arange(count), np.arange(3)[:, None]
    factors = np.stack([np.ones(count), n, n * (n - 1)])
    return np.maximum(n - k, 0), factors


def _step(
    e: np.ndarray, value: float, slope: np.ndarray, full: np.ndarray, held: np.ndarray
) -> tuple[np.ndarray, float, np.ndarray]:
    """Return Newton's step, the new multiplier, and the derivative of the foot in the point.

    Args:
        e: the iterate minus the point.
        value: value of the polynomial.
        slope: gradient of the polynomial.
        full: the Hessian of half the squared distance and the multiplier times the polynomial.
        held: coordinates that stay fixed.
    """
    free = ~held
    along = _tangent(slope, free)
    # Even if the distance is no minimum along the surface, the Gauss-Newton step goes downwards.
    if along.shape[1] and np.min(np.linalg.eigvalsh(along.T @ full @ along)) < 1e-3:
        full = np.eye(3)
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = np.where(free[:, None] & free[None], full, np.eye(3))
    matrix[:3, 3] = matrix[3, :3] = np.where(free, slope, 0.0)
    right = np.zeros((4, 4))
    right[:3, 0] = np.where(free, -e, 0.0)
    right[3, 0] = -value
    right[:3, 1:] = np.diag(free.astype(float))
    solved = np.linalg.solve(matrix, right)
    return solved[:3, 0], float(solved[3, 0]), solved[:3, 1:]


def _tangent(slope: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the free directions orthogonal to the gradient, (3, count)."""
    axes = np.eye(3)[:, free]
    inner = axes.T @ slope
    _, _, rows = np.linalg.svd(inner[None])
    return axes @ rows[1:].T
