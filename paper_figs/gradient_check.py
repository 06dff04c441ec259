"""A moving arc, its distance from a parabola at one foot, two feet and an end, and correct and naive derivatives.

Numbers by gradient_check's experiment.

Caption: An arc moves inside a parabola; its farthest point has one foot, then two, and then is an end of the arc.
Derivatives by jhd, by naive automatic differentiation and by differences, and errors for random pairs of curves. First
and second derivatives of jhd agree with differences to 1e-6. Along the path naive differentiation is wrong wherever two
feet are active, by up to 1.2 for a derivative of 2.1.

Alt text: Five panels: six arcs that rise inside a parabola, the distance along the path over bands that name the event,
its derivative by three methods, the errors of two of them, and the errors for random pairs by event.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, bezier, letter, power_text, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

_NAMES = {"a_end": "end of $A$", "b_end": "end of $B$", "one_to_two": "one-to-two"}
_EVENTS = {"antipodal": (BLUE, "antipodal"), "one_to_two": (ORANGE, "one-to-two"), "a_end": (PURPLE, "end")}
_SHOWN = 6
_HALO = [withStroke(linewidth=2.0, foreground="white")]


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers["path"], picture.numbers["pairs"]))


def _figure(path: dict[str, Any], pairs: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 165 * MM), layout="constrained")
        parts: Any = figure.subfigures(2, 1, height_ratios=(120, 45))
        shape, value, slope, error = parts[0].subplots(2, 2).ravel()
        _draw_errors(parts[1].subplots(), pairs)
        _draw_shapes(shape, path)
        u, events = np.array(path["u"]), np.array(path["event"])
        _bands([value, slope, error], u, events)
        value.plot(u, path["value"], color=BLACK)
        letter(value, "b", "distance of the arc from the parabola")
        value.set_ylabel("distance $h$")
        value.set_ylim(top=value.get_ylim()[1] + 0.2 * np.ptp(value.get_ylim()))
        slope.plot(u, path["difference"], "o", color=GRAY, markersize=3.6, markerfacecolor="none", label="differences")
        slope.plot(u, path["rule"], color=GREEN, linewidth=1.4, label="jhd")
        slope.plot(u, path["naive"], color=VERMILLION, linestyle="none", marker="x", markersize=2.6, label="naive")
        letter(slope, "c", "its derivative along the path")
        slope.set_ylabel("d$h$/d$u$")
        slope.legend(loc="upper center", ncols=3, handletextpad=0.4, columnspacing=1.0)
        slope.set_ylim(top=slope.get_ylim()[1] + 0.25 * np.ptp(slope.get_ylim()))
        difference = np.array(path["difference"])
        for key, color, marker in (("rule", GREEN, "o"), ("naive", VERMILLION, "x")):
            off = np.maximum(np.abs(np.array(path[key]) - difference), 1e-16)
            error.semilogy(u, off, linestyle="none", marker=marker, color=color, markersize=2.6)
        letter(error, "d", "errors against central differences")
        error.set_ylabel("|error| of d$h$/d$u$")
        error.text(0.3, 0.62, "equal where one foot is active", transform=error.transAxes, color=BLACK)
        for ax in (value, slope, error):
            ax.set_xlabel("parameter $u$ of the path")
            ax.set_xlim(0, 1)
    return figure


def _draw_errors(ax: Axes, pairs: dict[str, Any]) -> None:
    """Plot errors of first and second derivatives for random pairs of curves, by event, with the largest."""
    looks = {"first": ("o", GREEN, "first derivative", -0.22), "second": ("s", BLUE, "second derivative", 0.22)}
    for k, found in enumerate(pairs.values()):
        for order, (marker, color, label, shift) in looks.items():
            values = np.maximum(np.sort(found[order]), 1e-16)
            place = k + shift + 0.2 * np.linspace(-0.5, 0.5, len(values)) * (len(values) > 1)
            named = label if k == 0 else None
            ax.semilogy(place, values, marker, color=color, markersize=2.6, markerfacecolor="none", label=named)
            text = power_text(values[-1])
            ax.annotate(text, (k + shift, values[-1]), (0, 4), textcoords="offset points", ha="center", va="bottom")
    titles = [f"{_NAMES.get(name, name)}, {len(found['first'])}" for name, found in pairs.items()]
    ax.set_xticks(range(len(pairs)), titles)
    ax.tick_params(axis="x", length=0)
    ax.set_xlim(-0.5, len(pairs) - 0.5)
    ax.set_ylim(top=30 * ax.get_ylim()[1])
    ax.set_xlabel("event, and the number of pairs")
    ax.set_ylabel("relative error")
    ax.legend(loc="upper right", ncols=2, borderaxespad=0.1)
    letter(ax, "e", "errors of derivatives, all kinds of curves, with the largest")


def _draw_shapes(ax: Axes, path: dict[str, Any]) -> None:
    t = np.linspace(0, 1, 200)
    ax.plot(*np.asarray(bezier([path["parabola"]])(t)).T, color=BLACK)
    arcs = path["arcs"]
    for k in np.unique(np.linspace(0, len(arcs) - 1, _SHOWN).astype(int)):
        shade = 0.75 - 0.75 * k / (len(arcs) - 1)
        line = np.asarray(bezier([arcs[k]])(t)).T
        ax.plot(*line, color=(shade, shade, 1.0) if shade > 0 else BLUE)
        text = f"{k / (len(arcs) - 1):.1f}"
        ax.annotate(
            text,
            (line[0, 0], line[1, 0]),
            (-3, 0),
            textcoords="offset points",
            ha="right",
            va="center",
            path_effects=_HALO,
        )
    ax.set_xlim(-1.35, 1.35)
    ax.set_ylim(-0.1, 1.85)
    ax.set_aspect("equal")
    ax.set_xlabel("$x$")
    ax.set_ylabel("$y$")
    letter(ax, "a", "the arc at parameters $u$, in a parabola")


def _bands(axes: list[Axes], u: np.ndarray, events: np.ndarray) -> None:
    """Draw bands in the color of the event, with their names in the first panel."""
    starts = np.flatnonzero(np.append(True, events[1:] != events[:-1]))
    for start, stop in zip(starts, np.append(starts[1:], len(u)), strict=True):
        left = 0.0 if start == 0 else 0.5 * float(u[start - 1] + u[start])
        right = 1.0 if stop == len(u) else 0.5 * float(u[stop - 1] + u[stop])
        color, name = _EVENTS[events[start]]
        for ax in axes:
            ax.axvspan(left, right, color=color, alpha=0.12, linewidth=0)
        if right - left > 0.05:
            turn = 90 if right - left < 0.2 else 0
            ax, height = axes[0], 0.95
            ax.text(
                0.5 * (left + right),
                height,
                name,
                transform=ax.get_xaxis_transform(),
                ha="center",
                va="top",
                rotation=turn,
            )


if __name__ == "__main__":
    main()
