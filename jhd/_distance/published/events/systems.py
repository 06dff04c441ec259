"""The solver of the systems of all events: boxes are cut by the equations and halved until they are small.

A box is a set of parameter intervals of one system. It is examined with the coefficients on it, blossomed from the
control points themselves; linear bounds of the equations cut its sides, and it is halved if that gains little.

With h(t, s) = 2 A(t).B(s) - |B(s)|^2 the systems, in the unit box of each piece, are

 - pairs (t, r), antipodal events: (A - B).A' = 0 and h_r = 0;
 - triples (t, r, s), one-to-two events with feet on different segments: h_r(t, r) = 0, h_s(t, s) = 0 and
   h(t, s) - h(t, r) = 0, whose enclosure needs two bivariate forms and no trivariate one;
 - triples on one segment, where r = s solves the above for a whole sheet: h_r(t, r) = 0, h'[r, s] = 0 and
   h[r, r, s, s] = 0 with divided differences in the parameter of b. All pairs r != s of solutions solve these too, by
   the recursion of divided differences, and r = s only where h' = h'' = h''' = 0, which is no sheet.

Ends and corners of b are segments of one point: h_r vanishes identically there, and the same systems hold.

Two segments that meet, and an end and its own segment, have their common point as a trivial root. A box next to it is
dropped if h' is strictly monotone from the one foot through the joint to the other: by Rolle's theorem there is one
critical point then, not two. This is exact at an end; at a joint it takes a common tangent.

Source: Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and R^3, GMP 2008;
equations (11) to (13) of Kim et al. 2010. The bounds of the third equation and the last system are ours.
"""

from collections.abc import Callable
from functools import cache
from math import comb, factorial
from typing import NamedTuple

import numpy as np

from jhd._arithmetic.rounding import gamma
from jhd._distance.normalization.curves import elevation_matrix
from jhd._distance.published.events.forms import (
    Curve,
    EventForm,
    bounds,
    cut_by,
    extent,
    foot_form,
    h_form,
    hull_distances,
    linear_cut,
    may_vanish,
    mean_slope,
    piece_of,
    ramp,
    restricted,
    unwanted,
)

# Cuts are widened by at least this, which covers the rounding of the cut itself.
LEAST_PAD = 1e-14
# Boxes examined together: for cubics, their arrays stay in the cache of a core.
BLOCK = 1024
# Systems in work at one time; each has at most `limit` boxes, which bounds the memory.
SYSTEMS = 2048
# Two roundings of a parameter in [0, 1].
_ULP = 2.0**-52
# Sides below this are final whatever their size in space: parameters hold no more.
_RESOLVED = 2.0**-40


class EventCut(NamedTuple):
    """Remainder of each box: whether there is any, and its sides (variables, 2, boxes) in units of the box."""

    alive: np.ndarray
    sides: np.ndarray
    sizes: np.ndarray  # (variables, boxes): extents of the pieces


def _unit(count: int, boxes: int) -> np.ndarray:
    return np.broadcast_to(np.array([0.0, 1.0])[None, :, None], (count, 2, boxes)).copy()


