"""Rectangles of the parameters of patches, and bounds of the distance between the surface and triangles over them.

A triangle L whose corners are points S(P_k) of the surface, with all P_k in one rectangle, is off from S at equal
parameters x = sum l_k P_k by half of sum l_k H_k(P_k - x), H_k second derivatives of S on the way. The variance of a
coordinate within an interval is at most a quarter of the square of its length, so

    |S - L| <= (|S_uu| + 2 |S_uv| + |S_vv|) / 8,

the largest sizes over the rectangle, with parameters in units of it (Filip, Magedson & Markot for right triangles). It
does not matter which triangle it is: whatever points lie on the sides of the rectangle, it holds. As triangles that
cover the rectangle are the image of the same parameters, the distance is bounded both ways: from any point of the
surface to the mesh and from any point of the mesh to the surface. The distance of stored vertices from S adds to it.

Rational patches S = N / w are compared with the bilinear surface B between their four corners. For D = N - w B the
difference e = D / w is of second order with its derivatives, and e_u = (D_u - w_u e) / w, e_uu = (D_uu - 2 w_u e_u -
w_uu e) / w, e_uv = (D_uv - w_u e_v - w_v e_u - w_uv e) / w; S_uu = e_uu, S_vv = e_vv, and S_uv = e_uv + t with the
twist t of B. So little is lost on them. All sizes come from Bernstein coefficients.

All this is done with coordinates about a common center, divided by powers of two to order one: the largest is r >= 1/2,
or all numbers are zero. Rounding: local points and their products with weights take 2 roundings, and
a restriction of degree p takes 3 p + 1 more, as ends and their differences from one are exact: 2 p in the matrix, 1
for a product, p for the sum. The coefficients of D take 9: 3 in the factors, non-negative and of sum one, and 6
for products, difference and sum. B is taken between its corners as rounded. So the terms of these coefficients,
which add up to at most 2 r times a weight, pass through 3 (p + q) + 13 roundings, and two more in the first of two
differences: they are off by at most `noise` = 2 sqrt(3) gamma(3 (p + q) + 15) r times the largest weight of the
rectangle, weights relatively by less, and a k-th difference by 2^k times that. The rest are fewer than 64 roundings of
positive numbers, where the least weight comes in four times at most: less than a factor 1 + 10 noise. Points of the
surface are off by 4 noise at most, if a power of a parameter is good to four units in the last place.

A flat rectangle with uneven parameters is near its triangles, but not at equal parameters. Let q be a convex
quadrilateral in a plane, and let the surface S over the rectangle and the triangles L both stay within h of the plane.
Project both onto the plane. Let both stay within e of q, and along each side of the rectangle within b of the edge of q
between its two corners. If a point of q is farther than b from all edges, it lies on both projections: the border can
be moved to the edges without meeting the point, so it winds about the point once, as the edges do. Each other point of
q is within b of an edge, and each point of an edge within b of the border. So each point of S is within e of a point of
q, which is within 2 b of L, and vice versa. They are at most

    sqrt((e + 2 b)^2 + (2 h)^2)

apart. The corners of q are the projected corners of the rectangle; h, e and b are the largest of all control points, as
the sets in question are convex. The vertices of L are points of S, those on a side points of that side, so the same
holds for L. Rounding: control points are off by at most `noise`, the distances taken from them by 2 noise more, and the
border begins and ends within 2 noise of the corners of q: 5 (1 + 2) + 2 2 < 20 noise together. The check that q is
convex leaves more room.

Source: Filip, Magedson & Markot, Surface algorithms using bounds on derivatives, CAGD 3 (1986); Farin, Curves and
Surfaces for CAGD (2002), chapter 14, for the nets. The bound for rational patches and for any triangle is ours.

Borders of two patches are one if they have equal control points and weights, in whichever direction they run.
"""

from typing import Any, NamedTuple

import numpy as np

from jhd._arithmetic.bernstein import basis, blossoms, product_weights
from jhd._arithmetic.rounding import gamma
from jhd._arithmetic.scaling import common_exponent, unit_weights
from jhd._runtime.arrays import taken
from jhd._shapes.mesh import places_of

# A quadrilateral counts as convex if the sine of each corner exceeds _CONVEX, and each edge is longer than _LONG times
# the rounding of its corners, which then turns an edge by less than a tenth of _CONVEX.
_CONVEX, _LONG = 1e-3, 3e4


