"""How do time, cells, compilation and memory grow with the number of segments?

Pairs of closed cubic B-splines, from 1 to 2000 segments each, of two kinds:

- refined: one pair of shapes, far from each other for their size, with more and more control points on it;
- noisy: two tracings of one ellipse with independent noise in every control point. The height of the noise is
  proportional to the spacing, so the number of nearly equal maxima grows with the segments. Medians of three draws.

A single segment is the first one of a spline of four. Functions are compiled for 4, 16, 48, 96, 192, 256, 384, 512, ...
segments, and curves are padded to these sizes. The experiment uses some of these sizes, and some sizes just above them,
which cost as much as the next size: 2000 costs as much as 2048. Times are warm medians in one process on one core: one
direction and both, as a plain call and as one compiled function, and one plain call with no steps, which measures only
the start of the search. For comparison, SciPy's k-d tree in one direction, tree included, with 25 samples a segment,
and its error; the samples are not timed. Exponents are fitted to the sizes that need no padding.

Memory is measured in two ways: XLA's own count of the memory of a compiled function without its input and output, and
the peak of a process that does nothing else, less the memory of the imports. This process takes its compiled functions
from the compile cache. Compilation is timed for one direction, from the call to the compiled function, without a cache.

Claims: 2000 x 2000 segments are certified to 1e-10 of the diagonal in a tenth of a second a direction, in fewer than
n + 64 cells of n segments, and in bounded memory: less than 10 MB for the tables of a compiled function, less than 1 GB
for the process. Tracing and compiling take 8 to 40 s. The start of the search grows more slowly than the number of
segments, and takes a quarter or more of a plain call from 385 segments on. A k-d tree is faster for few segments. For
2000 segments of the noisy pairs it takes about as long (0.3 to 2 times), and has an error of 1e-6 of the diagonal
instead of a proof.

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
# Sizes without padding, some that need the most padding, and the claimed size, which is padded to 2048.
_SIZES = (1, *sorted({*_BUCKETS[:-1], *(count + 1 for count in _BUCKETS[:6])}), _CLAIMED)
# Exponents are fitted in two ranges: overhead dominates every call in the first, and none in the second.
_FITS = {"small": (4, 96), "large": (384, 1536)}
_SAMPLES = 25
_DRAWS = 3
# Mean radius and stretch of the noisy ellipses, and the standard deviation of the noise in spacings of the points.
_RADIUS, _STRETCH, _NOISE = 100.0, 1.2, 0.3
# A call is repeated for about this many seconds, within limits; in a smoke run, as few times as possible.
_SECONDS, _REPEATS = 0.3, (1, 21)
_MB = 1e6


def _directed(a: jhd.BezierSegments, b: jhd.BezierSegments) -> jhd.HausdorffSolution:
    return jhd.directed_hausdorff(a, b)


def _two_sided(a: jhd.BezierSegments, b: jhd.BezierSegments) -> jhd.HausdorffSolution:
    return jhd.hausdorff(a, b)


@jhd.inline_searches()
def main() -> None:
    """Compute, save and print."""
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
    """Return the segments of a closed spline; if `count` is 1, only the first one."""
    segments = curve.segments()
    return segments if count > 1 else jhd.BezierSegments(segments.control_points[:1])


def _refined(count: int) -> Pair:
    """Return the two shapes with `count` control points."""
    a, b = (_first(ring(name, max(count, 4)), count) for name in ("example_2_a", "example_2_b"))
    return a, b


def _noisy(count: int, random: np.random.Generator) -> Pair:
    """Return two tracings of one ellipse."""
    a, b = (_first(_tracing(max(count, 4), random), count) for _ in "ab")
    return a, b


def _tracing(count: int, random: np.random.Generator) -> jhd.BSplineCurve:
    angle = 2 * np.pi * np.arange(count) / count
    r = _RADIUS * (1 + 2 * np.pi / count * _NOISE * random.standard_normal(count))
    points = np.stack([_STRETCH * r * np.cos(angle), r * np.sin(angle)], axis=-1)
    return jhd.BSplineCurve.uniform(points, periodic=True)


def _compiled(
    function: Callable[..., Any], buckets: tuple[int, ...], cached: bool, options: dict[str, Any] | None
) -> dict[int, tuple[Any, dict]]:
    """Compile one function for each number of segments; return them with the seconds of tracing and compiling."""
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
    """Return the warm median time of a call, repeated for about this many seconds."""
    start = time.perf_counter()
    jax.block_until_ready(call())
    return seconds(call, int(np.clip(budget / (time.perf_counter() - start), *_REPEATS)))


def _measured(pairs: list[Pair], programs: dict[int, tuple[Any, Any]], budget: float) -> dict[str, Any]:
    """Measure all draws of one size; return the medians of counts, times and the error of the samples."""
    count = pairs[0][0].count
    bucket = padded_count(count, small=True)
    draws = [_draw(pair, programs.get(bucket), budget / len(pairs)) for pair in pairs]
    medians = {key: float(np.median([draw[key] for draw in draws])) for key in draws[0]}
    ratio = medians["directed, compiled"] / medians["k-d tree"]
    return {"segments": count, "padded": bucket, "draws": draws, **medians, "ratio": ratio}


def _draw(pair: Pair, compiled: tuple[Any, Any] | None, budget: float) -> dict[str, float]:
    """Measure one pair; return times by name."""
    directed, two_sided = compiled or (jax.jit(_directed), jax.jit(_two_sided))
    start = jhd.BranchAndBound(max_steps=0)
    # Compiled functions need curves of their own size: the segments, with the last one repeated.
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
    """Return the larger of the certified gaps, and the error of the samples, in diagonals of the box."""
    rows = np.concatenate([np.asarray(curve.control_points).reshape(-1, 2) for curve in pair])
    diagonal = float(np.linalg.norm(np.ptp(rows, axis=0)))
    gap = max(float(found.upper - found.lower) for found in (there, both))
    return {"gap": gap / diagonal, "error": abs(sampled - float(there.value)) / diagonal}


def _memory(programs: tuple[Any, Any]) -> dict[str, Any]:
    """Return the bytes that XLA reserves besides input and output; None if the device does not report them."""
    found = [program.memory_analysis() for program in programs]
    sizes = [getattr(analysis, "temp_size_in_bytes", None) for analysis in found]
    return dict(zip(("directed, reserved", "both, reserved"), sizes, strict=True))


def _peaks(count: int, options: dict[str, Any] | None) -> dict[str, Any]:
    """Return the peaks of a process of its own for this size."""
    command = [sys.executable, "-c", f"import scaling; scaling.report_peaks({count}, {options})"]
    environment = {**os.environ, "JAX_COMPILATION_CACHE_DIR": str(jax.config.jax_compilation_cache_dir)}  # pyright: ignore
    done = subprocess.run(
        command, cwd=Path(__file__).parent, env=environment, capture_output=True, text=True, check=True
    )
    return {"padded": count, **json.loads(done.stdout)}


def report_peaks(count: int, options: dict[str, Any] | None = None) -> None:
    """Print by how many bytes a plain call, then the function for both directions, raise this process's peak."""
    before, pair = _peak(), _refined(count)
    _two_sided(*pair)
    plain = _peak()
    with jhd.inline_searches():
        jax.block_until_ready(jax.jit(_two_sided, compiler_options=options)(*pair))
    print(json.dumps({"plain, peak": plain - before, "both, peak": _peak() - before}))


def _peak() -> int:
    """Return the largest number of bytes that this process has held at any time."""
    status = Path("/proc/self/status")
    if not status.exists():
        # macOS counts in bytes.
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # On Linux ru_maxrss of a child begins at the peak of its parent.
    (line,) = (line for line in status.read_text(encoding="ascii").splitlines() if line.startswith("VmHWM"))
    return 1024 * int(line.split()[1])


def _exponents(kinds: dict[str, Any]) -> dict[str, Any]:
    """Return slopes of time over segments on logarithmic scales, by kind, call and range."""
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
