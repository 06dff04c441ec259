"""How many pairs per second does a batch compute?

Random pairs of two kinds: single cubics, with normal control points; and closed cubic B-splines of 30 control points,
two noisy tracings of an ellipse each. For every pair the two-sided Hausdorff distance is certified to 1e-10 of the
diagonal:

- in a batch of 1 to 1024 pairs (64 to 8192 on an accelerator) by `jax.vmap` of `jhd.hausdorff` within `jax.jit`;
- in such a batch with the search compiled into the function (`jhd.inline_searches`), as always on an accelerator;
- one by one, by one compiled function;
- one by one, by plain calls.

On a CPU a compiled function calls the kept search on the host, which spreads blocks of a batch over all cores. If the
search is compiled into the function, one core searches the pairs of a batch one after the other by design
(`jax.custom_batching.sequential_vmap`), since side by side each pair would take as long as the longest one. On an
accelerator they are searched side by side. The saved numbers name the device and the number of cores. Functions are
compiled for 4, 16, 48, ... segments, so that a cubic is repeated four times, and 30 segments cost as much as 48.

For comparison: SciPy's k-d trees on one core, both directions, trees included, pair by pair, with 100 samples a
segment, and their error; the samples are not timed. Batches use the same 256 pairs, larger ones use more; arrays are
stacked beforehand. All run in one process, in turns; times are medians, warm.

Claims: the answers of a batch equal those one by one to rounding. On two or more cores of a CPU a batch of 256 pairs or
more is searched at least three times as fast as pairs one by one for single cubics, twice for curves of 30 segments,
and faster than with the search compiled into the function. The trees have errors of 1e-6 in the median and up to 1e-3.

Feeds: figure and table "throughput".
Takes: 3 minutes.
"""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from common import Run, markdown
from common_curves import sample, sampled_directed

import jhd
from jhd._distance.normalization.curves import padded_count

_BATCHES = (1, 4, 16, 64, 256, 1024)
# On an accelerator each size takes half a minute to compile, and a call tens of milliseconds.
_ON_ACCELERATOR = (64, 1024, 8192)
# All batches up to this size, and all single calls, take these first pairs.
_CLAIMED = 256
_SEGMENTS = 30
_SAMPLES = 100
# Mean radius and stretch of the ellipses, and the standard deviation of the radius, in radii.
_RADIUS, _STRETCH, _NOISE = 100.0, 1.2, 0.1
# Measured in turns, so that other work on the machine slows all calls equally; the first turn is not counted.
_ROUNDS, _FEW_ROUNDS = 5, 2

Pair = tuple[jhd.BezierSegments, jhd.BezierSegments]


class Answer(NamedTuple):
    """The stored parts of every solution: arrays of the batch's shape."""

    value: Any
    lower: Any
    upper: Any
    steps: Any


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    platform = jax.default_backend()
    batches = (4,) if run.smoke else _BATCHES if platform == "cpu" else _ON_ACCELERATOR
    kinds = {"cubics": _cubic} if run.smoke else {"cubics": _cubic, "splines": _tracing}
    found = {}
    for name, draw in kinds.items():
        pairs = [(draw(run.random), draw(run.random)) for _ in range(batches[-1])]
        found[name] = _measured(run, pairs, batches)
    device = {"platform": platform, "kind": jax.devices()[0].device_kind, "cores": run.cores}
    run.save({**device, "claimed": _CLAIMED, "kinds": found}, _tables(found, "{kind} ({platform})".format(**device)))


def _cubic(random: np.random.Generator) -> jhd.BezierSegments:
    return jhd.BezierCurve(random.standard_normal((4, 2))).segments()


def _tracing(random: np.random.Generator) -> jhd.BezierSegments:
    angle = 2 * np.pi * np.arange(_SEGMENTS) / _SEGMENTS
    r = _RADIUS * (1 + _NOISE * random.standard_normal(_SEGMENTS))
    points = np.stack([_STRETCH * r * np.cos(angle), r * np.sin(angle)], axis=-1)
    return jhd.BSplineCurve.uniform(points, periodic=True).segments()


def _stacked(pairs: list[Pair]) -> Any:
    """Stack both curves of all pairs, as one curve each with a leading axis."""
    return jax.tree_util.tree_map(lambda *rows: jnp.stack(rows), *pairs)


def _answer(a: jhd.BezierSegments, b: jhd.BezierSegments) -> Answer:
    found = jhd.hausdorff(a, b)
    return Answer(found.value, found.lower, found.upper, found.stats["a_to_b_steps"] + found.stats["b_to_a_steps"])


