"""The four panels of an example of Cao et al. 2014: samples, stationary points, candidates, result."""

from typing import Any

import numpy as np
from common import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    MM,
    ORANGE,
    PURPLE,
    VERMILLION,
    bezier,
    freeze,
    letter,
    place_label,
    scale_bar,
    solution,
    style,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jhd import plot

# Dashes, so that the curves differ in gray too.
_DASHED = (0, (4, 1.2))
_EDGE: dict[str, Any] = {"markeredgecolor": BLACK, "markeredgewidth": 0.6, "linestyle": "none"}
_SAMPLE: dict[str, Any] = {"marker": "o", "markersize": 3.0, "color": BLACK, "linestyle": "none", "zorder": 5}
_FOOT: dict[str, Any] = {"marker": "s", "markersize": 3.2, "markerfacecolor": "white", "zorder": 4, **_EDGE}
_CHOSEN: dict[str, Any] = {"marker": "o", "markersize": 5.0, "color": VERMILLION, "zorder": 7, **_EDGE}
_RANKS = ({"color": VERMILLION, "marker": "o"}, {"color": GREEN, "marker": "^"}, {"color": PURPLE, "marker": "D"})


def four_panels(numbers: dict[str, Any], bar: tuple[float, float]) -> Figure:
    """Return a figure two columns wide from the numbers of an experiment.

    Args:
        numbers: the numbers that the experiment saved.
        bar: the center of the scale bar in panel (a), in axes coordinates; all panels have one scale.
    """
    with style():
        figure = Figure(figsize=(175 * MM, 122 * MM), layout="constrained")
        axes = figure.subplots(2, 2, sharex=True, sharey=True)
        for ax in axes.flat:
            _curves(ax, numbers)
        _samples(axes[0, 0], numbers["samples"])
        _stationary(axes[0, 1], numbers)
        _candidates(axes[1, 0], numbers)
        _result(axes[1, 1], numbers)
        _limits(axes[0, 0])
        places: dict[str, Any] = {"loc": "outside lower center", "ncols": 6, "handlelength": 1.8, "handletextpad": 0.5}
        figure.legend(handles=_handles(), columnspacing=1.2, **places)
        freeze(figure)
        scale_bar(axes[0, 0], _round_length(axes[0, 0]), numbers["unit"], bar)
        for rank, candidate in enumerate(numbers["candidates"], 1):
            place_label(axes[1, 0], numbers["samples"]["points"][candidate["sample"] - 1], f"{rank}")
            place_label(axes[1, 1], candidate["solution"]["witness"]["point"], f"{rank}")
    return figure


def _round_length(ax: Axes) -> float:
    """Return the least length with first digit 1, 2 or 5 that is at least a tenth of the width."""
    least = 0.1 * float(np.ptp(ax.get_xlim()))
    unit = 10 ** np.floor(np.log10(least))
    return float(unit * next(digit for digit in (1, 2, 5, 10) if digit * unit >= least))


def _handles() -> list[Line2D]:
    wide: dict[str, Any] = {"linewidth": 1.2}
    return [
        Line2D([], [], color=BLUE, label="curve $A$", **wide),
        Line2D([], [], color=ORANGE, linestyle=_DASHED, label="curve $B$", **wide),
        Line2D([], [], label="sample of $A$", **_SAMPLE),
        Line2D([], [], label="point chosen", **_CHOSEN),
        Line2D([], [], label="foot on $B$", **_FOOT),
        Line2D([], [], color=GRAY, marker="x", markersize=4, linestyle="none", label="stationary point"),
    ]


