"""Proven bounds of the distance over flat cells: everywhere, of its mean, and of the mean of its square.

A cell is a segment, triangle or parallelogram with corners v_i and middle c, with its points spread evenly. With W the
mean of |x - c|^2 over the cell, the mean of |x - p|^2 is |c - p|^2 + W for any point p.

**Below.** The distance to b changes by at most |x - p|, so d(x) >= d(p) - |x - p| for every point p, near or far. For p
on the far side of the cell from b, along the line from the foot of c, only W / (2 |c - p|) is lost. Such balls about
far points contain no point of b, and are flat.

If b is a mesh or a point set, the triangles or points that may be nearest to the cell are known. For any w with
|w| <= 1 the distance to a convex piece is at least w.x - max w.f over its corners f. With w from the foot on the piece
to c, nothing is lost at c. With w from the nearest foot to c, nothing is lost over adjacent faces in one plane. With w
across the piece, on the side of c, nothing is lost over the piece if b is hollow there. The smallest of these bounds
over the pieces is concave. So over the cell it is at least the affine function l with its values at the corners, and
its mean is at least the mean of l.

**Above.** Flat pieces F, each of whose points has a point of b within sag (jhd._distance.nearest.target), give the
convex function f(x) = d(x, F) + sag. Over the cell it is at most the affine function u with its values at the corners:
at most the largest of them, and its mean is at most their mean, because on average the points weight all corners
equally. The points of a polynomial part are such means of its control points, so the control points replace the
corners, here and in the bounds from below by pieces. If F is the foot q of c, the mean of the squares is |c - q|^2 + W
itself.

**Between.** Over points, segments and triangles that are spread evenly, l <= d <= u bounds the mean of the square, and
the fractions in which d is at most some level (jhd._distance.cells.weighted). Over a face, between the walls of the
prism over it and on one side of its plane, d is the distance to the plane, and both l and u are d itself, up to
rounding. So cells are best cut by the walls and the planes. The planes hold the faces that are nearest to the middle of
a cell. No proof depends on them: any cut is valid.

Rounding: sizes are at most `size`, and gamma(64) `size` exceeds the roundings of a sum of a few lengths. A mean over
control points takes one rounding more for each.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jhd._arithmetic.rounding import gamma
from jhd._distance.cells.arc_length_area import FlatCells
from jhd._distance.cells.flat_pieces import vectors_from
from jhd._distance.cells.normal_offset_bounds import HeightBounds, unknown_bounds
from jhd._distance.cells.weighted import greatest_square, least_square
from jhd._distance.nearest.target import AbstractTarget, ConvexPieces, Flats, ProvenFeet
from jhd._runtime.arrays import taken

# The mean of |x - c|^2 divided by the sum over the corners, by the number of corners.
_SPREAD = {1: 0.0, 2: 1 / 6, 3: 1 / 12, 4: 1 / 12}
# The first distance at which far points are tried; no round number, since nearest points of centers of circles and
# spheres are hard to prove. If one serves and more can be gained, the distance grows by this factor, up to the limit:
# coordinates are at most one.
NEAR, _FARTHER, _FARTHEST = 0.0437, 4.0, 4.0
# More can be gained if the loss exceeds this fraction of the gap that may remain.
_GAIN = 0.1
# The gap that bounds of far points may leave, as a fraction of the loss.
_SMALL_PART = 0.25
_ROUNDINGS = gamma(64, np.float64)
# Faces as near as this to the nearest one, relative to its distance, have a common edge or corner that is nearest.
_TIED = 1e-9
# A plane is worth a cut if it explains this fraction of the gap of a cell, and if it cuts off more than this fraction
# of the length of its longest edge; cells as short as that are cut in their middles.
_WORTH, _THINNEST, _SHORT = 0.125, 2.0**-20, 2.0**-24


class OverCells(NamedTuple):
    """Bounds over cells, and data for the bounds of their parts."""

    lower: Float[np.ndarray, " cells"]  # lower bound of the distance, everywhere
    upper: Float[np.ndarray, " cells"]  # upper bound of the distance, everywhere
    mean: Float[np.ndarray, "cells 2"]  # bounds (cells, 2) of its mean
    square: Float[np.ndarray, "cells 2"]  # bounds (cells, 2) of the mean of its square
    reach: Float[np.ndarray, " cells"]  # distance of the far point that served; negative if farther ones do not help
    # Values at the corners of two affine functions of the parameters, between which the distance lies.
    ends: Float[np.ndarray, "cells corners 2"]
    # Values at the corners of an affine function; the cell is best cut along its zeros. All are zero if there is no
    # such cut.
    parting: Float[np.ndarray, "cells corners"]

    take = taken


class _Above(NamedTuple):
    """Upper bounds over cells: everywhere, of the mean, of the mean of squares; and a convex function at controls."""

    most: np.ndarray
    mean: np.ndarray
    square: np.ndarray
    ends: np.ndarray


def distances_over(
    cells: FlatCells,
    target: AbstractTarget,
    dtype: np.dtype,
    reach: np.ndarray,
    goal: float,
    heights: Callable[[FlatCells, ProvenFeet, np.ndarray], HeightBounds] | None = None,
) -> OverCells:
    """Bounds of the distance to a target over cells.

    Args:
        cells: the cells.
        target: the other shape, in the coordinates of the cells.
        dtype: the type of the points that the target takes.
        reach: how far away far points are tried, for each cell; negative if farther ones did not help.
        goal: a gap that may remain.
        heights: computes bounds by heights from the cells, feet near their middles, and upper bounds; None without.
    """
    # Bounds below are for the exact number that each point is.
    middle = np.mean(cells.corners, axis=1).astype(dtype)
    # Copies: the arrays returned by a compiled function are read-only.
    found = ProvenFeet(*(np.array(x) for x in target.near(middle)))
    size = np.max(np.abs(cells.corners), axis=(1, 2)) + _FARTHEST
    room = 4 * (_over_controls(cells) + np.finfo(dtype).eps) * size
    above = _above(cells, target, middle, found, room)
    known = unknown_bounds(len(middle)) if heights is None else heights(cells, found, above.most)
    least, least_mean, after = np.zeros(len(middle)), np.zeros(len(middle)), reach.copy()
    below, pieces = np.full(cells.controls.shape[:2], -np.inf), None
    # If this leaves a larger gap than far points would, it is no valley, for example around the end of a curve that is
    # continued.
    left = np.fmin(known.most_mean, above.mean) - known.least_mean
    spread = _share(cells.corners) * _scatter(cells.corners)
    expected = np.minimum(spread / (2 * np.abs(reach)), np.sqrt(spread)) + _GAIN * goal
    rows = beside = np.flatnonzero((known.least_mean <= 0) | (left > expected))
    if len(rows):
        pieces = _pieces_near(cells.controls[rows], target, middle[rows], found.take(rows))
    if pieces is not None:
        off = (cells.off + room)[rows, None]
        below[rows] = _beside_pieces(cells.controls[rows], middle[rows], found.take(rows), pieces) - off
        least, least_mean = (np.maximum(f(below, axis=1), 0.0) for f in (np.min, np.mean))
        # If these leave as small a gap, far points do not help.
        rows = rows[(above.mean - least_mean)[rows] > expected[rows]]
    if len(rows):
        some, near = cells.take(rows), found.take(rows)
        lower = _lower(some, target, middle[rows], near, (reach[rows], goal))
        for held, better in zip((least, least_mean), lower[:2], strict=True):
            held[rows] = np.maximum(held[rows], better - some.slack - room[rows])
        after[rows] = lower[2]
        mended = np.flatnonzero(near.upper < found.upper[rows])
        if len(mended):
            again = _above(some.take(mended), target, middle[rows[mended]], near.take(mended), room[rows[mended]])
            for held, new in zip(above[:3], again[:3], strict=True):
                held[rows[mended]] = np.fmin(held[rows[mended]], new)
    least_squares = least_mean**2 * (1 - _ROUNDINGS)
    if _are_simplices(cells):
        least_squares = np.fmax(least_squares, least_square(np.where(np.isfinite(below), below, 0.0)))
    ends = zip((least, least_mean, least_squares), above[:3], strict=True)
    bounds = HeightBounds(*(x for pair in ends for x in pair)).narrowed(known)
    over = _weighed(cells.uneven, bounds)
    parting = np.zeros(cells.corners.shape[:2])
    if pieces is not None and target.triangles and _are_simplices(cells):
        left = (bounds.most_mean - bounds.least_mean)[beside]
        parting[beside] = partings(cells.corners[beside], middle[beside], found.take(beside), pieces, left)
    return OverCells(*over, after, _ends(cells, over[:2], (below, above.ends)), parting)


def _over_controls(cells: FlatCells) -> float:
    """Bound the rounding of a mean over control points, and of a sum of a few lengths."""
    return gamma(48 + cells.controls.shape[1], np.float64)


def _are_simplices(cells: FlatCells) -> bool:
    """Return whether the controls are the corners of points, segments or triangles."""
    return cells.corners.shape[1] <= 3 and cells.controls.shape == cells.corners.shape


def _ends(cells: FlatCells, whole: tuple[np.ndarray, np.ndarray], affine: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return values at the corners of affine functions that bound the distance; constants if no others are known."""
    constant = [np.repeat(x[:, None], cells.corners.shape[1], axis=1) for x in whole]
    if not _are_simplices(cells):
        return np.stack(constant, axis=2)
    known = [(cells.uneven == 0)[:, None] & np.all(np.isfinite(x), axis=1, keepdims=True) for x in affine]
    return np.stack([np.where(*x) for x in zip(known, affine, constant, strict=True)], axis=2)


