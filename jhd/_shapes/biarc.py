"""Biarcs: approximations of plane curves by circular arcs, each with a certified deviation from its piece of the curve.

An arc is stored as its ends and its bulge tan(sweep / 4), as in DXF files. A line is an arc of bulge zero, and nothing
here or downstream divides by a curvature.

Source: Sir, Feichtinger & Juttler, Approximating curves and their offsets using biarcs and Pythagorean hodograph
quintics, CAD 38 (2006), as used by Kim et al. 2010, section 2.2; the proof of the deviation is ours.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jhd._results.display import box_text, count_text, described, most_text, opaque
from jhd._results.solution import NotProvenError
from jhd._runtime.arrays import is_traced
from jhd._shapes.approximation import checked_tolerance
from jhd._shapes.as_shape import ShapeLike, taken_as
from jhd._shapes.biarc_fit import fitted
from jhd._shapes.checks import Numbers
from jhd._shapes.curve import BezierSegments, check_curve
from jhd._shapes.deviation import HostArcs, HostCurve, complex_points
from jhd._shapes.flattening import pieces_following


class BiarcCurve(eqx.Module):
    """Circular arcs and lines that approximate a plane curve, in the order of the curve; made by `biarcs`.

    Args:
        start: (arcs, 2) start points, in the unit of the coordinates.
        end: (arcs, 2) end points. The next arc of the same segment starts at exactly these numbers.
        bulge: (arcs,) values of tan(sweep / 4), from -1/2 to 1/2: positive to the left (counter-clockwise), zero for a
            line.
        segment: (arcs,) indices of the segments of the curve that the arcs approximate.
        t0: (arcs,) local parameters, from 0 to 1, at which the pieces start.
        t1: (arcs,) local parameters, from 0 to 1, at which the pieces end.
        deviation: (arcs,) certified bounds of the Hausdorff distance between each arc and its piece, in both
            directions.
        next_segment: (arcs,) for each arc the index of the arc that starts at its end, -1 at a free end.
    """

    start: Float[Array, "arcs dim"]
    end: Float[Array, "arcs dim"]
    bulge: Float[Array, " arcs"]
    segment: Int[Array, " arcs"]
    t0: Float[Array, " arcs"]
    t1: Float[Array, " arcs"]
    deviation: Float[Array, " arcs"]
    next_segment: Int[Array, " arcs"]

    def __repr__(self) -> str:
        if text := opaque(self):
            return text
        most = most_text("deviation at most", self.deviation)
        return described(self, count_text(self.count, "arc"), most, box_text(self.start, "ends in"))

    @property
    def count(self) -> int:
        """Number of arcs."""
        return self.bulge.shape[-1]

    @property
    def sweep(self) -> Float[Array, " arcs"]:
        """Signed angle in radians by which the direction turns along each arc: 4 atan(bulge)."""
        return 4 * jnp.arctan(self.bulge)

    @property
    def curvature(self) -> Float[Array, " arcs"]:
        """Signed curvature 4 bulge / (chord (1 + bulge^2)), positive to the left; zero for lines and points."""
        _, b, _, _, length = self._parts()
        return jnp.asarray(4 * b / (length * (1 + b * b)))[..., 0]

    @property
    def radius(self) -> Float[Array, " arcs"]:
        """Radius of each arc; infinite for lines and points."""
        xp, b, _, _, length = self._parts()
        radius = length * (1 + b * b) / (4 * xp.abs(xp.where(b == 0, 1.0, b)))
        return jnp.asarray(xp.where(b == 0, xp.inf, radius))[..., 0]

    @property
    def center(self) -> Float[Array, "arcs dim"]:
        """Center of each arc; infinite for lines and points."""
        xp, b, middle, chord, _ = self._parts()
        some = xp.where(b == 0, 1.0, b)
        center = middle + _left(xp, chord) * ((1 - some) * (1 + some) / (4 * some))
        return jnp.asarray(xp.where(b == 0, xp.inf, center))

    @property
    def tangents(self) -> Float[Array, "arcs 2 dim"]:
        """Unit tangents at the start and the end of each arc; zero for points.

        They are the chord turned by half the sweep to either side.
        """
        xp, b, _, chord, length = self._parts()
        along, across = chord / length * ((1 - b) * (1 + b)), _left(xp, chord) / length * (2 * b)
        return jnp.asarray(xp.stack([along - across, along + across], axis=-2) / (1 + b * b)[..., None])

    def segments(self) -> BezierSegments:
        """The arcs as rational quadratic segments with weights 1, cos(sweep / 2), 1; exact except for rounding."""
        xp, b, middle, chord, _ = self._parts()
        apex = middle - _left(xp, chord) * (b / ((1 - b) * (1 + b)))
        cosine = (1 - b) * (1 + b) / (1 + b * b)
        weights = xp.concatenate([xp.ones_like(b), cosine, xp.ones_like(b)], axis=-1)
        rows = xp.stack([xp.asarray(self.start), apex, xp.asarray(self.end)], axis=-2)
        return BezierSegments(rows, weights, self.next_segment)

    def _parts(self) -> tuple[Any, Any, Any, Any, Any]:
        """The array module, and bulge, middle of the chord, chord, and length of the chord (one if it is zero).

        The module is NumPy for concrete arcs: JAX would compile each operation for each number of arcs.
        """
        xp = jnp if is_traced(self) else np
        start, end, b = xp.asarray(self.start), xp.asarray(self.end), xp.asarray(self.bulge)[..., None]
        chord = end - start
        length = xp.hypot(chord[..., :1], chord[..., 1:])
        return xp, b, 0.5 * start + 0.5 * end, chord, xp.where(length > 0, length, 1.0)


def _left(xp: Any, x: Any) -> Any:
    """Vectors turned by a right angle to the left."""
    return xp.stack([-x[..., 1], x[..., 0]], axis=-1)


def biarcs(curve: ShapeLike, tolerance: Numbers) -> BiarcCurve:
    """Circular arcs that approximate a plane curve, each within `tolerance` of its piece in both directions.

    The Hausdorff distance between the curve and all arcs together is at most the largest deviation. The number of arcs
    grows like tolerance^(-1/3). On smooth parts of the curve the arcs join smoothly; corners and cusps are kept. Two
    kinds of pieces become lines:

    - pieces that are straight up to rounding,
    - pieces smaller than tolerance / 16 that turn too far for a biarc.

    >>> import jhd
    >>> arcs = jhd.biarcs(jhd.circle([0, 0], 1), 1e-9)
    >>> arcs.count, bool(abs(arcs.radius - 1).max() < 1e-12)
    (8, True)

    Args:
        curve: a polynomial or rational curve in the plane, or an object that `jhd.as_shape` converts to one. Its
            control points must not be traced.
        tolerance: largest deviation allowed, a positive length in the unit of the coordinates.

    Returns:
        The arcs in the order of segments and parameters; together their intervals cover every segment.

    Raises:
        TypeError: not a curve, or a traced one; the number of arcs depends on its numbers.
        ValueError: a curve in space, or a `tolerance` that is not positive or smaller than rounding allows; the message
            says how small it may be.
        NotProvenError: the weights are so uneven that a piece cannot be halved any further. The error carries the arcs,
            whose deviations hold.
    """
    segments = _checked(curve)
    wanted = checked_tolerance(tolerance, segments, "biarcs needs a concrete curve", "arcs")
    host = HostCurve.of(segments)
    least = 0.0 if segments.degree <= 1 else host.least
    if wanted < least:
        raise ValueError(f"tolerance is {wanted:g}; needs at least {least:g} for these coordinates.")
    if segments.degree <= 1:
        return _assembled(segments, _lines(segments))
    found = _assembled(segments, fitted(host, wanted))
    reached = float(np.max(np.asarray(found.deviation)))
    if reached > wanted:
        why = "the weights are too uneven. Raise tolerance."
        message = f"The deviation stays at {reached:g}, above tolerance = {wanted:g}: {why}"
        raise NotProvenError(message, found)
    return found


def least_tolerance(curve: Any) -> float:
    """The smallest tolerance that `biarcs` accepts: four times the rounding error of a deviation; 0 for polylines.

    >>> from jhd._shapes.simple_curves import polyline
    >>> least_tolerance(polyline([[0, 0], [1, 2]]))
    0.0

    Args:
        curve: a curve in the plane, or an object that `jhd.as_shape` converts to one.

    Returns:
        A length in the unit of the coordinates.

    Raises:
        TypeError: not a curve, or a traced one.
        ValueError: a curve in space.
    """
    segments = _checked(curve)
    return 0.0 if segments.degree <= 1 else HostCurve.of(segments).least


def _checked(curve: Any) -> BezierSegments:
    curve = taken_as("curve", curve)
    check_curve("curve", curve)
    segments = curve.segments()
    if is_traced(segments):
        raise TypeError("biarcs needs concrete control points, not traced ones: the number of arcs depends on them.")
    if segments.dim != 2:
        raise ValueError(f"curve has {segments.dim} coordinates a point; biarcs needs 2.")
    return segments


def _lines(segments: BezierSegments) -> HostArcs:
    """Points and lines as arcs of bulge zero."""
    points, zeros = complex_points(np.asarray(segments.control_points, np.float64)), np.zeros(segments.count)
    return HostArcs(np.arange(segments.count), zeros, zeros + 1, points[:, 0], points[:, -1], zeros, zeros)


def _assembled(segments: BezierSegments, arcs: HostArcs) -> BiarcCurve:
    """The arcs, each linked to the next arc of the curve."""
    next_segment = pieces_following(arcs.segment, np.asarray(segments.next_segment))
    dtype = np.dtype(segments.control_points.dtype)
    start, end = (np.stack([np.real(x), np.imag(x)], axis=-1) for x in (arcs.start, arcs.end))
    numbers = [x.astype(dtype) for x in (start, end, arcs.bulge, arcs.t0, arcs.t1, arcs.deviation)]
    # All together: one transfer takes as long as eight.
    start, end, bulge, t0, t1, deviation, segment, next_segment = jax.device_put([*numbers, arcs.segment, next_segment])
    return BiarcCurve(start, end, bulge, segment, t0, t1, deviation, next_segment)
