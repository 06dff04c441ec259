"""Distance transforms: the one-dimensional example, a slice with the published method's errors, and times.

White dots in the slice mark the columns along the third axis in which the published method errs somewhere.

Numbers by lin03_transform's experiment. A second picture has the templates, in one to three dimensions.

Caption: Distance transforms: the one-dimensional example of Lin and Wang, a slice with the errors of vector propagation
(white dots mark columns with errors), and times. Vector propagation is wrong on less than 0.1 % of the voxels, by less
than 0.1 voxel. The exact transform equals SciPy's and is faster on every grid. The second picture shows the templates
(figures 1, 3 and 4), reconstructed from the printed one and the counts of operations.

Alt text: Four panels: a row of seven pixels with signed offsets to the feature, a round slice with white dots near its
center, times of three methods against the grid size, and the fractions of wrong voxels for three shapes.

Alt text of templates: Eleven small grids of boxes: the templates of one, two and three dimensions. Yellow boxes hold
the steps to the neighbors that are read, gray boxes the voxel itself.
"""

from typing import Any

import numpy as np
from common import BLACK, BLUE, GRAY, GREEN, MM, ORANGE, VERMILLION, Picture, letter, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

_TIMES = (
    ("exact", "jhd (exact)", BLUE, "o", "-"),
    ("vector_propagation", "published templates", VERMILLION, "s", "--"),
    ("scipy", "SciPy", GRAY, "^", ":"),
)
_SHAPES = (("shell", BLUE, "o", "-"), ("tube", ORANGE, "s", "--"), ("scattered", GREEN, "^", ":"))


def main() -> None:
    """Draw and save the figures."""
    picture = Picture(__file__, __doc__)
    picture.save(_figure(picture.numbers))
    picture.save(_templates(picture.numbers["templates"]), "_templates")


def _figure(numbers: dict[str, Any]) -> Figure:
    with style():
        figure = Figure(figsize=(175 * MM, 125 * MM), layout="constrained")
        line, plane, times, errors = figure.subplots(2, 2).ravel()
        _draw_line(line, numbers["line"]["vector_propagation"])
        _draw_slice(figure, plane, numbers["slice"])
        _draw_times(times, numbers)
        _draw_errors(errors, numbers)
    return figure


def _templates(templates: list[list[list[int]]]) -> Figure:
    """Return a figure of the templates in one, two and three dimensions; the 2-D ones are slices of the 3-D ones."""
    flat = [[step[:2] for step in template if not step[2]] for template in templates]
    # In one dimension there are only the steps along a row, in both directions.
    lines = [[step for step in template if not step[0]] for template in flat[:2]]
    with style():
        figure = Figure(figsize=(175 * MM, 82 * MM), layout="constrained")
        parts: Any = figure.subfigures(2, 1, height_ratios=(1, 1.25))
        above = parts[0].subplots(1, 6, width_ratios=(1, 1, 1.3, 1.3, 1.3, 1.3))
        for k, template in enumerate(lines):
            _draw_template(above[k], [step[1:] for step in template], (1, 3))
            letter(above[k], "ab"[k], f"1-D: {k + 1}")
        for k, template in enumerate(flat):
            _draw_template(above[2 + k], template, (3, 3))
            letter(above[2 + k], "cdef"[k], f"2-D: {k + 1}")
        below = parts[1].subplots(1, 5)
        _draw_template(below[0], [step for step in templates[0] if step[2]], (3, 3), center=False)
        letter(below[0], "g", "3-D: 1, at $k+1$")
        for k, template in enumerate(templates):
            _draw_template(below[1 + k], [step for step in template if not step[2]], (3, 3), dim=3)
            letter(below[1 + k], "hijk"[k], f"3-D: {k + 1}, at $k$")
    return figure


def _draw_template(
    ax: Axes, steps: list[list[int]], shape: tuple[int, int], center: bool = True, dim: int | None = None
) -> None:
    """Draw boxes around a voxel with the steps to the neighbors that are read; rows go down, columns to the right."""
    zero = [0] * (dim or len(steps[0]))
    taken = {tuple(step[:2] if len(step) > 1 else [0, *step]): step for step in [*steps, *([zero] if center else [])]}
    for i in range(-(shape[0] // 2), shape[0] // 2 + 1):
        for j in range(-1, 2):
            step = taken.get((i, j))
            color = "none" if step is None else "#fbe3a1" if any(step) else "#c9c9c9"
            ax.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, facecolor=color, edgecolor=BLACK, linewidth=0.6))
            if step is not None:
                text = ",".join(f"{x:d}".replace("-", "\N{MINUS SIGN}") for x in step)
                ax.text(j, i, text, ha="center", va="center", fontsize=6 if len(step) > 1 else 8)
    ax.set_xlim(-1.55, 1.55)
    ax.set_ylim(shape[0] / 2 + 0.05, -shape[0] / 2 - 0.05)
    ax.set_aspect("equal", anchor="N")
    ax.axis("off")