class PatchBorders(NamedTuple):
    """Borders of patches; side k of a patch is u = 0, u = 1, v = 0, v = 1."""

    number: np.ndarray  # the number of each side (patches, 4), one for all sides that are one curve
    turned: np.ndarray  # whether the side runs against the direction in which its curve is taken
    patch: np.ndarray  # the patch that stands for each curve
    side: np.ndarray  # its side there
    collapsed: np.ndarray  # whether the curve is one point

    @classmethod
    def of(cls, points: np.ndarray, weights: np.ndarray | None) -> "PatchBorders":
        """The borders of patches with control points (patches, rows, columns, 3)."""
        heavy = np.ones(points.shape[:-1]) if weights is None else weights.astype(np.float64)
        # Zeros of either sign are one number.
        net = np.concatenate([points.astype(np.float64) + 0.0, heavy[..., None]], axis=-1)
        longest = max(net.shape[1:3])
        sides = [net[:, 0], net[:, -1], net[:, :, 0], net[:, :, -1]]
        forward = np.stack([_padded(x, longest) for x in sides], axis=1)
        backward = np.stack([_padded(x[:, ::-1], longest) for x in sides], axis=1)
        apart = backward - forward
        first = np.argmax(apart != 0, axis=-1)
        turned = np.take_along_axis(apart, first[..., None], axis=-1)[..., 0] < 0
        rows = np.where(turned[..., None], backward, forward)
        _, index, number = np.unique(rows.reshape(4 * len(net), -1), axis=0, return_index=True, return_inverse=True)
        collapsed = [np.all(x[..., :3] == x[:, :1, :3], axis=(1, 2)) for x in sides]
        return cls(number.reshape(-1, 4), turned, index // 4, index % 4, np.stack(collapsed, axis=1).ravel()[index])

    def needed(self, points: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
        """Mask of the patches that are more than a curve or a point of the border of another patch.

        Repeated knots give spans of no length, whose patches are such curves or points.
        """
        heavy = np.ones(points.shape[:-1]) if weights is None else weights
        net = np.concatenate([points, heavy[..., None]], axis=-1)
        narrow = np.stack([np.all(net == net[:, :1], axis=(1, 2, 3)), np.all(net == net[:, :, :1], axis=(1, 2, 3))])
        proper = ~np.any(narrow, axis=0)
        curve = np.where(narrow[0], self.number[:, 0], self.number[:, 2])
        ends = points[:, [0, 0, -1, -1], [0, -1, 0, -1]]
        place = places_of(ends.reshape(-1, 3)).reshape(-1, 4)
        inside = np.where(
            np.all(narrow, axis=0), np.isin(place[:, 0], place[proper]), np.isin(curve, self.number[proper])
        )
        return proper | ~inside

    def along(self, patch: np.ndarray, side: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Convert parameters of a side to parameters of its curve, or back; they are dyadic, so this is exact."""
        return np.where(self.turned[patch, side], 1 - t, t)

    def standing(self, patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Patch, u and v of border points on the patch that stands for their curve; other points stay.

        A curve that is one point is taken at parameter 0.
        """
        side = np.select([u == 0, u == 1, v == 0, v == 1], [0, 1, 2, 3], default=-1)
        inside, at = side < 0, np.maximum(side, 0)
        curve = self.number[patch, at]
        own, other = self.patch[curve], self.side[curve]
        t = self.along(own, other, self.along(patch, at, np.where(at < 2, v, u)))
        t = np.where(self.collapsed[curve], 0.0, t)
        end = (other % 2).astype(np.float64)
        u, v = np.where(inside, u, np.where(other < 2, end, t)), np.where(inside, v, np.where(other < 2, t, end))
        return np.where(inside, patch, own), u, v


def _padded(rows: np.ndarray, length: int) -> np.ndarray:
    """Control points and weights (patches, points, 4) as one row for each patch; no weight is zero."""
    rows = np.concatenate([rows[..., :3], unit_weights(rows[..., 3:], 1)], axis=-1)
    return np.pad(rows, ((0, 0), (0, length - rows.shape[1]), (0, 0))).reshape(len(rows), -1)


class PatchCells(NamedTuple):
    """Rectangles [u0, u1] x [v0, v1] of patches, with bounds of their deviation."""

    patch: np.ndarray  # number of the patch
    u0: np.ndarray  # start in u; all four ends are exact dyadic numbers
    u1: np.ndarray  # end in u
    v0: np.ndarray  # start in v
    v1: np.ndarray  # end in v
    bound: np.ndarray  # bound of the distance of surface and triangles, local; infinite if not measured
    along_u: np.ndarray  # whether u is the parameter to bisect

    take = taken

    @classmethod
    def of(cls, patch: np.ndarray, u0: np.ndarray, u1: np.ndarray, v0: np.ndarray, v1: np.ndarray) -> "PatchCells":
        """Rectangles without known bounds."""
        return cls(patch, u0, u1, v0, v1, np.full(len(patch), np.inf), np.zeros(len(patch), bool))

    def halves(self) -> "PatchCells":
        """Both halves of each rectangle along the parameter to bisect."""
        _, u, v = self.middle()
        first = (self.patch, self.u0, np.where(self.along_u, u, self.u1), self.v0, np.where(self.along_u, self.v1, v))
        other = (self.patch, np.where(self.along_u, u, self.u0), self.u1, np.where(self.along_u, self.v0, v), self.v1)
        return PatchCells.of(*(np.concatenate(pair) for pair in zip(first, other, strict=True)))

    def middle(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Patch, u and v of the middle."""
        return self.patch, 0.5 * (self.u0 + self.u1), 0.5 * (self.v0 + self.v1)

    def corner(self, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Patch, u and v of corner k, counter-clockwise from (u0, v0)."""
        return self.patch, (self.u0, self.u1, self.u1, self.u0)[k], (self.v0, self.v0, self.v1, self.v1)[k]


class HostPatches(NamedTuple):
    """Patches in float64: local coordinates x = 2^-second (2^-power x_user - center), of size at most one."""

    points: np.ndarray  # (patches, rows, columns, 3) as they are stored
    net: np.ndarray  # (patches, rows, columns, 4) local points times weights of at most one, and these weights
    power: int
    center: np.ndarray
    second: int
    noise: float  # error of a bound by rounding, local
    borders: PatchBorders

    @classmethod
    def of(cls, points: np.ndarray, weights: np.ndarray | None) -> "HostPatches":
        """The patches in local coordinates."""
        power = int(common_exponent(points))
        near = np.ldexp(points.astype(np.float64), -power)
        low, high = near.min(axis=(0, 1, 2)), near.max(axis=(0, 1, 2))
        center = low + 0.5 * (high - low)
        about = near - center
        # Far from the origin the surface may be small compared with its coordinates.
        second = int(common_exponent(about))
        about = np.ldexp(about, -second)
        heavy = np.ones(points.shape[:-1]) if weights is None else unit_weights(weights.astype(np.float64), (1, 2))
        net = np.concatenate([about * heavy[..., None], heavy[..., None]], axis=-1)
        roundings = 3 * (points.shape[1] + points.shape[2] - 2) + 15
        noise = 2 * np.sqrt(3.0) * gamma(roundings, np.float64) * float(np.abs(about).max())
        return cls(points, net, power, center, second, noise, PatchBorders.of(points, weights))

    @property
    def degrees(self) -> tuple[int, int]:
        """Degrees in u and in v."""
        return self.net.shape[1] - 1, self.net.shape[2] - 1

    def whole(self) -> PatchCells:
        """Every patch, unless it is only a part of the border of others, as one rectangle."""
        patch = np.flatnonzero(self.borders.needed(self.points, self.net[..., 3]))
        zero, one = np.zeros(len(patch)), np.ones(len(patch))
        return PatchCells.of(patch, zero, one, zero, one)

    def in_user_units(self, lengths: Any) -> Any:
        """Local lengths in the user's unit, rounded up."""
        with np.errstate(over="ignore"):
            return np.nextafter(np.ldexp(lengths * (1 + 1e-15), self.power + self.second), np.inf)

    def in_local_units(self, length: float) -> float:
        """A length in the user's unit as a local one, rounded."""
        return float(np.ldexp(length, -(self.power + self.second)))

    def _local(self, vertices: np.ndarray) -> np.ndarray:
        """Stored points in local coordinates; the subtraction is the only rounding."""
        return np.ldexp(np.ldexp(vertices.astype(np.float64), -self.power) - self.center, -self.second)

    def vertices(self, patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, float]:
        """Points of the surface as stored (points, 3), and a bound of their error, local.

        Patches with a common border have identical points there. Corners are the control points themselves; all other
        points are inside the box of all control points.
        """
        patch, u, v = self.borders.standing(patch, u, v)
        corner = ((u == 0) | (u == 1)) & ((v == 0) | (v == 1))
        given = self.points[patch, np.where(u == 1, -1, 0), np.where(v == 1, -1, 0)]
        local = self._at(patch, u, v)
        found = np.ldexp(np.ldexp(local, self.second) + self.center, self.power)
        found = np.clip(found, self.points.min(axis=(0, 1, 2)), self.points.max(axis=(0, 1, 2)))
        stored = np.where(corner[:, None], given, found.astype(self.points.dtype))
        return stored, float(_length(self._local(stored) - local).max(initial=0.0)) + 4 * self.noise

    def _at(self, patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Local points, sums in a fixed order."""
        (p, q), total = self.degrees, np.zeros((len(patch), 4))
        along_u, along_v = basis(p, u), basis(q, v)
        for i in range(p + 1):
            row = np.zeros_like(total)
            for j in range(q + 1):
                row = row + along_v[:, j, None] * self.net[patch, i, j]
            total = total + along_u[:, i, None] * row
        return total[:, :3] / total[:, 3:]


def with_bounds(patches: HostPatches, cells: PatchCells, enough: float) -> PatchCells:
    """The rectangles with their bounds and the parameters to bisect.

    Args:
        patches: the patches.
        cells: the rectangles.
        enough: a local length; only of rectangles with a larger bound it is asked whether they are flat.
    """
    net, noise = _restricted(patches, cells), patches.noise
    corners = [net[:, i, j, :3] / net[:, i, j, 3:] for i, j in ((0, 0), (-1, 0), (-1, -1), (0, -1))]
    raised = _against_corners(net, corners)
    weight, shape = raised[..., 3], raised[..., :3]
    least, most = weight.min(axis=(1, 2)), weight.max(axis=(1, 2))
    twist = corners[0] - corners[1] + corners[2] - corners[3]
    own = _derivatives(weight[..., None], noise * most)
    of = _derivatives(shape, noise * most, least[:, None] * twist)
    e = _length(shape / raised[..., 3:]).max(axis=(1, 2)) + noise
    e_u, e_v = (of.u + own.u * e) / least, (of.v + own.v * e) / least
    s_uu = (of.uu + 2 * own.u * e_u + own.uu * e) / least
    s_vv = (of.vv + 2 * own.v * e_v + own.vv * e) / least
    uneven = _length(twist) * (most - least)
    s_uv = (of.uv + uneven + own.u * e_v + own.v * e_u + own.uv * e) / least
    bound = (s_uu + 2 * s_uv + s_vv) / 8 * (1 + 10 * noise)
    wide = np.maximum(_length(corners[1] - corners[0]), _length(corners[2] - corners[3]))
    high = np.maximum(_length(corners[3] - corners[0]), _length(corners[2] - corners[1]))
    along_u = np.where(2 * s_uv > np.maximum(s_uu, s_vv), wide >= high, s_uu >= s_vv)
    (rows,) = np.nonzero(bound > enough)
    flat, bent = _flat_bounds(net[rows], noise, bound[rows])
    bound[rows], along_u[rows] = np.minimum(bound[rows], flat), np.where(np.isfinite(flat), bent, along_u[rows])
    return cells._replace(bound=bound, along_u=along_u)


def _flat_bounds(net: np.ndarray, noise: float, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounds for flat rectangles, infinite unless below `most`, and whether more is bent along u than along v."""
    points = net[..., :3] / net[..., 3:]
    bound, along_u = np.full(len(points), np.inf), np.zeros(len(points), bool)
    normal = np.cross(points[:, -1, -1] - points[:, 0, 0], points[:, 0, -1] - points[:, -1, 0])
    size = _length(normal)[:, None]
    normal = normal / np.where(size > 0, size, 1.0)
    height = np.einsum("nijk,nk->nij", points - points[:, :1, :1], normal)
    high = np.abs(height - 0.5 * (height[:, :1, :1] + height[:, -1:, :1])).max(axis=(1, 2), initial=0.0)
    (rows,) = np.nonzero((size[:, 0] > 0) & (4 * high < most))
    if len(rows) == 0:
        return bound, along_u
    points, normal, high = points[rows], normal[rows], high[rows]
    flat = points - height[rows, ..., None] * normal[:, None, None]
    sides = flat[:, :, 0], flat[:, -1], flat[:, ::-1, -1], flat[:, 0, ::-1]
    start = np.stack([side[:, 0] for side in sides], axis=1)
    edge = np.stack([side[:, -1] - side[:, 0] for side in sides], axis=1)
    turn = np.einsum("nek,nk->ne", np.cross(edge, np.roll(edge, -1, axis=1)), normal)
    long = _length(edge)
    convex = np.all((turn > _CONVEX * long * np.roll(long, -1, axis=1)) & (long > _LONG * noise), axis=1)
    border = np.max([_from_chord(side).max(axis=1) for side in sides], axis=0)
    inner = flat.reshape(len(flat), -1, 3)
    leftward = np.cross(normal[:, None], edge)
    inside = np.all(np.einsum("nepk,nek->nep", inner[:, None] - start[:, :, None], leftward) >= 0, axis=1)
    nearest = np.min([_from_segment(inner, start[:, k], edge[:, k]) for k in range(4)], axis=0)
    outside = np.where(inside, 0.0, nearest).max(axis=1)
    found = np.hypot(outside + 2 * border, 2 * high) + 20 * noise
    bound[rows] = np.where(convex & (found < most[rows]), found, np.inf)
    # Lines of control points along u, then along v.
    lines = np.moveaxis(points, 2, 0), np.moveaxis(points, 1, 0)
    bent = [np.max([_from_chord(line).max(axis=1) for line in of], axis=0) for of in lines]
    along_u[rows] = bent[0] >= bent[1]
    return bound, along_u


def _from_chord(rows: np.ndarray) -> np.ndarray:
    """The distances of points (cells, points, 3) from the segment between the first and the last one of each cell."""
    return _from_segment(rows, rows[:, 0], rows[:, -1] - rows[:, 0])


def _from_segment(rows: np.ndarray, start: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """The distances of points (cells, points, 3) from a segment of each cell."""
    square = np.sum(edge * edge, axis=-1)[:, None]
    t = np.einsum("npk,nk->np", rows - start[:, None], edge) / np.where(square > 0, square, 1.0)
    return _length(rows - start[:, None] - np.clip(t, 0.0, 1.0)[..., None] * edge[:, None])


class _Sizes(NamedTuple):
    """The largest sizes of derivatives over each rectangle."""

    u: np.ndarray
    v: np.ndarray
    uu: np.ndarray
    uv: np.ndarray
    vv: np.ndarray


def _derivatives(rows: np.ndarray, error: np.ndarray, mixed: np.ndarray | float = 0.0) -> _Sizes:
    """Bounds of the derivatives of polynomials with coefficients (cells, n + 1, m + 1, dim), each off by the error.

    The vectors `mixed` are added to the derivative uv.
    """
    n, m = rows.shape[1] - 1, rows.shape[2] - 1
    u, v = n * np.diff(rows, axis=1), m * np.diff(rows, axis=2)
    uu, vv, uv = (n - 1) * np.diff(u, axis=1), (m - 1) * np.diff(v, axis=2), n * np.diff(v, axis=1)
    uv = uv + np.reshape(mixed, (-1, 1, 1, np.shape(mixed)[-1] if np.ndim(mixed) else 1))
    factors = (2 * n, 2 * m, 4 * n * (n - 1), 4 * n * m, 4 * m * (m - 1))
    found = (_length(x).max(axis=(1, 2), initial=0.0) for x in (u, v, uu, uv, vv))
    return _Sizes(*(x + factor * error for x, factor in zip(found, factors, strict=True)))


def _against_corners(net: np.ndarray, corners: list[np.ndarray]) -> np.ndarray:
    """Coefficients of D and of w in one degree more, from the coefficients of N and w."""
    cells, (p, q), weight = len(net), (net.shape[1] - 1, net.shape[2] - 1), net[..., 3:]
    along_u, along_v = product_weights(p, 1), product_weights(q, 1)
    total = np.zeros((cells, p + 2, q + 2, 4))
    for corner, (a, b) in zip(corners, ((0, 0), (1, 0), (1, 1), (0, 1)), strict=True):
        share = along_u[:, a, None, None] * along_v[None, :, b, None]
        difference = np.concatenate([net[..., :3] - weight * corner[:, None, None], weight], axis=-1)
        total[:, a : a + p + 1, b : b + q + 1] += share * difference
    return total


def _restricted(patches: HostPatches, cells: PatchCells) -> np.ndarray:
    """Local control points times weights, and the weights, on each rectangle."""
    (p, q), net = patches.degrees, patches.net[cells.patch]
    along_u = np.matmul(blossoms(cells.u0, cells.u1, p), net.reshape(len(net), p + 1, -1)).reshape(net.shape)
    return np.matmul(blossoms(cells.v0, cells.v1, q)[:, None], along_u)


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(sum(x * x for x in np.moveaxis(vectors, -1, 0)))
