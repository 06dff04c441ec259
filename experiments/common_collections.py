"""Shared parts of experiments on many shapes: letters of whole fonts, compilation in advance, CPU time by stage."""

import os
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

import jhd
import jhd.io

FAMILIES = ("DejaVu Sans", "DejaVu Serif", "DejaVu Sans Mono")
# Small fonts for smoke runs, which use only letters that fit one compiled function.
SMALL = ("STIXSizeOneSym", "STIXSizeTwoSym")
_SMALL_SEGMENTS = 16
# Largest number of segments of each compiled function; two shapes of each size suffice to compile all functions.
_SIZES = (16, 48, 192, 768)


class Glyphs(NamedTuple):
    """Letters and their outlines, in ems."""

    letters: list[str]
    curves: list[jhd.BezierSegments]

    def take(self, index: Sequence[int] | np.ndarray) -> "Glyphs":
        """Return the glyphs at these indices."""
        return Glyphs([self.letters[k] for k in index], [self.curves[k] for k in index])


def glyphs_of(fonts: Sequence[str], small: bool = False) -> Glyphs:
    """Return the letters of fonts, each outline once per font; if `small`, only those of few segments."""
    seen: dict[tuple[str, bytes], tuple[str, jhd.BezierSegments]] = {}
    for font in fonts:
        for letter, curve in jhd.io.load_glyphs(font, size=1.0).items():
            if not small or curve.count <= _SMALL_SEGMENTS:
                seen.setdefault((font, np.asarray(curve.control_points).tobytes()), (letter, curve))
    letters, curves = zip(*seen.values(), strict=True)
    return Glyphs(list(letters), list(curves))


def between(glyphs: Glyphs, least: int, most: int) -> Glyphs:
    """Return the glyphs of `least` to `most` segments."""
    return glyphs.take([k for k, curve in enumerate(glyphs.curves) if least <= curve.count <= most])


def compile_for(*collections: Sequence[jhd.BezierSegments]) -> None:
    """Compile the functions for calls on these curves, by a call on two curves of each size."""
    some: list[jhd.BezierSegments] = []
    for curves in collections:
        for low, high in zip((0, *_SIZES), _SIZES, strict=False):
            some += [curve for curve in curves if low < curve.count <= high][:2]
    jhd.nearest_shapes(some, some[:], len(some))


class Spent(NamedTuple):
    """CPU seconds of a call in this process (pivot distances, the rest, the total), and its wall time."""

    pivots: float
    rest: float
    cpu: float
    wall: float


def staged(call: Callable[[Callable[[Any], None]], Any]) -> tuple[Any, Spent]:
    """Return the result of a call that takes `progress`, and the time it spent."""
    start, wall = time.process_time(), time.perf_counter()
    marks = [start]

    def told(progress: Any) -> None:
        if progress.stage == "pivot distances":
            marks.append(time.process_time())

    found = call(told)
    end = time.process_time()
    return found, Spent(marks[-1] - start, end - marks[-1], end - start, time.perf_counter() - wall)


def load() -> float | None:
    """Return the load average of the last minute, or None if the system does not report it."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
