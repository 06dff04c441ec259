"""Path data, the language of the attribute `d` of SVG: text to contours.

All commands of SVG 1.1 chapter 8.3, absolute and relative. Lines and polynomial segments keep the numbers as written.
Elliptic arcs become rational quadratics of at most a quarter turn each, exact up to rounding (a few ulp of the
coordinates). The standard asks viewers to draw up to the first error; we refuse the text and name its line and column.
"""

import math
import re
from collections.abc import Callable

from jhd._io.contours import Contour, unit_direction
from jhd._io.errors import ParseError, place_in

_NUMBER = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_SEPARATOR = re.compile(r"[ \t\r\n\f]*,?[ \t\r\n\f]*")
_SPACE = re.compile(r"[ \t\r\n\f]*")
_ARGUMENTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
# tan(pi / 8), with room for rounding: arcs that turn further than a quarter are halved.
_QUARTER = math.tan(math.pi / 8) * (1 + 1e-12)


class Scanner:
    """Reader of numbers separated by white space or one comma; `at` is its position in the text.

    Args:
        text: the text to read.
        what: name of the text in messages, for example "path data".
    """

    def __init__(self, text: str, what: str):
        self.text = text
        self.what = what
        self.at = 0

    def error(self, message: str) -> ParseError:
        """A ParseError with the message and the current position."""
        line, column = place_in(self.text, self.at)
        return ParseError(f"{self.what}: {message}", line=line, column=column)

    def found(self) -> str:
        """The present character, for messages."""
        return repr(self.text[self.at]) if self.at < len(self.text) else "the end"

    def skip(self, pattern: re.Pattern[str] = _SPACE) -> None:
        """Move past the pattern if it matches here."""
        match = pattern.match(self.text, self.at)
        self.at = match.end() if match else self.at

    def at_end(self) -> bool:
        """Whether only white space is left."""
        self.skip()
        return self.at == len(self.text)

    def more_numbers(self) -> bool:
        """Whether a number follows, perhaps after a comma; the scanner does not move."""
        match = _SEPARATOR.match(self.text, self.at)
        return _NUMBER.match(self.text, match.end() if match else self.at) is not None

    def number(self) -> float:
        """The number that starts here.

        Raises:
            ParseError: there is none, or it overflows.
        """
        match = _NUMBER.match(self.text, self.at)
        if match is None:
            raise self.error(f"needs a number; found {self.found()}.")
        value = float(match.group())
        if not math.isfinite(value):
            raise self.error(f"the number {match.group()[:40]} is too large.")
        self.at = match.end()
        return value

    def flag(self) -> bool:
        """The flag of an arc: one digit, 0 or 1, which needs no separator behind it.

        Raises:
            ParseError: another character.
        """
        if self.text[self.at : self.at + 1] not in ("0", "1"):
            raise self.error(f"needs an arc flag, 0 or 1; found {self.found()}.")
        self.at += 1
        return self.text[self.at - 1] == "1"

    def numbers(self, kinds: str) -> list[float]:
        """Numbers with separators between them: one for each letter of kinds, n a number and f a flag."""
        values = []
        for index, kind in enumerate(kinds):
            self.skip(_SEPARATOR if index else _SPACE)
            values.append(float(self.flag()) if kind == "f" else self.number())
        return values

    def rest(self) -> list[float]:
        """All numbers up to the end of the text."""
        values = [] if self.at_end() else self.numbers("n")
        while self.more_numbers():
            self.skip(_SEPARATOR)
            values += self.numbers("n")
        if not self.at_end():
            raise self.error(f"needs a number; found {self.found()}.")
        return values


class _Drawing:
    """The contours drawn so far, the current point and the control point that smooth commands reflect."""

    def __init__(self):
        self.contours: list[Contour] = []
        self.at = 0j
        self.control: tuple[str, complex] | None = None

    @property
    def contour(self) -> Contour:
        """The current contour; after a closed contour, a new one that starts at its start point."""
        if self.contours[-1].closed:
            self.contours.append(Contour(self.at))
        return self.contours[-1]

    def reflected(self, kind: str) -> complex:
        """The last control point of the same kind of curve mirrored at the current point, else the current point."""
        if self.control is None or self.control[0] != kind:
            return self.at
        return 2 * self.at - self.control[1]

    def draw(self, command: str, values: list[float]) -> None:
        """Draw one command with one set of values."""
        name, origin = command.upper(), self.at if command.islower() else None
        control = None
        if name == "M":
            self.contours.append(Contour(_points(values, origin)[0]))
        elif name == "Z":
            self.contours[-1].close()
        elif name in "HV":
            self.contour.append(_straight(name, values[0], self.at, origin))
        elif name == "L":
            self.contour.append(*_points(values, origin))
        elif name == "A":
            rx, ry, rotation, large, sweep = values[:5]
            draw_arc(self.contour, (rx, ry), rotation, bool(large), bool(sweep), _points(values[5:], origin)[0])
        else:
            kind = "cubic" if name in "CS" else "quadratic"
            points = _points(values, origin)
            if name in "ST":
                points.insert(0, self.reflected(kind))
            self.contour.append(*points)
            control = (kind, points[-2])
        self.control = control
        self.at = self.contours[-1].end


