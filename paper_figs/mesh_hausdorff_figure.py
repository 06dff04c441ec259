"""Two meshes colored by their distance to each other, a section through the farthest point, and the bounds closing.

Numbers by mesh_hausdorff_figure's experiment.

Caption: Two meshes of one surface colored by their distance to each other, a section through the farthest point, and
the convergence of the bounds. Both directed distances are certified to 1e-9 of their values in fewer than
20 rounds.

Alt text: Two renderings of a faceted bumpy ball colored from dark blue to yellow by distance, with the farthest point
marked; a section with both meshes; and two lines that show the gap of the bounds falling by the round.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, MM, ORANGE, VERMILLION, Picture, grouped, letter, style
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

_NAMES = {"a_to_b": "from $A$ to $B$", "b_to_a": "from $B$ to $A$"}
_STYLES = {"a_to_b": (BLUE, "o", "-"), "b_to_a": (ORANGE, "s", "--")}
# The view is turned away from the farthest point by these angles, so that the point is not in the middle.
_TURN, _LIFT = 0.45, 0.3
# Fraction of a color that faces turned from the light lose.
_SHADE = 0.3
# Least cosine of the angle of a triangle to the eye for its edges to be drawn.
_RIM = 0.25
# Edges of more triangles would hide the colors.
_FEW = 3000
_COLORS = "viridis"


def main() -> None:
    """Draw and save the figure."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))


def _figure(numbers: dict[str, Any]) -> Figure:
    largest = max(entry["solution"]["value"] for entry in numbers["directions"].values())
    scale = Normalize(0, largest)
    with style():
        figure = Figure(figsize=(175 * MM, 132 * MM), layout="constrained")
        halves: Any = figure.subfigures(2, 1, height_ratios=(1.15, 1))
        above, below = halves
        left, right = above.subplots(1, 2)
        shown = numbers["b"] if len(numbers["b"]["triangles"]) <= _FEW else None
        for ax, name, text in (
            (left, "a", "mesh $A$"),
            (right, "b", "mesh $B$, its edges in both" if shown else "mesh $B$"),
        ):
            mine = numbers["directions"]["a_to_b" if name == "a" else "b_to_a"]["solution"]["witness"]
            _draw_mesh(ax, numbers[name], shown, mine, scale)
            letter(ax, name, f"{text}; {grouped(len(numbers[name]['triangles']))} triangles")
        bar = above.colorbar(ScalarMappable(scale, _COLORS), ax=[left, right], shrink=0.85, aspect=24)
        bar.set_label("distance to the other mesh")
        section, bounds = below.subplots(1, 2, width_ratios=(1, 1.15))
        _draw_section(section, numbers["section"], numbers["larger"])
        _draw_bounds(bounds, numbers["directions"])
    return figure


def _draw_mesh(
    ax: Axes, mesh: dict[str, Any], lines: dict[str, Any] | None, witness: dict[str, Any], scale: Any
) -> None:
    """Draw a mesh seen from near its farthest point, with the edges of a coarse mesh and the point."""
    corners = np.array(mesh["vertices"])[np.array(mesh["triangles"])]
    middle = (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1))) / 2
    axes = _eye(np.array(witness["point"]) - middle)
    weights, distance = np.array(mesh["weights"]), np.array(mesh["distance"])
    parts = np.einsum("pck,tkd->tpcd", weights, corners) @ axes.T
    towards, light = _facing(corners, axes)
    seen = towards > 0
    polygons, values = parts[seen].reshape(-1, 3, 3), distance[seen].ravel()
    shade = 1 - _SHADE * (1 - np.repeat(light[seen], len(weights)))
    order = np.argsort(polygons[:, :, 2].mean(axis=1))
    colors = ScalarMappable(scale, _COLORS).to_rgba(values)[:, :3] * shade[:, None]
    # Faces are drawn with edges of their own color: no light shines between them.
    ax.add_collection(
        PolyCollection(
            list(polygons[order, :, :2]),
            facecolor=colors[order],
            edgecolor=colors[order],
            linewidth=0.25,
            rasterized=True,
        )
    )
    if lines:
        _draw_edges(ax, lines, axes)
    x, y, _ = axes @ np.array(witness["point"])
    ax.plot(x, y, "o", color=VERMILLION, markersize=5, markeredgecolor="white", markeredgewidth=0.8, zorder=5)
    halo: Any = [withStroke(linewidth=2.4, foreground="white")]
    ax.annotate("farthest point", (x, y), (7, 6), textcoords="offset points", zorder=6, path_effects=halo)
    ax.autoscale_view()
    ax.set_aspect("equal")
    ax.axis("off")


