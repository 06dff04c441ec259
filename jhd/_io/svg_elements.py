"""Elements of SVG documents with their line and column, and their attributes as numbers, lengths and matrices.

The standard library reads the XML. Nothing is rounded or skipped on the way: content that cannot be understood is
refused with its line and column.
"""

import math
import re
import xml.parsers.expat
from functools import cached_property
from typing import Any

import numpy as np

from jhd._io.contours import unit_direction
from jhd._io.errors import ParseError, shown
from jhd._io.path_text import Scanner

# User units (CSS pixels, 96 an inch) in each absolute unit.
_UNITS = {"": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "pt": 96 / 72, "pc": 16.0}
_LENGTH = re.compile(r"\s*([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)(%|[a-zA-Z]*)\s*", re.ASCII)
_FUNCTION = re.compile(r"[\s,]*([A-Za-z]+)\s*\(([^()]*)\)[\s,]*")
_NUMBERS_OF = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,)}
_NAMESPACE = "http://www.w3.org/2000/svg "

# Properties of CSS that move shapes, of all elements, and that give their sizes, of some.
_MOVING = ("transform", "transform-origin", "transform-box", "translate", "rotate", "scale", "zoom", "offset-path")
_MOVING_WITH = ("transform-origin", "transform-box")
_BOX = ("x", "y", "width", "height")
_SIZES = {
    "svg": _BOX, "use": _BOX, "rect": (*_BOX, "rx", "ry"), "circle": ("cx", "cy", "r"),
    "ellipse": ("cx", "cy", "rx", "ry"), "path": ("d",),
}  # fmt: skip
# A comment without an end extends to the end of the text.
_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)", re.DOTALL)
_IMPORTED = re.compile(r"(@import\b[^;]*)")
_SHEET = re.compile(
    r"(?:^|[{;\s])(display\s*:\s*none|visibility\s*:\s*(?:hidden|collapse)|(?:"
    + "|".join(sorted({*_MOVING, *(name for names in _SIZES.values() for name in names)}))
    + r")\s*:)"
)

# Most levels of nested elements.
_DEEPEST = 200
# Entities and defaults may expand the text of attributes and style sheets to this many times the file, plus a
# constant.
_TIMES_GROWN, _ALWAYS_GROWN = 10, 100_000

# Width and height of the surrounding viewport in user units; None if the file does not say.
Viewport = tuple[float, float] | None


class Element:
    """An XML element: tag, attributes, children, and its line and column in the file, from 1."""

    def __init__(self, tag: str, attributes: dict[str, str], line: int, column: int):
        self.tag = tag
        self.attributes = attributes
        self.children: list[Element] = []
        self.line = line
        self.column = column

    @cached_property
    def style(self) -> dict[str, str]:
        """The declarations of the attribute `style`, in small letters: CSS does not tell them from capitals."""
        pairs = (part.partition(":") for part in _without_comments(self.attributes.get("style", "")).split(";"))
        return {name.strip(): value.partition("!")[0].strip() for name, _, value in pairs}

    def property(self, name: str) -> str:
        """The value of a property in small letters; the attribute `style` precedes the attribute of this name."""
        return self.style.get(name, self.attributes.get(name, "").strip().lower())

    def check_placed_by_attributes(self, sizes: bool = True) -> None:
        """Raise ParseError if a property that is not read moves the element or sets one of its sizes."""
        for name in (*_MOVING, *(_SIZES.get(self.tag, ()) if sizes else ())):
            moves = name not in _MOVING_WITH or "transform" in self.attributes
            given = name in self.style and (self.style[name] != "none" or name in self.attributes)
            if moves and (given or name in _MOVING_WITH and name in self.attributes):
                where = " in its style" if name in self.style else ""
                raise self.error(f"has {name}{where}, which is not read; needs attributes: transform, x, y, r ...")

    def error(self, message: str) -> ParseError:
        """A ParseError with the message and the position of this element."""
        return ParseError(f"<{self.tag[:60]}> {message}", line=self.line, column=self.column)

    def numbers(self, name: str, text: str | None = None) -> list[float]:
        """The list of numbers in the attribute, or in a part of its text.

        Raises:
            ParseError: the text has anything else.
        """
        text = self.attributes.get(name, "") if text is None else text
        try:
            return Scanner(text, name).rest()
        except ParseError as error:
            raise self.error(f"{error.reason} (column {error.column} of {shown(text)})") from error

    def length(self, name: str, viewport: Viewport, default: str = "0") -> float:
        """The attribute in user units; percentages refer to a side of the viewport or to its mean diagonal.

        Raises:
            ParseError: no number, an unknown or relative unit, a percentage of an unknown viewport.
        """
        text = self.attributes.get(name, default)
        match = _LENGTH.fullmatch(text)
        if match is None or match.group(2) not in (*_UNITS, "%"):
            units = ", ".join(unit for unit in _UNITS if unit)
            raise self.error(f"has {name} {shown(text)}; needs a number, perhaps with {units} or %.")
        value, unit = float(match.group(1)), match.group(2)
        value = value / 100 * self._whole(name, text, viewport) if unit == "%" else value * _UNITS[unit]
        if not math.isfinite(value):
            raise self.error(f"has {name} {shown(text)}, which is beyond the range of doubles.")
        return value

    def _whole(self, name: str, text: str, viewport: Viewport) -> float:
        """The length to which percentages of the attribute refer."""
        if viewport is None:
            raise self.error(
                f"has {name} {shown(text)}; percentages need a viewBox, or a width and height, of the root."
            )
        width, height = viewport
        if name in ("x", "x1", "x2", "cx", "width", "rx"):
            return width
        if name in ("y", "y1", "y2", "cy", "height", "ry"):
            return height
        return math.hypot(width, height) / math.sqrt(2)

    def transform(self) -> np.ndarray:
        """The matrix (2, 3) of the attribute `transform`, the identity if there is none.

        Raises:
            ParseError: an unknown function, a wrong number of values, text between functions.
        """
        text = self.attributes.get("transform", "").strip()
        matrix, at = translation(0.0, 0.0), 0
        while at < len(text):
            match = _FUNCTION.match(text, at)
            if match is None:
                found = text[at : at + 12]
                raise self.error(
                    f"has transform {shown(text)}; needs functions such as rotate(30); found {shown(found)}."
                )
            name = match.group(1)
            values = self.numbers("transform", match.group(2))
            if len(values) not in _NUMBERS_OF.get(name, ()):
                known = ", ".join(f"{key} of {' or '.join(map(str, n))}" for key, n in _NUMBERS_OF.items())
                raise self.error(f"has transform {shown(match.group().strip())}; known are {known} numbers.")
            matrix = compose(matrix, _function_matrix(name, values))
            at = match.end()
        return matrix


