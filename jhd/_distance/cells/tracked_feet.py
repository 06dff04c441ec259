"""Proven lower bounds of the distance over pairs of cells, by feet on one shape that move with the point on the other.

The points of a cell of a are within `beside` of polynomials P(u) in two variables, up to a rest of the eighth order:
the polynomials of a parametric shape (jhd._distance.cells.tracked_feet_nets), or the graph near an implicit surface
(jhd._distance.cells.tracked_feet_surfaces). Each P has a polynomial Q(u) that passes approximately through its feet on
b. With a function L that is |P - q|^2 on b and convex in q, the distance of P from a cell of b is bounded by the value
at Q and by the derivatives there (jhd._distance.cells.tracked_feet_minimum). So

    |p - q| >= sqrt(least square) - beside

for all p of a and q of b in the cells, for parametric shapes and implicit surfaces in any combination. If the distance
is constant along a, the bound is short by the eighth order of the size of the cell of a, wherever the cell lies, and
the cell of b may be as large as L is convex: the number of pairs grows like the fourth root of the inverse of the gap.

Source: ours.
"""

from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.lagrange import WithSurface
from jhd._distance.cells.pairs import Cell, PairBound, Parametric
from jhd._distance.cells.tracked_feet_minimum import MovingPoint
from jhd._distance.cells.tracked_feet_nets import points_of_net, square_seems_convex, square_to_net
from jhd._distance.cells.tracked_feet_surfaces import narrowed, points_of_surface, seems_convex, square_to_surface
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.surfaces import Side

# Largest ratios of the lengths of cells of b and a at which a is cut first: for a net b, for a surface b, and if a is
# no graph.
_LONGEST_NET, _LONGEST_SURFACE, _LONGEST_OF_NONE = 64.0, 512.0, 64.0


@runtime_checkable
class PairProblem(Protocol):
    """A pair of shapes in common coordinates, as a search takes it."""

    @property
    def floor(self) -> Array | float:
        """Return the gap that rounding leaves."""
        ...

    def bound(self, cell: Cell) -> PairBound:
        """Return the bounds over one pair of cells."""
        ...


class WithMovingFeet(NamedTuple):
    """A pair of shapes with bounds by feet on b that move with a, in addition to its own bounds."""

    still: Parametric | WithSurface
    on_first = False

    @property
    def floor(self) -> Array | float:
        """Return the gap that rounding leaves."""
        return self.still.floor

    def bound(self, cell: Cell) -> PairBound:
        """Return the shapes' own bounds over one pair of cells, after parts without a point are cut off."""
        n = self.still.a.parameters
        for shape, part in ((self.still.a, slice(0, n)), (self.still.b, slice(n, None))):
            if isinstance(shape, Side):
                low, high = narrowed(shape, cell.low[part], cell.high[part])
                cell = cell._replace(low=cell.low.at[part].set(low), high=cell.high.at[part].set(high))
        return self.still.bound(cell)

    def moving_points(self, cell: Cell, x: Array) -> tuple[MovingPoint, Array]:
        """Return the moving points, and whether L seems convex at the foot of their middle; x is a pair of points."""
        a, b, cell, start = self._turned(cell, x)
        on_a, n = points_over(a, cell), a.parameters
        other = cell.low[n:], cell.high[n:]
        if isinstance(b, Side):
            return on_a, seems_convex(b, on_a.point.terms[0], *other, start)
        return on_a, square_seems_convex(b.piece(cell.piece_b), on_a.point, *other, start)

    def moving_bound(self, on_a: MovingPoint, cell: Cell, x: Array) -> tuple[Array, Array]:
        """Return the lower bound by feet of the moving points, and whether L is proven convex."""
        _, b, cell, start = self._turned(cell, x)
        return _bound_of(on_a, b, cell, start)

    def _turned(self, cell: Cell, x: Array) -> tuple[Net | Side, Net | Side, Cell, Array]:
        """Return the shape with the moving points, the shape with the feet, their cells and the start of a foot."""
        a, b, n = self.still.a, self.still.b, self.still.a.parameters
        if not self.on_first:
            return a, b, cell, x[n:]
        low, high = (jnp.concatenate([x[n:], x[:n]]) for x in (cell.low, cell.high))
        return b, a, Cell(cell.piece_b, cell.piece_a, low, high), x[:n]

    def to_cut(self, extent: np.ndarray, moving: "MovingBound") -> np.ndarray:
        """Choose the cuts: a, down to graphs; then b, until L is convex; then a again, unless b is far longer.

        A part of a that is no graph yet is cut across its strongest bend: adjacent sheets are cut apart.

        Args:
            extent: the lengths of pairs of cells along their parameters.
            moving: the bounds by moving feet.

        Returns:
            The lengths, negative along parameters that are not to be cut.
        """
        n = self.still.a.parameters
        follow = (np.arange(extent.shape[1]) < n) == self.on_first
        on_surface = isinstance(self.still.a if self.on_first else self.still.b, Side)
        first, second, most = (np.max(x, axis=1) for x in (extent[:, ~follow], extent[:, follow], moving.bent))
        graph = moving.graph[:, None] | ~(most > 0)[:, None]
        bent = first[:, None] * np.sqrt(moving.bent / np.where(most > 0, most, 1.0)[:, None])
        own = np.where(graph, extent[:, ~follow], bent)
        longest = np.where(moving.graph, _LONGEST_SURFACE if on_surface else _LONGEST_NET, _LONGEST_OF_NONE)
        useful = moving.convex & (moving.lower > 0) if on_surface else moving.convex
        whole = (first * longest > second) & (~moving.graph | useful)
        lengths = np.where(whole[:, None], -1.0, extent)
        lengths[:, ~follow] = own
        return lengths