def _eye(towards: np.ndarray) -> np.ndarray:
    """Return axes to the right, up, and towards the eye, turned a little away from a direction."""
    azimuth, height = np.arctan2(towards[1], towards[0]) + _TURN, np.arcsin(towards[2] / np.linalg.norm(towards))
    height = np.clip(height + (_LIFT if height < 0 else -_LIFT), -1.2, 1.2)
    eye = np.array([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)])
    right = np.cross([0, 0, 1], eye)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(eye, right), eye])


def _facing(corners: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return cosines of triangle normals to the eye, and to a light from the upper left (zero if turned away)."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(length > 0, length, 1.0)
    light = np.array([-0.4, 0.5, 0.77]) @ axes
    return normal @ axes[2], np.clip(normal @ light, 0, 1)


def _draw_edges(ax: Axes, mesh: dict[str, Any], axes: np.ndarray) -> None:
    """Draw the edges of the triangles that are turned towards the eye."""
    vertices, triangles = np.array(mesh["vertices"]), np.array(mesh["triangles"])
    towards, _ = _facing(vertices[triangles], axes)
    # At the rim, edges would crowd, and some are behind other parts.
    shown = triangles[towards > _RIM]
    edges = np.unique(np.sort(np.concatenate([shown[:, [0, 1]], shown[:, [1, 2]], shown[:, [2, 0]]]), axis=1), axis=0)
    ends = (vertices @ axes.T)[edges][:, :, :2]
    ax.add_collection(LineCollection(list(ends), colors="white", linewidths=0.3, alpha=0.6, rasterized=True))


def _draw_section(ax: Axes, section: dict[str, Any], larger: str) -> None:
    """Draw both meshes in a plane through the farthest point and its feet, in true lengths."""
    for name, (color, line) in {"a": (BLUE, "solid"), "b": (ORANGE, "solid")}.items():
        segments = [np.array(ends) for ends in section[name]]
        width = 1.6 if name == "a" else 1.2
        ax.add_collection(LineCollection(segments, colors=color, linestyles=line, linewidths=width))
        ax.plot([], [], color=color, linewidth=width, label=f"mesh ${name.upper()}$")
    for foot in section["feet"]:
        ax.plot([0, foot[0]], [0, foot[1]], color=BLACK, linewidth=0.9, linestyle=(0, (3, 1.5)), zorder=4)
        ax.plot(*foot, "o", color="white", markeredgecolor=BLACK, markersize=4, zorder=5)
    ax.plot(
        [],
        [],
        "o",
        color="white",
        markeredgecolor=BLACK,
        markersize=4,
        label="feet" if len(section["feet"]) > 1 else "foot",
    )
    ax.plot(0, 0, "o", color=VERMILLION, markersize=5, zorder=6, label="farthest point")
    distance, width = section["distance"], section["width"]
    ax.set_xlim(-0.9 * width, 0.9 * width)
    ax.set_ylim(-0.65 * width, 0.55 * width)
    ax.set_aspect("equal")
    ax.set_xlabel("offset along the section")
    ax.set_ylabel("offset from the farthest point")
    ax.legend(loc="lower center", ncols=2, columnspacing=1.2, handlelength=1.6, labelspacing=0.3)
    letter(ax, "c", f"section, distance {distance:.6f} {_NAMES[larger]}")


def _draw_bounds(ax: Axes, directions: dict[str, Any]) -> None:
    """Plot the difference of the bounds after each round."""
    for name, entry in directions.items():
        color, marker, line = _STYLES[name]
        steps = [row["steps"] for row in entry["rounds"]]
        gap = [(row["upper"] - row["lower"]) / entry["solution"]["value"] for row in entry["rounds"]]
        ax.semilogy(steps, gap, color=color, marker=marker, linestyle=line, markersize=4, label=_NAMES[name])
    ax.set_xlabel("round")
    ax.set_ylabel("(upper $-$ lower) / distance")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="upper right")
    letter(ax, "d", "certified bounds closing")


if __name__ == "__main__":
    main()
