"""Trimming as Kim et al. 2010 print it, for comparison: a distance map read by pixels, and tests of control points.

 1. The distance map of b's arcs is read at the pixels that a passes through. The largest reading less eps1 (arcs), eps2
    (rendering, here 0) and eps3 (half the diagonal of a pixel) is the lower bound LB, as in (1) and (2).
 2. For an arc of either curve, the pixels of its three control points name arcs of the other curve; the one that is
    nearest there is tested. If it passes (8), (9) or (10), the piece of the arc is trimmed.
 3. Events are sought on the rest of both curves.

None of this is safe. Test (8) passes arcs that reach beyond LB (`within_offset_unsafe`). Trimming b can remove the foot
of the maximum; the largest event that is left is then too small, and often below LB.

In (5) the offset reads LB / cos(theta), with theta of figure 15 taken for half the sweep. That region is larger than
the one in which the control polygon is to be proven, and trims the very arc of the maximum. So cos(theta) is used as a
factor, as the text argues; the test is unsafe in both readings.

Source: Kim et al. 2010, sections 3 and 4.2.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jhd._distance.normalization.jets import polynomial_jet
from jhd._distance.published.arc_bounds import Arcs, cross
from jhd._distance.published.events.forms import Curve
from jhd._distance.published.events.host_pair import HostPair, HostSide
from jhd._distance.published.events.survivors import EventPieces, SurvivingFeet, event_pieces
from jhd._fields.distance_map import DistanceMap, distance_map
from jhd._shapes.biarc import BiarcCurve


class PrintedTrimming(NamedTuple):
    """The parts of both curves that remain."""

    pieces: EventPieces  # parts of a
    feet: SurvivingFeet  # parts of b, for each piece all remaining ones, and all ends of b
    lower: float  # the lower bound LB, in common coordinates
    kept_of_b: float  # the total length of the parameter intervals of b that remain


def printed_trimming(pair: HostPair, d: Arcs, c: Arcs, level: float, pixels: int) -> PrintedTrimming:
    """Return the pieces of a and of b that the printed tests leave.

    Args:
        pair: both curves.
        d: arcs of a, of the stored segments.
        c: arcs of b.
        level: distances up to it do not matter; in common coordinates.
        pixels: pixels along the longer side of the map.
    """
    of_d, of_c = _mapped(d, pair, pixels), _mapped(c, pair, pixels)
    eps1 = max(float(np.max(x.deviation)) for x in (d, c))
    eps3 = float(of_c.spacing[0]) / np.sqrt(2)
    lower = max(_largest_reading(pair.a, of_c) - (eps1 + eps3), level, 0.0)
    a = _left(_moving(d, pair.first), c, of_c, lower, eps1)
    b = _left(_moving(c, pair.second), d, of_d, lower, eps1)
    ends = np.arange(pair.b.moving, pair.b.points.shape[-1])
    segment = np.concatenate([b.segment, ends])
    side = np.concatenate([b.side, np.zeros((2, len(ends)))], axis=1)
    count = len(a.segment)
    feet = SurvivingFeet(np.repeat(np.arange(count), len(segment)), np.tile(segment, count), np.tile(side, count))
    return PrintedTrimming(a, feet, lower, float(np.sum(b.side[1] - b.side[0])))


def within_offset_unsafe(d: Arcs, c: Arcs, limit: float, eps1: float) -> np.ndarray:
    """Return whether the control points of arcs d pass (8), (9) or (10) for the arcs c: unsafe, arcs can reach farther.

    (8) takes control points in the wedge of c and bounds their distances to its circle by limit cos(theta) - eps1. It
    overlooks that a flat arc d can run next to its control points: with r_c = 100, r_d = 200, a half chord of 10 and a
    limit of 1.2, the control points are within 1.195 and the arc reaches 1.445.
    """
    points = np.stack([d.start, d.apex, d.end])
    offset = points - c.center
    before = c.turn * cross(c.start - c.center, offset) < 0
    beyond = c.turn * cross(offset, c.end - c.center) < 0
    outside = before | beyond
    cosine = (1 - d.bulge) * (1 + d.bulge) / (1 + d.bulge**2)
    radial = np.abs(np.abs(offset) - c.radius).max(axis=0) < limit * cosine - eps1
    # The first point outside says which end of c is taken.
    first = np.argmax(outside, axis=0)
    at_start = np.take_along_axis(before, first[None], axis=0)[0]
    end = np.where(at_start, c.start, c.end)
    near = np.abs(points - end).max(axis=0) < limit - eps1
    return np.where(outside.any(axis=0), near, radial)


def _moving(arcs: Arcs, side: HostSide) -> Arcs:
    """Return the arcs of segments that are no points, with the solver's numbers of their segments."""
    number = side.moving
    arcs = arcs.take(np.flatnonzero(number[arcs.segment] >= 0))
    return arcs._replace(segment=number[arcs.segment])


