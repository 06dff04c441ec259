"""Candidates for the maximum of the distance from a to b: ends of a, and the roots of the systems of all events."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from jhd._distance.normalization.jets import polynomial_jet
from jhd._distance.published.events.forms import Curve, hull_distances, restricted
from jhd._distance.published.events.host_pair import HostPair
from jhd._distance.published.events.survivors import EventPieces, SurvivingFeet, everywhere, pairs, survivors, triples
from jhd._distance.published.events.systems import NO_EVENTS, Events, Systems, solve


class Search(NamedTuple):
    """Options of the solver in common coordinates: size of final boxes, open boxes of a system, boxes in all."""

    box_size: float
    limit: int
    max_boxes: int


class Candidates(NamedTuple):
    """Points of a, by segments of the solver: (candidates,) arrays."""

    segment: np.ndarray  # index of the segment
    t: np.ndarray  # parameter on the segment
    bound: np.ndarray  # upper bound of the distance, which is measured if the bound is large


class Unresolved(NamedTuple):
    """Boxes on curves of roots: segment and interval (2, boxes) of a, bounds of the distances."""

    segment: np.ndarray
    side: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


class Stats(NamedTuple):
    """Counts of the search, and unresolved boxes; pairs are the examined pairs of pieces and parts of b."""

    pairs: int
    boxes: int
    candidates: int
    roots: int
    exhausted: bool
    unresolved: Unresolved


def candidate_events(
    pair: HostPair, pieces: EventPieces, search: Search, feet: SurvivingFeet | None = None
) -> tuple[Candidates, Stats]:
    """Return isolated points of a, ends of its segments in the pieces, and all events on the pieces."""
    a, b = pair.a, pair.b
    feet = everywhere(b, len(pieces.segment)) if feet is None else feet
    parts: list[tuple[np.ndarray, ...]] = []
    stretches = [_distances(a, b, NO_EVENTS)]
    boxes, roots, exhausted = 0, 0, False
    for groups in _groups(pair, pieces, feet):
        found = solve(a, b, groups, box_size=search.box_size, limit=search.limit, max_boxes=search.max_boxes - boxes)
        boxes, exhausted, roots = boxes + found.boxes, exhausted or found.exhausted, roots + int(found.isolated.sum())
        parts.append(_refined(a, b, found))
        stretches.append(_distances(a, b, found))
    segment, t, bound = ([part[k] for part in parts] for k in range(3))
    # A maximum at an end of a segment is at an end of a piece, unless it was trimmed.
    start = np.append(pieces.segment[pieces.side[0] == 0], pair.first.isolated)
    stop = pieces.segment[pieces.side[1] == 1]
    end_points = np.concatenate([a.points[0, :, start], a.points[-1, :, stop]])
    candidates = Candidates(
        np.concatenate([start, stop, *segment]),
        np.concatenate([np.zeros(len(start)), np.ones(len(stop)), *t]),
        np.concatenate([near_ends(end_points, b), *bound]),
    )
    left = Unresolved(*(np.concatenate(x, axis=-1) for x in zip(*stretches, strict=True)))
    return candidates, Stats(len(feet.piece), boxes, len(candidates.t), roots, exhausted, left)


def _groups(pair: HostPair, pieces: EventPieces, feet: SurvivingFeet) -> Iterator[list[Systems]]:
    """Yield the systems of the pieces, in portions: pairs, triples, triples on one segment."""
    kept = survivors(pair.a, pair.b, pieces, feet)
    antipodal, none = pairs(pieces, kept), np.zeros(0, int)
    for two, on_one in triples(pair.b, pieces, kept):
        yield [antipodal, two, on_one]
        antipodal = antipodal.take(none)


def near_ends(points: np.ndarray, b: Curve) -> np.ndarray:
    """Return the distances of points (count, 2) to the nearest end of a segment of b."""
    ends = np.concatenate([b.points[0], b.points[-1]], axis=1)
    squares = sum((points[:, k, None] - ends[k]) ** 2 for k in (0, 1))
    return np.sqrt(np.min(squares, axis=1))


def _distances(a: Curve, b: Curve, found: Events) -> Unresolved:
    """Return the boxes that are no roots, with bounds of the distances to both feet."""
    rows = np.flatnonzero(~found.isolated)
    segment, box = found.segment[:, rows], found.box[:, :, rows]
    if not len(rows):
        return Unresolved(segment[0], box[0], np.zeros(0), np.zeros(0))
    p = restricted(a.points[..., segment[0]], box[0])
    bounds = [hull_distances(p, restricted(b.points[..., segment[k]], box[k])) for k in (1, 2)]
    return Unresolved(segment[0], box[0], np.maximum(*(x[0] for x in bounds)), np.minimum(*(x[1] for x in bounds)))


def _refined(a: Curve, b: Curve, found: Events) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return segments, parameters and distances of the events, by Newton's method from the middles of their boxes."""
    if not found.segment.shape[1]:
        return np.zeros(0, int), np.zeros(0), np.zeros(0)
    p, q, w = a.points[..., found.segment[0]], b.points[..., found.segment[1]], b.points[..., found.segment[2]]
    two = np.any(found.segment[1] != found.segment[2]) & (found.segment[1] != found.segment[2])
    two = two | np.any(found.box[1] != found.box[2], axis=0)
    still = [k >= b.moving for k in found.segment[1:]]
    low, high = found.box[:, 0], found.box[:, 1]
    y = 0.5 * (low + high)
    # Newton's method ends if no parameter moves by more than 2^-44.
    for _ in range(8):
        step = _newton_step(polynomial_jet(p, y[0]), polynomial_jet(q, y[1]), polynomial_jet(w, y[2]), two, still)
        moved = np.clip(y + np.where(np.isfinite(step) & found.isolated, step, 0.0), low, high)
        still_, y = np.abs(moved - y).max() <= 2.0**-44, moved
        if still_:
            break
    point = polynomial_jet(p, y[0])[0]
    distance = [np.hypot(*(point - foot)) for foot in (polynomial_jet(q, y[1])[0], polynomial_jet(w, y[2])[0])]
    return found.segment[0], y[0], np.minimum(*distance)


