"""Derivatives of nearest points on surfaces: of the distance, of the foot and of its parameters, in query and surface.

The foot solves equations. On a patch the distance is stationary in the parameters that no border holds. On an implicit
surface the polynomial is zero and the query lies on the normal, in the coordinates that no face holds. Two Newton steps
from the foot found, which is a constant, carry first and second derivatives. If the equations are singular (a whole
region is equally near), nothing moves, which leaves the first derivative of the distance unchanged. At a pole, which is
a free foot on a collapsed edge, one piece does not determine how the foot moves: its derivatives and the second
derivatives of the distance are NaN. They are also NaN close to a pole, within the root of rounding, if distances do not
determine which piece has the foot.

Along the normal of a surface the distance keeps its digits if the query is close. At distance zero the derivative is
zero by convention.
"""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._arithmetic.polynomials import jets, rescaled, slopes
from jhd._arithmetic.scaling import common_exponent, length, scale_of, unit
from jhd._distance.nearest.feet import presses
from jhd._distance.normalization.custom_derivatives import at_rest, attached, without_derivative
from jhd._distance.normalization.net_jets import Net, jet
from jhd._results.solution import Projection
from jhd._runtime.arrays import varying
from jhd._runtime.compiled import compiled

# Distances determine a foot to the root of this many units of roundoff. This near to a collapsed edge, the foot is
# known if the distance is stationary, to an angle of this many units.
_TOLD, _STATIONARY = 32, 2.0**15
# Newton steps before the differentiated ones, and the largest move of a foot in one step, as a fraction of the piece.
_POLISHING, _KNOWN = 8, 1e-6
# Largest turn around a pole in one step, as a fraction of the parameters.
_TURN = 0.5
# The equations are singular if their determinant is below this fraction of its largest possible value.
_SINGULAR = 1e-8


def with_patch_derivatives(found: Projection, queries: Array, net: Net) -> Projection:
    """Return nearest points (points, ...) of a net, differentiable in the queries and in the net."""
    distance, foot, t = distances_from_patches(queries, found.element, found.t, net)
    return attached(attached(found, found.distance > 0, distance=distance), foot=foot, t=t)


def with_surface_derivatives(found: Projection, queries: Array, surface: Any) -> Projection:
    """Return nearest points of an implicit surface, differentiable in queries, coefficients and box."""
    coefficients, box = surface.coefficients, jnp.stack(surface.bounds)
    distance, foot = distance_from_surface(queries, found.foot, coefficients, box)
    return attached(attached(found, found.distance > 0, distance=distance), foot=foot)


@compiled
def distances_from_patches(queries: Array, segment: Array, t: Array, net: Net) -> tuple[Array, Array, Array]:
    """Return distances, feet and parameters on pieces of a net, as functions of queries and net."""
    n = net.parameters
    # If nothing is proven there is no foot; its derivatives are not used, but they must be numbers.
    segment, t = jnp.maximum(segment, 0), jnp.where(jnp.isfinite(t), t, 0.0)

    def one(query: Array, k: Array, t: Array) -> tuple[Array, Array, Array]:
        piece, x = net.piece(k), t[:n]
        # Relative to the foot all digits are kept: near a collapsed edge first derivatives are as short as its
        # distance.
        origin = jax.lax.stop_gradient(jet(piece, x).point)
        offsets = piece.points - origin
        scale = scale_of(common_exponent(jax.lax.stop_gradient(piece.points - query)), offsets.dtype)
        piece, apart = Net(offsets * scale, piece.weights), (origin - query) * scale
        still = jax.lax.stop_gradient((piece, apart))
        x = _polished(*still, jax.lax.stop_gradient(x)) if n == 2 else x
        held, pole = _held(*still, x)
        for _ in range(2):
            at = jet(piece, x)
            step = _step(apart, at, held, apart + at.point)
            x = x + jnp.where(jnp.all(jnp.isfinite(step)), step, 0.0)
        x = without_derivative(x, pole)
        distance = at_rest(_distance_at, (x, held), (piece, apart))
        return distance / scale, jet(piece, x).point / scale + origin, jnp.concatenate([x, t[n:]])

    return jax.vmap(one)(queries, segment, t)


