"""A quartic surface with the ellipsoids of least squares and of least Hausdorff distance, and the convergence.

Numbers by fit_quadric's experiment.

Caption: A quartic surface with the least-squares ellipsoid and with the ellipsoid of least Hausdorff distance found,
and the convergence of the fit. The distance falls by 22 % in fewer than 40 evaluations, certified to 1e-9 at both ends.

Alt text: Two renderings of a blue quartic surface interpenetrated by an orange ellipsoid, with the farthest point
marked, and a step plot of the distance falling from 0.18 to 0.14.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, ORANGE, VERMILLION, Picture, letter, middle_text, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.proj3d import proj_transform

import jhd
from jhd._plot.faces import shaded_shapes
from jhd._plot.nets import quadrilaterals

_CELLS, _SMOKE_CELLS = 64, 16
_VIEW = 22, -58
_MARK: dict[str, Any] = {"linestyle": "none", "markeredgecolor": BLACK}
_FOOT: dict[str, Any] = {"marker": "s", "color": "white", "markersize": 3.5, **_MARK}
_FARTHEST: dict[str, Any] = {"marker": "o", "color": VERMILLION, "markersize": 4, **_MARK}


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers, _SMOKE_CELLS if picture.smoke else _CELLS))


def _figure(numbers: dict[str, Any], cells: int) -> Figure:
    ends = numbers["ends"]
    with style():
        figure = Figure(figsize=(175 * MM, 78 * MM))
        for k, (found, title) in enumerate(zip(ends, ("least squares", "least distance found"), strict=True)):
            ax: Any = figure.add_axes((0.3 * k, 0.16, 0.3, 0.72), projection="3d")
            _draw_surfaces(ax, numbers, found, cells)
            figure.text(0.3 * k + 0.012, 0.97, f"$\\bf{{({'ab'[k]})}}$ {title}", va="top")
            text = f"$H$ = {middle_text(found['lower'], found['upper'])}"
            figure.text(0.3 * k + 0.15, 0.1, text, ha="center", va="bottom")
        figure.legend(handles=_handles(), loc="lower left", ncols=4, columnspacing=1.2, handlelength=1.4)
        _draw_path(figure.add_axes((0.685, 0.23, 0.3, 0.67)), numbers)
    return figure


def _handles() -> list[Any]:
    return [
        Patch(facecolor=BLUE, label="quartic"),
        Patch(facecolor=ORANGE, label="ellipsoid fitted"),
        Line2D([], [], label="farthest point", **_FARTHEST),
        Line2D([], [], label="its feet", **_FOOT),
    ]


def _draw_surfaces(ax: Any, numbers: dict[str, Any], found: dict[str, Any], cells: int) -> None:
    """Draw the quartic in blue, the ellipsoid in orange, the witness and its feet."""
    size = numbers["box"]
    p, u = np.array(found["parameters"][:3]), np.array(found["parameters"][3:])
    coefficients = np.zeros((3, 3, 3))
    coefficients[0, 0, 0] = np.sum(p * u**2) - 1
    for axis in range(3):
        one = np.eye(3, dtype=int)[axis]
        coefficients[tuple(one)], coefficients[tuple(2 * one)] = -2 * p[axis] * u[axis], p[axis]
    quartic = jhd.ImplicitSurface.parse(numbers["target"], [-size] * 3, [size] * 3)
    ellipsoid = jhd.ImplicitSurface(coefficients, [-size] * 3, [size] * 3)
    faces = _outside(quartic, ellipsoid, cells), _outside(ellipsoid, quartic, cells)
    shaded_shapes(ax, faces, (BLUE, ORANGE), (None, None), 1.0)
    point, feet = np.array(found["point"]), np.array(found["feet"])
    for foot, weight in zip(feet, found["multipliers"], strict=True):
        if weight > 0:
            ax.plot(*np.transpose([point, foot]), color=BLACK, linewidth=1.2, zorder=8)
            ax.plot(*foot[:, None], zorder=9, **_FOOT)
    ax.plot(*point[:, None], zorder=9, **_FARTHEST)
    limits = 0.8 * np.array([-size, size])
    ax.set(xlim=limits, ylim=limits, zlim=limits)
    ax.set_axis_off()
    ax.view_init(*_VIEW)
    ax.set_box_aspect((1, 1, 1), zoom=1.7)
    _draw_scale(ax)


def _draw_scale(ax: Any) -> None:
    """Draw a unit of length across the view at the depth of the center, below the shapes."""
    across = np.array([-np.sin(np.radians(_VIEW[1])), np.cos(np.radians(_VIEW[1])), 0.0])
    ends: Any = across[:, None] * np.array([-0.5, 0.5])
    x, y, _ = proj_transform(ends[0], ends[1], ends[2], ax.get_proj())
    (left, _), (right, _) = ax.figure.transFigure.inverted().transform(ax.transData.transform(np.transpose([x, y])))
    ax.figure.add_artist(Line2D([left, right], [0.205, 0.205], color=BLACK, linewidth=1.2))
    ax.figure.text(right + 0.008, 0.205, "1", va="center")


def _outside(shape: jhd.ImplicitSurface, other: jhd.ImplicitSurface, cells: int) -> np.ndarray:
    """Return the faces outside another closed surface, cut at it, with the last corner repeated: (faces, 6, 3)."""
    faces = quadrilaterals(shape, cells)
    found = []
    for corners, values in zip(faces, np.asarray(other(faces)), strict=True):
        rows = []
        for here, there, low, high in zip(corners, np.roll(corners, -1, 0), values, np.roll(values, -1), strict=True):
            rows += [here] if low >= 0 else []
            rows += [here + low / (low - high) * (there - here)] if low * high < 0 else []
        if len(rows) > 2:
            found.append(rows + rows[-1:] * (6 - len(rows)))
    return np.array(found)


def _draw_path(ax: Axes, numbers: dict[str, Any]) -> None:
    path = np.array(numbers["path"])
    ax.plot(path, color=BLUE, drawstyle="steps-post")
    lower = np.flatnonzero(np.append(True, np.diff(path) < 0))
    ax.plot(lower, path[lower], "o", color=BLUE, markersize=4, label="steps that were taken")
    ax.axhline(path[-1], color=GRAY, linewidth=0.6, linestyle=":")
    ax.set(xlabel="evaluation", ylabel="distance $H$ (input units)", ylim=(0, 1.15 * path.max()))
    ax.set_xlim(-0.5, len(path) - 0.5)
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.yaxis.set_major_locator(MaxNLocator(6))
    ax.legend(loc="lower left", borderaxespad=0.1, frameon=False)
    letter(ax, "c", "bundle method")


if __name__ == "__main__":
    main()