def pair_kernel(a: Curve, b: Curve, segment: np.ndarray, box: np.ndarray, wanted: np.ndarray) -> EventCut:
    """Cut boxes of antipodal events by each equation, and by the inverse of the mean Jacobian."""
    p, q = piece_of(a, segment[0], box[0]), piece_of(b, segment[1], box[1])
    distances = hull_distances(p.points, q.points)
    origin = q.points.mean(0)
    foot = foot_form(p.points - origin, q.about(origin), box[1])
    origin = p.points.mean(0)
    along = foot_form(q.points - origin, p.about(origin))
    along = EventForm(along.c.swapaxes(0, 1), along.error)  # axes (t, r) for both
    alive = may_vanish(foot) & may_vanish(along) & ~unwanted(distances, wanted)
    sides = _unit(2, box.shape[-1])
    models = []
    for form in (along, foot):
        slopes = [mean_slope(form.c, axis) for axis in (0, 1)]
        rest = form.c - sum(ramp(form.c.shape[k], k, 2) * slopes[k] for k in (0, 1))
        size = 1e-14 * (np.abs(slopes[0]) + np.abs(slopes[1]))
        models.append((*slopes, *bounds(rest, form.error + size)))
    (a1, b1, low1, high1), (a2, b2, low2, high2) = models
    determinant = a1 * b2 - b1 * a2
    products = np.abs(a1 * b2) + np.abs(b1 * a2)
    regular = np.abs(determinant) > 1e-8 * products
    safe = np.where(regular, determinant, 0.0)
    for k, (first, second) in enumerate(((b2, -b1), (-a2, a1))):
        low = np.minimum(first * low1, first * high1) + np.minimum(second * low2, second * high2)
        high = np.maximum(first * low1, first * high1) + np.maximum(second * low2, second * high2)
        # The determinant and the intervals are rounded a few times; the variable is at most one.
        size = 1e-14 * (np.maximum(np.abs(low), np.abs(high)) + products)
        sides[k] = cut_by(sides[k], safe, low - size, high + size)
    sides[0] = linear_cut(sides[0], along, 0)
    sides[1] = linear_cut(sides[1], foot, 1)
    return _cut(alive, sides, [p.points, q.points])


def _cut(alive: np.ndarray, sides: np.ndarray, pieces: list[np.ndarray]) -> EventCut:
    # Widened like the children: an interval that only rounding has emptied still counts.
    return EventCut(
        alive & np.all(sides[:, 1] - sides[:, 0] >= -LEAST_PAD, axis=0), sides, np.stack([extent(x) for x in pieces])
    )


def triple_kernel(a: Curve, b: Curve, segment: np.ndarray, box: np.ndarray, wanted: np.ndarray) -> EventCut:
    """Cut boxes of one-to-two events with feet on different segments."""
    p = restricted(a.points[..., segment[0]], box[0])
    q = [piece_of(b, k, side) for k, side in zip(segment[1:], box[1:], strict=True)]
    distances = [hull_distances(p, piece.points) for piece in q]
    origins = [piece.points.mean(0) for piece in q]
    forms = [h_form(p - o, piece.points - o) for o, piece in zip(origins, q, strict=True)]
    feet = [foot_form(p - o, piece.about(o), side) for o, piece, side in zip(origins, q, box[1:], strict=True)]
    between, middle = origins[1] - origins[0], 0.5 * (origins[0] + origins[1])
    # |A - o_r|^2 - |A - o_s|^2, of degree one in A.
    bridge = 2 * ((p - middle) * between).sum(1)
    reach = np.abs(p - middle).max((0, 1)) + np.abs(between).max(0)
    error = forms[0].error + forms[1].error + gamma(36 * len(p) + 24, np.float64) * 4 * reach
    low = bridge + forms[1].c.min(1) - forms[0].c.max(1)
    high = bridge + forms[1].c.max(1) - forms[0].c.min(1)
    alive = (low.min(0) <= error) & (high.max(0) >= -error)
    for foot, apart in zip(feet, distances, strict=True):
        alive &= may_vanish(foot) & ~unwanted(apart, wanted)
    alive &= ~_trivial(a, b, segment, box, alive)
    sides = _unit(3, box.shape[-1])
    slope = (
        bridge[-1] - bridge[0] + sum(sign * (f.c[-1] - f.c[0]).mean(0) for f, sign in zip(forms, (-1, 1), strict=True))
    )
    ramp = np.linspace(0.0, 1.0, len(p))[:, None] * slope
    size = error + 1e-14 * (np.abs(slope) + np.abs(low).max(0) + np.abs(high).max(0))
    sides[0] = cut_by(sides[0], slope, (low - ramp).min(0) - size, (high - ramp).max(0) + size)
    for k, foot in enumerate(feet):
        sides[0] = linear_cut(sides[0], foot, 0)
        sides[1 + k] = linear_cut(sides[1 + k], foot, 1)
    return _cut(alive, sides, [p, *(piece.points for piece in q)])


