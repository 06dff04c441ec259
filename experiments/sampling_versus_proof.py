"""How much do samples and polylines cost for a given error, compared with a distance certified to 1e-10?

Four pairs: two closed cubic B-splines of 90 control points; two single cubics; a parabola with and without a curved bar
between its arms, whose distance is sqrt(7)/2 exactly, at a point of the bar with two feet; the letter a in two fonts.
For each pair the two-sided Hausdorff distance is computed by

- SciPy's k-d tree, both curves sampled at equal steps of the parameter, 4 to 6400 a segment;
- shapely's `hausdorff_distance` of the polylines through such samples, plain and with densify=0.25. It takes the exact
  distances from the vertices of each line (with densify also from three points on every edge) to the other line. It
  misses maxima between these points. It also ignores the gap between a curve and its chords, which densify does not
  reduce;
- `jhd.hausdorff` within jax.jit, with the search compiled into the function (`jhd.inline_searches`), at tolerances
  from 1e-2 to 1e-12 of the diagonal.

Errors are measured against the bounds certified at the last tolerance. The unit of errors and gaps is the diagonal of
the box of both curves. Samples and lines are made beforehand and not timed. All run in one process on one core; times
are medians, warm.

Claims: one direction of the closed curves, certified to 1e-10 of the diagonal, takes less than 3 ms within jax.jit. It
is at least 250 times faster than the k-d tree with 400 samples a segment. The error of the tree is then 1e-9 of the
diagonal in one direction, with an antipodal maximum, and 1e-6 in the other, with a one-to-two maximum. No sampling
method gets below 1e-10 on any pair; its error falls unsteadily, depending on the maximum's position between samples. On
a pair of single segments, samples are faster than the proof if 1e-5 is enough.

Feeds: figure and tables "sampling versus proof".
Takes: 3 minutes, 2 once compiled.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from common import Run, markdown, seconds
from common_cao14 import ring
from common_curves import sample, sampled_directed

import jhd
import jhd.io

# Tolerances, as fractions of the diagonal; the last one gives the reference.
_TOLERANCES = (1e-2, 1e-6, 1e-10, 1e-12)
_CHOSEN = 1e-10
_COUNTS = (4, 10, 25, 100, 400, 1600, 6400)
# The number of samples a segment in the claim.
_BESIDE = 400
# Largest number of points for the tree, and of pairs of points and edges for shapely, which compares all.
_MOST_POINTS, _MOST_PAIRS = 80_000, 1e8
_DENSIFY = 0.25
# A call is repeated for about this many seconds, within limits; in a smoke run, as few times as possible.
_SECONDS, _REPEATS = 0.4, (3, 51)
_ROUNDS = 5

_directed = jax.jit(lambda a, b, method: jhd.directed_hausdorff(a, b, method))


class Pair(NamedTuple):
    """Two curves, their distance if it is known, and the diagonal of the box of both."""

    a: jhd.BezierSegments
    b: jhd.BezierSegments
    known: float | None = None

    @property
    def diagonal(self) -> float:
        """Return the diagonal of the box of all control points."""
        rows = np.concatenate([np.asarray(c.control_points).reshape(-1, 2) for c in (self.a, self.b)])
        return float(np.linalg.norm(np.ptp(rows, axis=0)))

    def method(self, tolerance: float) -> jhd.BranchAndBound:
        """Return our method, with a tolerance in diagonals."""
        return jhd.BranchAndBound(atol=jnp.asarray(tolerance * self.diagonal))


@jhd.inline_searches()
def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, one_core=True)
    names = ("parabola",) if run.smoke else tuple(_PAIRS)
    counts, budget = (_COUNTS[:3], 0.0) if run.smoke else (_COUNTS, _SECONDS)
    two_sided = jax.jit(lambda a, b, method: jhd.hausdorff(a, b, method), compiler_options=run.options)
    pairs = {name: _measured(_PAIRS[name](), two_sided, counts, budget) for name in names}
    # One direction needs a compiled function of its own.
    directed = None if run.smoke else _one_direction(_PAIRS["splines"]())
    tables = [_table(pairs)] if directed is None else [_table(pairs), _directed_table(directed)]
    run.save({"chosen": _CHOSEN, "pairs": pairs, "directed": directed}, "\n\n".join(tables))


def _splines() -> Pair:
    a, b = (ring(name, 90).segments() for name in ("example_2_a", "example_2_b"))
    return Pair(a, b)


def _cubics() -> Pair:
    a = jhd.BezierCurve([(0.0, 0.0), (1.0, 3.0), (2.5, 2.0), (3.0, 0.0)])
    b = jhd.BezierCurve([(0.0, 0.0), (0.5, -1.0), (2.0, 1.0), (3.0, 0.0)])
    return Pair(a.segments(), b.segments())


def _parabola() -> Pair:
    """Return the pair: the bar is y = 2 + x/2 - x^2/4; the feet of (0, 2) on y = x^2 are at x^2 = 3/2."""
    parabola = jhd.BezierCurve([(-2.0, 4.0), (0.0, -4.0), (2.0, 4.0)])
    bar = jhd.BezierCurve([(-0.5, 1.6875), (0.125, 2.15625), (0.75, 2.234375)])
    return Pair(jhd.BezierSegments.join([parabola, bar]), parabola.segments(), np.sqrt(7) / 2)


def _letters() -> Pair:
    return Pair(jhd.io.load_glyph("DejaVu Sans", "a"), jhd.io.load_glyph("DejaVu Serif", "a"))


_PAIRS: dict[str, Callable[[], Pair]] = {
    "splines": _splines,
    "cubics": _cubics,
    "parabola": _parabola,
    "letters": _letters,
}


def _contours(curve: jhd.BezierSegments, count: int) -> list[np.ndarray]:
    """Return samples of every connected part, in order."""
    following = np.asarray(curve.next_segment)
    ends = np.flatnonzero(following != np.arange(curve.count) + 1) + 1
    points = np.asarray(curve.control_points)
    return [sample(points[i:j], count) for i, j in zip(np.concatenate([[0], ends[:-1]]), ends, strict=True)]


def _time(call: Callable[[], Any], budget: float) -> float:
    """Return the warm median time of a call, repeated for about this many seconds."""
    low, high = _REPEATS
    return seconds(call, int(np.clip(budget / seconds(call, 1), low, high)))


def _measured(pair: Pair, two_sided: Callable[..., Any], counts: tuple[int, ...], budget: float) -> dict[str, Any]:
    """Run all methods on one pair."""
    ours = []
    for tolerance in _TOLERANCES:
        method = pair.method(tolerance)
        found = two_sided(pair.a, pair.b, method)
        took = _time(lambda method=method: two_sided(pair.a, pair.b, method), budget)
        ours.append({"method": "jhd", "tolerance": tolerance, "seconds": took, "solution": found})
    last = ours[-1]["solution"]
    exact, diagonal = 0.5 * float(last.lower + last.upper), pair.diagonal
    chosen = next(entry["seconds"] for entry in ours if entry["tolerance"] == _CHOSEN)
    for entry in ours:
        found = entry["solution"]
        entry.update(error=abs(float(found.value) - exact) / diagonal, gap=float(found.upper - found.lower) / diagonal)
    peers = [_against(entry, exact, diagonal) for count in counts for entry in _sampled(pair, count, budget)]
    return {
        "segments": [pair.a.count, pair.b.count],
        "diagonal": diagonal,
        "known": pair.known,
        "entries": [{**entry, "ratio": entry["seconds"] / chosen} for entry in [*ours, *peers]],
    }


def _sampled(pair: Pair, count: int, budget: float) -> list[dict[str, Any]]:
    """Run the peers with `count` samples a segment, if their limits allow it."""
    contours = [_contours(curve, count) for curve in (pair.a, pair.b)]
    a, b = (np.concatenate(rows) for rows in contours)
    x, y = (shapely.MultiLineString(rows) for rows in contours)
    calls: dict[str, tuple[bool, Callable[[], float]]] = {
        "k-d tree": (len(a) + len(b) <= _MOST_POINTS, lambda: max(sampled_directed(a, b), sampled_directed(b, a))),
        "shapely": (len(a) * len(b) <= _MOST_PAIRS, lambda: shapely.hausdorff_distance(x, y)),
        "shapely, densify": (
            len(a) * len(b) / _DENSIFY <= _MOST_PAIRS,
            lambda: shapely.hausdorff_distance(x, y, densify=_DENSIFY),
        ),
    }
    return [
        {"method": name, "samples": count, "seconds": _time(call, budget), "value": float(call())}
        for name, (affordable, call) in calls.items()
        if affordable
    ]


def _against(entry: dict[str, Any], exact: float, diagonal: float) -> dict[str, Any]:
    return {**entry, "error": abs(entry["value"] - exact) / diagonal}


def _one_direction(pair: Pair) -> list[dict[str, Any]]:
    """Compute h(A,B) within one compiled function, as a plain call, and by the claim's tree; errors of h(B,A) too."""
    method, tight = pair.method(_CHOSEN), pair.method(_TOLERANCES[-1])
    samples = tuple(np.concatenate(_contours(curve, _BESIDE)) for curve in (pair.a, pair.b))
    peers: dict[str, tuple[Callable[..., Any], tuple]] = {
        "jhd within jax.jit": (lambda a, b: _directed(a, b, method), pair[:2]),
        "jhd, plain call": (lambda a, b: jhd.directed_hausdorff(a, b, method), pair[:2]),
        f"k-d tree, {_BESIDE} samples a segment": (sampled_directed, samples),
    }
    exact = [float(_directed(*curves, tight).value) for curves in (pair[:2], pair[1::-1])]
    # In turns, so that other work on the machine slows all of them equally.
    rounds = [[_time(lambda f=f, x=x: f(*x), _SECONDS) for f, x in peers.values()] for _ in range(_ROUNDS)]
    times = np.median(rounds, axis=0)
    return [
        {
            "method": name,
            "seconds": time,
            "best": best,
            "ratio": time / times[0],
            "errors": [
                abs(float(f(*x)) - value) / pair.diagonal
                for x, value in zip((curves, curves[::-1]), exact, strict=True)
            ],
        }
        for (name, (f, curves)), time, best in zip(peers.items(), times, np.min(rounds, axis=0), strict=True)
    ]


def _table(pairs: dict[str, Any]) -> str:
    header = ["pair", "method", "samples a segment or tolerance", "time (ms)", "ratio to jhd at 1e-10", "error", "gap"]
    rows = [
        [
            name,
            entry["method"],
            entry["samples"] if "samples" in entry else f"{entry['tolerance']:.0e}",
            f"{1e3 * entry['seconds']:.3g}",
            f"{entry['ratio']:.3g}",
            f"{entry['error']:.1e}",
            f"{entry['gap']:.1e}" if "gap" in entry else "",
        ]
        for name, pair in pairs.items()
        for entry in pair["entries"]
    ]
    return markdown(header, rows)


def _directed_table(entries: list[dict[str, Any]]) -> str:
    header = ["one direction, splines", "time (ms)", "best", "ratio", "error of h(A,B)", "of h(B,A)"]
    rows = [
        [e["method"], *(f"{1e3 * e[key]:.3g}" for key in ("seconds", "best")), f"{e['ratio']:.3g}", *errors]
        for e in entries
        for errors in [[f"{x:.1e}" for x in e["errors"]]]
    ]
    return markdown(header, rows)


if __name__ == "__main__":
    main()
