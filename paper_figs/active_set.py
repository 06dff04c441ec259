"""The critical pairs of a fit from a poor start to equal maxima, the distances along both curves, and the convergence.

If a pair is a maximum along both curves, it is marked once, at its parameter on the target. Numbers by active_set's
experiment.

Caption: Critical pairs of a fit from a poor start to equal maxima, the distances along both curves, and the
convergence; a pair that is a maximum along both curves is marked once. The run starts with 1 of 4 pairs at the maximum.
It ends with 7 of 8, equal to 1e-14, at a distance of 0.281167221.

Alt text: Six drawings of an M-shaped target and a dashed fitted curve with segments at the critical pairs, each above
its distance profiles, and three plots against the step: distance, values of the pairs, and stationarity.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, ORANGE, VERMILLION, Picture, bezier, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

# Steps that are shown, as fractions of the run: the pairs change mostly near its end.
_SHOWN = (0.0, 0.2, 0.4, 0.6, 0.7, 1.0)
_DASHED = (0, (4, 1.2))
_EDGE: dict[str, Any] = {"markeredgecolor": BLACK, "markeredgewidth": 0.5, "linestyle": "none", "clip_on": False}
_TOP: dict[str, Any] = {"marker": "o", "markersize": 3.8, "color": VERMILLION, "zorder": 7, **_EDGE}
_OTHER: dict[str, Any] = {"marker": "o", "markersize": 3.0, "color": "white", "zorder": 6, **_EDGE}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    steps = numbers["steps"]
    lines = [bezier([numbers["target"]]), *(bezier([step["control_points"]]) for step in steps)]
    shown = [round(share * (len(steps) - 1)) for share in _SHOWN]
    target, *curves = (np.asarray(line(np.array(numbers["samples"]))) for line in lines)
    with style():
        figure = Figure(figsize=(175 * MM, 170 * MM), layout="constrained")
        shapes, profiles, convergence = _grid(figure)
        for panel, (k, shape, profile) in enumerate(zip(shown, shapes, profiles, strict=True)):
            _draw_shape(shape, target, curves[k], steps[k], numbers["near"])
            _draw_profile(profile, np.array(numbers["samples"]), steps[k], numbers["near"])
            letter(shape, "abcdef"[panel], f"step {k}, $h$ = {steps[k]['distance']:.4f}")
            if panel % 3 == 0:
                profile.set_ylabel("distance\n(input units)")
        box = np.concatenate([target, *(curves[k] for k in shown)])
        for shape in shapes:
            shape.set_xlim(box[:, 0].min() - 0.2, box[:, 0].max() + 0.2)
            shape.set_ylim(box[:, 1].min() - 0.2, box[:, 1].max() + 0.2)
        _draw_convergence(convergence, numbers)
        _legend(figure, numbers["near"])
    return figure


def _grid(figure: Figure) -> tuple[list[Axes], list[Axes], list[Axes]]:
    """Return axes of two rows of shapes, of the profiles below each, and of a row for the convergence."""
    rows: list[Any] = [
        [f"{kind}{k}" for k in range(first, first + 3)] for first in (0, 3) for kind in ("shape", "profile")
    ]
    axes = figure.subplot_mosaic([*rows, ["h", "values", "optimality"]], height_ratios=(1.0, 0.85, 1.0, 0.85, 1.15))
    shapes, profiles = ([axes[f"{kind}{k}"] for k in range(6)] for kind in ("shape", "profile"))
    return shapes, profiles, [axes[name] for name in ("h", "values", "optimality")]


def _draw_shape(ax: Axes, target: np.ndarray, curve: np.ndarray, step: dict[str, Any], near: float) -> None:
    """Draw both curves and the segments of all pairs; pairs at the maximum stand out."""
    ax.plot(*target.T, color=BLUE, linewidth=1.2)
    ax.plot(*curve.T, color=ORANGE, linewidth=1.4, linestyle=_DASHED)
    pairs = step["pairs"]
    for k, top in enumerate(_at_top(pairs, near)):
        point, feet = np.array(pairs["point"][k]), np.unique(pairs["feet"][k], axis=0)
        style: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.8} if top else {"color": GRAY, "linewidth": 0.8}
        for foot in feet:
            ax.plot(*np.stack([point, foot], axis=1), **style, zorder=5 if top else 4)
        ax.plot(*point, **{**(_TOP if top else _OTHER), "markersize": 2.6})
    ax.set_aspect("equal")
    ax.set_axis_off()


def _draw_profile(ax: Axes, t: np.ndarray, step: dict[str, Any], near: float) -> None:
    """Draw the distances along both curves, and the pairs at their parameters."""
    ax.plot(t, step["profile"]["a_to_b"], color=BLUE, linewidth=1.0)
    ax.plot(t, step["profile"]["b_to_a"], color=ORANGE, linewidth=1.2, linestyle=_DASHED)
    ax.axhline(step["distance"], color=GRAY, linewidth=0.8, linestyle=(0, (1, 1.5)))
    pairs = step["pairs"]
    for place, value, top in zip(pairs["t"], pairs["value"], _at_top(pairs, near), strict=True):
        ax.plot([place], [value], **(_TOP if top else _OTHER))
    ax.set_xlim(0, 1)
    ax.set_ylim(0, 1.12 * step["distance"])
    ax.set_xticks([0, 0.5, 1], ["0", "½", "1"])
    ax.set_xlabel("parameter $t$ or $s$", labelpad=1)


def _at_top(pairs: dict[str, Any], near: float) -> np.ndarray:
    values = np.array(pairs["value"])
    return values >= (1 - near) * values.max()


def _draw_convergence(axes: list[Axes], numbers: dict[str, Any]) -> None:
    """Plot the distance, all pairs as fractions of the distance, and the optimality against the step."""
    distance, values, optimality = axes
    steps = numbers["steps"]
    line: dict[str, Any] = {"color": BLACK, "marker": "o", "markersize": 3.0}
    distance.plot([step["distance"] for step in steps], **line)
    distance.set_ylim(bottom=0)
    distance.set_ylabel("distance $h$ (input units)")
    letter(distance, "g", "distance")
    for k, step in enumerate(steps):
        shares, tops = np.array(step["pairs"]["value"]) / step["distance"], _at_top(step["pairs"], numbers["near"])
        values.plot(np.full(np.sum(~tops), k), shares[~tops], **_OTHER)
        values.plot(np.full(np.sum(tops), k), shares[tops], **_TOP)
        values.annotate(str(step["near"]), (k, 1), (0, 5), textcoords="offset points", ha="center")
    values.set_ylim(0, 1.18)
    values.set_ylabel("value of each pair / $h$")
    letter(values, "h", "pairs; number at the top")
    optimality.semilogy([step["optimality"] for step in steps], **line)
    optimality.set_ylabel("optimality $|\\sum \\mu_j g_j|$")
    letter(optimality, "i", "stationarity")
    for ax in axes:
        ax.set_xticks(range(0, len(steps), 2))
        ax.set_xlabel("step")


def _legend(figure: Figure, near: float) -> None:
    styles: dict[str, dict[str, Any]] = {
        "target ($t$)": {"color": BLUE, "linewidth": 1.2},
        "curve that is fitted ($s$)": {"color": ORANGE, "linewidth": 1.4, "linestyle": _DASHED},
        f"pair within {100 * near:g} % of $h$": {**_TOP, "linestyle": "-", "linewidth": 1.8},
        "other pair": {**_OTHER, "color": GRAY, "linestyle": "-", "linewidth": 0.8, "markerfacecolor": "white"},
    }
    handles = [Line2D([], [], label=label, **style) for label, style in styles.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=4, handlelength=2.4, columnspacing=1.6)


if __name__ == "__main__":
    main()