def same_kernel(a: Curve, b: Curve, segment: np.ndarray, box: np.ndarray, wanted: np.ndarray) -> EventCut:
    """Cut boxes of one-to-two events with both feet on one segment, r <= s."""
    p = restricted(a.points[..., segment[0]], box[0])
    low, high = np.minimum(box[1, 0], box[2, 0]), np.maximum(box[1, 1], box[2, 1])
    both, *q = (piece_of(b, segment[1], side) for side in (np.stack([low, high]), box[1], box[2]))
    origin = both.points.mean(0)
    whole, *feet = (
        foot_form(p - origin, piece.about(origin), side)
        for piece, side in ((both, None), (q[0], box[1]), (q[1], box[2]))
    )
    alive = box[1, 0] <= box[2, 1]
    for foot, piece in zip(feet, q, strict=True):
        alive &= may_vanish(foot) & ~unwanted(hull_distances(p, piece.points), wanted)
    alive &= ~_closing(a, b, segment, box, alive)
    width = high - low
    inside = [(side - low) / np.where(width > 0, width, 1.0) for side in box[1:]]
    # The parameters in units of the hull are off by a few units of roundoff: a fraction of the range of the form.
    differences = [_divided(whole, order, inside) for order in (1, 2)]
    for form in differences:
        alive &= may_vanish(form)
    sides = _unit(3, box.shape[-1])
    for form in (*feet, *differences):
        sides[0] = linear_cut(sides[0], form, 0)
    sides[1], sides[2] = linear_cut(sides[1], feet[0], 1), linear_cut(sides[2], feet[1], 1)
    for form in differences:
        sides[1], sides[2] = linear_cut(sides[1], form, 1), linear_cut(sides[2], form, 2)
    return _cut(alive, sides, [p, *(piece.points for piece in q)])


@cache
def _divided_map(degree: int, order: int) -> np.ndarray:
    """Return averages that make divided differences from differences of h': ((m + 1)^2, m + 1), m = degree - order.

    h'[r, s] is the mean of h'' on [r, s], and h[r, r, s, s] the mean of h''' / 6 with the weight 6 u (1 - u)
    (Hermite-Genocchi). With the blossom F of the derivative, of degree m, its value at (1 - u) r + u s is the sum over
    l of C(m, l) (1 - u)^(m - l) u^l F(r, .., s, ..) with l arguments s; the integral over u is a beta function, and
    F(r^(m - l), s^l) has the coefficients c_(i + j) of degrees (m - l, l), raised to (m, m). All weights are
    non-negative and sum to one.
    """
    m = degree - order
    result = np.zeros((m + 1, m + 1, m + 1))
    for level in range(m + 1):
        weight = 1 / (m + 1)
        if order == 2:
            weight = 6 * comb(m, level) * factorial(level + 1) * factorial(m - level + 1) / factorial(m + 3)
        first, second = elevation_matrix(m - level, m), elevation_matrix(level, m)
        for i in range(m - level + 1):
            for j in range(level + 1):
                result[:, :, i + j] += weight * np.outer(first[:, i], second[:, j])
    return result.reshape(-1, m + 1)


def _divided(form: EventForm, order: int, inside: list[np.ndarray]) -> EventForm:
    """Return h'[r, s] (order 1) or h[r, r, s, s] (order 2) up to a factor, from coefficients (t, r, s) of h'."""
    n, degree, boxes = form.c.shape[0] - 1, form.c.shape[1] - 1, form.c.shape[2]
    c = np.diff(form.c, order, axis=1)
    m = degree - order
    table = np.einsum("kl,tlb->ktb", _divided_map(degree, order), c).reshape(m + 1, m + 1, n + 1, boxes)
    size = np.abs(c).max((0, 1))
    table = restricted(table, inside[0])
    table = restricted(table.swapaxes(0, 1), inside[1]).swapaxes(0, 1)
    return EventForm(np.moveaxis(table, 2, 0), 2.1**order * form.error + gamma(60 * degree + 60, np.float64) * size)


def _bends(a: Curve, b: Curve, segment: np.ndarray, box: np.ndarray, k: int, side: list[np.ndarray]) -> np.ndarray:
    """Return 1 or -1 if h_rr has this sign for all t of the box and r in `side` of segment k, else 0."""
    p, q = restricted(a.points[..., segment[0]], box[0]), piece_of(b, segment[k], np.stack(side))
    origin = q.points.mean(0)
    form = foot_form(p - origin, q.about(origin))
    second, error = np.diff(form.c, axis=1), 2.1 * form.error
    return np.where(second.min((0, 1)) > error, 1, np.where(second.max((0, 1)) < -error, -1, 0))


