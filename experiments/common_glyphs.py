"""Letters of fonts, curves padded to few sizes, and texts and step counts of decisions.

JAX compiles once for each number of segments. So all curves here have 48 segments, or the next number that the package
compiles for; padding repeats the last segment and leaves the point set unchanged.
"""

from typing import Any

import numpy as np

import jhd
import jhd.io
from jhd._distance.normalization.curves import padded_count
from jhd._results.solution import name_of

_SEGMENTS = 48


def padded(control_points: Any, next_segment: Any = None) -> jhd.BezierSegments:
    """Pad the segments (segments, points, 2) by repeating the last one; a chain if `next_segment` is None."""
    points = np.asarray(control_points, dtype=float)
    joints = np.append(np.arange(1, len(points)), -1) if next_segment is None else np.asarray(next_segment)
    index = np.minimum(np.arange(padded_count(max(len(points), _SEGMENTS))), len(points) - 1)
    return jhd.BezierSegments(points[index], None, joints[index])


def chain(points: Any) -> np.ndarray:
    """Return the control points (segments, 2, 2) of a polyline."""
    rows = np.asarray(points, dtype=float)
    return np.stack([rows[:-1], rows[1:]], axis=1)


def alphabet(font: str, letters: str) -> dict[str, jhd.BezierSegments]:
    """Load letters in units of the font's x-height (the top of its x), centered in x on their boxes, baseline y = 0.

    The boxes enclose the control points, and both steps round by an ulp: the curves are these arrays.
    """
    height = np.max(np.asarray(jhd.io.load_glyph(font, "x").control_points)[..., 1])
    found = {}
    for letter in letters:
        curve = jhd.io.load_glyph(font, letter)
        points = np.asarray(curve.control_points) / height
        middle = (points[..., 0].min() + points[..., 0].max()) / 2
        found[letter] = padded(points - [middle, 0.0], curve.next_segment)
    return found


def steps_of(found: jhd.HausdorffSolution | jhd.Decision) -> int:
    """Return the number of steps of both directions."""
    return int(found.stats["a_to_b_steps"] + found.stats["b_to_a_steps"])


def answer(decision: jhd.Decision) -> str:
    """Return the name of a decision: yes, no or undecided."""
    return name_of(decision.answer)