def _mapped(arcs: Arcs, pair: HostPair, pixels: int) -> DistanceMap:
    """Return the distance map of arcs on square pixels that cover both curves."""
    points = np.concatenate([np.moveaxis(x.points, 1, -1).reshape(-1, 2) for x in (pair.a, pair.b)])
    low, high = points.min(axis=0), points.max(axis=0)
    step = max(float(np.max(high - low)) / pixels, np.finfo(float).tiny * pixels)
    size = np.maximum(np.ceil((high - low) / step), 1).astype(int)
    ends = (jnp.asarray(np.stack([np.real(x), np.imag(x)], axis=1)) for x in (arcs.start, arcs.end))
    rest = (arcs.bulge, arcs.segment, arcs.t0, arcs.t1, arcs.deviation, np.full(len(arcs.t0), -1))
    curve = BiarcCurve(*ends, *(jnp.asarray(x) for x in rest))
    return distance_map(curve, low, low + step * size, (int(size[0]), int(size[1])))


def _pixels(field: DistanceMap, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the pixels that contain points, or the nearest pixels."""
    low, step = np.asarray(field.lower), np.asarray(field.spacing)
    return tuple(
        np.clip(np.floor((z - low[k]) / step[k]).astype(int), 0, field.distance.shape[k] - 1)
        for k, z in enumerate((x, y))
    )


def _largest_reading(a: Curve, field: DistanceMap) -> float:
    """Return the largest value of the map at the pixels of samples along a curve, about one a pixel."""
    lengths = np.hypot(*np.moveaxis(np.diff(a.points, axis=0), 1, 0)).sum(axis=0)
    counts = 1 + np.ceil(lengths / float(field.spacing[0])).astype(int)
    counts[a.moving :] = 1
    segment = np.repeat(np.arange(len(counts)), counts)
    t = (np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)) / np.maximum(counts - 1, 1)[segment]
    x, y = polynomial_jet(a.points[..., segment], t)[0]
    return float(np.max(np.asarray(field.distance)[_pixels(field, x, y)], initial=0.0))


def _left(arcs: Arcs, others: Arcs, field: DistanceMap, limit: float, eps1: float) -> EventPieces:
    """Return the pieces of arcs that are not trimmed, with neighbors merged; `field` is the map of the other arcs."""
    points = np.stack([arcs.start, arcs.apex, arcs.end])
    pixels = _pixels(field, np.real(points), np.imag(points))
    distance, nearest = np.asarray(field.distance)[pixels], np.asarray(field.nearest)[pixels]
    named = np.take_along_axis(nearest, np.argmin(distance, axis=0)[None], axis=0)[0]
    left = arcs.take(np.flatnonzero(~within_offset_unsafe(arcs, others.take(named), limit, eps1)))
    return event_pieces(left.segment, left.t0, left.t1, np.full(len(left.t0), np.inf), 0.0)