def _through(a: Curve, b: Curve, segment: np.ndarray, box: np.ndarray, r: int, s: int) -> np.ndarray:
    """Return whether h' is monotone from foot r through the end of its segment and the start of the next one to s."""
    ones, zeros = np.ones(box.shape[-1]), np.zeros(box.shape[-1])
    first = _bends(a, b, segment, box, r, [box[r, 0], ones])
    return (first != 0) & (first == _bends(a, b, segment, box, s, [zeros, box[s, 1]]))


def _trivial(a: Curve, b: Curve, segment: np.ndarray, box: np.ndarray, alive: np.ndarray) -> np.ndarray:
    """Return boxes that hold at most the common point of two segments that meet, or of an end and its own segment."""
    drop = np.zeros(len(alive), bool)
    for r, s in ((1, 2), (2, 1)):
        rows = np.flatnonzero(alive & (b.next_segment[segment[r]] == segment[s]))
        if len(rows):
            drop[rows] |= _through(a, b, segment[:, rows], box[:, :, rows], r, s)
    for owner, stop in ((b.start_of, False), (b.end_of, True)):
        rows = np.flatnonzero(alive & (owner[segment[2]] == segment[1]))
        if len(rows):
            ends, side = np.full(len(rows), float(stop)), box[1][:, rows]
            reach = [side[0], ends] if stop else [ends, side[1]]
            drop[rows] |= _bends(a, b, segment[:, rows], box[:, :, rows], 1, reach) != 0
    return drop


def _closing(a: Curve, b: Curve, segment: np.ndarray, box: np.ndarray, alive: np.ndarray) -> np.ndarray:
    """Return boxes of a segment that closes on itself, at whose joint r and s are one point."""
    drop = np.zeros(len(alive), bool)
    rows = np.flatnonzero(alive & (b.next_segment[segment[1]] == segment[1]))
    if len(rows):
        drop[rows] = _through(a, b, segment[:, rows], box[:, :, rows], 2, 1)
    return drop


class Systems(NamedTuple):
    """Systems of one kind: segments (2 or 3, systems) of a and b, boxes (2 or 3, 2, systems), distances that matter."""

    segment: np.ndarray
    box: np.ndarray
    wanted: np.ndarray  # (2, systems): lower and upper end

    def take(self, rows: np.ndarray) -> "Systems":
        """Return the systems with these indices."""
        return Systems(self.segment[:, rows], self.box[:, :, rows], self.wanted[:, rows])


class Events(NamedTuple):
    """Boxes of events: segment and box as in `Systems` with three variables, and whether it is a root."""

    segment: np.ndarray
    box: np.ndarray
    isolated: np.ndarray  # False: part of a curve of roots, or of one that could not be told from it
    exhausted: bool  # whether boxes were left unexamined
    boxes: int


NO_EVENTS = Events(np.zeros((3, 0), int), np.zeros((3, 2, 0)), np.zeros(0, bool), False, 0)

_Kernel = Callable[[Curve, Curve, np.ndarray, np.ndarray, np.ndarray], EventCut]


def solve(a: Curve, b: Curve, groups: list[Systems], *, box_size: float, limit: int, max_boxes: int) -> Events:
    """Return all boxes that may hold an event, of systems in three groups: pairs, triples, triples on one segment.

    Args:
        a: the curve of the maximum.
        b: the target curve.
        groups: systems as made by `pairs` and `triples`.
        box_size: a box is final when its pieces of both curves are at most this large.
        limit: largest number of open boxes of one system; if there are more, it has a curve of roots.
        max_boxes: largest number of examined boxes in all.
    """
    found, boxes, exhausted = [], 0, False
    for kernel, systems in zip((pair_kernel, triple_kernel, same_kernel), groups, strict=True):
        for start in range(0, systems.segment.shape[1], SYSTEMS):
            rows = np.arange(start, min(start + SYSTEMS, systems.segment.shape[1]))
            parts, count, full = _solve(kernel, a, b, systems.take(rows), box_size, limit, max_boxes - boxes)
            found += parts
            boxes, exhausted = boxes + count, exhausted or full
    every = [(NO_EVENTS.segment, NO_EVENTS.box, NO_EVENTS.isolated), *found]
    segment, box, isolated = (np.concatenate(x, axis=-1) for x in zip(*every, strict=True))
    return Events(segment, box, isolated, exhausted, boxes)


