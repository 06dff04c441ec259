"""SVG: path data and files to curves, curves to files.

Coordinates are those of the file: y points down, as everywhere in SVG, unless `y_up` asks for the mirror image.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from jhd._io.contours import Contour, assemble, contours_of
from jhd._io.errors import ParseError, read_bytes
from jhd._io.path_text import contours_of_path
from jhd._io.svg_document import Drawn, drawn_shapes
from jhd._io.svg_elements import parse_document
from jhd._io.svg_paths import path_words
from jhd._runtime.files import replace_file
from jhd._shapes.curve import AbstractCurve, BezierSegments, check_curve

_MIRROR = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def parse_path(d: str) -> BezierSegments:
    """The curve of SVG path data, the text of an attribute `d`.

    Arcs become rational quadratics of at most a quarter turn and are exact up to rounding. Lines and polynomial
    segments keep their numbers and are elevated to the largest degree of the path. y is the second number, in whichever
    direction it points.

    >>> import jhd
    >>> jhd.io.parse_path("M0 0 H4 V2 Z").control_points[:, 0].tolist()
    [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0]]

    Args:
        d: path data with any commands of SVG 1.1; several contours are allowed.

    Returns:
        All contours as one curve.

    Raises:
        TypeError: `d` is not a string.
        ParseError: text that is not path data, with line and column; or path data that draws nothing.
    """
    if not isinstance(d, str):
        raise TypeError(f"d must be a string of SVG path data; got {type(d).__name__}.")
    curve = assemble(contours_of_path(d))
    if curve is None:
        raise ParseError("path data: draws nothing.")
    return curve


def load_svg(file: str | Path, ids: str | Sequence[str] | None = None, *, y_up: bool = False) -> BezierSegments:
    """All shapes that an SVG file draws, as one curve: outlines of fills and center lines of strokes.

    Coordinates are user units of the root element. Transforms of groups and elements and nested viewBoxes are applied;
    the viewBox and the size of the root are not. A drawing without groups therefore keeps its numbers. Absolute units
    become pixels of 1/96 inch.

    Text, images, clipping, masks and font-relative lengths are not read. `display` and `visibility` are respected.
    Styles and style sheets that set positions or sizes are refused.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> with TemporaryDirectory() as folder:
    ...     _ = jhd.io.save_svg(f"{folder}/corner.svg", jhd.io.parse_path("M0 0 H4 V2"))
    ...     jhd.io.load_svg(f"{folder}/corner.svg", y_up=True).control_points[:, 1].tolist()
    [[4.0, 0.0], [4.0, -2.0]]

    Args:
        file: name of the SVG file.
        ids: read only elements or groups with these ids; None reads all. A `use` element has its own id and the id of
            its target.
        y_up: whether to mirror, (x, y) -> (x, -y), so that y points up as in plots and fonts.

    Returns:
        All contours as one curve.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: the file is not SVG; an element whose position cannot be determined exactly, with line and column;
            or nothing is drawn, or nothing with these ids.
    """
    content = read_bytes(file)
    try:
        drawn = list(drawn_shapes(parse_document(content)))
    except ParseError as error:
        raise ParseError(error.reason, file, error.line, error.column) from error
    contours = [contour for shape in _select(drawn, ids, file) for contour in shape.contours]
    curve = assemble([contour.transformed(_MIRROR) for contour in contours] if y_up else contours)
    if curve is None:
        raise ParseError("draws no path, rect, circle, ellipse, line, polyline or polygon.", file)
    return curve


def _select(drawn: list[Drawn], ids: str | Sequence[str] | None, file: str | Path) -> list[Drawn]:
    if ids is None:
        return drawn
    wanted = [ids] if isinstance(ids, str) else list(ids)
    known = sorted(frozenset().union(*(shape.ids for shape in drawn)))
    for name in wanted:
        if name not in known:
            raise ParseError(f"draws nothing of id {name!r}; ids that draw: {_some(known)}.", file)
    return [shape for shape in drawn if not shape.ids.isdisjoint(wanted)]


def _some(names: list[str]) -> str:
    """The first names, for messages."""
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "") if names else "none"


def format_path(curve: AbstractCurve, *, tolerance: float | None = None) -> str:
    """The text of an attribute `d` that draws a plane curve: the inverse of `parse_path`.

    Polynomial segments of degree 1 to 3 keep their numbers. Rational segments of degree 2 or 3 that are arcs of
    ellipses are written as arcs; the arc that `parse_path` reads back is within tolerance, certified. Other segments
    are approximated by cubics.

    >>> import jhd
    >>> jhd.io.format_path(jhd.io.parse_path("M0 0 L4 .5 A2 2 0 0 1 8 .5"))
    'M0.0,0.0 Q2.0,0.25 4.0,0.5 A2 2 0 0 1 6.0,-1.5 A2 2 0 0 1 8.0,0.5'

    Args:
        curve: a curve in the plane.
        tolerance: largest deviation of the curve that is read back, in both directions, a positive length in the unit
            of the coordinates. None keeps polynomial segments exactly and arcs within 1e-12 of the largest coordinate,
            and refuses other segments.

    Returns:
        The path data.

    Raises:
        TypeError: not a curve.
        ValueError: a curve in space, a point set, or `tolerance` is None but needed.
    """
    _check_tolerance(tolerance)
    return path_words(_drawing("curve", curve, False), tolerance)


def save_svg(
    file: str | Path | None,
    curves: AbstractCurve | Sequence[AbstractCurve],
    *,
    y_up: bool = False,
    tolerance: float | None = None,
) -> str:
    """Write plane curves as paths of an SVG file, and return the text of the file.

    `load_svg` reads the same floats back (with the same `y_up`), except that it omits segments that are single points.
    Arcs of ellipses and segments that paths cannot hold are written as in `format_path`. Each curve is one path with
    the id curve0, curve1, ... The viewBox is the bounding box of the control points with a margin.

    >>> import jhd
    >>> print(jhd.io.save_svg(None, jhd.io.parse_path("M0 0 H4 V2")).splitlines()[1].strip())
    <path id="curve0" d="M0.0,0.0 L4.0,0.0 L4.0,2.0"/>

    Args:
        file: name of the file; None only returns the text. An existing file is replaced.
        curves: a curve in the plane, or several.
        y_up: whether y of the curves points up. The file then contains (x, -y), which viewers show upright.
        tolerance: largest deviation of segments that paths cannot hold, see `format_path`; None refuses them.

    Returns:
        The text of the file.

    Raises:
        TypeError: not a curve.
        ValueError: no curve; a curve in space or a point set; or `tolerance` is None but needed.
    """
    _check_tolerance(tolerance)
    several = list(curves) if isinstance(curves, Iterable) else [curves]
    if not several:
        raise ValueError("curves is empty; needs at least one curve.")
    drawings = [_drawing(f"curves[{index}]", curve, y_up) for index, curve in enumerate(several)]
    points = [p for drawing in drawings for contour in drawing for part in contour.segments for p in part.points]
    x, y = np.array([p.real for p in points]), np.array([p.imag for p in points])
    # A single point has no size; any positive one makes a valid viewBox.
    side = float(max(np.ptp(x), np.ptp(y))) or 1.0
    # Margin around a written drawing, as a fraction of its larger side.
    margin = 0.05 * side
    box = (x.min() - margin, y.min() - margin, np.ptp(x) + 2 * margin, np.ptp(y) + 2 * margin)
    paths = [
        f'  <path id="curve{index}" d="{path_words(drawing, tolerance)}"/>' for index, drawing in enumerate(drawings)
    ]
    # Width of the lines, as a fraction of the larger side.
    style = f'fill="none" stroke="black" stroke-width="{0.004 * side:.6g}"'
    view_box = " ".join(f"{number:.9g}" for number in box)
    opening = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{view_box}" {style}>'
    text = "\n".join([opening, *paths, "</svg>", ""])
    if file is not None:
        replace_file(file, text)
    return text


def _drawing(name: str, curve: AbstractCurve, y_up: bool) -> list[Contour]:
    check_curve(name, curve)
    segments = curve.segments()
    if segments.dim != 2:
        raise ValueError(f"{name} has {segments.dim} coordinates a point; SVG needs 2.")
    if segments.degree == 0:
        raise ValueError(f"{name} has degree 0; SVG paths hold no points.")
    contours = contours_of(segments)
    return [contour.transformed(_MIRROR) for contour in contours] if y_up else contours


def _check_tolerance(tolerance: float | None) -> None:
    if tolerance is not None and not tolerance > 0:
        raise ValueError(f"tolerance is {tolerance}; needs a positive number, or None.")