class _DocumentBuilder:
    """Handlers of an XML parser that build the elements of a document; `left` counts down the allowed text."""

    def __init__(self, parser: Any, left: int):
        self.parser, self.left, self.sheet = parser, left, []
        self.top = Element("document", {}, 1, 1)
        self.stack = [self.top]
        parser.StartElementHandler, parser.EndElementHandler = self.start, self.end
        parser.CharacterDataHandler, parser.ProcessingInstructionHandler = self.text, self.instruction

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Handle the start of an element."""
        place = self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1
        element = Element(name.removeprefix(_NAMESPACE), attributes, *place)
        if len(self.stack) > _DEEPEST:
            raise element.error(f"is inside {_DEEPEST} other elements; deeper ones are not read.")
        self.stack[-1].children.append(element)
        self.stack.append(element)
        self.grow(sum(map(len, attributes.values())))

    def text(self, part: str) -> None:
        """Handle text in an element."""
        if self.stack[-1].tag == "style":
            self.grow(len(part))
            self.sheet.append(part)

    def instruction(self, target: str, _: str) -> None:
        """Handle a processing instruction, for example `<?xml-stylesheet ...?>`."""
        if target == "xml-stylesheet":
            line, column = self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1
            raise ParseError("names a style sheet, which is not read; needs attributes.", line=line, column=column)

    def end(self, _: str) -> None:
        """Handle the end of an element."""
        element = self.stack.pop()
        if element.tag == "style":
            _check_sheet(element, "".join(self.sheet))
            self.sheet.clear()

    def grow(self, count: int) -> None:
        """Count text that is kept; raise ParseError if it is far longer than the file."""
        self.left -= count
        if self.left < 0:
            raise self.stack[-1].error(f"grows the file to more than {_TIMES_GROWN} times its length, by entities.")


def parse_document(content: bytes) -> Element:
    """The root element of an SVG document; elements of other namespaces keep their full names.

    Args:
        content: the bytes of the file, in the encoding that they declare.

    Raises:
        ParseError: text that is not well-formed, that grows by its entities, or whose root is not `svg`; a style sheet
            that hides shapes, moves them or gives their sizes.
    """
    parser = xml.parsers.expat.ParserCreate(namespace_separator=" ")
    top = _DocumentBuilder(parser, _ALWAYS_GROWN + _TIMES_GROWN * len(content)).top
    try:
        parser.Parse(content, True)
    except xml.parsers.expat.ExpatError as error:
        reason = xml.parsers.expat.ErrorString(error.code)
        raise ParseError(f"XML: {reason}.", line=error.lineno, column=error.offset + 1) from error
    except ParseError:
        raise
    except (LookupError, ValueError) as error:  # of encodings that Python does not know, or not one byte at a time
        raise ParseError(f"XML: {shown(str(error), 100)}.", line=1) from error
    root = top.children[0]
    if root.tag != "svg":
        raise root.error("is the root; an SVG file has <svg> there.")
    return root


def _without_comments(text: str) -> str:
    return _COMMENT.sub(" ", text.lower())


def _check_sheet(element: Element, text: str) -> None:
    found = _SHEET.search(_without_comments(text)) or _IMPORTED.search(_without_comments(text))
    if found:
        raise element.error(f"sets {shown(found.group(1).strip())}, and style sheets are not read; needs attributes.")


def translation(x: float, y: float) -> np.ndarray:
    """The matrix (2, 3) of a shift."""
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y]])


def compose(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """The matrix (2, 3) of x -> outer(inner(x))."""
    # Matrices beyond the range of doubles are refused when points are transformed.
    with np.errstate(over="ignore", invalid="ignore"):
        product = outer[:, :2] @ inner
        product[:, 2] += outer[:, 2]
    return product


def _function_matrix(name: str, values: list[float]) -> np.ndarray:
    if name == "matrix":
        return np.array(values).reshape(3, 2).T
    if name == "translate":
        return translation(values[0], values[1] if len(values) > 1 else 0.0)
    if name == "scale":
        return np.array([[values[0], 0.0, 0.0], [0.0, values[-1], 0.0]])
    if name == "rotate":
        cosine, sine = unit_direction(values[0])
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0]])
        if len(values) == 1:
            return turn
        return compose(compose(translation(values[1], values[2]), turn), translation(-values[1], -values[2]))
    slope = math.tan(math.radians(values[0]))
    return np.array([[1.0, slope if name == "skewX" else 0.0, 0.0], [slope if name == "skewY" else 0.0, 1.0, 0.0]])
