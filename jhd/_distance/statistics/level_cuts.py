"""Level crossings of the distance on lines across cells of a surface, and rules below the level and along it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from jhd._distance.statistics.breakpoints import OnLines, chosen, meeting
from jhd._distance.statistics.cut_cells import CellLines, CellNodes, Looked, cut_lines, kind_of, parts_of, ruled
from jhd._distance.statistics.quadrature import Nodes, ParameterCells
from jhd._runtime.arrays import joined, taken

# Parts of a line at whose ends the distance is evaluated.
_PARTS = 4
# Steps to find a point beyond the level where the distance turns, and Newton or bisection steps to the crossing.
_TURN_STEPS, _LEVEL_STEPS = 8, 40
# Newton's steps end if they are shorter than this, or if the distance is the level up to the rounding of distances and
# of coordinates, which are at most about one.
_STILL, _REACHED = 2.0**-50, 2.0**-51
# Halvings of cells before corners of the level are searched, and bisection steps to them.
_SHARP, _CORNER_HALVINGS = 2, 28


class LevelRule(NamedTuple):
    """A rule over cells."""

    below: CellNodes  # nodes below the level
    on: CellNodes  # points where lines cross the level, with factors of the other parameter alone
    axis: Int[np.ndarray, " places"]  # axes of the lines through these points
    settled: Bool[np.ndarray, " cells"]  # whether all lines of each part of a cell cross the same levels


def cut_at_level(cells: ParameterCells, looked: Looked, across: np.ndarray, level: float, step: int) -> LevelRule:
    """Return rules over the part below the level and along the level.

    Args:
        cells: cells of a surface.
        looked: the distances from its points.
        across: the axis of the lines of each cell, across the level.
        level: a distance.
        step: number of halvings that made the cells.
    """
    halvings = _CORNER_HALVINGS if step >= _SHARP else 0
    cut, settled = cut_lines(cells, across, lambda lines: _passed(lines, looked, level), halvings, step)
    rule = ruled(cut, step)
    start = looked.along(cut.lines, cut.lines.low).value <= level
    inside = start[rule.line] ^ (rule.part % 2 == 1)
    row, column = np.nonzero(~np.isnan(cut.cuts))
    lines = cut.lines.take(row)
    on = CellNodes(Nodes(lines.piece, lines.place(cut.cuts[row, column]), cut.factor[row]), lines.cell)
    places = CellNodes(taken(rule.places.nodes, inside), rule.places.cell[inside])
    return LevelRule(places, on, lines.axis, settled)


def _passed(lines: CellLines, looked: Looked, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the distance crosses a level along lines, at most twice in a part, and a number for these."""
    each, places = parts_of(lines, _PARTS)
    seen = looked.along(each, places.ravel())
    ends = [OnLines(*(x.reshape(places.shape)[:, part].ravel() for x in seen)) for part in (slice(-1), slice(1, None))]
    row = np.repeat(np.arange(len(places)), _PARTS)
    beyond = _turned(lines.take(row), looked, level, *ends)
    # Before and behind the point beyond the level, both at once.
    first, last = (joined(x) for x in ((ends[0], beyond), (beyond, ends[1])))
    found = _crossed(lines.take(np.tile(row, 2)), looked, level, first, last)
    place, label = (x.reshape(2, -1).T.reshape(len(places), -1) for x in found)
    below = ends[0].value.reshape(len(places), _PARTS)[:, :1] <= level
    count = np.sum(~np.isnan(place), axis=1, keepdims=True)
    kind = kind_of(np.concatenate([2 * label + 2, 2 * (2 * count + below) + 1], axis=1))
    return np.sort(place, axis=1), kind


def _turned(lines: CellLines, looked: Looked, level: float, first: OnLines, last: OnLines) -> OnLines:
    """Return a point of each line on the opposite side of the level from both ends, or the start if there is none."""
    found = OnLines(*(x.copy() for x in first))
    side = first.value <= level
    turns = (side == (last.value <= level)) & (first.slope * last.slope < 0) & ((first.slope > 0) == side)
    rows = np.flatnonzero(turns & ((meeting(first, last)[1] <= level) != side))
    for step in range(_TURN_STEPS):
        if len(rows) == 0:
            break
        some = taken(first, rows), taken(last, rows)
        kink = meeting(*some)[0]
        smooth = some[0].place + (some[1].place - some[0].place) * some[0].slope / (some[0].slope - some[1].slope)
        at = looked.along(lines.take(rows), kink if step % 2 else smooth)
        ahead = at.slope * some[0].slope > 0
        for ends, which in ((first, ahead), (last, ~ahead)):
            for held, new in zip(ends, at, strict=True):
                held[rows[which]] = new[which]
        passes = (at.value <= level) != side[rows]
        for held, new in zip(found, at, strict=True):
            held[rows[passes]] = new[passes]
        left = taken(first, rows), taken(last, rows)
        rows = rows[~passes & ((meeting(*left)[1] <= level) != side[rows]) & (at.slope != 0)]
    return found


def _crossed(
    lines: CellLines, looked: Looked, level: float, first: OnLines, last: OnLines
) -> tuple[np.ndarray, np.ndarray]:
    """Return where the distance crosses the level between two points, NaN if it does not, and the label there."""
    found, label = np.full(len(first.place), np.nan), np.full(len(first.place), -1)
    rows = np.flatnonzero((first.value <= level) != (last.value <= level))
    low, high = (taken(end, rows) for end in (first, last))
    place = low.place + (high.place - low.place) * (level - low.value) / (high.value - low.value)
    for _ in range(_LEVEL_STEPS):
        if len(rows) == 0:
            break
        at = looked.along(lines.take(rows), place)
        found[rows], label[rows] = place, at.label
        before = (at.value <= level) == (low.value <= level)
        low, high = chosen(before, at, low), chosen(before, high, at)
        # If there is a breakpoint between, the tangent at the opposite end leads to its branch.
        following = 0.5 * (low.place + high.place)
        for end in (chosen(before, high, low), at):
            newton = end.place + (level - end.value) / np.where(end.slope != 0, end.slope, 1.0)
            inside = (end.slope != 0) & (newton >= low.place) & (newton <= high.place)
            following = np.where(inside, newton, following)
        moves = (np.abs(following - place) > _STILL) & (np.abs(at.value - level) > _REACHED * max(abs(level), 1.0))
        rows, place = rows[moves], following[moves]
        low, high = (taken(end, moves) for end in (low, high))
    return found, label