def _draw_line(ax: Axes, offsets: list[int]) -> None:
    """Draw pixels with the signed offset to the feature in each, and an arrow along the offset."""
    for i, offset in enumerate(offsets, start=1):
        color = "#E8E8E8" if offset == 0 else "none"
        ax.add_patch(Rectangle((i - 0.5, 0), 1, 1, facecolor=color, edgecolor=BLACK, linewidth=0.8))
        ax.text(i, 0.5, f"{offset:d}".replace("-", "\N{MINUS SIGN}"), ha="center", va="center", fontsize=10)
        ax.text(i, -0.12, str(i), ha="center", va="top", color=GRAY)
        if offset:
            height = 1.15 + 0.3 * (abs(offset) - 1)
            ax.annotate(
                "",
                (i + offset, height),
                (i, height),
                arrowprops={"arrowstyle": "->", "color": BLUE, "shrinkA": 0, "shrinkB": 2, "linewidth": 0.9},
            )
            ax.plot([i], [height], ".", color=BLUE, markersize=3)
    middle = 1 + offsets.index(0)
    ax.plot([middle, middle], [1, 2.1], color=BLACK, linewidth=0.6, linestyle=":")
    ax.text(middle, 2.15, "feature", ha="center", va="bottom")
    ax.text((1 + len(offsets)) / 2, -0.62, "pixel $i$", ha="center", va="top")
    ax.set_xlim(0.3, len(offsets) + 0.7)
    ax.set_ylim(-1.2, 2.8)
    ax.set_aspect("equal")
    ax.axis("off")
    letter(ax, "a", "signed offsets to the feature of a line of pixels")


def _draw_slice(figure: Figure, ax: Axes, stored: dict[str, Any]) -> None:
    distance, error = np.array(stored["distance"]), np.array(stored["error"])
    n = len(distance)
    image = ax.imshow(distance.T, origin="lower", cmap="cividis", extent=(0, n, 0, n))
    bar = figure.colorbar(image, ax=ax, shrink=0.9)
    bar.set_label("distance (voxels)")
    x, y = np.nonzero(error > 1e-9)
    if len(x):
        ax.scatter(x + 0.5, y + 0.5, 1.2, marker="s", color="white", linewidth=0)
    ax.set_xlabel("voxel $i$")
    ax.set_ylabel("voxel $j$")
    letter(ax, "b", "middle plane of a shell; wrong in white")


def _draw_times(ax: Axes, numbers: dict[str, Any]) -> None:
    sizes = np.array(numbers["sizes"])
    for key, name, color, marker, line in _TIMES:
        every = [[_seconds(case, key) for case in cases] for cases in numbers["shapes"].values()]
        low, high = np.min(every, axis=0), np.max(every, axis=0)
        ax.fill_between(sizes, low, high, color=color, alpha=0.2, linewidth=0)
        ax.loglog(sizes, np.median(every, axis=0), color=color, marker=marker, linestyle=line, label=name, markersize=4)
    _size_axis(ax, sizes)
    ax.set_ylabel("time (s)")
    ax.legend(loc="upper left")
    letter(ax, "c", "one core; bands: three shapes")


def _seconds(case: dict[str, Any], key: str) -> float:
    return case["scipy"] if key == "scipy" else case[key]["seconds"]


def _draw_errors(ax: Axes, numbers: dict[str, Any]) -> None:
    sizes = np.array(numbers["sizes"])
    for name, color, marker, line in _SHAPES:
        published = [case["vector_propagation"] for case in numbers["shapes"][name]]
        share = np.array([100 * case["wrong"] for case in published])
        largest = max(case["largest"] for case in published)
        label = f"{name}: by at most {largest:.3f}" if largest > 1e-9 else f"{name}: none"
        ax.plot(sizes, share, color=color, marker=marker, linestyle=line, label=label, markersize=4)
    ax.set_xscale("log")
    _size_axis(ax, sizes)
    ax.set_ylim(bottom=-0.004, top=1.5 * max(0.02, ax.get_ylim()[1]))
    ax.set_ylabel("fraction of wrong voxels (%)")
    ax.legend(loc="upper left", title="too large, in voxels", alignment="left")
    letter(ax, "d", "errors of the published templates")


def _size_axis(ax: Axes, sizes: np.ndarray) -> None:
    ax.set_xticks(sizes, [f"${n}^3$" for n in sizes])
    ax.minorticks_off()
    ax.set_xlabel("voxels")


if __name__ == "__main__":
    main()
