"""Distance map with nearest arcs, its graph as cones over the plane, and a curve trimmed by the region of radius LB.

Numbers by kim10_figures's experiment. A second picture has four pairs, one for each event, with map, reading and both
curves trimmed; a third one draws the steps for an arc.

Caption: A distance map with nearest arcs, its graph as cones, and curves trimmed by the region of radius LB (figures 7,
8, 10 and 17 of Kim et al. 2010, with our own data). The maximum remains, with less than a tenth of A. Second picture: a
pair for each of the four events (figure 1 of Cao et al. 2014, figure 18 of Kim et al.); trimmed as published, nothing
of B remains. Third picture: the steps for an arc (figures 1 to 6, 9 and 11 to 16).

Alt text: Top, a plane in colored sectors around an open oval of arcs, and the distance as a faceted surface over that
plane. Bottom, two curves in a gray region with a short red part that is kept, each next to a close-up.

Alt text of pairs: A grid of four rows, one for each event, and four columns: both curves with their distance, the map
of nearest arcs, the distance along A, and the parts of both curves that are kept.

Alt text of parts: Eight small sketches of circular arcs: a biarc, feet on an arc, pixels passed by a curve, nearest
arcs, the region about an arc, an arc that leaves it, its turning angle, and an arc that leaves a strip unnoticed.
"""

from typing import Any

import common_arcs
import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

import jhd

# Five light colors in turn: neighbors differ in lightness too.
_FILLS = ("#9ecae9", "#fbe3a1", "#8fd3b6", "#f7c6a3", "#e3c1d9")
_LEVELS = 9
_SHOWN = ("antipodal", "end")
_REGION = "#dcdcdc"
_B: dict[str, Any] = {"color": BLACK, "linewidth": 1.2}
_TRIMMED: dict[str, Any] = {"color": BLUE, "linewidth": 1.0, "linestyle": (0, (3, 1.2))}
_LEFT: dict[str, Any] = {"color": VERMILLION, "linewidth": 2.8, "solid_capstyle": "butt"}
_LEFT_OF_B: dict[str, Any] = {"color": ORANGE, "linewidth": 3.4, "solid_capstyle": "butt"}
_DISTANCE: dict[str, Any] = {"color": GREEN, "linewidth": 1.6}
# Names of the four events in Cao et al.
_WAYS = {
    "end": "end of $A$",
    "foot_at_end": "end of $B$",
    "antipodal": "common normal",
    "self_bisector": "one to two",
}
# A ring, so that the short part of the curve that remains there is seen.
_PLACE: dict[str, Any] = {
    "marker": "o",
    "markersize": 8,
    "markerfacecolor": "none",
    "markeredgecolor": BLACK,
    "zorder": 6,
}
_END: dict[str, Any] = {"color": BLACK, "marker": ".", "markersize": 2.6}
_WITNESS: dict[str, Any] = {"color": BLACK, "linewidth": 0.7, "marker": "o", "markersize": 3.0}


