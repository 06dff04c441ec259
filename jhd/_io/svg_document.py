"""SVG documents: which shapes are drawn, and at which coordinates.

Read: groups, links, `switch` (all of its children), nested `svg` and `use` (also of symbols) with viewBox and
preserveAspectRatio, and the basic shapes, as contours in the coordinates of their element. `display` and `visibility`
are respected in attributes and styles. Not read: text, images, stroke widths, clipping and masks. Style sheets and
styles that move or resize shapes are refused.

Source: SVG 2, chapter 10; if it leaves the start and the direction open, its equivalent paths.
"""

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jhd._io.contours import Contour
from jhd._io.errors import ParseError, shown
from jhd._io.path_text import contours_of_path
from jhd._io.svg_elements import Element, Viewport, compose, translation

_ALWAYS_DRAWN = 100_000
# Most levels of nested uses.
_MOST_USES = 8
# Any other value is inherited from the parent element.
_VISIBLE = {"visible": True, "initial": True, "hidden": False, "collapse": False}


def _path(element: Element, viewport: Viewport) -> list[Contour]:
    text = element.attributes.get("d", "none")
    if text.strip() == "none":
        return []
    try:
        return contours_of_path(text)
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
        return contours_of_path(f"M{x!r} {y!r}H{right!r}V{bottom!r}H{x!r}Z")
    # If opposite corners meet they need one common number: rounding would leave a side of an ulp.
    x0, y0 = x + rx, y + ry
    x1, y1 = x0 if rx == width / 2 else right - rx, y0 if ry == height / 2 else bottom - ry
    arc = f"A{rx!r} {ry!r} 0 0 1"
    return contours_of_path(
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
    """The radii rx and ry, not negative; a missing or `auto` radius equals the other."""
    given = [name for name in ("rx", "ry") if element.attributes.get(name, "auto") != "auto"]
    return _sizes(element, viewport, (given[0], given[-1])) if given else (0.0, 0.0)


def _ellipse(element: Element, viewport: Viewport) -> list[Contour]:
    """Four quarters from angle 0, towards positive y first."""
    cx, cy = element.length("cx", viewport), element.length("cy", viewport)
    circle = element.tag == "circle"
    rx, ry = _sizes(element, viewport, ("r", "r")) if circle else _radii(element, viewport)
    if rx == 0 or ry == 0:
        return []
    # Written out, not drawn as arcs: then the corners of the box are exact if their sums are.
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


_SHAPES = {
    "path": _path,
    "rect": _rect,
    "circle": _ellipse,
    "ellipse": _ellipse,
    "line": _line,
    "polyline": _polyline,
    "polygon": _polyline,
}
_DRAWN = frozenset(("svg", "g", "a", "switch", "use", *_SHAPES))
# Elements that a `switch` may choose; text and pictures are no curves.
_CHOSEN = _DRAWN | {"text", "image", "foreignObject"}


class Drawn(NamedTuple):
    """The contours of one shape in the coordinates of the root, and the ids of the shape and all its parents."""

    contours: list[Contour]
    ids: frozenset[str]


class _DrawnPlace(NamedTuple):
    """Context in which an element is drawn: coordinates, ids of parents and of `use` elements that led to it."""

    matrix: np.ndarray
    viewport: Viewport
    ids: frozenset[str]
    uses: tuple[str, ...]
    visible: bool
    # The number of elements that may still be drawn in all, counted down.
    left: list[int]


def drawn_shapes(root: Element) -> Iterator[Drawn]:
    """Every shape that is drawn, in order, in user units of the root.

    viewBox and size of the root itself set the scale of the paper and not the drawing: they are not applied, and only
    give the size to which percentages refer.

    Raises:
        ParseError: an element that cannot be placed exactly, with its line and column.
    """
    if root.property("display") == "none":
        return
    # The size of the root is the size of the paper.
    root.check_placed_by_attributes(sizes=False)
    named: dict[str, Element] = {}
    # Most elements drawn, with repetitions by `use`: this many times the elements of the file, plus a constant.
    left = [_ALWAYS_DRAWN + 10 * _collect_ids(root, named)]
    box = _view_box(root)
    viewport = (box[2], box[3]) if box else None
    if box is None and {"width", "height"} <= root.attributes.keys() and not {"width", "height"} & root.style.keys():
        width, height = root.attributes["width"], root.attributes["height"]
        if "%" not in width + height:
            viewport = (root.length("width", None), root.length("height", None))
    place = _enter(root, _DrawnPlace(translation(0.0, 0.0), viewport, frozenset(), (), True, left))
    for child in root.children:
        yield from _draw(child, place, named)


def _collect_ids(element: Element, named: dict[str, Element]) -> int:
    """Store the descendants of an element by id in `named`, and return the number of descendants."""
    count = len(element.children)
    for child in element.children:
        if "id" in child.attributes:
            named.setdefault(child.attributes["id"], child)
        count += _collect_ids(child, named)
    return count


def _enter(element: Element, place: _DrawnPlace) -> _DrawnPlace:
    """The context inside an element: its transform applied, its id added."""
    name = element.attributes.get("id")
    ids = place.ids if name is None else place.ids | {name}
    visible = _VISIBLE.get(element.property("visibility"), place.visible)
    return place._replace(matrix=compose(place.matrix, element.transform()), ids=ids, visible=visible)


def _draw(element: Element, place: _DrawnPlace, named: dict[str, Element]) -> Iterator[Drawn]:
    """The shapes drawn by an element in a context: itself, its children, or the element that it uses."""
    if element.tag not in _DRAWN or element.property("display") == "none" or not _is_meant(element):
        return
    element.check_placed_by_attributes()
    place.left[0] -= 1
    if place.left[0] < 0:
        raise element.error("is drawn after too many others: <use> elements draw far more than the file holds.")
    if len(place.uses) > _MOST_USES:
        raise element.error(f"is inside {_MOST_USES} uses of uses; deeper ones are not read.")
    place = _enter(element, place)
    if element.tag in _SHAPES:
        if not place.visible:
            return
        contours = _SHAPES[element.tag](element, place.viewport)
        yield Drawn([contour.transformed(place.matrix) for contour in contours], place.ids)
        return
    if element.tag == "use":
        target, place = _used(element, place, named)
        yield from _draw(target, place, named)
        return
    if element.tag == "svg":
        place = _enter_viewport(element, place)
    children = element.children
    if element.tag == "switch":
        chosen = next((child for child in children if child.tag in _CHOSEN and _is_meant(child)), None)
        children = [] if chosen is None else [chosen]
    for child in children:
        yield from _draw(child, place, named)


def _is_meant(element: Element) -> bool:
    """Whether the conditions of an element hold; never if it needs an extension of SVG, as none is read.

    Raises:
        ParseError: an element restricted to a language.
    """
    if "requiredExtensions" in element.attributes:
        return False
    if "systemLanguage" in element.attributes:
        raise element.error("has systemLanguage, which is not read; leave one language.")
    return True


def _used(element: Element, place: _DrawnPlace, named: dict[str, Element]) -> tuple[Element, _DrawnPlace]:
    """The element that a `use` draws, and its context; a symbol becomes a nested `svg` of the size of the `use`."""
    href = element.attributes.get("href") or element.attributes.get("http://www.w3.org/1999/xlink href", "")
    name = href[1:]
    if not href.startswith("#"):
        raise element.error(f"refers to {shown(href)}; only elements of the same file, #id, can be used.")
    if name not in named:
        raise element.error(f"refers to {shown(href)}; the file has no element of that id.")
    if name in place.uses:
        raise element.error(f"refers to {shown(href)}, which uses itself.")
    shift = translation(element.length("x", place.viewport), element.length("y", place.viewport))
    place = place._replace(matrix=compose(place.matrix, shift), uses=(*place.uses, name))
    target = named[name]
    if target.tag not in ("symbol", "svg"):
        return target, place
    size = {key: element.attributes[key] for key in ("width", "height") if key in element.attributes}
    copy = Element("svg", target.attributes | size, target.line, target.column)
    copy.children = target.children
    return copy, place


def _enter_viewport(element: Element, place: _DrawnPlace) -> _DrawnPlace:
    """The coordinates inside a nested `svg`: moved by its x and y, scaled from its viewBox to its size."""
    outside = place.viewport
    shift = translation(element.length("x", outside), element.length("y", outside))
    box = _view_box(element)
    if box is None and not {"width", "height"} & element.attributes.keys():
        return place._replace(matrix=compose(place.matrix, shift))
    width, height = element.length("width", outside, "100%"), element.length("height", outside, "100%")
    if box is None:
        return place._replace(matrix=compose(place.matrix, shift), viewport=(width, height))
    matrix = compose(shift, _view_box_matrix(element, box, width, height))
    return place._replace(matrix=compose(place.matrix, matrix), viewport=(box[2], box[3]))


def _view_box(element: Element) -> list[float] | None:
    if "viewBox" not in element.attributes:
        return None
    box = element.numbers("viewBox")
    if len(box) != 4 or min(box[2:]) <= 0:
        text = element.attributes["viewBox"]
        raise element.error(f"has viewBox {shown(text)}; needs x, y and a positive width and height.")
    return box


def _view_box_matrix(element: Element, box: list[float], width: float, height: float) -> np.ndarray:
    """The map of the viewBox into the rectangle from 0, 0 to width, height (SVG 2, section 8.2)."""
    aspect = element.attributes.get("preserveAspectRatio", "xMidYMid")
    match = re.fullmatch(r"\s*(?:none|x(Min|Mid|Max)Y(Min|Mid|Max))(\s+meet|\s+slice)?\s*", aspect)
    if match is None:
        raise element.error(f"has preserveAspectRatio {shown(aspect)}; needs for example 'xMidYMid meet' or 'none'.")
    scales = [width / box[2], height / box[3]]
    if match.group(1) is not None:
        scales = [max(scales) if "slice" in aspect else min(scales)] * 2
    shares = [{"Min": 0.0, "Mid": 0.5, "Max": 1.0, None: 0.0}[part] for part in match.groups()[:2]]
    shift = [
        share * (size - scale * extent) - scale * low
        for share, size, scale, low, extent in zip(shares, (width, height), scales, box[:2], box[2:], strict=True)
    ]
    return np.array([[scales[0], 0.0, shift[0]], [0.0, scales[1], shift[1]]])
