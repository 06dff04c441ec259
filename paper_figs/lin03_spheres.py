"""The voxel method on two spheres of distance 2: its answers on 81 grids, and the locations of their samples.

Numbers by lin03_spheres's experiment.

Caption: The published voxel method on two spheres of distance 2 (figure 10 of Lin and Wang): the printed and the
certified points, the answers on 81 grids, and the points found. The answers reach 2.0166; the printed 2.0020 is among
the answers on 32 of the grids. The certified bounds enclose 2 and are less than 3e-12 apart.

Alt text: Three panels: two gray spheres joined by a short segment, cumulative curves of the answers on 81 grids, and
answers along a parabola over the distance of their samples from the line of centers.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

RADII, CENTER = (3.0, 2.0), 7.0
# The second coordinates of the printed points.
_PRINTED = (2.9992, 5.0012)


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(85 * MM, 158 * MM), layout="constrained")
        spheres, above, below = figure.subplots(3, 1, height_ratios=(1.0, 1.45, 1.45))
        _draw_spheres(spheres, numbers)
        _draw_answers(above, numbers)
        _draw_places(below, numbers)
    return figure


def _draw_spheres(ax: Axes, numbers: dict[str, Any]) -> None:
    """Draw both spheres seen along z, lit from the left, with the printed and the certified points."""
    printed = np.array([(y, numbers["line"]["x"]) for y in _PRINTED])
    certified = [(RADII[0], 0.0), (CENTER - RADII[1], 0.0)]
    for radius, center in zip(RADII, (0.0, CENTER), strict=True):
        x, y = np.meshgrid(*2 * [np.linspace(-radius, radius, 400)])
        height = np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0)) / radius
        light = np.where(height > 0, 0.55 + 0.45 * np.clip(0.8 * height - 0.4 * x / radius, 0, 1), np.nan)
        extent = (center - radius, center + radius, -radius, radius)
        ax.imshow(light, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent)
    ax.plot(*np.array(certified).T, "*-", color=GREEN, markersize=7, linewidth=1.0)
    ax.plot(*printed.T, "s", color=VERMILLION, markersize=4, markerfacecolor="none")
    ax.set_xlim(-RADII[0] - 0.1, CENTER + RADII[1] + 0.1)
    ax.set_ylim(-RADII[0] - 0.1, RADII[0] + 0.1)
    ax.set_axis_off()
    letter(ax, "a", "two spheres, printed and certified points")


def _draw_answers(ax: Axes, numbers: dict[str, Any]) -> None:
    """Plot the fraction of the answers below each value."""
    every = np.concatenate([answer["distances"] for answer in numbers["answers"]]) - 2
    taken = np.array([answer["first"] for answer in numbers["answers"]]) - 2
    for values, color, dashes, text, place in (
        (every, BLUE, "-", "any nearest pair", (0.0026, 0.72)),
        (taken, ORANGE, (0, (4, 1.5)), "first pair", (0.0134, 0.22)),
    ):
        ordered = np.sort(values)
        share = np.arange(1, len(ordered) + 1) / len(ordered)
        ax.step(np.append(0, ordered), np.append(0, share), where="post", color=color, linestyle=dashes)
        ax.text(*place, text, color=color)
    for x, color, text in (
        (numbers["printed"] - 2, VERMILLION, "printed"),
        (numbers["eps"], GRAY, r"stated error $\epsilon$"),
    ):
        ax.axvline(x, color=color, linewidth=0.8, linestyle=":")
        ax.annotate(text, (x, 1.0), (2, 2), xycoords=ax.get_xaxis_transform(), textcoords="offset points", color=color)
    ax.set_xlim(0, 0.0175)
    ax.set_ylim(0, 1.0)
    ax.set_xlabel("distance found, less 2")
    ax.set_ylabel("fraction of answers below")
    ax.set_xticks([0, 0.005, 0.01, 0.015])
    letter(ax, "b", f"answers on {len(numbers['answers'])} grids")
    # The names of the lines stand between the title and the axes.
    ax.set_title(ax.get_title(loc="left"), loc="left", pad=13)


def _draw_places(ax: Axes, numbers: dict[str, Any]) -> None:
    """Plot the answers over the distance of their samples from the line of centers."""
    x, z, value = (np.concatenate([answer[key] for answer in numbers["answers"]]) for key in ("x", "z", "distances"))
    off = np.hypot(x, z)
    radius = np.linspace(0, 1.05 * off.max(), 200)
    exact = CENTER - sum(np.sqrt(r**2 - radius**2) for r in RADII) - 2
    ax.plot(radius, exact, color=GRAY, linewidth=0.8, label="along a parallel of $y$")
    ax.plot(
        off, value - 2, "o", color=BLUE, markersize=2.4, markerfacecolor="none", markeredgewidth=0.5, label="answers"
    )
    line = numbers["line"]
    ax.plot(line["x"], line["distance"] - 2, "s", color=VERMILLION, markersize=5, label="printed, with $x = 0.0700$")
    ax.plot(0, 0, "*", color=GREEN, markersize=9, clip_on=False, zorder=9, label="jhd, to $3\\times10^{-12}$")
    ax.axhline(numbers["eps"], color=BLACK, linewidth=0.6, linestyle=":")
    ax.annotate(
        r"$\epsilon$", (0, numbers["eps"]), (3, -9), textcoords="offset points", xycoords=("axes fraction", "data")
    )
    ax.set_xlim(0, radius[-1])
    ax.set_ylim(0, 0.0195)
    ax.set_xlabel(r"samples' distance from the line of centers")
    ax.set_ylabel("distance found, less 2")
    ax.legend(loc="upper left", bbox_to_anchor=(0.02, 1.04), handletextpad=0.6, labelspacing=0.3)
    letter(ax, "c", "locations of the answers")


if __name__ == "__main__":
    main()
