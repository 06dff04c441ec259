"""The basic shapes of SVG as contours, in the coordinates of their element.

Source: SVG 2, chapter 10; where it leaves the start and the direction open, those of its equivalent paths.
"""

import math

from jhd.io.contours import Contour
from jhd.io.errors import ParseError
from jhd.io.path_data import parse_path
from jhd.io.svg_elements import Element, Viewport


def contours_of_shape(element: Element, viewport: Viewport) -> list[Contour]:
    """The contours of a basic shape or a path; none where a size is zero, as the standard says.

    Args:
        element: one whose tag is in `SHAPES`.
        viewport: what percentages refer to.

    Raises:
        ParseError: an attribute that is no length or no list of numbers, or a negative size.
    """
    return SHAPES[element.tag](element, viewport)


def _path(element: Element, viewport: Viewport) -> list[Contour]:
    text = element.attributes.get("d", "none")
    if text.strip() == "none":
        return []
    try:
        return parse_path(text)
    except ParseError as error:
        raise element.error(f"{error.reason} (column {error.column} of d)") from error


def _rect(element: Element, viewport: Viewport) -> list[Contour]:
    x, y = element.length("x", viewport), element.length("y", viewport)
    width, height = _sizes(element, viewport, ("width", "height"))
    if width == 0 or height == 0:
        return []
    rx, ry = _radii(element, viewport)
    rx, ry = min(rx, width / 2), min(ry, height / 2)
    right, bottom = x + width, y + height
    if not (math.isfinite(right) and math.isfinite(bottom)):
        raise element.error("draws points beyond the range of doubles.")
    if rx == 0 or ry == 0:
        return parse_path(f"M{x!r} {y!r}H{right!r}V{bottom!r}H{x!r}Z")
    # One number where opposite corners meet: rounding would leave a side of an ulp.
    x0, y0 = x + rx, y + ry
    x1, y1 = x0 if rx == width / 2 else right - rx, y0 if ry == height / 2 else bottom - ry
    arc = f"A{rx!r} {ry!r} 0 0 1"
    return parse_path(
        f"M{x0!r} {y!r}H{x1!r}{arc} {right!r} {y0!r}V{y1!r}{arc} {x1!r} {bottom!r}"
        f"H{x0!r}{arc} {x!r} {y1!r}V{y0!r}{arc} {x0!r} {y!r}Z"
    )


def _sizes(element: Element, viewport: Viewport, names: tuple[str, str]) -> tuple[float, float]:
    """Two lengths that must not be negative."""
    sizes = element.length(names[0], viewport), element.length(names[1], viewport)
    for name, size in zip(names, sizes, strict=True):
        if size < 0:
            raise element.error(f"has {name} {size:g}; needs a length that is not negative.")
    return sizes


def _radii(element: Element, viewport: Viewport) -> tuple[float, float]:
    """The radii rx and ry, not negative; one stands for both where the other is missing or `auto`."""
    given = [name for name in ("rx", "ry") if element.attributes.get(name, "auto") != "auto"]
    return _sizes(element, viewport, (given[0], given[-1])) if given else (0.0, 0.0)


def _ellipse(element: Element, viewport: Viewport) -> list[Contour]:
    """Four quarters from angle 0, towards positive y first."""
    cx, cy = element.length("cx", viewport), element.length("cy", viewport)
    circle = element.tag == "circle"
    rx, ry = _sizes(element, viewport, ("r", "r")) if circle else _radii(element, viewport)
    if rx == 0 or ry == 0:
        return []
    # Written out, not drawn as arcs: the corners of the box are exact where their sums are.
    corners = [complex(cx + rx * u, cy + ry * v) for u, v in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    ends = [complex(cx, cy + ry), complex(cx - rx, cy), complex(cx, cy - ry), complex(cx + rx, cy)]
    contour = Contour(ends[-1])
    for corner, end in zip(corners, ends, strict=True):
        contour.append(corner, end, weights=(1.0, math.sqrt(0.5), 1.0))
    contour.close()
    return [contour]


def _line(element: Element, viewport: Viewport) -> list[Contour]:
    x1, y1, x2, y2 = (element.length(name, viewport) for name in ("x1", "y1", "x2", "y2"))
    contour = Contour(complex(x1, y1))
    contour.append(complex(x2, y2))
    return [contour]


def _polyline(element: Element, viewport: Viewport) -> list[Contour]:
    values = element.numbers("points")
    if len(values) % 2:
        raise element.error(f"has {len(values)} numbers in points; needs pairs.")
    if not values:
        return []
    first, *others = (complex(x, y) for x, y in zip(values[::2], values[1::2], strict=True))
    contour = Contour(first)
    for point in others:
        contour.append(point)
    if element.tag == "polygon":
        contour.close()
    return [contour]


SHAPES = {
    "path": _path,
    "rect": _rect,
    "circle": _ellipse,
    "ellipse": _ellipse,
    "line": _line,
    "polyline": _polyline,
    "polygon": _polyline,
}