def _points(values: list[float], origin: complex | None) -> list[complex]:
    absolute = [complex(x, y) for x, y in zip(values[::2], values[1::2], strict=True)]
    return absolute if origin is None else [origin + point for point in absolute]


def _straight(name: str, value: float, at: complex, origin: complex | None) -> complex:
    if name == "H":
        return complex(value if origin is None else at.real + value, at.imag)
    return complex(at.real, value if origin is None else at.imag + value)


def contours_of_path(d: str) -> list[Contour]:
    """The contours of path data; contours of a lone move hold no segment.

    Raises:
        ParseError: text that is no path data, with line and column in it.
    """
    scanner, drawing = Scanner(d, "path data"), _Drawing()
    while not scanner.at_end():
        command = d[scanner.at]
        if not command.isascii() or command.upper() not in _ARGUMENTS:
            raise scanner.error(f"needs a command, one of {' '.join(_ARGUMENTS)} or lower case; found {command!r}.")
        if not drawing.contours and command not in "Mm":
            raise scanner.error(f"must begin with M or m; found {command!r}.")
        scanner.at += 1
        _draw_all(scanner, drawing, command)
    return drawing.contours


def _draw_all(scanner: Scanner, drawing: _Drawing, command: str) -> None:
    """Draw a command as often as numbers follow; repeats of a move are lines."""
    if command in "Zz":
        drawing.draw(command, [])
        return
    kinds = "nnnffnn" if command in "Aa" else "n" * _ARGUMENTS[command.upper()]
    drawing.draw(command, scanner.numbers(kinds))
    repeat = {"M": "L", "m": "l"}.get(command, command)
    while scanner.more_numbers():
        scanner.skip(_SEPARATOR)
        drawing.draw(repeat, scanner.numbers(kinds))


def draw_arc(
    contour: Contour, radii: tuple[float, float], rotation: float, large: bool, sweep: bool, end: complex
) -> None:
    """Append the elliptic arc to `end` as rational quadratics of at most a quarter turn each.

    In the coordinates where the ellipse is the unit circle, an arc of half angle h over the chord 2 v has its middle
    control point at J v tan(h) from the middle of the chord, J the turn by a right angle, with weight cos(h), and its
    own middle at J v tan(h/2); sin(h) = |v|. Nothing refers to the center, which may be far away. tan(h/2) is
    s / (1 + c) for small arcs and (1 + c) / s for large ones, so nothing cancels. Radii too small for the chord are
    scaled up to a half turn, which does not change J v.

    Args:
        contour: drawn from its end.
        radii: half axes; a zero gives a line, signs do not matter.
        rotation: angle of the first axis, in degrees.
        large: whether the arc turns by more than a half turn.
        sweep: whether it turns from x towards y.
        end: end point; nothing is drawn if the contour is there already.

    Source: SVG 1.1, appendix F.6; Piegl & Tiller, The NURBS Book (1997), section 7.3.
    """
    rx, ry = abs(radii[0]), abs(radii[1])
    if contour.end == end:
        return
    if rx == 0 or ry == 0:
        contour.append(end)
        return
    axis = complex(*unit_direction(rotation))

    def turned(v: complex) -> complex:
        """J v in the metric of the ellipse, towards the bulge of the arc."""
        local = v * axis.conjugate()
        bulge = complex(local.imag * (rx / ry), -local.real * (ry / rx)) * axis
        return bulge if sweep else -bulge

    half = (end - contour.end) / 2 * axis.conjugate()
    sine = min(1.0, math.hypot(half.real / rx, half.imag / ry))
    cosine = math.sqrt((1 - sine) * (1 + sine))
    # If the chord is tiny compared with the radii, the far side exceeds the range of doubles and is refused later.
    far = (1 + cosine) / sine if sine else math.inf
    _append_arc(contour, end, turned, far if large else sine / (1 + cosine))


def _append_arc(contour: Contour, end: complex, turned: Callable[[complex], complex], tangent: float) -> None:
    """Append the arc whose tan(h/2) is `tangent`, halved until it turns by a quarter at most."""
    middle, half = (contour.end + end) / 2, (end - contour.end) / 2
    if tangent > _QUARTER:
        part = tangent / (1 + math.hypot(1.0, tangent))
        _append_arc(contour, middle + tangent * turned(half), turned, part)
        _append_arc(contour, end, turned, part)
        return
    square = tangent * tangent
    corner = middle + turned(half) * (2 * tangent / (1 - square))
    contour.append(corner, end, weights=(1.0, (1 - square) / (1 + square), 1.0))
