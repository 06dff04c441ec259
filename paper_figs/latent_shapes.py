"""Unseen shapes as a network draws them, distances in training with three losses, and the points moved by each.

Numbers by latent_shapes' experiment.

Caption: Unseen shapes as a network draws them from two latent numbers, their distances during training with three
losses, and the number of control points that each loss moves in a step. The mean distance of unseen shapes is 0.026 for
the soft loss, 0.045 for the distance itself and 0.038 for Chamfer, all certified upper bounds.

Alt text: Left, eight closed curves overlaid with the dashed curves of the network. Right, falling distances against the
step for three losses, and bars of the number of control points that each loss moves.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from common import BLACK, BLUE, GREEN, MM, ORANGE, TEXT, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import jhd

_WAYS = {
    "soft, then hard": (VERMILLION, "-", "o"),
    "the distance itself": (BLUE, (0, (4, 1.5)), "s"),
    "Chamfer": (GREEN, (0, (1, 1.2)), "^"),
}
_DASHED = (0, (3, 1.2))
_COLUMNS, _MOST = 4, 8
_SAMPLES = 241
_TICKS = (0.03, 0.1, 0.3, 1.0)


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 82 * MM), layout="constrained")
        parts: Any = figure.subfigures(1, 2, width_ratios=(1.12, 1.0))
        left, right = parts
        _draw_shapes(left, numbers)
        path, moved = right.subplots(2, 1, height_ratios=(1.7, 1.0))
        _draw_path(path, numbers)
        _draw_moved(moved, numbers)
    return figure


def _draw_shapes(figure: Any, numbers: dict[str, Any]) -> None:
    """Draw unseen shapes, and the curves of the network that was trained with the soft loss."""
    way = numbers["ways"]["soft, then hard"]
    count = min(len(numbers["targets"]), _MOST)
    axes = figure.subplots(-(-count // _COLUMNS), _COLUMNS, squeeze=False).ravel()
    distances = way["path"][-1]["distances"]
    for ax in axes:
        ax.set_axis_off()
    for ax, target, drawn, distance in zip(axes, numbers["targets"][:count], way["points"], distances, strict=False):
        ax.plot(*_outline(target), color=BLUE, linewidth=1.6)
        ax.plot(*_outline(drawn), color=ORANGE, linewidth=1.4, linestyle=_DASHED)
        ax.set_aspect("equal")
        ax.set(xlim=(-1.7, 1.7), ylim=(-1.5, 1.5))
        ax.text(0.5, -0.02, f"{distance:.3f}", transform=ax.transAxes, ha="center", va="top")
    title = "$\\bf{(a)}$ unseen shapes and their distances"
    figure.suptitle(title, x=0.01, ha="left", fontsize=TEXT)
    handles = [
        Line2D([], [], color=BLUE, linewidth=1.6, label="shape"),
        Line2D([], [], color=ORANGE, linewidth=1.4, linestyle=_DASHED, label="drawn by the network"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, handlelength=2.6)


def _outline(points: Any) -> np.ndarray:
    curve = jhd.BSplineCurve.uniform(np.asarray(points), periodic=True).segments()
    return np.asarray(curve(jnp.linspace(0.0, curve.count, _SAMPLES))).T


def _draw_path(ax: Axes, numbers: dict[str, Any]) -> None:
    """Plot the mean distance of unseen shapes against the step, with the largest as a thin line."""
    for name, (color, line, marker) in _WAYS.items():
        path = numbers["ways"][name]["path"]
        steps, distances = [x["step"] for x in path], np.array([x["distances"] for x in path])
        options: dict[str, Any] = {"color": color, "linestyle": line}
        ax.semilogy(steps, distances.mean(axis=1), **options, marker=marker, markersize=3.5, label=name, linewidth=1.4)
        ax.semilogy(steps, distances.max(axis=1), **options, linewidth=0.7)
    ax.set(xlabel="step of Adam", ylabel="distance (input units)")
    ax.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    ax.set_yticks([], minor=True)
    ax.set_ylim(top=2.0)
    ax.legend(loc="upper right", handlelength=2.8, borderaxespad=0.0)
    letter(ax, "b", "unseen: mean, largest (thin)")


def _draw_moved(ax: Axes, numbers: dict[str, Any]) -> None:
    """Plot the number of control points of a shape that each loss moves in a step."""
    names = list(_WAYS)[::-1]
    values = [float(np.mean(numbers["ways"][name]["moved"])) for name in names]
    bars = ax.barh(names, values, color=[_WAYS[name][0] for name in names], edgecolor=BLACK, linewidth=0.5, height=0.6)
    ax.bar_label(bars, fmt="%.1f", padding=3)
    ax.set(xlabel=f"of {numbers['drawn']} control points", xlim=(0, 1.2 * numbers["drawn"]))
    ax.set_xticks(range(0, numbers["drawn"] + 1, 3))
    letter(ax, "c", "control points moved in a step")


if __name__ == "__main__":
    main()
