"""Which borders of patches are one: those with the same control points and weights, in whichever direction they run."""

from typing import NamedTuple

import numpy as np

from jhd.arithmetic.scaling import unit_weights
from jhd.shapes.mesh import places_of


class PatchBorders(NamedTuple):
    """Borders of patches; side k of a patch is u = 0, u = 1, v = 0, v = 1.

    Args:
        number: the number of each side (patches, 4), one for all sides that are the same curve.
        turned: whether the side runs against the direction in which its curve is taken.
        patch: the patch that stands for each curve.
        side: its side there.
        collapsed: whether the curve is one point.
    """

    number: np.ndarray
    turned: np.ndarray
    patch: np.ndarray
    side: np.ndarray
    collapsed: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, weights: np.ndarray | None) -> "PatchBorders":
        """The borders of patches with control points (patches, rows, columns, 3)."""
        heavy = np.ones(points.shape[:-1]) if weights is None else weights.astype(np.float64)
        # Zeros of either sign are one number.
        net = np.concatenate([points.astype(np.float64) + 0.0, heavy[..., None]], axis=-1)
        longest = max(net.shape[1:3])
        sides = [net[:, 0], net[:, -1], net[:, :, 0], net[:, :, -1]]
        forward = np.stack([_padded(x, longest) for x in sides], axis=1)
        backward = np.stack([_padded(x[:, ::-1], longest) for x in sides], axis=1)
        apart = backward - forward
        first = np.argmax(apart != 0, axis=-1)
        turned = np.take_along_axis(apart, first[..., None], axis=-1)[..., 0] < 0
        rows = np.where(turned[..., None], backward, forward)
        _, index, number = np.unique(rows.reshape(4 * len(net), -1), axis=0, return_index=True, return_inverse=True)
        collapsed = [np.all(x[..., :3] == x[:, :1, :3], axis=(1, 2)) for x in sides]
        return cls(number.reshape(-1, 4), turned, index // 4, index % 4, np.stack(collapsed, axis=1).ravel()[index])

    def needed(self, points: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
        """Which patches are more than a curve or a point of the border of another one.

        Spans of no length give such patches at knots that are repeated.
        """
        heavy = np.ones(points.shape[:-1]) if weights is None else weights
        net = np.concatenate([points, heavy[..., None]], axis=-1)
        narrow = np.stack([np.all(net == net[:, :1], axis=(1, 2, 3)), np.all(net == net[:, :, :1], axis=(1, 2, 3))])
        proper = ~np.any(narrow, axis=0)
        curve = np.where(narrow[0], self.number[:, 0], self.number[:, 2])
        ends = points[:, [0, 0, -1, -1], [0, -1, 0, -1]]
        place = places_of(ends.reshape(-1, 3)).reshape(-1, 4)
        inside = np.where(
            np.all(narrow, axis=0), np.isin(place[:, 0], place[proper]), np.isin(curve, self.number[proper])
        )
        return proper | ~inside

    def along(self, patch: np.ndarray, side: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Parameters of a side as those of its curve, and the other way round; parameters are dyadic, so exact."""
        return np.where(self.turned[patch, side], 1 - t, t)

    def standing(self, patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Patch, u and v on the patch that stands for the curve, for points on a border; others stay.

        On a curve that is one point this is the end of it.
        """
        side = np.select([u == 0, u == 1, v == 0, v == 1], [0, 1, 2, 3], default=-1)
        inside, at = side < 0, np.maximum(side, 0)
        curve = self.number[patch, at]
        own, other = self.patch[curve], self.side[curve]
        t = self.along(own, other, self.along(patch, at, np.where(at < 2, v, u)))
        t = np.where(self.collapsed[curve], 0.0, t)
        end = (other % 2).astype(np.float64)
        u, v = np.where(inside, u, np.where(other < 2, end, t)), np.where(inside, v, np.where(other < 2, t, end))
        return np.where(inside, patch, own), u, v


def _padded(rows: np.ndarray, length: int) -> np.ndarray:
    """Control points and weights (patches, points, 4) as one row for each patch; no weight is zero."""
    rows = np.concatenate([rows[..., :3], unit_weights(rows[..., 3:], 1)], axis=-1)
    return np.pad(rows, ((0, 0), (0, length - rows.shape[1]), (0, 0))).reshape(len(rows), -1)
