"""Pictures of a distance: the witness, its feet, and the shapes on which they lie."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jhd._plot.axes import BLUE, GRAY, ORANGE, TEXT_POINTS, axes_for, draw, finish, legend_above, mark
from jhd._plot.curves import curve
from jhd._plot.faces import frame, shaded_shapes
from jhd._plot.implicit import net
from jhd._plot.mesh_pictures import faces_of
from jhd._results.solution import HausdorffSolution, MinimumSolution
from jhd._runtime.decimals import lower_text, upper_text
from jhd._shapes.as_shape import ShapeLike, as_shape
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.foreign import Axes
from jhd._shapes.mesh import TriangleMesh

_COLORS = BLUE, ORANGE
_DASHES: tuple[Any, ...] = ("-", (0, (4, 1.2)))


def witness(
    solution: HausdorffSolution | MinimumSolution,
    ax: Axes | None = None,
    *,
    distance: bool = True,
    empty_circle: bool = True,
) -> Axes:
    """Axes with the witness, its feet, the lines that join them, and the distance in writing.

    For a minimum distance, these are the two nearest points and the line between them.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> found = jhd.hausdorff(jhd.polyline([(0, 0), (1, 0)]), jhd.polyline([(0, 1), (1, 1)]))
    >>> ax = jhd.plot.witness(found, Figure().add_subplot())
    >>> sorted(line.get_gid() for line in ax.lines)
    ['empty_circle', 'feet', 'joining_lines', 'witness']

    Args:
        solution: Hausdorff distance or minimum distance, one and not a batch.
        ax: matplotlib axes; points in space need axes with projection="3d". None creates a figure.
        distance: whether to write the distance next to the line to the first foot. The legend entry of the lines always
            holds the distance: as `d = ` if it is exact, as `d ≈ ` if both bounds agree in the digits shown, otherwise
            as the certified inequality.
        empty_circle: whether to draw the circle around the witness through its feet, in the plane: the opposite curve
            does not enter this circle. Not drawn for a minimum distance.

    Returns:
        The axes.

    Raises:
        ValueError: the solution is a batch, or its points lie in space and the axes are plane.
    """
    if np.ndim(solution.value) > 0:
        raise ValueError(f"solution is a batch of shape {np.shape(solution.value)}; draw one at a time.")
    nearest = isinstance(solution, MinimumSolution)
    point, feet = _ends(solution)
    dim = point.shape[-1]
    ax = axes_for(ax, dim)
    spokes = np.concatenate([[point, foot, np.full(dim, np.nan)] for foot in feet])
    if empty_circle and dim == 2 and not nearest:
        turn = np.linspace(0.0, 2 * np.pi, 181)
        circle = point + np.linalg.norm(feet[0] - point) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        draw(ax, circle, "empty_circle", color=GRAY, linewidth=0.6, linestyle=":", zorder=3)
    mark(ax, point[None], "witness", label="nearest points" if nearest else "witness")
    mark(ax, feet, "feet", not nearest, label=None if nearest else "foot" if len(feet) == 1 else "feet")
    draw(ax, spokes, "joining_lines", color="black", linewidth=1.0, label=distance_text(solution), zorder=4)
    if distance:
        _write_distance(ax, solution, point, feet)
    finish(ax)
    return ax


def solution(
    a: ShapeLike,
    b: ShapeLike,
    solution: HausdorffSolution | MinimumSolution,
    ax: Axes | None = None,
    *,
    labels: Sequence[str] = ("A", "B"),
    control_polygon: bool = True,
    legend: bool = True,
) -> Axes:
    """Axes with both shapes, the witness, its feet and the distance between the shapes.

    >>> from matplotlib.figure import Figure
    >>> import jhd
    >>> a, b = jhd.polyline([(0, 0), (1, 0)]), jhd.polyline([(0, 1), (1, 1)])
    >>> ax = jhd.plot.solution(a, b, jhd.hausdorff(a, b), Figure().add_subplot())
    >>> [text.get_text() for text in ax.get_legend().get_texts()][:4]
    ['A', 'B', 'witness', 'foot']

    Args:
        a: first shape, drawn in blue: a curve as a solid line, a surface or mesh in one translucent color.
        b: second shape, of the same dimension, drawn in orange; a curve as a dashed line.
        solution: Hausdorff distance or minimum distance of both shapes.
        ax: matplotlib axes; shapes in space need axes with projection="3d". None creates a figure.
        labels: names of both shapes in the legend.
        control_polygon: whether to draw the control polygons of curves.
        legend: whether to draw a legend, with the distance, above the axes. Otherwise the distance is written next to
            the joining line.

    Returns:
        The axes.

    Raises:
        TypeError: an object is no shape, or the solution has another type.
        ValueError: the dimensions differ, the solution is a batch, or shapes in space are drawn on plane axes.
    """
    a, b = as_shape(a), as_shape(b)
    if not isinstance(solution, HausdorffSolution | MinimumSolution):
        raise TypeError(f"solution must be a HausdorffSolution or MinimumSolution; got {type(solution).__name__}.")
    if a.dim != b.dim:
        raise ValueError(f"a has {a.dim} coordinates; b has {b.dim}.")
    ax = axes_for(ax, a.dim)
    drawn = list(zip((a, b), _COLORS, _DASHES, labels, strict=True))
    # All faces are drawn as one, so that faces in front hide others.
    faced = [(_faces(shape), color, name) for shape, color, _, name in drawn if not isinstance(shape, AbstractCurve)]
    if faced:
        faces, colors, names = zip(*faced, strict=True)
        # Opacity of surfaces and meshes, behind which the other shape may lie.
        shaded_shapes(ax, faces, colors, names, 0.6)
        frame(ax, [np.asarray(end) for shape in (a, b) for end in shape.bounds])
    for shape, color, dashes, name in drawn:
        if isinstance(shape, AbstractCurve):
            curve(shape, ax, color=color, linestyle=dashes, label=name, control_polygon=control_polygon)
    witness(solution, ax, distance=not legend)
    if legend:
        legend_above(ax, 2 if isinstance(solution, MinimumSolution) else 3, handlelength=2.2)
    return ax


def _faces(shape: Any) -> np.ndarray:
    # Cells along each axis that a surface is drawn from.
    return faces_of(shape) if isinstance(shape, TriangleMesh) else net(shape, 48)


def _ends(solution: HausdorffSolution | MinimumSolution) -> tuple[np.ndarray, np.ndarray]:
    """The point from which the distance is measured, and the points to which it is measured."""
    if isinstance(solution, MinimumSolution):
        return np.asarray(solution.point_a), np.asarray(solution.point_b)[None]
    return np.asarray(solution.witness.point), _distinct(np.asarray(solution.witness.feet))


def _distinct(feet: np.ndarray) -> np.ndarray:
    """The feet without repetitions, in order."""
    return np.stack([foot for k, foot in enumerate(feet) if not (feet[:k] == foot).all(axis=-1).any()])


def distance_text(solution: HausdorffSolution | MinimumSolution) -> str:
    """The distance to four digits, or the proven inequality if the bounds differ in these digits."""
    return bounds_text(float(solution.lower), float(solution.upper))


def bounds_text(lower: float, upper: float) -> str:
    """`distance_text` of a distance given by its bounds."""
    below, above, near = lower_text(lower, ".4g"), upper_text(upper, ".4g"), f"{lower:.4g}"
    if near == f"{upper:.4g}":
        return f"$d$ {'=' if below == above else '≈'} {near}"
    return f"{below} ≤ $d$ ≤ {above}" if np.isfinite(upper) else f"$d$ ≥ {below}"


def _write_distance(
    ax: Any, solution: HausdorffSolution | MinimumSolution, point: np.ndarray, feet: np.ndarray
) -> None:
    """Write the distance next to the first joining line, on the side without another foot."""
    from matplotlib.patheffects import withStroke

    halo = [withStroke(linewidth=2.5, foreground="white")]
    style: dict[str, Any] = {"fontsize": TEXT_POINTS, "path_effects": halo, "zorder": 6, "gid": "distance"}
    middle = (point + feet[0]) / 2
    if ax.name == "3d":
        ax.text(*middle, f" {distance_text(solution)}", **style)
        return
    along = feet[0] - point
    length = np.linalg.norm(along)
    normal = np.array([-along[1], along[0]]) / length if length > 0 else np.array([0.6, 0.8])
    others = (feet - point) @ normal
    if others.sum() > 0 or (abs(others.sum()) <= 1e-9 * length and normal[0] < 0):
        normal = -normal
    sides = ("right", "center", "left"), ("top", "center", "bottom")
    ha, va = (names[int(np.sign(np.round(x))) + 1] for names, x in zip(sides, normal, strict=True))
    offset = 5 * normal
    ax.annotate(distance_text(solution), middle, tuple(offset), textcoords="offset points", ha=ha, va=va, **style)
