"""The maximum of the distance from one implicit surface in a box to another surface, near a candidate.

A box cuts its surface, so an extremum may lie on a face, an edge or a corner of the box. The faces that hold it are a
part of the solution: a face holds a coordinate while the sign of its multiplier says so and releases it otherwise, also
if the surface only touches the face. The result is a proposal, which the caller proves or discards; it is not
differentiable. The polynomials near the points limit the precision, so boxes far from the origin must be centered
first.

The unknowns of a maximum are the point p on a with a multiplier, the feet q_k on b with their signed distances t_k
along the unit normals N_k, the weights w_k and the distance d:

    f_a(p) = 0,  f_b(q_k) = 0,  p - q_k = t_k N_k,  |p - q_k| = d,  sum w_k = 1,  sum w_k u_k = lambda grad f_a(p)

with the unit vectors u_k from the feet to p. If a face holds a coordinate, its equation is replaced by the equation of
the face, and normals are gradients divided by the length of their free part. If no face holds a foot, u_k is its
normal, which is accurate on close surfaces, while p - q_k is lost to rounding.

Source: Karush-Kuhn-Tucker conditions of the maximum of a minimum; the events are those of Elber & Grandine, GMP 2008,
carried over to surfaces in a box.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Bool, Float

from jhd._arithmetic.polynomials import PolynomialJet, jets
from jhd._arithmetic.rounding import like_double
from jhd._arithmetic.scaling import length
from jhd._runtime.arrays import varying

# Rounds of the active set of a maximum, and Newton steps in each round.
_ROUNDS, _NEWTON = 6, 10
# Fractions of the size of the boxes: near a face, beyond a face, residual of a solution.
# The last two, and the numbers below, are meant for double precision.
_NEAR, _BEYOND, _CONVERGED = 1e-3, 1e-12, 1e-11
# A multiplier of a face or of a foot is negative below minus this, as a fraction of one.
_NEGATIVE = 1e-9
# Singular values below this fraction of the largest are zero: non-isolated maximizers do not move along themselves.
_SOLVED, _FLAT = 1e-13, 1e-10
# A face this near to being tangent to the surface is left free at first: sine of the angle.
_TANGENT = 0.05


class Polished(NamedTuple):
    """A local maximum of the smallest distance to some feet; feet that do not count have the multiplier zero."""

    point: Float[Array, "3"]
    feet: Float[Array, "4 3"]
    multipliers: Float[Array, "4"]
    distance: Float[Array, ""]
    converged: Bool[Array, ""]


class MaximumProblem(NamedTuple):
    """The data of a polish. Of the five rows the first belongs to p on a, the others to the feet on b."""

    f: Array  # (5, i, j, k)
    lower: Array  # (5, 3), in the coordinates of the unknowns, like the next two
    upper: Array
    start: Array
    center: Array  # (3,), origin of these coordinates
    size: Array  # their unit
    scale: Array  # (5,): values of the polynomials at points one unit from the surfaces

    def jets(self, x: Array) -> PolynomialJet:
        """Return value and gradient of each polynomial at its point."""
        return jax.vmap(jets)(self.f, self.center + self.size * x)

    def face(self, faces: Array) -> Array:
        """Return the position of the face that holds each coordinate, the upper face if none does."""
        return jnp.where(faces < 0, self.lower, self.upper)


class ActiveSet(NamedTuple):
    """The active set: -1 or 1 if the lower or the upper face holds a coordinate, and a mask of the feet that count."""

    faces: Array  # (5, 3)
    used: Array  # (4,)


class Unknowns(NamedTuple):
    """Points, multiplier of p and signed distances of the feet, weights, distance."""

    x: Array  # (5, 3)
    s: Array  # (5,)
    w: Array  # (4,)
    d: Array


def polish(
    fa: Float[Array, "i j k"],
    box_a: tuple[Float[Array, "3"], Float[Array, "3"]],
    fb: Float[Array, "l m n"],
    box_b: tuple[Float[Array, "3"], Float[Array, "3"]],
    point: Float[Array, "3"],
    feet: Float[Array, "4 3"],
    used: Bool[Array, "4"],
) -> Polished:
    """Return the local maximum over a of the smallest distance to feet on b, near a candidate.

    Every round solves the equations of one active set by Newton's method from the candidate, and revises the set. If
    the maximizers are not isolated (concentric spheres), one near the candidate is returned.

    Args:
        fa: coefficients of a.
        box_a: lower and upper corner of the box of a.
        fb: coefficients of b.
        box_b: lower and upper corner of the box of b.
        point: a point near a.
        feet: its feet, or points near them.
        used: which feet count, at least one.

    Returns:
        The point and the feet inside the closed boxes, as good as the equations are solved (their values are not
        exactly zero). Without convergence: the last iterate and equal weights.
    """
    places, dtype = jnp.concatenate([point[None], feet]), point.dtype
    solved_to, converged = like_double(_SOLVED, dtype), like_double(_CONVERGED, dtype)
    solver = lx.SVD(rcond=like_double(_FLAT, dtype))
    method = optx.Newton(rtol=solved_to, atol=solved_to, linear_solver=solver)
    problem, start, at = _started(_stacked(fa, box_a, fb, box_b), places, used / jnp.maximum(jnp.sum(used), 1))

    def turn(state: tuple) -> tuple:
        turns, active, _, _ = state
        solution = optx.root_find(_equations, method, start, (problem, active), max_steps=_NEWTON, throw=False)
        rest = jnp.stack([jnp.max(jnp.abs(x)) for x in _equations(solution.value, (problem, active))])
        known = jnp.all(jnp.isfinite(rest))
        found = jax.tree_util.tree_map(lambda x, y: jnp.where(known, x, y), solution.value, start)
        at = problem.jets(found.x)
        after = _revised(found, at, problem, active)
        same = jnp.all(after.faces == active.faces) & jnp.all(after.used == active.used)
        # A corner has no equation left to be on the surface.
        off = jnp.abs(at.value / problem.scale) > converged
        off = off.at[1:].set(off[1:] | _saddles(found, at, after.faces, problem.size))
        solved = same & known & jnp.all(rest <= converged) & ~off[0] & ~jnp.any(off[1:] & after.used)
        return jnp.where(same, _ROUNDS, turns + 1), after, found, solved

    faces = _first_faces(problem, at.gradient)
    start = _multiplied(start, at, faces)
    # A foot from which the distance falls along b misleads; another foot replaces it if there is one.
    nearest = used & ~_saddles(start, at, faces, problem.size)
    active = ActiveSet(faces, jnp.where(jnp.any(nearest), nearest, used))
    state = varying((jnp.array(0), active, start, jnp.array(False)), problem, start)
    _, active, found, solved = jax.lax.while_loop(lambda state: state[0] < _ROUNDS, turn, state)
    x = problem.center + problem.size * jnp.clip(found.x, problem.lower, problem.upper)
    weights = jnp.where(solved, jnp.where(active.used, jnp.clip(found.w, 0.0, 1.0), 0.0), start.w)
    return Polished(x[0], x[1:], weights, jnp.abs(found.d) * problem.size, solved)


class Shapes(NamedTuple):
    """The surface of the point and the surface of the feet, with coefficients of one shape."""

    f: Array  # (2, i, j, k)
    lower: Array  # (2, 3)
    upper: Array


def _stacked(fa: Array, box_a: tuple[Array, Array], fb: Array, box_b: tuple[Array, Array]) -> Shapes:
    """Return both surfaces with their coefficients padded to one shape."""
    shape = [max(sizes) for sizes in zip(fa.shape, fb.shape, strict=True)]
    padded = [jnp.pad(f, [(0, n - m) for n, m in zip(shape, f.shape, strict=True)]) for f in (fa, fb)]
    return Shapes(jnp.stack(padded), *(jnp.stack(corners) for corners in zip(box_a, box_b, strict=True)))


def _started(shapes: Shapes, places: Array, weights: Array) -> tuple[MaximumProblem, Unknowns, PolynomialJet]:
    """Return the problem about the first of five points, in units of the boxes, all unknowns there, and the jets."""
    owner = jnp.array([0, 1, 1, 1, 1])
    center, size = places[0], jnp.max(shapes.upper - shapes.lower)
    lower, upper = ((x[owner] - center) / size for x in (shapes.lower, shapes.upper))
    x = (places - center) / size
    problem = MaximumProblem(shapes.f[owner], lower, upper, x, center, size, jnp.ones(5, size.dtype))
    at = problem.jets(x)
    slopes = length(at.gradient)
    slopes = jnp.where(slopes > 0, slopes, 1.0)
    s = -jnp.sum(x * at.gradient, axis=-1) / slopes
    start = Unknowns(x, s, weights, jnp.sum(weights * length(x[1:])))
    return problem._replace(scale=slopes * size), start, at


class Balance(NamedTuple):
    """The terms of the equations; `pull` is the residual of u_k or p - q_k, and vanishes if no face holds."""

    values: Array  # (5,), of the polynomials
    slopes: Array  # (5,), lengths of the free parts of their gradients, one if there are none
    pull: Array  # (5, 3)
    distances: Array  # (4,)


def _balance(y: Unknowns, at: PolynomialJet, faces: Array) -> Balance:
    """Return the terms at some values of the unknowns, from the jets there."""
    slopes = length(jnp.where(faces == 0, at.gradient, 0.0))
    slopes = jnp.where(slopes > 0, slopes, 1.0)
    normals = at.gradient / slopes[:, None]
    apart = y.x[0] - y.x[1:]
    lengths = length(apart)
    signs = jax.lax.stop_gradient(jnp.where(y.s[1:] < 0, -1.0, 1.0))
    along = jnp.all(faces[1:] == 0, axis=-1)
    directions = apart / jnp.where(lengths > 0, lengths, 1.0)[:, None]
    units = jnp.where(along[:, None], signs[:, None] * normals[1:], directions)
    pull = jnp.concatenate([jnp.sum(y.w[:, None] * units, axis=0)[None], apart]) - y.s[:, None] * normals
    return Balance(at.value, slopes, pull, jnp.where(along, signs * y.s[1:], lengths))


def _equations(y: Unknowns, args: tuple[MaximumProblem, ActiveSet]) -> tuple:
    """Return the equations of the module's docstring for one active set, as many as there are unknowns."""
    problem, (faces, used) = args
    terms, free = _balance(y, problem.jets(y.x), faces), faces == 0
    counts = jnp.concatenate([jnp.ones(1, bool), used])
    rows = jnp.where(free, terms.pull, y.x - problem.face(faces))
    closed = jnp.where(jnp.any(free, axis=-1), terms.values / problem.scale, y.s)
    return (
        jnp.where(counts[:, None], rows, y.x - problem.start),
        jnp.where(counts, closed, y.s),
        jnp.where(used, terms.distances - y.d, y.w),
        jnp.sum(y.w) - 1.0,
    )