def _solve(
    kernel: _Kernel, a: Curve, b: Curve, systems: Systems, box_size: float, limit: int, max_boxes: int
) -> tuple[list[tuple[np.ndarray, ...]], int, bool]:
    """Return boxes of some systems, level by level."""
    job, box = np.arange(systems.segment.shape[1]), systems.box
    found: list[tuple[np.ndarray, ...]] = []
    examined = 0

    def keep(rows: np.ndarray, box: np.ndarray, isolated: bool) -> None:
        segment = systems.segment[:, rows]
        if len(segment) == 2:
            segment, box = np.concatenate([segment, segment[1:]]), np.concatenate([box, box[1:]])
        found.append((segment, box, np.full(len(rows), isolated)))

    while len(job):
        crowded = np.bincount(job, minlength=systems.segment.shape[1])[job] > limit
        if crowded.any():
            keep(job[crowded], box[:, :, crowded], False)
            job, box = job[~crowded], box[:, :, ~crowded]
        if examined + len(job) > max_boxes:
            keep(job, box, False)
            return found, examined, True
        examined += len(job)
        next_job, next_box = [], []
        for start in range(0, len(job), BLOCK):
            rows, part = job[start : start + BLOCK], box[:, :, start : start + BLOCK]
            cut = kernel(a, b, systems.segment[:, rows], part, systems.wanted[:, rows])
            final, children = _children(part, cut, box_size)
            keep(rows[final[0]], final[1], True)
            next_job += [rows[index] for index, _ in children]
            next_box += [boxes for _, boxes in children]
        job = np.concatenate(next_job) if next_job else job[:0]
        box = np.concatenate(next_box, axis=2) if next_box else box[:, :, :0]
    return found, examined, False


def _children(
    box: np.ndarray, cut: EventCut, box_size: float
) -> tuple[tuple[np.ndarray, np.ndarray], list[tuple[np.ndarray, np.ndarray]]]:
    """Return final boxes, and the boxes to examine next, halved if the cuts left much; each with their rows."""
    rows = np.flatnonzero(cut.alive)
    old, sides, sizes = box[:, :, rows], cut.sides[:, :, rows], cut.sizes[:, rows]
    # Cuts are widened by this fraction of the box and by LEAST_PAD.
    pad = 1e-3 * (sides[:, 1] - sides[:, 0]) + LEAST_PAD
    low, high = np.maximum(sides[:, 0] - pad, 0.0), np.minimum(sides[:, 1] + pad, 1.0)
    width = old[:, 1] - old[:, 0]
    # At an end of the box the very number is kept: roots at ends of segments lie on it.
    start = np.where(low > 0, np.maximum(old[:, 0] + low * width - _ULP, old[:, 0]), old[:, 0])
    stop = np.where(high < 1, np.minimum(old[:, 0] + high * width + _ULP, old[:, 1]), old[:, 1])
    new, shares = np.stack([start, stop], axis=1), high - low
    extent = sizes * shares
    done = np.all((extent <= box_size) | (stop - start <= _RESOLVED), axis=0)
    largest = np.argmax(np.where(stop - start > _RESOLVED, extent, -1.0), axis=0)
    # A box whose largest side keeps more than this fraction is halved.
    halve = ~done & (np.max(extent, axis=0) > 0.7 * np.max(sizes, axis=0))
    whole = ~done & ~halve
    column = np.flatnonzero(halve)
    k, left, right = largest[column], new[:, :, column], new[:, :, column].copy()
    index = np.arange(len(column))
    middle = 0.5 * (left[k, 0, index] + left[k, 1, index])
    left[k, 1, index], right[k, 0, index] = middle, middle
    children = [(rows[whole], new[:, :, whole]), (rows[column], left), (rows[column], right)]
    return (rows[done], new[:, :, done]), children
