"""Curves to path data, the language of the attribute `d` of SVG.

Polynomial segments of degree 1 to 3 keep their numbers. A rational quadratic whose middle weight is below the geometric
mean of the others is an arc of an ellipse. It is written as an arc (A) if the arc that is read back from the numbers is
proven to be close enough. A rational cubic that is such a quadratic in a higher degree is treated equally. Everything
else is drawn by cubics within a tolerance.

The proof for arcs compares rational segments of one degree, c with points P_i and weights w_i, and c' with P'_i, w'_i.
As sum B_i w_i (P_i - c) = 0, c' - c = sum B_i (w'_i (P'_i - P_i) + (w'_i - w_i) (P_i - c)) / sum B_i w'_i, and so |c' -
c| <= max |P'_i - P_i| + max |w'_i - w_i| / w'_i * max |P_i - P_j|. Rounding of the control points that are compared is
below 64 ulp of the largest coordinate. Halving and lowering the degree are combinations of at most four numbers with
factors that add up to one or to two, and weights enter with a few ulp of the size of the segment.

Source: SVG 1.1, section 8.3; Piegl & Tiller, The NURBS Book (1997), section 7.3; Farin, Curves and Surfaces for CAGD
(2002), section 13.2, for standard form and halves of rational quadratics.
"""

import math
from collections.abc import Iterator

import numpy as np

from jhd._arithmetic.bernstein import product_weights
from jhd._io.contours import Contour, Segment
from jhd._io.outward import cubic_contours
from jhd._io.path_text import draw_arc
from jhd._shapes.curve import BezierSegments

_LETTERS = {1: "L", 2: "Q", 3: "C"}
_ULPS = 64 * 2.0**-52
# Half axes and angles are written in as few digits as the tolerance allows.
_DIGITS = (6, 9, 12, 15, 17)


def path_words(contours: list[Contour], tolerance: float | None) -> str:
    """Path data of the contours.

    Args:
        contours: polynomial and rational segments of any degree above 0.
        tolerance: largest distance of the text from the curve; None for exact segments, and arcs up to rounding.

    Raises:
        ValueError: tolerance is None and a segment is neither exact nor an arc.
    """
    largest = max((abs(p) for contour in contours for part in contour.segments for p in part.points), default=0.0)
    words = []
    for contour in contours:
        words.append("M" + pair(contour.start))
        for segment in contour.segments:
            words += _segment_words(segment, largest, tolerance)
        words += ["Z"] if contour.closed else []
    return " ".join(words)


def _segment_words(segment: Segment, largest: float, tolerance: float | None) -> list[str]:
    points, weights = segment
    degree = len(points) - 1
    polynomial = weights is None or len(set(weights)) == 1
    if degree == 1 or (polynomial and degree in _LETTERS):
        return [_LETTERS[degree] + " ".join(map(pair, points[1:]))]
    if weights is not None:
        # Arcs are exact up to rounding if no tolerance is given: this fraction of the largest coordinate.
        arcs = _arcs(points, weights, 1e-12 * largest if tolerance is None else tolerance)
        if arcs is not None:
            return arcs
    rows = np.array([[(p.real, p.imag) for p in points]])
    heavy = None if polynomial else np.array([weights])
    return [
        "C" + " ".join(map(pair, part.points[1:]))
        for contour in cubic_contours("the curve", BezierSegments(rows, heavy, [-1]), tolerance)
        for part in contour.segments
    ]


def pair(point: complex) -> str:
    """The two coordinates with all their digits."""
    return f"{point.real!r},{point.imag!r}"


def _arcs(points: tuple[complex, ...], weights: tuple[float, ...], tolerance: float) -> list[str] | None:
    """The segment as arcs of at most a quarter turn within tolerance; None if it is no arc."""
    p, w, off = np.array(points), np.array(weights) / max(weights), 0.0
    largest = float(np.abs(p).max())
    if len(p) == 4:
        p, w, off = _lowered(p, w)
    room = _ULPS * max(largest, float(np.abs(p).max()))
    if len(p) != 3 or off + room > 0.5 * tolerance or w[1] ** 2 >= w[0] * w[2]:
        return None
    words, left = [], tolerance - off - room
    for corner, end, weight, start in _quarters(p, float(w[1] / math.sqrt(w[0] * w[2]))):
        word = _arc(start, corner, end, weight, left)
        if word is None:
            return None
        words.append(word)
    return words


