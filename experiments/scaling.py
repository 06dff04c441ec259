"""How do time, cells, compilation and memory grow with the number of segments?

Pairs of closed cubic B-splines, from 1 to 2 000 segments each, of two kinds:

- refined: one pair of shapes, far from each other for their size, with more and more control points on it;
- noisy: two tracings of one ellipse with independent noise in every control point, the height of the noise in
  proportion to the spacing, so that the maxima of nearly the same height grow in number with the segments; three
  draws, of which the medians count.

A single segment is the first of a spline of four. Programs are compiled for 4, 16, 48, 96, 192, 256, 384, 512, ...
segments, and curves are padded to these. Some of these are taken, and some just over them, which cost as much as the
next: 2 000 costs what 2 048 would. Times are warm medians in one process on one core: one direction and both, as a
plain call and as one compiled program, and one plain call without any step, which is the start of the search alone.
Beside them SciPy's k-d tree in one direction, tree included, with 25 samples a segment, taken beforehand for free, and
its error. Exponents are fitted to the sizes that need no padding.

Memory is XLA's own count of what a program needs beside its input and output, and the peak of a process that does
nothing else, less what the imports took. The programs of that process come from the compile cache. Compilation is that
of one direction, from the call to the program, with no cache.

Claims: 2 000 x 2 000 segments are proven to 1e-10 of the diagonal in a tenth of a second a direction, in fewer than n +
64 cells of n segments, and in bounded memory: less than 10 MB for the tables of a program, less than 1 GB for the
process. Tracing and compiling take 10 to 20 s. The start of the search grows more slowly than the number of segments,
and takes a third or more of a plain call from 385 segments on. A k-d tree is faster for few segments and takes as long
for 2 000 of the noisy pairs, with an error of 1e-6 of the diagonal in place of a proof.

Feeds: figure and tables "scaling".
Takes: 8 minutes, 5 once compiled.
"""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from common import Run, markdown, seconds
from common_cao14 import ring
from common_curves import sample, sampled_directed
from jax.experimental.compilation_cache.compilation_cache import reset_cache

import jhd
from jhd._distance.normalization.curves import padded_count

Pair = tuple[jhd.BezierSegments, jhd.BezierSegments]

_BUCKETS = (4, 16, 48, 96, 192, 384, 768, 1536, 3072)
_CLAIMED = 2000
# Sizes that need no padding, some that need the most, and the claimed one, which needs the last program.
_SIZES = (1, *sorted({*_BUCKETS[:-1], *(count + 1 for count in _BUCKETS[:6])}), _CLAIMED)
# Exponents are fitted where all calls take less than the overhead of a few, and where none does.
_FITS = {"small": (4, 96), "large": (384, 1536)}
_SAMPLES = 25
_DRAWS = 3
# Mean radius and stretch of the noisy ellipses, and the standard deviation of the noise in spacings of the points.
_RADIUS, _STRETCH, _NOISE = 100.0, 1.2, 0.3
# A call is repeated for about this many seconds, within limits; least often in a smoke run.
_SECONDS, _REPEATS = 0.3, (1, 21)
_MB = 1e6


def _directed(a: jhd.BezierSegments, b: jhd.BezierSegments) -> jhd.HausdorffSolution:
    return jhd.directed_hausdorff(a, b)


def _two_sided(a: jhd.BezierSegments, b: jhd.BezierSegments) -> jhd.HausdorffSolution:
    return jhd.hausdorff(a, b)


@jhd.searches_in_program()
def main() -> None:
    """Computes, saves and prints."""
    run = Run(__file__, __doc__, one_core=True)
    buckets, sizes, draws, budget = _BUCKETS, _SIZES, _DRAWS, _SECONDS
    if run.smoke:
        buckets, sizes, draws, budget = (4,), (1, 4), 1, 0.0
    cold = _compiled(_directed, buckets, run.smoke, run.options)
    both = _compiled(_two_sided, buckets, True, run.options)
    programs = {count: (cold[count][0], both[count][0]) for count in buckets}
    kinds = {
        "refined": [_measured([_refined(count)], programs, budget) for count in sizes],
        "noisy": [_measured([_noisy(count, run.random) for _ in range(draws)], programs, budget) for count in sizes],
    }
    memory = [{**cold[count][1], **_memory(programs[count]), **_peaks(count, run.options)} for count in buckets]
    numbers = {"cold": not run.smoke, "kinds": kinds, "programs": memory, "exponents": _exponents(kinds)}
    tables = [*(_table(name, entries) for name, entries in kinds.items()), _program_table(memory)]
    run.save(numbers, "\n\n".join([*tables, _exponent_table(numbers["exponents"])]))


