"""Faces in space, shaded by the light on them: what pictures of surfaces, cells and meshes are made of."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jhd.plot.axes import draw, finish
from jhd.plot.depth import DepthTree, eye_of

_LIGHT = np.array([0.35, -0.5, 0.79])  # where the light comes from, above the left shoulder of the usual view
_SHADE = 0.45  # share of a colour that faces turned from the light lose
# So many triangles, which are large, are drawn in their right order, cut in so many parts at most; others by depth.
_FEW, _PARTS = 400, 4000


def shaded_shapes(
    ax: Any, faces: Sequence[np.ndarray], colours: Sequence[str], labels: Sequence[str | None], alpha: float
) -> None:
    """Several shapes (faces, 4, 3), drawn as one, so that those in front hide others, with keys for a legend."""
    rgb = np.repeat([rgb_of(colour) for colour in colours[: len(faces)]], [len(own) for own in faces], axis=0)
    corners = np.concatenate(faces)
    tree = _tree(corners)
    if tree is None:
        add_faces(ax, corners, rgb, "surface", alpha)
    else:
        _add_in_order(ax, tree, _shaded(corners, rgb, alpha)[tree.owner])
    for colour, name in zip(colours, labels, strict=False):
        draw(ax, np.full((1, 3), np.nan), "key", color=colour, label=name, marker="s", linestyle="none")


def add_faces(ax: Any, corners: np.ndarray, rgb: np.ndarray, gid: str, alpha: float, **style: Any) -> None:
    """Quadrilaterals in colours that fade where they are turned from the light, whichever side is seen."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    colours = _shaded(corners, rgb, alpha)
    # Between opaque faces the ground would shine through; edges of transparent ones would lie on top of each other.
    seams: dict[str, Any] = {"linewidth": 0.3, "edgecolor": colours} if alpha == 1.0 else {"linewidth": 0.0}
    # Thousands of faces as paths would make files that no viewer opens.
    faces = Poly3DCollection(corners, facecolors=colours, rasterized=True, **(seams | style))
    faces.set_gid(gid)
    ax.add_collection3d(faces, autolim=False)


def _shaded(corners: np.ndarray, rgb: np.ndarray, alpha: float) -> np.ndarray:
    """The colours (faces, 4), faded and with the opacity."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.abs(normal @ _LIGHT)[:, None] / np.where(length > 0, length, 1.0) / np.linalg.norm(_LIGHT)
    return np.concatenate([rgb * (1 - _SHADE + _SHADE * facing), np.full((len(rgb), 1), alpha)], axis=1)


def _tree(corners: np.ndarray) -> DepthTree | None:
    """The tree of few triangles, as quadrilaterals (faces, 4, 3) with the last corner twice; None of all else."""
    if len(corners) > _FEW or np.any(corners[:, 2] != corners[:, 3]):
        return None
    try:
        return DepthTree(corners, _PARTS)
    except ValueError:
        return None


def _add_in_order(ax: Any, tree: DepthTree, colours: np.ndarray) -> None:
    """The parts of a tree, sorted whenever they are drawn, from where they are seen then."""
    from matplotlib.collections import PolyCollection
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    opaque = bool(np.all(colours[:, 3] == 1.0))

    class SortedFaces(PolyCollection):
        def do_3d_projection(self) -> float:
            """What space axes call before they draw: gives the depth of what is nearest."""
            axes: Any = self.axes
            order = tree.order(eye_of(np.asarray(axes.M)))
            places: Any = tree.parts[order].reshape(-1, 3).T
            x, y, depth = proj_transform(places[0], places[1], places[2], axes.M)
            self.set_verts(list(np.stack([x, y], axis=-1).reshape(len(order), -1, 2)))
            shown: Any = colours[order]
            self.set_facecolor(shown)
            if opaque:
                self.set_edgecolor(shown)
            return float(np.min(depth))

    flat = list(tree.parts[:, :, :2])
    faces = SortedFaces(flat, facecolors=colours, linewidths=0.3 if opaque else 0.0, rasterized=True)
    faces.set_gid("surface")
    ax.add_collection(faces, autolim=False)


def frame(ax: Any, corners: list[np.ndarray]) -> None:
    """Limits that hold what was there before, and the corners."""
    ax.auto_scale_xyz(*np.transpose(corners))
    finish(ax)


def rgb_of(colour: str) -> np.ndarray:
    """A colour as three numbers."""
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(colour))
