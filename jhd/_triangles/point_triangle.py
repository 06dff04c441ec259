"""Distance from a point to a triangle, to a proven accuracy that does not depend on the triangle's shape.

Every triangle is stored in a frame of its own. Its corners are turned in cyclic order until the edge from A to B is the
longest, of length L. The frame has the unit vectors u along this edge and v in the plane of the triangle, on the side
of C, and there the corners are (0, 0), (L, 0) and (c, h) with 0 <= c <= L and h >= 0. A point p has the coordinates
x = w.u, y = w.v, z = w.(u x v) with w = p - A. Its squared distance is z^2 if (x, y) is inside, else z^2 plus the
least squared distance of (x, y) to the three edges; nothing is divided, so slivers cost no digits. A triangle without
area has h = 0: no point is strictly inside, and its edges do the rest. This covers the seven regions of the paper.

Error. Let M be the largest L, and eps the largest, over all triangles, of |u.u - 1|, |v.v - 1|, |u.v|,
|A + L u - B| / M and |A + c u + h v - C| / M, which `frames` measures. A triangle is put into its frame with sides
divided by a power of two of its own, so a tiny one has as good directions as the others, and what underflows of it is
far below M. Three steps lead from the exact distance d to the computed one:

- With F = (u, v, u x v), F'F differs from the identity by at most 3 eps, so there is an orthogonal Q with
  |F - Q| <= 2 eps. The coordinates are scalar products of three rounded terms (four roundings for x and y, seven for
  z, whose terms add up to at most sqrt(2) |w|), so they are off by at most (gamma(12) + 2 eps) |w| in length.
- The stored corners are those of Q'(T - A) up to 4 eps M. A distance moves by at most as much as its point and the
  corners do.
- In the plane, the unit vectors (c1, s1), (c2, s2) along AC and BC, and their lengths, have relative errors of eight
  roundings at most in each component, which turns and shifts an edge by at most 8 u (|w| + L) + 8 u L; products and
  differences add 6 u (|w| + L). "Inside" asks for y > 0, x s1 > y c1 and (L - x) s2 > y |c2|: as all four products are
  known up to factors of 1 + 10 u, it is right for a height of the triangle changed by a factor of 1 + 21 u, so an error
  of this decision moves the distance by at most 21 u L.

Together |computed - d| <= (gamma(48) + 6 eps) (|w| + M), and |w| <= d + M. The sum of squares and its root take another
gamma(4) of the result. Squares below the smallest normal number nu are lost, and with them sqrt(6 nu) of the length.

Source: the seven regions of Lin03 ("3-D signed Euclidean distance transform and its applications", 2003); the frame and
the proof are ours.
"""

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, Int

from jhd._arithmetic.rounding import gamma, smallest_normal, unit_roundoff
from jhd._arithmetic.scaling import frexp, ldexp
from jhd._runtime.arrays import is_traced

# Columns of the table of triangles.
COLUMNS = 18
# Columns that are lengths.
LENGTHS = (0, 1, 2, 9, 12, 15, 16, 17)


class Frames(NamedTuple):
    """Triangles in their frames; NumPy arrays, or JAX arrays if the corners are traced."""

    table: Float[Any, "triangles columns"]  # A, u, v, L, c1, s1, l1, c2, s2, l2, c, h of each triangle
    turn: Int[Any, " triangles"]  # the number of the corner A in the triangle
    longest: Any  # M, the largest L
    defect: Any  # eps of this module's docstring, with room for the rounding of measuring it