def _first(curve: jhd.BSplineCurve, count: int) -> jhd.BezierSegments:
    """The segments of a closed spline, or the first of them alone."""
    segments = curve.segments()
    return segments if count > 1 else jhd.BezierSegments(segments.control_points[:1])


def _refined(count: int) -> Pair:
    """The same two shapes with more control points."""
    a, b = (_first(ring(name, max(count, 4)), count) for name in ("example_2_a", "example_2_b"))
    return a, b


def _noisy(count: int, random: np.random.Generator) -> Pair:
    """Two tracings of one ellipse."""
    a, b = (_first(_tracing(max(count, 4), random), count) for _ in "ab")
    return a, b


def _tracing(count: int, random: np.random.Generator) -> jhd.BSplineCurve:
    angle = 2 * np.pi * np.arange(count) / count
    r = _RADIUS * (1 + 2 * np.pi / count * _NOISE * random.standard_normal(count))
    points = np.stack([_STRETCH * r * np.cos(angle), r * np.sin(angle)], axis=-1)
    return jhd.BSplineCurve.uniform(points, closed=True)


def _compiled(
    function: Callable[..., Any], buckets: tuple[int, ...], cached: bool, options: dict[str, Any] | None
) -> dict[int, tuple[Any, dict]]:
    """One program for each number of segments, and how long tracing and compiling took."""
    # JAX looks at this option once, before it compiles for the first time, and again after a reset.
    jax.config.update("jax_enable_compilation_cache", cached)
    reset_cache()
    found = {}
    for count in buckets:
        start = time.perf_counter()
        lowered = jax.jit(function, compiler_options=options).lower(*_refined(count))
        traced = time.perf_counter()
        program = lowered.compile()
        found[count] = (program, {"trace": traced - start, "compile": time.perf_counter() - traced})
    jax.config.update("jax_enable_compilation_cache", True)
    reset_cache()
    return found


def _time(call: Callable[[], Any], budget: float) -> float:
    """Warm median time of a call, repeated for about this many seconds."""
    start = time.perf_counter()
    jax.block_until_ready(call())
    return seconds(call, int(np.clip(budget / (time.perf_counter() - start), *_REPEATS)))


def _measured(pairs: list[Pair], programs: dict[int, tuple[Any, Any]], budget: float) -> dict[str, Any]:
    """All draws of one size: counts, times and the error of the samples, each as the median over the draws."""
    count = pairs[0][0].count
    bucket = padded_count(count, small=True)
    draws = [_draw(pair, programs.get(bucket), budget / len(pairs)) for pair in pairs]
    medians = {key: float(np.median([draw[key] for draw in draws])) for key in draws[0]}
    ratio = medians["directed, compiled"] / medians["k-d tree"]
    return {"segments": count, "padded": bucket, "draws": draws, **medians, "ratio": ratio}


def _draw(pair: Pair, compiled: tuple[Any, Any] | None, budget: float) -> dict[str, float]:
    """One pair; times by name."""
    directed, two_sided = compiled or (jax.jit(_directed), jax.jit(_two_sided))
    start = jhd.BranchAndBound(max_steps=0)
    # Programs take the curves that they were compiled for: the same segments, repeated.
    padded = tuple(curve.pad(padded_count(curve.count, small=True)) for curve in pair)
    samples = [sample(np.asarray(curve.control_points), _SAMPLES) for curve in pair]
    calls: dict[str, Callable[[], Any]] = {
        "directed, compiled": lambda: directed(*padded),
        "both, compiled": lambda: two_sided(*padded),
        "directed, plain": lambda: _directed(*pair),
        "both, plain": lambda: _two_sided(*pair),
        "start": lambda: jhd.directed_hausdorff(*pair, start, throw=False),
        "k-d tree": lambda: sampled_directed(*samples),
    }
    times = {name: _time(call, budget) for name, call in calls.items()}
    there, both = directed(*padded), two_sided(*padded)
    return {**times, **_counts(there, both), **_errors(pair, there, both, calls["k-d tree"]())}


def _counts(there: jhd.HausdorffSolution, both: jhd.HausdorffSolution) -> dict[str, int]:
    cells = {"cells": int(there.stats["cells"]), "steps": int(there.stats["steps"])}
    return {**cells, "cells, both": sum(int(x) for key, x in both.stats.items() if key.endswith("cells"))}


