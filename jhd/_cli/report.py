"""Output of the command line: lines about shapes and solutions, and pictures.

Numbers are written in full: a bound that is read back is the certified bound. Digits are rounded outward.
"""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jhd import plot
from jhd._cli.lengths import share_text
from jhd._distance.deviation_solution import Deviation
from jhd._distance.search.bodies import body_of
from jhd._plot.pages import page_of_figure
from jhd._results.solution import RESULTS, Decision, HausdorffSolution, MinimumSolution, name_of
from jhd._runtime.decimals import interval_text, lower_text, upper_text
from jhd._runtime.files import replace_file
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh
from jhd._shapes.patch import AbstractPatch
from jhd.progress import Progress

_MILLIMETERS = 1 / 25.4
_PICTURE_SIZE = 180 * _MILLIMETERS, 102 * _MILLIMETERS  # two columns of a journal
PICTURE_DPI = 200
_SPACE_SIZE = 120 * _MILLIMETERS, 115 * _MILLIMETERS
_BAR = 24  # characters of a bar of progress
_DIGITS = 10  # digits of a distance in a bar; by default a search ends with about this many
_SPEC_WIDTH = 60  # path data can be pages long


def bar(done: int, count: int) -> str:
    """A progress bar, with the number of finished items."""
    filled = _BAR * done // count
    return f"[{'#' * filled}{'.' * (_BAR - filled)}] {done}/{count}"


def solution_text(
    title: str, solution: HausdorffSolution, shapes: dict[str, Any], diagonal: float | None = None
) -> str:
    """One solution in lines; `shapes` are the two shapes of the call, in its order, by their names."""
    known = [(name, body_of(shape).places) for name, shape in shapes.items()]
    (name, on), (other, under) = known if name_of(solution.direction) == "a_to_b" else known[::-1]
    w = solution.witness
    lines = [
        title,
        f"  value    {_number(solution)}",
        *_bound_lines(solution, "not certified by this method"),
        *_share_line("  relative ", solution.value, diagonal),
        f"  event    {name_of(solution.event)}",
        f"  witness  {place_text(name, on, w.element, w.t, w.point)}",
    ]
    seen: list[tuple[float, ...]] = []
    for foot, segment, t, weight in zip(w.feet, w.feet_elements, w.feet_params, w.multipliers, strict=True):
        if (here := tuple(np.asarray(foot).tolist())) not in seen:
            lines.append(f"  foot     {place_text(other, under, segment, t, foot)}, multiplier {float(weight):.4g}")
            seen.append(here)
    if not successful(solution):
        lines.append(f"  result   {_with_sentence(solution.result)}")
    return "\n".join(lines)


def deviation_text(found: Deviation, threshold: float | None, quantile: float | None, diagonal: float) -> str:
    """A table of the bounds of a deviation."""
    rows: dict[str, Any] = {"maximum": found.maximum, "rms": found.rms, "mean": found.mean}
    shares = sorted({0.5, 0.9, 0.99} | (set() if quantile is None else {quantile}))
    rows |= {f"{100 * q:.12g}% within": found.quantile(q) for q in shares}
    lengths = len(rows)
    if threshold is not None:
        rows[f"fraction within {threshold!r}"] = found.fraction_within(threshold)
    rows[f"{body_of(found.a).measure} of A"] = found.size
    width = max(map(len, rows))
    ends = [(lower_text(known.lower), upper_text(known.upper)) for known in rows.values()]
    wide = 2 + max(len(text) for row in ends for text in row)
    head = f"distance from A to B\n  {'':<{width}}  {'lower':<{wide}}{'upper':<{wide}}of the diagonal"
    shares = [share_text(known.upper, diagonal) for known in list(rows.values())[:lengths]]
    shares += [""] * (len(rows) - lengths)
    lines = [
        f"  {name:<{width}}  {low:<{wide}}{high:<{wide}}{share}".rstrip()
        for name, (low, high), share in zip(rows, ends, shares, strict=True)
    ]
    told = [] if successful(found) else [f"  {'result':<{width}}  {_with_sentence(found.result)}"]
    return "\n".join([head, *lines, *told])


def decision_text(title: str, found: Decision, threshold: float, diagonal: float) -> str:
    """The answer to whether a distance is at most a threshold, with the bounds reached."""
    return "\n".join(
        [
            f"{title} at most {threshold!r}: {name_of(found.answer)}",
            *_bound_lines(found),
            *_share_line("  asked    ", threshold, diagonal),
            f"  answer   {found.answer._enumeration._index_to_message[int(found.answer._value)]}",
            *([] if successful(found) else [f"  result   {_with_sentence(found.result)}"]),
        ]
    )


