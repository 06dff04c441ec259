"""Radial errors of the best Bezier quarter circles, with their equal maxima, and the convergence of the fits.

Numbers by quarter_circle's experiment.

Caption: Radial errors of the best Bézier quarter circles with their equal maxima, and the convergence of the fits. The
parameter of the one-parameter cubic is found to 1e-16 in 5 to 9 steps, with an error of 1.9608e-4. The errors of cubics
with fixed ends and free ends and of the quintic are 6.844e-5, 5.508e-5 and about 7.7e-10, all certified to 1e-12.

Alt text: Six panels: four radial error curves that oscillate between equal positive and negative extremes, each marked,
and two semilogarithmic plots of convergence against the step.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, certified_text, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

_TITLES = {
    "parameter": ("a", "cubic, one parameter $c$"),
    "fixed": ("c", "cubic, fixed ends"),
    "free": ("d", "cubic, free ends"),
    "quintic": ("e", "quintic, fixed ends"),
}
_RUNS = ((BLUE, "o", "-"), (ORANGE, "s", (0, (4, 1.2))), (PURPLE, "D", (0, (1, 1))))
_FITS = {"fixed": (BLUE, "o", "-"), "free": (ORANGE, "s", (0, (4, 1.2))), "quintic": (GREEN, "^", "-")}
_MARKS: dict[str, Any] = {"markersize": 3.6, "markeredgecolor": BLACK, "markeredgewidth": 0.5}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 105 * MM), layout="constrained")
        axes = figure.subplot_mosaic([["parameter", "c", "fixed"], ["free", "quintic", "excess"]])
        for name, fit in numbers["fits"].items():
            _draw_error(axes[name], fit)
            letter(axes[name], *_TITLES[name])
        _draw_parameter(axes["c"], numbers)
        letter(axes["c"], "b", "its $c$, from three starts")
        _draw_excess(axes["excess"], numbers["fits"])
        letter(axes["excess"], "f", "distance of (c), (d), (e)")
    return figure


def _draw_error(ax: Axes, fit: dict[str, Any]) -> None:
    """Plot the radial error in a power of ten, its equal maxima, and the levels that they reach."""
    h = fit["error"]["value"]
    power = int(np.floor(np.log10(h)))
    unit = 10.0**power
    for level in (h, -h):
        ax.axhline(level / unit, color=GRAY, linewidth=0.8, linestyle=(0, (4, 2)))
    ax.axhline(0, color=GRAY, linewidth=0.4)
    ax.plot(fit["curve"]["t"], np.array(fit["curve"]["error"]) / unit, color=BLUE, linewidth=1.2)
    pairs = fit["pairs"]
    active = np.array(pairs["active"])
    places = np.array(pairs["t"])[active]
    heights = (np.array(pairs["sign"]) * np.array(pairs["value"]))[active] / unit
    style: dict[str, Any] = {"marker": "o", "color": VERMILLION, "linestyle": "none", "clip_on": False, "zorder": 5}
    ax.plot(places, heights, **style, **_MARKS)
    limit = 1.75 * h / unit
    ax.set_ylim(-limit, limit)
    ax.set_xlim(0, 1)
    ax.set_xticks([0, 0.5, 1], ["0", "½", "1"])
    ax.set_xlabel("parameter $t$")
    ax.set_ylabel(f"$|B(t)| - 1$ ($10^{{{power}}}$ radii)")
    lower, upper = (float(fit["error"][name]) / unit for name in ("lower", "upper"))
    text = f"$h {certified_text(lower, upper, 4 if fit['degree'] == 5 else 6)} \\times 10^{{{power}}}$"
    ax.text(0.5, 0.98, text, transform=ax.transAxes, ha="center", va="top")
    ax.text(0.5, 0.02, f"{fit['active']} equal maxima", transform=ax.transAxes, ha="center", va="bottom")


def _draw_parameter(ax: Axes, numbers: dict[str, Any]) -> None:
    for run, (color, marker, line) in zip(numbers["runs"], _RUNS, strict=False):
        ax.semilogy(run["off"], color=color, marker=marker, linestyle=line, label=f"{run['start']:g}", **_MARKS)
    ax.axhline(numbers["within"], color=GRAY, linewidth=0.8, linestyle=(0, (4, 2)))
    ax.set_ylim(1e-18, 1e4)
    ax.set_xlim(left=-0.3)
    ax.set_xticks(range(0, 10, 3))
    ax.set_xlabel("step")
    ax.set_ylabel("$|c - c^*|$")
    ax.legend(loc="upper center", ncols=3, handlelength=2.2, handletextpad=0.5, columnspacing=1.0, borderaxespad=0.1)


def _draw_excess(ax: Axes, fits: dict[str, Any]) -> None:
    """Plot the excess of the distance over the final one, as a fraction of the final one."""
    for name in [name for name in _FITS if name in fits]:
        color, marker, line = _FITS[name]
        history = np.array(fits[name]["history"])
        excess = history[:-1] / history[-1] - 1
        every = ((len(excess) - 1) % 3, 3) if len(excess) > 20 else 1
        options: dict[str, Any] = {"linestyle": line, "label": f"({_TITLES[name][0]})", "markevery": every, **_MARKS}
        ax.semilogy(excess, color=color, marker=marker, **options)
    ax.xaxis.set_major_locator(MaxNLocator(4, integer=True))
    ax.set_xlabel("step")
    ax.set_ylabel("excess $h_k / h_{\\mathrm{end}} - 1$")
    ax.legend(loc="lower center", handlelength=2.4, borderaxespad=0.1)


if __name__ == "__main__":
    main()
