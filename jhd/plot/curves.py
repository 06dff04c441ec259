"""Pictures of curves, and of the distance along one of them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jhd._results.solution import HausdorffSolution
from jhd.arithmetic.bernstein import basis
from jhd.distance.project import project
from jhd.plot.axes import BLUE, GREY, TEXT_POINTS, VERMILLION, axes_for, draw, finish
from jhd.shapes.as_shape import taken_as
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.slips import belongs

_PROFILE_SAMPLES = 1500  # in all; more than the pixels of a column at 300 dpi
_LEVEL = 1e-9  # share of the largest distance below which a rise is rounding, not a maximum


@belongs(color="write colour=")
def curve(
    shape: Any,
    ax: Any = None,
    *,
    colour: str = BLUE,
    linestyle: Any = "-",
    label: str | None = None,
    control_polygon: bool = True,
    samples: int = 32,
) -> Any:
    """Axes with a plane or space curve: a point set as dots, contours that are not joined left apart.

    Args:
        shape: the curve, or what jhd.as_shape takes for one, as in all of these.
        ax: axes to draw on, three-dimensional ones for a space curve; None makes a figure.
        colour: of the curve and, faint, of its control polygon.
        linestyle: of the curve, as matplotlib takes it.
        label: name in a legend.
        control_polygon: whether the control polygons are drawn (a polyline is its own).
        samples: steps for each segment of degree two or more.

    Raises:
        ValueError: a space curve on plane axes.
    """
    shape = taken_as("shape", shape)
    check_curve("shape", shape)
    pieces = shape.segments()
    ax = axes_for(ax, pieces.dim)
    if pieces.degree == 0:
        draw(ax, pieces.control_points[:, 0], "curve", color=colour, marker=".", linestyle="none", label=label)
    else:
        t = np.linspace(0.0, 1.0, (samples if pieces.degree > 1 else 1) + 1)
        if control_polygon and pieces.degree > 1:
            polygon = _with_gaps(pieces, np.asarray(pieces.control_points))
            style: dict[str, Any] = {"color": colour, "linewidth": 0.5, "marker": ".", "markersize": 2.5, "alpha": 0.45}
            draw(ax, polygon, "control_polygon", **style)
        line = _with_gaps(pieces, _sample(pieces, t))
        draw(ax, line, "curve", color=colour, linestyle=linestyle, linewidth=1.2, label=label)
    finish(ax)
    return ax


@belongs(color="write colour=")
def profile(
    a: Any,
    b: Any,
    ax: Any = None,
    solution: HausdorffSolution | None = None,
    *,
    labels: Sequence[str] = ("A", "B"),
    unit: str = "input units",
    colour: str = BLUE,
    samples: int | None = None,
) -> Any:
    """Axes with the distance profile t -> d(a(t), b): its largest value is the directed Hausdorff distance.

    The parameter is the global one: segment k carries [k, k + 1]. Local maxima, the candidates for the witness, are
    circled as far as the samples show them; vertical lines are the boundaries of segments.

    Args:
        a: the curve that is walked along; of a point set every point is one dot.
        b: the curve to which distances are measured.
        ax: plane axes to draw on; None makes a figure.
        solution: a distance of the two; its value is drawn as a level and, where its witness lies on `a`, the witness.
        labels: the names of the curves on the axes.
        unit: the unit of the coordinates, as the axis names it.
        colour: of the profile.
        samples: steps for each segment of a; about 1500 in all by default.

    Raises:
        ValueError: curves of different dimensions, samples below one, or a batch of solutions.
    """
    a, b = taken_as("a", a), taken_as("b", b)
    check_pair(a, b)
    pieces = a.segments()
    steps = int(np.clip(_PROFILE_SAMPLES // pieces.count, 8, 256)) if samples is None else samples
    if steps < 1:
        raise ValueError(f"samples is {steps}; needs at least 1.")
    ax = axes_for(ax, 2)
    t = np.linspace(0.0, 1.0, steps + 1) if pieces.degree > 0 else np.zeros(1)
    distances = np.asarray(project(_sample(pieces, t), b, throw=False).distance)
    place = np.arange(pieces.count)[:, None] + t
    line = _with_gaps(pieces, np.stack([place, distances], axis=-1))
    style = {"linewidth": 1.2} if pieces.degree else {"linestyle": "none", "marker": "."}
    # Many boundaries would hide the profile; every second or tenth of them would say nothing.
    if 1 < pieces.count <= 64 and pieces.degree:
        for k in range(1, pieces.count):
            ax.axvline(k, color=GREY, linewidth=0.4, alpha=0.35, zorder=0, gid="segment_boundary")
    draw(ax, line, "profile", color=colour, **style)
    if pieces.degree:
        tops = _local_maxima(distances, np.asarray(pieces.following))
        rings = {"marker": "o", "markersize": 4, "markerfacecolor": "white", "markeredgecolor": colour}
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
    """Raises an error unless both are curves of one dimension."""
    check_curve("a", a)
    check_curve("b", b)
    dims = a.segments().dim, b.segments().dim
    if dims[0] != dims[1]:
        raise ValueError(f"a has {dims[0]} coordinates; b has {dims[1]}.")


def _sample(pieces: BezierSegments, t: np.ndarray) -> np.ndarray:
    """Points of all segments at the local parameters t, (segments, samples, dim).

    In NumPy, by the basis: a compiled program for every number of segments would take longer than the picture.
    """
    values = np.einsum("ti,kid->ktd", basis(pieces.degree, t), np.asarray(pieces.homogeneous))
    return values if pieces.weights is None else values[..., :-1] / values[..., -1:]


def _with_gaps(pieces: BezierSegments, samples: np.ndarray) -> np.ndarray:
    """The rows of all segments (segments, samples, width) as one list; a NaN row where the next does not follow."""
    rows: list[np.ndarray] = []
    gap = np.full((1, samples.shape[-1]), np.nan)
    for k, following in enumerate(np.asarray(pieces.following)):
        rows += [samples[k]] if following == k + 1 else [samples[k], gap]
    return np.concatenate(rows)


def _local_maxima(distances: np.ndarray, following: np.ndarray) -> np.ndarray:
    """Mask of the samples (segments, samples) not below their neighbours, across joints; of a plateau the first."""
    previous = np.full(following.shape, -1)
    previous[following[following >= 0]] = np.flatnonzero(following >= 0)
    before = np.where(previous >= 0, distances[previous, -2], -np.inf)
    after = np.where(following >= 0, distances[following, 1], -np.inf)
    level = _LEVEL * np.max(distances)
    left = np.concatenate([before[:, None], distances[:, :-1]], axis=1)
    right = np.concatenate([distances[:, 1:], after[:, None]], axis=1)
    tops = (distances > left + level) & (distances >= right - level)
    tops[following >= 0, -1] = False  # it is the first sample of the segment that follows
    return tops


def _mark_level(ax: Any, pieces: BezierSegments, solution: HausdorffSolution) -> None:
    """The value as a horizontal line and, where the witness lies on this curve, its place."""
    if np.ndim(solution.value) > 0:
        raise ValueError(f"solution is a batch of shape {np.shape(solution.value)}; draw one at a time.")
    value = float(solution.value)
    ax.axhline(value, color="black", linewidth=0.8, linestyle=(0, (1, 1.5)), zorder=1, gid="level")
    segment, t, point = (np.asarray(x) for x in (solution.witness.segment, solution.witness.t, solution.witness.point))
    if segment >= pieces.count or point.shape[-1] != pieces.dim:
        return
    here = _sample(pieces, np.atleast_1d(t))[int(segment), 0]
    size = np.max(np.abs(pieces.control_points))
    if np.max(np.abs(here - point)) <= 1e-5 * size:  # wide enough for float32, far below what the eye sees
        place = np.array([[segment + t * (pieces.degree > 0), value]])
        edge = {"markeredgecolor": "black", "markeredgewidth": 0.8, "zorder": 5, "clip_on": False}
        draw(ax, place, "witness", marker="o", markersize=5.5, color=VERMILLION, linestyle="none", **edge)