def minimum_text(found: MinimumSolution, diagonal: float) -> str:
    """The minimum distance in lines, with the nearest points."""
    lines = ["minimum distance", f"  value    {float(found.value)!r}", *_bound_lines(found)]
    lines += _share_line("  relative ", found.value, diagonal)
    for name, point in (("A", found.point_a), ("B", found.point_b)):
        lines.append(f"  point    {name} at ({', '.join(f'{float(x):.9g}' for x in point)})")
    if not successful(found):
        lines.append(f"  result   {_with_sentence(found.result)}")
    return "\n".join(lines)


def directions_text(there: HausdorffSolution, back: HausdorffSolution) -> str:
    """The bounds of both directed distances; the smaller distance may have wide bounds."""
    lines = []
    for way, solution in (("A to B", there), ("B to A", back)):
        lines.append(f"{way}     {lower_text(solution.lower)} to {_upper(solution)}")
    return "\n".join(lines)


def _bound_lines(solution: Any, unproven: str = "not certified") -> list[str]:
    return [f"  lower    {lower_text(solution.lower)}", f"  upper    {_upper(solution, unproven)}"]


def _upper(solution: Any, unproven: str = "not certified") -> str:
    return upper_text(solution.upper) if np.isfinite(solution.upper) else unproven


def _share_line(title: str, distance: Any, diagonal: float | None) -> list[str]:
    """The line with a distance as a percentage of the diagonal, if that is known."""
    share = "" if diagonal is None else share_text(distance, diagonal)
    return [f"{title}{share} of the diagonal"] if share else []


def _with_sentence(item: Any) -> str:
    """The name of a member of an enumeration and its message."""
    return f"{name_of(item)}: {item._enumeration._index_to_message[int(item._value)]}"


def place_text(name: str, places: tuple[str, ...], element: Any, t: Any, point: Any) -> str:
    """A point of a shape with its element and its parameters there, as far as its body has them."""
    label, *parameters = places
    where = f" {label} {int(element)}," if label and int(element) >= 0 else ""
    if where and parameters:
        numbers = [f"{float(x):.9g}" for x in np.atleast_1d(t)[: len(parameters)]]
        where += f" t = {numbers[0]}," if len(numbers) == 1 else f" t = ({', '.join(numbers)}),"
    return f"{name}{where} at ({', '.join(f'{float(x):.9g}' for x in point)})"


def _number(solution: HausdorffSolution) -> str:
    return "unknown" if np.isnan(solution.value) else repr(float(solution))


def shape_line(name: str, spec: str, shape: Any) -> str:
    """A line with the name of a shape, its text on the command line, and its kind and size."""
    shown = spec if len(spec) <= _SPEC_WIDTH else f"{spec[: _SPEC_WIDTH - 3]}..."
    if isinstance(shape, ImplicitSurface):
        ends = zip(*(np.asarray(end) for end in shape.bounds), strict=True)
        box = " x ".join(interval_text(low, high, ".9g") for low, high in ends)
        return f"{name}  {shown}: surface of degree {shape.degree} in {box}"
    if isinstance(shape, TriangleMesh):
        kind = "closed mesh" if shape.is_closed else "open mesh"
        return f"{name}  {shown}: {kind} of {shape.count} triangle{'' if shape.count == 1 else 's'}"
    if isinstance(shape, AbstractPatch):
        parts = shape.patches()
        kind = "rational patch" if parts.weights is not None else "patch"
        plural = "" if parts.count == 1 else "es"
        return f"{name}  {shown}: {parts.count} {kind}{plural} of degrees {' and '.join(map(str, parts.degrees))}"
    pieces = shape.segments()
    plural = "" if pieces.count == 1 else "s"
    if pieces.degree == 0:
        return f"{name}  {shown}: {pieces.count} point{plural}"
    kind = "rational " if pieces.weights is not None else ""
    return f"{name}  {shown}: {pieces.count} {kind}segment{plural} of degree {pieces.degree}"


def successful(solution: Any) -> bool:
    """Whether every result of a solution is successful."""
    return bool(np.all(np.asarray(solution.result._value) == np.asarray(RESULTS.successful._value)))


def interrupted(solution: Any) -> bool:
    """Whether any result of a solution comes from an interrupted search."""
    return bool(np.any(np.asarray(solution.result._value) == np.asarray(RESULTS.interrupted._value)))


