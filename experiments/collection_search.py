"""What fraction of the distances between many letters must be searched to certify the nearest ones, and in what time?

`jhd.nearest_shapes` finds the nearest and the five nearest among 125, 500 and 2000 letters of DejaVu Sans for each of
500 letters of DejaVu Serif, drawn at random, one em high. Measured are the number of searched distances, as a fraction
of all distances, and CPU seconds of the whole call, once compiled. For comparison, `jhd.pairwise` computes all
distances of eight queries; its time is scaled to all queries.

Claims: the nearest of 2000 takes at most 0.3 per cent of the distances and ten CPU seconds, the five nearest one per
cent; the fraction falls as the number of shapes grows. Both results agree with all distances of the eight queries,
within the certified bounds. Every shape that these distances prove to be among the nearest is found or named as a tie.

Feeds: figure and table "nearest letters".
Takes: 2 minutes.
"""

from typing import Any

import numpy as np
from common import Run, markdown
from common_collections import SMALL, Glyphs, compile_for, glyphs_of, load, staged

import jhd

_FONTS = ("DejaVu Serif", "DejaVu Sans")
_QUERIES, _SIZES, _COUNTS = 500, (125, 500, 2000), (1, 5)
# Number of queries with all distances computed.
_CHECKED = 8
# Letters in the figure, and their number of neighbors.
_SHOWN, _NEIGHBORS = "gR&", 4


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    fonts, sizes = (SMALL, (8, 24)) if run.smoke else (_FONTS, _SIZES)
    first, second = (glyphs_of([font], run.smoke) for font in fonts)
    queries = first.take(run.random.permutation(len(first.curves))[: 12 if run.smoke else _QUERIES])
    shapes = second.take(run.random.permutation(len(second.curves))[: sizes[-1]])
    compile_for(queries.curves, shapes.curves)
    every, spent = staged(lambda told: jhd.pairwise(queries.curves[:_CHECKED], shapes.curves, progress=told))
    each = spent.cpu / every.computed
    searches = [_search(queries, shapes, size, k, every) for k in _COUNTS for size in sizes]
    numbers = {
        "fonts": fonts,
        "queries": len(queries.curves),
        "load": load(),
        "checked": _CHECKED,
        "cpu_a_pair": each,
        "searches": searches,
        "shown": _shown(first, shapes, first.letters[:2] if run.smoke else list(_SHOWN)),
    }
    run.save(numbers, _table(numbers))


def _search(queries: Glyphs, shapes: Glyphs, size: int, k: int, every: jhd.Pairwise) -> dict[str, Any]:
    """Search among the first `size` shapes, and compare with all distances of the first queries."""
    found, spent = staged(lambda told: jhd.nearest_shapes(queries.curves, shapes.curves[:size], k, progress=told))
    value, lower, upper = (np.sort(x[:, :size], axis=1)[:, :k] for x in (every.value, every.lower, every.upper))
    some = slice(_CHECKED)
    # Bounds of the k-th smallest distance contain one number in both tables.
    agree = np.all(found.lower[some] <= upper) and np.all(lower <= found.upper[some])
    near = [_surely(*bounds, k) for bounds in zip(every.lower[:, :size], every.upper[:, :size], strict=True)]
    named = [{*index, *ties} for index, ties in zip(found.index, found.ties, strict=True)][some]
    return {
        "shapes": size,
        "k": k,
        "computed": found.computed,
        "share": found.computed / (len(queries.curves) * size),
        "tied": found.tied.sum(),
        "spent": spent._asdict(),
        "difference": np.max(np.abs(found.value[some] - value)),
        "gap": np.max(found.upper - found.lower),
        "agrees": bool(agree and all(a <= b for a, b in zip(near, named, strict=True))),
    }


def _surely(lower: np.ndarray, upper: np.ndarray, k: int) -> set[int]:
    """Return the shapes certified to be among the k nearest: fewer than k others may be as near."""
    return {j for j in np.argsort(upper)[:k].tolist() if np.sum(lower <= upper[j]) <= k}


def _shown(first: Glyphs, shapes: Glyphs, letters: list[str]) -> dict[str, Any]:
    """Return some letters with their nearest shapes, for the picture."""
    queries = first.take([first.letters.index(letter) for letter in letters])
    found = jhd.nearest_shapes(queries.curves, shapes.curves, _NEIGHBORS)
    return {
        "letters": queries.letters,
        "queries": [curve.control_points for curve in queries.curves],
        "neighbors": [shapes.take(index).letters for index in found.index],
        "shapes": [[shapes.curves[k].control_points for k in index] for index in found.index],
        "value": found.value,
        "lower": found.lower,
        "upper": found.upper,
        "ties": [len(tie) for tie in found.ties],
    }


def _table(numbers: dict[str, Any]) -> str:
    header = ["k", "shapes", "searched", "share (%)", "tied queries", "CPU (s)", "pivot distances (s)", "all pairs (s)"]
    rows = [
        [
            s["k"],
            s["shapes"],
            s["computed"],
            f"{100 * s['share']:.2f}",
            s["tied"],
            f"{s['spent']['cpu']:.1f}",
            f"{s['spent']['pivots']:.1f}",
            f"{numbers['cpu_a_pair'] * numbers['queries'] * s['shapes']:.0f}",
        ]
        for s in numbers["searches"]
    ]
    return markdown(header, rows)


if __name__ == "__main__":
    main()
