"""Faces in space, shaded by the light on them: what pictures of surfaces, cells and meshes are made of."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jhd.plot.axes import draw, finish

_LIGHT = np.array([0.35, -0.5, 0.79])  # where the light comes from, above the left shoulder of the usual view
_SHADE = 0.45  # share of a colour that faces turned from the light lose


def shaded_shapes(
    ax: Any, faces: Sequence[np.ndarray], colours: Sequence[str], labels: Sequence[str | None], alpha: float
) -> None:
    """Several shapes (faces, 4, 3), drawn as one, so that those in front hide others, with keys for a legend."""
    rgb = np.repeat([rgb_of(colour) for colour in colours[: len(faces)]], [len(own) for own in faces], axis=0)
    add_faces(ax, np.concatenate(faces), rgb, "surface", alpha)
    for colour, name in zip(colours, labels, strict=False):
        draw(ax, np.full((1, 3), np.nan), "key", color=colour, label=name, marker="s", linestyle="none")


def add_faces(ax: Any, corners: np.ndarray, rgb: np.ndarray, gid: str, alpha: float, **style: Any) -> None:
    """Quadrilaterals in colours that fade where they are turned from the light, whichever side is seen."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.abs(normal @ _LIGHT)[:, None] / np.where(length > 0, length, 1.0) / np.linalg.norm(_LIGHT)
    shaded = rgb * (1 - _SHADE + _SHADE * facing)
    colours = np.concatenate([shaded, np.full((len(rgb), 1), alpha)], axis=1)
    # Between opaque faces the ground would shine through; edges of transparent ones would lie on top of each other.
    seams: dict[str, Any] = {"linewidth": 0.3, "edgecolor": colours} if alpha == 1.0 else {"linewidth": 0.0}
    # Thousands of faces as paths would make files that no viewer opens.
    faces = Poly3DCollection(corners, facecolors=colours, rasterized=True, **(seams | style))
    faces.set_gid(gid)
    ax.add_collection3d(faces, autolim=False)


def frame(ax: Any, corners: list[np.ndarray]) -> None:
    """Limits that hold what was there before, and the corners."""
    ax.auto_scale_xyz(*np.transpose(corners))
    finish(ax)


def rgb_of(colour: str) -> np.ndarray:
    """A colour as three numbers."""
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(colour))