def _curves(ax: Axes, numbers: dict[str, Any]) -> None:
    for name, color, dashes in (("a", BLUE, "-"), ("b", ORANGE, _DASHED)):
        pieces = bezier(numbers[name])
        steps = max(8, 512 // pieces.count)
        plot.curve(pieces, ax, color=color, linestyle=dashes, control_polygon=False, samples=steps)
    ax.set_axis_off()


def _limits(ax: Axes) -> None:
    """Set the limits to a box around both curves."""
    points = np.concatenate([np.asarray(line.get_xydata()) for line in ax.lines[:2]])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = 0.04 * (high - low).max()
    ax.set_xlim(low[0] - margin, high[0] + margin)
    ax.set_ylim(low[1] - margin, high[1] + margin)


def _samples(ax: Axes, samples: dict[str, Any]) -> None:
    points, feet = np.array(samples["points"]), np.array(samples["feet"])
    _spokes(ax, points, feet, color=GRAY, linewidth=0.6)
    few = len(points) < 40
    ax.plot(*points.T, **{**_SAMPLE, "markersize": 3.0 if few else 1.6})
    ax.plot(*feet.T, **{**_FOOT, "markersize": 3.2 if few else 1.8, "markeredgewidth": 0.6 if few else 0.4})
    letter(ax, "a", f"{len(points)} samples of $A$ and their feet")


def _stationary(ax: Axes, numbers: dict[str, Any]) -> None:
    stationary = numbers["stationary"]
    points, distance = np.array(stationary["points"]), np.array(stationary["distance"])
    sample = np.array(numbers["samples"]["points"])[stationary["sample"] - 1]
    nearest = int(np.argmin(distance))
    others = np.delete(points, nearest, axis=0)
    _spokes(ax, np.broadcast_to(sample, others.shape), others, color=GRAY, linewidth=0.6)
    ax.plot(*others.T, color=GRAY, marker="x", markersize=4, markeredgewidth=1.0, linestyle="none", zorder=4)
    _spokes(ax, sample[None], points[nearest][None], color=BLACK, linewidth=1.2)
    ax.plot(*points[nearest], **_FOOT)
    ax.plot(*sample, **_CHOSEN)
    letter(ax, "b", f"{len(points)} stationary points of sample {stationary['sample']}")


def _candidates(ax: Axes, numbers: dict[str, Any]) -> None:
    points, feet = (np.array(numbers["samples"][name]) for name in ("points", "feet"))
    for candidate, kind in zip(numbers["candidates"], _RANKS, strict=False):
        around = np.array(candidate["around"]) - 1
        _spokes(ax, points[around], feet[around], color=kind["color"], linewidth=1.0)
        ax.plot(*points[around].T, **{**_SAMPLE, "markersize": 2.4})
        ax.plot(*feet[around].T, **_FOOT)
        ax.plot(*points[around[1]], **{**_CHOSEN, **kind})
    ranked = enumerate(numbers["candidates"], 1)
    lines = [f"{rank}: sample {c['sample']}, {c['distance']:.2f} {numbers['unit']}" for rank, c in ranked]
    _below(ax, lines)
    letter(ax, "c", "samples above both neighbors")


def _result(ax: Axes, numbers: dict[str, Any]) -> None:
    chosen = numbers["directions"]["a_to_b"]["solution"]
    for candidate, kind in zip(numbers["candidates"], _RANKS, strict=False):
        other = candidate["solution"]
        witness = other["witness"]
        point, ends = np.array(witness["point"]), np.array(witness["feet"])
        if abs(other["value"] - chosen["value"]) > 1e-6:
            _spokes(ax, np.broadcast_to(point, ends.shape), ends, color=kind["color"], linewidth=1.0)
            ax.plot(*ends.T, **_FOOT)
            ax.plot(*point, **{**_CHOSEN, **kind, "markersize": 4.0})
    found = [candidate["solution"] for candidate in numbers["candidates"]]
    _below(ax, [f"{rank}: {_words(f, numbers['unit'])}" for rank, f in enumerate(found, 1)])
    plot.witness(solution(chosen), ax, distance=False, empty_circle=False)
    ax.set_axis_off()
    same = [f"; {rank} is $h(A,B)$" for rank, f in enumerate(found, 1) if abs(f["value"] - chosen["value"]) <= 1e-6]
    letter(ax, "d", "maxima between them" + "".join(same))


def _words(found: dict[str, Any], unit: str) -> str:
    """Return the value to six decimals, and the event."""
    return f"{found['value']:.6f} {unit}".strip() + f", {found['witness']['event'].replace('_', '-')}"


def _below(ax: Axes, lines: list[str]) -> None:
    """Write lines of text under a panel."""
    ax.text(0.02, -0.02, "\n".join(lines), transform=ax.transAxes, va="top", linespacing=1.25)


def _spokes(ax: Axes, points: np.ndarray, feet: np.ndarray, **style: Any) -> None:
    """Draw lines from points to feet, as one artist."""
    gap = np.full_like(feet, np.nan)
    ax.plot(*np.stack([points, feet, gap], axis=1).reshape(-1, 2).T, zorder=3, **style)
