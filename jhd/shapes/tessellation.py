"""Triangles for tensor-product patches, with a proven deviation.

Every patch is cut into a grid of cells, and every cell into two triangles between its corners. Over a cell the patch is
compared with the bilinear surface B between the stored corners at equal parameters: the coefficients of N - w B, in one
degree more, divided by those of w, bound |S - B| on rational patches as on polynomial ones. In a triangle B differs
from the plane by the twist v00 - v10 - v01 + v11 times x y, x + y <= 1: at most a quarter of it. As the triangles
are the image of the same parameters, the sum bounds the distance both ways: from any point of the surface to the mesh
and from any point of the mesh to the surface.

All this is done with coordinates divided by a power of two, of order one, and the vertices as they are stored.
Rounding, for coordinates about a common centre, of size at most r. The entries of a restriction of degree p are sums of
products of p factors, 3 p roundings; two of them, the point and its weight, and the sums make at most 4 (p + q) + 10.
The coefficients of N - w B take p + q + 12 more, with non-negative factors that add up to the weight; the length and
the quotient 12. So |S - B| is off by at most 2 sqrt(3) gamma(5 (p + q) + 34) r.

Source: Farin, Curves and Surfaces for CAGD (2002), chapter 14, for the nets; the bound by the elevated difference is
ours and sharper than the one by second derivatives (Filip, Magedson & Markot, CAGD 3, 1986).
"""

from typing import NamedTuple

import numpy as np

from jhd.arithmetic.bernstein import basis, product_weights
from jhd.arithmetic.rounding import gamma
from jhd.arithmetic.scaling import common_exponent, unit_weights

# The numbers of cells grow by this factor until the bound is small enough.
_GROWTH = 1.25
# Tolerances, for surfaces of size one, between which the first numbers of cells are worked out.
_SOUGHT = (1e-100, 1e100)


class _SampleGrid(NamedTuple):
    """Numbers of cells of every patch, the power of two of the coordinates, and the precision of the vertices."""

    m: int
    n: int
    power: int
    dtype: np.dtype


class Tessellation(NamedTuple):
    """Corners and triangles, and how far surface and triangles are from each other at most."""

    vertices: np.ndarray
    triangles: np.ndarray
    deviation: float


def tessellate(points: np.ndarray, weights: np.ndarray | None, atol: float, most: int) -> Tessellation:
    """Triangles within atol of Bezier patches (patches, rows, columns, 3), on one grid for all patches.

    Raises:
        ValueError: more than `most` triangles are needed.
    """
    dtype = points.dtype
    power = int(common_exponent(points))
    points = np.ldexp(points.astype(np.float64), -power)
    # Beyond either end nothing is told by how far: every number of cells is enough, or none.
    wanted = float(np.clip(np.ldexp(np.longdouble(atol), -power), *_SOUGHT))
    heavy = np.ones(points.shape[:-1]) if weights is None else unit_weights(weights.astype(np.float64), (1, 2))
    m, n = _first_counts(points, wanted)
    while True:
        # Written so that numbers beyond the integers are refused too.
        if not 2.0 * len(points) * m * n <= most:
            raise ValueError(f"atol is {atol:g}; more than max_triangles = {most} triangles would be needed.")
        found = _on_grid(points, heavy, _SampleGrid(int(m), int(n), power, dtype))
        if found.deviation <= atol:
            return found
        # A direction of degree zero holds nothing to cut.
        m, n = (
            np.ceil(_GROWTH * k) if k_points > 1 else k for k, k_points in zip((m, n), points.shape[1:], strict=False)
        )


def _first_counts(points: np.ndarray, atol: float) -> tuple[float, float]:
    """Numbers of cells that second differences of the nets ask for at the least, each kind by itself."""
    p, q = points.shape[1] - 1, points.shape[2] - 1

    def most(rows: np.ndarray, factor: float) -> float:
        return float(np.sqrt(np.sum(rows**2, axis=-1)).max(initial=0.0)) * factor

    bend_u = most(np.diff(points, 2, axis=1), p * (p - 1) / 8)
    bend_v = most(np.diff(points, 2, axis=2), q * (q - 1) / 8)
    twist = most(np.diff(np.diff(points, axis=1), axis=2), p * q / 4)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        m, n = (max(1.0, float(np.ceil(np.sqrt(np.float64(x) / atol)))) if x > 0 else 1.0 for x in (bend_u, bend_v))
        lacking = np.sqrt(max(1.0, float(np.float64(twist) / atol) / (m * n))) if twist > 0 else 1.0
    return float(np.ceil(m * lacking)), float(np.ceil(n * lacking))


