"""Faces in space, shaded by the light on them: the basis of pictures of surfaces, cells and meshes.

A few large faces are drawn from back to front. Sorted by mean depth, they would hide faces that lie in front of them.
In a tree of planes, every face lies on one side of the planes above it, and is cut if it would not. A face on the far
side of a plane never hides a face on the side of the eye.

Source: Fuchs, Kedem & Naylor, On visible surface generation by a priori tree structures, SIGGRAPH 1980.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from jhd._plot.axes import draw, finish

_LIGHT = np.array([0.35, -0.5, 0.79])  # direction to the light, above the left shoulder of the usual view
_SHADE = 0.45  # fraction of a color that faces turned from the light lose
# Up to _FEW triangles, which are large, are drawn in exact order, cut into at most _PARTS parts; more by depth.
_FEW, _PARTS = 400, 4000


class _Node(NamedTuple):
    """A plane, the faces in it, and the nodes on the side of the normal and on the opposite side; -1 for none."""

    plane: np.ndarray
    faces: np.ndarray
    sides: list[int]


class DepthTree:
    """Convex flat faces, some cut in parts, and the order in which they are drawn for any eye.

    Args:
        corners: corners of the faces, (faces, corners, 3); a corner may be repeated.
        most: largest number of parts.

    Raises:
        ValueError: there would be more parts.
    """

    def __init__(self, corners: Float[np.ndarray, "faces corners 3"], most: int):
        # All of the same number of corners, of which the last may stand there again and again.
        self.parts = np.array(corners, float)
        self.owner = np.arange(len(corners))
        self._most = most
        # Tolerance for lying in a plane, as a fraction of the total size.
        self._flat = 1e-9 * float(np.max(np.ptp(self.parts.reshape(-1, 3), axis=0), initial=0.0))
        self._nodes: list[_Node] = []
        waiting = [(np.arange(len(corners)), -1, 0)]
        while waiting:
            rows, parent, side = waiting.pop()
            if parent >= 0:
                self._nodes[parent].sides[side] = len(self._nodes)
            plane, (within, *beside) = self._parted(rows)
            waiting += [(some, len(self._nodes), k) for k, some in enumerate(beside) if len(some)]
            self._nodes.append(_Node(plane, within, [-1, -1]))

    def order(self, eye: Float[np.ndarray, " 4"]) -> Int[np.ndarray, " parts"]:
        """The parts from back to front.

        Args:
            eye: its homogeneous coordinates; for a parallel projection the direction to it, and 0.
        """
        found: list[np.ndarray] = []
        # A node is looked at twice: the far side and itself are put on the stack below the near side.
        stack = [(0, False)]
        while stack:
            number, opened = stack.pop()
            node = self._nodes[number]
            if opened:
                found.append(node.faces)
                continue
            near = 0 if node.plane @ eye >= 0 else 1
            around = [(node.sides[near], False), (number, True), (node.sides[1 - near], False)]
            stack += [entry for entry in around if entry[0] >= 0]
        return np.concatenate(found)

    def _parted(self, rows: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """A plane, and the faces in it, on the side of its normal and on the opposite side; crossing faces are cut."""
        plane = self._plane(rows)
        height = self._heights(rows, plane)
        above, below = np.max(height, axis=1) > self._flat, np.min(height, axis=1) < -self._flat
        crossed = rows[above & below]
        parts = [self._cut(int(row), plane) for row in crossed]
        return plane, [
            rows[~above & ~below],
            np.concatenate([rows[above & ~below], np.array([x[0] for x in parts], int)]),
            np.concatenate([rows[below & ~above], np.array([x[1] for x in parts], int)]),
        ]

    def _plane(self, rows: np.ndarray) -> np.ndarray:
        """The plane, among planes of some of the faces, that cuts fewest faces."""
        # Faces whose planes are tried at each node; the plane that cuts fewest faces is taken.
        planes = [
            self._plane_of(int(row)) for row in rows[np.linspace(0, len(rows) - 1, min(6, len(rows))).astype(int)]
        ]
        heights = [self._heights(rows, plane) for plane in planes]
        cuts = [np.sum((x.max(axis=1) > self._flat) & (x.min(axis=1) < -self._flat)) for x in heights]
        # A face without area has no plane, and would not separate the others.
        cuts = [count if np.any(plane) else len(rows) + 1 for count, plane in zip(cuts, planes, strict=True)]
        return planes[int(np.argmin(cuts))]

    def _plane_of(self, row: int) -> np.ndarray:
        """The unit normal, and the negative of the height of the plane along it."""
        corners = self.parts[row]
        across = np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0]).sum(axis=0)
        length = float(np.linalg.norm(across))
        normal = across / length if length > 0 else np.zeros(3)
        return np.append(normal, -normal @ corners[0])

    def _heights(self, rows: np.ndarray, plane: np.ndarray) -> np.ndarray:
        return self.parts[rows] @ plane[:3] + plane[3]

    def _cut(self, row: int, plane: np.ndarray) -> tuple[int, int]:
        """Cut a face; return the rows of the part on the side of the normal, which replaces it, and of the new part."""
        if len(self.parts) >= self._most:
            raise ValueError(f"there would be more than {self._most} parts.")
        corners = self.parts[row]
        height = corners @ plane[:3] + plane[3]
        sides: tuple[list[np.ndarray], list[np.ndarray]] = ([], [])
        for here, there, low, high in zip(corners, np.roll(corners, -1, 0), height, np.roll(height, -1), strict=True):
            for side, sign in zip(sides, (1, -1), strict=True):
                if sign * low >= 0:
                    side.append(here)
                if low * high < 0:
                    side.append(here + low / (low - high) * (there - here))
        width = max(len(sides[0]), len(sides[1]), self.parts.shape[1])
        self.parts = _padded(self.parts, width)
        self.parts[row] = _padded(np.array(sides[0])[None], width)[0]
        self.parts = np.concatenate([self.parts, _padded(np.array(sides[1])[None], width)])
        self.owner = np.append(self.owner, self.owner[row])
        return row, len(self.parts) - 1


def _padded(corners: np.ndarray, width: int) -> np.ndarray:
    return np.concatenate([corners, np.repeat(corners[:, -1:], width - corners.shape[1], axis=1)], axis=1)


def eye_of(projection: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, " 4"]:
    """The eye of a projection of homogeneous coordinates, the third of which grows with the depth.

    It is the point without image: its first, second and fourth projected coordinates are zero.
    """
    eye = np.linalg.svd(projection[[0, 1, 3]])[2][-1]
    # In a parallel projection the eye is infinitely far away, on the side of small depth.
    parallel = abs(eye[3]) <= 1e-9 * np.max(np.abs(eye))
    return -np.sign(projection[2] @ eye) * np.append(eye[:3], 0.0) if parallel else eye / eye[3]


def shaded_shapes(
    ax: Any, faces: Sequence[np.ndarray], colors: Sequence[str], labels: Sequence[str | None], alpha: float
) -> None:
    """Draw several shapes (faces, 4, 3) as one, so that faces in front hide others, with keys for a legend."""
    rgb = np.repeat([rgb_of(color) for color in colors[: len(faces)]], [len(own) for own in faces], axis=0)
    corners = np.concatenate(faces)
    tree = _tree(corners)
    if tree is None:
        add_faces(ax, corners, rgb, "surface", alpha)
    else:
        _add_in_order(ax, tree, _shaded(corners, rgb, alpha)[tree.owner])
    for color, name in zip(colors, labels, strict=False):
        draw(ax, np.full((1, 3), np.nan), "key", color=color, label=name, marker="s", linestyle="none")


def add_faces(ax: Any, corners: np.ndarray, rgb: np.ndarray, gid: str, alpha: float, **style: Any) -> None:
    """Add quadrilaterals, on both sides in colors that fade if they are turned from the light."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    colors = _shaded(corners, rgb, alpha)
    # Between opaque faces the ground would shine through; edges of transparent ones would lie on top of each other.
    seams: dict[str, Any] = {"linewidth": 0.3, "edgecolor": colors} if alpha == 1.0 else {"linewidth": 0.0}
    # Thousands of faces as paths would make files that no viewer opens.
    faces = Poly3DCollection(corners, facecolors=colors, rasterized=True, **(seams | style))
    faces.set_gid(gid)
    ax.add_collection3d(faces, autolim=False)


