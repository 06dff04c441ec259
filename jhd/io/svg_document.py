"""SVG documents: which shapes are drawn, and where.

Read: groups, links, `switch` (all of its children), nested `svg` and `use` (also of symbols) with viewBox and
preserveAspectRatio, and the shapes of `svg_shapes`; `display` and `visibility` are heeded in attributes and styles. Not
read: text, images, stroke widths, clipping and masks. Style sheets and styles that place shapes are refused.
"""

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from jhd.io.contours import Contour
from jhd.io.errors import shown
from jhd.io.svg_elements import Element, Viewport, compose, translation
from jhd.io.svg_shapes import SHAPES, contours_of_shape

# Elements that are drawn, where `use` repeats them: so many times as there are in the file, and so many in any case.
_TIMES_DRAWN, _ALWAYS_DRAWN = 10, 100_000
# Uses inside of what is used.
_MOST_USES = 8
_DRAWN = frozenset(("svg", "g", "a", "switch", "use", *SHAPES))
# Other values are those of the element around.
_VISIBLE = {"visible": True, "initial": True, "hidden": False, "collapse": False}


class Drawn(NamedTuple):
    """The contours of one shape in the coordinates of the root, and the ids of it and of all that it is inside."""

    contours: list[Contour]
    ids: frozenset[str]


class _DrawnPlace(NamedTuple):
    """Where an element is drawn: its coordinates, the ids around it and the `use` elements it came through."""

    matrix: np.ndarray
    viewport: Viewport
    ids: frozenset[str]
    uses: tuple[str, ...]
    visible: bool
    # How many elements may still be drawn in all, counted down.
    left: list[int]


def drawn_shapes(root: Element) -> Iterator[Drawn]:
    """Every shape that is drawn, in order, in user units of the root.

    viewBox and size of the root itself set the scale of the paper and not the drawing: they are not applied, and only
    say what percentages refer to.

    Raises:
        ParseError: whatever cannot be placed exactly, with the line and column of its element.
    """
    if root.property("display") == "none":
        return
    # Its size is that of the paper.
    root.check_placed_by_attributes(sizes=False)
    named: dict[str, Element] = {}
    left = [_ALWAYS_DRAWN + _TIMES_DRAWN * _collect_ids(root, named)]
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
    """Finds what is inside of an element by its id, and counts it."""
    count = len(element.children)
    for child in element.children:
        if "id" in child.attributes:
            named.setdefault(child.attributes["id"], child)
        count += _collect_ids(child, named)
    return count


def _enter(element: Element, place: _DrawnPlace) -> _DrawnPlace:
    """The place inside an element: its transform applied, its id added."""
    name = element.attributes.get("id")
    ids = place.ids if name is None else place.ids | {name}
    visible = _VISIBLE.get(element.property("visibility"), place.visible)
    return place._replace(matrix=compose(place.matrix, element.transform()), ids=ids, visible=visible)


def _draw(element: Element, place: _DrawnPlace, named: dict[str, Element]) -> Iterator[Drawn]:
    if element.tag not in _DRAWN or element.property("display") == "none":
        return
    element.check_placed_by_attributes()
    place.left[0] -= 1
    if place.left[0] < 0:
        raise element.error("is drawn after too many others: by <use>, elements are drawn again far beyond the file.")
    if len(place.uses) > _MOST_USES:
        raise element.error(f"is inside {_MOST_USES} uses of uses; deeper ones are not read.")
    place = _enter(element, place)
    if element.tag in SHAPES:
        if not place.visible:
            return
        contours = contours_of_shape(element, place.viewport)
        yield Drawn([contour.transformed(place.matrix) for contour in contours], place.ids)
        return
    if element.tag == "use":
        target, place = _used(element, place, named)
        yield from _draw(target, place, named)
        return
    if element.tag == "svg":
        place = _enter_viewport(element, place)
    for child in element.children:
        yield from _draw(child, place, named)


def _used(element: Element, place: _DrawnPlace, named: dict[str, Element]) -> tuple[Element, _DrawnPlace]:
    """What a `use` draws, and where. A symbol is drawn as a nested `svg` of the size that the `use` gives."""
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
