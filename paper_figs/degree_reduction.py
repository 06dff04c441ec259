"""Errors of five ways to reduce the degree of a curve, against the minimax fit, against time, and along one curve.

Numbers by degree_reduction's experiment.

Caption: Random curves of degree 7, approximated by curves of degree 3, 4 and 5: errors of five methods divided by the
error of the minimax fit of jhd, errors against time, and the error along one curve. The fit of jhd is certified to be
nearer than every other in all 24 cases, by a factor of 1.0001 to 1.12 for the soft Hausdorff loss and of at least 1.09
for the rest.

Alt text: Four panels: scatter plots of error ratios by degree and against time, with jhd on the lowest line, one
hook-shaped curve with its approximations, and their signed errors, of which two oscillate between equal extremes.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, ORANGE, PURPLE, Picture, bezier, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_LOOK: dict[str, dict[str, Any]] = {
    "least squares": {"color": GRAY, "marker": "s"},
    "projected least squares": {"color": ORANGE, "marker": "^"},
    "Chamfer": {"color": PURPLE, "marker": "D"},
    "soft Hausdorff": {"color": BLACK, "marker": "o"},
    "ours": {"color": BLUE, "marker": "*"},
}
_NAMES = {"ours": "jhd (minimax)", "Chamfer": "Adam, Chamfer", "soft Hausdorff": "Adam, soft Hausdorff"}
# Line styles and widths; the first lies below.
_LINES: dict[str, tuple[Any, float]] = {
    "ours": ("-", 2.4),
    "projected least squares": ("-.", 1.0),
    "Chamfer": ((0, (1, 1)), 1.2),
    "soft Hausdorff": ((0, (4, 2)), 0.9),
}
# Magnifications of the errors next to the target. The largest one is taken for which no line turns back; such a line
# would show loops that do not exist.
_LARGER = (8, 6, 5, 4, 3, 2, 1)
# Each line keeps at least this fraction of the target's speed along the target.
_FORWARD = 0.3


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 118 * MM), layout="constrained")
        parts: Any = figure.subfigures(2, 1, height_ratios=(1.1, 1.0))
        top, bottom = parts
        ratios, times = top.subplots(1, 2, sharey=True, width_ratios=(1.25, 1.0))
        _draw_ratios(ratios, numbers["cases"])
        _draw_times(times, numbers["cases"])
        shapes, errors = bottom.subplots(1, 2, width_ratios=(1.0, 1.25))
        case = numbers["cases"][numbers["example"]["case"]]
        _draw_shapes(shapes, numbers["targets"][case["curve"]], case, numbers["example"])
        _draw_errors(errors, numbers["example"], case["methods"]["ours"]["value"])
        handles = {**dict(_handles(ratios)), **dict(_handles(times))}
        order = [_NAMES.get(name, name) for name in _LOOK]
        top.legend([handles[name] for name in order], order, loc="outside upper center", ncols=5, columnspacing=1.0)
        bottom.legend(*shapes.get_legend_handles_labels(), loc="outside lower center", ncols=5, columnspacing=1.0)
    return figure


def _handles(ax: Axes) -> list[tuple[str, Any]]:
    handles, labels = ax.get_legend_handles_labels()
    return list(zip(labels, handles, strict=True))


def _draw_ratios(ax: Axes, cases: list[dict[str, Any]]) -> None:
    degrees = sorted({case["degree"] for case in cases})
    others = [name for name in _LOOK if name != "ours"]
    for j, name in enumerate(others):
        for k, degree in enumerate(degrees):
            values = np.sort([case["methods"][name]["ratio"] for case in cases if case["degree"] == degree])
            # Cases stand next to each other, ordered by their ratios, so that none hides another.
            place = k + 0.22 * (j - 1.5) + 0.075 * np.linspace(-1, 1, len(values))
            label = _NAMES.get(name, name) if k == 0 else None
            ax.plot(place, values, linestyle="none", markersize=3.0, markeredgewidth=0.6, label=label, **_hollow(name))
    for k in range(1, len(degrees)):
        ax.axvline(k - 0.5, color=GRAY, linewidth=0.4)
    ax.axhline(1.0, color=BLUE, linewidth=1.0)
    ax.set_yscale("log")
    ticks = (1, 2, 5, 10, 20, 50)
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.set_xticks(range(len(degrees)), [f"7 to {degree}" for degree in degrees])
    ax.tick_params(axis="x", length=0)
    ax.set_xlim(-0.5, len(degrees) - 0.5)
    ax.set_xlabel("degree")
    ax.set_ylabel("error / error of jhd")
    letter(ax, "a", "certified errors")


def _hollow(name: str) -> dict[str, Any]:
    look = _LOOK[name]
    return {**look, "markerfacecolor": look["color"] if name == "ours" else "none"}


def _draw_times(ax: Axes, cases: list[dict[str, Any]]) -> None:
    for name in _LOOK:
        entries = [case["methods"][name] for case in cases]
        values = [[entry[key] for entry in entries] for key in ("seconds", "ratio")]
        size = 5.0 if name == "ours" else 3.0
        label = _NAMES.get(name, name)
        ax.plot(*values, linestyle="none", markersize=size, markeredgewidth=0.6, label=label, **_hollow(name))
    ax.axhline(1.0, color=BLUE, linewidth=1.0, zorder=0)
    ax.set_xscale("log")
    ax.set_xlabel("time (s)")
    letter(ax, "b", "time of the run shown, compiled")


def _draw_shapes(ax: Axes, target: Any, case: dict[str, Any], example: dict[str, Any]) -> None:
    t = np.linspace(0, 1, len(example["along"]))
    rows = np.asarray(bezier([target])(t))
    speed = np.gradient(rows, t, axis=0)
    normal = np.stack([-speed[:, 1], speed[:, 0]], axis=1) / np.linalg.norm(speed, axis=1)[:, None]
    ax.plot(*rows.T, color=GRAY, linewidth=0.8, label="target")
    offsets = {name: np.array(example["errors"][name])[:, None] * normal for name in _LINES}
    larger = next((k for k in _LARGER if all(_is_forward(rows, k * x) for x in offsets.values())), _LARGER[-1])
    for name, offset in offsets.items():
        ax.plot(*(rows + larger * offset).T, **_line(name))
    ax.plot(*rows[[0, -1]].T, "o", color=GRAY, markersize=3.0)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("$x$")
    ax.set_ylabel("$y$")
    scale = f"; errors {larger} times larger" if larger > 1 else ""
    letter(ax, "c", f"one case, 7 to {case['degree']}{scale}")


def _is_forward(rows: np.ndarray, offset: np.ndarray) -> bool:
    """Return True if a line moved by an offset runs everywhere in the direction of the original line."""
    steps, moved = np.diff(rows, axis=0), np.diff(rows + offset, axis=0)
    return bool(np.all(np.sum(steps * moved, axis=1) >= _FORWARD * np.sum(steps * steps, axis=1)))


def _line(name: str) -> dict[str, Any]:
    line, width = _LINES[name]
    look = {"color": _LOOK[name]["color"], "linestyle": line, "linewidth": width}
    return {**look, "alpha": 0.55 if name == "ours" else 1.0, "label": _NAMES.get(name, name)}


def _draw_errors(ax: Axes, example: dict[str, Any], level: float) -> None:
    for side in (-1, 1):
        ax.axhline(1e3 * side * level, color=BLUE, linewidth=0.5)
    for name in _LINES:
        ax.plot(example["along"], 1e3 * np.array(example["errors"][name]), **_line(name))
    ax.set_xlim(0, 1)
    ax.set_xlabel("location along the target (fraction of its length)")
    ax.set_ylabel("signed distance ($10^{-3}$)")
    letter(ax, "d", "errors along the target of (c)")


if __name__ == "__main__":
    main()
