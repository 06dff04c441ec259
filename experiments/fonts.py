"""How far apart are the letters of two fonts, and is the nearest letter of the other font certified to be its namesake?

All 26 x 26 two-sided Hausdorff distances between the lower-case outlines of DejaVu Sans (a sans serif of even strokes)
and STIX General (a Times: serifs, contrast, a g of two storeys). Each letter is scaled to the x-height of its font and
centered. Fonts of one design would find each other by their skeletons; these two have only the alphabet in common.

Then the nearest letters are searched without the matrix. Boxes give a first certified lower bound. For the remaining
letters, hausdorff_at_most decides if they are nearer than the best so far; only then their distance is computed. For
comparison, SciPy's k-d tree on samples of the outlines, in one process on one core, trees built once for each letter.

Claims: every distance has bounds closer than 1e-9 x-heights. Every nearest letter is certified to be one, or tied with
another one within that distance (i and l of STIX General reach equally far beyond those of DejaVu Sans). The search
finds the matrix's results with less than a tenth of its distances. Samples 0.002 x-heights apart take longer than the
proof, and err by up to 0.6 of this spacing.

Feeds: figure and tables "letters of two fonts".
Takes: 2 minutes, 1 once compiled.
"""

import string
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from common import Run, markdown
from common_curves import sample
from common_glyphs import alphabet, answer, steps_of
from scipy.spatial import KDTree

import jhd

FONTS = ("DejaVu Sans", "STIXGeneral")
# The curves of a search, by letter.
Letters = Mapping[str, jhd.BezierSegments]


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, one_core=True)
    # Without m and g of STIX, whose 49 segments would need compiled functions of their own.
    letters = "ailop" if run.smoke else string.ascii_lowercase
    first, second = (alphabet(font, letters) for font in FONTS)
    solutions, took = _timed(lambda: _matrix(first, second))
    matrix = _record(solutions, letters, took)
    searches = {"rows": _search(first, second), "columns": _search(second, first)}
    samples = [_sampled(first, second, spacing, matrix) for spacing in ((0.1,) if run.smoke else (0.1, 0.01, 0.002))]
    numbers = {
        "unit": "x-height",
        "fonts": FONTS,
        "letters": letters,
        "matrix": matrix,
        "searches": searches,
        "samples": samples,
        "pairs": _pairs(first, second, solutions, letters),
    }
    run.save(numbers, "\n\n".join([_matrix_table(numbers), _search_table(numbers), _misses_table(numbers)]))


def _timed(function: Callable[[], Any]) -> tuple[Any, float]:
    """Return the result of a call, and the least wall time of three later calls; the first call compiles."""
    found, times = function(), []
    for _ in range(3):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return found, min(times)


def _matrix(first: Letters, second: Letters) -> list[list[jhd.HausdorffSolution]]:
    return [[jhd.hausdorff(a, b) for b in second.values()] for a in first.values()]


def _record(solutions: list[list[jhd.HausdorffSolution]], letters: str, took: float) -> dict[str, Any]:
    """Collect values, bounds and work of all pairs, and the nearest letter of each row and column."""
    table = {
        key: np.array([[float(getattr(s, key)) for s in row] for row in solutions])
        for key in ("value", "lower", "upper")
    }
    steps = np.array([[steps_of(s) for s in row] for row in solutions])
    nearest = {
        "rows": [_ranked(letters, *bounds) for bounds in zip(table["lower"], table["upper"], strict=True)],
        "columns": [_ranked(letters, *bounds) for bounds in zip(table["lower"].T, table["upper"].T, strict=True)],
    }
    gap = float(np.max(table["upper"] - table["lower"]))
    return {**table, "steps": steps, "cells": 4 * steps.sum(), "gap": gap, "seconds": took, "nearest": nearest}


def _ranked(letters: str, lower: np.ndarray, upper: np.ndarray) -> dict[str, Any]:
    """Return the nearest letter, letters with overlapping bounds, and the certified ratio of the next distance."""
    best = int(np.argmin(upper))
    tied = [letters[k] for k in np.flatnonzero(lower <= upper[best]) if k != best]
    second = int(np.argsort(lower)[1 if lower[best] == lower.min() else 0])
    return {"nearest": letters[best], "tied": tied, "second": letters[second], "ratio": lower[second] / upper[best]}


class _Found(NamedTuple):
    """One search: the nearest letter, letters with overlapping bounds, and the pairs that took more than boxes."""

    nearest: str
    tied: list[str]
    distances: list[str]
    decisions: list[tuple[str, float]]


