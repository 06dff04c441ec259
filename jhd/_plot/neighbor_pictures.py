"""Pictures of the nearest shapes of some queries: each neighbor over its query, with the distance."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np

from jhd._distance.collections.neighbors import Neighbors
from jhd._plot.axes import BLUE, COLUMN_INCHES, ORANGE, TEXT_POINTS, finish
from jhd._plot.colored import pieces_of
from jhd._plot.curves import curve
from jhd._plot.faces import shaded_shapes
from jhd._plot.solutions import bounds_text
from jhd._shapes.as_shape import ShapeLike, as_shape
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.foreign import Axes

_COLORS, _WHAT = (BLUE, ORANGE), ("query", "neighbor")
_DASHES: tuple[Any, ...] = ("-", (0, (4, 1.2)))


def neighbors(
    queries: Sequence[ShapeLike],
    shapes: Sequence[ShapeLike],
    found: Neighbors,
    axes: np.ndarray | Sequence[Sequence[Axes]] | None = None,
    *,
    rows: Sequence[int] | None = None,
    query_names: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
) -> np.ndarray:
    """Axes in rows: a query alone, then each of its nearest shapes drawn over it, nearest first, with the distances.

    All panels of a row have the same scale. If further shapes may be as near as the last one of a row, their number is
    written above the last panel.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> squares = [jhd.polyline([(0, 0), (s, 0), (s, s), (0, s)], closed=True) for s in (1, 2, 4)]
    >>> queries = [jhd.polyline([(0, 0), (3, 0), (3, 3), (0, 3)], closed=True)]
    >>> found = jhd.nearest_shapes(queries, squares)
    >>> jhd.plot.neighbors(queries, squares, found, Figure().subplots(1, 2, squeeze=False)).shape
    (1, 2)

    Args:
        queries: queries that were passed to jhd.nearest_shapes.
        shapes: shapes that were passed to jhd.nearest_shapes.
        found: result of jhd.nearest_shapes.
        axes: array of axes, one row for each drawn query with 1 + neighbors columns; shapes in space need
            projection="3d". None creates a figure.
        rows: indices of the queries to draw. None means the first eight.
        query_names: names of the queries. None means their indices.
        names: names of the shapes. None means their indices.

    Returns:
        The array of axes.

    Raises:
        TypeError: an object is no shape, or `found` is no result of jhd.nearest_shapes.
        ValueError: `axes` has the wrong shape, or there is no query.
    """
    if not isinstance(found, Neighbors):
        got = type(found).__name__
        raise TypeError(f"found is a {got}; needs the result of jhd.nearest_shapes: neighbors(queries, shapes, found).")
    # Queries drawn by default: more are too many for a page.
    chosen = list(range(min(len(queries), 8)) if rows is None else rows)
    if not chosen:
        raise ValueError("there is no query to draw.")
    width = 1 + found.index.shape[1]
    dim = as_shape(queries[0]).dim
    drawn = _figure(len(chosen), width, dim) if axes is None else np.asarray(axes)
    if drawn.shape != (len(chosen), width):
        raise ValueError(f"axes has shape {drawn.shape}; needs {(len(chosen), width)}, a row for each query.")
    for row, panels in zip(chosen, drawn, strict=True):
        query = as_shape(queries[row])
        others = [as_shape(shapes[k]) for k in found.index[row]]
        _titled(panels[0], str(row) if query_names is None else query_names[row])
        for ax, pair in zip(panels, [[query], *([query, other] for other in others)], strict=True):
            _draw(ax, pair)
        for place, (ax, k) in enumerate(zip(panels[1:], found.index[row], strict=True)):
            _titled(ax, str(k) if names is None else names[int(k)], _distance(found, row, place))
        _one_scale(panels, [query, *others])
    return drawn


def _figure(rows: int, columns: int, dim: int) -> Any:
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D

    # Width and height of a panel in inches: room for a distance in writing above a shape.
    size = max(COLUMN_INCHES, 0.95 * columns), 1.2 * rows + 0.3
    space: dict[str, Any] = {"subplot_kw": {"projection": "3d"}} if dim == 3 else {}
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False, **space)
    styles = zip(_COLORS, _DASHES, _WHAT, strict=True)
    keys = [Line2D([], [], color=color, linestyle=dashes, label=what) for color, dashes, what in styles]
    figure.legend(handles=keys, loc="outside lower center", ncols=2, fontsize=TEXT_POINTS, frameon=False)
    return axes


def _draw(ax: Any, shapes: list[Any]) -> None:
    """Curves as lines; surfaces together, so that faces in front hide faces behind."""
    for surfaces, group in groupby(enumerate(shapes), lambda item: not isinstance(item[1], AbstractCurve)):
        numbers, drawn = zip(*group, strict=True)
        colors = [_COLORS[k] for k in numbers]
        if surfaces:
            # The last corner twice makes a quadrilateral of a triangle.
            faces = [pieces_of(shape).corners[:, [0, 1, 2, 2]] for shape in drawn]
            # Opacity of surfaces that lie over each other.
            shaded_shapes(ax, faces, colors, [None] * len(drawn), 0.6)
            continue
        for k, shape in zip(numbers, drawn, strict=True):
            curve(shape, ax, color=_COLORS[k], linestyle=_DASHES[k], control_polygon=False)


def _titled(ax: Any, name: str, distance: str = "") -> None:
    # A dollar would begin a formula, as it does in the distance.
    plain = name.replace("$", r"\$")
    ax.set_title(f"{plain}\n{distance}" if distance else plain, fontsize=TEXT_POINTS)


def _distance(found: Neighbors, row: int, place: int) -> str:
    """The distance to four digits or its bounds, and at the last one how many more may be as near."""
    text = bounds_text(found.lower[row, place], found.upper[row, place]).replace(" ≤ $d$ ≤ ", " ≤ $d$\n≤ ")
    ties = len(found.ties[row])
    last = place == found.index.shape[1] - 1
    return f"{text}\n{ties} more tied" if ties and last else text


def _one_scale(panels: Any, shapes: list[Any]) -> None:
    """Set common limits in all panels of a row, and remove the axes."""
    points = np.concatenate([pieces_of(shape).points for shape in shapes])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.04 * np.max(high - low) or 0.5
    for ax in panels:
        for name, start, end in zip("xyz", low - room, high + room, strict=False):
            getattr(ax, f"set_{name}lim")(start, end)
        finish(ax)
        ax.set_axis_off()