def _errors(pair: Pair, there: jhd.HausdorffSolution, both: jhd.HausdorffSolution, sampled: float) -> dict[str, float]:
    """The larger of the proven gaps, and the error of the samples, in diagonals of the box."""
    rows = np.concatenate([np.asarray(curve.control_points).reshape(-1, 2) for curve in pair])
    diagonal = float(np.linalg.norm(np.ptp(rows, axis=0)))
    gap = max(float(found.upper - found.lower) for found in (there, both))
    return {"gap": gap / diagonal, "error": abs(sampled - float(there.value)) / diagonal}


def _memory(programs: tuple[Any, Any]) -> dict[str, Any]:
    """What XLA reserves beside input and output, in bytes; None where a device does not say."""
    found = [program.memory_analysis() for program in programs]
    sizes = [getattr(analysis, "temp_size_in_bytes", None) for analysis in found]
    return dict(zip(("directed, reserved", "both, reserved"), sizes, strict=True))


def _peaks(count: int, options: dict[str, Any] | None) -> dict[str, Any]:
    """The peaks of a process of its own for this size."""
    command = [sys.executable, "-c", f"import scaling; scaling.report_peaks({count}, {options})"]
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir)}  # pyright: ignore
    done = subprocess.run(
        command, cwd=Path(__file__).parent, env=environment, capture_output=True, text=True, check=True
    )
    return {"padded": count, **json.loads(done.stdout)}


def report_peaks(count: int, options: dict[str, Any] | None = None) -> None:
    """Prints by how many bytes a plain call, and then the program for both directions, raise this process's peak."""
    before, pair = _peak(), _refined(count)
    _two_sided(*pair)
    plain = _peak()
    with jhd.searches_in_program():
        jax.block_until_ready(jax.jit(_two_sided, compiler_options=options)(*pair))
    print(json.dumps({"plain, peak": plain - before, "both, peak": _peak() - before}))


def _peak() -> int:
    """Most bytes that this process has held at any time."""
    status = Path("/proc/self/status")
    if not status.exists():
        # macOS counts in bytes.
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # On Linux ru_maxrss of a child begins at the peak of its parent.
    (line,) = (line for line in status.read_text(encoding="ascii").splitlines() if line.startswith("VmHWM"))
    return 1024 * int(line.split()[1])


def _exponents(kinds: dict[str, Any]) -> dict[str, Any]:
    """Slopes of time over segments on logarithmic scales, by kind, call and range."""
    names = ("directed, compiled", "both, compiled", "directed, plain", "both, plain", "start", "k-d tree")
    return {
        kind: {name: {fit: _slope(entries, name, *ends) for fit, ends in _FITS.items()} for name in names}
        for kind, entries in kinds.items()
    }


def _slope(entries: list[dict[str, Any]], name: str, low: int, high: int) -> float | None:
    used = [e for e in entries if e["segments"] == e["padded"] and low <= e["segments"] <= high]
    if len(used) < 3:
        return None
    x, y = (np.log([entry[key] for entry in used]) for key in ("segments", name))
    return float(np.polyfit(x, y, 1)[0])


def _table(kind: str, entries: list[dict[str, Any]]) -> str:
    times = ("directed, compiled", "directed, plain", "both, compiled", "both, plain", "start", "k-d tree")
    header = [f"{kind}: segments", "padded", "cells", "cells, both", *(f"{name} (ms)" for name in times)]
    rows = [
        [
            entry["segments"],
            entry["padded"],
            *(f"{entry[key]:.0f}" for key in ("cells", "cells, both")),
            *(f"{1e3 * entry[name]:.3g}" for name in times),
            *(f"{entry[key]:.2g}" for key in ("ratio", "gap", "error")),
        ]
        for entry in entries
    ]
    return markdown([*header, "ratio", "gap", "error of the tree"], rows)


def _program_table(entries: list[dict[str, Any]]) -> str:
    sizes = ("directed, reserved", "both, reserved", "plain, peak", "both, peak")
    header = ["padded", "trace (s)", "compile (s)", *(f"{name} (MB)" for name in sizes)]
    rows = [
        [
            entry["padded"],
            *(f"{entry[key]:.1f}" for key in ("trace", "compile")),
            *("" if entry[key] is None else f"{entry[key] / _MB:.3g}" for key in sizes),
        ]
        for entry in entries
    ]
    return markdown(header, rows)


def _exponent_table(exponents: dict[str, Any]) -> str:
    header = ["exponent of time", "kind", *(f"{low} to {high} segments" for low, high in _FITS.values())]
    rows = [
        [name, kind, *("" if slope is None else f"{slope:.2f}" for slope in fits.values())]
        for kind, calls in exponents.items()
        for name, fits in calls.items()
    ]
    return markdown(header, rows)


if __name__ == "__main__":
    main()
