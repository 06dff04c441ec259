"""The systems to solve: pieces of a, the parts of b that can hold their feet, and the pairs of both.

Everything is tested once for whole pieces and parts before any box is opened.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jhd._distance.published.events.forms import (
    Curve,
    foot_form,
    hull_distances,
    may_vanish,
    piece_of,
    restricted,
    unwanted,
)
from jhd._distance.published.events.systems import BLOCK, SYSTEMS, Systems


class EventPieces(NamedTuple):
    """Parts of a that may hold the maximum: segment, interval (2, pieces), distances that matter (2, pieces)."""

    segment: np.ndarray
    side: np.ndarray
    wanted: np.ndarray

    def take(self, rows: np.ndarray) -> "EventPieces":
        """Return the pieces with these indices, which may repeat."""
        return EventPieces(self.segment[rows], self.side[:, rows], self.wanted[:, rows])


def event_pieces(segment: np.ndarray, t0: np.ndarray, t1: np.ndarray, upper: np.ndarray, level: float) -> EventPieces:
    """Return intervals of segments as pieces, neighbors merged; distances matter from `level` to the bound."""
    if not len(segment):
        return EventPieces(np.zeros(0, int), np.zeros((2, 0)), np.zeros((2, 0)))
    goes_on = (segment[1:] == segment[:-1]) & (t0[1:] == t1[:-1])
    first = np.flatnonzero(np.append(True, ~goes_on))
    last = np.append(first[1:], len(segment)) - 1
    most = np.maximum.reduceat(upper, first)
    return EventPieces(segment[first], np.stack([t0[first], t1[last]]), np.stack([np.full(len(first), level), most]))


class SurvivingFeet(NamedTuple):
    """Parts of b that may hold the feet of pieces, in the order of the pieces; different parts have no common interior.

    Args:
        piece: index of the piece that the feet belong to.
        segment: segment of b.
        side: interval (2, feet); [0, 0] for segments of one point.
    """

    piece: np.ndarray
    segment: np.ndarray
    side: np.ndarray

    def take(self, rows: np.ndarray) -> "SurvivingFeet":
        """Return the feet with these indices."""
        return SurvivingFeet(self.piece[rows], self.segment[rows], self.side[:, rows])


def everywhere(b: Curve, count: int) -> SurvivingFeet:
    """Return all of b for each piece."""
    segments = b.points.shape[-1]
    segment = np.tile(np.arange(segments), count)
    stop = (segment < b.moving).astype(float)
    return SurvivingFeet(np.repeat(np.arange(count), segments), segment, np.stack([np.zeros(len(segment)), stop]))


class Survivors(NamedTuple):
    """Feet that are possible by the signs of h_r and by their distances."""

    feet: SurvivingFeet  # the possible feet
    lower: np.ndarray  # lower bounds of the distances
    upper: np.ndarray  # upper bounds of the distances
    single: np.ndarray  # whether h_rr has one sign, which excludes a second foot on the same part


def survivors(a: Curve, b: Curve, pieces: EventPieces, feet: SurvivingFeet) -> Survivors:
    """Return the parts of b on which h_r can vanish and distances that matter occur."""
    rows, bounds = [], []
    for start in range(0, len(feet.piece), BLOCK):
        stop = min(start + BLOCK, len(feet.piece))
        part = feet.take(np.arange(start, stop))
        own = pieces.take(part.piece)
        p, q = restricted(a.points[..., own.segment], own.side), piece_of(b, part.segment, part.side)
        lower, upper = hull_distances(p, q.points)
        origin = q.points.mean(0)
        form = foot_form(p - origin, q.about(origin), part.side)
        kept = np.flatnonzero(may_vanish(form) & ~unwanted((lower, upper), own.wanted))
        second, error = np.diff(form.c[..., kept], axis=1), 2.1 * form.error[kept]
        single = (second.min((0, 1)) > error) | (second.max((0, 1)) < -error)
        rows.append(start + kept)
        bounds.append(np.stack([lower[kept], upper[kept], single]))
    table = np.concatenate(bounds, axis=1) if bounds else np.zeros((3, 0))
    index = np.concatenate(rows) if rows else np.zeros(0, int)
    return Survivors(feet.take(index), table[0], table[1], table[2] > 0)


def pairs(pieces: EventPieces, kept: Survivors) -> Systems:
    """Return the antipodal systems; with the ends of b they cover its events with one foot at an end."""
    feet, own = kept.feet, pieces.take(kept.feet.piece)
    return Systems(np.stack([own.segment, feet.segment]), np.stack([own.side, feet.side]), own.wanted)


def triples(b: Curve, pieces: EventPieces, kept: Survivors) -> Iterator[tuple[Systems, Systems]]:
    """Yield the one-to-two systems on different segments and on one, for groups of pieces: pairs of surviving feet.

    Both distances are equal at an event, so their bounds must meet.
    """
    count = len(pieces.segment)
    edges = np.searchsorted(kept.feet.piece, np.arange(count + 1))
    waiting, size = [], 0
    for piece in range(count):
        r, s = (edges[piece] + x for x in np.triu_indices(edges[piece + 1] - edges[piece]))
        meet = (kept.lower[r] <= kept.upper[s]) & (kept.lower[s] <= kept.upper[r])
        meet &= (r != s) | (kept.feet.segment[r] < b.moving) & ~kept.single[r]
        waiting.append(np.stack([np.full(meet.sum(), piece), r[meet], s[meet]]))
        size += waiting[-1].shape[1]
        if size >= 16 * SYSTEMS or piece == count - 1:
            own, r, s = np.concatenate(waiting, axis=1)
            mine, first, second = pieces.take(own), kept.feet.take(r), kept.feet.take(s)
            box = np.stack([mine.side, first.side, second.side])
            systems = Systems(np.stack([mine.segment, first.segment, second.segment]), box, mine.wanted)
            same = first.segment == second.segment
            yield systems.take(np.flatnonzero(~same)), systems.take(np.flatnonzero(same))
            waiting, size = [], 0
