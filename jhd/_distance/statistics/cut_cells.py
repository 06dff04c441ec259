"""Rules over cells of a surface that are cut along curves: creases or levels of the distance.

Along one parameter each line across a cell is cut at such a curve, and a Gauss rule is applied to each part. Along the
other parameter the cell is cut at the points where the curve leaves it by an end of these lines, and where the lines
begin to meet another curve. The integrand is then smooth in each part, so the rules converge as over a whole cell. The
lines run across the curve.

Source: Saye, High-order quadrature methods for implicitly defined surfaces and volumes in hyperrectangles (2015).
Branches of the distance instead of a level set, and cuts found by the slopes from both sides, are ours.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jhd._distance.normalization.net_jets import Net
from jhd._distance.statistics.breakpoints import OnLines, kinks
from jhd._distance.statistics.pointwise import Seen, Sight
from jhd._distance.statistics.quadrature import Nodes, ParameterCells
from jhd._runtime.arrays import joined, taken

# Nodes of a rule over each part along each parameter, after an even and an odd number of halvings: with equal numbers,
# lines between the same cuts would coincide in a cell and in its part.
_GAUSS = 5, 6
# Parts of a line at whose ends labels are compared.
_PARTS = 8
# Largest number of changes of kind in each cell, and bisection steps to find one.
_CHANGES, _KINK_HALVINGS = 6, 14
# Multiplied with it, labels are scattered over all numbers (2^64 over the golden section).
_ODD = np.int64(-7046029254386353131)


class CellLines(NamedTuple):
    """Lines along one parameter: cells, pieces, both parameters at the start, the axis, and its value at the end."""

    cell: Int[np.ndarray, " lines"]
    piece: Int[np.ndarray, " lines"]
    start: Float[np.ndarray, "lines parameters"]
    axis: Int[np.ndarray, " lines"]
    end: Float[np.ndarray, " lines"]

    take = taken

    def place(self, along: np.ndarray) -> np.ndarray:
        """Return both parameters, given the one along the lines."""
        t = self.start.copy()
        t[np.arange(len(t)), self.axis] = along
        return t

    @property
    def low(self) -> np.ndarray:
        """Starts of the lines along their axes."""
        return self.start[np.arange(len(self.start)), self.axis]

    @property
    def beside(self) -> np.ndarray:
        """The parameter across the lines."""
        return self.start[np.arange(len(self.start)), 1 - self.axis]


class CellNodes(NamedTuple):
    """Nodes of rules over cells, with factors, and the cell of each."""

    nodes: Nodes
    cell: Int[np.ndarray, " places"]

    def of(self, cells: np.ndarray) -> "CellNodes":
        """Return the nodes of the cells in a mask, with cells numbered among these."""
        rows = cells[self.cell]
        return CellNodes(taken(self.nodes, rows), (np.cumsum(cells) - 1)[self.cell[rows]])

    def sums(self, values: np.ndarray, cells: int) -> np.ndarray:
        """Return sums (cells, columns) of values (places, columns) over each of `cells` cells."""
        return np.stack([np.bincount(self.cell, column, cells) for column in values.T], axis=1)


class Looked:
    """Distances from nodes of a known net, with a count of the evaluations."""

    def __init__(self, net: Net, sight: Sight):
        self.net, self.sight, self.count = net, sight, 0

    def at(self, nodes: Nodes) -> Seen:
        """Return the data seen from nodes."""
        self.count += len(nodes.piece)
        return self.sight.at(self.net, nodes)

    def along(self, lines: CellLines, place: np.ndarray) -> OnLines:
        """Return distances and their slopes along lines."""
        seen = self.at(Nodes(lines.piece, lines.place(place), np.ones(len(place))))
        return OnLines(place, seen.distance, seen.slope[np.arange(len(place)), lines.axis], seen.label)


class CutLines(NamedTuple):
    """Lines with factors, their cuts, and the kind of curves that they meet."""

    lines: CellLines  # lines across cells
    factor: Float[np.ndarray, " lines"]  # factors of the rule in the other parameter
    cuts: Float[np.ndarray, "lines cuts"]  # (lines, cuts) in order; NaN behind the last.
    kind: Int[np.ndarray, " lines"]  # a number that identifies the curves that a line meets

    @property
    def edges(self) -> np.ndarray:
        """Return the starts, cuts and ends of lines."""
        end = self.lines.end[:, None]
        return np.concatenate([self.lines.low[:, None], np.where(np.isnan(self.cuts), end, self.cuts), end], axis=1)


class Ruled(NamedTuple):
    """Rules over the parts of cut lines: the nodes, and the line and part of each."""

    places: CellNodes
    line: Int[np.ndarray, " places"]
    part: Int[np.ndarray, " places"]


# Returns the cuts of lines in order, and the kind of each line.
Cutter = Callable[[CellLines], tuple[np.ndarray, np.ndarray]]


def cut_lines(
    cells: ParameterCells, across: np.ndarray, cutter: Cutter, halvings: int, step: int
) -> tuple[CutLines, np.ndarray]:
    """Return lines across cells at nodes of the other parameter, over parts in which they meet the same curves.

    Args:
        cells: cells of a surface.
        across: the axis of the lines of each cell.
        cutter: returns the cuts of lines, and the kind of each line.
        halvings: bisection steps to find where the kind of lines changes; without any, such cells are only reported.
        step: number of halvings that made the cells.

    Returns:
        The lines, and whether all lines of each part of a cell meet the same curves.
    """
    settled = np.ones(len(across), bool)
    if cells.low.shape[1] == 1:
        # The cells of a curve are lines themselves.
        lines = CellLines(np.arange(len(across)), cells.piece, cells.low, across, cells.high[:, 0])
        return CutLines(lines, np.ones(len(across)), *cutter(lines)), settled
    ends = []
    for end in (cells.low, cells.high):
        border = _border(cells, across, end)
        cuts = cutter(border)[0]
        ends.append(np.where(np.isnan(cuts), border.low[:, None], cuts))
    first = _cut(cells, across, cutter, np.concatenate(ends, axis=1), step)
    lines, kind = first.lines, first.kind
    rows = np.flatnonzero((np.diff(lines.cell) == 0) & (np.diff(kind) != 0))
    if halvings == 0 or len(rows) == 0:
        settled[lines.cell[rows]] = False
        return first, settled
    # From both sides, since the part between may be narrow.
    cell, other = np.tile(lines.cell[rows], 2), np.concatenate([kind[rows], kind[rows + 1]])
    low, high = np.tile(lines.beside[rows], 2), np.tile(lines.beside[rows + 1], 2)
    ahead = np.arange(len(cell)) < len(rows)
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        onward = (cutter(_lines_at(cells, across, cell, middle))[1] == other) == ahead
        low, high = np.where(onward, middle, low), np.where(onward, high, middle)
    order = np.argsort(cell, kind="stable")
    cell, found = cell[order], (0.5 * (low + high))[order]
    settled[cell[np.arange(len(cell)) - np.searchsorted(cell, cell) >= _CHANGES]] = False
    changed, place = np.unique(cell), np.full((len(cells.piece), _CHANGES), np.nan)
    rank = np.arange(len(cell)) - np.searchsorted(cell, cell)
    some = rank < _CHANGES
    place[cell[some], rank[some]] = found[some]
    place = np.where(np.isnan(place), cells.low[np.arange(len(across)), 1 - across][:, None], place)
    again = _cut(cells.take(changed), across[changed], cutter, np.concatenate([*ends, place], axis=1)[changed], step)
    again = again._replace(lines=again.lines._replace(cell=changed[again.lines.cell]))
    return joined([taken(first, ~np.isin(lines.cell, changed)), again]), settled


def _cut(cells: ParameterCells, across: np.ndarray, cutter: Cutter, others: np.ndarray, step: int) -> CutLines:
    """Return lines at nodes between given values (cells, places) of the other parameter."""
    count = len(cells.piece)
    row, other = np.arange(count), 1 - across
    x, w = _rule(step)
    first, last = cells.low[row, other][:, None], cells.high[row, other][:, None]
    edges = np.sort(np.concatenate([first, others, last], axis=1), axis=1)
    size = np.diff(edges, axis=1)
    at, factor = edges[:, :-1, None] + size[..., None] * x, size[..., None] * w
    cell = np.broadcast_to(row[:, None, None], at.shape)[factor > 0]
    lines = _lines_at(cells, across, cell, at[factor > 0])
    return CutLines(lines, factor[factor > 0], *cutter(lines))


def _border(cells: ParameterCells, across: np.ndarray, end: np.ndarray) -> CellLines:
    """Return the borders of cells at one end of the lines across them."""
    row = np.arange(len(across))
    start = cells.low.copy()
    start[row, across] = end[row, across]
    return CellLines(row, cells.piece, start, 1 - across, cells.high[row, 1 - across])


def _lines_at(cells: ParameterCells, across: np.ndarray, cell: np.ndarray, at: np.ndarray) -> CellLines:
    """Return lines across some cells at values of the other parameter."""
    start, axis = cells.low[cell], across[cell]
    start[np.arange(len(cell)), 1 - axis] = at
    return CellLines(cell, cells.piece[cell], start, axis, cells.high[cell, axis])


def ruled(cut: CutLines, step: int) -> Ruled:
    """Return rules over the parts of lines."""
    x, w = _rule(step)
    edges = cut.edges
    width = np.diff(edges, axis=1)
    at = edges[:, :-1, None] + width[..., None] * x
    some = np.broadcast_to(width[..., None] > 0, at.shape)
    line, part, _ = np.nonzero(some)
    factor = (cut.factor[:, None, None] * width[..., None] * w)[some]
    lines = cut.lines.take(line)
    return Ruled(CellNodes(Nodes(lines.piece, lines.place(at[some]), factor), lines.cell), line, part)


def parts_of(lines: CellLines, parts: int) -> tuple[CellLines, np.ndarray]:
    """Return each line `parts` + 1 times, and the ends (lines, parts + 1) of its equal parts."""
    shares = np.arange(parts + 1) / parts
    return lines.take(np.repeat(np.arange(len(lines.cell)), parts + 1)), (
        lines.low[:, None] * (1 - shares) + lines.end[:, None] * shares
    )


def kind_of(labels: np.ndarray) -> np.ndarray:
    """Return a number for each row of labels that identifies the set of its labels."""
    ordered = np.sort(labels, axis=1)
    fresh = np.concatenate([np.ones((len(ordered), 1), bool), ordered[:, 1:] != ordered[:, :-1]], axis=1)
    with np.errstate(over="ignore"):
        mixed = (ordered + 1) * _ODD
        mixed = (mixed ^ (mixed >> 29)) * _ODD
        return np.sum(mixed * fresh, axis=1)


def cut_at_kinks(
    cells: ParameterCells, looked: Looked, across: np.ndarray, alike: np.ndarray, step: int
) -> tuple[CellNodes, np.ndarray]:
    """Return rules over the parts of cells between breakpoints, and whether the distance is smooth in each part.

    Args:
        cells: cells of a surface.
        looked: the distances from its points.
        across: the axis of the lines of each cell, across the breakpoints.
        alike: whether lines of a cell are also cut if they see one label only.
        step: number of halvings that made the cells.
    """
    # Halvings of cells before changes of kind are searched.
    halvings = _KINK_HALVINGS if step >= 3 else 0
    cut, smooth = cut_lines(cells, across, lambda lines: _kinks(lines, looked, alike), halvings, step)
    return ruled(cut, step).places, smooth


def _kinks(lines: CellLines, looked: Looked, alike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where labels change along lines, at most once in each part, and a number for the labels seen."""
    each, places = parts_of(lines, _PARTS)
    label = looked.along(each, places.ravel()).label.reshape(places.shape)
    changes = label[:, 1:] != label[:, :-1]
    row, part = np.nonzero(changes)
    # Whole lines if no label shows where to search.
    bare = np.flatnonzero(alike[lines.cell] & ~np.any(changes, axis=1))
    low, high = (
        np.concatenate([ends[row, part], whole[bare]])
        for ends, whole in ((places[:, :-1], lines.low), (places[:, 1:], lines.end))
    )
    row, part = np.concatenate([row, bare]), np.concatenate([part, np.zeros_like(bare)])
    cuts, seen = np.full(changes.shape, np.nan), np.repeat(label[:, :1], 2 * _PARTS, axis=1)
    if len(row):
        some = lines.take(row)
        found = kinks(lambda place: looked.along(some, place), low, high)
        cuts[row, part], seen[row, part], seen[row, _PARTS + part] = found
    return np.sort(cuts, axis=1), kind_of(np.concatenate([label, seen], axis=1))


def _rule(step: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and factors of the Gauss rule over a unit interval."""
    x, w = np.polynomial.legendre.leggauss(_GAUSS[step % 2])
    return (x + 1) / 2, w / 2
