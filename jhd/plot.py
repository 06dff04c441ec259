"""Pictures: a curve, the witness of a distance, both together, and the distance profile along a curve.

Every function takes axes and returns them; without axes it makes a figure 85 mm wide (one column of a journal) with
pyplot, which is imported only then. Nothing global is changed. Lengths on the axes carry the unit of the input
coordinates. The colours are those of Okabe & Ito, and line styles and markers tell the same things apart in grey. Every
artist has a gid (`witness`, `feet`, ...), by which it can be found and restyled, also in an SVG.

A picture is no proof: curves and profiles are drawn from samples.
"""

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import Any

import numpy as np

from jhd.arithmetic.bernstein import binomials
from jhd.distance.projection import project
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.solution import HausdorffSolution

BLUE, ORANGE, VERMILLION, GREY = "#0072B2", "#E69F00", "#D55E00", "#707070"

_COLUMN_INCHES = 85 / 25.4
_POINTS = 8  # size of text that stays legible when a column is printed
_PROFILE_SAMPLES = 1500  # in all; more than the pixels of a column at 300 dpi
_LEVEL = 1e-9  # share of the largest distance below which a rise is rounding, not a maximum


def curve(
    shape: AbstractCurve,
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
        shape: the curve.
        ax: axes to draw on, three-dimensional ones for a space curve; None makes a figure.
        colour: of the curve and, faint, of its control polygon.
        linestyle: of the curve, as matplotlib takes it.
        label: name in a legend.
        control_polygon: whether the control polygons are drawn (a polyline is its own).
        samples: steps for each segment of degree two or more.

    Raises:
        ValueError: a space curve on plane axes.
    """
    check_curve("shape", shape)
    pieces = shape.segments()
    ax = _axes(ax, pieces.dim)
    if pieces.degree == 0:
        _plot(ax, pieces.control_points[:, 0], "curve", color=colour, marker=".", linestyle="none", label=label)
    else:
        t = np.linspace(0.0, 1.0, (samples if pieces.degree > 1 else 1) + 1)
        if control_polygon and pieces.degree > 1:
            polygon = _with_gaps(pieces, np.asarray(pieces.control_points))
            style: dict[str, Any] = {"color": colour, "linewidth": 0.5, "marker": ".", "markersize": 2.5, "alpha": 0.45}
            _plot(ax, polygon, "control_polygon", **style)
        line = _with_gaps(pieces, _sample(pieces, t))
        _plot(ax, line, "curve", color=colour, linestyle=linestyle, linewidth=1.2, label=label)
    _finish(ax)
    return ax


def witness(solution: HausdorffSolution, ax: Any = None, *, distance: bool = True, empty_circle: bool = True) -> Any:
    """Axes with the witness point, its feet, the lines that join them, and the distance in writing.

    Args:
        solution: one solution, not a batch.
        ax: axes to draw on; None makes a figure.
        distance: whether the distance is also written beside the line to the first foot. It labels the joining lines
            in any case: `d = ` where the bounds agree in the digits shown, otherwise the inequality that is proven.
        empty_circle: whether, in the plane, the circle about the witness through its feet is drawn: the other curve
            does not enter it.

    Raises:
        ValueError: a batch of solutions, or a witness in space on plane axes.
    """
    if np.ndim(solution.value) > 0:
        raise ValueError(f"solution is a batch of shape {np.shape(solution.value)}; draw one at a time.")
    point = np.asarray(solution.witness.point)
    feet = _distinct(np.asarray(solution.witness.feet))
    dim = point.shape[-1]
    ax = _axes(ax, dim)
    spokes = np.concatenate([[point, foot, np.full(dim, np.nan)] for foot in feet])
    if empty_circle and dim == 2:
        turn = np.linspace(0.0, 2 * np.pi, 181)
        circle = point + np.linalg.norm(feet[0] - point) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        _plot(ax, circle, "empty_circle", color=GREY, linewidth=0.6, linestyle=":", zorder=3)
    marks: dict[str, Any] = {"linestyle": "none", "markeredgecolor": "black", "markeredgewidth": 0.8}
    _plot(ax, point[None], "witness", marker="o", markersize=5.5, color=VERMILLION, label="witness", zorder=6, **marks)
    name = "foot" if len(feet) == 1 else "feet"
    _plot(ax, feet, "feet", marker="s", markersize=4.5, markerfacecolor="white", label=name, zorder=5, **marks)
    _plot(ax, spokes, "joining_lines", color="black", linewidth=1.0, label=_distance_text(solution), zorder=4)
    if distance:
        _write_distance(ax, solution, point, feet)
    _finish(ax)
    return ax


def solution(
    a: AbstractCurve,
    b: AbstractCurve,
    solution: HausdorffSolution,
    ax: Any = None,
    *,
    labels: Sequence[str] = ("A", "B"),
    control_polygon: bool = True,
    legend: bool = True,
) -> Any:
    """Axes with both curves, the witness, its feet and the distance between them.

    Args:
        a: the first curve, blue and solid.
        b: the second curve, orange and dashed.
        solution: their distance.
        ax: axes to draw on, three-dimensional ones for space curves; None makes a figure.
        labels: the names of the curves in the legend.
        control_polygon: whether the control polygons are drawn.
        legend: whether a legend, which then holds the distance, is put above the axes; otherwise the distance is
            written beside the joining line.

    Raises:
        ValueError: curves of different dimensions, a batch of solutions, or space curves on plane axes.
    """
    _check_pair(a, b)
    ax = curve(a, ax, label=labels[0], control_polygon=control_polygon)
    curve(b, ax, colour=ORANGE, linestyle=(0, (4, 1.2)), label=labels[1], control_polygon=control_polygon)
    witness(solution, ax, distance=not legend)
    if legend:
        above: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "borderaxespad": 0.2}
        ax.legend(ncols=3, fontsize=_POINTS, frameon=False, handlelength=2.2, columnspacing=1.2, **above)
    return ax


def profile(
    a: AbstractCurve,
    b: AbstractCurve,
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
    _check_pair(a, b)
    pieces = a.segments()
    steps = int(np.clip(_PROFILE_SAMPLES // pieces.count, 8, 256)) if samples is None else samples
    if steps < 1:
        raise ValueError(f"samples is {steps}; needs at least 1.")
    ax = _axes(ax, 2)
    t = np.linspace(0.0, 1.0, steps + 1) if pieces.degree > 0 else np.zeros(1)
    distances = np.asarray(project(_sample(pieces, t), b, throw=False).distance)
    place = np.arange(pieces.count)[:, None] + t
    line = _with_gaps(pieces, np.stack([place, distances], axis=-1))
    style = {"linewidth": 1.2} if pieces.degree else {"linestyle": "none", "marker": "."}
    # Many boundaries would hide the profile; every second or tenth of them would say nothing.
    if 1 < pieces.count <= 64 and pieces.degree:
        for k in range(1, pieces.count):
            ax.axvline(k, color=GREY, linewidth=0.4, alpha=0.35, zorder=0, gid="segment_boundary")
    _plot(ax, line, "profile", color=colour, **style)
    if pieces.degree:
        tops = _local_maxima(distances, np.asarray(pieces.following))
        rings = {"marker": "o", "markersize": 4, "markerfacecolor": "white", "markeredgecolor": colour}
        _plot(
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
    ax.set_xlabel(f"{what} {labels[0]}", fontsize=_POINTS)
    ax.set_ylabel(f"distance to {labels[1]} ({unit})", fontsize=_POINTS)
    ax.tick_params(labelsize=_POINTS)
    return ax


def _check_pair(a: AbstractCurve, b: AbstractCurve) -> None:
    check_curve("a", a)
    check_curve("b", b)
    dims = a.segments().dim, b.segments().dim
    if dims[0] != dims[1]:
        raise ValueError(f"a has {dims[0]} coordinates; b has {dims[1]}.")


def _axes(ax: Any, dim: int) -> Any:
    """The axes given, checked, or those of a new figure one column wide."""
    if ax is None:
        import matplotlib.pyplot as plt

        size = _COLUMN_INCHES, _COLUMN_INCHES
        if dim == 3:
            # No layout engine sees the labels of space axes: room for that of z is left at the right.
            return plt.figure(figsize=size).add_axes((0.02, 0.1, 0.84, 0.78), projection="3d")
        return plt.figure(figsize=size, layout="constrained").add_subplot()
    if dim == 3 and ax.name != "3d":
        raise ValueError("ax has two dimensions; a space curve needs axes made with projection='3d'.")
    return ax


def _finish(ax: Any) -> None:
    ax.set_aspect("equal")
    ax.tick_params(labelsize=_POINTS)
    if ax.name == "3d":
        ax.locator_params(nbins=4)  # the shorter axes are seen at a slant, where more labels run into each other
    for name in "xyz" if ax.name == "3d" else "xy":
        getattr(ax, f"set_{name}label")(f"${name}$", fontsize=_POINTS)


def _plot(ax: Any, points: Any, gid: str, **style: Any) -> None:
    ax.plot(*np.moveaxis(np.asarray(points), -1, 0), gid=gid, solid_capstyle="round", **style)


def _sample(pieces: BezierSegments, t: np.ndarray) -> np.ndarray:
    """Points of all segments at the local parameters t, (segments, samples, dim).

    In NumPy, by the basis: a compiled program for every number of segments would take longer than the picture.
    """
    degree = pieces.degree
    i = np.arange(degree + 1)
    basis = binomials(degree) * t[:, None] ** i * (1 - t[:, None]) ** (degree - i)
    values = np.einsum("ti,kid->ktd", basis, np.asarray(pieces.homogeneous))
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
        _plot(ax, place, "witness", marker="o", markersize=5.5, color=VERMILLION, linestyle="none", **edge)


def _distinct(feet: np.ndarray) -> np.ndarray:
    """The feet without repetitions, in order."""
    return np.stack([foot for k, foot in enumerate(feet) if not (feet[:k] == foot).all(axis=-1).any()])


def _distance_text(solution: HausdorffSolution) -> str:
    """The distance to four digits; as the inequality that is proven where the bounds do not agree in them."""
    lower, upper = float(solution.lower), float(solution.upper)
    if f"{lower:.4g}" == f"{upper:.4g}":
        return f"$d$ = {lower:.4g}"
    below = f"{Context(prec=4, rounding=ROUND_FLOOR).create_decimal_from_float(lower):g}"
    if not np.isfinite(upper):
        return f"$d$ ≥ {below}"
    above = f"{Context(prec=4, rounding=ROUND_CEILING).create_decimal_from_float(upper):g}"
    return f"{below} ≤ $d$ ≤ {above}"


def _write_distance(ax: Any, solution: HausdorffSolution, point: np.ndarray, feet: np.ndarray) -> None:
    """Writes the distance beside the first joining line, on the side that holds no other foot."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.5, foreground="white")]
    style: dict[str, Any] = {"fontsize": _POINTS, "path_effects": halo, "zorder": 6, "gid": "distance"}
    middle = (point + feet[0]) / 2
    if ax.name == "3d":
        ax.text(*middle, f" {_distance_text(solution)}", **style)
        return
    along = feet[0] - point
    length = np.linalg.norm(along)
    normal = np.array([-along[1], along[0]]) / length if length > 0 else np.array([0.6, 0.8])
    others = (feet - point) @ normal
    if others.sum() > 0 or (abs(others.sum()) <= 1e-9 * length and normal[0] < 0):
        normal = -normal
    sides = ("right", "center", "left"), ("top", "center", "bottom")
    ha, va = (names[int(np.sign(np.round(x))) + 1] for names, x in zip(sides, normal, strict=True))
    offset = 5 * normal
    ax.annotate(_distance_text(solution), middle, tuple(offset), textcoords="offset points", ha=ha, va=va, **style)
