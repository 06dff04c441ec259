"""Pictures of triangle meshes."""

from collections.abc import Sequence

import numpy as np

from jhd._plot.axes import BLUE, ORANGE, axes_for
from jhd._plot.faces import frame, shaded_shapes
from jhd._runtime.argument_hints import belongs
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.foreign import Axes
from jhd._shapes.mesh import TriangleMesh, check_mesh, places_of

# More triangles of all meshes together take many seconds to draw, and are smaller than a printed dot.
_MOST = 20_000


def mesh(
    shape: ShapeLike, ax: Axes | None = None, *, color: str = BLUE, label: str | None = None, alpha: float = 1.0
) -> Axes:
    """Space axes with a triangle mesh; a coarser image is drawn if the mesh has more than 20 000 triangles.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> square = jhd.TriangleMesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    >>> jhd.plot.mesh(square, Figure().add_subplot(projection="3d")).name
    '3d'

    Args:
        shape: mesh, or an object that jhd.as_shape converts to one.
        ax: matplotlib axes with projection="3d". None creates a figure.
        color: color of the triangles.
        label: name in a legend. None means no entry.
        alpha: opacity, 0 to 1.

    Returns:
        The axes.

    Raises:
        TypeError: the shape is no mesh.
        ValueError: the axes are plane.
    """
    return meshes((shape,), ax, colors=(color,), labels=(label,), alpha=alpha)


@belongs(color="write colors=, one for each")
def meshes(
    shapes: Sequence[ShapeLike],
    ax: Axes | None = None,
    *,
    colors: Sequence[str] = (BLUE, ORANGE),
    labels: Sequence[str | None] = ("A", "B"),
    alpha: float = 0.6,
) -> Axes:
    """Space axes with several meshes, drawn together so that faces in front hide faces behind.

    If the meshes have more than 20 000 triangles in total, coarser images with merged vertices are drawn.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> square = jhd.TriangleMesh([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)])
    >>> jhd.plot.meshes([square, square], Figure().add_subplot(projection="3d")).name
    '3d'

    Args:
        shapes: meshes, or objects that jhd.as_shape converts to meshes.
        ax: matplotlib axes with projection="3d". None creates a figure.
        colors: colors, one for each mesh.
        labels: names in a legend, one for each mesh.
        alpha: opacity, 0 to 1.

    Returns:
        The axes.

    Raises:
        TypeError: a shape is no mesh.
        ValueError: the axes are plane.
    """
    shapes = [taken_as(f"shapes[{number}]", shape) for number, shape in enumerate(shapes)]
    for number, shape in enumerate(shapes):
        check_mesh(f"shapes[{number}]", shape)
    ax = axes_for(ax, 3)
    shaded_shapes(ax, [faces_of(shape, _MOST // len(shapes)) for shape in shapes], colors, labels, alpha)
    frame(ax, [np.asarray(end) for shape in shapes for end in shape.bounds])
    return ax


def faces_of(shape: TriangleMesh, most: int = _MOST // 2) -> np.ndarray:
    """The triangles of a mesh as quadrilaterals (triangles, 4, 3); a coarser image if there are more than `most`."""
    # The last corner twice makes a quadrilateral of a triangle.
    return _few(np.asarray(shape.corners), most)[:, [0, 1, 2, 2]]


def _few(corners: np.ndarray, most: int) -> np.ndarray:
    """At most `most` triangles (triangles, 3, 3) that look like the given ones from afar."""
    # First number of cells along the longest side in which vertices are merged.
    cells, few = 256.0, corners
    while len(few) > most:
        # From try to try the number of cells shrinks by this factor.
        few, cells = _gathered(corners, cells), cells * 0.75
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
