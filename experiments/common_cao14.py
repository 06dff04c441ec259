"""The two examples of Cao et al. 2014, rebuilt with data of our own: curves, steps of the method, table.

The source prints no control points. These curves are of the same kind and size (millimeters, 90 control points).
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from common import markdown, plain
from common_curves import directed_reference

import jhd

# Each curve: mean radius (mm), stretch in x, waves (number, fraction of the radius, phase), offset and turn.
_RINGS = {
    "example_1_b": (110.0, 1.25, ((2, 0.10, 0.3), (3, 0.22, 1.1), (5, 0.12, 2.0), (8, 0.05, 0.5)), (0.0, 0.0), 0.0),
    "example_2_a": (105.0, 1.20, ((2, 0.20, 1.3), (3, 0.14, 2.9), (4, 0.10, 0.2), (7, 0.06, 1.0)), (15.0, 5.0), 0.4),
    "example_2_b": (100.0, 1.25, ((2, 0.12, 0.2), (3, 0.25, 1.0), (5, 0.12, 2.2), (9, 0.04, 0.5)), (0.0, 0.0), 0.0),
}
_OPEN = ((-70, -70), (-60, 150), (0, 170), (40, -60), (120, -200), (400, -200), (110, 60))


def ring(name: str, count: int) -> jhd.BSplineCurve:
    """Return a closed uniform cubic B-spline with this many control points."""
    radius, stretch, waves, offset, turn = _RINGS[name]
    angle = 2 * np.pi * np.arange(count) / count
    r = radius * (1 + sum(share * np.cos(number * angle + phase) for number, share, phase in waves))
    x, y = stretch * r * np.cos(angle), r * np.sin(angle)
    c, s = np.cos(turn), np.sin(turn)
    return jhd.BSplineCurve.uniform(np.stack([c * x - s * y, s * x + c * y], axis=-1) + offset, periodic=True)


def open_curve() -> jhd.BezierCurve:
    """Return an open Bezier curve of degree six that starts inside the closed curve and leaves it."""
    return jhd.BezierCurve(_OPEN)


class Example:
    """Curves a and b, sampled and solved step by step.

    Both curves are padded to one number of segments, by repeating the last one. So both directions and every
    interval run one compiled function; the point sets are unchanged.

    Args:
            a: the sampled curve.
            b: the other curve.
            samples: steps in each segment of a.
            method: method of the exact distances.
    """

    def __init__(self, a: jhd.BezierSegments, b: jhd.BezierSegments, samples: int, method: jhd.published.TwoStep):
        self.a, self.b, self.method = a, b, method
        self.count = max(a.count, b.count)
        self.closed = bool(np.all(np.asarray(a.next_segment) >= 0))
        self.t = np.arange(a.count * samples + (not self.closed)) / samples
        self.points = np.asarray(_at(a, self.t))
        self.stationary = jhd.stationary_points(self.points, b)
        # The nearest stationary point would not do: a foot may be a corner or an end.
        nearest = jhd.project(self.points, b)
        self.distance, self.feet = np.asarray(nearest.distance), np.asarray(nearest.foot)

    def directed(self, a: jhd.BezierSegments, b: jhd.BezierSegments) -> jhd.HausdorffSolution:
        """Return the directed distance of padded curves."""
        return jhd.directed_hausdorff(a.pad(self.count), b.pad(self.count), self.method)

    def peaks(self) -> np.ndarray:
        """Find samples not below their neighbors ("small-large-small"), largest first; ends of a are no peaks."""
        d = self.distance
        left, right = np.roll(d, 1), np.roll(d, -1)
        inner = np.ones(len(d), bool)
        inner[[0, -1]] = self.closed
        found = np.flatnonzero((d > left) & (d >= right) & inner)
        return found[np.argsort(-d[found])]

    def candidate(self, k: int) -> dict[str, Any]:
        """Describe the peak at sample k: the sample, its neighbors, and the maximum between them."""
        around = [(k - 1) % len(self.t), k, (k + 1) % len(self.t)]
        solution = self.directed(self._stretch(around), self.b)
        steps = float(solution.witness.element + solution.witness.t)
        t = (self.t[around[0]] + steps * (self.t[1] - self.t[0])) % (self.a.count if self.closed else np.inf)
        return {
            "sample": k + 1,
            "around": [j + 1 for j in around],
            "distance": self.distance[k],
            "t": t,
            "solution": solution,
        }

    def _stretch(self, around: list[int]) -> jhd.BezierSegments:
        """Return the part of a from the first to the last of three consecutive samples."""
        step = self.t[1] - self.t[0]
        parts = []
        for start in self.t[around[:2]]:
            k = int(start)
            piece = jhd.BezierSegments(self.a.control_points[k : k + 1])
            parts.append(piece.restrict(start - k, min(start - k + step, 1.0)))
        return jhd.BezierSegments.join(parts)

    def record(self, shown: int, candidates: int, unit: str = "mm") -> dict[str, Any]:
        """Collect all numbers: samples, stationary points of sample `shown`, candidates and both directed distances.

        Samples are numbered from one, as in the source.
        """
        shown = min(shown, len(self.t))
        valid = np.asarray(self.stationary.valid)[shown - 1]
        places = (np.asarray(x)[shown - 1][valid] for x in (self.stationary.segment, self.stationary.t))
        stationary = np.asarray(self.b.point(*places))
        return {
            "unit": unit,
            "a": self.a.control_points,
            "b": self.b.control_points,
            "samples": {"t": self.t, "points": self.points, "feet": self.feet, "distance": self.distance},
            "stationary": {
                "sample": shown,
                "points": stationary,
                "distance": np.asarray(self.stationary.distance)[shown - 1][valid],
            },
            "candidates": [self.candidate(int(k)) for k in self.peaks()[:candidates]],
            "directions": {
                "a_to_b": checked(self.directed(self.a, self.b), self.a, self.b),
                "b_to_a": checked(self.directed(self.b, self.a), self.b, self.a),
            },
        }


def _at(curve: jhd.BezierSegments, t: np.ndarray) -> jax.Array:
    """Return the points at global parameters."""
    return curve(jnp.asarray(t))


def checked(solution: jhd.HausdorffSolution, a: jhd.BezierSegments, b: jhd.BezierSegments) -> dict[str, Any]:
    """Return a solution with its reference value, and its error in units of the coordinates and of the pair's size."""
    points = [np.asarray(curve.control_points) for curve in (a, b)]
    both = np.concatenate([p.reshape(-1, 2) for p in points])
    size = float(np.linalg.norm(both.max(axis=0) - both.min(axis=0)))
    value, t = directed_reference(*points)
    error = abs(float(solution.value) - value)
    found = {"solution": solution, "t": solution.witness.element + solution.witness.t}
    return {**found, "reference": value, "reference_t": t, "error": error, "relative_error": error / size}


