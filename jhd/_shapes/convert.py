"""Conversion of matplotlib paths and shapely geometries to contours of control points.

Neither package is imported; only `vertices` and `codes`, or `geom_type`, `coords` and `geoms` are read. A contour is a
list of segments, each an array of points, so one contour may contain lines, quadratics and cubics.
"""

from typing import Any

import numpy as np

from jhd._runtime.arrays import check_finite
from jhd._shapes.homogeneous import elevated

# Path.STOP, MOVETO, LINETO, CURVE3, CURVE4 and CLOSEPOLY of matplotlib, and the number of vertices that each takes.
_STOP, _MOVETO, _LINETO, _CURVE3, _CURVE4, _CLOSEPOLY = 0, 1, 2, 3, 4, 79
_VERTICES = {_STOP: 1, _MOVETO: 1, _LINETO: 1, _CURVE3: 2, _CURVE4: 3, _CLOSEPOLY: 1}


def outline_arrays(contours: list[list[np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Control points (segments, points, dim) in the largest degree, and the index of the segment after each.

    The next segment of the contour follows; after the last one the first, if the contour returns to its start, and -1
    otherwise.
    """
    pieces = [piece for contour in contours for piece in contour]
    lengths = np.array([len(piece) for piece in pieces])
    degree = int(lengths.max()) - 1
    control_points = np.empty((len(pieces), degree + 1, pieces[0].shape[-1]))
    for length in np.unique(lengths):
        rows = np.flatnonzero(lengths == length)
        control_points[rows] = elevated(np.stack([pieces[k] for k in rows]), degree)
    next_segment = np.arange(1, len(pieces) + 1)
    first = 0
    for contour in contours:
        last = first + len(contour) - 1
        start = contour[0][0]
        closed = np.array_equal(start, contour[-1][-1]) and any(np.any(piece != start) for piece in contour)
        next_segment[last] = first if closed else -1
        first = last + 1
    return control_points, next_segment


def path_contours(path: Any) -> list[list[np.ndarray]]:
    """The contours of a matplotlib Path; contours without a segment (a lone MOVETO) are left out.

    Raises:
        TypeError: an object without `vertices` and `codes`.
        ValueError: no segment, NaN or infinity, a code that is unknown, out of place or short of vertices.
    """
    vertices, codes = _path_arrays(path)
    contours: list[list[np.ndarray]] = []
    start = pen = vertices[0]
    k = 0
    while k < len(codes) and codes[k] != _STOP:
        code, points = codes[k], vertices[k : k + _VERTICES[codes[k]]]
        if code == _MOVETO:
            start = points[0]
            contours.append([])
        elif code != _CLOSEPOLY:
            contours[-1].append(np.vstack([pen, points]))
        elif np.any(pen != start):
            contours[-1].append(np.stack([pen, start]))
        pen = start if code == _CLOSEPOLY else points[-1]
        if code == _CLOSEPOLY:
            contours.append([])
        k += len(points)
    contours = [contour for contour in contours if contour]
    if not contours:
        raise ValueError(f"path has no segment; its {len(codes)} vertices only move the pen.")
    return contours


def _path_arrays(path: Any) -> tuple[np.ndarray, np.ndarray]:
    if not hasattr(path, "vertices") or not hasattr(path, "codes"):
        raise TypeError(f"path must be a matplotlib Path (vertices and codes); got {type(path).__name__}.")
    vertices = np.asarray(path.vertices, dtype=float)
    if vertices.ndim != 2 or vertices.shape[1] != 2:
        raise ValueError(f"path.vertices has shape {vertices.shape}; needs (points, 2).")
    if not len(vertices):
        raise ValueError("path is empty: it has no vertices.")
    codes = np.full(len(vertices), _LINETO) if path.codes is None else np.asarray(path.codes)
    if path.codes is None:
        codes[0] = _MOVETO
    _check_codes(codes, len(vertices))
    # The vertex of CLOSEPOLY is ignored by every reader of paths, and need not hold numbers.
    check_finite("path.vertices", np.where(codes[:, None] == _CLOSEPOLY, 0.0, vertices))
    return vertices, codes


def _check_codes(codes: np.ndarray, count: int) -> None:
    if codes.shape != (count,):
        raise ValueError(f"path.codes has {len(codes)} entries; path.vertices has {count} rows.")
    if codes[0] != _MOVETO:
        raise ValueError(f"path.codes[0] is {codes[0]}; needs MOVETO ({_MOVETO}).")
    k = 0
    while k < count and codes[k] != _STOP:
        if codes[k] not in _VERTICES:
            raise ValueError(f"path.codes[{k}] is {codes[k]}; needs one of {sorted(_VERTICES)}.")
        needed = _VERTICES[codes[k]]
        if np.count_nonzero(codes[k : k + needed] == codes[k]) < needed:
            raise ValueError(f"path.codes[{k}] is {codes[k]}, which takes {needed} vertices; fewer have that code.")
        k += needed


def geometry_contours(geometry: Any) -> list[list[np.ndarray]]:
    """The contours of a shapely geometry: points, lines, and the rings that bound polygons; empty members are left out.

    Raises:
        TypeError: no shapely geometry, or a kind of geometry that is none of the above.
        ValueError: an empty geometry, NaN or infinity, plane and space members in one collection.
    """
    if not hasattr(geometry, "geom_type"):
        raise TypeError(f"geometry must be a shapely geometry; got {type(geometry).__name__}.")
    if geometry.is_empty:
        raise ValueError(f"geometry is empty: {geometry.geom_type}.")
    chains = _chains(geometry)
    dims = sorted({chain.shape[1] for chain in chains})
    if len(dims) > 1:
        raise ValueError(f"geometry mixes members of {dims[0]} and {dims[1]} coordinates; needs one dimension.")
    for index, chain in enumerate(chains):
        check_finite(f"geometry.coords of part {index}", chain)
    return [[chain] if len(chain) == 1 else list(np.stack([chain[:-1], chain[1:]], axis=1)) for chain in chains]


def _chains(geometry: Any) -> list[np.ndarray]:
    """The coordinates of each point, line and ring, in order."""
    if geometry.is_empty:
        return []
    kind = geometry.geom_type
    if kind in ("Point", "LineString", "LinearRing"):
        # A measure, if present, is the last column and no coordinate.
        return [np.asarray(geometry.coords, dtype=float)[:, : 3 if geometry.has_z else 2]]
    if kind == "Polygon":
        return [chain for ring in (geometry.exterior, *geometry.interiors) for chain in _chains(ring)]
    if hasattr(geometry, "geoms"):
        return [chain for part in geometry.geoms for chain in _chains(part)]
    raise TypeError(f"geometry is a {kind}; needs points, lines, rings, polygons or collections of them.")
