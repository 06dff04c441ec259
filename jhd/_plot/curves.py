"""Pictures of curves, and of the distance along a curve."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jhd._arithmetic.bernstein import basis
from jhd._distance.project import project
from jhd._plot.axes import BLUE, GRAY, TEXT_POINTS, axes_for, draw, finish, mark
from jhd._results.solution import HausdorffSolution
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd._shapes.foreign import Axes


def curve(
    shape: ShapeLike,
    ax: Axes | None = None,
    *,
    color: str = BLUE,
    linestyle: str | tuple[float, Sequence[float]] = "-",
    label: str | None = None,
    control_polygon: bool = True,
    samples: int = 32,
) -> Axes:
    """Axes with a plane or space curve; point sets are drawn as dots, contours that are not joined stay separate.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> ax = jhd.plot.curve(jhd.polyline([(0, 0), (1, 1)]), Figure().add_subplot())
    >>> [line.get_gid() for line in ax.lines]
    ['curve']

    Args:
        shape: curve, or an object that jhd.as_shape converts to one.
        ax: matplotlib axes; a space curve needs axes with projection="3d". None creates a figure.
        color: color of the curve and, faint, of its control polygon.
        linestyle: line style of the curve, as in matplotlib.
        label: name in a legend. None means no entry.
        control_polygon: whether to draw the control polygons of segments of degree two or more.
        samples: number of steps for each segment of degree two or more.

    Returns:
        The axes.

    Raises:
        TypeError: the shape is no curve.
        ValueError: a space curve is drawn on plane axes.
    """
    taken = taken_as("shape", shape)
    check_curve("shape", taken)
    pieces = taken.segments()
    ax = axes_for(ax, pieces.dim)
    if pieces.degree == 0:
        draw(ax, pieces.control_points[:, 0], "curve", color=color, marker=".", linestyle="none", label=label)
    else:
        t = np.linspace(0.0, 1.0, (samples if pieces.degree > 1 else 1) + 1)
        if control_polygon and pieces.degree > 1:
            polygon = _with_gaps(pieces, np.asarray(pieces.control_points))
            style: dict[str, Any] = {"color": color, "linewidth": 0.5, "marker": ".", "markersize": 2.5, "alpha": 0.45}
            draw(ax, polygon, "control_polygon", **style)
        line = _with_gaps(pieces, _sample(pieces, t))
        draw(ax, line, "curve", color=color, linestyle=linestyle, linewidth=1.2, label=label)
    finish(ax)
    return ax


def distance_profile(
    a: ShapeLike,
    b: ShapeLike,
    ax: Axes | None = None,
    solution: HausdorffSolution | None = None,
    *,
    labels: Sequence[str] = ("A", "B"),
    unit: str = "input units",
    color: str = BLUE,
    samples: int | None = None,
) -> Axes:
    """Axes with the distance profile t -> d(a(t), b), whose largest value is the directed Hausdorff distance.

    The parameter is global: segment k has the parameters [k, k + 1]. Circles mark the local maxima that the samples
    show, which are the candidates for the witness. Vertical lines mark the boundaries of segments.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> a, b = jhd.polyline([(0, 0), (1, 0)]), jhd.polyline([(0, 1), (1, 1)])
    >>> jhd.plot.distance_profile(a, b, Figure().add_subplot()).get_ylabel()
    'distance to B (input units)'

    Args:
        a: curve along which the distance is drawn; of a point set, every point gives one dot.
        b: curve to which the distances are measured, of the same dimension.
        ax: plane matplotlib axes. None creates a figure.
        solution: Hausdorff distance of both curves. Its value is drawn as a level, and its witness if it lies on `a`.
        labels: names of both curves on the axes.
        unit: unit of the coordinates, for the labels.
        color: color of the profile.
        samples: number of steps for each segment of `a`. None means about 1500 steps in total.

    Returns:
        The axes.

    Raises:
        TypeError: a shape is no curve.
        ValueError: the dimensions differ, `samples` is below 1, or `solution` is a batch.
    """
    first, second = taken_as("a", a), taken_as("b", b)
    check_pair(first, second)
    pieces = first.segments()
    # In all more samples than a column has pixels at 300 dpi.
    steps = int(np.clip(1500 // pieces.count, 8, 256)) if samples is None else samples
    if steps < 1:
        raise ValueError(f"samples is {steps}; needs at least 1.")
    ax = axes_for(ax, 2)
    t = np.linspace(0.0, 1.0, steps + 1) if pieces.degree > 0 else np.zeros(1)
    distances = np.asarray(project(_sample(pieces, t), second, throw=False).distance)
    place = np.arange(pieces.count)[:, None] + t
    line = _with_gaps(pieces, np.stack([place, distances], axis=-1))
    style = {"linewidth": 1.2} if pieces.degree else {"linestyle": "none", "marker": "."}
    # Many boundaries would hide the profile; a selection of them would have no meaning.
    if 1 < pieces.count <= 64 and pieces.degree:
        for k in range(1, pieces.count):
            ax.axvline(k, color=GRAY, linewidth=0.4, alpha=0.35, zorder=0, gid="segment_boundary")
    draw(ax, line, "profile", color=color, **style)
    if pieces.degree:
        tops = _local_maxima(distances, np.asarray(pieces.next_segment))
        rings = {"marker": "o", "markersize": 4, "markerfacecolor": "white", "markeredgecolor": color}
        draw(
            ax,
            np.stack([place[tops], distances[tops]], axis=-1),
            "candidates",
            linestyle="none",
            clip_on=False,
            **rings,
        )
    if solution is not None:
        _mark_level(ax, pieces, solution)
    ax.set_xlim((0, pieces.count) if pieces.degree else (-0.5, pieces.count - 0.5))
    ax.set_ylim(bottom=0)
    what = "parameter $t$ on" if pieces.degree else "index of the point of"
    ax.set_xlabel(f"{what} {labels[0]}", fontsize=TEXT_POINTS)
    ax.set_ylabel(f"distance to {labels[1]} ({unit})", fontsize=TEXT_POINTS)
    ax.tick_params(labelsize=TEXT_POINTS)
    return ax


def check_pair(a: AbstractCurve, b: AbstractCurve) -> None:
    """Raise an error unless both are curves of one dimension."""
    check_curve("a", a)
    check_curve("b", b)
    dims = a.segments().dim, b.segments().dim
    if dims[0] != dims[1]:
        raise ValueError(f"a has {dims[0]} coordinates; b has {dims[1]}.")


def _sample(pieces: BezierSegments, t: np.ndarray) -> np.ndarray:
    """Points of all segments at the local parameters t, (segments, samples, dim).

    In NumPy, by the basis: a compiled function for every number of segments would take longer than the picture.
    """
    values = np.einsum("ti,kid->ktd", basis(pieces.degree, t), np.asarray(pieces.homogeneous))
    return values if pieces.weights is None else values[..., :-1] / values[..., -1:]


def _with_gaps(pieces: BezierSegments, samples: np.ndarray) -> np.ndarray:
    """The rows of all segments (segments, samples, width) as one list; a NaN row if the next one does not follow."""
    rows: list[np.ndarray] = []
    gap = np.full((1, samples.shape[-1]), np.nan)
    for k, next_segment in enumerate(np.asarray(pieces.next_segment)):
        rows += [samples[k]] if next_segment == k + 1 else [samples[k], gap]
    return np.concatenate(rows)


def _local_maxima(distances: np.ndarray, next_segment: np.ndarray) -> np.ndarray:
    """Mask of the samples (segments, samples) not below their neighbors, across joints; of a plateau the first."""
    previous = np.full(next_segment.shape, -1)
    previous[next_segment[next_segment >= 0]] = np.flatnonzero(next_segment >= 0)
    before = np.where(previous >= 0, distances[previous, -2], -np.inf)
    after = np.where(next_segment >= 0, distances[next_segment, 1], -np.inf)
    # A smaller rise is rounding, not a maximum.
    level = 1e-9 * np.max(distances)
    left = np.concatenate([before[:, None], distances[:, :-1]], axis=1)
    right = np.concatenate([distances[:, 1:], after[:, None]], axis=1)
    tops = (distances > left + level) & (distances >= right - level)
    tops[next_segment >= 0, -1] = False  # it is the first sample of the segment that follows
    return tops


def _mark_level(ax: Any, pieces: BezierSegments, solution: HausdorffSolution) -> None:
    """Draw the value as a horizontal line and, if the witness lies on this curve, the witness."""
    if np.ndim(solution.value) > 0:
        raise ValueError(f"solution is a batch of shape {np.shape(solution.value)}; draw one at a time.")
    value = float(solution.value)
    ax.axhline(value, color="black", linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=1, gid="level")
    segment, t, point = (np.asarray(x) for x in (solution.witness.element, solution.witness.t, solution.witness.point))
    if segment >= pieces.count or point.shape[-1] != pieces.dim:
        return
    here = _sample(pieces, np.atleast_1d(t))[int(segment), 0]
    size = np.max(np.abs(pieces.control_points))
    if np.max(np.abs(here - point)) <= 1e-5 * size:  # wide enough for float32, far below visible differences
        place = np.array([[segment + t * (pieces.degree > 0), value]])
        mark(ax, place, "witness", zorder=5, clip_on=False)