def frames(corners: Float[Any, "triangles 3 3"], dtype: DTypeLike) -> Frames:
    """The triangles in their frames, computed in the precision of the corners and stored in `dtype`.

    Args:
        corners: coordinates of at most one in absolute value.
        dtype: precision of the table.
    """
    xp: Any = jnp if is_traced(corners) else np
    roundoff = unit_roundoff(corners.dtype)
    edges = xp.roll(corners, -1, axis=1) - corners
    power = frexp(xp.max(xp.abs(edges), axis=(1, 2)))[1]
    edges = ldexp(edges, -power[:, None, None])
    turn = xp.argmax(xp.sqrt(_dot(edges, edges)), axis=1)
    places = (turn[:, None] + np.arange(3)) % 3
    a, b, c = (xp.take_along_axis(corners, places[:, [k], None], axis=1)[:, 0] for k in range(3))
    u, length = _normalized(xp, ldexp(b - a, -power[:, None]), np.array([1.0, 0.0, 0.0]))
    side = ldexp(c - a, -power[:, None])
    along = xp.clip(_dot(side, u), 0.0, length)
    v = side - along[:, None] * u
    # One projection leaves rounding errors along u; two are enough, and the third is for nearly vanishing v.
    for _ in range(3):
        v = v - _dot(v, u)[:, None] * u
    # Below this, v is made of rounding errors.
    flat = xp.max(xp.abs(v), axis=1) <= 8 * roundoff * length
    spare = xp.asarray(np.eye(3))[xp.argmin(xp.abs(u), axis=1)].astype(corners.dtype)
    spare = spare - _dot(spare, u)[:, None] * u
    v, height = _normalized(xp, xp.where(flat[:, None], spare, v), np.array([0.0, 1.0, 0.0]))
    height = xp.where(flat, 0.0, height)
    parts = [length, *_edge(xp, along, height), *_edge(xp, along - length, height), along, height]
    columns = xp.concatenate([a, u, v, xp.stack(parts, axis=1)], axis=1)
    table = ldexp(columns, np.isin(np.arange(COLUMNS), LENGTHS[3:]) * power[:, None]).astype(dtype)
    defect = _defect(xp, table.astype(corners.dtype), b, c) + 16 * roundoff
    return Frames(table, turn, xp.max(table[:, 9]), defect)


def _dot(x: Any, y: Any) -> Any:
    return (x * y).sum(axis=-1)


def _normalized(xp: Any, x: Any, otherwise: np.ndarray) -> tuple[Any, Any]:
    """Unit vectors and lengths; `otherwise` replaces unit vectors of length zero."""
    size = xp.max(xp.abs(x), axis=1, keepdims=True)
    scaled = x / xp.where(size > 0, size, 1.0)
    length = xp.sqrt(xp.where(size > 0, _dot(scaled, scaled)[:, None], 1.0))
    unit = xp.where(size > 0, scaled / length, otherwise)
    return unit, xp.where(size > 0, size * length, 0.0)[:, 0]


def _edge(xp: Any, along: Any, height: Any) -> tuple[Any, Any, Any]:
    """Unit vector (along, height) and its length; (1, 0) for length zero."""
    size = xp.maximum(xp.abs(along), height)
    known = xp.where(size > 0, size, 1.0)
    x, y = xp.where(size > 0, along / known, 1.0), height / known
    length = xp.sqrt(x * x + y * y)
    return x / length, y / length, size * length


def _defect(xp: Any, table: Any, b: Any, c: Any) -> Any:
    """The measured eps of the stored triangles."""
    a, u, v, length = table[:, :3], table[:, 3:6], table[:, 6:9], table[:, 9]
    gram = [xp.abs(_dot(u, u) - 1), xp.abs(_dot(v, v) - 1), xp.abs(_dot(u, v))]
    longest = xp.max(length)
    known = xp.where(longest > 0, longest, 1.0)
    # Divided by M first, so that no square underflows which counts.
    misses = [((b - a) - length[:, None] * u) / known, ((c - a) - (table[:, 16:17] * u + table[:, 17:18] * v)) / known]
    return xp.max(xp.stack([*gram, *(xp.sqrt(_dot(miss, miss)) for miss in misses)]))


def error_factor(defect: Any, dtype: DTypeLike) -> Any:
    """Factor k of the bound k (d + 2 L) on the error of a computed distance, with room for applying it."""
    return gamma(64, dtype) + 6.2 * defect


def absolute_floor(dtype: DTypeLike) -> float:
    """Bound of the error of a length by underflow."""
    return 4 * math.sqrt(smallest_normal(dtype))