class WithFeetOnFirst(WithMovingFeet):
    """Bounds by feet on a that move with b: needed if b stands still where the distance is constant along a."""

    on_first = True


class MovingBound(NamedTuple):
    """A lower bound over a pair of cells, with the conditions that it depends on."""

    lower: Any  # the bound
    graph: Any  # whether a is near its polynomials
    convex: Any  # whether L is proven convex
    bent: Any  # see MovingPoint


def moving_bound(a: Net | Side, b: Net | Side, cell: Cell, start: Array) -> MovingBound:
    """Lower bound of the distance of two parts; zero if none is proven.

    Args:
        a: the shape with the moving points.
        b: the shape with the feet.
        cell: the pieces and the ends of both parts.
        start: the parameters of a foot, or the point of an implicit surface.
    """
    on_a = points_over(a, cell)
    lower, convex = _bound_of(on_a, b, cell, start)
    return MovingBound(lower, jnp.isfinite(on_a.beside), convex, on_a.bent)


def points_over(a: Net | Side, cell: Cell) -> MovingPoint:
    """Return the polynomials near the first shape over a cell."""
    n = a.parameters
    own = cell.low[:n], cell.high[:n]
    return points_of_surface(a, *own) if isinstance(a, Side) else points_of_net(a.piece(cell.piece_a), *own)


def _bound_of(on_a: MovingPoint, b: Net | Side, cell: Cell, start: Array) -> tuple[Array, Array]:
    """Return the bound, and whether L is proven convex."""
    dtype, n = cell.low.dtype, cell.low.size - b.parameters
    other = cell.low[n:], cell.high[n:]
    if isinstance(b, Side):
        square = square_to_surface(b, on_a.point, *other, start)
    else:
        square = square_to_net(b.piece(cell.piece_b), on_a.point, *other, start)
    root = jnp.sqrt(jnp.maximum(square.lower, 0.0)) * (1 - gamma(8, dtype)) - on_a.beside * (1 + gamma(4, dtype))
    proven = jnp.isfinite(on_a.beside) & square.convex & jnp.isfinite(root)
    return jnp.where(proven, jnp.maximum(root, 0.0), 0.0), square.convex
