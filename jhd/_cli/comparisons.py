"""The commands that measure one shape against another, or points against a shape.

Lengths may be given as percentages of the diagonal of the joint bounding box, and are printed as such too.
"""

import sys
from argparse import Namespace
from collections.abc import Iterator
from functools import partial
from typing import Any

import jax
import numpy as np

import jhd
from jhd._cli.console import INTERRUPTED, busy, device, exit_status, precision, timed
from jhd._cli.lengths import rounded_diagonal
from jhd._cli.options import (
    PROJECTIONS,
    box_of,
    check_picture,
    check_writable,
    kind_of,
    method_of,
    points_of,
    search_of,
    shape_of,
    shapes_of,
    tolerances_of,
)
from jhd._cli.output import TABLE_SUFFIXES, delivered, print_files
from jhd._cli.report import (
    decision_text,
    deviation_picture,
    deviation_text,
    directions_text,
    interrupted,
    minimum_picture,
    minimum_text,
    picture,
    shape_line,
    solution_text,
    space_picture,
)
from jhd._distance.search.bodies import body_of
from jhd._plot.pages import plotly_script
from jhd._results.solution import Decision, HausdorffSolution, MinimumSolution, name_of, to_plain
from jhd._runtime.clock import Clock
from jhd._runtime.decimals import lower_text, upper_text
from jhd._runtime.files import replace_file
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.patch import AbstractPatch
from jhd.progress import Callback, Progress

# Points in one batch of projections, some seconds of work: onto surfaces, and onto other shapes.
_FEW_POINTS, _MANY_POINTS = 1_000, 100_000


def hausdorff(options: Namespace) -> int:
    """The (directed) Hausdorff distance of two shapes, or whether it is at most a threshold."""
    entry = jhd.directed_hausdorff if options.directed else jhd.hausdorff
    decide = partial(jhd.hausdorff_at_most, directed=options.directed)
    title = "directed distance from A to B" if options.directed else "Hausdorff distance"
    early = "the search ends before the farthest point is known"

    def text(a: Any, b: Any, found: HausdorffSolution, size: float) -> str:
        head = "the bounds reached" if interrupted(found) else title
        lines = solution_text(head, found, {"A": a, "B": b}, size)
        return lines if found.directions is None else f"{lines}\n\n{directions_text(*found.directions)}"

    return _measured(options, title, entry, decide, early, _draw, text, directed=options.directed)


def minimum(options: Namespace) -> int:
    """The minimum distance of two shapes and their nearest points, or whether it is at most a threshold."""
    title, early = "minimum distance", "the nearest points are not known"
    calls = jhd.minimum_distance, jhd.minimum_at_most
    return _measured(options, title, *calls, early, minimum_picture, lambda a, b, *found: minimum_text(*found))


def _measured(
    options: Namespace, title: str, entry: Any, decide: Any, early: str, draw: Any, text: Any, **named: Any
) -> int:
    """Print a distance, or the answer whether it is at most the threshold, and return the exit status.

    Args:
        options: the parsed options.
        title: the name of the distance.
        entry: the function that computes it.
        decide: the function that answers the question; its search ends as soon as the answer is known.
        early: the reason why an answer has no picture, page or certificate.
        draw: writes the picture of a distance.
        text: the lines about a distance.
        named: facts that are stored and printed with the method; without any, the method is not named.
    """
    a, b = shapes_of(options)
    size = rounded_diagonal(a, b)
    method = search_of(options, a, b)
    check_drawn(options, a.dim)
    check_writable(options.certificate)
    check_writable(options.out, ".json")
    named |= {"method": type(method).__name__} if named else {}
    asked = {"a": options.a, "b": options.b, **named, **tolerances_of(options, a, b), **box_of(a, b)}
    given = [name for name in ("plot", "html", "certificate") if getattr(options, name)]
    compute = partial(entry, a, b, throw=False)
    if options.threshold is not None:
        if given:
            raise ValueError(f"--{given[0]}: with --threshold {early}; leave it out.")
        asked["threshold"] = options.threshold.of(a, b)
        compute = partial(decide, a, b, asked["threshold"])
    with busy("computing; a first run compiles") as show:
        chosen = {"method": method, "max_seconds": options.max_seconds, "progress": show}
        found, seconds = timed(lambda: compute(**chosen))
    status, stopped = exit_status(found), interrupted(found)
    files = {} if stopped else _written(options, a, b, found, draw)
    if options.threshold is not None and not stopped:
        # An undecided question counts as bounds not closed.
        status = {"yes": 0, "no": 3, "undecided": 1}[name_of(found.answer)]
    if options.certificate and not stopped and not files["proof"]:
        status = 1
    if delivered(options, found, **asked, diagonal=size, seconds=seconds):
        return status
    print(shape_line("A", options.a, a), shape_line("B", options.b, b), sep="\n", end="\n\n")
    decided = isinstance(found, Decision)
    print(decision_text(title, found, asked["threshold"], size) if decided else text(a, b, found, size), end="\n\n")
    if named:
        print(f"method     {named['method']}")
    _print_run(seconds, size)
    print_files(**files, result=options.out)
    return status