def _newton_step(a: Any, r: Any, s: Any, two: np.ndarray, still: list[np.ndarray]) -> np.ndarray:
    """Return Newton's step for equations (12) or (13) of Kim et al. 2010, by Cramer's rule; a foot in a point stays."""

    def dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return x[0] * y[0] + x[1] * y[1]

    c, e, one = a[0] - r[0], a[0] - s[0], np.ones_like(two, float)
    rows = []
    for offset, foot, held in ((c, r, still[0]), (e, s, still[1] | ~two)):
        value, along = dot(offset, foot[1]), dot(a[1], foot[1])
        bend = dot(offset, foot[2]) - dot(foot[1], foot[1])
        rows.append([np.where(held, 0.0, value), np.where(held, 0.0, along), np.where(held, one, bend)])
    (f2, a2, b2), (f3, a3, b3) = rows
    f1 = np.where(two, dot(c + e, s[0] - r[0]), dot(c, a[1]))
    a1 = np.where(two, 2 * dot(a[1], s[0] - r[0]), dot(a[1], a[1]) + dot(c, a[2]))
    b1 = np.where(two, -2 * dot(c, r[1]), -dot(r[1], a[1]))
    c1 = np.where(two, 2 * dot(e, s[1]), 0.0)
    with np.errstate(all="ignore"):
        t = -(f1 - b1 * f2 / b2 - c1 * f3 / b3) / (a1 - b1 * a2 / b2 - c1 * a3 / b3)
        return np.stack([t, -(f2 + a2 * t) / b2, -(f3 + a3 * t) / b3])