def _first_faces(problem: MaximumProblem, gradients: Array) -> Array:
    """Return the faces within a fraction of the size of the start, except faces that the surface nearly touches."""
    x = problem.start
    faces = jnp.where(x <= problem.lower + _NEAR, -1.0, jnp.where(x >= problem.upper - _NEAR, 1.0, 0.0))
    slopes = length(gradients)[:, None]
    rest = length(jnp.where(faces == 0, gradients, 0.0))[:, None]
    touched = (rest <= _TANGENT * slopes) & jnp.any(faces == 0, axis=-1, keepdims=True)
    # Of the faces at an edge, the faces across the surface go on holding.
    return jnp.where(touched & (jnp.abs(gradients) > _TANGENT * slopes), 0.0, faces)


def _multiplied(y: Unknowns, at: PolynomialJet, faces: Array) -> Unknowns:
    """Return the unknowns with the least-squares multipliers of p and of the feet."""
    y = y._replace(s=y.s.at[0].set(0.0))
    terms = _balance(y, at, faces)
    normals = jnp.where(faces == 0, at.gradient, 0.0) / terms.slopes[:, None]
    feet = jnp.sum((y.x[0] - y.x[1:]) * normals[1:], axis=-1)
    return y._replace(s=jnp.concatenate([jnp.sum(terms.pull[0] * normals[0])[None], feet]))


