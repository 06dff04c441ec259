"""The active system: the equations that hold at a witness, and the distance there, as functions of both curves.

At a witness the parameter t on a and the feet s1, s2 on b solve three equations G = 0. A foot is free, (A - B).B' = 0,
or held at an end or corner of b. The parameter is held at an end or corner of a, or set by equal distances of two feet,
or by (A - B).A' = 0. In the plane the last equation is B' x A' = 0 at a free foot if the normal of b is more exact than
A - B (jhd._distance.nearest.feet.by_normal). The distance is taken along this normal, too.

The value has the derivative lambda_1 d1 + lambda_2 d2, where d_i is the derivative of the distance to foot i at fixed
parameters and lambda the multipliers of the witness; a single foot has lambda = 1, and at an end or corner of a the
multipliers are constants (jhd._distance.witness.multipliers). The parameters y move by -J^-1 dG, and the Jacobian J is
small enough for Cramer's rule. `solution` is y as a function of both curves, whose derivative is written with
`solution` again, so that derivatives of all orders are right. If the determinant vanishes (concentric arcs, whose
maximum is not isolated), nothing moves.

Source: the events are those of Elber & Grandine, GMP 2008; implicit differentiation is Danskin's theorem for one foot.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jhd._distance.nearest.feet import by_normal, equation, is_held
from jhd._distance.normalization.jets import CurveJet, jet
from jhd._distance.normalization.pieces import Piece, is_point
from jhd._results.solution import EVENTS
from jhd._runtime.arrays import varying


class Active(NamedTuple):
    """The pieces that carry a witness and its feet, a mask of the held parameters, and whether both feet count."""

    a: Piece
    first: Piece
    second: Piece
    held: Array  # (3,)
    two: Array

    @property
    def pieces(self) -> "Pieces":
        """The three pieces."""
        return self.a, self.first, self.second


Pieces = tuple[Piece, Piece, Piece]


def active(a: Piece, first: Piece, second: Piece, y: Array, event: Any, multipliers: Array) -> Active:
    """Return the system of an event at the parameters y = (t, s1, s2); at ends the multipliers determine the feet."""
    at = jet(*a, y[0]).point
    ends = (event == EVENTS.a_end) | (event == EVENTS.corner)
    two = (event == EVENTS.one_to_two) | ends & jnp.all(multipliers > 0)
    ends = ends | is_point(a)
    stay = jnp.stack([ends, is_held(at, first, y[1]), is_held(at, second, y[2]) | ~two])
    return Active(a, first, second, stay, two)


class _Jets(NamedTuple):
    """Jets of a and of both feet."""

    a: CurveJet
    b: CurveJet
    d: CurveJet


def _jets(y: Array, pieces: Pieces) -> _Jets:
    feet = jax.tree_util.tree_map(lambda *x: jnp.stack(x), *pieces[1:])
    both = jax.vmap(lambda piece, s: jet(*piece, s))(feet, y[1:])
    return _Jets(jet(*pieces[0], y[0]), *(CurveJet(*(x[k] for x in both)) for k in (0, 1)))


class _Products(NamedTuple):
    """Scalar products (10, 10) of c, e, c + e, c - e and the derivatives at a and both feet; crossed in the plane."""

    dot: Array
    crossed: Array | None

    @classmethod
    def of(cls, jets: _Jets) -> "_Products":
        """Compute all products at once: compiling takes longer for each separate operation."""
        a, b, d = jets
        c, e = a.point - b.point, a.point - d.point
        # c - e without rounding c and e.
        rows = jnp.stack([c, e, c + e, d.point - b.point, a.first, a.second, b.first, b.second, d.first, d.second])
        # A sum keeps the batch axis of vmap in front; a matrix product may move it.
        dot = jnp.sum(rows[:, None] * rows, axis=-1)
        crossed = rows[:, None, 0] * rows[:, 1] - rows[:, None, 1] * rows[:, 0] if c.shape[0] == 2 else None
        return cls(dot, crossed)

    def along_normal(self, held: Array) -> Array:
        """Return whether the first foot is free and the normal there gives its direction."""
        return ~held & by_normal(self.dot[_C, _C], self.dot[_B1, _B1])


# The rows of the products.
_C, _E, _SUM, _APART, _A1, _A2, _B1, _B2, _D1, _D2 = range(10)


def _equations(jets: _Jets, system: Active) -> Array:
    """Return G without the equations of the parameters that are held."""
    products = _Products.of(jets)
    dot, crossed = products
    stationary = dot[_C, _A1]
    if crossed is not None:
        stationary = jnp.where(products.along_normal(system.held[1]), crossed[_B1, _A1], stationary)
    # (c + e).(c - e): the difference of the squares without cancellation.
    return jnp.stack([jnp.where(system.two, dot[_SUM, _APART], stationary), dot[_C, _B1], dot[_E, _D1]])


def _jacobian(jets: _Jets, system: Active) -> Array:
    """Return the rows of dG/dy; rows of held parameters are unit vectors."""
    products = _Products.of(jets)
    dot, crossed = products
    zero = jnp.zeros((), dot.dtype)
    along = jnp.stack([dot[_A1, _A1] + dot[_C, _A2], -dot[_B1, _A1], zero])
    if crossed is not None:
        normal = jnp.stack([crossed[_B1, _A2], crossed[_B2, _A1], zero])
        along = jnp.where(products.along_normal(system.held[1]), normal, along)
    equal = 2 * jnp.stack([dot[_A1, _APART], -dot[_C, _B1], dot[_E, _D1]])
    rows = [
        jnp.where(system.two, equal, along),
        jnp.stack([dot[_A1, _B1], dot[_C, _B2] - dot[_B1, _B1], zero]),
        jnp.stack([dot[_A1, _D1], zero, dot[_E, _D2] - dot[_D1, _D1]]),
    ]
    return jnp.where(system.held[:, None], jnp.eye(3, dtype=dot.dtype), jnp.stack(rows))


def _solve(rows: Array, right: Array) -> Array:
    """Return the solution by Cramer's rule; zero if the determinant vanishes.

    The inverse has the cross products of the rows as columns. It is formed apart from the right-hand side, in which
    rules of derivatives must be linear term by term.
    """
    first, second, third = rows
    columns = jnp.stack([jnp.cross(second, third), jnp.cross(third, first), jnp.cross(first, second)])
    determinant = first @ columns[0]
    size = jnp.prod(jnp.sqrt(jnp.sum(jax.lax.stop_gradient(rows) ** 2, axis=1)))
    # A determinant below this fraction of the product of the lengths of its rows is zero.
    regular = jnp.abs(determinant) > 1e-10 * size
    return jnp.where(regular, right @ (columns / jnp.where(regular, determinant, 1.0)), 0.0)


def stationary(s: Array, point: Array, piece: Piece, held: Array) -> Array:
    """Return the parameter of a foot after a Newton step of (B - P).B' = 0, if it is free and the root is simple."""
    here = equation(point, piece, s)
    moves = ~held & here.is_simple
    return s - jnp.where(moves, here.residual, 0.0) / jnp.where(moves, here.slope, 1.0)


