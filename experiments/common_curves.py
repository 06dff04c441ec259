"""Plane curves in NumPy alone: samples, and a reference for distances that uses no code of the package.

A curve is an array of Bezier control points (segments, points, 2); its global parameter runs over [0, segments]. The
reference is no proof: it samples densely, polishes every foot and climbs to the top of every maximum in sight.
"""

from math import comb, sqrt

import numpy as np
from scipy.spatial import KDTree

# Samples of a segment in the search for feet, and of a whole curve in the search for maxima.
_FEET, _MAXIMA = 64, 40_000
# Number of sampled maxima to climb; the largest one wins by more than the error of the samples.
_CLIMBED = 6
# Golden sections leave 1e-16 of a bracket.
_SECTIONS = 78
_NEWTON = 12


def basis(degree: int, t: np.ndarray) -> np.ndarray:
    """Return the Bernstein polynomials in a new last axis."""
    i = np.arange(degree + 1)
    return np.array([comb(degree, k) for k in i]) * t[..., None] ** i * (1 - t[..., None]) ** (degree - i)


def evaluate(curve: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the points at global parameters of any shape."""
    t = np.asarray(t, dtype=float)
    segment = np.clip(np.floor(t).astype(int), 0, len(curve) - 1)
    return np.einsum("...i,...id->...d", basis(curve.shape[1] - 1, t - segment), curve[segment])


def sample(curve: np.ndarray, count: int) -> np.ndarray:
    """Return points at `count` equal steps of every segment, both ends of the curve included."""
    return evaluate(curve, np.linspace(0, len(curve), len(curve) * count + 1))


class Feet:
    """Distances of points to one curve, to about 1e-15 of its size."""

    def __init__(self, curve: np.ndarray):
        self.curve = curve
        self.degree = curve.shape[1] - 1
        self.s = np.linspace(0.0, 1.0, _FEET + 1)
        self.points = np.einsum("si,kid->ksd", basis(self.degree, self.s), curve)
        self.spacing = np.max(np.linalg.norm(np.diff(self.points, axis=1), axis=-1))

    def distance(self, point: np.ndarray) -> float:
        """Return the distance of one point; each local minimum of the samples that may matter is polished."""
        d = np.linalg.norm(self.points - point, axis=-1)
        wide = np.pad(d, ((0, 0), (1, 1)), constant_values=np.inf)
        low = (d <= wide[:, :-2]) & (d <= wide[:, 2:]) & (d <= d.min() + self.spacing)
        segment, index = np.nonzero(low)
        s = self._polish(point, self.curve[segment], self.s[index])
        # If Newton's method diverges, the sample itself counts.
        found = np.concatenate([self._lengths(point, self.curve[segment], s), d[low]])
        return float(found.min())

    def _lengths(self, point: np.ndarray, pieces: np.ndarray, s: np.ndarray) -> np.ndarray:
        return np.linalg.norm(np.einsum("ki,kid->kd", basis(self.degree, s), pieces - point), axis=-1)

    def _polish(self, point: np.ndarray, pieces: np.ndarray, s: np.ndarray) -> np.ndarray:
        n, offsets = self.degree, pieces - point
        first = n * np.diff(offsets, axis=1)
        second = (n - 1) * np.diff(first, axis=1) if n > 1 else np.zeros_like(first)
        for _ in range(_NEWTON):
            c = np.einsum("ki,kid->kd", basis(n, s), offsets)
            d = np.einsum("ki,kid->kd", basis(n - 1, s), first)
            e = np.einsum("ki,kid->kd", basis(max(n - 2, 0), s), second)
            slope = np.sum(d * d + c * e, axis=-1)
            s = np.clip(s - np.sum(c * d, axis=-1) / np.where(slope > 0, slope, np.inf), 0.0, 1.0)
        return s


def directed_reference(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    """Return the directed Hausdorff distance from a to b and its global parameter on a, to about 1e-14 of the size."""
    feet = Feet(b)
    t = np.linspace(0, len(a), len(a) * (_MAXIMA // len(a)) + 1)
    d = KDTree(sample(b, _MAXIMA // len(b))).query(evaluate(a, t))[0]
    wide = np.pad(d, 1, constant_values=-np.inf)
    tops = np.flatnonzero((d >= wide[:-2]) & (d >= wide[2:]))
    tops = tops[np.argsort(-d[tops])][:_CLIMBED]
    # Samples err by little, but a flat top can be off by more than one step.
    step = 3 * t[1]
    return max(_climb(a, feet, max(t[k] - step, 0.0), min(t[k] + step, t[-1])) for k in tops)


def _climb(a: np.ndarray, feet: Feet, low: float, high: float) -> tuple[float, float]:
    """Climb to a maximum, smooth or not, by golden sections."""
    golden = (sqrt(5) - 1) / 2

    def at(t: float) -> tuple[float, float]:
        return feet.distance(evaluate(a, np.array(t))), t

    best = max(at(low), at(high))
    left, right = at(high - golden * (high - low)), at(low + golden * (high - low))
    for _ in range(_SECTIONS):
        best = max(best, left, right)
        if left[0] >= right[0]:
            high, right = right[1], left
            left = at(high - golden * (high - low))
        else:
            low, left = left[1], right
            right = at(low + golden * (high - low))
    return best


def sampled_directed(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance from rows of a to the nearest row of b, by a k-d tree: the usual way without curves."""
    return float(KDTree(b).query(a)[0].max())