def _revised(y: Unknowns, at: PolynomialJet, problem: MaximumProblem, active: ActiveSet) -> ActiveSet:
    """Return the next active set: faces that were passed hold; faces and feet with negative multipliers let go."""
    terms = _balance(y, at, active.faces)
    unit = jnp.concatenate([jnp.ones(1), jnp.where(terms.distances > 0, terms.distances, 1.0)])
    outward = active.faces * terms.pull / unit[:, None]
    passed = _passed(y.x, problem)
    faces = jnp.where(
        active.faces == 0, passed, jnp.where(outward < -like_double(_NEGATIVE, outward.dtype), 0.0, active.faces)
    )
    # One foot at a time, the one with the most negative weight.
    used = active.used & ~((jnp.arange(4) == jnp.argmin(y.w)) & (y.w < -like_double(_NEGATIVE, y.w.dtype)))
    counts = jnp.concatenate([jnp.ones(1, bool), active.used])
    return ActiveSet(jnp.where(counts[:, None], faces, active.faces), used)


def _saddles(y: Unknowns, at: PolynomialJet, faces: Array, size: Array) -> Array:
    """Return a mask of the feet from which the distance falls along b, to second order."""

    def least(s: Array, gradient: Array, hessian: Array, held: Array) -> Array:
        normal = jnp.where(held == 0, gradient, 0.0)
        slope = length(normal)
        matrix = jnp.eye(3, dtype=s.dtype) + s * size / jnp.where(slope > 0, slope, 1.0) * hessian
        return _least_curvature(matrix, normal, held == 0)

    # Curvatures of half the squared distance, which is one on a plane, below which a point is not a nearest point.
    return jax.vmap(least)(y.s[1:], at.gradient[1:], at.hessian[1:], faces[1:]) < -like_double(1e-6, y.s.dtype)