def newton(y: Array, system: Active) -> Array:
    """Return y after one Newton step; y itself if the determinant vanishes."""
    jets = _jets(y, system.pieces)
    return y - _solve(_jacobian(jets, system), jnp.where(system.held, 0.0, _equations(jets, system)))


def solution(start: Array, pieces: Pieces, held: Array, two: Array) -> Array:
    """Return the solution of the system next to `start`, as a function of the pieces."""
    return jnp.stack(_solution((start[0], start[1], start[2]), pieces, held, two))


# Functions with rules of their own take and give scalars, but for the pieces. Under jit(vmap) an output must be batched
# wherever its derivative is (jax 0.10.2 fails otherwise), and a scalar leaves no choice of a batch axis.
@jax.custom_jvp
def _solution(start: tuple, pieces: Pieces, held: Array, two: Array) -> tuple[Array, ...]:
    system = Active(pieces[0], pieces[1], pieces[2], held, two)
    # Two steps in a loop: compiling takes longer for each separate operation.
    y = jax.lax.fori_loop(0, 2, lambda _, y: newton(y, system), varying(jnp.stack(start), pieces, held, two))
    return y[0], y[1], y[2]


@_solution.defjvp
def _solution_rule(primals: tuple, tangents: tuple) -> tuple[tuple, tuple]:
    start, pieces, held, two = primals
    found = _solution(start, pieces, held, two)
    system, y = Active(pieces[0], pieces[1], pieces[2], held, two), jnp.stack(found)
    _, moved = jax.jvp(lambda p: _equations(_jets(y, p), system), (pieces,), (tangents[1],))
    change = -_solve(_jacobian(_jets(y, pieces), system), jnp.where(held, 0.0, moved))
    return found, (change[0], change[1], change[2])


def direction(c: Array, velocity: Array, held: Array) -> Array:
    """Return the unit vector along c, from a foot to the witness: the normal of b if that is known."""
    square = c @ c
    unit = c / jnp.sqrt(jnp.where(square > 0, square, 1.0))
    if c.shape[0] == 3:
        return unit
    speed_sq = velocity @ velocity
    known = ~held & by_normal(square, speed_sq)
    normal = jnp.stack([-velocity[1], velocity[0]]) / jnp.sqrt(jnp.where(known, speed_sq, 1.0))
    return jnp.where(known, jnp.where(normal @ c < 0, -normal, normal), unit)


def places(y: Array, pieces: Pieces) -> tuple[Array, Array]:
    """Return the witness, and both feet in rows."""
    a, first, second = _jets(y, pieces)
    return a.point, jnp.stack([first.point, second.point])


def distance(y: Array, system: Active) -> Array:
    """Return the distance from the witness to its first foot; along the normal of b if that is known."""
    a, b, _ = _jets(y, system.pieces)
    c = a.point - b.point
    return c @ direction(c, b.first, system.held[1])


def polished(y: Array, system: Active) -> Array:
    """Return parameters after a few Newton steps, kept in [0, 1]."""
    # Newton steps of a polish; the peaks of the search are off by the root of its tolerance.
    return jax.lax.fori_loop(0, 4, lambda _, x: jnp.clip(newton(x, system), 0.0, 1.0), varying(y, system))


def balance(y: Array, system: Active, held: Array) -> tuple[Array, Array]:
    """Return the multipliers of both feet, and the unit vectors from the feet to the witness in rows.

    The weights lambda_i have lambda_1 g1 + lambda_2 g2 = 0 for the slopes g_i of the distances along a. If the
    parameter on a is held, the multipliers `held` are returned: a range of multipliers may be valid
    (jhd._distance.witness.multipliers), and these stay fixed while the feet stay.
    """
    a, first, second = _jets(y, system.pieces)
    feet, velocities = jnp.stack([first.point, second.point]), jnp.stack([first.first, second.first])
    units = jax.vmap(direction)(a.point - feet, velocities, system.held[1:])
    slopes = units @ a.first
    spread = jnp.where(system.two, slopes[0] - slopes[1], 1.0)
    opposite = system.two & (spread != 0)
    share = jnp.clip(-slopes[1] / jnp.where(opposite, spread, 1.0), 0.0, 1.0)
    balanced = jnp.where(opposite, jnp.stack([share, 1 - share]), jnp.array([1.0, 0.0]))
    return jnp.where(system.held[0], held, balanced), units
