"""A pair of plane curves for the solver of events, in NumPy, together with its form for certified distances."""

from typing import NamedTuple

import numpy as np

from jhd._distance.published.events.forms import CORNER_ANGLE, Curve
from jhd._runtime.arrays import is_traced
from jhd._shapes.curve import BezierSegments
from jhd._shapes.unchecked import trusted

# Tangents shorter than this fraction of their segment have no direction.
_STILL = 1e-9


def check_served(method: str, a: BezierSegments, b: BezierSegments) -> None:
    """Raise TypeError, naming the methods that serve, for curves that the systems do not support."""
    others = "BranchAndBound() and TwoStep() serve it."
    if is_traced(a, b):
        raise TypeError(f"{method} needs concrete control points, not traced ones; under jit {others}")
    if a.dim != 2:
        raise TypeError(f"{method} needs curves in the plane; these have {a.dim} coordinates a point. {others}")
    for curve in (a, b):
        if curve.weights is not None and np.ptp(np.asarray(curve.weights), axis=-1).any():
            raise TypeError(f"{method} needs polynomial segments; these are rational. {others}")


class HostSide(NamedTuple):
    """One curve for the solver and for the proof of distances."""

    curve: Curve  # the curve for the solver
    index: np.ndarray  # for each of its segments and isolated points the stored segment, -1 for free ends and corners
    isolated: np.ndarray  # indices of its segments that are isolated points
    stored: BezierSegments  # the curve in common coordinates, polynomial
    skip: np.ndarray  # which stored segments repeat the one before

    @property
    def moving(self) -> np.ndarray:
        """For each stored segment its index among the solver's segments that are no points, else -1."""
        number = np.full(self.stored.count, -1)
        number[self.index[: self.curve.moving]] = np.arange(self.curve.moving)
        return number

    @classmethod
    def of(cls, curve: BezierSegments) -> "HostSide":
        """Build from the common coordinates; repeated segments are left out."""
        points = np.asarray(curve.control_points)
        stored = trusted(points, None, np.asarray(curve.next_segment))
        skip = np.concatenate([[False], np.all(points[1:] == points[:-1], axis=(1, 2))])
        made, index = _curve(stored, ~skip)
        return cls(made, index, np.flatnonzero(index >= 0)[made.moving :], stored, skip)


class HostPair(NamedTuple):
    """Both curves for the solver and for the proof of distances."""

    first: HostSide
    second: HostSide

    @classmethod
    def of(cls, a: BezierSegments, b: BezierSegments) -> "HostPair":
        """Build from the common coordinates."""
        return cls(HostSide.of(a), HostSide.of(b))

    def reversed(self) -> "HostPair":
        """Return the pair for the opposite direction."""
        return HostPair(self.second, self.first)

    @property
    def a(self) -> Curve:
        """The curve of the maximum, for the solver."""
        return self.first.curve

    @property
    def b(self) -> Curve:
        """The target curve, for the solver."""
        return self.second.curve

    @property
    def stored(self) -> tuple[BezierSegments, BezierSegments]:
        """Both curves in common coordinates."""
        return self.first.stored, self.second.stored


def _curve(curve: BezierSegments, kept: np.ndarray) -> tuple[Curve, np.ndarray]:
    """Return segments that are no points, then free ends, corners and points as segments of one point; and an index.

    The index gives the stored segment of each segment and isolated point, -1 for free ends and corners.
    """
    points, next_segment = np.asarray(curve.control_points, np.float64), np.asarray(curve.next_segment)
    representative = np.flatnonzero(kept)[np.cumsum(kept) - 1]
    next_segment = np.where(next_segment < 0, -1, representative[next_segment])
    single = np.all(points == points[:, :1], axis=(1, 2))
    moving = np.flatnonzero(kept & ~single)
    number = np.full(len(points), -1)
    number[moving] = np.arange(len(moving))
    rows = points[moving].copy()
    onward = np.where(next_segment[moving] < 0, -1, number[next_segment[moving]])
    from_, to = np.flatnonzero(onward >= 0), onward[onward >= 0]
    # Joined ends may differ by a few units of roundoff, which would make two feet of one.
    rows[to, 0] = rows[from_, -1]
    smooth = _smooth(rows[from_], rows[to])
    onward[from_[~smooth]] = -1
    started = np.isin(np.arange(len(moving)), to)
    none = lambda x: np.full(len(x), -1)  # noqa: E731
    starts, stops, corners = np.flatnonzero(~started), np.setdiff1d(np.arange(len(moving)), from_), ~smooth
    isolated = points[kept & single][:, 0]
    ends = np.concatenate([rows[starts, 0], rows[stops, -1], rows[from_[corners], -1], isolated])
    start_of = np.concatenate([starts, none(stops), to[corners], none(isolated)])
    end_of = np.concatenate([none(starts), stops, from_[corners], none(isolated)])
    every = np.concatenate([rows, np.repeat(ends[:, None], points.shape[1], axis=1)])
    velocity = (points.shape[1] - 1) * np.diff(every, axis=1)
    return (
        Curve(
            points=np.ascontiguousarray(np.moveaxis(every, 0, -1)),
            velocity=np.ascontiguousarray(np.moveaxis(velocity, 0, -1)),
            speed=np.abs(velocity).max(axis=(1, 2)),
            moving=len(moving),
            next_segment=np.concatenate([onward, none(ends)]),
            start_of=np.concatenate([none(moving), start_of]),
            end_of=np.concatenate([none(moving), end_of]),
        ),
        np.concatenate([moving, none(ends[: len(ends) - len(isolated)]), np.flatnonzero(kept & single)]),
    )


def _smooth(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return whether the tangents at the joints of two rows of segments agree, and are not too short to tell."""
    if before.shape[1] < 2:
        return np.zeros(len(before), bool)
    x, y = before[:, -1] - before[:, -2], after[:, 1] - after[:, 0]
    sizes = [np.hypot(*v.T) for v in (x, y)]
    extents = [np.ptp(rows, axis=1).max(axis=1) for rows in (before, after)]
    moves = (sizes[0] > _STILL * extents[0]) & (sizes[1] > _STILL * extents[1])
    cross, along = x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0], np.sum(x * y, axis=1)
    return moves & (np.abs(cross) <= CORNER_ANGLE * sizes[0] * sizes[1]) & (along > 0)
