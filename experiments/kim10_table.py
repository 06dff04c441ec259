"""What does trimming save, at how many control points, and how does the table of Kim et al. 2010 look today?

Pairs of clamped cubic B-splines of 5 to 120 control points, one for each kind of event as in the source's figure 18.
The source prints no control points. For each pair the two-sided Hausdorff distance is computed by

- `AlgebraicEvents`, all events without trimming: the baseline of the source (Elber & Grandine 2008);
- `BiarcTrimming(variant="paper")`, the source's own steps: a distance map of 512 pixels along the longer side, its
  bound LB, the tests of control points, both curves trimmed;
- `BiarcTrimming`, ours: a measured bound, an exact test, one curve trimmed; both variants in total and less the time of
  the biarcs, which the source counts as preprocessing;
- `TwoStep` and `BranchAndBound` of this package, the latter also with certified upper bounds, to 1e-10 of the diagonal.

The deviation of the biarcs is 1e-4 of the diagonal of the pair's box for all sizes. Times are the shortest of several
warm calls, methods in turn, in one process on one core. The table also shows the source's times, printed for four pairs
of these kinds and sizes, on a Pentium 4 of 2.4 GHz.

Claims: without trimming and with ours the value is the certified one to 1e-9 of the diagonal; trimming never examines
more boxes. As printed, a foot of the maximum is trimmed for some pairs, and then the value is too small, mostly below
LB.

Feeds: figure and table "trimming" (table 1 of Kim et al. 2010, with data of our own).
Takes: 3 minutes.
"""

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from common import Run, markdown
from common_kim10 import COUNTS, KINDS, pair

import jhd
from jhd._distance.normalization.curves import prepare
from jhd._distance.published.events.host_pair import HostPair
from jhd._distance.published.trimming import both_arcs
from jhd._results.solution import name_of

# Milliseconds without and with trimming, by kind and number of control points: table 1 and figure 18 of the source.
PRINTED = {
    ("end", 5): (2953, 146),
    ("self_bisector", 10): (10156, 1572),
    ("antipodal", 15): (15502, 1306),
    ("antipodal", 30): (35725, 2215),
}
DEVIATION = 1e-4
# The name of the source's own steps.
PAPER = "BiarcTrimming, paper"
# Tolerated error of the values of both methods of the source, in diagonals.
AGREE = 1e-9
# Rounds of all methods take about BUDGET seconds a pair, and their number stays between these limits.
BUDGET, FEWEST, MOST = 5.0, 5, 40


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, one_core=True)
    kinds, counts = (KINDS[:1], COUNTS[:1]) if run.smoke else (KINDS, COUNTS)
    budget = 0.0 if run.smoke else BUDGET
    entries = [_measured(kind, count, budget) for count in counts for kind in kinds]
    sizes = [_size([entry for entry in entries if entry["count"] == count]) for count in counts]
    tables = [_table(entries), _values(entries), _sizes(sizes), _printed(entries)]
    run.save({"deviation": DEVIATION, "entries": entries, "sizes": sizes}, "\n\n".join(tables))


def _measured(kind: str, count: int, budget: float) -> dict[str, Any]:
    """Measure one pair: values, boxes and times by method."""
    a, b = (curve.segments() for curve in pair(kind, count))
    low, high = (np.asarray(x) for x in jhd.BezierSegments.join([a, b]).bounds)
    diagonal = float(np.linalg.norm(high - low))
    methods = {
        "AlgebraicEvents": jhd.published.AlgebraicEvents(),
        "BiarcTrimming": jhd.published.BiarcTrimming(deviation=DEVIATION * diagonal),
        PAPER: jhd.published.BiarcTrimming(deviation=DEVIATION * diagonal, variant="paper"),
        "TwoStep": jhd.published.TwoStep(),
        "BranchAndBound": jhd.BranchAndBound(),
    }
    calls: dict[str, Callable[[], Any]] = {
        name: lambda method=method: jhd.hausdorff(a, b, method) for name, method in methods.items()
    }
    p, q, frame = prepare(a, b)
    deviation = float(frame.common(DEVIATION * diagonal))
    calls["biarcs"] = lambda: both_arcs(HostPair.of(p, q), deviation)
    times = _times(calls, budget)
    found = {name: calls[name]() for name in methods}
    return {
        "kind": kind,
        "count": count,
        "diagonal": diagonal,
        "event": name_of(found["BranchAndBound"].witness.event),
        "values": _checked(found, diagonal),
        "upper": found["BranchAndBound"].upper,
        **_counts(found),
        "seconds": {
            **times,
            "trimming without biarcs": times["BiarcTrimming"] - times["biarcs"],
            "paper without biarcs": times[PAPER] - times["biarcs"],
        },
        "printed": PRINTED.get((kind, count)),
    }


