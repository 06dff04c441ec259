"""Elements of SVG documents with their places in the file, and their attributes as numbers, lengths and matrices.

The standard library reads the XML, and nothing is rounded or skipped on the way: what cannot be understood is refused
with its line and column.
"""

import math
import re
import xml.parsers.expat

import numpy as np

from jhd.io.contours import unit_direction
from jhd.io.errors import ParseError, shown
from jhd.io.path_data import Scanner

# User units (CSS pixels, 96 an inch) in each absolute unit.
_UNITS = {"": 1.0, "px": 1.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "pt": 96 / 72, "pc": 16.0}
_LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(%|[a-zA-Z]*)\s*", re.ASCII)
_FUNCTION = re.compile(r"[\s,]*([A-Za-z]+)\s*\(([^()]*)\)[\s,]*")
_NUMBERS_OF = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,)}
_NAMESPACE = "http://www.w3.org/2000/svg "

# Elements in elements.
_DEEPEST = 200

# Width and height of the surrounding viewport in user units; None where the file does not say.
Viewport = tuple[float, float] | None


class Element:
    """An XML element: tag, attributes, children, and its line and column in the file, from 1."""

    def __init__(self, tag: str, attributes: dict[str, str], line: int, column: int):
        self.tag = tag
        self.attributes = attributes
        self.children: list[Element] = []
        self.line = line
        self.column = column

    def error(self, message: str) -> ParseError:
        """The error that the message describes, at this element."""
        return ParseError(f"<{self.tag[:60]}> {message}", line=self.line, column=self.column)

    def numbers(self, name: str, text: str | None = None) -> list[float]:
        """The list of numbers in the attribute, or in a part of its text.

        Raises:
            ParseError: anything else is in it.
        """
        text = self.attributes.get(name, "") if text is None else text
        try:
            return Scanner(text, name).rest()
        except ParseError as error:
            raise self.error(f"{error.reason} (column {error.column} of {shown(text)})") from error

    def length(self, name: str, viewport: Viewport, default: str = "0") -> float:
        """The attribute in user units; percentages refer to the viewport, those of other names to its mean diagonal.

        Raises:
            ParseError: no number, an unknown or relative unit, a percentage of an unknown viewport.
        """
        text = self.attributes.get(name, default)
        match = _LENGTH.fullmatch(text)
        if match is None or match.group(2) not in (*_UNITS, "%"):
            units = ", ".join(unit for unit in _UNITS if unit)
            raise self.error(f"has {name} {shown(text)}; needs a number, perhaps with {units} or %.")
        amount, unit = float(match.group(1)), match.group(2)
        if unit != "%":
            return amount * _UNITS[unit]
        if viewport is None:
            raise self.error(
                f"has {name} {shown(text)}; percentages need a viewBox, or a width and height, of the root."
            )
        width, height = viewport
        if name in ("x", "x1", "x2", "cx", "width", "rx"):
            return amount / 100 * width
        if name in ("y", "y1", "y2", "cy", "height", "ry"):
            return amount / 100 * height
        return amount / 100 * math.sqrt((width**2 + height**2) / 2)

    def transform(self) -> np.ndarray:
        """The matrix (2, 3) of the attribute `transform`, the identity where there is none.

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


def parse_document(content: bytes) -> Element:
    """The root element of an SVG document; elements of other namespaces keep their full names.

    Args:
        content: the bytes of the file, in the encoding that they declare.

    Raises:
        ParseError: text that is not well-formed, or whose root is not `svg`.
    """
    parser = xml.parsers.expat.ParserCreate(namespace_separator=" ")
    top = Element("document", {}, 1, 1)
    stack = [top]

    def start(name: str, attributes: dict[str, str]) -> None:
        place = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        element = Element(name.removeprefix(_NAMESPACE), attributes, *place)
        if len(stack) > _DEEPEST:
            raise element.error(f"is inside {_DEEPEST} other elements; deeper ones are not read.")
        stack[-1].children.append(element)
        stack.append(element)

    def end(_: str) -> None:
        stack.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
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


def translation(x: float, y: float) -> np.ndarray:
    """The matrix (2, 3) of a shift."""
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y]])


def compose(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """The matrix (2, 3) of x -> outer(inner(x))."""
    # What leaves the range of doubles is refused where points are drawn by it.
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
