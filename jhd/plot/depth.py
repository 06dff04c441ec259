"""Which faces are drawn first, so that those in front hide what is behind: a tree of planes, for few large faces.

Sorted by their mean depth, large faces hide what stands before them. In a tree every face lies on one side of the
planes above it, cut where it would not, and what is on the far side of a plane never hides what is on that of the eye.

Source: Fuchs, Kedem & Naylor, On visible surface generation by a priori tree structures, SIGGRAPH 1980.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

# Faces of planes that are tried at each node; the one that cuts fewest others is taken.
_TRIED = 6
# What lies in a plane, as a share of the size of the whole.
_FLAT = 1e-9


class _Node(NamedTuple):
    """A plane, the faces in it, and the nodes on the side of the normal and on the other; -1 where there is none."""

    plane: np.ndarray
    faces: np.ndarray
    sides: list[int]


class DepthTree:
    """Convex flat faces, some cut in parts, and the order in which they are drawn for any eye.

    Args:
        corners: of the faces, (faces, corners, 3); a corner may stand there twice.
        most: parts at most.

    Raises:
        ValueError: there would be more parts.
    """

    def __init__(self, corners: Float[np.ndarray, "faces corners 3"], most: int):
        # All of the same number of corners, of which the last may stand there again and again.
        self.parts = np.array(corners, float)
        self.owner = np.arange(len(corners))
        self._most = most
        self._flat = _FLAT * float(np.max(np.ptp(self.parts.reshape(-1, 3), axis=0), initial=0.0))
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
            eye: where it is, in homogeneous coordinates; of a parallel projection the direction to it, and 0.
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
        """A plane, and which faces lie in it, on its side and on the other; those that it crosses are cut."""
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
        """Of the planes of some of the faces that which cuts fewest."""
        planes = [
            self._plane_of(int(row)) for row in rows[np.linspace(0, len(rows) - 1, min(_TRIED, len(rows))).astype(int)]
        ]
        heights = [self._heights(rows, plane) for plane in planes]
        cuts = [np.sum((x.max(axis=1) > self._flat) & (x.min(axis=1) < -self._flat)) for x in heights]
        # A face without area has no plane, and leaves the others as they are.
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
        """Both parts of a face: on the side of the normal, in the place of the face, and on the other, a new one."""
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
    """Where a projection of homogeneous coordinates, whose third one grows with the depth, is seen from.

    That is what has no place in the picture: the first, second and fourth coordinate are zero.
    """
    eye = np.linalg.svd(projection[[0, 1, 3]])[2][-1]
    # At a parallel projection the eye is infinitely far away, where it is not deep.
    parallel = abs(eye[3]) <= 1e-9 * np.max(np.abs(eye))
    return -np.sign(projection[2] @ eye) * np.append(eye[:3], 0.0) if parallel else eye / eye[3]
