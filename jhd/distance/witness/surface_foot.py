"""A foot of a point on an implicit surface in a box, near a start.

The box cuts the surface, so the foot may lie on a face, an edge or a corner of the box, and which faces hold it is a
part of the answer. A face that the surface only touches at the foot must not hold: on it the surface has no direction
left, and Newton's method creeps. What comes back is a proposal, to be proven or thrown away by the caller; it is not
differentiable. Its precision is that of the polynomial, so boxes far from the origin need recentring before.

Source: Lagrange-Newton steps with an l1 merit function and a correction of second order (Nocedal & Wright, Numerical
Optimization, 2006, chapter 18); the faces are those of the projection onto the tangent plane in the box.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jhd.arithmetic.rounding import like_double
from jhd.arrays import varying

# Steps of a foot that must come nearer, and those after them that only solve its equations.
_NEARER, _SOLVED = 8, 3
# A foot is found when the plane tangent there has its nearest point within this share of the size of the box.
_FOUND = 1e-7
# The least curvature of the squared distance that a step takes for granted where it was negative.
_DAMPED = 0.01
# Curvatures of half the squared distance, which is one on a plane, below which a place is no nearest point.
SADDLE = 1e-6
# A face this near to being tangent to the surface is left free at first: sine of the angle.
TANGENT = 0.05


class Foot(NamedTuple):
    """A local nearest point, and whether it satisfies its equations."""

    point: Float[Array, "3"]
    converged: Bool[Array, ""]


class Jet(NamedTuple):
    """Value, gradient and second derivatives of a polynomial at a point."""

    value: Array
    gradient: Array
    hessian: Array


def jet(coefficients: Float[Array, "i j k"], point: Float[Array, "3"]) -> Jet:
    """Value and first two derivatives of a polynomial, from the powers of the coordinates."""
    x, y, z = (_powers(point[axis], coefficients.shape[axis]) for axis in range(3))
    # Sums keep the batch axis of vmap in front, where a matrix product may move it; see jhd.distance.witness.active.
    t = jnp.sum(coefficients[:, :, :, None] * z.T, axis=2)
    t = jnp.sum(t[:, :, None, :] * y.T[:, :, None], axis=1)
    t = jnp.sum(t[:, None] * x.T[:, :, None, None], axis=0)
    xy, xz, yz = t[1, 1, 0], t[1, 0, 1], t[0, 1, 1]
    rows = [[t[2, 0, 0], xy, xz], [xy, t[0, 2, 0], yz], [xz, yz, t[0, 0, 2]]]
    return Jet(t[0, 0, 0], jnp.stack([t[1, 0, 0], t[0, 1, 0], t[0, 0, 1]]), jnp.stack([jnp.stack(x) for x in rows]))


def _powers(x: Array, count: int) -> Array:
    """Rows of the powers of x, their first and their second derivatives: shape (3, count)."""
    powers = [jnp.ones_like(x)]
    for _ in range(count - 1):
        powers.append(powers[-1] * x)
    rows = [jnp.stack(powers)]
    for _ in range(2):
        before = jnp.concatenate([jnp.zeros(1, x.dtype), rows[-1][:-1]])
        rows.append(jnp.arange(count, dtype=x.dtype) * before)
    return jnp.stack(rows)


def local_foot(
    f: Float[Array, "i j k"],
    lower: Float[Array, "3"],
    upper: Float[Array, "3"],
    point: Float[Array, "3"],
    start: Float[Array, "3"],
) -> Foot:
    """A point of f = 0 in the closed box that is locally nearest to a point.

    Each step tries three places and takes the best by |q - p|^2 / 2 + weight |f(q)|: the Lagrange-Newton step on the
    faces that hold, the one without those that touch the surface there, cut off at the box, and the
    nearest point of the tangent plane in the box, which says which faces hold.

    Args:
        f: coefficients of the polynomial.
        lower: lower corner of the box.
        upper: upper corner of the box.
        point: the point, anywhere.
        start: where to begin.
    """
    size = jnp.max(upper - lower)

    def weighed(q: Array, weight: Array) -> Array:
        return 0.5 * jnp.sum((q - point) ** 2) + weight * jnp.abs(jet(f, q).value)

    def step(i: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        q, radius = state
        at = jet(f, q)
        slope, apart = length(at.gradient), length(q - point)
        target, mu = _on_plane(at, q, point, lower, upper)
        held = (target <= lower) | (target >= upper)
        # Held where the plane's nearest point is, and of those faces only by the ones across the surface.
        free = jnp.stack([~held, ~held | (jnp.abs(at.gradient) > TANGENT * slope)])
        moves = jax.vmap(_lagrange_newton, in_axes=(None, None, None, 0))(at, target - q, point - q, free)
        moves, free = jnp.concatenate([moves, (target - q)[None]]), free[jnp.array([0, 1, 0])]
        lengths = length(moves)
        shares = jnp.minimum(1.0, radius / jnp.where(lengths > 0, lengths, 1.0))
        # Back towards the surface, or a long step along it is refused for leaving it.
        tries = jnp.clip(q + moves * shares[:, None], lower, upper)
        normals = jnp.where(free, at.gradient, 0.0)
        squares = jnp.sum(normals * normals, axis=1)
        heights = jax.vmap(lambda x: jet(f, x).value)(tries) / jnp.where(squares > 0, squares, 1.0)
        tries = jnp.clip(tries - heights[:, None] * normals, lower, upper)
        weight = 2 * jnp.maximum(jnp.abs(mu), apart / jnp.where(slope > 0, slope, 1.0))
        values = jax.vmap(weighed, in_axes=(0, None))(jnp.concatenate([tries, q[None]]), weight)
        # What the weighing cannot tell apart is decided by the equations in the last steps.
        tangent = jnp.sqrt(squares[0]) <= TANGENT * slope
        choice = jnp.where(i < _NEARER, jnp.argmin(values[:3]), jnp.where(tangent, 1, 0))
        rounding = 8 * jnp.finfo(q.dtype).eps * apart * (apart + size)
        good = values[choice] <= values[3] + jnp.where(i < _NEARER, 0.0, rounding)
        return jnp.where(good, tries[choice], q), jnp.where(good, jnp.minimum(2 * radius, size), 0.25 * radius)

    first = varying((jnp.clip(start, lower, upper), 0.5 * size), f, point, lower, upper)
    q, _ = jax.lax.fori_loop(0, _NEARER + _SOLVED, step, first)
    at = jet(f, q)
    left = length(_on_plane(at, q, point, lower, upper)[0] - q)
    return Foot(q, left <= like_double(_FOUND, left.dtype) * size)


def _on_plane(at: Jet, q: Array, point: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """The nearest point of the box on the plane tangent at q, or near it where they do not meet, and its multiplier.

    It is clip(point + mu n) with n.(clip(point + mu n) - q) = -f, whose left side grows with mu in straight pieces.
    """
    n = at.gradient
    safe = jnp.where(n != 0, n, 1.0)
    ends = jnp.where(n != 0, jnp.stack([(lower - point) / safe, (upper - point) / safe]), 0.0)
    mu = jnp.sort(ends.ravel())
    values = jnp.sum((jnp.clip(point + mu[:, None] * n, lower, upper) - q) * n, axis=1) + at.value
    # Between the last break that is below the plane and the first one above.
    below = jnp.sum(values < 0)
    low, high = jnp.maximum(below - 1, 0), jnp.minimum(below, 5)
    rise = values[high] - values[low]
    share = jnp.where(rise > 0, -values[low] / jnp.where(rise > 0, rise, 1.0), 0.0)
    root = mu[low] + jnp.clip(share, 0.0, 1.0) * (mu[high] - mu[low])
    return jnp.clip(point + root * n, lower, upper), root


def _lagrange_newton(at: Jet, fixed: Array, right: Array, free: Array) -> Array:
    """The step s with W s - mu' n = right and n.s = -f, coordinates that are not free moving as `fixed` says.

    W is 1 - mu H with the multiplier mu of least squares, raised where it is not positive along the surface, so that
    the distance falls. It is `fixed` where there is no such step.
    """
    n = jnp.where(free, at.gradient, 0.0)
    square = jnp.sum(n * n)
    eye = jnp.eye(3, dtype=right.dtype)
    matrix = eye + jnp.sum(n * right) / jnp.where(square > 0, square, 1.0) * at.hessian
    least = least_curvature(matrix, n, free)
    matrix = matrix + jnp.where(least < -like_double(SADDLE, least.dtype), _DAMPED - 2 * least, 0.0) * eye
    still = jnp.where(free, 0.0, fixed)
    rows = jnp.where(free[:, None] & free, matrix, eye)
    columns = jnp.cross(jnp.roll(rows, -1, axis=0), jnp.roll(rows, -2, axis=0))
    determinant = jnp.sum(rows[0] * columns[0])
    inverse = columns.T / jnp.where(determinant != 0, determinant, 1.0)
    x = jnp.sum(inverse * jnp.where(free, right - jnp.sum(matrix * still, axis=1), 0.0), axis=1)
    y = jnp.sum(inverse * n, axis=1)
    slope = jnp.sum(n * y)
    lack = -at.value - jnp.sum(at.gradient * still) - jnp.sum(n * x)
    move = x + still + y * lack / jnp.where(slope != 0, slope, 1.0)
    sound = (determinant != 0) & (slope != 0) & jnp.all(jnp.isfinite(move))
    return jnp.where(sound, move, fixed)


def least_curvature(matrix: Array, normal: Array, free: Array) -> Array:
    """The smaller eigenvalue of a matrix on the free directions of a surface; at most zero where there is only one."""
    square = jnp.sum(normal * normal)
    unit = normal / jnp.sqrt(jnp.where(square > 0, square, 1.0))
    along = jnp.where(free, jnp.eye(3, dtype=normal.dtype), 0.0) - unit[:, None] * unit
    curved = jnp.sum(along[:, :, None] * jnp.sum(matrix[:, :, None] * along[None], axis=1)[None], axis=1)
    # One eigenvalue is zero; the others have this sum and the sum of squares of all entries.
    trace = jnp.trace(curved)
    return 0.5 * (trace - jnp.sqrt(jnp.maximum(2 * jnp.sum(curved * curved) - trace * trace, 0.0)))


def length(vector: Array) -> Array:
    """Euclidean length, with the derivative zero at zero."""
    square = jnp.sum(vector * vector, axis=-1)
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
