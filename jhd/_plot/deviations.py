"""Pictures of a deviation: a shape colored by its distance to another, the histogram, and the farthest point."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jhd._distance.cells.weighted import shares_below
from jhd._distance.deviation_solution import Deviation, DistanceSamples
from jhd._plot.axes import BLUE, COLUMN_INCHES, ORANGE, TEXT_POINTS, VERMILLION, axes_for, draw, finish, mark
from jhd._plot.colored import DrawnPieces, distances_at, pieces_of, section
from jhd._plot.faces import frame
from jhd._plot.solutions import distance_text
from jhd._results.solution import HausdorffSolution, name_of
from jhd._shapes.as_shape import Shape, ShapeLike, as_shape
from jhd._shapes.foreign import Axes

# Positions in a whole picture of the shape in space or in the plane, the color bar, the histogram and the inset.
_SPACE, _PLANE, _BAR = (0.05, 0.45, 0.63, 0.52), (0.18, 0.5, 0.53, 0.47), (0.76, 0.52, 0.03, 0.44)
_HISTOGRAM, _SECTION = (0.16, 0.1, 0.38, 0.23), (0.655, 0.1, 0.33, 0.23)
# The inset of a picture that has no histogram.
_SECTION_ALONE = (0.2, 0.1, 0.6, 0.23)


def deviation(
    found: Deviation,
    ax: Axes | None = None,
    *,
    labels: Sequence[str] = ("A", "B"),
    unit: str | None = None,
    witness: bool = True,
    color_bar: bool = True,
) -> Axes:
    """Axes with `a` colored by its distance to `b`, and the farthest point.

    Without axes it creates a whole figure one column wide. Below the shape are the histogram of the distances and an
    inset of the farthest point: a section of both shapes through this point and its foot. Shapes in space are seen from
    the side of the farthest point.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> found = jhd.deviation(jhd.polyline([(0, 0), (1, 0)]), jhd.point_set([(0, 0)]))
    >>> jhd.plot.deviation(found, Figure().add_subplot(), color_bar=False).lines[0].get_gid()
    'witness'

    Args:
        found: result of jhd.deviation.
        ax: matplotlib axes; shapes in space need axes with projection="3d". None creates a figure.
        labels: names of both shapes.
        unit: unit of the coordinates, for the labels. None omits it.
        witness: whether to mark the farthest point.
        color_bar: whether to draw a color bar; it takes some room from the given axes.

    Returns:
        The axes of the shape. The axes of the histogram and the inset are in `ax.figure.axes`, with the gids
        `histogram` and `inset`.

    Raises:
        ValueError: a shape in space is drawn on plane axes.
    """
    if not isinstance(found, Deviation):
        got = type(found).__name__
        raise TypeError(
            f"found is a {got}; needs the result of jhd.deviation. plot.distances draws a HausdorffSolution."
        )
    shown = _ColoredPair(found.a, found.b, found.maximum, labels, unit, found.samples)
    drawn = _drawn(shown, ax, witness, color_bar, _SECTION)
    if ax is None:
        histogram(found, drawn.figure.add_axes(_HISTOGRAM, gid="histogram"), labels=labels, unit=unit)
    return drawn


def distances(
    a: ShapeLike,
    b: ShapeLike,
    solution: HausdorffSolution,
    ax: Axes | None = None,
    *,
    labels: Sequence[str] = ("A", "B"),
    unit: str | None = None,
    witness: bool = True,
    color_bar: bool = True,
) -> Axes:
    """Axes with the shape that contains the witness of a distance, colored by its distance to the opposite shape.

    Like `deviation`, for shapes of all kinds and from the solution alone, so without the histogram. Without axes it
    creates a whole figure one column wide, with an inset of the farthest point.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> a, b = jhd.polyline([(0, 0), (1, 0)]), jhd.polyline([(0, 1), (1, 1)])
    >>> jhd.plot.distances(a, b, jhd.hausdorff(a, b), Figure().add_subplot(), color_bar=False).lines[0].get_gid()
    'witness'

    Args:
        a: first shape.
        b: second shape, of the same dimension.
        solution: Hausdorff distance of both shapes. If its witness lies on `b`, then `b` is the colored shape.
        ax: matplotlib axes; shapes in space need axes with projection="3d". None creates a figure.
        labels: names of both shapes.
        unit: unit of the coordinates, for the labels. None omits it.
        witness: whether to mark the farthest point.
        color_bar: whether to draw a color bar; it takes some room from the given axes.

    Returns:
        The axes of the shape. The axes of the inset are in `ax.figure.axes`, with the gid `inset`.

    Raises:
        TypeError: an object is no shape.
        ValueError: a shape in space is drawn on plane axes.
    """
    a, b = as_shape(a), as_shape(b)
    shown = _ColoredPair(a, b, solution, labels, unit)
    if name_of(solution.direction) == "b_to_a":
        shown = _ColoredPair(b, a, solution, labels[::-1], unit)
    return _drawn(shown, ax, witness, color_bar, _SECTION_ALONE)


def histogram(
    found: Deviation, ax: Axes | None = None, *, labels: Sequence[str] = ("A", "B"), unit: str | None = None
) -> Axes:
    """Axes with the histogram of the distances: the fraction of `a`, by length, area or number, at each distance.

    Each part of `a` is counted by the mean of the affine functions that bound its distance, or evenly between its
    bounds. The mean, the root mean square and the maximum are marked.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> found = jhd.deviation(jhd.polyline([(0, 0), (1, 0)]), jhd.point_set([(0, 0)]))
    >>> jhd.plot.histogram(found, Figure().add_subplot()).get_ylabel()
    'fraction of A (%)'

    Args:
        found: result of jhd.deviation.
        ax: plane matplotlib axes. None creates a figure.
        labels: names of both shapes.
        unit: unit of the coordinates, for the labels. None omits it.

    Returns:
        The axes.
    """
    ax = axes_for(ax, 2)
    parts = found.samples
    known = np.isfinite(parts.upper)
    weight = parts.fraction[known].sum(axis=1)
    top = float(found.maximum.value)
    edges = np.linspace(0.0, top if top > 0 else 1.0, 41)
    lower, upper = (np.minimum(ends[known], edges[-1]) for ends in (parts.lower, parts.upper))
    middle = np.mean(parts.ends[known], axis=2)
    affine = np.max(middle, axis=1) > np.min(middle, axis=1)
    below = _weights_below(edges[1:-1], lower[~affine], upper[~affine], weight[~affine])
    below += [weight[affine] @ np.mean(shares_below(middle[affine], end), axis=0) for end in edges[1:-1]]
    heights = np.diff(np.concatenate([[0.0], below, [weight.sum()]]))
    ax.bar(edges[:-1], 100 * heights / weight.sum(), np.diff(edges), align="edge", color=BLUE, gid="histogram_bars")
    marks = (("mean", float(found.mean), "-", "black"), ("rms", float(found.rms), "--", "black"))
    for name, value, style, color in (*marks, ("max.", top, ":", VERMILLION)):
        ax.axvline(value, color=color, linestyle=style, linewidth=1.2, label=name, gid=name)
    ax.set_xlim(0, 1.04 * edges[-1])
    ax.set_xlabel(_length("distance", labels, unit), fontsize=TEXT_POINTS)
    ax.set_ylabel(f"fraction of {labels[0]} (%)", fontsize=TEXT_POINTS)
    ax.tick_params(labelsize=TEXT_POINTS)
    ax.locator_params(axis="x", nbins=3)
    ax.locator_params(axis="y", nbins=4)
    place: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "borderaxespad": 0.2}
    ax.legend(ncols=3, fontsize=TEXT_POINTS, frameon=False, columnspacing=0.7, handlelength=1.1, **place)
    return ax


def _weights_below(ends: np.ndarray, lower: np.ndarray, upper: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """The weight of distances up to each of the ends; the distances of a part lie evenly between its bounds."""
    width = upper - lower
    some = width > 0
    return np.array(
        [
            weight @ np.where(some, np.clip((end - lower) / np.where(some, width, 1.0), 0.0, 1.0), lower <= end)
            for end in ends
        ]
    )


class _ColoredPair(NamedTuple):
    """A shape to color, the shape to which distances are taken, the largest distance, and known samples."""

    a: Shape
    b: Shape
    maximum: HausdorffSolution
    labels: Sequence[str]
    unit: str | None
    samples: DistanceSamples | None = None


def _drawn(shown: _ColoredPair, ax: Any, witness: bool, color_bar: bool, section: tuple[float, ...]) -> Any:
    """The axes with the colored shape; if None is given, a new figure with its color bar and the inset."""
    if ax is not None:
        ax = axes_for(ax, shown.a.dim)
        _colored(shown, ax, witness, ax if color_bar else None)
        return ax
    import matplotlib.pyplot as plt

    # Height of a whole picture as a fraction of its width, in a column.
    figure = plt.figure(figsize=(COLUMN_INCHES, 1.5 * COLUMN_INCHES))
    space = shown.a.dim == 3
    ax = figure.add_axes(_SPACE if space else _PLANE, projection="3d" if space else None)
    bar = figure.add_axes(_BAR) if color_bar else None
    _colored(shown, ax, witness, None, bar)
    if space:
        # Nearer to its axis, the name of z stays clear of the border and of the color bar.
        ax.zaxis.labelpad = -2
    place: Any = section
    _inset(shown, figure.add_axes(place, gid="inset"))
    return ax


def _colored(shown: _ColoredPair, ax: Any, witness: bool, beside: Any, bar: Any = None) -> None:
    """The shape in colors, and the color bar next to some axes or in its own axes."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    pieces = pieces_of(shown.a)
    top = float(shown.maximum.value)
    values = distances_at(pieces.points, shown.b, top, shown.samples)
    # Colors readable in gray and by color-blind readers.
    colors = ScalarMappable(Normalize(0.0, top if top > 0 else 1.0), "viridis")
    rgba: Any = colors.to_rgba(np.mean(values[pieces.rows], axis=1))
    {1: _as_points, 2: _as_lines, 3: _as_faces}[pieces.rows.shape[1]](ax, pieces, rgba)
    point = np.asarray(shown.maximum.witness.point)
    low, high = pieces.points.min(axis=0), pieces.points.max(axis=0)
    if shown.a.dim == 3:
        frame(ax, [low, high])
        _sized(ax, high - low)
        if pieces.rows.shape[1] == 3:
            _turned(ax, point - 0.5 * (low + high))
    else:
        ax.set_xlim(*_widened(low[0], high[0]))
        ax.set_ylim(*_widened(low[1], high[1]))
        finish(ax)
    if witness and top > 0:
        mark(ax, point[None], "witness")
    if beside is not None or bar is not None:
        made = ax.figure.colorbar(colors, cax=bar, ax=beside, shrink=0.7 if bar is None else 1.0)
        made.set_label(_length("distance", shown.labels, shown.unit), fontsize=TEXT_POINTS)
        made.ax.tick_params(labelsize=TEXT_POINTS)
        made.ax.locator_params(nbins=5)


