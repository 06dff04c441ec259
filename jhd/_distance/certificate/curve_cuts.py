"""Cuts of the cells of a certificate between two curves: at peaks of the distance and where feet leave a piece.

An exact bound needs these cuts. The computation is in floating point; the cells are checked exactly wherever they are
cut.
"""

from typing import NamedTuple

import numpy as np

from jhd._distance.certificate.shape_side import ShapeSide
from jhd._distance.nearest.feet import dot, equation_of, foot_speed

# Samples of an interval among which its peak is searched.
_NODES = np.linspace(0.0, 1.0, 13)
# Steps of Newton's method for the peak, among three candidates and for the chosen one alone.
_PEAK_STEPS, _LAST_STEPS = 4, 4


class CurveCells(NamedTuple):
    """Intervals of a curve: the piece of each, and its ends."""

    piece: np.ndarray
    start: np.ndarray
    end: np.ndarray


class CurveFeet(NamedTuple):
    """Two branches of feet: the piece (branches, cells), and the feet of both ends of a cell (branches, cells, 2)."""

    piece: np.ndarray
    ends: np.ndarray


class CurvePeaks(NamedTuple):
    """Peaks of cells: parameters, squared distances, and whether the distance is smooth there."""

    t: np.ndarray
    top: np.ndarray
    is_smooth: np.ndarray


def seams(source: ShapeSide, target: ShapeSide, cells: CurveCells, piece: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the parameters at which feet on pieces reach an end, by bisection; an end of the cell if none does."""
    there = target.curve_jet(piece, end)

    def side(t: np.ndarray) -> np.ndarray:
        return np.sign(dot(source.points(cells.piece, t[:, None]) - there.point, there.first))

    low, high = cells.start, cells.end
    first = side(low)
    # Halvings that find a parameter to its last digit.
    for _ in range(54):
        middle = 0.5 * (low + high)
        same = side(middle) == first
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return high


def peaks(source: ShapeSide, target: ShapeSide, cells: CurveCells, feet: CurveFeet) -> CurvePeaks:
    """Return the peaks of the smaller distance to the feet of two branches over cells.

    The best of a few samples comes first. Then follow steps to the best of the peaks of either branch and of their
    crossing. The last steps go to this one alone, since values locate a smooth peak to half of the digits only.
    """
    t0, width, n = cells.start, cells.end - cells.start, np.arange(len(cells.piece))

    def heights(t: np.ndarray) -> np.ndarray:
        """Squared distances to the feet with two derivatives at t (samples, cells): (3, branches, samples, cells)."""
        count = 2 * len(t)
        at = source.curve_jet(np.tile(cells.piece, count), np.tile(t, (2, 1)).ravel())
        piece, ends = (np.repeat(rows, len(t), axis=0) for rows in feet)
        share = np.tile((t - t0) / width, (2, 1))
        s = ((1 - share) * ends[..., 0] + share * ends[..., 1]).reshape(-1, 1)
        s = target.local(piece.ravel(), s, np.asarray(at.point)).x[:, 0]
        here = equation_of(at.point, target.curve_jet(piece.ravel(), s))
        speed = foot_speed(s, here, at.first, np.tile(width, count))
        bend = dot(at.first, at.first) - dot(at.first, here.first) * speed - dot(here.apart, at.second)
        return np.array([here.distance_sq, -2 * dot(here.apart, at.first), 2 * bend]).reshape(3, 2, *t.shape)

    def steps(height: np.ndarray) -> np.ndarray:
        """Return steps from t to the peaks of both branches and to their crossing, (3, cells)."""
        f, slope, bend = height
        crossed = slope[0] - slope[1]
        tops = np.where(bend < 0, -slope / np.where(bend < 0, bend, -1.0), 0.0)
        return np.concatenate([tops, [-(f[0] - f[1]) / np.where(crossed != 0, crossed, np.inf)]])

    tried = t0 + _NODES[:, None] * width
    low, high = t0, t0 + width
    t, kind = np.zeros(len(n)), np.full(len(n), -1)
    here, top = np.zeros((3, 2, len(n))), np.full(len(n), -np.inf)
    for k in range(_PEAK_STEPS + 1):
        found = heights(tried)
        least = np.min(found[0], axis=0)
        i = np.argmax(least, axis=0)
        # Rounding of a squared distance: a value larger by less than this is no higher peak.
        better = least[i, n] > top * (1 + 1e-14)
        t, top = np.where(better, tried[i, n], t), np.where(better, least[i, n], top)
        here = np.where(better, found[:, :, i, n], here)
        if k == 0:
            low, high = (np.clip(t + side * width / (len(_NODES) - 1), low, high) for side in (-1, 1))
        else:
            kind = np.where(better, i, kind)
        tried = np.clip(t + steps(here), low, high)
    last = t
    for _ in range(_LAST_STEPS):
        here = heights(last[None])[:, :, 0]
        last = np.where(kind < 0, last, np.clip(last + steps(here)[kind, n], low, high))
    # Fraction of a squared distance by which the peak of the last steps may be lower than the one before, and the least
    # squared distance to which it applies.
    same = np.min(heights(last[None])[0, :, 0], axis=0) >= top - 1e-12 * np.maximum(top, 1e-13)
    return CurvePeaks(np.where(same, last, t), top, kind != 2)
