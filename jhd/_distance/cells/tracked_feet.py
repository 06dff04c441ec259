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

from typing import NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.implicit import parameters
from jhd._distance.cells.lagrange import WithSurface
from jhd._distance.cells.pairs import Cell, PairBound, Parametric
from jhd._distance.cells.tracked_feet_nets import points_of_net, square_to_net
from jhd._distance.cells.tracked_feet_surfaces import narrowed, points_of_surface, square_to_surface
from jhd._distance.normalization.net_jets import Net
from jhd._distance.normalization.surfaces import Side

# The most that a cell of a net or surface b is longer than one of a that is cut first, and where a is no graph.
_LONGEST_NET, _LONGEST_SURFACE, _LONGEST_OF_NONE = 64.0, 512.0, 64.0


@runtime_checkable
class PairProblem(Protocol):
    """A pair of shapes in common coordinates, as a search takes it."""

    @property
    def floor(self) -> Array | float:
        """The gap that rounding leaves."""
        ...

    def bound(self, cell: Cell) -> PairBound:
        """Bounds over one pair of cells."""
        ...


class WithMovingFeet(NamedTuple):
    """A pair of shapes with bounds by feet on b that move with a, besides its own."""

    still: Parametric | WithSurface

    @property
    def floor(self) -> Array | float:
        """The gap that rounding leaves."""
        return self.still.floor

    def bound(self, cell: Cell) -> PairBound:
        """Bounds over one pair of cells: the larger one."""
        a, b = self.still.a, self.still.b
        n, on_first = parameters(a), isinstance(self, WithFeetOnFirst)
        for shape, part in ((a, slice(0, n)), (b, slice(n, None))):
            if isinstance(shape, Side):
                low, high = narrowed(shape, cell.low[part], cell.high[part])
                cell = cell._replace(low=cell.low.at[part].set(low), high=cell.high.at[part].set(high))
        still = self.still.bound(cell)
        if on_first:
            ends = (jnp.concatenate([x[n:], x[:n]]) for x in (cell.low, cell.high))
            moving = moving_bound(b, a, Cell(cell.piece_b, cell.piece_a, *ends), still.x[:n])
        else:
            moving = moving_bound(a, b, cell, still.x[n:])
        follow = (np.arange(cell.low.size) < n) == on_first
        extent = _to_cut(still.extent, moving, follow, isinstance(a if on_first else b, Side))
        return still._replace(lower=jnp.maximum(still.lower, moving.lower), extent=extent)


class WithFeetOnFirst(WithMovingFeet):
    """The same by feet on a that move with b: needed if b stands still where the distance is constant along a."""


def _to_cut(extent: Array, moving: "MovingBound", follow: np.ndarray, on_surface: bool) -> Array:
    """What to cut: a, down to graphs; then b, down to where L is convex; and then a again, unless b is far longer.

    What is no graph yet is cut where it is bent most: sheets next to each other between them.

    Args:
        extent: the lengths along the parameters, negative where they are not to be cut.
        moving: the bound by feet that move.
        follow: which parameters are those of the shape with the feet.
        on_surface: whether this is an implicit surface.
    """
    own = extent[~follow]
    first, second, most = jnp.max(own), jnp.max(extent[follow]), jnp.max(moving.bent)
    bent = first * jnp.sqrt(moving.bent / jnp.where(most > 0, most, 1.0))
    extent = extent.at[~follow].set(jnp.where(moving.graph | ~(most > 0), own, bent))
    longest = jnp.where(moving.graph, _LONGEST_SURFACE if on_surface else _LONGEST_NET, _LONGEST_OF_NONE)
    useful = moving.convex & (moving.lower > 0) if on_surface else moving.convex
    return jnp.where((first * longest > second) & (~moving.graph | useful) & follow, -1.0, extent)


class MovingBound(NamedTuple):
    """A lower bound over a pair of cells, and what it rests on.

    Args:
        lower: the bound.
        graph: whether a is near its polynomials.
        convex: whether L is proven convex.
        bent: see MovingPoint.
    """

    lower: Array
    graph: Array
    convex: Array
    bent: Array


def moving_bound(a: Net | Side, b: Net | Side, cell: Cell, start: Array) -> MovingBound:
    """A lower bound of the distance of two parts; zero where there is none.

    Args:
        a: the shape with the places.
        b: the one with the feet.
        cell: the pieces and the ends of both parts.
        start: the parameters of a foot, or the point of an implicit surface.
    """
    n, dtype = parameters(a), cell.low.dtype
    own, other = (cell.low[:n], cell.high[:n]), (cell.low[n:], cell.high[n:])
    on_a = points_of_surface(a, *own) if isinstance(a, Side) else points_of_net(a.piece(cell.piece_a), *own)
    if isinstance(b, Side):
        square = square_to_surface(b, on_a.point, *other, start)
    else:
        square = square_to_net(b.piece(cell.piece_b), on_a.point, *other, start)
    root = jnp.sqrt(jnp.maximum(square.lower, 0.0)) * (1 - gamma(8, dtype)) - on_a.beside * (1 + gamma(4, dtype))
    graph = jnp.isfinite(on_a.beside)
    lower = jnp.where(graph & square.convex & jnp.isfinite(root), jnp.maximum(root, 0.0), 0.0)
    return MovingBound(lower, graph, square.convex, on_a.bent)
