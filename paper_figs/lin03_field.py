"""Adaptive fields of meshes: slices with their cells, and the surfaces extracted from them, colored by error.

Black lines in the slices are the zero set; cells are drawn in gray. Times stand next to the printed times of the paper,
measured on a 933 MHz Pentium III for unknown tolerances.

Numbers by lin03_field's experiment. A second picture has the input meshes, and the regions about a triangle.

Caption: Adaptive fields of meshes of 67 500 and 48 000 triangles: slices with their cells, and the extracted surfaces
colored by error; times are listed next to those printed in 2003. The error is certified to be below twice the
tolerance, and the extracted surface is within that distance of the mesh, both ways. The second picture shows the input
meshes and the regions around a triangle that decide which feature is nearest (figures 5, 6 and 8 of Lin and Wang, with
other meshes).

Alt text: Six panels: two slices of signed distance with adaptive square cells and black outlines, two surfaces (a bumpy
sphere and a knotted tube) colored by their error, bars of times, and bars of errors.

Alt text of inputs: Gray renderings of a bumpy sphere and a knotted tube, and a triangle in a plane whose seven regions
are labeled with the signs of the barycentric coordinates.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, MM, ORANGE, Picture, grouped, letter, style
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize, to_rgb
from matplotlib.figure import Figure


def main() -> None:
    """Draw and save the figures."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))
    picture.save(_inputs(picture.numbers["meshes"]), "_inputs")


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 192 * MM), layout="constrained")
        # The panels below have columns of their own: their labels would push the pictures apart.
        parts: Any = figure.subfigures(2, 1, height_ratios=[1, 0.32])
        rows, below = parts[0].subplots(2, 2), parts[1].subplots(1, 2)
        for k, case in enumerate(numbers["meshes"]):
            _draw_slice(parts[0], rows[k, 0], case)
            letter(rows[k, 0], "ac"[k], f"{case['name']}: {grouped(case['leaves'])} cells")
            _draw_view(parts[0], rows[k, 1], case)
            letter(rows[k, 1], "bd"[k], "surface extracted, its error")
        _draw_times(below[0], numbers)
        letter(below[0], "e", "mesh to field")
        _draw_errors(below[1], numbers)
        letter(below[1], "f", "errors")
    return figure


def _inputs(meshes: list[dict[str, Any]]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 66 * MM), layout="constrained")
        first, second, regions = figure.subplots(1, 3)
        for ax, name, case in zip((first, second), "ab", meshes, strict=True):
            light = np.array(case["input"]["light"], float)
            ax.imshow(0.35 + 0.65 * light, cmap="gray", vmin=0, vmax=1, origin="lower", interpolation="nearest")
            _tight(ax, np.isfinite(light))
            counts = "\n".join(f"{grouped(case[key])} {key}" for key in ("vertices", "triangles"))
            ax.text(0.5, -0.02, counts, ha="center", va="top", transform=ax.transAxes)
            letter(ax, name, case["name"])
        _draw_regions(regions)
        letter(regions, "c", r"signs of $(\alpha, \beta, \gamma)$")
    return figure


def _draw_regions(ax: Axes) -> None:
    """Draw the seven regions of the plane of a triangle, by the signs of the barycentric coordinates."""
    corners = np.array([(0.0, 0.0), (1.0, 0.0), (0.45, 0.85)])
    x, y = np.meshgrid(np.linspace(-0.8, 1.9, 271), np.linspace(-0.7, 1.55, 226))
    inverse = np.linalg.inv(np.vstack([corners.T, np.ones(3)]))
    shares = np.einsum("ij,jyx->iyx", inverse, np.stack([x, y, np.ones_like(x)]))
    positive = (shares > 0).astype(int)
    # Colors by the number of positive coordinates: one beyond a corner, two next to a side, three inside.
    colors = np.array([[1.0, 1.0, 1.0], *(to_rgb(c) for c in ("#8fd3b6", "#9ecae9", "#fbe3a1"))])[positive.sum(axis=0)]
    extent = (x[0, 0], x[0, -1], y[0, 0], y[-1, 0])
    ax.imshow(colors, origin="lower", extent=extent, interpolation="nearest")
    for share in shares:
        ax.contour(x, y, share, levels=[0], colors=GRAY, linewidths=0.6)
    ax.fill(*corners.T, facecolor="none", edgecolor=BLACK, linewidth=1.4)
    for corner, name, move in zip(corners, "ABC", ((-7, 4), (7, 4), (9, 0)), strict=True):
        ax.annotate(name, corner, move, textcoords="offset points", ha="center", style="italic")
    for signs in np.unique(positive.reshape(3, -1).T, axis=0):
        here = (positive == signs[:, None, None]).all(axis=0)
        place = float(np.mean(x[here])), float(np.mean(y[here]))
        ax.text(*place, "".join("+" if s else "\N{MINUS SIGN}" for s in signs), ha="center", va="center")
    ax.set_axis_off()