def _widened(low: float, high: float) -> tuple[float, float]:
    room = 0.06 * (high - low) or 0.5
    return low - room, high + room


def _length(what: str, labels: Sequence[str], unit: str | None) -> str:
    return f"{what} to {labels[1]}" + (f" ({unit})" if unit else "")


def _as_points(ax: Any, pieces: DrawnPieces, rgba: np.ndarray) -> None:
    # The colors are the distances: colors of far points do not fade.
    style = {"depthshade": False} if ax.name == "3d" else {}
    ax.scatter(*pieces.points.T, c=rgba, s=6, linewidths=0, gid="deviation", **style)


def _as_lines(ax: Any, pieces: DrawnPieces, rgba: np.ndarray) -> None:
    if ax.name == "3d":
        from mpl_toolkits.mplot3d.art3d import Line3DCollection

        ax.add_collection3d(Line3DCollection(pieces.corners, colors=rgba, linewidths=2.2, gid="deviation"))
        return
    from matplotlib.collections import LineCollection

    ax.add_collection(
        LineCollection(list(pieces.corners), colors=rgba, linewidths=2.6, capstyle="round", gid="deviation")
    )


def _as_faces(ax: Any, pieces: DrawnPieces, rgba: np.ndarray) -> None:
    """The colors show the distance, so no light changes them; nearer faces hide farther ones."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    # Thousands of faces as paths would make files that no viewer opens; edges close the seams between them.
    faces = Poly3DCollection(pieces.corners, facecolors=rgba, edgecolors=rgba, linewidth=0.3, rasterized=True)
    faces.set_gid("deviation")
    ax.add_collection3d(faces, autolim=False)


def _sized(ax: Any, extent: np.ndarray) -> None:
    """Room for the labels of the axes, of which short ones have fewer ticks."""
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    sides = np.ptp(limits, axis=1)
    # A long box is as long as a cube's diagonal, and its labels stand beyond its ends.
    ax.set_box_aspect(sides, zoom=0.65 * np.sqrt(np.linalg.norm(sides) / np.max(sides)))
    for name, share, ends in zip("xyz", extent / (np.max(extent) or 1.0), limits, strict=True):
        # Axes shorter than this fraction of the longest have only two ticks.
        if share >= 0.35:
            ax.locator_params(axis=name, nbins=int(np.clip(round(4 * share), 2, 4)))
            continue
        unit = 10.0 ** np.floor(np.log10(np.ptp(ends) / 2))
        inside = np.trunc(ends / unit) * unit
        getattr(ax, f"set_{name}ticks")(np.unique(np.round(inside, 12)))


def _turned(ax: Any, outward: np.ndarray) -> None:
    """Turn the view so that a point in this direction from the middle is seen from the front."""
    level = float(np.hypot(outward[0], outward[1]))
    azimuth = np.degrees(np.arctan2(outward[1], outward[0])) + 25 if level > 0 else -60.0
    steep = np.degrees(np.arctan2(outward[2], level)) if np.any(outward != 0) else 25.0
    ax.view_init(elev=float(np.clip(steep + 15, -15, 40)), azim=float(azimuth))
    # The mark lies on the surface, and drawing by depth would hide half of it.
    ax.computed_zorder = False


def _inset(shown: _ColoredPair, ax: Any) -> None:
    """The section of both shapes through the farthest point and its foot, along a direction of a."""
    found = shown.maximum
    point, foot = (np.asarray(x, float) for x in (found.witness.point, found.witness.feet[0]))
    distance = float(found.value)
    size = float(np.max(np.ptp(pieces_of(shown.a).points, axis=0)))
    # The inset shows this many distances to each side, at least this fraction of the shapes' size.
    reach = max(1.6 * distance, 0.02 * size) or 1.0
    up = point - foot
    up = up / np.linalg.norm(up) if np.any(up != 0) else np.eye(len(point))[-1]
    across = _across(shown.a, point, up)
    first, second = shown.labels
    for shape, color, style, name in ((shown.a, BLUE, "-", first), (shown.b, ORANGE, (0, (4, 1.2)), second)):
        lines = _flat_lines(shape, point, np.stack([across, up]), reach)
        draw(ax, lines, f"section_{name}", color=color, linestyle=style, linewidth=1.2, label=name)
    draw(ax, np.array([[0, 0], [0, -distance]]), "joining_line", color="black", linewidth=0.8)
    mark(ax, np.zeros((1, 2)), "inset_witness")
    mark(ax, np.array([[0, -distance]]), "inset_foot", square=True)
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-0.5 * distance - reach, -0.5 * distance + reach)
    ax.set_aspect("equal")
    ax.set_xticks([])
    ax.set_yticks([])
    place: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "borderaxespad": 0.2}
    # The marks need no names: they match the picture above.
    ax.legend(fontsize=TEXT_POINTS, frameon=False, handlelength=1.8, labelspacing=0.2, **place)
    ax.set_xlabel(distance_text(found).replace(" ≤ $d$ ≤ ", " ≤ $d$\n≤ "), fontsize=TEXT_POINTS)


def _across(shape: Any, point: np.ndarray, up: np.ndarray) -> np.ndarray:
    """A unit direction along the shape at a point, made normal to `up`."""
    if len(up) == 2:
        return np.array([up[1], -up[0]])
    pieces = pieces_of(shape)
    nearest = np.argmin(np.sum((pieces.points - point) ** 2, axis=1))
    held = pieces.corners[np.any(pieces.rows == nearest, axis=1)]
    sides = [held[:, k] - held[:, 0] for k in range(1, held.shape[1])] or [np.eye(3)]
    along = np.concatenate(sides)
    along = along - (along @ up)[:, None] * up
    best = along[np.argmax(np.sum(along**2, axis=1))]
    if not np.any(np.abs(best) > 0):
        best = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    return best / np.linalg.norm(best)


def _flat_lines(shape: Any, point: np.ndarray, axes: np.ndarray, reach: float) -> np.ndarray:
    """Lines of a shape in a plane, separated by rows of NaN; for space curves and points, the parts near the plane."""
    pieces = pieces_of(shape)
    if pieces.rows.shape[1] == 3:
        lines = section(pieces, point, np.cross(*axes))
    else:
        lines = pieces.corners[:, [0, -1]]
        if lines.shape[2] == 3:
            away = np.abs((lines - point) @ np.cross(*axes))
            lines = lines[np.max(away, axis=1) <= reach]
    flat = (lines - point) @ axes.T
    near = np.min(np.max(np.abs(flat), axis=2), axis=1) <= 3 * reach
    flat = flat[near]
    if pieces.rows.shape[1] == 1:
        # A point is drawn as a short stroke.
        flat = flat + 0.03 * reach * np.array([[-1.0, 0.0], [1.0, 0.0]])
    return _chained(flat, 1e-6 * reach)


def _chained(lines: np.ndarray, room: float) -> np.ndarray:
    """Join lines (lines, 2, 2) at common ends, so that dashes continue; rows of NaN separate the joined lines."""
    rows = np.arange(len(lines))
    ends: dict[tuple[int, ...], list[int]] = {}
    keys = [[tuple(end) for end in line] for line in np.round(lines / room).astype(np.int64).tolist()]
    for k, pair in enumerate(keys):
        for key in pair:
            ends.setdefault(key, []).append(k)
    left, chains = set(rows.tolist()), []
    while left:
        start = left.pop()
        chain = [lines[start, 0], lines[start, 1]]
        for forward in (True, False):
            key = keys[start][1 if forward else 0]
            while (after := next((k for k in ends[key] if k in left), None)) is not None:
                left.remove(after)
                end = 1 if keys[after][0] == key else 0
                key = keys[after][end]
                chain.insert(len(chain) if forward else 0, lines[after, end])
        chains.append(np.array([*chain, [np.nan, np.nan]]))
    return np.concatenate(chains) if chains else np.full((1, 2), np.nan)