def _written(options: Namespace, a: Any, b: Any, found: Any, draw: Any) -> dict[str, str | None]:
    """Write the picture, the page and the certificate of a distance, and return the names of the files."""
    if options.plot:
        with busy("drawing"):
            draw(options.plot, a, b, found)
    if options.html:
        write_page(options.html, a, b, found)
    proof = options.certificate if options.certificate and _certified(options.certificate, a, b, found) else None
    return {"picture": options.plot, "page": options.html, "proof": proof}


def _print_run(seconds: float, size: float) -> None:
    """The last lines of every answer in text form."""
    print(f"diagonal   {size!r}, of the joint bounding box")
    print(f"time       {seconds:.2f} s with compilation")
    print(f"device     {device()}, {precision()}")


def deviation(options: Namespace) -> int:
    """The distribution of the distance to B over A."""
    a, b = shapes_of(options)
    size = rounded_diagonal(a, b)
    check_drawn(options, a.dim)
    check_writable(options.out, ".json")
    tolerances = tolerances_of(options, a, b)
    threshold = None if options.threshold is None else options.threshold.of(a, b)
    q = options.quantile
    asked = {"rtol": options.rtol, "atol": tolerances["atol"], "quantile": q, "throw": False}
    asked["max_seconds"] = options.max_seconds
    with busy("computing; a first run compiles") as show:
        found, seconds = timed(lambda: jhd.deviation(a, b, **asked, progress=show))
    within = None if threshold is None else found.fraction_within(threshold)
    drawn = {} if interrupted(found) else {"picture": options.plot, "page": options.html}
    if drawn.get("picture"):
        with busy("drawing"):
            deviation_picture(options.plot, found)
    if drawn.get("page"):
        write_page(options.html, found)
    asked = {"a": options.a, "b": options.b, "threshold": threshold, "quantile": q, **tolerances, **box_of(a, b)}
    content: Any = found.to_dict() | ({} if within is None else {"fraction_within": to_plain(within)})
    if q is not None:
        content["quantiles"][str(q)] = to_plain(found.quantile(q))
    if delivered(options, found, content, **asked, diagonal=size, seconds=seconds):
        return exit_status(found)
    print(shape_line("A", options.a, a), shape_line("B", options.b, b), sep="\n", end="\n\n")
    print(deviation_text(found, threshold, q, size), end="\n\n")
    _print_run(seconds, size)
    print_files(**drawn, result=options.out)
    return exit_status(found)