class _InPlane(NamedTuple):
    """Coordinates of a point in a triangle's frame, foot parameters on the three edges, and squared distances."""

    x: Array
    y: Array
    z_sq: Array
    inside: Array
    along: tuple[Array, Array, Array]
    edge_sq: tuple[Array, Array, Array]


def _in_plane(point: Array, row: Array) -> _InPlane:
    ax, ay, az, ux, uy, uz, vx, vy, vz, length, c1, s1, l1, c2, s2, l2 = (row[..., i] for i in range(16))
    wx, wy, wz = point[..., 0] - ax, point[..., 1] - ay, point[..., 2] - az
    x, y = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    z = wx * (uy * vz - uz * vy) + wy * (uz * vx - ux * vz) + wz * (ux * vy - uy * vx)
    beyond = x - length
    off1, off2 = x * s1 - y * c1, y * c2 - beyond * s2
    along1, along2 = x * c1 + y * s1, beyond * c2 + y * s2
    along = (jnp.clip(x, 0, length), jnp.clip(along1, 0, l1), jnp.clip(along2, 0, l2))
    steps = (x - along[0], along1 - along[1], along2 - along[2])
    edge_sq = (y * y + steps[0] ** 2, off1 * off1 + steps[1] ** 2, off2 * off2 + steps[2] ** 2)
    return _InPlane(x, y, z * z, (y > 0) & (off1 > 0) & (off2 > 0), along, edge_sq)


def squared_distances(points: Float[Array, "*#batch 3"], rows: Float[Array, "*#batch columns"]) -> Array:
    """Squared distances of points to triangles, by rows of the table, or to points, rows of three; both broadcast."""
    if rows.shape[-1] == 3:
        return jnp.sum((points - rows) ** 2, axis=-1)
    p = _in_plane(points, rows)
    return p.z_sq + jnp.where(p.inside, 0.0, jnp.minimum(p.edge_sq[0], jnp.minimum(p.edge_sq[1], p.edge_sq[2])))


def barycentric(
    points: Float[Array, "*batch 3"], rows: Float[Array, "*batch columns"], turn: Int[Array, "*batch"]
) -> Float[Array, "*batch corners"]:
    """Barycentric coordinates of the nearest points, in the order of the triangles' corners; exactly 0 off a face.

    All are in [0, 1], with sum one up to an ulp.
    """
    p = _in_plane(points, rows)
    length, l1, l2, c, height = (rows[..., i] for i in (9, 12, 15, 16, 17))
    third = jnp.clip(_share(p.y, height), 0.0, 1.0)
    second = jnp.clip(_share(p.x - c * third, length), 0.0, 1.0 - third)
    on1, on2 = _share(p.along[1], l1), _share(p.along[2], l2)
    zero, on0 = jnp.zeros_like(third), _share(p.along[0], length)
    # Of equal distances the edge AB is taken, then AC.
    first_edge = p.edge_sq[0] <= jnp.minimum(p.edge_sq[1], p.edge_sq[2])
    second_edge = p.edge_sq[1] <= p.edge_sq[2]

    def chosen(inside: Array, e0: Array, e1: Array, e2: Array) -> Array:
        return jnp.where(p.inside, inside, jnp.where(first_edge, e0, jnp.where(second_edge, e1, e2)))

    t = jnp.stack(
        [
            chosen(1.0 - third - second, 1.0 - on0, 1.0 - on1, zero),
            chosen(second, on0, zero, 1.0 - on2),
            chosen(third, zero, on1, on2),
        ],
        axis=-1,
    )
    t = jnp.maximum(t, 0.0)
    return jnp.where(
        (turn == 0)[..., None], t, jnp.where((turn == 1)[..., None], jnp.roll(t, 1, axis=-1), jnp.roll(t, 2, axis=-1))
    )


def _share(part: Array, whole: Array) -> Array:
    """The quotient part / whole; exactly one if both are equal, and zero if the whole is zero."""
    return jnp.where(part >= whole, jnp.where(whole > 0, 1.0, 0.0), part / jnp.where(whole > 0, whole, 1.0))
