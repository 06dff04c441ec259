"""Outlines of letters as curves, from the fonts that matplotlib knows and from font files.

TrueType outlines consist of lines and quadratics; on-curve points that the format only implies are included. Outlines
of CFF fonts consist of lines and cubics. Coordinates are exact font units with y up: integers, and halves if lines are
elevated to quadratics. (In CFF fonts, elevating lines to cubics rounds by an ulp.) There is no hinting, kerning or
ligatures.

Source: Apple, TrueType Reference Manual, chapter "Digitizing letterform designs".
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from fontTools.pens.basePen import BasePen
from fontTools.ttLib import TTFont, TTLibError
from matplotlib import font_manager, get_data_path

from jhd._io.contours import Contour, assemble
from jhd._io.errors import ParseError
from jhd._shapes.curve import BezierSegments

_SUFFIXES = (".ttf", ".otf", ".ttc", ".otc")
# Parts that letters are put together of, and pieces, in one letter: parts of parts double at every level, and three
# bytes stand for 256 points. A simple letter of the format has no more points.
_MOST_PARTS, _MOST_PIECES = 1_000, 1 << 16

# A point as fontTools hands it to pens.
Point = tuple[float | int, float | int]


class _MissingGlyphError(Exception):
    """A font lacks a letter."""


class _OutgrownError(Exception):
    """A letter has more parts or pieces than are allowed."""


def load_glyph(font: str | Path, text: str, *, size: float | int | None = None) -> BezierSegments:
    """The outline of a letter, or of a text without kerning: all contours as one curve, with y up.

    >>> import jhd
    >>> jhd.io.load_glyph("DejaVu Sans", "l").control_points[0].tolist()
    [[193.0, 1556.0], [377.0, 1556.0]]

    Args:
        font: a font family that matplotlib knows (`DejaVu Sans`; its regular face), the name of a font file without
            suffix (`DejaVuSans-Bold`), or a path to a .ttf, .otf, .ttc or .otc file.
        text: one letter or several; the first starts at x = 0 on the baseline y = 0.
        size: length of the em, a positive number in any unit; None keeps font units (usually 1000 or 2048 per em).

    Returns:
        A closed curve in the plane.

    Raises:
        FileNotFoundError: the path does not exist.
        ParseError: a file that is not a font.
        TypeError: a text that is not a string.
        ValueError: an unknown font (the message lists some known ones), a letter that the font lacks, a text without
            outline (spaces), or a size that is not positive.
    """
    if not isinstance(text, str):
        raise TypeError(f"text is {text!r}; needs a string.")
    if not text:
        raise ValueError("text is empty; needs at least one letter.")
    curve = _outlines(font, lambda _: [text], size)[0]
    if curve is None:
        raise ValueError(f"{text!r} has no outline in {font}.")
    return curve


def load_glyphs(font: str | Path, *, size: float | int | None = None) -> dict[str, BezierSegments]:
    """The outlines of all letters of a font that have one, in the order of their code points.

    >>> import jhd
    >>> jhd.io.load_glyphs("STIXSizeFiveSym")["_"].count
    4

    Args:
        font: a family, the name of a font file or a path, see `load_glyph`.
        size: length of the em, a positive number in any unit; None keeps font units (usually 1000 or 2048 per em).

    Returns:
        A dictionary from letters to closed curves.

    Raises:
        FileNotFoundError: the path does not exist.
        ParseError: a file that is not a font.
        ValueError: an unknown font, or a size that is not positive.
    """
    letters: list[str] = []

    def all_of(opened: TTFont) -> list[str]:
        letters.extend(map(chr, sorted(opened.getBestCmap() or {})))
        return letters

    curves = _outlines(font, all_of, size)
    return {letter: curve for letter, curve in zip(letters, curves, strict=True) if curve is not None}


def _outlines(
    font: str | Path, texts_of: Callable[[TTFont], list[str]], size: float | int | None
) -> list[BezierSegments | None]:
    """The outlines of some texts, None for texts without ink, from a font that is opened once."""
    if size is not None and (not hasattr(size, "__float__") or not float(size) > 0):
        raise ValueError(f"size is {size!r}; needs a positive length.")
    file = _font_file(str(font))
    try:
        with TTFont(file, fontNumber=0) as opened:
            drawn = [_draw(opened, str(font), text) for text in texts_of(opened)]
    except _MissingGlyphError as error:
        raise ValueError(str(error)) from None
    except _OutgrownError as error:
        raise ParseError(str(error), file) from None
    except TTLibError as error:
        raise ParseError(f"is not a readable font ({error}).", file) from error
    except Exception as error:
        # Damaged tables surface as nearly every kind of error that Python has.
        reason = f"{type(error).__name__}: {str(error)[:100]}"
        raise ParseError(f"is not a readable font ({reason}).", file) from error
    if size is None:
        return [assemble(contours) for contours, _ in drawn]
    scaled = [(contours, np.diag([size / units, size / units, 0.0])[:2]) for contours, units in drawn]
    return [assemble([contour.transformed(scale) for contour in contours]) for contours, scale in scaled]


def parse_font_spec(spec: str) -> tuple[str, str]:
    """Font and text of `font:NAME:TEXT`; the name may contain colons, and the text may be a colon.

    >>> import jhd
    >>> jhd.io.parse_font_spec("font:DejaVu Sans:a")
    ('DejaVu Sans', 'a')

    Args:
        spec: a string of this form.

    Returns:
        The name of the font, and the text.

    Raises:
        ParseError: a string of another form.
    """
    if spec.startswith("font:"):
        name, _, text = spec.removeprefix("font:").rpartition(":")
        if not text and name.endswith(":"):
            name, text = name[:-1], ":"
        if name and text:
            return name, text
    raise ParseError(
        f"{spec!r} does not name a letter of a font; needs font:NAME:LETTER, for example 'font:DejaVu Sans:a'."
    )


def _font_file(font: str) -> str:
    """The file of a font given by path, family name or file name."""
    if font.lower().endswith(_SUFFIXES):
        if not Path(font).is_file():
            raise FileNotFoundError(f"{font}: no such file.")
        return font
    entries = font_manager.fontManager.ttflist
    wanted = font.casefold()
    matching = [entry for entry in entries if wanted in (entry.name.casefold(), Path(entry.fname).stem.casefold())]
    if not matching:
        raise ValueError(f"{font!r} is not a font known to matplotlib; known are for example {_some_families()}.")
    return min(matching, key=_preference).fname


def _preference(entry: Any) -> tuple[bool, int, bool, bool, str]:
    """Sort key: regular faces first, then files that come with matplotlib, which do not depend on the machine."""
    style = entry.style != "normal"
    stretch, weight = entry.stretch != "normal", abs(int(entry.weight) - 400)
    return style, weight, stretch, not _is_carried(entry), entry.fname


def _is_carried(entry: Any) -> bool:
    return Path(entry.fname).is_relative_to(get_data_path())


def _some_families() -> str:
    carried = {entry.name for entry in font_manager.fontManager.ttflist if _is_carried(entry)}
    return ", ".join(sorted(carried)[:8])


def _draw(font: TTFont, name: str, text: str) -> tuple[list[Contour], float]:
    """The contours of the text, each letter moved by the advances before it, and the font units of an em."""
    glyphs = font.getGlyphSet()
    named = font.getBestCmap() or {}
    contours: list[Contour] = []
    advance = 0.0
    for letter in text:
        if ord(letter) not in named:
            raise _MissingGlyphError(f"{name} has no glyph for {letter!r} (U+{ord(letter):04X}).")
        glyph = glyphs[named[ord(letter)]]
        pen = _ContourPen(glyphs, advance)
        glyph.draw(pen)
        contours += pen.contours
        advance += glyph.width
    return contours, float(font["head"].unitsPerEm)  # pyright: ignore[reportAttributeAccessIssue]


class _ContourPen(BasePen):
    """A fontTools pen that collects the contours of a letter; the base class transforms parts of composite letters."""

    def __init__(self, glyphs: Any, advance: float):
        BasePen.__init__(self, glyphs)
        self.contours: list[Contour] = []
        self.advance = advance
        self.parts = self.pieces = 0

    def addComponent(self, glyphName: str, transformation: Any) -> None:
        """Draw a part, which may have parts itself."""
        self.parts += 1
        if self.parts > _MOST_PARTS:
            raise _OutgrownError(f"a letter has more than {_MOST_PARTS} parts.")
        BasePen.addComponent(self, glyphName, transformation)

    def _places(self, *points: Point) -> list[complex]:
        self.pieces += 1
        if self.pieces > _MOST_PIECES:
            raise _OutgrownError(f"a letter has more than {_MOST_PIECES} pieces.")
        return [complex(x + self.advance, y) for x, y in points]

    def _moveTo(self, pt: Point) -> None:
        self.contours.append(Contour(*self._places(pt)))

    def _lineTo(self, pt: Point) -> None:
        self.contours[-1].append(*self._places(pt))

    def _qCurveToOne(self, pt1: Point, pt2: Point) -> None:
        self.contours[-1].append(*self._places(pt1, pt2))

    def _curveToOne(self, pt1: Point, pt2: Point, pt3: Point) -> None:
        self.contours[-1].append(*self._places(pt1, pt2, pt3))

    def _closePath(self) -> None:
        self.contours[-1].close()

    def _endPath(self) -> None:
        # Outlines bound ink: a contour that a font leaves open is closed by every renderer.
        self.contours[-1].close()
