"""How long would a million shapes take on a cluster, extrapolated from a few thousand letters?

A million shapes are more than one call holds, so they are cut into shards. Each pair of shards is one task: a call of
`jhd.nearest_shapes` or `jhd.pairs_within` on some worker of any executor. Results are merged: of the nearest shapes in
each shard, the nearest one is kept. Here such calls are measured on pairs of shards of 500 to 4000 letters of the
DejaVu fonts, drawn at random, no letter in both. Measured are CPU seconds of pivot distances and of the rest, the
number of searched distances, and the bytes sent for a shape. Blocks of `jhd.pairwise` give the price of one distance.

The plan multiplies the costs of the largest shards. Its assumptions: the million are as alike, and have as many
segments, as these letters; shards are drawn at random; a thousand cores like this one are busy four fifths of the time;
tasks are independent, so the best bounds of one shard do not help the next. Nothing is extrapolated to larger shards,
which would need fewer pivot distances and fewer searches.

Claims: the merged nearest shapes of two half shards equal those of the whole shard, within the certified bounds. In
shards of 4000 less than a hundredth of the distances is searched for. All pairs of a million take a thousand cores days
and terabytes, the nearest of each one to two hours and all near-duplicates minutes.

Feeds: figure and table "to a million".
Takes: 2 minutes.
"""

import pickle
from typing import Any

import numpy as np
from common import Run, markdown
from common_collections import FAMILIES, SMALL, Glyphs, compile_for, glyphs_of, load, staged

import jhd

_SHARDS = (500, 1000, 2000, 4000)
_WITHIN = 0.01
_MILLION, _CORES, _BUSY = 10**6, 1000, 0.8
# Stored bytes: a distance has its value, both bounds and the result; a neighbor also an index; a pair two indices.
_STORED = {"all pairs": 32, "nearest": 40, "within": 32}
_HOUR = 3600.0


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    fonts, sizes = (SMALL, (20, 40)) if run.smoke else (FAMILIES, _SHARDS)
    glyphs = glyphs_of(fonts, run.smoke)
    order = run.random.permutation(len(glyphs.curves))
    a, b = (glyphs.take(order[k * sizes[-1] : (k + 1) * sizes[-1]]) for k in range(2))
    compile_for(a.curves, b.curves)
    shards = [_shard(a, b, size) for size in sizes]
    side = sizes[0] // 8
    every, spent = staged(lambda told: jhd.pairwise(a.curves[:side], b.curves[:side], progress=told))
    numbers = {
        "fonts": fonts,
        "within": _WITHIN,
        "load": load(),
        "cpu_a_pair": spent.cpu / every.computed,
        "segments": np.mean([curve.count for curve in glyphs.curves]),
        "bytes_a_shape": np.mean([len(pickle.dumps(curve)) for curve in a.curves[:side]]),
        "shards": shards,
        "merged": _merged(a, b, sizes[0]),
        "assumed": {"shapes": _MILLION, "cores": _CORES, "busy": _BUSY},
    }
    numbers["plan"] = _plan(numbers)
    run.save(numbers, "\n\n".join([_shard_table(shards), _plan_table(numbers)]))


def _shard(a: Glyphs, b: Glyphs, size: int) -> dict[str, Any]:
    """Run both calls on one pair of shards."""
    near, spent = staged(lambda told: jhd.nearest_shapes(a.curves[:size], b.curves[:size], progress=told))
    some, others = a.curves[:size], b.curves[:size]
    within, also = staged(lambda told: jhd.pairs_within(some, others, threshold=_WITHIN, progress=told))
    return {
        "size": size,
        "nearest": {"computed": near.computed, "share": near.computed / size**2, **spent._asdict()},
        "within": {
            "computed": within.computed,
            "share": within.computed / size**2,
            "found": len(within.index),
            "undecided": len(within.undecided),
            **also._asdict(),
        },
    }


def _merged(a: Glyphs, b: Glyphs, size: int) -> dict[str, Any]:
    """Compare the nearest shapes merged from two halves of a shard with those from the whole shard."""
    queries, shapes = a.curves[:size], b.curves[:size]
    whole = jhd.nearest_shapes(queries, shapes)
    parts = [jhd.nearest_shapes(queries, half) for half in (shapes[: size // 2], shapes[size // 2 :])]
    lower, upper = (np.min([getattr(part, name)[:, 0] for part in parts], axis=0) for name in ("lower", "upper"))
    agrees = np.all(lower <= whole.upper[:, 0]) and np.all(whole.lower[:, 0] <= upper)
    computed = sum(part.computed for part in parts)
    return {"agrees": agrees, "computed": computed, "computed_whole": whole.computed}


def _plan(numbers: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Return tasks, CPU hours, hours on the cluster and bytes kept for three questions about a million shapes."""
    largest = numbers["shards"][-1]
    parts = _MILLION / largest["size"]
    ordered, unordered = parts**2, parts * (parts + 1) / 2
    pairs = _MILLION * (_MILLION - 1) / 2
    found = unordered * largest["within"]["found"]
    rows = {
        "all pairs": (unordered, pairs * numbers["cpu_a_pair"], pairs),
        "nearest": (ordered, ordered * largest["nearest"]["cpu"], float(_MILLION)),
        "within": (unordered, unordered * largest["within"]["cpu"], found),
    }
    return {
        name: {
            "tasks": tasks,
            "cpu_hours": cpu / _HOUR,
            "hours": cpu / _HOUR / (_CORES * _BUSY),
            "bytes": kept * _STORED[name],
        }
        for name, (tasks, cpu, kept) in rows.items()
    }


def _shard_table(shards: list[dict[str, Any]]) -> str:
    header = [
        "shard",
        "nearest: searched",
        "share (%)",
        "CPU (s)",
        "pivot distances (s)",
        f"within {_WITHIN:g} em: searched",
    ]
    rows = [
        [
            shard["size"],
            shard["nearest"]["computed"],
            f"{100 * shard['nearest']['share']:.3f}",
            f"{shard['nearest']['cpu']:.1f}",
            f"{shard['nearest']['pivots']:.1f}",
            shard["within"]["computed"],
            shard["within"]["found"],
            f"{shard['within']['cpu']:.1f}",
        ]
        for shard in shards
    ]
    return markdown([*header, "found", "CPU (s)"], rows)


def _plan_table(numbers: dict[str, Any]) -> str:
    rows = [
        [name, f"{row['tasks']:.3g}", f"{row['cpu_hours']:.3g}", f"{row['hours']:.3g}", f"{row['bytes'] / 1e9:.3g}"]
        for name, row in numbers["plan"].items()
    ]
    return markdown([f"{_MILLION:.0e} shapes", "tasks", "CPU hours", f"hours on {_CORES} cores", "kept (GB)"], rows)


if __name__ == "__main__":
    main()
