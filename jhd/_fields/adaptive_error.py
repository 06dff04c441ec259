"""A certified bound of the error of an adaptively sampled distance field, from the Lipschitz property alone.

The signed distance s of a closed mesh is 1-Lipschitz, so for all points z and x

    s(z) - |x - z|  <=  s(x)  <=  s(z) + |x - z|.

Let f be trilinear in a box. Then f(x) + |x - z| is convex along each axis, so it is largest at a corner of the box, and
so is |x - z| - f(x). With the corners c this gives, for every z and with no other assumption,

    f - s <= max_c (f(c) + |c - z|) - s(z)      and      s - f <= max_c (|c - z| - f(c)) + s(z)      in the box.

With z far away along the normal, on either side of the surface, both are sharp to second order in the size of the box
if s is smooth there. So z is tried at several distances from the center. Boxes whose bound is too large are split.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from jhd._arithmetic.rounding import gamma, round_up
from jhd._fields.adaptive_samples import Surface, is_inner
from jhd._fields.boxes import CORNERS
from jhd._runtime.arrays import joined, taken
from jhd._triangles.closest_point import closest_points

# Distances of the points z from the middle, in sides of the box.
_REACHES = np.array([0.0, 1.0, -1.0, 4.0, -4.0])
# Boxes in one batch.
_BOXES = 1 << 14
# Weights of the corners of a box at the corners of its parts: (part, corner, corner of the box).
_HALVES = (CORNERS[:, None] + CORNERS[None]) / 2
_PARTS = np.prod(np.where(CORNERS == 1, _HALVES[:, :, None], 1 - _HALVES[:, :, None]), axis=3)


class LeafBoxes(NamedTuple):
    """Cubes in which a field is trilinear."""

    lower: Float[np.ndarray, "boxes 3"]  # lower corners
    width: Float[np.ndarray, " boxes"]  # sides
    values: Float[np.ndarray, "boxes 8"]  # of the field at the corners

    take = taken

    def parts(self) -> "LeafBoxes":
        """The eight parts of each."""
        width = 0.5 * self.width
        lower = self.lower[:, None] + width[:, None, None] * CORNERS
        values = np.einsum("pcb,nb->npc", _PARTS, self.values)
        return LeafBoxes(lower.reshape(-1, 3), np.repeat(width, 8), values.reshape(-1, 8))


def meeting(surface: Surface, boxes: LeafBoxes) -> LeafBoxes:
    """The boxes that may meet the surface: those with a middle within half the diagonal of it."""
    middle = boxes.lower + 0.5 * boxes.width[:, None]
    asked = middle.astype(surface.dtype)
    shift = np.linalg.norm(asked.astype(np.float64) - middle, axis=1)
    lower = closest_points(surface.mesh, asked).lower.astype(np.float64)
    return boxes.take(lower <= np.sqrt(0.75) * boxes.width * (1 + gamma(64, np.float64)) + shift + _slack(boxes))


def largest_error(surface: Surface, boxes: LeafBoxes, rtol: float, most: int) -> float:
    """An upper bound of |field - signed distance| in all boxes, rounded up.

    Args:
        surface: the mesh, whose winding number is constant off it.
        boxes: the boxes, one at least.
        rtol: largest relative excess of a bound over the largest error seen at middles; larger bounds are refined.
        most: number of boxes after which no more are split.
    """
    slack = _slack(boxes)
    bounds, errors = _bounded(surface, boxes)
    seen, done, spent = float(errors.max()), 0.0, len(bounds)
    while True:
        open_ = bounds > (1 + rtol) * seen
        done = max(done, float(np.max(bounds[~open_], initial=0.0)))
        boxes, bounds = boxes.take(open_), bounds[open_]
        # At most this many boxes are split together.
        room = min(most // 64, (most - spent) // 8)
        if not len(bounds) or room < 1 or boxes.width.min() < slack:
            return float(round_up(np.float64(max(done, float(np.max(bounds, initial=0.0))) + slack)))
        # The worst first: then the bounds left when the room ends are as small as possible.
        order = np.argsort(-bounds, kind="stable")
        worst, rest = order[:room], order[room:]
        parts = boxes.take(worst).parts()
        new, errors = _bounded(surface, parts)
        seen, spent = max(seen, float(errors.max())), spent + len(new)
        # A bound of the whole holds for its parts.
        bounds = np.concatenate([bounds[rest], np.minimum(new, np.repeat(bounds[worst], 8))])
        boxes = joined([boxes.take(rest), parts])


def _slack(boxes: LeafBoxes) -> float:
    """Bound of the rounding of positions, values and bounds."""
    size = np.max(np.abs(boxes.lower)) + 8 * np.max(boxes.width) + np.max(np.abs(boxes.values))
    # Values and positions of parts have some roundings for each halving down to the last place.
    return float(gamma(1024, np.float64) * size)


def _bounded(surface: Surface, boxes: LeafBoxes) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the error in each box, and errors at the middles."""
    parts = [
        _of_batch(surface, boxes.take(slice(start, start + _BOXES))) for start in range(0, len(boxes.width), _BOXES)
    ]
    return np.concatenate([x for x, _ in parts]), np.concatenate([x for _, x in parts])


def _of_batch(surface: Surface, boxes: LeafBoxes) -> tuple[np.ndarray, np.ndarray]:
    """`_bounded` for one batch: the least bound over several points z along the normal, and errors at the middles."""
    middle = (boxes.lower + 0.5 * boxes.width[:, None]).astype(surface.dtype)
    found = closest_points(surface.mesh, middle)
    normal = np.asarray(surface.mesh.normals, np.float64)[found.triangle]
    step = middle - found.foot.astype(np.float64)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    away = length > 1e-3 * boxes.width[:, None]
    normal = np.where(away, step / np.where(away, length, 1.0), normal)
    reach = boxes.width[:, None] * _REACHES
    z = (middle[:, None] + reach[..., None] * normal[:, None]).astype(surface.dtype)
    low, high = (
        x.reshape(reach.shape) for x in _signed(surface, z.reshape(-1, 3), np.repeat(boxes.width, len(_REACHES)))
    )
    corners = boxes.lower[:, None] + boxes.width[:, None, None] * CORNERS
    apart = np.linalg.norm(corners[:, None] - z[:, :, None].astype(np.float64), axis=3)
    above = np.min(np.max(boxes.values[:, None] + apart, axis=2) - low, axis=1)
    below = np.min(np.max(apart - boxes.values[:, None], axis=2) + high, axis=1)
    error = np.mean(boxes.values, axis=1) - 0.5 * (low[:, 0] + high[:, 0])
    return np.maximum(above, below), np.abs(error)


def _signed(surface: Surface, points: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the signed distances of points."""
    found = closest_points(surface.mesh, points)
    inside = is_inner(surface, points, found, reach)
    lower, upper = found.lower.astype(np.float64), found.upper.astype(np.float64)
    # On the mesh to within rounding the side is not known.
    least = np.where(lower > 0, lower, -upper)
    return np.where(inside, -upper, least), np.where(inside, -lower, upper)
