"""Pictures of polynomial and parametric surfaces, and of the cells that hold them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jhd.fields.octree import Voxels
from jhd.plot.axes import BLUE, GREY, ORANGE, PALE_BLUE, TEXT_POINTS, VERMILLION, axes_for, draw, finish, legend_above
from jhd.plot.faces import add_faces, frame, rgb_of, shaded_shapes
from jhd.plot.nets import quadrilaterals, quadrilaterals_of_patches
from jhd.shapes.implicit import ImplicitSurface, check_surface
from jhd.shapes.patch import AbstractPatch
from jhd.slips import belongs

_LINES = 257  # samples along each axis of the curve in which a plane cuts a surface


@belongs(color="write colour=")
def surface(
    shape: ImplicitSurface | AbstractPatch,
    ax: Any = None,
    *,
    colour: str = BLUE,
    label: str | None = None,
    alpha: float = 0.75,
    cells: int = 48,
) -> Any:
    """Space axes with a surface; a polynomial one is cut off at its box.

    Args:
        shape: the surface, polynomial or parametric.
        ax: three-dimensional axes to draw on; None makes a figure.
        colour: of the surface.
        label: name in a legend.
        alpha: opacity.
        cells: cells along each axis that a polynomial surface is drawn from, of which finer parts can be missing, or
            along each side of a parametric one, about.

    Raises:
        TypeError: another kind of shape.
        ValueError: plane axes.
    """
    return surfaces((shape,), ax, colours=(colour,), labels=(label,), alpha=alpha, cells=cells)


@belongs(color="write colours=, one for each", colour="write colours=, one for each", colors="write colours=")
def surfaces(
    shapes: Sequence[ImplicitSurface | AbstractPatch],
    ax: Any = None,
    *,
    colours: Sequence[str] = (BLUE, ORANGE),
    labels: Sequence[str | None] = ("A", "B"),
    alpha: float = 0.6,
    cells: int = 48,
) -> Any:
    """Space axes with several surfaces, drawn as one, so that those in front hide what is behind.

    Args:
        shapes: the surfaces.
        ax: three-dimensional axes to draw on; None makes a figure.
        colours: one for each.
        labels: their names in a legend.
        alpha: opacity.
        cells: as for `surface`.

    Raises:
        TypeError: another kind of shape.
        ValueError: plane axes.
    """
    for number, shape in enumerate(shapes):
        check_drawn(f"shapes[{number}]", shape)
    ax = axes_for(ax, 3)
    nets = [net(shape, cells) for shape in shapes]
    shaded_shapes(ax, nets, colours, labels, alpha)
    frame(ax, [np.asarray(end) for shape in shapes for end in shape.box()])
    return ax


def check_drawn(name: str, shape: object) -> None:
    """Raises TypeError unless a shape is a surface that `surfaces` draws."""
    if not isinstance(shape, ImplicitSurface | AbstractPatch):
        got = type(shape).__name__
        raise TypeError(f"{name} must be an ImplicitSurface or a parametric surface; got {got}.")


def net(shape: ImplicitSurface | AbstractPatch, cells: int) -> np.ndarray:
    """Quadrilaterals of a surface, polynomial or parametric (quadrilaterals, 4, 3)."""
    return (
        quadrilaterals(shape, cells) if isinstance(shape, ImplicitSurface) else quadrilaterals_of_patches(shape, cells)
    )


@belongs(color="write colours=", colour="write colours=", colors="write colours=")
def voxels(cells: Voxels, ax: Any = None, *, colours: Sequence[str] = (BLUE, VERMILLION), legend: bool = True) -> Any:
    """Space axes with the kept cells of a surface: those that are proven to hold a point of it, and the others.

    Args:
        cells: what `voxelise` returned.
        ax: three-dimensional axes to draw on; None makes a figure.
        colours: of the proven cells and of the others.
        legend: whether a legend with their numbers is put above the axes.

    Raises:
        ValueError: plane axes.
    """
    ax = axes_for(ax, 3)
    places, proven = np.asarray(cells.cells), np.asarray(cells.proven)
    owner, faces = _visible_faces(places)
    corners = np.asarray(cells.lower) + np.asarray(cells.spacing) * faces
    edges = {"linewidth": 0.15, "edgecolor": "white"}
    rgb = np.where(proven[owner, None], rgb_of(colours[0]), rgb_of(colours[1]))
    add_faces(ax, corners, rgb, "voxels", 1.0, **edges)
    for colour, name, count in zip(colours, ("proven", "not proven"), (proven.sum(), (~proven).sum()), strict=True):
        if count:
            label = f"{name} ({count})"
            draw(ax, np.full((1, 3), np.nan), "key", color=colour, label=label, marker="s", linestyle="none")
    frame(ax, [corners.min((0, 1)), corners.max((0, 1))])
    if legend:
        legend_above(ax, 2)
    return ax


def section(
    shape: ImplicitSurface,
    cells: Voxels,
    ax: Any = None,
    *,
    axis: int = 2,
    at: float | None = None,
    legend: bool = True,
) -> Any:
    """Plane axes with a layer of cells by what is known of them, and the curve in which a plane cuts the surface.

    A cell that is not kept is inside or outside: the polynomial has one sign on all of it, negative inside. A kept cell
    at the boundary is proven to hold a point of the surface, or it may hold one (hatched).

    Args:
        shape: the surface.
        cells: its cells, from `voxelise`.
        ax: plane axes to draw on; None makes a figure.
        axis: the coordinate that is constant: 0, 1 or 2.
        at: its value, which chooses the layer; by default the middle of the box.
        legend: whether a legend is put above the axes.

    Raises:
        TypeError: another kind of shape.
        ValueError: another axis, or a plane outside of the box.
    """
    check_surface("shape", shape)
    low, high = (np.asarray(end, float) for end in shape.box())
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
    x, y = np.meshgrid(*(np.linspace(low[k], high[k], _LINES) for k in (u, v)))
    values = shape(np.insert(np.stack([x, y], axis=-1), axis, at, axis=-1))
    ax.contour(x, y, np.asarray(values), levels=[0.0], colors="black", linewidths=1.0).set_gid("curve")
    finish(ax)
    for name, k in (("x", u), ("y", v)):
        getattr(ax, f"set_{name}label")(f"${'xyz'[k]}$", fontsize=TEXT_POINTS)
    if legend:
        _name_classes(ax, f"${'xyz'[axis]}$ = {at:.4g}")
    return ax


_INSIDE, _OUTSIDE, _PROVEN, _KEPT = range(4)
_CLASSES = (("inside", PALE_BLUE), ("outside", "white"), ("boundary", ORANGE), ("not proven", VERMILLION))


def _classes(shape: ImplicitSurface, cells: Voxels, axis: int, layer: int, counts: np.ndarray) -> np.ndarray:
    """What is known of each cell of a layer."""
    u, v = (k for k in range(3) if k != axis)
    places = np.insert(np.argwhere(np.ones((counts[u], counts[v]))), axis, layer, axis=-1)
    centres = np.asarray(cells.lower) + np.asarray(cells.spacing) * (places + 0.5)
    classes = np.where(np.asarray(shape(centres)) < 0, _INSIDE, _OUTSIDE).reshape(counts[u], counts[v])
    kept, proven = np.asarray(cells.cells), np.asarray(cells.proven)
    here = kept[:, axis] == layer
    classes[tuple(kept[here][:, [u, v]].T)] = np.where(proven[here], _PROVEN, _KEPT)
    return classes


def _draw_classes(ax: Any, x: np.ndarray, y: np.ndarray, classes: np.ndarray) -> None:
    from matplotlib.colors import ListedColormap

    shown = {"cmap": ListedColormap([colour for _, colour in _CLASSES]), "vmin": -0.5, "vmax": len(_CLASSES) - 0.5}
    ax.pcolormesh(x, y, classes.T, gid="cells", edgecolors=GREY, linewidth=0.1, **shown)
    unproven = np.ma.masked_where(classes != _KEPT, classes)
    if unproven.count():
        ax.pcolor(x, y, unproven.T, gid="unproven", hatch="////", edgecolor="black", linewidth=0.0, **shown)


def _name_classes(ax: Any, plane: str) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys: list[Any] = [
        Patch(facecolor=colour, edgecolor="black", linewidth=0.5, hatch="////" if k == _KEPT else None, label=name)
        for k, (name, colour) in enumerate(_CLASSES)
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