def _passed(x: Array, problem: MaximumProblem) -> Array:
    """Return the faces that each point passes first on the way from its start, as -1 and 1."""
    room = like_double(_BEYOND, x.dtype)
    beyond = jnp.where(x < problem.lower - room, -1.0, jnp.where(x > problem.upper + room, 1.0, 0.0))
    way = jnp.where(beyond != 0, x - problem.start, 1.0)
    share = jnp.where(beyond != 0, (problem.face(beyond) - problem.start) / jnp.where(way != 0, way, 1.0), jnp.inf)
    return jnp.where(share <= jnp.maximum(jnp.min(share, axis=-1, keepdims=True), 0.0), beyond, 0.0)


def _least_curvature(matrix: Array, normal: Array, free: Array) -> Array:
    """Return the smaller eigenvalue of a matrix on the free directions of a surface; at most zero for one direction."""
    square = jnp.sum(normal * normal)
    unit = normal / jnp.sqrt(jnp.where(square > 0, square, 1.0))
    along = jnp.where(free, jnp.eye(3, dtype=normal.dtype), 0.0) - unit[:, None] * unit
    curved = jnp.sum(along[:, :, None] * jnp.sum(matrix[:, :, None] * along[None], axis=1)[None], axis=1)
    # One eigenvalue is zero; the others have this sum and the sum of squares of all entries.
    trace = jnp.trace(curved)
    return 0.5 * (trace - jnp.sqrt(jnp.maximum(2 * jnp.sum(curved * curved) - trace * trace, 0.0)))