def _shaded(corners: np.ndarray, rgb: np.ndarray, alpha: float) -> np.ndarray:
    """The colors (faces, 4), faded and with the opacity."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.abs(normal @ _LIGHT)[:, None] / np.where(length > 0, length, 1.0) / np.linalg.norm(_LIGHT)
    return np.concatenate([rgb * (1 - _SHADE + _SHADE * facing), np.full((len(rgb), 1), alpha)], axis=1)


def _tree(corners: np.ndarray) -> DepthTree | None:
    """The tree of few triangles, as quadrilaterals (faces, 4, 3) with the last corner twice; None for other faces."""
    if len(corners) > _FEW or np.any(corners[:, 2] != corners[:, 3]):
        return None
    try:
        return DepthTree(corners, _PARTS)
    except ValueError:
        return None


def _add_in_order(ax: Any, tree: DepthTree, colors: np.ndarray) -> None:
    """Add the parts of a tree, sorted for the current view each time they are drawn."""
    from matplotlib.collections import PolyCollection
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    opaque = bool(np.all(colors[:, 3] == 1.0))

    class SortedFaces(PolyCollection):
        def do_3d_projection(self) -> float:
            """Sort faces for the current view and return the least depth; axes in space call this before drawing."""
            axes: Any = self.axes
            order = tree.order(eye_of(np.asarray(axes.M)))
            places: Any = tree.parts[order].reshape(-1, 3).T
            x, y, depth = proj_transform(places[0], places[1], places[2], axes.M)
            self.set_verts(list(np.stack([x, y], axis=-1).reshape(len(order), -1, 2)))
            shown: Any = colors[order]
            self.set_facecolor(shown)
            if opaque:
                self.set_edgecolor(shown)
            return float(np.min(depth))

    flat = list(tree.parts[:, :, :2])
    faces = SortedFaces(flat, facecolors=colors, linewidths=0.3 if opaque else 0.0, rasterized=True)
    faces.set_gid("surface")
    ax.add_collection(faces, autolim=False)


def frame(ax: Any, corners: list[np.ndarray]) -> None:
    """Set limits that contain the previous content and the corners."""
    ax.auto_scale_xyz(*np.transpose(corners))
    finish(ax)


def rgb_of(color: str) -> np.ndarray:
    """A color as three numbers."""
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(color))
