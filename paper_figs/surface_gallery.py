"""Six pairs of algebraic surfaces, each with the farthest point, its feet and the bounds.

Numbers by surface_gallery's experiment.

Caption: Six pairs of algebraic surfaces, each with its farthest point, the foot points and the certified bounds. All
pairs except the torus close to 1e-6 within a second. The torus has a circle of foot points; its search stops early,
which the result reports, with bounds less than 2e-6 apart.

Alt text: Six boxes with two transparent surfaces each, blue and orange: cones, sphere and ellipsoid, torus and
ellipsoid, tanglecube and sphere, two cubics, Barth sextic and sphere. Segments join farthest points to their feet.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, MM, ORANGE, VERMILLION, Picture, middle_text, outward, solution, style
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

import jhd

_COLUMNS = 3
# Elevation and azimuth of the view of each pair, in degrees.
_VIEWS = {
    "two cones": (18, -52),
    "sphere, ellipsoid": (20, -60),
    "torus, ellipsoid": (30, -60),
    "tanglecube, sphere": (22, -50),
    "Clebsch, Cayley cubic": (22, -35),
    "Barth sextic, sphere": (20, -45),
}
# Cells along an axis for drawing surfaces.
_CELLS, _SMOKE_CELLS = 64, 16


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers, _SMOKE_CELLS if picture.smoke else _CELLS))


def _figure(numbers: dict[str, Any], cells: int) -> Figure:
    pairs = numbers["pairs"]
    rows = -(-len(pairs) // _COLUMNS)
    with style():
        # The last strip of the figure is for the key.
        key, whole = 7.0, rows * 68.0
        figure = Figure(figsize=(175 * MM, (whole + key) * MM))
        figure.legend(handles=_handles(), loc="lower center", ncols=4, columnspacing=2.0, handlelength=1.4)
        share = key / (whole + key)
        for k, pair in enumerate(pairs):
            row, column = divmod(k, _COLUMNS)
            left, height = column / _COLUMNS, (1 - share) / rows
            place = (left, 1 - (row + 1) * height + 0.09 * height, 1 / _COLUMNS - 0.005, 0.85 * height)
            ax: Any = figure.add_axes(place, projection="3d")
            _draw(ax, pair, cells)
            figure.text(left + 0.012, 1 - row * height - 0.018, f"$\\bf{{({'abcdef'[k]})}}$ {_title(pair)}", va="top")
            text = _text(pair)
            figure.text(left + 0.5 / _COLUMNS, 1 - (row + 1) * height + 0.02 * height, text, ha="center", va="bottom")
    return figure


def _handles() -> list[Any]:
    mark: dict[str, Any] = {"linestyle": "none", "markeredgecolor": BLACK, "markersize": 4}
    return [
        Patch(facecolor=BLUE, alpha=0.55, label="first surface"),
        Patch(facecolor=ORANGE, alpha=0.55, label="second surface"),
        Line2D([], [], marker="o", color=VERMILLION, label="farthest point", **mark),
        Line2D([], [], marker="s", color="white", label="its feet", **mark),
    ]


def _draw(ax: Any, pair: dict[str, Any], cells: int) -> None:
    """Draw both surfaces in the box, with the witness and no ticks: lengths stand below."""
    a, b = (jhd.ImplicitSurface.parse(text, pair["lower"], pair["upper"]) for text in pair["polynomials"])
    jhd.plot.surfaces((a, b), ax, labels=(None, None), cells=cells, alpha=0.55)
    # Points of implicit surfaces have no parameters, which are stored as null.
    point = pair["solution"]["witness"] | {"t": np.nan, "feet_params": [np.nan] * 4}
    jhd.plot.witness(solution(pair["solution"] | {"witness": point}), ax, distance=False)
    for line in ax.lines:
        if line.get_gid() in ("witness", "feet"):
            line.set_markersize(4)
    low, high = np.array(pair["lower"]), np.array(pair["upper"])
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    for i, p in enumerate(corners):
        for q in corners[i + 1 :]:
            if np.sum(p != q) == 1:
                ax.plot(*np.transpose(low + (high - low) * np.array([p, q])), color="#B0B0B0", linewidth=0.4, zorder=0)
    ax.set_axis_off()
    ax.view_init(*_VIEWS[pair["name"]])
    ax.set_box_aspect((1, 1, 1), zoom=1.12)


def _title(pair: dict[str, Any]) -> str:
    """Return the names, with a note if the search ended before its tolerance."""
    return pair["name"] + ("" if pair["solution"]["result"] == "successful" else "; ended early")


def _text(pair: dict[str, Any]) -> str:
    """Return the distance with its certified error, or its bounds if they differ by more than 2 %, and the seconds."""
    lower, upper = pair["solution"]["lower"], pair["solution"]["upper"]
    seconds = f"{pair['seconds']:.1f} s"
    if upper is None:
        return f"{outward(lower, lower, 3)[0]} ≤ $H$, {seconds}"
    half = (upper - lower) / 2
    if half > 0.01 * upper:
        low, high = outward(lower, upper, 3)
        return f"{low} ≤ $H$ ≤ {high}, {seconds}"
    return f"$H$ = {middle_text(lower, upper)}, {seconds}"


if __name__ == "__main__":
    main()
