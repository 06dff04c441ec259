"""What experiments on many shapes share: letters of whole fonts, programs compiled before, CPU by stage."""

import os
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

import jhd
import jhd.io

FAMILIES = ("DejaVu Sans", "DejaVu Serif", "DejaVu Sans Mono")
# Small fonts for small runs, of which those letters are taken that one program measures.
SMALL = ("STIXSizeOneSym", "STIXSizeTwoSym")
_SMALL_SEGMENTS = 16
# Numbers of segments up to which one program serves; two shapes of each are enough to compile all programs.
_SIZES = (16, 48, 192, 768)


class Glyphs(NamedTuple):
    """Outlines of letters, in ems, and the letters."""

    letters: list[str]
    curves: list[jhd.BezierSegments]

    def take(self, index: Sequence[int] | np.ndarray) -> "Glyphs":
        """Some of them."""
        return Glyphs([self.letters[k] for k in index], [self.curves[k] for k in index])


def glyphs_of(fonts: Sequence[str], small: bool = False) -> Glyphs:
    """The letters of fonts whose outline comes once in its font; in a small run those of few segments alone."""
    seen: dict[tuple[str, bytes], tuple[str, jhd.BezierSegments]] = {}
    for font in fonts:
        for letter, curve in jhd.io.load_glyphs(font, size=1.0).items():
            if not small or curve.count <= _SMALL_SEGMENTS:
                seen.setdefault((font, np.asarray(curve.control_points).tobytes()), (letter, curve))
    letters, curves = zip(*seen.values(), strict=True)
    return Glyphs(list(letters), list(curves))


def between(glyphs: Glyphs, least: int, most: int) -> Glyphs:
    """Those with so many segments."""
    return glyphs.take([k for k, curve in enumerate(glyphs.curves) if least <= curve.count <= most])


def compile_for(*collections: Sequence[jhd.BezierSegments]) -> None:
    """Compiles what calls on these curves need: a call on two of each size."""
    some: list[jhd.BezierSegments] = []
    for curves in collections:
        for low, high in zip((0, *_SIZES), _SIZES, strict=False):
            some += [curve for curve in curves if low < curve.count <= high][:2]
    jhd.nearest_shapes(some, some[:], len(some))


class Spent(NamedTuple):
    """CPU seconds of a call in this process: of pivot distances, of the rest, and of all; and its wall time."""

    pivots: float
    rest: float
    cpu: float
    wall: float


def staged(call: Callable[[Callable[[Any], None]], Any]) -> tuple[Any, Spent]:
    """The result of a call that takes `progress`, and what it spent."""
    start, wall = time.process_time(), time.perf_counter()
    marks = [start]

    def told(progress: Any) -> None:
        if progress.stage == "pivot distances":
            marks.append(time.process_time())

    found = call(told)
    end = time.process_time()
    return found, Spent(marks[-1] - start, end - marks[-1], end - start, time.perf_counter() - wall)


def load() -> float | None:
    """How many processes wanted to run in the last minute, where the system says."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