def project(options: Namespace) -> int:
    """The nearest points of a shape to given points, one row for each point."""
    shape = shape_of(options)
    points = points_of(options)
    if points.shape[1] != shape.dim:
        raise ValueError(f"a point has {points.shape[1]} coordinates; the {kind_of(shape)} has {shape.dim}.")
    check_writable(options.out, *TABLE_SUFFIXES)
    method = jhd.BestFirstProjection() if isinstance(shape, AbstractCurve) else None
    if options.method is not None:
        method = method_of(options.method, PROJECTIONS)()
    clock = Clock(options.max_seconds)
    with busy("computing; a first run compiles") as show:
        found = _projected(points, shape, method, show, clock)
    done = len(found.distance)
    status = exit_status(found) if done == len(points) else 1 if clock.is_over() else INTERRUPTED
    asked = {"points": points[:done].tolist(), "method": "exact" if method is None else type(method).__name__}
    head, *rows = _rows_of(found, shape)
    if delivered(options, found, table=(head, *rows), shape=options.shape, **asked, **box_of(shape)):
        return status
    if options.out:
        print_files(result=options.out)
        return status
    print(*head, sep="\t")
    for value, lower, upper, *others, end in rows:
        print(repr(value), lower_text(lower), upper_text(upper), *map(repr, others), end, sep="\t")
    return status


def _rows_of(found: Any, shape: Any) -> Iterator[list[Any]]:
    """The rows of projections: distance, bounds, the parameters on the shape, the foot point and the result."""
    kind, *parameters = body_of(shape).places
    place = [kind, *parameters] if kind else []
    yield ["distance", "lower", "upper", *place, *(f"foot {axis}" for axis in "xyz"[: shape.dim]), "result"]
    columns = [found.distance, found.lower, found.upper, found.element, found.t, found.foot]
    for value, lower, upper, element, t, foot, end in zip(
        *map(np.asarray, columns), to_plain(found.result), strict=True
    ):
        where = (element, *np.atleast_1d(t)[: len(parameters)]) if kind else ()
        yield [*(x.item() for x in (value, lower, upper, *where, *foot)), end]


def _projected(points: np.ndarray, shape: Any, method: Any, show: Callback, clock: Clock) -> Any:
    """The projections of the points, thousands at a time; only the finished ones after an interrupt or the time."""
    size = _FEW_POINTS if isinstance(shape, AbstractPatch | ImplicitSurface) else _MANY_POINTS
    parts: list[Any] = []
    try:
        for start in range(0, len(points), size):
            parts.append(jhd.project(points[start : start + size], shape, method=method, throw=False))
            done = min(start + size, len(points))
            show(Progress("points", done, len(points)))
            if clock.is_over():
                break
    except KeyboardInterrupt:
        if not parts:
            raise
    return parts[0] if len(parts) == 1 else jax.tree_util.tree_map(lambda *x: np.concatenate(x), *parts)


def _draw(file: str, a: Any, b: Any, solution: HausdorffSolution) -> None:
    """The picture of a distance; for curves with all directions that were computed."""
    if isinstance(a, AbstractCurve) and isinstance(b, AbstractCurve):
        picture(file, a, b, directions_of(solution))
    else:
        space_picture(file, a, b, solution)


def check_drawn(options: Namespace, dim: int) -> None:
    """Raise an error if a requested picture or page cannot be written."""
    if options.plot:
        check_picture(options.plot)
    check_writable(options.html, ".html", ".htm")
    if options.html and dim == 3:
        plotly_script()


def write_page(file: str, *shown: Any) -> None:
    """Write the page of two shapes and their distance, or of a deviation."""
    with busy("drawing"):
        replace_file(file, jhd.plot.page(*shown))


def directions_of(solution: HausdorffSolution) -> list[HausdorffSolution | None]:
    """The directed distances of a solution; None for the second if its bounds are wide."""
    if solution.directions is None:
        return [solution]
    there, back = solution.directions
    # A directed distance whose bounds agree to this fraction is drawn.
    return [there, back if float(back.upper - back.lower) <= 1e-6 * float(back.upper) else None]


def _certified(file: str, a: Any, b: Any, solution: HausdorffSolution | MinimumSolution) -> bool:
    """Write the certificate of the solution; return False, after a line on stderr, if its bounds cannot be proven."""
    try:
        with busy("certifying") as show:
            certificate = jhd.certify(a, b, solution, progress=show)
    except jhd.NotProvenError as error:
        print(f"jhd: no certificate: {error}", file=sys.stderr)
        return False
    certificate.save(file)
    return True