def table(record: dict[str, Any]) -> str:
    """Format both directed distances and the candidates, lengths to 1e-10."""
    record = plain(record)
    unit = f" ({record['unit']})" if record["unit"] else ""
    rows = [
        [name, *_row(entry), f"{entry['error']:.1e}"]
        for name, entry in (("h(A,B)", record["directions"]["a_to_b"]), ("h(B,A)", record["directions"]["b_to_a"]))
    ]
    rows += [[f"sample {entry['sample']}", *_row(entry), ""] for entry in record["candidates"]]
    lengths = [f"{name}{unit}" for name in ("distance", "lower", "point", "feet", "error")]
    return markdown(["", *lengths[:2], "event", "t", *lengths[2:]], rows)


def _row(entry: dict[str, Any]) -> list[str]:
    solution = entry["solution"]
    witness = solution["witness"]
    feet = [f"({x:.6f}, {y:.6f})" for x, y in witness["feet"]]
    distinct = feet[:1] if feet[0] == feet[1] else feet
    x, y = witness["point"]
    event = witness["event"].replace("_", " ")
    lengths = [f"{solution[key]:.10f}" for key in ("value", "lower")]
    return [*lengths, event, f"{entry['t']:.10f}", f"({x:.6f}, {y:.6f})", " ".join(distinct)]