def _on_grid(points: np.ndarray, weights: np.ndarray, grid: _SampleGrid) -> Tessellation:
    """The triangles of one grid, in the user's coordinates, from points divided by 2^power."""
    (count, rows, columns), (m, n) = weights.shape, grid[:2]
    p, q = rows - 1, columns - 1
    u, v = np.linspace(0.0, 1.0, m + 1), np.linspace(0.0, 1.0, n + 1)
    vertices = np.ldexp(_corners(points, weights, u, v), grid.power).astype(grid.dtype)
    low, high = points.min(axis=(0, 1, 2)), points.max(axis=(0, 1, 2))
    centre = low + 0.5 * (high - low)
    about, corners = points - centre, np.ldexp(vertices.astype(np.float64), -grid.power) - centre
    # Far from the origin the surface may be small beside its coordinates.
    second = common_exponent(about, corners)
    about, corners = np.ldexp(about, -second), np.ldexp(corners, -second)
    net = np.concatenate([about * weights[..., None], weights[..., None]], axis=-1)
    along_v = np.stack([_restriction(v[j], v[j + 1], q) for j in range(n)])
    rows_of_v = np.einsum("nbj,kijc->knibc", along_v, net)
    worst = 0.0
    for i in range(m):
        cells = np.einsum("ai,knibc->knabc", _restriction(u[i], u[i + 1], p), rows_of_v)
        ends = corners[:, i : i + 2]
        square = np.stack([ends[:, :, :-1], ends[:, :, 1:]], axis=-2)  # (patches, 2 along u, cells, 2 along v, 3)
        worst = max(worst, _bent(cells, np.moveaxis(square, 1, 2)))
    size = max(float(np.abs(about).max()), float(np.abs(corners).max()))
    error = 2 * np.sqrt(3.0) * gamma(5 * (p + q) + 34, np.float64) * size
    with np.errstate(over="ignore"):
        deviation = np.ldexp((worst + error) * (1 + 1e-15), grid.power + second)
    return Tessellation(*_joined(vertices, count, m, n), float(np.nextafter(deviation, np.inf)))


def _bent(cells: np.ndarray, square: np.ndarray) -> float:
    """The largest distance of cells (patches, cells, rows, columns, 4) from the triangles between their corners."""
    p, q = cells.shape[2] - 1, cells.shape[3] - 1
    along_u, along_v = product_weights(p, 1), product_weights(q, 1)
    total = np.zeros((*cells.shape[:2], p + 2, q + 2, 4))
    for a in (0, 1):
        for b in (0, 1):
            share = along_u[:, a, None, None] * along_v[None, :, b, None]
            corner = square[:, :, a, b][:, :, None, None]
            weight = cells[..., 3:]
            difference = np.concatenate([cells[..., :3] - weight * corner, weight], axis=-1)
            total[:, :, a : a + p + 1, b : b + q + 1] += share * difference
    from_bilinear = np.sqrt(np.sum((total[..., :3] / total[..., 3:]) ** 2, axis=-1)).max(axis=(2, 3))
    twist = square[:, :, 0, 0] - square[:, :, 1, 0] - square[:, :, 0, 1] + square[:, :, 1, 1]
    return float((from_bilinear + 0.25 * np.sqrt(np.sum(twist**2, axis=-1))).max())


def _restriction(t0: float, t1: float, degree: int) -> np.ndarray:
    """The matrix whose row j holds the weights of the blossom with degree - j arguments t0 and j arguments t1."""
    rows = []
    for j in range(degree + 1):
        row = np.ones(1)
        for k in range(degree):
            t = t0 if k < degree - j else t1
            row = np.append(row * (1 - t), 0.0) + np.append(0.0, row * t)
        rows.append(row)
    return np.stack(rows)


def _corners(points: np.ndarray, weights: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Points of the patches on the grid (patches, m + 1, n + 1, 3).

    Sums in a fixed order: neighbours get the same floats along their common edge.
    """
    net = np.concatenate([points * weights[..., None], weights[..., None]], axis=-1)
    along_u = np.zeros((len(points), len(u), *net.shape[2:]))
    for i, values in enumerate(basis(net.shape[1] - 1, u).T):
        along_u = along_u + values[:, None, None] * net[:, i, None]
    both = np.zeros((len(points), len(u), len(v), 4))
    for j, values in enumerate(basis(net.shape[2] - 1, v).T):
        both = both + values[:, None] * along_u[:, :, j, None]
    return both[..., :3] / both[..., 3:]


def _joined(grid: np.ndarray, count: int, m: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices that are each given once, and two triangles for each cell, counter-clockwise in the parameters."""
    vertices, number = np.unique(grid.reshape(-1, 3), axis=0, return_inverse=True)
    index = number.reshape(count, m + 1, n + 1)
    a, b, c, d = index[:, :-1, :-1], index[:, 1:, :-1], index[:, 1:, 1:], index[:, :-1, 1:]
    triangles = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=-2)
    return vertices, triangles.reshape(-1, 3)
