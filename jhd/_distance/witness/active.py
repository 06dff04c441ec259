"""The active system: the equations that hold at a witness, and the distance there, as functions of both curves.

At a witness the parameter t on a and the feet s1, s2 on b solve three equations G = 0. A foot is free, (A - B).B' = 0,
or held at an end or corner of b. The parameter is held at an end or corner of a, or set by equal distances of two feet,
or by (A - B).A' = 0. In the plane the last one is B' x A' = 0 at a free foot where the normal of b tells more than
A - B (jhd._distance.nearest.feet.by_normal). The distance is taken along that normal for the same reason.

The value has the derivative lambda_1 d1 + lambda_2 d2, where d_i is that of the distance to foot i at fixed parameters
and lambda the multipliers of the witness; a single foot has lambda = 1, and at an end or corner of a the multipliers
are constants (jhd._distance.witness.multipliers). The parameters y move by -J^-1 dG, and the Jacobian J is small enough
for Cramer's rule. `solution` is y as a function of both curves, whose derivative is written with `solution` again, so
that derivatives of all orders are right. If the determinant vanishes (concentric arcs, whose maximum is not isolated),
nothing moves.

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

# A determinant below this share of the product of the lengths of its rows is none.
_SINGULAR = 1e-10
# Newton steps of a polish; the peaks of the search are off by the root of its tolerance.
_POLISH = 4


class Active(NamedTuple):
    """The pieces that carry a witness and its feet, which of the three parameters are held, whether both feet count."""

    a: Piece
    first: Piece
    second: Piece
    held: Array  # (3,)
    two: Array

    @property
    def pieces(self) -> "Pieces":
        """The three pieces alone."""
        return self.a, self.first, self.second


Pieces = tuple[Piece, Piece, Piece]


def active(a: Piece, first: Piece, second: Piece, y: Array, event: Any, multipliers: Array) -> Active:
    """The system that belongs to an event at the parameters y = (t, s1, s2); at ends the multipliers tell the feet."""
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
        """All at once: a program is as long to compile as it has parts, and each sum is one."""
        a, b, d = jets
        c, e = a.point - b.point, a.point - d.point
        # c - e without rounding c and e.
        rows = jnp.stack([c, e, c + e, d.point - b.point, a.first, a.second, b.first, b.second, d.first, d.second])
        # A sum keeps the batch axis of vmap in front, where a matrix product may move it.
        dot = jnp.sum(rows[:, None] * rows, axis=-1)
        crossed = rows[:, None, 0] * rows[:, 1] - rows[:, None, 1] * rows[:, 0] if c.shape[0] == 2 else None
        return cls(dot, crossed)

    def along_normal(self, held: Array) -> Array:
        """Whether the first foot is free and the normal there tells its direction."""
        return ~held & by_normal(self.dot[_C, _C], self.dot[_B1, _B1])


# The rows of the products.
_C, _E, _SUM, _APART, _A1, _A2, _B1, _B2, _D1, _D2 = range(10)


def _equations(jets: _Jets, system: Active) -> Array:
    """G without the equations of the parameters that are held."""
    products = _Products.of(jets)
    dot, crossed = products
    stationary = dot[_C, _A1]
    if crossed is not None:
        stationary = jnp.where(products.along_normal(system.held[1]), crossed[_B1, _A1], stationary)
    # (c + e).(c - e): the difference of the squares without cancellation.
    return jnp.stack([jnp.where(system.two, dot[_SUM, _APART], stationary), dot[_C, _B1], dot[_E, _D1]])


def _jacobian(jets: _Jets, system: Active) -> Array:
    """Rows of dG/dy; those of the parameters that are held are unit vectors."""
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
    """The solution by Cramer's rule; zero where the determinant vanishes.

    The inverse has the cross products of the rows as columns. It is formed apart from the right-hand side, in which
    rules of derivatives must be linear term by term.
    """
    first, second, third = rows
    columns = jnp.stack([jnp.cross(second, third), jnp.cross(third, first), jnp.cross(first, second)])
    determinant = first @ columns[0]
    size = jnp.prod(jnp.sqrt(jnp.sum(jax.lax.stop_gradient(rows) ** 2, axis=1)))
    regular = jnp.abs(determinant) > _SINGULAR * size
    return jnp.where(regular, right @ (columns / jnp.where(regular, determinant, 1.0)), 0.0)


def stationary(s: Array, point: Array, piece: Piece, held: Array) -> Array:
    """The parameter of a foot after a Newton step of (B - P).B' = 0, where it is free and the root is simple."""
    here = equation(point, piece, s)
    moves = ~held & here.is_simple
    return s - jnp.where(moves, here.residual, 0.0) / jnp.where(moves, here.slope, 1.0)


def newton(y: Array, system: Active) -> Array:
    """One Newton step from y; y itself where the determinant vanishes."""
    jets = _jets(y, system.pieces)
    return y - _solve(_jacobian(jets, system), jnp.where(system.held, 0.0, _equations(jets, system)))


def solution(start: Array, pieces: Pieces, held: Array, two: Array) -> Array:
    """The solution of the system next to `start`, as a function of the pieces."""
    return jnp.stack(_solution((start[0], start[1], start[2]), pieces, held, two))


# Functions with rules of their own take and give scalars, but for the pieces. Under jit(vmap) an output must be batched
# wherever its derivative is (jax 0.10.2 fails otherwise), and a scalar leaves no choice of a batch axis.
@jax.custom_jvp
def _solution(start: tuple, pieces: Pieces, held: Array, two: Array) -> tuple[Array, ...]:
    system = Active(pieces[0], pieces[1], pieces[2], held, two)
    # Two steps, in a loop: a program is as long to compile as it has parts.
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
    """Unit vector from a foot to the witness, c apart: the normal of b where that is known, zero where c is."""
    square = c @ c
    unit = c / jnp.sqrt(jnp.where(square > 0, square, 1.0))
    if c.shape[0] == 3:
        return unit
    speed_sq = velocity @ velocity
    known = ~held & by_normal(square, speed_sq)
    normal = jnp.stack([-velocity[1], velocity[0]]) / jnp.sqrt(jnp.where(known, speed_sq, 1.0))
    return jnp.where(known, jnp.where(normal @ c < 0, -normal, normal), unit)


def places(y: Array, pieces: Pieces) -> tuple[Array, Array]:
    """The witness, and both feet in rows."""
    a, first, second = _jets(y, pieces)
    return a.point, jnp.stack([first.point, second.point])


def distance(y: Array, system: Active) -> Array:
    """Distance from the witness to its first foot; along the normal of b where that is known."""
    a, b, _ = _jets(y, system.pieces)
    c = a.point - b.point
    return c @ direction(c, b.first, system.held[1])


def polished(y: Array, system: Active) -> Array:
    """Parameters after a few Newton steps, kept in [0, 1]."""
    return jax.lax.fori_loop(0, _POLISH, lambda _, x: jnp.clip(newton(x, system), 0.0, 1.0), varying(y, system))


def balance(y: Array, system: Active, held: Array) -> tuple[Array, Array]:
    """Multipliers of both feet, and the unit vectors from them to the witness in rows.

    The weights lambda_i have lambda_1 g1 + lambda_2 g2 = 0 for the slopes g_i of the distances along a. Those given as
    `held` hold where the parameter on a does: a range of them may serve there (jhd._distance.witness.multipliers), and
    the same ones are taken as long as the feet stay.
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