def _tight(ax: Axes, seen: np.ndarray) -> None:
    """Crop an image to the pixels that are seen, with a small margin."""
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    ax.set_xlim(columns[0] - 2, columns[-1] + 2)
    ax.set_ylim(rows[0] - 2, rows[-1] + 2)
    ax.set_axis_off()


def _draw_slice(figure: Any, ax: Axes, case: dict[str, Any]) -> None:
    """Draw values, cells and the zero set in a plane."""
    stored, size = case["slice"], case["size"]
    (x0, y0), (x1, y1) = np.array(stored["lower"]) / size, np.array(stored["upper"]) / size
    values = np.array(stored["values"]).T / size
    limit = float(np.max(np.abs(values)))
    image = ax.imshow(
        values, origin="lower", extent=(x0, x1, y0, y1), cmap="PuOr", vmin=-limit, vmax=limit, interpolation="bilinear"
    )
    lines = [line for x, y, side in np.array(stored["cells"]) / size for line in _sides(x, y, side)]
    ax.add_collection(LineCollection(lines, colors=GRAY, linewidths=0.25))
    ax.contour(values, [0.0], extent=(x0, x1, y0, y1), colors=BLACK, linewidths=0.7)
    ax.set_aspect("equal")
    ax.locator_params(nbins=4)
    ax.set_xlabel("$x$ / longest side")
    ax.set_ylabel("$y$ / longest side")
    figure.colorbar(image, ax=ax, shrink=0.8).set_label("signed distance / longest side")


def _sides(x: float, y: float, side: float) -> list[list[tuple[float, float]]]:
    """Return the lower and the left side of a square; its neighbors draw the others."""
    return [[(x, y), (x + side, y)], [(x, y), (x, y + side)]]


def _draw_view(figure: Any, ax: Axes, case: dict[str, Any]) -> None:
    """Draw the error as a color, darker if the surface turns away from the eye."""
    error = np.array(case["view"]["error"], float) / case["atol"]
    light = np.array(case["view"]["light"], float)
    seen = np.isfinite(error)
    colors = ScalarMappable(Normalize(0, 1), cmap="viridis")
    image = colors.to_rgba(np.where(seen, error, 0.0))
    image[..., :3] *= np.where(seen, 0.35 + 0.65 * np.where(seen, light, 0.0), 1.0)[..., None]
    image[~seen] = 1.0
    ax.imshow(image, origin="lower", interpolation="nearest")
    _tight(ax, seen)
    figure.colorbar(colors, ax=ax, shrink=0.8, extend="max").set_label("distance to the mesh / tolerance")


def _draw_times(ax: Axes, numbers: dict[str, Any]) -> None:
    """Draw the seconds of each mesh as bars."""
    names = []
    for k, (case, (count, time)) in enumerate(zip(numbers["meshes"], numbers["printed"], strict=True)):
        bars = (
            ("printed", time, GRAY),
            ("jhd, first call", case["first_call"], ORANGE),
            ("jhd, later calls", case["build"], BLUE),
        )
        for j, (label, value, color) in enumerate(bars):
            if value is None:  # a short run has the first call of one mesh alone
                continue
            ax.barh(4 * k + j, value, color=color, height=0.8)
            ax.text(value, 4 * k + j, f" {label}, {value:.1f} s".replace(".0 s", " s"), va="center")
        names.append(f"{grouped(case['triangles'])}\n({grouped(count)})")
    ax.set_yticks([1, 5], names)
    ax.invert_yaxis()
    ax.set_xlim(0, 1.5 * max(time for _, time in numbers["printed"]))
    ax.set_xlabel("time (s)")
    ax.set_ylabel("triangles (printed)")


def _draw_errors(ax: Axes, numbers: dict[str, Any]) -> None:
    """Plot the largest errors of the field and of the extracted mesh, in tolerances."""
    rows = ("sampled", "certified", "extracted to mesh", "mesh to extracted")
    for k, (case, color) in enumerate(zip(numbers["meshes"], (BLUE, ORANGE), strict=True)):
        ways = [case["hausdorff"][key]["upper"] for key in ("from", "to")]
        values = np.array([case["sampled"], case["certified"], *ways]) / case["atol"]
        places = np.arange(4) + 0.38 * (k - 0.5)
        ax.barh(places, values, height=0.34, color=color)
        for j, (place, value) in enumerate(zip(places, values, strict=True)):
            ax.text(value, place, f" {value:.2f}" + (f", {case['name']}" if j == 0 else ""), va="center")
    ax.set_yticks(range(4), rows)
    ax.invert_yaxis()
    ax.set_xlim(0, 1.8 * ax.get_xlim()[1])
    ax.set_xlabel("largest error / tolerance")


if __name__ == "__main__":
    main()
