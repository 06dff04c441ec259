"""Derivatives of a Hausdorff distance of implicit surfaces in both polynomials and in both boxes.

The search is not differentiated. At its witness the equations of jhd.distance.witness.polish hold, and the distance has
the derivative of their Lagrange function: with the multipliers lambda of a and t_k of the feet, normalised by the
length s of the free part of a gradient (components that a face holds left out),

    dh = -lambda df_a(p) / s_a + sum w_k (t_k / h) df_b(q_k) / s_k
         + sum over held coordinates of p of the pull at p times the motion of the face
         - sum over held coordinates of q_k of w_k times the pull at q_k times the motion of the face,

where the pulls are what is left of the unit vector u_k from the foot to p, weighted for p, after its part along the
normal. The second derivatives follow from the motion -J^-1 dG of the point, of the feet and of the multipliers. Where
the equations are singular (families of maximisers, more feet than a surface has room for) nothing moves, which leaves
the first derivatives as they are.

Where several places are equally far, the derivative is that of the witness named, one of the generalised derivatives of
the maximum, and in a direction of change where it is the largest one, the one-sided derivative. A face that only
touches does not hold. Where the distance is zero it is not differentiable, and zero is taken; zero is also the share of
a surface whose gradient vanishes at its place, where the point can have any speed.

Source: Danskin's theorem and the envelope theorem; implicit differentiation of the Karush-Kuhn-Tucker conditions.
"""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from jhd._results.solution import DIRECTIONS, HausdorffSolution, Witness, on_device
from jhd._runtime.arrays import is_traced
from jhd._runtime.compiled import compiled
from jhd.arithmetic.rounding import like_double
from jhd.distance.witness.polish import (
    ActiveSet,
    MaximumProblem,
    Shapes,
    Unknowns,
    balance,
    equations,
    first_faces,
    multiplied,
    posed,
    revised,
    stacked,
    started,
)
from jhd.shapes.implicit import ImplicitSurface

# Singular values of the equations below this share of the largest make them singular.
_SINGULAR = 1e-10
# A foot does not count at a weight below this.
_WEIGHTLESS = 1e-12
# Share of the size of the boxes within which a place lies on a face.
_TOUCHING = 1e-9


class _System(NamedTuple):
    """What the equations need besides the surfaces: coordinates, active set, and where the unknowns are."""

    centre: Array
    size: Array
    scale: Array
    active: ActiveSet
    start: Unknowns

    def problem(self, shapes: Shapes) -> MaximumProblem:
        """The equations of these surfaces."""
        return posed(shapes, self.centre, self.size)._replace(scale=self.scale, start=self.start.x)


def with_surface_derivatives(solution: HausdorffSolution, a: ImplicitSurface, b: ImplicitSurface) -> HausdorffSolution:
    """The solution, its value differentiable in the coefficients and in the boxes of both surfaces, twice.

    The number stays as it is, and the witness is a constant. It does nothing where neither surface is traced.

    Args:
        solution: the distance of a and b, its witness in the same coordinates: a point on its surface, up to four feet
            with multipliers, unused rows with multiplier zero. Its direction says which surface carries the point.
        a: the first surface.
        b: the second surface.
    """
    if not is_traced(a, b):
        return solution
    solution = on_device(solution)
    return replace(solution, value=_attached(solution.value, a, b, solution.witness))


@compiled
def _attached(value: Array, a: ImplicitSurface, b: ImplicitSurface, witness: Witness) -> Array:
    """The same number, with the derivatives of the equations of the witness."""
    given = stacked(a.coefficients, a.box(), b.coefficients, b.box())
    turned = witness.direction == DIRECTIONS.b_to_a
    shapes = Shapes(*(jnp.where(turned, x[::-1], x) for x in given))
    fixed = jax.lax.stop_gradient((value, shapes, witness))
    return _with_rule(fixed[0], shapes, _system(*fixed[1:]))


def _system(shapes: Shapes, witness: Witness) -> _System:
    """The active set of the witness: faces it lies on, less those with a negative multiplier."""
    places = jnp.concatenate([witness.point[None], witness.feet])
    used = witness.multipliers > like_double(_WEIGHTLESS, witness.multipliers.dtype)
    used = used | (~jnp.any(used) & (jnp.arange(4) == 0))
    problem, start, at = started(shapes, places, witness.multipliers)
    active = ActiveSet(first_faces(problem, at.gradient, like_double(_TOUCHING, at.gradient.dtype)), used)
    faces = revised(multiplied(start, at, active.faces), at, problem, active).faces
    start = multiplied(start, at, faces)
    return _System(problem.centre, problem.size, problem.scale, ActiveSet(faces, used), start)


# Functions with rules of their own give scalars; see jhd.distance.witness.active on why.
@jax.custom_jvp
def _with_rule(value: Array, shapes: Shapes, system: _System) -> Array:
    return value


@_with_rule.defjvp
def _rule(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    value, shapes, system = primals
    y = _unknowns(_solution(shapes, system), system)
    return value, jnp.where(value > 0, _stretch(y, shapes, tangents[1], system), 0.0)


def _stretch(y: Unknowns, shapes: Shapes, moved: Shapes, system: _System) -> Array:
    """The derivative of the distance by the formula of the module's docstring."""
    problem, (faces, used) = system.problem(shapes), system.active

    def at_rest(x: Shapes) -> tuple[Array, Array]:
        there = system.problem(x)
        return there.jets(y.x).value, there.face(faces)

    _, (values, walls) = jax.jvp(at_rest, (shapes,), (moved,))
    terms = balance(y, problem.jets(y.x), faces)
    pushed = jnp.sum(jnp.where(faces != 0, terms.pull * walls, 0.0), axis=-1) * system.size
    own = pushed - y.s * values / terms.slopes
    distances = jnp.where(terms.distances > 0, terms.distances, 1.0)
    return own[0] - jnp.sum(jnp.where(used, y.w * own[1:] / distances, 0.0))


def _unknowns(numbers: tuple, system: _System) -> Unknowns:
    return ravel_pytree(system.start)[1](jnp.stack(numbers))


def _left(flat: Array, shapes: Shapes, system: _System) -> Array:
    """The equations as one vector."""
    y = _unknowns(tuple(flat), system)
    return ravel_pytree(equations(y, (system.problem(shapes), system.active)))[0]


@jax.custom_jvp
def _solution(shapes: Shapes, system: _System) -> tuple:
    """The unknowns that solve the equations next to the witness, as a function of the surfaces."""
    return tuple(ravel_pytree(system.start)[0])


@_solution.defjvp
def _solution_rule(primals: tuple, tangents: tuple) -> tuple[tuple, tuple]:
    shapes, system = primals
    found = _solution(shapes, system)
    y = jnp.stack(found)
    _, moved = jax.jvp(lambda x: _left(y, x, system), (shapes,), (tangents[0],))
    return found, tuple(-_solved(jax.jacfwd(_left)(y, shapes, system), moved))


def _solved(matrix: Array, right: Array) -> Array:
    """The solution of a linear system; zero where it is singular."""
    sizes = jnp.linalg.svd(jax.lax.stop_gradient(matrix), compute_uv=False)
    regular = sizes[-1] > like_double(_SINGULAR, sizes.dtype) * sizes[0]
    safe = jnp.where(regular, matrix, jnp.eye(matrix.shape[0], dtype=matrix.dtype))
    return jnp.where(regular, jnp.linalg.solve(safe, right), 0.0)