def _search(queries: Letters, others: Letters) -> dict[str, Any]:
    """Find the nearest letter of each query, with the counts of work; the steps are counted afterwards."""

    def find() -> dict[str, _Found]:
        boxes = {name: _Box.of(curve) for name, curve in others.items()}
        return {name: _nearest(curve, others, boxes) for name, curve in queries.items()}

    found, took = _timed(find)
    steps = 0
    for name, one in found.items():
        steps += sum(steps_of(jhd.hausdorff(queries[name], others[other])) for other in one.distances)
        steps += sum(
            steps_of(jhd.hausdorff_at_most(queries[name], others[other], limit)) for other, limit in one.decisions
        )
    return {
        "nearest": [one.nearest for one in found.values()],
        "tied": [one.tied for one in found.values()],
        "distances": sum(len(one.distances) for one in found.values()),
        "decisions": sum(len(one.decisions) for one in found.values()),
        "steps": steps,
        "seconds": took,
    }


def _nearest(curve: jhd.BezierSegments, others: Letters, boxes: Mapping[str, "_Box"]) -> _Found:
    """Return the nearest letter: boxes first, then decisions if boxes cannot tell, then distances of nearer letters."""
    mine = _Box.of(curve)
    lower = {name: mine.distance(box) for name, box in boxes.items()}
    first, *rest = sorted(others, key=lambda name: lower[name])
    best = jhd.hausdorff(curve, others[first])
    found = _Found(first, [], [first], [])
    for name in rest:
        limit = float(best.upper)
        if lower[name] > limit:
            break
        found.decisions.append((name, limit))
        if answer(jhd.hausdorff_at_most(curve, others[name], limit)) == "no":
            continue
        solution = jhd.hausdorff(curve, others[name])
        found.distances.append(name)
        # If the bounds of both overlap, neither is certified to be the nearer one.
        if solution.upper < best.lower:
            best, found = solution, found._replace(nearest=name, tied=[])
        elif solution.lower <= best.upper:
            found.tied.append(name)
    return found


class _Box(NamedTuple):
    """Corners (low, high) of two boxes, one inside and one around the box of a curve."""

    inner: np.ndarray
    outer: np.ndarray

    @staticmethod
    def of(curve: jhd.BezierSegments) -> "_Box":
        """Return both boxes: segment ends lie on the curve, control points around it; low corners are negated."""
        points = np.asarray(curve.control_points)
        signed = np.concatenate([-points, points], axis=-1)
        return _Box(signed[:, [0, -1]].max(axis=(0, 1)), signed.max(axis=(0, 1)))

    def distance(self, other: "_Box") -> float:
        """Return a certified lower bound of the Hausdorff distance: how far one curve leaves the other's box."""
        reach = max(np.max(self.inner - other.outer), np.max(other.inner - self.outer), 0.0)
        return float(np.nextafter(reach, -np.inf))


def _sampled(first: Letters, second: Letters, spacing: float, matrix: dict[str, Any]) -> dict[str, Any]:
    """Compute the matrix by k-d trees of samples this far apart: time, and errors against the certified distances."""
    rows = [[_samples(curve, spacing) for curve in letters.values()] for letters in (first, second)]

    def answers() -> np.ndarray:
        trees = [[KDTree(points) for points in letters] for letters in rows]
        pairs = ((p, q) for p in zip(rows[0], trees[0], strict=True) for q in zip(rows[1], trees[1], strict=True))
        found = [max(q[1].query(p[0])[0].max(), p[1].query(q[0])[0].max()) for p, q in pairs]
        return np.reshape(found, (len(first), len(second)))

    found, took = _timed(answers)
    error = np.maximum(matrix["lower"] - found, found - matrix["upper"])
    numbers = {"spacing": spacing, "seconds": took, "ratio": took / matrix["seconds"]}
    outside = np.mean(error > 0)
    return {
        **numbers,
        "largest_error": error.max(),
        "outside": outside,
        "median_error": np.median(np.maximum(error, 0)),
    }


def _samples(curve: jhd.BezierSegments, spacing: float) -> np.ndarray:
    """Return points along all segments, neighbors at most about `spacing` apart."""
    points = np.asarray(curve.control_points)
    lengths = np.sum(np.linalg.norm(np.diff(points, axis=1), axis=-1), axis=-1)
    rows = [sample(piece[None], int(np.ceil(length / spacing))) for piece, length in zip(points, lengths, strict=True)]
    return np.unique(np.concatenate(rows), axis=0)


