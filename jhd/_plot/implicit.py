"""Pictures of implicit and parametric surfaces, and of the cells that contain them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jhd._fields.octree import Voxels
from jhd._plot.axes import BLUE, GRAY, ORANGE, PALE_BLUE, TEXT_POINTS, VERMILLION, axes_for, draw, finish, legend_above
from jhd._plot.faces import add_faces, frame, rgb_of, shaded_shapes
from jhd._plot.nets import quadrilaterals, quadrilaterals_of_patches
from jhd._runtime.argument_hints import belongs
from jhd._shapes.foreign import Axes
from jhd._shapes.implicit import ImplicitSurface, check_surface
from jhd._shapes.patch import AbstractPatch


def surface(
    shape: ImplicitSurface | AbstractPatch,
    ax: Axes | None = None,
    *,
    color: str = BLUE,
    label: str | None = None,
    alpha: float = 0.75,
    cells: int = 48,
) -> Axes:
    """Space axes with a surface; an implicit surface is cut off at its box.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> plane = jhd.ImplicitSurface.parse("x + y + z", [-1, -1, -1], [1, 1, 1])
    >>> jhd.plot.surface(plane, Figure().add_subplot(projection="3d"), cells=4).name
    '3d'

    Args:
        shape: implicit or parametric surface.
        ax: matplotlib axes with projection="3d". None creates a figure.
        color: color of the surface.
        label: name in a legend. None means no entry.
        alpha: opacity, 0 to 1.
        cells: for an implicit surface, the number of grid cells along each axis; finer parts may be missing. For a
            parametric surface, the approximate number of cells along each side.

    Returns:
        The axes.

    Raises:
        TypeError: the shape is no implicit or parametric surface.
        ValueError: the axes are plane.
    """
    return surfaces((shape,), ax, colors=(color,), labels=(label,), alpha=alpha, cells=cells)


@belongs(color="write colors=, one for each")
def surfaces(
    shapes: Sequence[ImplicitSurface | AbstractPatch],
    ax: Axes | None = None,
    *,
    colors: Sequence[str] = (BLUE, ORANGE),
    labels: Sequence[str | None] = ("A", "B"),
    alpha: float = 0.6,
    cells: int = 48,
) -> Axes:
    """Space axes with several surfaces, drawn together so that faces in front hide faces behind.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> planes = [jhd.ImplicitSurface.parse(text, [-1, -1, -1], [1, 1, 1]) for text in ("x + y + z", "x - y")]
    >>> jhd.plot.surfaces(planes, Figure().add_subplot(projection="3d"), cells=4).name
    '3d'

    Args:
        shapes: implicit or parametric surfaces.
        ax: matplotlib axes with projection="3d". None creates a figure.
        colors: colors, one for each surface.
        labels: names in a legend, one for each surface.
        alpha: opacity, 0 to 1.
        cells: number of cells along each axis of an implicit surface, or each side of a parametric one; see `surface`.

    Returns:
        The axes.

    Raises:
        TypeError: a shape is no implicit or parametric surface.
        ValueError: the axes are plane.
    """
    for number, shape in enumerate(shapes):
        check_drawn(f"shapes[{number}]", shape)
    ax = axes_for(ax, 3)
    nets = [net(shape, cells) for shape in shapes]
    shaded_shapes(ax, nets, colors, labels, alpha)
    frame(ax, [np.asarray(end) for shape in shapes for end in shape.bounds])
    return ax


def check_drawn(name: str, shape: object) -> None:
    """Raise TypeError unless the shape is a surface that `surfaces` can draw."""
    if not isinstance(shape, ImplicitSurface | AbstractPatch):
        got = type(shape).__name__
        raise TypeError(f"{name} must be an ImplicitSurface or a parametric surface; got {got}.")


def net(shape: ImplicitSurface | AbstractPatch, cells: int) -> np.ndarray:
    """Quadrilaterals of an implicit or parametric surface, (quadrilaterals, 4, 3)."""
    return (
        quadrilaterals(shape, cells) if isinstance(shape, ImplicitSurface) else quadrilaterals_of_patches(shape, cells)
    )


@belongs(color="write colors=")
def voxels(
    cells: Voxels, ax: Axes | None = None, *, colors: Sequence[str] = (BLUE, VERMILLION), legend: bool = True
) -> Axes:
    """Space axes with the kept cells of a surface, colored by whether they are certified to contain one of its points.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2, -2, -2], [2, 2, 2])
    >>> ax = jhd.plot.voxels(jhd.voxelize(sphere, 2), Figure().add_subplot(projection="3d"))
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['certified (8)']

    Args:
        cells: result of `voxelize`.
        ax: matplotlib axes with projection="3d". None creates a figure.
        colors: colors of the certified cells and of the remaining cells.
        legend: whether to draw a legend with the numbers of cells above the axes.

    Returns:
        The axes.

    Raises:
        ValueError: the axes are plane.
    """
    ax = axes_for(ax, 3)
    places, proven = np.asarray(cells.cells), np.asarray(cells.proven)
    owner, faces = _visible_faces(places)
    corners = np.asarray(cells.lower) + np.asarray(cells.spacing) * faces
    edges = {"linewidth": 0.15, "edgecolor": "white"}
    rgb = np.where(proven[owner, None], rgb_of(colors[0]), rgb_of(colors[1]))
    add_faces(ax, corners, rgb, "voxels", 1.0, **edges)
    for color, name, count in zip(colors, ("certified", "not certified"), (proven.sum(), (~proven).sum()), strict=True):
        if count:
            label = f"{name} ({count})"
            draw(ax, np.full((1, 3), np.nan), "key", color=color, label=label, marker="s", linestyle="none")
    frame(ax, [corners.min((0, 1)), corners.max((0, 1))])
    if legend:
        legend_above(ax, 2)
    return ax


def section(
    shape: ImplicitSurface,
    cells: Voxels,
    ax: Axes | None = None,
    *,
    axis: int = 2,
    at: float | None = None,
    legend: bool = True,
) -> Axes:
    """Plane axes with one layer of cells, colored by their state, and the curve in which a plane cuts the surface.

    A cell that `voxelize` dropped is inside or outside: the polynomial has one sign in the whole cell, negative inside.
    A kept cell at the boundary is certified to contain a point of the surface, or it may contain one (hatched).

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2, -2, -2], [2, 2, 2])
    >>> ax = jhd.plot.section(sphere, jhd.voxelize(sphere, 2), Figure().add_subplot())
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('$x$', '$y$')

    Args:
        shape: implicit surface.
        cells: cells of this surface, from `voxelize`.
        ax: plane matplotlib axes. None creates a figure.
        axis: coordinate that is constant in the layer: 0, 1 or 2.
        at: value of this coordinate, which selects the layer. None means the middle of the box.
        legend: whether to draw a legend above the axes.

    Returns:
        The axes.

    Raises:
        TypeError: the shape is no implicit surface.
        ValueError: the axis is not 0, 1 or 2, or the plane lies outside the box.
    """
    check_surface("shape", shape)
    low, high = (np.asarray(end, float) for end in shape.bounds)
    if axis not in (0, 1, 2):
        raise ValueError(f"axis is {axis}; needs 0, 1 or 2.")
    at = float(low[axis] + high[axis]) / 2 if at is None else float(at)
    if not low[axis] <= at <= high[axis]:
        raise ValueError(f"at is {at:g}; the box has {low[axis]:g} to {high[axis]:g} along this axis.")
    ax = axes_for(ax, 2)
    spacing = np.asarray(cells.spacing)
    counts = np.rint((high - low) / spacing).astype(int)
    u, v = (k for k in range(3) if k != axis)
    classes = _classes(shape, cells, axis, min(int((at - low[axis]) / spacing[axis]), counts[axis] - 1), counts)
    x, y = (np.linspace(low[k], high[k], counts[k] + 1) for k in (u, v))
    _draw_classes(ax, x, y, classes)
    x, y = np.meshgrid(*(np.linspace(low[k], high[k], 257) for k in (u, v)))
    values = shape(np.insert(np.stack([x, y], axis=-1), axis, at, axis=-1))
    ax.contour(x, y, np.asarray(values), levels=[0.0], colors="black", linewidths=1.0).set_gid("curve")
    finish(ax)
    for name, k in (("x", u), ("y", v)):
        getattr(ax, f"set_{name}label")(f"${'xyz'[k]}$", fontsize=TEXT_POINTS)
    if legend:
        _name_classes(ax, f"${'xyz'[axis]}$ = {at:.4g}")
    return ax


_INSIDE, _OUTSIDE, _PROVEN, _KEPT = range(4)
_CLASSES = (("inside", PALE_BLUE), ("outside", "white"), ("boundary", ORANGE), ("not certified", VERMILLION))


def _classes(shape: ImplicitSurface, cells: Voxels, axis: int, layer: int, counts: np.ndarray) -> np.ndarray:
    """The state of each cell of a layer."""
    u, v = (k for k in range(3) if k != axis)
    places = np.insert(np.argwhere(np.ones((counts[u], counts[v]))), axis, layer, axis=-1)
    centers = np.asarray(cells.lower) + np.asarray(cells.spacing) * (places + 0.5)
    classes = np.where(np.asarray(shape(centers)) < 0, _INSIDE, _OUTSIDE).reshape(counts[u], counts[v])
    kept, proven = np.asarray(cells.cells), np.asarray(cells.proven)
    here = kept[:, axis] == layer
    classes[tuple(kept[here][:, [u, v]].T)] = np.where(proven[here], _PROVEN, _KEPT)
    return classes


def _draw_classes(ax: Any, x: np.ndarray, y: np.ndarray, classes: np.ndarray) -> None:
    from matplotlib.colors import ListedColormap

    shown = {"cmap": ListedColormap([color for _, color in _CLASSES]), "vmin": -0.5, "vmax": len(_CLASSES) - 0.5}
    ax.pcolormesh(x, y, classes.T, gid="cells", edgecolors=GRAY, linewidth=0.1, **shown)
    unproven = np.ma.masked_where(classes != _KEPT, classes)
    if unproven.count():
        ax.pcolor(x, y, unproven.T, gid="unproven", hatch="////", edgecolor="black", linewidth=0.0, **shown)


def _name_classes(ax: Any, plane: str) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys: list[Any] = [
        Patch(facecolor=color, edgecolor="black", linewidth=0.5, hatch="////" if k == _KEPT else None, label=name)
        for k, (name, color) in enumerate(_CLASSES)
    ]
    keys.append(Line2D([], [], color="black", linewidth=1.0, label=plane))
    legend_above(ax, 3, handles=keys, handlelength=1.4)


def _visible_faces(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces without a cell behind them: the cell of each, and its corners (faces, 4, 3) in steps of the grid."""
    corner = places.min(axis=0) - 1
    taken = np.zeros(places.max(axis=0) - corner + 2, bool)
    taken[tuple((places - corner).T)] = True
    owners, faces = [], []
    for axis in range(3):
        u, v = np.delete(np.eye(3, dtype=int), axis, axis=0)
        out = np.eye(3, dtype=int)[axis]
        for side in (0, 1):
            open_ones = np.flatnonzero(~taken[tuple((places - corner + (2 * side - 1) * out).T)])
            base = places[open_ones] + side * out
            owners.append(open_ones)
            faces.append(np.stack([base, base + u, base + u + v, base + v], axis=1))
    return np.concatenate(owners), np.concatenate(faces)
