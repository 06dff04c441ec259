"""Pictures of triangle meshes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jhd.plot.axes import BLUE, ORANGE, axes_for
from jhd.plot.faces import frame, shaded_shapes
from jhd.shapes.as_shape import taken_as
from jhd.shapes.mesh import TriangleMesh, check_mesh, places_of
from jhd.slips import belongs

# More triangles of all meshes together take many seconds to draw, and are smaller than a printed dot.
_MOST = 20_000
# Cells along the longest side that vertices are gathered in, at first; each try takes this share of the last.
_CELLS, _COARSER = 256, 0.75


@belongs(color="write colour=")
def mesh(shape: Any, ax: Any = None, *, colour: str = BLUE, label: str | None = None, alpha: float = 1.0) -> Any:
    """Space axes with a triangle mesh; of one with very many triangles a coarser image.

    Args:
        shape: the mesh, or what jhd.as_shape takes for one.
        ax: three-dimensional axes to draw on; None makes a figure.
        colour: of its triangles.
        label: name in a legend.
        alpha: opacity.

    Raises:
        TypeError: another kind of shape.
        ValueError: plane axes.
    """
    return meshes((shape,), ax, colours=(colour,), labels=(label,), alpha=alpha)


@belongs(color="write colours=, one for each", colour="write colours=, one for each", colors="write colours=")
def meshes(
    shapes: Sequence[Any],
    ax: Any = None,
    *,
    colours: Sequence[str] = (BLUE, ORANGE),
    labels: Sequence[str | None] = ("A", "B"),
    alpha: float = 0.6,
) -> Any:
    """Space axes with several meshes, drawn as one, so that those in front hide what is behind.

    Args:
        shapes: the meshes, or what jhd.as_shape takes for some; of very many triangles a coarser image is drawn, its
            vertices gathered in cells.
        ax: three-dimensional axes to draw on; None makes a figure.
        colours: one for each.
        labels: their names in a legend.
        alpha: opacity.

    Raises:
        TypeError: another kind of shape.
        ValueError: plane axes.
    """
    shapes = [taken_as(f"shapes[{number}]", shape) for number, shape in enumerate(shapes)]
    for number, shape in enumerate(shapes):
        check_mesh(f"shapes[{number}]", shape)
    ax = axes_for(ax, 3)
    shaded_shapes(ax, [faces_of(shape, _MOST // len(shapes)) for shape in shapes], colours, labels, alpha)
    frame(ax, [np.asarray(end) for shape in shapes for end in shape.box()])
    return ax


def faces_of(shape: TriangleMesh, most: int = _MOST // 2) -> np.ndarray:
    """Its triangles, or where these are more a coarser image of it, as quadrilaterals (triangles, 4, 3)."""
    # The last corner twice makes a quadrilateral of a triangle.
    return _few(np.asarray(shape.corners), most)[:, [0, 1, 2, 2]]


def _few(corners: np.ndarray, most: int) -> np.ndarray:
    """At most so many triangles (triangles, 3, 3) that look like the given ones from afar."""
    cells, few = float(_CELLS), corners
    while len(few) > most:
        few, cells = _gathered(corners, cells), cells * _COARSER
    return few


def _gathered(corners: np.ndarray, cells: float) -> np.ndarray:
    """The triangles with corners in three cells of a grid, moved to the mean of all corners in each cell, once each."""
    points = corners.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    keys = places_of(np.floor((points - low) / np.max(high - low) * cells))
    counts = np.bincount(keys)
    means = np.stack([np.bincount(keys, points[:, axis]) for axis in range(3)], axis=1) / counts[:, None]
    triangles = keys.reshape(-1, 3)
    distinct = np.all(triangles != np.roll(triangles, 1, axis=1), axis=1)
    _, first = np.unique(np.sort(triangles[distinct], axis=1), axis=0, return_index=True)
    return means[triangles[distinct][first]]