def _pairs(
    first: Letters, second: Letters, solutions: list[list[jhd.HausdorffSolution]], letters: str
) -> list[dict[str, Any]]:
    """Return the pairs of the figure: the closest and farthest with one letter, and the worst miss either way."""
    value = np.array([[float(s.value) for s in row] for row in solutions])
    same = np.diag(value)
    chosen = [("closest", *(int(np.argmin(same)),) * 2), ("farthest", *(int(np.argmax(same)),) * 2)]
    for name, table in (("missed_row", value), ("missed_column", value.T)):
        query = int(np.argmax(same / table.min(axis=1)))
        nearest = int(np.argmin(table[query]))
        if nearest != query:
            chosen.append((name, query, nearest) if name == "missed_row" else (name, nearest, query))
    return [
        {
            "kind": kind,
            "letters": [letters[i], letters[j]],
            "a": _plain(first[letters[i]]),
            "b": _plain(second[letters[j]]),
            "solution": solutions[i][j],
        }
        for kind, i, j in chosen
    ]


def _plain(curve: jhd.BezierSegments) -> np.ndarray:
    """Return the control points without the repetitions of the last segment."""
    points = np.asarray(curve.control_points)
    return points[: 1 + int(np.argmax(np.all(points == points[-1], axis=(1, 2))))]


def _matrix_table(numbers: dict[str, Any]) -> str:
    matrix, count = numbers["matrix"], len(numbers["letters"])
    header = [f"{count} x {count} distances", "time (s)", "ratio", "gap or largest error (x-height)", "cells"]
    rows = [["jhd.hausdorff", f"{matrix['seconds']:.2f}", "1.00", f"{matrix['gap']:.1e}", str(matrix["cells"])]]
    rows += [
        [
            f"k-d tree, samples {s['spacing']:g} apart",
            f"{s['seconds']:.2f}",
            f"{s['ratio']:.2f}",
            f"{s['largest_error']:.1e}",
        ]
        + [""]
        for s in numbers["samples"]
    ]
    return markdown(header, rows)


def _search_table(numbers: dict[str, Any]) -> str:
    matrix, letters = numbers["matrix"], numbers["letters"]
    header = [
        "nearest letters",
        "same, certified",
        "other, certified",
        "tied",
        "distances",
        "decisions",
        "steps",
        "time (s)",
    ]
    rows = []
    for name, search in numbers["searches"].items():
        work = [search["distances"], search["decisions"], search["steps"], f"{search['seconds']:.2f}"]
        counts = _counts(letters, search["nearest"], search["tied"])
        rows.append([f"of {numbers['fonts'][name == 'columns']}, search", *counts, *work])
    for name, entries in matrix["nearest"].items():
        work = [len(letters) ** 2, 0, matrix["steps"].sum(), f"{matrix['seconds']:.2f}"]
        counts = _counts(letters, *([entry[key] for entry in entries] for key in ("nearest", "tied")))
        rows.append([f"of {numbers['fonts'][name == 'columns']}, matrix", *counts, *work])
    return markdown(header, rows)


def _counts(letters: str, nearest: list[str], tied: list[list[str]]) -> list[int]:
    """Count letters whose nearest one is certified to be its namesake, certified to be another, and tied."""
    clear = [x == y for x, y, others in zip(letters, nearest, tied, strict=True) if not others]
    return [sum(clear), len(clear) - sum(clear), len(letters) - len(clear)]


def _misses_table(numbers: dict[str, Any]) -> str:
    """Format letters whose nearest one is another or tied, and the closest of the other calls."""
    rows = []
    for name, entries in numbers["matrix"]["nearest"].items():
        font = numbers["fonts"][name == "columns"]
        named = list(zip(numbers["letters"], entries, strict=True))
        clear = [(letter, e) for letter, e in named if e["nearest"] == letter and not e["tied"]]
        listed = [(f"{letter} of {font}", e) for letter, e in named if (letter, e) not in clear]
        closest = min(clear, key=lambda pair: pair[1]["ratio"])
        for words, e in (*listed, (f"closest call: {closest[0]} of {font}", closest[1])):
            rows.append([words, e["nearest"], e["second"], "tied" if e["tied"] else f"{e['ratio']:.4f}"])
    return markdown(["letter", "nearest", "second", "ratio of their distances"], rows)


if __name__ == "__main__":
    main()