def _polished(piece: Net, apart: Array, x: Array) -> Array:
    """Return the parameters after Newton steps, each of which moves the foot by at most its uncertainty.

    Distances determine a foot to the root of rounding, which is far along a collapsed edge close to it. The part of the
    offset along the surface is left out of second derivatives: with it Newton's method turns around a pole by less than
    45 degrees, and without it by nearly 90.
    """
    most = _KNOWN * _size(piece)

    def newton(_: Any, x: Array) -> Array:
        held, _pole = _held(piece, apart, x)
        at = jet(piece, x)
        normal = unit(jnp.cross(*at.first))
        pull = jnp.where(jnp.any(held), apart + at.point, jnp.sum(normal * (apart + at.point)) * normal)
        step = _step(apart, at, held, pull)
        lengths = jnp.sqrt(jnp.sum(at.first**2, axis=-1))
        return x + jnp.where(jnp.all(jnp.abs(step) * lengths <= most), jnp.clip(step, -_TURN, _TURN), 0.0)

    return jax.lax.fori_loop(0, _POLISHING, newton, varying(x, piece, apart))


def _size(piece: Net) -> Array:
    return jnp.max(jnp.abs(piece.points - piece.points[0, 0]))


def _distance_at(settled: tuple[Array, Array], given: tuple[Net, Array]) -> Array:
    """Return the distance from the origin of a moved piece, at parameters that are stationary or held.

    To first order it does not change with these parameters. Autodiff adds the rounding error of this slope times their
    speed, which is large near a collapsed edge.
    """
    (x, held), (piece, apart) = settled, given
    at = jet(piece, x)
    free = ~jnp.any(held) if x.size == 2 else False
    normal = jnp.cross(at.first[0], at.first[1]) if x.size == 2 else jnp.zeros_like(at.point)
    return _length(apart + at.point, normal, free)


def _held(piece: Net, apart: Array, x: Array) -> tuple[Array, Array]:
    """Return a mask of the parameters that do not move, and whether the motion of the foot is unknown, as at a pole.

    Parameters are held by a border, along collapsed edges, and all of them at singular feet.
    """
    at, eps = jet(piece, x), float(jnp.finfo(x.dtype).eps)
    slope = at.first @ (apart + at.point)
    lengths = jnp.sqrt(jnp.sum(at.first**2, axis=-1))
    size, distance = _size(piece), length(apart + at.point)
    # A derivative this much shorter than the size of the piece belongs to a collapsed edge; above, feet have six
    # digits.
    collapsed = lengths <= 1e-10 * size
    sizes = lengths * distance
    # On a collapsed edge a neighboring piece may hold the foot, within its uncertainty.
    pressed = presses(x, slope, sizes) & ~(jnp.any(collapsed) & (jnp.abs(slope) <= _KNOWN * sizes))
    # This near to the edge distances do not determine which piece has the foot: it is unknown if hardly stationary.
    told = jnp.sqrt(_TOLD * eps * size * (size + distance))
    pull = jnp.abs(slope) / jnp.where(sizes > 0, sizes, 1.0)
    beside = jnp.any(~collapsed & (lengths <= told) & (pull > _STATIONARY * eps) & (pull <= _KNOWN))
    pole = jnp.any(collapsed) & ~jnp.all(collapsed | pressed) | beside
    held = pressed | collapsed
    hessian = _hessian(at, apart + at.point, held)
    most = jnp.prod(jnp.sum(jnp.abs(hessian), axis=-1))
    return held | ~(jnp.abs(_determinant(hessian)) > _SINGULAR * most), pole


def _hessian(at: Any, pull: Array, held: Array) -> Array:
    """Return the Hessian of half the squared distance, in parameters that are lengths, for the offset `pull`."""
    per_length = _per_length(at, held)
    hessian = jnp.sum(at.first[:, None] * at.first[None], axis=-1) + jnp.sum(at.second * pull, axis=-1)
    hessian = hessian * per_length[:, None] * per_length[None, :]
    return jnp.where(held[:, None] | held[None, :], jnp.eye(held.size, dtype=hessian.dtype), hessian)


def _per_length(at: Any, held: Array) -> Array:
    """Return the change of the parameters along a unit of length; one for parameters that do not move."""
    lengths = jax.lax.stop_gradient(jnp.sqrt(jnp.sum(at.first**2, axis=-1)))
    return 1 / jnp.where(held | (lengths == 0), 1.0, lengths)


def _determinant(m: Array) -> Array:
    return m[0, 0] if m.shape[0] == 1 else m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]