def progress_text(progress: Progress) -> str:
    """One line for a progress report."""
    stage, done, total, lower, upper, details = progress
    if lower is not None and upper is not None and total is not None:
        ends = f"{lower_text(lower, '.9g')} to {upper_text(upper, '.9g')}"
        digits = bar(_digits(lower, upper), _DIGITS)
        return f"{stage}: {digits} digits, {ends}, step {done}, {total - done} open cells"
    known = [] if total is None else [bar(min(done, total), max(total, 1))]
    return ", ".join([f"{stage} {' '.join(known)}".rstrip(), *(f"{name} {x:.9g}" for name, x in details.items())])


def _digits(lower: float, upper: float) -> int:
    """About how many digits of a distance are common to both bounds, at most the number shown."""
    if lower == upper:
        return _DIGITS
    if not math.isfinite(upper):
        return 0
    gap = max((upper - lower) / upper, 10.0**-_DIGITS)
    return int(np.clip(-math.log10(gap), 0, _DIGITS))


def picture(
    file: str,
    a: AbstractCurve,
    b: AbstractCurve,
    directed: Sequence[HausdorffSolution | None],
    labels: Sequence[str] = ("A", "B"),
    unit: str = "input units",
) -> None:
    """Write the curves with the larger of the directed distances, next to the profile of each direction."""
    # A figure without pyplot: no window, and the backend that the user has set stays as it is.
    from matplotlib.figure import Figure

    figure = Figure(figsize=_PICTURE_SIZE, layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1, 1.15))[0]
    space: dict[str, Any] = {"projection": "3d"} if a.segments().dim == 3 else {}
    larger = max((solution for solution in directed if solution is not None), key=float)
    plot.solution(a, b, larger, left.add_subplot(**space), labels=labels, control_polygon=False)
    panels = np.atleast_1d(right.subplots(len(directed)))
    plot.distance_profile(a, b, panels[0], directed[0], labels=labels, unit=unit)
    for panel, back in zip(panels[1:], directed[1:], strict=True):
        plot.distance_profile(b, a, panel, back, labels=labels[::-1], unit=unit, color=plot.ORANGE)
    save_figure(file, figure)


def space_picture(file: str, a: Any, b: Any, solution: HausdorffSolution) -> None:
    """Write two implicit surfaces with the witness, or the shape with the witness colored by its distance."""
    if not (isinstance(a, ImplicitSurface) and isinstance(b, ImplicitSurface)):
        _save_and_close(file, plot.distances(a, b, solution).figure)
        return
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SPACE_SIZE)
    # No layout engine sees the labels of space axes.
    plot.solution(a, b, solution, figure.add_axes((0.02, 0.08, 0.88, 0.82), projection="3d"))
    save_figure(file, figure)


def minimum_picture(file: str, a: Any, b: Any, found: MinimumSolution) -> None:
    """Write two shapes with their nearest points."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SPACE_SIZE, layout=None if a.dim == 3 else "constrained")
    # No layout engine sees the labels of space axes.
    ax = figure.add_axes((0.02, 0.08, 0.88, 0.82), projection="3d") if a.dim == 3 else figure.add_subplot()
    plot.solution(a, b, found, ax, control_polygon=False)
    save_figure(file, figure)


def deviation_picture(file: str, found: Any) -> None:
    """Write the shape colored by its distance, with a histogram."""
    _save_and_close(file, plot.deviation(found).figure)


def neighbors_picture(file: str, queries: Any, shapes: Any, found: Any, names: tuple[list[str], list[str]]) -> None:
    """Write the first queries with their nearest shapes, as a picture or page."""
    axes = plot.neighbors(queries, shapes, found, query_names=names[0], names=names[1])
    if not file.lower().endswith((".html", ".htm")):
        _save_and_close(file, axes[0, 0].figure)
        return
    import matplotlib.pyplot as plt

    replace_file(file, page_of_figure(axes[0, 0].figure, "nearest shapes"))
    plt.close(axes[0, 0].figure)


def save_figure(file: str, figure: Any) -> None:
    """Write a picture in the format of its suffix; an interrupted call leaves no partial file."""
    stream = io.BytesIO()
    figure.savefig(stream, format=Path(file).suffix.removeprefix(".").lower(), dpi=PICTURE_DPI)
    replace_file(file, stream.getvalue())


def _save_and_close(file: str, figure: Any) -> None:
    import matplotlib.pyplot as plt

    try:
        save_figure(file, figure)
    finally:
        plt.close(figure)
