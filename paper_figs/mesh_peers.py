"""Nearest points and Hausdorff distances of meshes: queries per second of each library, and time against error.

Numbers by mesh_peers's experiment.

Caption: Nearest points per second of jhd, libigl, point-cloud-utils, Open3D and trimesh, as far as installed, and
Hausdorff distances of meshes: time against error. jhd finds nearest points one to four times as fast as libigl if they
are spread evenly, and about as fast (to a factor of 1.5) near the surface. The certified distance takes less than half
the time of a million samples, whose errors exceed 1 %.

Alt text: Left, horizontal bars of nearest points per second for each library and two kinds of points, with jhd at the
top. Right, a log-log plot of error against time, where jhd is a single star far below all other marks.
"""

from typing import Any

import numpy as np
from common import BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, grouped, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

_OURS = "jhd, certified"
# Color, marker, and whether the distances are too large or too small.
_WAYS = {
    _OURS: (BLUE, "*"),
    "libigl, vertices": (PURPLE, "D"),
    "samples, SciPy": (VERMILLION, "o"),
    "samples, point-cloud-utils": (ORANGE, "s"),
    "samples to meshes": (GREEN, "^"),
}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 72 * MM), layout="constrained")
        rates, errors = figure.subplots(1, 2)
        _draw_rates(rates, numbers["queries"], numbers["triangles"][0])
        _draw_errors(errors, numbers["hausdorff"])
    return figure


def _draw_rates(ax: Axes, queries: list[dict[str, Any]], triangles: int) -> None:
    """Draw bars of both kinds of points for each library, with the speed of jhd relative to it."""
    places = np.arange(len(queries))[::-1]
    for k, (name, color, hatch) in enumerate((("even in the box", BLUE, None), ("near the surface", ORANGE, "////"))):
        rates = [peer["rates"][k] for peer in queries]
        rows = places + (0.2, -0.2)[k]
        ax.barh(rows, rates, 0.36, color=color, hatch=hatch, edgecolor="white", linewidth=0, label=name)
        for y, rate, peer in zip(rows, rates, queries, strict=True):
            compared = "" if peer is queries[0] else f"  (jhd $\\times${peer['ratios'][k]:.2g})"
            text = grouped(float(f"{rate:.3g}"), ",.0f") + compared
            ax.annotate(text, (rate, y), (3, 0), textcoords="offset points", va="center")
    ax.set_xscale("log")
    rates = [rate for peer in queries for rate in peer["rates"]]
    ax.set_xlim(min(rates) / 3, max(rates) * 200)
    # Room for the legend below the bars.
    ax.set_ylim(-1.35, len(queries) - 0.5)
    ax.set_yticks(places, [peer["name"] for peer in queries])
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("nearest points per second")
    ax.legend(loc="lower left", ncols=2, handlelength=1.4, columnspacing=1.2)
    letter(ax, "a", f"queries on {grouped(triangles)} triangles, one core")


def _draw_errors(ax: Axes, ways: list[dict[str, Any]]) -> None:
    """Plot the relative error against seconds; markers are filled if the distance is too small, hollow if too large."""
    certified = (ways[0]["upper"] - ways[0]["lower"]) / ways[0]["value"]
    for name, (color, marker) in _WAYS.items():
        mine = [way for way in ways if way["name"] == name]
        if not mine:
            continue
        errors = [max(abs(way["error"]), certified) for way in mine]
        low = np.median([way["error"] for way in mine]) <= 0
        size = 9 if name == _OURS else 4.5
        text = "jhd (width of the certified bounds)" if name == _OURS else f"{name} (too {'small' if low else 'large'})"
        face = color if low else "white"
        seconds = [way["seconds"] for way in mine]
        ax.loglog(
            seconds,
            errors,
            marker=marker,
            color=color,
            markersize=size,
            markerfacecolor=face,
            linestyle=":",
            linewidth=0.9,
            label=text,
        )
        if name == "samples to meshes":
            _name_samples(ax, [way["samples"] for way in mine], seconds, errors)
    ax.set_ylim(certified / 10, 100)
    ax.set_xlabel("time (s)")
    ax.set_ylabel("relative error")
    ax.legend(loc="center left", bbox_to_anchor=(0.0, 0.42), labelspacing=0.3, borderaxespad=0.2)
    letter(ax, "b", "Hausdorff distances, one core")


def _name_samples(ax: Axes, samples: list[int], seconds: list[float], errors: list[float]) -> None:
    """Write each number of samples once, left of the lowest of its marks."""
    look: dict[str, Any] = {
        "ha": "right",
        "va": "center",
        "color": GRAY,
        "bbox": {"fc": "white", "ec": "none", "pad": 0.5},
    }
    for count in sorted(set(samples)):
        y, x = min((y, x) for y, x, those in zip(errors, seconds, samples, strict=True) if those == count)
        ax.annotate(_power(count), (x, y), (-6, 0), textcoords="offset points", **look)


def _power(count: int) -> str:
    """Return a number of samples as a power of ten if possible."""
    exponent = round(np.log10(count))
    return f"$10^{exponent}$" if 10**exponent == count else str(count)


if __name__ == "__main__":
    main()
