"""The solver of the systems of all events: boxes are cut by the equations and halved until they are small.

A box is a set of parameter intervals of one system. It is examined with the coefficients on it, blossomed from the
control points themselves; linear bounds of the equations cut its sides, and it is halved where that gains little.

Source: Elber & Grandine, Hausdorff and minimal distances between parametric freeforms in R^2 and R^3, GMP 2008.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from jhd.distance.published.events.forms import Curve
from jhd.distance.published.events.kernels import LEAST_PAD, EventCut, pair_kernel, same_kernel, triple_kernel

# Boxes examined together: the arrays of so many stay in the cache of a core for cubics.
BLOCK = 1024
# Systems in work at one time; each has at most `limit` boxes, which bounds the memory.
SYSTEMS = 2048
# A box whose largest side keeps more than this share is halved.
_KEPT = 0.7
# Cuts are widened by this share of the box and by LEAST_PAD.
_PAD = 1e-3
# Two roundings of a parameter in [0, 1].
_ULP = 2.0**-52
# Sides below this are final whatever their size in space: parameters hold no more.
_RESOLVED = 2.0**-40


class Systems(NamedTuple):
    """Systems of one kind: segments (2 or 3, systems) of a and b, boxes (2 or 3, 2, systems), distances that matter."""

    segment: np.ndarray
    box: np.ndarray
    wanted: np.ndarray  # (2, systems): lower and upper end

    def take(self, rows: np.ndarray) -> "Systems":
        """Some of the systems."""
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


def solve(a: Curve, b: Curve, groups: list[Systems], *, atol: float, limit: int, max_boxes: int) -> Events:
    """All boxes that may hold an event, of three groups of systems: pairs, triples, and triples on one segment.

    Args:
        a: the curve of the maximum.
        b: the other one.
        groups: systems as made by `pairs` and `triples`.
        atol: a box is final when its pieces of both curves are at most this large.
        limit: most boxes of one system that are open together; beyond them it has a curve of roots.
        max_boxes: most boxes examined in all.
    """
    found, boxes, exhausted = [], 0, False
    for kernel, systems in zip((pair_kernel, triple_kernel, same_kernel), groups, strict=True):
        for start in range(0, systems.segment.shape[1], SYSTEMS):
            rows = np.arange(start, min(start + SYSTEMS, systems.segment.shape[1]))
            parts, count, full = _solve(kernel, a, b, systems.take(rows), atol, limit, max_boxes - boxes)
            found += parts
            boxes, exhausted = boxes + count, exhausted or full
    every = [(NO_EVENTS.segment, NO_EVENTS.box, NO_EVENTS.isolated), *found]
    segment, box, isolated = (np.concatenate(x, axis=-1) for x in zip(*every, strict=True))
    return Events(segment, box, isolated, exhausted, boxes)


def _solve(
    kernel: _Kernel, a: Curve, b: Curve, systems: Systems, atol: float, limit: int, max_boxes: int
) -> tuple[list[tuple[np.ndarray, ...]], int, bool]:
    """Boxes of some systems, level by level."""
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
            final, children = _children(part, cut, atol)
            keep(rows[final[0]], final[1], True)
            next_job += [rows[index] for index, _ in children]
            next_box += [boxes for _, boxes in children]
        job = np.concatenate(next_job) if next_job else job[:0]
        box = np.concatenate(next_box, axis=2) if next_box else box[:, :, :0]
    return found, examined, False


def _children(
    box: np.ndarray, cut: EventCut, atol: float
) -> tuple[tuple[np.ndarray, np.ndarray], list[tuple[np.ndarray, np.ndarray]]]:
    """Final boxes, and those to examine next: what the cuts left, in halves where they left much; with their rows."""
    rows = np.flatnonzero(cut.alive)
    old, sides, sizes = box[:, :, rows], cut.sides[:, :, rows], cut.sizes[:, rows]
    pad = _PAD * (sides[:, 1] - sides[:, 0]) + LEAST_PAD
    low, high = np.maximum(sides[:, 0] - pad, 0.0), np.minimum(sides[:, 1] + pad, 1.0)
    width = old[:, 1] - old[:, 0]
    # At an end of the box the very number is kept: roots at ends of segments lie on it.
    start = np.where(low > 0, np.maximum(old[:, 0] + low * width - _ULP, old[:, 0]), old[:, 0])
    stop = np.where(high < 1, np.minimum(old[:, 0] + high * width + _ULP, old[:, 1]), old[:, 1])
    new, shares = np.stack([start, stop], axis=1), high - low
    extent = sizes * shares
    done = np.all((extent <= atol) | (stop - start <= _RESOLVED), axis=0)
    largest = np.argmax(np.where(stop - start > _RESOLVED, extent, -1.0), axis=0)
    halve = ~done & (np.max(extent, axis=0) > _KEPT * np.max(sizes, axis=0))
    whole = ~done & ~halve
    column = np.flatnonzero(halve)
    k, left, right = largest[column], new[:, :, column], new[:, :, column].copy()
    index = np.arange(len(column))
    middle = 0.5 * (left[k, 0, index] + left[k, 1, index])
    left[k, 1, index], right[k, 0, index] = middle, middle
    children = [(rows[whole], new[:, :, whole]), (rows[column], left), (rows[column], right)]
    return (rows[done], new[:, :, done]), children
