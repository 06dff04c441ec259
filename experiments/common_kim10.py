"""Pairs of cubic B-splines, one for each way in which a Hausdorff distance arises, at any number of control points.

Kim et al. 2010 show pairs of 5, 10, 15 and 30 control points. Their distance arises at an end, at a self-bisector, or
between inner points. The paper prints no control points; these pairs are of the same kinds. All curves are clamped,
with uniform knots.

The second curve is a wave or an oval. The first one follows it except for one feature that outweighs everything else:

 - `end`: its last part leaves the wave, so that its end is farthest from the wave;
 - `foot_at_end`: it goes on beyond the end of the wave and turns back, so that the tip is farthest from that end;
 - `antipodal`: it has one bump, whose top is farthest;
 - `self_bisector`: it crosses the oval like the letter Z, from one side to the other: half way between the sides, two
   feet are equally near. The oval is wide enough that the crossing is farther from it than anything else.

Ripples of one control point, without a pattern, keep both curves from being smooth or parallel anywhere; there is no
seed.
"""

import numpy as np

import jhd

# The kinds, each with the event of the directed distance from a to b and of the Hausdorff distance.
EVENTS = {
    "end": "a_end",
    "foot_at_end": "b_end",
    "antipodal": "antipodal",
    "self_bisector": "one_to_two",
}
KINDS = tuple(EVENTS)
COUNTS = (5, 10, 15, 30, 120)
# Length of the wave; ripple height as a fraction of the control point spacing, and its upper limit.
_LENGTH, _RIPPLE, _LARGEST = 10.0, 0.2, 0.06


def pair(kind: str, count: int) -> tuple[jhd.BSplineCurve, jhd.BSplineCurve]:
    """Return both curves, with `count` control points each; the directed distance from the first is the larger one.

    Args:
        kind: one of `KINDS`.
        count: number of control points, at least 5.
    """
    if kind not in EVENTS:
        raise ValueError(f"kind is {kind!r}; needs one of {', '.join(KINDS)}.")
    if count < 5:
        raise ValueError(f"count is {count}; needs at least 5.")
    u = np.linspace(0.0, 1.0, count)
    a, b = _crossing(u) if kind == "self_bisector" else _following(kind, u)
    size = min(_RIPPLE * _LENGTH / (count - 1), _LARGEST)
    first, second = (jhd.BSplineCurve.clamped(x + size * _scattered(count, k)) for k, x in enumerate((a, b)))
    return first, second


def _following(kind: str, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the wave with a feature, and the wave."""
    wave = np.stack([_LENGTH * u, 0.8 * np.sin(9 * u)], axis=1)
    if kind == "end":
        size, way = np.clip((u - 0.7) / 0.3, 0, 1) ** 2, (-1.0, 3.0)
        return wave + size[:, None] * way, wave
    if kind == "antipodal":
        return wave + np.exp(-(((u - 0.5) / 0.1) ** 2))[:, None] * (0.0, -3.0), wave
    angle = np.pi * np.clip((u - 0.6) / 0.4, 0, 1)
    return wave + np.stack([8 * np.sin(angle), 0.5 * (1 - np.cos(angle))], axis=1), wave


def _crossing(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the letter Z and an oval around it, open at the bottom."""
    corners = np.array([(2.4, 1.6), (-2.4, 4.0), (0.0, 0.0), (2.4, -4.0), (-2.4, -1.6)])
    z = np.stack([np.interp(u, np.linspace(0, 1, 5), x) for x in corners.T], axis=1)
    angle = np.pi * (1.95 * u - 0.475)
    return z, np.stack([2.6 * np.cos(angle), 3.8 * np.sin(angle)], axis=1)


def _scattered(count: int, which: int) -> np.ndarray:
    """Return numbers in [-1, 1] without a pattern, (count, 2): fractions of multiples of irrational numbers."""
    k = np.arange(1, count + 1)[:, None] + 1000 * which
    return 2 * np.modf(k * np.array([0.7548776662, 0.5698402910]) * np.sqrt(5))[0] - 1
