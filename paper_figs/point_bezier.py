"""A point that slides past a cubic, its foot, and misses of local projections; numbers by point_bezier's experiment.

Writes a strip of six frames (.png, .pdf), the animation (.gif), and the methods compared (_methods.png, .pdf).

Caption: A point slides past a cubic, and its foot point jumps; the second picture counts wrong foot points of five
methods on 10 000 random cubics. The certified methods are never wrong. Interval halving and Newton's method are wrong
on 3 to 16 % of the queries.

Alt text: Six frames of a point that moves to the right past an N-shaped cubic, with a segment to its nearest point.
Below each frame, the distance over the parameter with its least value marked.

Alt text of methods: Three panels: distance to the foot of a sliding point with crosses at wrong answers, bars with the
percentage of wrong feet for five methods, and error against time for the k-d tree and jhd.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, PURPLE, VERMILLION, Picture, bezier, grouped, letter, style
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jhd import plot

_EDGE: dict[str, Any] = {"markeredgecolor": BLACK, "markeredgewidth": 0.6, "linestyle": "none"}
_POINT: dict[str, Any] = {"marker": "o", "markersize": 3.6, "color": BLACK, "linestyle": "none", "zorder": 6}
_FOOT: dict[str, Any] = {"marker": "s", "markersize": 3.8, "color": VERMILLION, "zorder": 5, **_EDGE}
_SHORT = {
    "IntervalHalvingProjection": "interval halving",
    "NewtonProjection": "Newton",
    "HybridProjection": "halving, Newton",
    "ProjectedPolyhedronProjection": "projected polyhedron",
    "BestFirstProjection": "nearest search",
}
# Color, marker and hatch of each spread of the queries.
_BARS = ((GREEN, "////"), (ORANGE, ""), (PURPLE, "...."))


def main() -> None:
    """Draw and save the figures."""
    picture = Picture(__file__, __doc__)
    path = picture.numbers["path"]
    picture.save(_strip(path))
    _animate(path, picture)
    picture.save(_methods(picture.numbers), "_methods")


class _Frame:
    """Artists of one frame: the curve with point and foot above, the distance over the parameter below."""

    def __init__(self, top: Axes, bottom: Axes, path: dict[str, Any]):
        self.path, self.curve = path, bezier([path["control_points"]])
        self.points = np.array(path["points"])
        self.t = np.array(path["methods"]["BestFirstProjection"]["t"])
        self.u = np.linspace(0.0, 1.0, 301)
        self.line = np.asarray(self.curve(self.u))
        plot.curve(self.curve, top, color=BLUE, control_polygon=False, samples=200)
        (self.spoke,) = top.plot([], [], color=BLACK, linewidth=1.0)
        (self.point,) = top.plot([], [], **_POINT)
        (self.foot,) = top.plot([], [], **_FOOT)
        (self.height,) = bottom.plot([], [], color=GRAY, linewidth=1.2)
        (self.least,) = bottom.plot([], [], **{**_FOOT, "clip_on": False})
        low, high = self.line.min(axis=0), self.line.max(axis=0)
        top.set_xlim(min(low[0], self.points[:, 0].min()) - 0.25, max(high[0], self.points[:, 0].max()) + 0.25)
        top.set_ylim(low[1] - 0.25, high[1] + 0.25)
        bottom.set_xlim(0, 1)
        bottom.set_ylim(0, 1.03 * np.max([self._profile(k).max() for k in range(len(self.points))]))

    def _profile(self, k: int) -> np.ndarray:
        return np.linalg.norm(self.line - self.points[k], axis=-1)

    def show(self, k: int) -> list[Any]:
        """Move the artists to frame k."""
        point, foot = self.points[k], np.asarray(self.curve(self.t[k]))
        self.spoke.set_data(*np.stack([point, foot], axis=-1))
        self.point.set_data(*point[:, None])
        self.foot.set_data(*foot[:, None])
        self.height.set_data(self.u, self._profile(k))
        self.least.set_data([self.t[k]], [self.path["distance"][k]])
        return [self.spoke, self.point, self.foot, self.height, self.least]


def _strip(path: dict[str, Any]) -> Figure:
    """Return six frames in a row: near the start, before and after each of the two jumps of the foot, near the end."""
    count, t = len(path["points"]), np.array(path["methods"]["BestFirstProjection"]["t"])
    jumps = np.sort(np.argsort(-np.abs(np.diff(t)))[:2])
    frames = [
        count // 8,
        *(k + part for k in jumps for part in (-(count // 40), 1 + count // 40)),
        count - 1 - count // 10,
    ]
    with style():
        figure = Figure(figsize=(175 * MM, 60 * MM), layout="constrained")
        axes = figure.subplots(2, 6, height_ratios=(0.7, 1.0))
        for column, k in enumerate(frames):
            top, bottom = axes[:, column]
            _Frame(top, bottom, path).show(int(k))
            top.set(xlabel="", ylabel="", xticks=[], yticks=[])
            top.set_axis_off()
            top.set_anchor("S")
            letter(top, "abcdef"[column], f"$x$ = {path['points'][k][0]:.2f}")
            bottom.set_xticks([0, 0.5, 1], ["0", "½", "1"])
            bottom.set_xlabel("parameter $u$")
            if column:
                bottom.set_yticklabels([])
        axes[1, 0].set_ylabel("distance $D(u)$\n(input units)")
    return figure


def _animate(path: dict[str, Any], picture: Picture) -> None:
    """Save the animation, one column wide at 144 dots an inch."""
    with style():
        figure = Figure(figsize=(85 * MM, 105 * MM), layout="constrained")
        top, bottom = figure.subplots(2, 1, height_ratios=(1.7, 1.0))
        frame = _Frame(top, bottom, path)
        top.set(xlabel="$x$ (input units)", ylabel="$y$ (input units)")
        bottom.set(xlabel="parameter $u$ on the cubic", ylabel="distance $D(u)$\n(input units)")
        animation = FuncAnimation(figure, frame.show, frames=len(path["points"]))  # pyright: ignore[reportArgumentType]
        animation.save(picture.path(".gif"), writer=PillowWriter(fps=20), dpi=144)
    print(picture.path(".gif"))


def _methods(numbers: dict[str, Any]) -> Figure:
    """Return a figure of misses of the local methods on the path, fractions of wrong feet, and error against time."""
    with style():
        figure = Figure(figsize=(175 * MM, 68 * MM), layout="constrained")
        path, shares, times = figure.subplots(1, 3, width_ratios=(1.0, 1.15, 0.9))
        _draw_path(path, numbers)
        _draw_shares(shares, numbers["random"])
        _draw_times(times, numbers["speed"])
    return figure


def _draw_path(ax: Axes, numbers: dict[str, Any]) -> None:
    path = numbers["path"]
    x, distance = np.array(path["points"])[:, 0], np.array(path["distance"])
    ax.plot(x, distance, color=BLUE, linewidth=1.4, label="certified", zorder=3)
    misses: dict[str, Any] = {"color": VERMILLION, "marker": "x", "markersize": 3.5, "linestyle": "none"}
    for name in ("IntervalHalvingProjection", "NewtonProjection", "HybridProjection"):
        found = np.array(path["methods"][name]["distance"])
        wrong = found > distance * (1 + numbers["wrong"])
        ax.plot(x[wrong], found[wrong], **misses)
    ax.plot([], [], label="local, wrong", **misses)
    ax.set(xlabel="coordinate $x$ of the point", ylabel="distance to the foot (input units)")
    ax.set_ylim(0, 1.35 * ax.get_ylim()[1])
    ax.legend(loc="upper right", handlelength=1.4, borderaxespad=0.1)
    letter(ax, "a", "sliding point")


def _draw_shares(ax: Axes, random: dict[str, Any]) -> None:
    names = list(random["methods"])
    spreads = [entry["spread"] for entry in random["methods"][names[0]]]
    height = 0.8 / len(spreads)
    for k, (spread, (color, hatch)) in enumerate(zip(spreads, _BARS, strict=False)):
        shares = [100 * random["methods"][name][k]["wrong"] for name in names]
        place = np.arange(len(names)) + (k - (len(spreads) - 1) / 2) * height
        label = f"σ = {spread:g}"
        ax.barh(place, shares, height, color=color, hatch=hatch, edgecolor=BLACK, linewidth=0.5, label=label)
    for k, name in enumerate(names):
        if not any(entry["wrong"] for entry in random["methods"][name]):
            ax.annotate("none", (0, k), (3, 0), textcoords="offset points", va="center")
    ax.set_yticks(range(len(names)), [_SHORT[name] for name in names])
    ax.invert_yaxis()
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel(f"wrong feet (% of {grouped(random['count'])})")
    ax.legend(loc="lower right", borderaxespad=0.1, handlelength=1.4, title="spread of query")
    letter(ax, "b", "random cubics")


def _draw_times(ax: Axes, speed: dict[str, Any]) -> None:
    ours, *trees = speed["entries"]
    ax.loglog(
        [e["seconds"] for e in trees],
        [e["error"] for e in trees],
        color=ORANGE,
        marker="D",
        markersize=4.5,
        **{"markeredgecolor": BLACK, "markeredgewidth": 0.6, "linestyle": (0, (4, 1.2))},
    )
    for e in trees:
        text = f"$10^{{{round(np.log10(e['samples']))}}}$"
        ax.annotate(text, (e["seconds"], e["error"]), (5, 2), textcoords="offset points")
    ax.loglog([ours["seconds"]], [ours["error"]], **{**_FOOT, "marker": "o", "markersize": 6})
    ax.annotate("jhd", (ours["seconds"], ours["error"]), (7, 0), textcoords="offset points", va="center")
    ax.annotate("k-d tree, samples:", (trees[0]["seconds"], trees[0]["error"]), (-4, 14), textcoords="offset points")
    seconds = [e["seconds"] for e in speed["entries"]]
    ax.set_xlim(min(seconds) / 2, max(seconds) * 4)
    ax.set_ylim(1e-16, 1)
    ax.set(xlabel="time (s)", ylabel="largest error (input units)")
    letter(ax, "c", f"{grouped(speed['count'])} queries")


if __name__ == "__main__":
    main()
