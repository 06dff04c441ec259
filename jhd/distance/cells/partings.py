"""Planes along which cells beside a triangle mesh are best cut: where the distance stops to be that of one face.

Over a face, between the walls of the prism over it, the distance is that to its plane, and so the absolute value of an
affine function; so it is known up to rounding over cells that neither a wall nor the plane itself cuts. The planes are
those of the faces that are nearest to the middle of a cell. Nothing hangs on them: any cut is a true one.
"""

import numpy as np
from jaxtyping import Float

from jhd.distance.nearest.target import ConvexPieces, ProvenFeet

# Faces as near as this to the nearest one, relative to its distance, share an edge or a corner that is the nearest.
_TIED = 1e-9
# A plane is worth a cut where it explains this share of what a cell leaves open, and if it takes off more than this
# share of the length of its longest edge; cells as short as that are cut in their middles.
_WORTH, _THINNEST, _SHORT = 0.125, 2.0**-20, 2.0**-24


def partings(
    corners: Float[np.ndarray, "cells corners 3"],
    middle: Float[np.ndarray, "cells 3"],
    found: ProvenFeet,
    pieces: ConvexPieces,
    left: Float[np.ndarray, " cells"],
) -> Float[np.ndarray, "cells corners"]:
    """The heights of the corners of cells above the plane by which each is best cut; zeros where there is none.

    Args:
        corners: of the cells.
        middle: of each.
        found: the nearest points of the middles.
        pieces: triangles near the middles.
        left: what the bounds of the means leave open.
    """
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