def _times(calls: dict[str, Callable[[], Any]], budget: float) -> dict[str, float]:
    """Return the shortest times in rounds of all calls, each of which has run before."""
    for call in calls.values():
        jax.block_until_ready(call())
    start = time.perf_counter()
    rounds = [_round(calls)]
    repeats = int(np.clip(budget / (time.perf_counter() - start), FEWEST, MOST)) if budget else 1
    rounds += [_round(calls) for _ in range(repeats - 1)]
    return {name: min(times[name] for times in rounds) for name in calls}


def _round(calls: dict[str, Callable[[], Any]]) -> dict[str, float]:
    times = {}
    for name, call in calls.items():
        start = time.perf_counter()
        jax.block_until_ready(call())
        times[name] = time.perf_counter() - start
    return times


def _checked(found: dict[str, jhd.HausdorffSolution], diagonal: float) -> dict[str, float]:
    """Return all values; those without trimming and with ours must be the certified one."""
    values = {name: float(solution.value) for name, solution in found.items()}
    for name in ("AlgebraicEvents", "BiarcTrimming"):
        off = abs(values[name] - values["BranchAndBound"])
        if not off <= AGREE * diagonal:
            raise AssertionError(f"{name} is off by {off / diagonal:g} of the diagonal")
    return values


def _counts(found: dict[str, jhd.HausdorffSolution]) -> dict[str, Any]:
    """Count boxes, cells, arcs and remaining parts of the curves, of both directions together."""

    def total(name: str, key: str) -> int:
        return sum(int(found[name].stats[f"{way}_{key}"]) for way in ("a_to_b", "b_to_a"))

    boxes = {name: total(name, "boxes") for name in ("AlgebraicEvents", PAPER, "BiarcTrimming")}
    if boxes["BiarcTrimming"] > boxes["AlgebraicEvents"]:
        raise AssertionError(f"trimming examines more boxes: {boxes}")
    stats = found["BiarcTrimming"].stats
    return {
        "boxes": boxes,
        "cells": total("BranchAndBound", "cells"),
        "arcs": int(stats["a_to_b_arcs"]),
        "left": [1.0 - float(stats[f"{way}_trimmed"]) for way in ("a_to_b", "b_to_a")],
        "left_as_printed": [1.0 - float(found[PAPER].stats[f"a_to_b_{key}"]) for key in ("trimmed", "trimmed_of_b")],
        "lower_bound": float(found[PAPER].stats["a_to_b_lower_bound"]),
    }


def _size(entries: list[dict[str, Any]]) -> dict[str, Any]:
    """Return geometric means of the times of one size, and the ranges of the ratios."""
    times = {key: [entry["seconds"][key] for entry in entries] for key in entries[0]["seconds"]}
    whole, total, bare = (
        np.array(times[key]) for key in ("AlgebraicEvents", "BiarcTrimming", "trimming without biarcs")
    )
    boxes = np.array([[entry["boxes"][key] for key in ("AlgebraicEvents", "BiarcTrimming")] for entry in entries])
    ratios = {"total": whole / total, "without biarcs": whole / bare, "boxes": boxes[:, 0] / np.maximum(boxes[:, 1], 1)}
    return {
        "count": entries[0]["count"],
        "seconds": {key: float(np.exp(np.mean(np.log(x)))) for key, x in times.items()},
        "ratios": {key: [float(np.min(x)), _mean(x), float(np.max(x))] for key, x in ratios.items()},
    }


