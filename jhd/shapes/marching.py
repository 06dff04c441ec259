"""Triangles of the piecewise linear function of a grid: every cell is cut into six tetrahedra with its long diagonal.

Source: Kuhn, Some combinatorial lemmas in topology (1960), for the tetrahedra; Doi & Koide, An efficient method of
triangulating equi-valued surfaces by using tetrahedral cells (1991).
"""

from functools import cache
from itertools import permutations
from typing import NamedTuple

import numpy as np


class MarchedSurface(NamedTuple):
    """The zeros of a piecewise linear function, without those in cells where it has one sign.

    Args:
        low: the node at one end of the edge on which each vertex lies, as an integer place of the grid.
        high: the node at the other end; the same one where the function is zero there.
        share: how far the vertex is along the edge.
        triangles: numbers of three vertices, counter-clockwise seen from where the function is positive.
    """

    low: np.ndarray
    high: np.ndarray
    share: np.ndarray
    triangles: np.ndarray


def nodes_of(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners of cells (cells, 3), each once, and their numbers (cells, 8) in the order of `ndindex`."""
    size = int(cells.max(initial=0)) + 2
    corners = cells[:, None] + np.array(list(np.ndindex(2, 2, 2)))
    names, number = np.unique((corners[..., 0] * size + corners[..., 1]) * size + corners[..., 2], return_inverse=True)
    nodes = np.stack([names // size**2, names // size % size, names % size], axis=1)
    return nodes, number.reshape(-1, 8)


def march(nodes: np.ndarray, corners: np.ndarray, values: np.ndarray) -> MarchedSurface:
    """The zeros in the cells with these corners; zero counts as positive, and triangles without area are left out.

    Args:
        nodes: places of the nodes (nodes, 3).
        corners: numbers of the corners of each cell (cells, 8).
        values: the function at the nodes.
    """
    tetrahedra = corners[:, _tetrahedra()].reshape(-1, 4)
    case = (values[tetrahedra] < 0) @ np.array([1, 2, 4, 8])
    mixed = (case > 0) & (case < 15)
    edges = _cases()[case[mixed]]
    ends = np.take_along_axis(tetrahedra[mixed], edges.reshape(len(edges), 12), axis=1).reshape(-1, 3, 2)
    # A vertex at a node where the function is zero is that node, whatever edge it came from.
    zero = values[ends] == 0
    at_zero = np.where(zero[..., :1], ends[..., :1], ends[..., 1:])
    ends = np.where(np.any(zero, axis=-1, keepdims=True), at_zero, ends)
    ends.sort(axis=-1)
    names, number = np.unique(ends[..., 0] * len(nodes) + ends[..., 1], return_inverse=True)
    low, high = names // len(nodes), names % len(nodes)
    triangles = number.reshape(-1, 3)
    proper = np.all(triangles != np.roll(triangles, 1, axis=1), axis=1)
    below, above = values[low], values[high]
    apart = below - above
    share = np.where(apart != 0, below / np.where(apart != 0, apart, 1.0), 0.0)
    return MarchedSurface(nodes[low], nodes[high], share, triangles[proper])


@cache
def _tetrahedra() -> np.ndarray:
    """The six tetrahedra as numbers of corners, all of positive volume: paths along the axes from corner 0 to 7."""
    found = []
    for order in permutations(range(3)):
        path = np.cumsum([0, *(4 >> axis for axis in order)])
        odd = sum(order[i] > order[j] for i in range(3) for j in range(i + 1, 3)) % 2
        found.append(path[[0, 1, 3, 2]] if odd else path)
    return np.array(found)


@cache
def _cases() -> np.ndarray:
    """The edges (16, 2 triangles, 3 vertices, 2 ends) by which corners are negative; one triangle is given twice.

    The second copy of a lone triangle is shrunk to a vertex, which is left out.
    """
    table = np.zeros((16, 2, 3, 2), int)
    places = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    for case in range(1, 15):
        below = [k for k in range(4) if case >> k & 1]
        above = [k for k in range(4) if k not in below]
        if len(below) == 2:
            (a, b), (c, d) = below, above
            loop = [(a, c), (a, d), (b, d), (b, c)]
            triangles = [[loop[0], loop[1], loop[2]], [loop[0], loop[2], loop[3]]]
        else:
            loop = [(a, b) for a in below for b in above]
            triangles = [loop, [loop[0]] * 3]
        middle = np.array([0.5 * (places[a] + places[b]) for a, b in triangles[0]])
        normal = np.cross(middle[1] - middle[0], middle[2] - middle[0])
        outwards = normal @ (places[above].mean(axis=0) - places[below].mean(axis=0)) > 0
        table[case] = triangles if outwards else [t[::-1] for t in triangles]
    return table