def _measured(run: Run, pairs: list[Pair], batches: tuple[int, ...]) -> dict[str, Any]:
    """Return seconds a pair of all batches and of single calls, and whether the answers agree."""
    one, batch = (jax.jit(function, compiler_options=run.options) for function in (_answer, jax.vmap(_answer)))
    few = pairs[:_CLAIMED]
    samples = [[sample(np.asarray(curve.control_points), _SAMPLES) for curve in pair] for pair in few]
    parts = {n: [_stacked(pairs[k : k + n]) for k in range(0, max(n, len(few)), n)] for n in batches}
    ways = {"batch": False} | ({"batch in the program": True} if jax.default_backend() == "cpu" else {})
    calls: dict[Any, Callable[[], Any]] = {
        **{
            (way, n): jhd.inline_searches(inside)(lambda stacked=stacked: [batch(*part) for part in stacked])
            for way, inside in ways.items()
            for n, stacked in parts.items()
        },
        # Waits only for the last answer, so that a device can work while Python goes on.
        "one by one": lambda: [one(*pair) for pair in few],
        "plain": lambda: [jhd.hausdorff(*pair) for pair in few],
        "k-d tree": lambda: [_trees(*rows) for rows in samples],
    }
    found = {name: jax.block_until_ready(call()) for name, call in calls.items()}
    count = _ROUNDS if jax.default_backend() == "cpu" else _FEW_ROUNDS
    rounds = [[_seconds(call) for call in calls.values()] for _ in range(1 if run.smoke else count)]
    counts = [max(name[1], len(few)) if isinstance(name, tuple) else len(few) for name in calls]
    each = dict(zip(calls, np.median(rounds, axis=0) / counts, strict=True))
    alone = each["one by one"]
    return {
        "segments": pairs[0][0].count,
        "padded": padded_count(pairs[0][0].count),
        "batches": {
            way: [{"size": n, "seconds": each[way, n], "one by one to this": alone / each[way, n]} for n in batches]
            for way in ways
        },
        "loops": {name: {"seconds": each[name], "pairs": len(few)} for name in each if isinstance(name, str)},
        **_checked(few, _joined(found["batch", batches[0]]), _joined(found["one by one"]), np.array(found["k-d tree"])),
    }


def _seconds(call: Callable[[], Any]) -> float:
    start = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - start


def _joined(answers: list[Answer]) -> Answer:
    return Answer(*(np.concatenate([np.atleast_1d(x) for x in rows]) for rows in zip(*answers, strict=True)))


def _checked(pairs: list[Pair], batch: Answer, alone: Answer, sampled: np.ndarray) -> dict[str, Any]:
    """Return steps, and certified gaps, differences of the answers and errors of the samples in diagonals."""
    diagonals = np.array([_diagonal(pair) for pair in pairs])
    error = np.abs(sampled - batch.value) / diagonals
    return {
        "steps": {"mean": np.mean(batch.steps), "most": np.max(batch.steps)},
        "gap": np.max((batch.upper - batch.lower) / diagonals),
        "difference": np.max(np.abs(batch.value - alone.value) / diagonals),
        "error": {"median": np.median(error), "largest": np.max(error)},
    }


def _trees(a: np.ndarray, b: np.ndarray) -> float:
    return max(sampled_directed(a, b), sampled_directed(b, a))


def _diagonal(pair: Pair) -> float:
    rows = np.concatenate([np.asarray(curve.control_points).reshape(-1, 2) for curve in pair])
    return float(np.linalg.norm(np.ptp(rows, axis=0)))


def _tables(kinds: dict[str, Any], device: str) -> str:
    rows = [
        [kind, found["segments"], name, f"{1 / each:.4g}", f"{1e3 * each:.3g}", f"{each / reference:.2f}"]
        for kind, found in kinds.items()
        for reference in [found["loops"]["one by one"]["seconds"]]
        for name, each in _named(found).items()
    ]
    checks = [
        [
            kind,
            f"{found['steps']['mean']:.1f}",
            found["steps"]["most"],
            *(f"{x:.1e}" for x in (found["gap"], found["difference"], *found["error"].values())),
        ]
        for kind, found in kinds.items()
    ]
    header = [device, "segments", "method", "pairs per second", "time per pair (ms)", "ratio to one by one"]
    columns = ["steps, mean", "most", "largest gap", "batch to one by one", "error of the tree, median", "largest"]
    return markdown(header, rows) + "\n\n" + markdown(["", *columns], checks)


def _named(found: dict[str, Any]) -> dict[str, float]:
    """Return seconds a pair by readable names."""
    batches = {
        f"{way}, {entry['size']} pairs": entry["seconds"] for way, rows in found["batches"].items() for entry in rows
    }
    return {**batches, **{name: entry["seconds"] for name, entry in found["loops"].items()}}


if __name__ == "__main__":
    main()