def _lowered(p: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """A cubic as a quadratic, and a bound of its deviation; the cubic itself if a weight would not be positive."""
    weight = 0.25 * (3 * w[1] - w[0] + 3 * w[2] - w[3])
    if weight <= 0:
        return p, w, 0.0
    middle = 0.25 * (3 * w[1] * p[1] - w[0] * p[0] + 3 * w[2] * p[2] - w[3] * p[3]) / weight
    q, v = np.array([p[0], middle, p[3]]), np.array([w[0], weight, w[3]])
    shares = product_weights(1, 2)
    raised = [sum(shares[i, k - i] * v[k - i] for i in (0, 1) if 0 <= k - i < 3) for k in range(4)]
    moved = [sum(shares[i, k - i] * v[k - i] * q[k - i] for i in (0, 1) if 0 <= k - i < 3) for k in range(4)]
    return q, v, _apart(p, w, np.array(moved) / np.array(raised), np.array(raised))


def _apart(p: np.ndarray, w: np.ndarray, other: np.ndarray, weights: np.ndarray) -> float:
    """Bound of the distance of two rational segments at equal parameters, without rounding of control points."""
    size = float(np.abs(p[:, None] - p).max())
    share = float((np.abs(weights - w) / weights).max()) + _ULPS
    return (float(np.abs(other - p).max()) + share * size) * (1 + 1e-12)


def _quarters(p: np.ndarray, weight: float) -> Iterator[tuple[complex, complex, float, complex]]:
    """Corner, end, weight and start of the arc, or of both halves if it turns by more than a quarter."""
    start, corner, end = (complex(x) for x in p)
    if weight >= math.sqrt(0.5) * (1 - 1e-15):
        yield corner, end, weight, start
        return
    first, second = (start + weight * corner) / (1 + weight), (end + weight * corner) / (1 + weight)
    middle, half = 0.5 * (first + second), math.sqrt(0.5 * (1 + weight))
    yield first, middle, half, start
    yield second, end, half, middle


def _arc(start: complex, corner: complex, end: complex, weight: float, tolerance: float) -> str | None:
    """The command A whose arc, as it is read, is within tolerance of the segment; None if there is none."""
    axes = _ellipse(start, corner, end, weight)
    if axes is None:
        return None
    v, side = end - start, corner - start
    sweep = v.real * side.imag - v.imag * side.real < 0
    candidates = [axes]
    # Half axes that differ by less are tried as a circle.
    if axes[0] - axes[1] <= 1e-6 * axes[0]:
        radius = 0.5 * (axes[0] + axes[1])
        candidates.insert(0, (radius, radius, 0.0))
    for digits in _DIGITS:
        for candidate in candidates:
            rx, ry, angle = (float(f"{x:.{digits}g}") for x in candidate)
            drawn = Contour(start)
            draw_arc(drawn, (rx, ry), angle, False, sweep, end)
            if len(drawn.segments) != 1 or drawn.segments[0].weights is None:
                continue
            read = drawn.segments[0]
            weights = np.array([1.0, weight, 1.0])
            if (
                _apart(np.array([start, corner, end]), weights, np.array(read.points), np.array(read.weights))
                <= tolerance
            ):
                return f"A{_short(rx)} {_short(ry)} {_short(angle)} 0 {int(sweep)} {pair(end)}"
    return None


def _short(x: float) -> str:
    return repr(int(x)) if x == int(x) and abs(x) < 1e15 else repr(x)


def _ellipse(start: complex, corner: complex, end: complex, weight: float) -> tuple[float, float, float] | None:
    """Half axes, the larger one first, and the angle of the first in degrees; None for a flat one.

    With weight = cos(h) the segment is the image of an arc of the unit circle of half angle h, whose half chord is
    sin(h) and whose corner is sin(h)^2 / cos(h) above the chord. So (end - start) / 2 / sin(h) and
    (corner - middle) cos(h) / sin(h)^2 are conjugate half diameters, and half axes the singular values of both.
    """
    square = (1 - weight) * (1 + weight)
    if square <= 0:
        return None
    a = 0.5 * (end - start) / math.sqrt(square)
    b = (corner - 0.5 * (start + end)) * (weight / square)
    if not (math.isfinite(abs(a)) and math.isfinite(abs(b))):
        return None
    left, sizes, _ = np.linalg.svd(np.array([[a.real, b.real], [a.imag, b.imag]]))
    if not sizes[1] > 0:
        return None
    angle = math.degrees(math.atan2(left[1, 0], left[0, 0]))
    return float(sizes[0]), float(sizes[1]), angle % 180.0