def main() -> None:
    """Draw and save the figures."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))
    picture.save(_pairs(picture.numbers), "_pairs")
    picture.save(_parts(), "_parts")


def _figure(numbers: dict[str, Any]) -> Figure:
    field, pairs = numbers["map"], numbers["pairs"]
    with style():
        figure = Figure(figsize=(175 * MM, 132 * MM), layout="constrained")
        top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.45, 1.0])[:, 0]
        grid = top.add_gridspec(1, 2, width_ratios=[1.0, 1.6])
        _draw_map(plane := top.add_subplot(grid[0]), field)
        letter(plane, "a", "arcs of $B$, and which is nearest")
        _draw_cones(cones := top.add_subplot(grid[1], projection="3d"), field)
        letter(cones, "b", "the distance to $B$: cones about the arcs")
        shown = [kind for kind in _SHOWN if kind in pairs] or list(pairs)
        axes = bottom.subplots(1, 2 * len(shown), squeeze=False, width_ratios=[1.75, 1.0] * len(shown))[0]
        for k, kind in enumerate(shown):
            ax, near = axes[2 * k : 2 * k + 2]
            _draw_trimmed(ax, pairs[kind])
            _draw_trimmed(near, pairs[kind])
            _enlarge(ax, near, pairs[kind])
            letter(ax, "cd"[k], f"{100 * pairs[kind]['share_left']:.1f} % of $A$ is kept")
        bottom.legend(handles=_handles(), loc="outside lower center", ncols=6, handlelength=1.8, columnspacing=1.6)
    return figure


def _pairs(numbers: dict[str, Any]) -> Figure:
    """Return a figure with a row for each pair: curves with distance, map of B, its reading along A, both trimmed."""
    pairs = numbers["pairs"]
    with style():
        figure = Figure(figsize=(175 * MM, (19 + 38 * len(pairs)) * MM), layout="constrained")
        axes = figure.subplots(len(pairs), 4, squeeze=False, width_ratios=(1, 1, 0.8, 1))
        for row, (kind, pair) in zip(axes, pairs.items(), strict=True):
            plane, field, profile, trimmed = row
            _draw_distance(plane, pair)
            _draw_map(field, pair["map"])
            _draw_reading(profile, pair)
            _draw_trimmed(trimmed, pair, both=True)
            for ax in (plane, field, trimmed):
                _bare(ax)
            plane.set_ylabel(_WAYS.get(kind, kind))
            kept = (f"{100 * pair[f'share_left{of}']:.1f} % of ${name}$" for of, name in (("", "A"), ("_of_b", "B")))
            trimmed.set_xlabel(", ".join(kept), labelpad=1)
        titles = ("distance of $A$ from $B$", "nearest arcs of $B$", "read along $A$", "kept of both")
        for ax, name, title in zip(axes[0], "abcd", titles, strict=True):
            letter(ax, name, title)
        more = [
            Line2D([], [], label="distance", **_DISTANCE),
            Line2D([], [], label="equally far from $B$", color=GRAY, linewidth=0.4),
            Line2D([], [], label="end of an arc", linestyle="none", **_END),
        ]
        if any(pair["share_left_of_b"] > 0 for pair in pairs.values()):
            more = [Line2D([], [], label="$B$, kept", **_LEFT_OF_B), *more]
        handles = [*_handles()[:3], *more, *_handles()[4:]]
        figure.legend(handles=handles, loc="outside lower center", ncols=4, handlelength=1.6, columnspacing=1.6)
    return figure


def _bare(ax: Axes) -> None:
    """Remove labels, ticks and spines from axes, and align them with the top of their cell."""
    ax.set(xlabel="", ylabel="", xticks=[], yticks=[], anchor="N")
    for spine in ax.spines.values():
        spine.set_visible(False)


def _parts() -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 88 * MM), layout="constrained")
        common_arcs.draw_all(figure.subplots(2, 4))
    return figure


def _draw_distance(ax: Axes, pair: dict[str, Any]) -> None:
    """Draw both curves, and the farthest point with its feet."""
    a, b = (jhd.BezierSegments(np.array(pair[name]["control_points"])) for name in "ab")
    ax.plot(*np.asarray(b(np.linspace(0, b.count, 600))).T, **_B)
    ax.plot(*np.asarray(a(np.linspace(0, a.count, 600))).T, **_TRIMMED)
    _draw_feet(ax, pair, **_DISTANCE)
    _finish(ax, *(np.array(pair["map"][key]) for key in "xy"))


def _draw_feet(ax: Axes, pair: dict[str, Any], **look: Any) -> None:
    witness = pair["solution"]["witness"]
    for foot in np.array(witness["feet"]):
        ax.plot(*np.stack([witness["point"], foot]).T, markevery=[1], **{**_WITNESS, **look})


def _draw_reading(ax: Axes, pair: dict[str, Any]) -> None:
    """Plot the distances that the map gives at samples of A, less its errors; the largest one is LB."""
    t, lower = (np.array(pair["profile"][key]) for key in ("t", "lower"))
    ax.plot(t, lower, color=BLUE)
    ax.axhline(pair["lower"], color=GRAY, linewidth=0.6)
    ax.annotate("$LB$", (0, pair["lower"]), (2, 2), textcoords="offset points")
    ax.set_ylim(0, 1.2 * pair["lower"])
    ax.set_xlabel("parameter of $A$", labelpad=1)
    ax.set_ylabel("distance to $B$", labelpad=1)


def _colors(field: dict[str, Any]) -> np.ndarray:
    """Return a color for each arc, in turn."""
    fills = np.array([to_rgb(x) for x in _FILLS])
    return fills[np.arange(len(field["arcs"]["weights"])) % len(fills)]


def _draw_map(ax: Axes, field: dict[str, Any]) -> None:
    """Draw pixels in the color of their nearest arc, lines of equal distance, and the arcs with their ends."""
    x, y, distance = (np.array(field[key]) for key in ("x", "y", "distance"))
    colors = _colors(field)
    palette: dict[str, Any] = {"cmap": ListedColormap(colors), "vmin": -0.5, "vmax": len(colors) - 0.5}
    ax.pcolormesh(x, y, np.array(field["nearest"]).T, rasterized=True, **palette)
    ax.contour(x, y, distance.T, levels=_LEVELS, colors=GRAY, linewidths=0.4)
    arcs = jhd.BezierSegments(np.array(field["arcs"]["control_points"]), np.array(field["arcs"]["weights"]))
    ax.plot(*np.asarray(arcs(np.linspace(0, arcs.count, 800))).T, color=BLACK, linewidth=1.2)
    ends = np.asarray(arcs.control_points)[:, [0, -1]].reshape(-1, 2)
    ax.plot(*ends.T, linestyle="none", **_END)
    _finish(ax, x, y)


def _draw_cones(ax: Any, field: dict[str, Any]) -> None:
    """Draw the graph of the distance, each point in the color of its nearest arc."""
    step = max(1, len(field["x"]) // 120)
    x, y = (np.array(field[key])[::step] for key in ("x", "y"))
    z, nearest = (np.array(field[key])[::step, ::step] for key in ("distance", "nearest"))
    how: dict[str, Any] = {"rcount": len(x), "ccount": len(y), "linewidth": 0, "antialiased": False}
    # Slopes down to the right are darker; the shading of matplotlib darkens light colors too much.
    slope = np.gradient(z, x, y)[0]
    shade = 0.86 + 0.14 * slope / np.max(np.abs(slope))
    colors = _colors(field)[nearest] * shade[..., None]
    ax.plot_surface(*np.meshgrid(x, y, indexing="ij"), z, facecolors=colors, shade=False, rasterized=True, **how)
    ax.view_init(elev=36, azim=-58)
    ax.set_box_aspect((np.ptp(x), np.ptp(y), 1.5 * np.ptp(z)), zoom=1.08)
    ax.set_xlabel("$x$", labelpad=-8)
    ax.set_ylabel("$y$", labelpad=-5)
    ax.set_zlabel("distance", labelpad=-4)
    ax.tick_params(pad=-2)
    ax.zaxis.set_major_locator(MultipleLocator(1))


def _draw_trimmed(ax: Axes, pair: dict[str, Any], both: bool = False) -> None:
    """Draw the region of radius LB about b, both curves, kept parts of a (or both) bold, and the maximum with feet."""
    region = pair["region"]
    x, y, distance = (np.array(region[key]) for key in ("x", "y", "distance"))
    ax.contourf(x, y, distance.T, levels=[0, pair["lower"]], colors=[_REGION])
    ax.contour(x, y, distance.T, levels=[pair["lower"]], colors=GRAY, linewidths=0.6)
    a, b = (jhd.BezierSegments(np.array(pair[name]["control_points"])) for name in "ab")
    ax.plot(*np.asarray(b(np.linspace(0, b.count, 600))).T, **_B)
    ax.plot(*np.asarray(a(np.linspace(0, a.count, 600))).T, **_TRIMMED)
    if both:
        _draw_left(ax, b, pair["parts_of_b"], _LEFT_OF_B)
    _draw_left(ax, a, pair["parts"], _LEFT)
    _draw_feet(ax, pair)
    _finish(ax, x, y)


def _draw_left(ax: Axes, curve: jhd.BezierSegments, parts: dict[str, Any], look: dict[str, Any]) -> None:
    """Draw the parts of a curve that remain."""
    for segment, t0, t1, left in zip(*(parts[key] for key in ("segment", "t0", "t1", "left")), strict=True):
        if left:
            ax.plot(*np.asarray(curve.point(np.full(16, segment), np.linspace(t0, t1, 16))).T, **look)


def _enlarge(ax: Axes, near: Axes, pair: dict[str, Any]) -> None:
    """Show the neighborhood of the maximum in the second axes, and mark its box in the first ones."""
    x, y = pair["solution"]["witness"]["point"]
    near.plot(x, y, **_PLACE)
    half = 0.05 * pair["diagonal"]
    near.set_xlim(x - half, x + half)
    near.set_ylim(y - half, y + half)
    near.set_ylabel("")
    for side in ("top", "right"):
        near.spines[side].set_visible(True)
    ax.indicate_inset((x - half, y - half, 2 * half, 2 * half), edgecolor=BLACK, alpha=1.0, linewidth=0.6)


def _handles() -> list[Any]:
    return [
        Line2D([], [], label="$B$", **_B),
        Line2D([], [], label="$A$, trimmed", **_TRIMMED),
        Line2D([], [], label="$A$, kept", **_LEFT),
        Line2D([], [], linestyle="none", label="maximum", **_PLACE),
        Line2D([], [], linestyle="none", label="foot", **_WITNESS),
        Patch(facecolor=_REGION, edgecolor=GRAY, linewidth=0.6, label="within $LB$ of $B$"),
    ]


def _finish(ax: Axes, x: np.ndarray, y: np.ndarray) -> None:
    ax.set_xlim(x[0], x[-1])
    ax.set_ylim(y[0], y[-1])
    ax.set_aspect("equal")
    ax.set_xlabel("$x$")
    ax.set_ylabel("$y$")


if __name__ == "__main__":
    main()