def _lower(
    cells: FlatCells,
    target: AbstractTarget,
    middle: np.ndarray,
    found: ProvenFeet,
    reached: tuple[np.ndarray, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower bounds over flat cells and of the means, and distances of the points that gave them; improves the feet."""
    corners, (reach, goal) = cells.corners, reached
    least, least_mean, after = _below(corners, target, middle, found, reached)
    doubtful = np.flatnonzero((after < 0) & (np.abs(after) < np.abs(reach)))
    if len(doubtful) and not target.sharp:
        # A near foot may be much farther away than the nearest one.
        _put(found, doubtful, target.nearest(middle[doubtful]))
        mended = taken(found, doubtful)
        again = _below(corners[doubtful], target, middle[doubtful], mended, (reach[doubtful], goal))
        least[doubtful], least_mean[doubtful] = (
            np.maximum(x[doubtful], y) for x, y in zip((least, least_mean), again[:2], strict=True)
        )
        after[doubtful] = again[2]
    return least, least_mean, after


def _weighed(uneven: np.ndarray, even: HeightBounds) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Bounds for points that are spread unevenly, which may be off by half the unevenness times the range."""
    lower, upper = even.least, even.most
    with np.errstate(invalid="ignore"):
        off = np.where(uneven > 0, 0.5 * uneven * (upper - lower), 0.0) * (1 + _ROUNDINGS)
        off_square = np.where(uneven > 0, 0.5 * uneven * (upper**2 - lower**2), 0.0) * (1 + _ROUNDINGS)
        low, high = np.fmax(even.least_mean - off, lower), np.fmin(even.most_mean + off, upper)
        square_low = np.fmax(even.least_square - off_square, lower**2 * (1 - _ROUNDINGS))
        square_high = np.fmin(even.most_square + off_square, upper**2 * (1 + _ROUNDINGS))
    # A mean is at most the root of the mean of squares.
    high = np.fmin(high, np.sqrt(square_high) * (1 + _ROUNDINGS))
    square_low = np.fmax(square_low, low**2 * (1 - _ROUNDINGS))
    return lower, upper, np.stack([low, high], axis=1), np.stack([square_low, square_high], axis=1)


def _below(
    corners: np.ndarray,
    target: AbstractTarget,
    middle: np.ndarray,
    found: ProvenFeet,
    reached: tuple[np.ndarray, float],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower bounds over the cells and of the means, and the distance of the point that gave the latter."""
    away = middle.astype(np.float64) - np.where(np.isfinite(found.foot), found.foot, middle)
    length = np.sqrt(np.sum(away**2, axis=1))
    normal = np.where((length > 0)[:, None], away / np.where(length > 0, length, 1.0)[:, None], _across(corners))
    before, goal = reached
    reach, spread = np.abs(before), _share(corners) * _scatter(corners)
    lost = spread / (2 * reach)
    least, mean = _seen_from(corners, target, middle, reach[:, None] * normal, _close(lost, goal))
    served = found.upper - mean <= 2 * lost + _GAIN * goal
    more = np.flatnonzero(served & (before > 0) & (lost > _GAIN * goal) & (_FARTHER * reach <= _FARTHEST))
    after = np.where(served, before, -reach / _FARTHER)
    if len(more):
        offset = _FARTHER * reach[more, None] * normal[more]
        there = _seen_from(corners[more], target, middle[more], offset, _close(lost[more] / _FARTHER, goal))
        after[more] = np.where(there[1] > mean[more], _FARTHER * reach[more], -reach[more])
        least[more], mean[more] = np.maximum(least[more], there[0]), np.maximum(mean[more], there[1])
    return least, mean, after


def _pieces_near(
    controls: np.ndarray, target: AbstractTarget, middle: np.ndarray, found: ProvenFeet
) -> ConvexPieces | None:
    """Return all convex pieces that may be nearest to a point of a cell; None if there are too many."""
    spread = np.max(np.sqrt(np.sum((controls - middle[:, None]) ** 2, axis=2)), axis=1)
    # A piece farther than this from the middle is not nearest to any point of the cell.
    return target.pieces_within(middle, (found.upper + 2 * spread) * (1 + _ROUNDINGS))


def _beside_pieces(controls: np.ndarray, middle: np.ndarray, found: ProvenFeet, pieces: ConvexPieces) -> np.ndarray:
    """Values (cells, controls) of a concave lower bound of the distance; minus infinity without pieces."""
    least = np.full(controls.shape[:2], np.inf)
    held, over = pieces.corners.astype(np.float64), controls[pieces.who]
    places = middle[pieces.who].astype(np.float64)
    aside = np.sum((places - held[:, 0]) * _across(held), axis=1, keepdims=True)
    common = _towards(middle, found.foot)[pieces.who]
    ways = [_towards(places, pieces.foot), common, np.sign(aside) * _across(held) * (1 - _ROUNDINGS)]
    bounds = np.stack(
        [
            np.sum(w[:, None] * over, axis=2) - np.max(np.sum(w[:, None] * held, axis=2), axis=1, keepdims=True)
            for w in ways
        ]
    )
    # One for all controls, lest the smallest be no longer concave: that which stays above the nearest piece.
    nearest = np.sum(common[:, None] * (over - found.foot[pieces.who, None]), axis=2)
    best = np.argmax(np.min(bounds - nearest, axis=2), axis=0)
    np.minimum.at(least, pieces.who, bounds[best, np.arange(len(best))])
    return np.where(np.isfinite(least), least, -np.inf)


def _towards(points: np.ndarray, feet: np.ndarray) -> np.ndarray:
    """Vectors from feet to points, divided by their lengths, at most one long; zero if both are equal."""
    away = points.astype(np.float64) - np.where(np.isfinite(feet), feet, points)
    length = np.sqrt(np.sum(away**2, axis=1, keepdims=True)) * (1 + _ROUNDINGS)
    return np.where(length > 0, away / np.where(length > 0, length, 1.0), 0.0)


def _put(found: ProvenFeet, rows: np.ndarray, others: ProvenFeet) -> None:
    for held, new in zip(found, others, strict=True):
        held[rows] = new


def _close(lost: np.ndarray, goal: float) -> float:
    """Tolerance for distances of far points: they are costly near the center of a round shape, so only a small part."""
    return _SMALL_PART * max(float(np.median(lost)), goal)


def _seen_from(
    corners: np.ndarray, target: AbstractTarget, middle: np.ndarray, offset: np.ndarray, close: float
) -> tuple[np.ndarray, np.ndarray]:
    """Lower bounds over cells and of the means, from points away from their middles."""
    places = (middle + offset).astype(middle.dtype)
    distance = target.nearest(places, close=close).lower.astype(np.float64)
    apart = np.sqrt(np.sum((corners - places[:, None].astype(np.float64)) ** 2, axis=-1))
    square = np.mean(apart**2, axis=1) - (1 - _share(corners)) * _scatter(corners)
    return distance - np.max(apart, axis=1), distance - np.sqrt(np.maximum(square, 0.0))


def _scatter(corners: np.ndarray) -> np.ndarray:
    """Mean of |v_i - c|^2 over the corners."""
    return np.mean(np.sum((corners - np.mean(corners, axis=1, keepdims=True)) ** 2, axis=2), axis=1)


def _share(corners: np.ndarray) -> float:
    """Ratio of W to the mean over the corners."""
    return _SPREAD[corners.shape[1]] * corners.shape[1]


def _across(corners: np.ndarray) -> np.ndarray:
    """Return a unit vector normal to each flat cell; some unit vector if the cell has no area."""
    if corners.shape[1] < 3:
        return np.broadcast_to(np.array([0.0, 0.0, 1.0]), (len(corners), 3))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.sqrt(np.sum(normal**2, axis=1, keepdims=True))
    return np.where(length > 0, normal / np.where(length > 0, length, 1.0), np.array([0.0, 0.0, 1.0]))


def _above(cells: FlatCells, target: AbstractTarget, middle: np.ndarray, found: ProvenFeet, room: np.ndarray) -> _Above:
    """Upper bounds over the cells, of the means, and of the means of squares, with room for roundings."""
    rows = target.rows_of(found).take(np.s_[:, None])
    flats = Flats(*(np.asarray(x, np.float64) for x in target.flats(rows, cells.corners.astype(middle.dtype))))
    # Upper bounds of f at the controls (cells, flats, controls).
    far = _length(vectors_from(flats, cells.controls, target.triangles))
    far = far + np.where(np.isnan(flats.sag), np.inf, flats.sag)[..., None]
    off, slack, corners = cells.off + room, cells.slack + room, cells.corners
    to_middle = found.upper.astype(np.float64)
    spread = np.max(np.sqrt(np.sum((corners - middle[:, None]) ** 2, axis=2)), axis=1)
    root = np.sqrt(to_middle**2 + _share(corners) * _scatter(corners)) * (1 + _ROUNDINGS) + slack
    most = np.fmin(np.min(np.max(far, axis=2), axis=1) + off, to_middle + spread + slack)
    mean = np.fmin(np.min(np.mean(far, axis=2), axis=1) + off, root)
    best = np.argmin(np.mean(far, axis=2), axis=1)
    ends = far[np.arange(len(far)), best] + off[:, None]
    square = greatest_square(ends) if _are_simplices(cells) else np.mean(ends**2, axis=1) * (1 + _over_controls(cells))
    return _Above(most, mean, np.fmin(square, root**2), ends)


def partings(
    corners: Float[np.ndarray, "cells corners 3"],
    middle: Float[np.ndarray, "cells 3"],
    found: ProvenFeet,
    pieces: ConvexPieces,
    left: Float[np.ndarray, " cells"],
) -> Float[np.ndarray, "cells corners"]:
    """Heights of the cells' corners above the plane that cuts each cell best; zeros if there is none."""
    parting = np.zeros(corners.shape[:2])
    away = _length(middle[pieces.who] - pieces.foot)
    near = found.upper[pieces.who] * (1 + _TIED) + _TIED * _SHORT
    tied = (away <= near) & (left[pieces.who] > 0)
    who, faces = pieces.who[tied], pieces.corners[tied].astype(np.float64)
    edges = np.roll(faces, -1, axis=1) - faces
    normal = _unit(np.cross(edges[:, 0], edges[:, 1]))
    inward = _unit(np.cross(normal[:, None], edges))
    apart = corners[who][:, None] - faces[:, :, None]  # (pairs, corners of the face, corners of the cell, 3)
    walls = np.sum(apart * inward[:, :, None], axis=3)
    height = np.sum(apart[:, 0] * normal[:, None], axis=2)
    # By how much the distance to the face is more than that to its plane, and the mean of heights less than their own.
    beyond = np.sqrt(height[:, None] ** 2 + np.minimum(walls, 0.0) ** 2) - np.abs(height)[:, None]
    crossed = np.mean(np.abs(height), axis=1) - np.abs(np.mean(height, axis=1))
    gain = np.concatenate([np.mean(beyond, axis=2), crossed[:, None]], axis=1)
    planes = np.concatenate([walls, height[:, None]], axis=1)
    size = np.max(_length(np.roll(corners, -1, axis=1) - corners), axis=1)[who]
    off = np.minimum(np.max(planes, axis=2), -np.min(planes, axis=2))
    apt = (off > _THINNEST * size[:, None]) & (size > _SHORT)[:, None] & (gain > _WORTH * left[who, None])
    gain = np.where(apt, gain, 0.0)
    best = np.argmax(gain, axis=1)
    most = np.max(gain, axis=1)
    order = np.argsort(most, kind="stable")
    order = order[most[order] > 0]
    # Of several for one cell the last is kept.
    parting[who[order]] = planes[order, best[order]]
    return parting


def _length(vectors: np.ndarray) -> np.ndarray:
    return np.sqrt(np.sum(vectors**2, axis=-1))


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = _length(vectors)[..., None]
    return vectors / np.where(length > 0, length, 1.0)