def _mean(x: np.ndarray) -> float:
    return float(np.exp(np.mean(np.log(x))))


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.2f}"


def _table(entries: list[dict[str, Any]]) -> str:
    header = ["points", "kind", "boxes, all", "as printed", "ours", "arcs", "left of a, b as printed (%)", "ours (%)"]
    header += ["AlgebraicEvents (ms)", "BiarcTrimming, paper (ms)", "BiarcTrimming (ms)", "biarcs (ms)"]
    header += ["without biarcs (ms)", "faster", "without biarcs"]
    header += ["TwoStep (ms)", "BranchAndBound (ms)", "cells"]
    rows = [
        [
            entry["count"],
            entry["kind"],
            *entry["boxes"].values(),
            entry["arcs"],
            *(", ".join(f"{100 * share:.2f}" for share in entry[key]) for key in ("left_as_printed", "left")),
            *(_ms(s[key]) for key in ("AlgebraicEvents", PAPER, "BiarcTrimming", "biarcs", "trimming without biarcs")),
            f"{s['AlgebraicEvents'] / s['BiarcTrimming']:.2f}",
            f"{s['AlgebraicEvents'] / s['trimming without biarcs']:.2f}",
            *(_ms(s[key]) for key in ("TwoStep", "BranchAndBound")),
            entry["cells"],
        ]
        for entry in entries
        for s in [entry["seconds"]]
    ]
    return markdown(header, rows)


def _values(entries: list[dict[str, Any]]) -> str:
    names = ("AlgebraicEvents", PAPER, "BiarcTrimming", "TwoStep")
    header = [
        "points",
        "kind",
        "event",
        "certified distance",
        "LB",
        *(f"{name} - certified (diagonals)" for name in names),
    ]
    rows = [
        [
            entry["count"],
            entry["kind"],
            entry["event"],
            f"{entry['values']['BranchAndBound']:.10f}",
            f"{entry['lower_bound']:.4f}",
            *(
                f"{(entry['values'][name] - entry['values']['BranchAndBound']) / entry['diagonal']:.1e}"
                for name in names
            ),
        ]
        for entry in entries
    ]
    return markdown(header, rows)


def _sizes(sizes: list[dict[str, Any]]) -> str:
    header = ["points", "faster by trimming: least, mean, most", "without biarcs", "fewer boxes"]
    rows = [
        [size["count"], *(", ".join(f"{x:.1f}" for x in size["ratios"][key]) for key in size["ratios"])]
        for size in sizes
    ]
    return markdown(header, rows)


def _printed(entries: list[dict[str, Any]]) -> str:
    """Compare the source's printed times with its own steps and ours; trimming times exclude the biarcs."""
    header = ["pair as in figure 18", "printed: without (ms)", "with (ms)", "faster", "here: without (ms)"]
    header += ["with, as printed (ms)", "faster", "value / certified", "with, ours (ms)", "faster", "value / certified"]
    rows = []
    for entry in entries:
        if entry["printed"]:
            (without, trimmed), s, values = entry["printed"], entry["seconds"], entry["values"]
            row = [f"{entry['kind']}, {entry['count']}", without, trimmed, f"{without / trimmed:.1f}"]
            row.append(_ms(s["AlgebraicEvents"]))
            for name, time in ((PAPER, "paper without biarcs"), ("BiarcTrimming", "trimming without biarcs")):
                share = values[name] / values["BranchAndBound"]
                row += [_ms(s[time]), f"{s['AlgebraicEvents'] / s[time]:.1f}", f"{share:.6f}"]
            rows.append(row)
    return markdown(header, rows)


if __name__ == "__main__":
    main()