def _step(apart: Array, at: Any, held: Array, pull: Array) -> Array:
    """Return Newton's step towards a stationary distance."""
    per_length = _per_length(at, held)
    right = jnp.where(held, 0.0, -jnp.sum(at.first * (apart + at.point), axis=-1) * per_length)
    hessian = _hessian(at, pull, held)
    if right.size == 1:
        return right / hessian[0] * per_length
    rows = jnp.stack([hessian[1, 1], -hessian[0, 1]]), jnp.stack([-hessian[1, 0], hessian[0, 0]])
    return jnp.stack([jnp.sum(row * right) for row in rows]) / _determinant(hessian) * per_length


def _length(apart: Array, normal: Array, free: Array | bool) -> Array:
    """Return the length of a vector, by the normal if the foot is free and has one."""
    square = jnp.sum(normal**2)
    sound = free & (square > 0)
    along = jnp.sum(apart * normal) / jnp.sqrt(jnp.where(sound, square, 1.0))
    signed = jnp.where(jax.lax.stop_gradient(along) < 0, -along, along)
    return jnp.where(sound, signed, length(apart))


@compiled
def distance_from_surface(queries: Array, feet: Array, coefficients: Array, box: Array) -> tuple[Array, Array]:
    """Return distances and feet on an implicit surface, as functions of all but the feet."""
    scale = scale_of(common_exponent(jax.lax.stop_gradient(box)), box.dtype)
    c = rescaled(coefficients, scale)
    box = box * scale
    # If nothing is proven there is no foot; its derivatives are not used, but they must be numbers.
    feet = jnp.where(jnp.isfinite(feet), feet, 0.0)

    def one(query: Array, foot: Array) -> tuple[Array, Array]:
        p = query * scale
        x = jax.lax.stop_gradient(foot) * scale
        x, faces = jax.lax.stop_gradient((x, box))
        at_low, at_high = x <= faces[0], x >= faces[1]
        y, usable, held = _start(c, x, jax.lax.stop_gradient(p), at_low, at_high)
        walls = jnp.where(at_low, box[0], box[1])

        def equations(y: Array, p: Array, c: Array, walls: Array) -> Array:
            at = jets(c, y[:3])
            pull = jnp.where(held, y[:3] - walls, y[:3] - p + y[3] * at.gradient)
            return jnp.append(pull, at.value)

        for _ in range(2):
            slope = jax.jacfwd(equations)(y, p, c, walls)
            slope = jnp.where(usable, slope, jnp.eye(4, dtype=slope.dtype))
            step = jnp.linalg.solve(slope, equations(y, p, c, walls))
            y = y - jnp.where(usable, step, 0.0)
        normal = slopes(c, y[:3])[1]
        # If the unknowns do not move, faces still move, and the surface moves along the normal by its own speed.
        distance = jnp.where(usable, _length(p - y[:3], normal, ~jnp.any(held)), _length(p - y[:3], normal, False))
        return distance / scale, y[:3] / scale

    return jax.vmap(one)(queries, feet)


def _start(c: Array, x: Array, p: Array, at_low: Array, at_high: Array) -> tuple[Array, Array, Array]:
    """Return foot and multiplier, whether their equations can be solved, and which coordinates faces hold.

    A face holds if the query pulls the foot beyond it.
    """
    at = jets(c, x)
    border = at_low | at_high
    multiplier = _multiplier(at.gradient, p - x, border)
    # First all faces hold; faces with an inward pull let go.
    pull = p - x - multiplier * at.gradient
    held = (at_low & (pull < 0)) | (at_high & (pull > 0))
    multiplier = _multiplier(at.gradient, p - x, held)
    hessian = jnp.eye(3) + multiplier * at.hessian
    matrix = jnp.where(held[:, None], jnp.eye(3, dtype=x.dtype), hessian)
    column = jnp.where(held, 0.0, at.gradient)
    top = jnp.concatenate([matrix, column[:, None]], axis=1)
    system = jnp.concatenate([top, jnp.append(at.gradient, 0.0)[None]])
    rows = jnp.prod(jnp.sum(jnp.abs(system), axis=1))
    usable = jnp.abs(jnp.linalg.det(system)) > _SINGULAR * rows
    return jnp.append(x, multiplier), usable & (rows > 0), held


def _multiplier(gradient: Array, apart: Array, held: Array) -> Array:
    free = jnp.where(held, 0.0, gradient)
    square = jnp.sum(free**2)
    return jnp.sum(free * apart) / jnp.where(square > 0, square, jnp.inf)
