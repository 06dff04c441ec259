"""What happens to the published distance if cells are kept that hold no point of the surface?

The method of the paper treats every cell that its range of the polynomial cannot exclude as a part of the surface. This
fails on three pairs: (1) a surface B with a factor that nearly vanishes near A and is zero nowhere, so that cells there
stand for points that do not exist; (2) such a factor in A; (3) an A that consists of such a factor alone, and has no
point at all. For each pair: the published interval, the interval of the safe rule, which asks for a proof when it
counts, and the bounds of BranchAndBound.

Claims: on the first two the published interval misses the distance with every number of cells up to 256 along an axis,
by at least 0.87 below 2.5 and 1.5 above 0.1 (0.95 and 1.7 at 256). On the third it gives a number although no distance
exists. The safe interval and BranchAndBound always hold the distance. On the third the safe rule does not certify that
a distance exists, and BranchAndBound proves that A is empty.

Feeds: figure "spurious cells" and its table.
Takes: 1 minute, 6 with compilation.
"""

from typing import Any

import numpy as np
from common import Run, markdown
from common_surfaces import surface

import jhd
from jhd._results.solution import name_of

SPHERE = "x^2 + y^2 + z^2 - 1"
# Title; both polynomials; the distance, or None if there is none; planes of the picture (z).
PAIRS = (
    ("cells of B without a point", SPHERE, "((x - 1.2)^2 + y^2 + z^2 + 1e-4)*(x + 1.5)", 2.5, (0.0,)),
    (
        "cells of A without a point",
        f"((x - 1.7)^2 + (y - 1.7)^2 + (z - 1.7)^2 + 1e-4)*({SPHERE})",
        "x^2 + y^2 + z^2 - 1.21",
        0.1,
        (0.0, 1.7),
    ),
    ("no point at all", "(x - 0.3)^2 + (y - 0.3)^2 + (z - 0.3)^2 + 1e-4", SPHERE, None, (0.3,)),
)
# Cells along an axis, and their number in the picture.
CELLS, SHOWN = (16, 32, 64, 128, 256), 32
ATOL = 1e-6


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    cells = (16,) if run.smoke else CELLS
    pairs = [_measured(run, *pair, cells) for pair in PAIRS]
    header = ["pair", "distance", "rule", *(f"{count}^3" for count in cells)]
    rows = []
    for pair in pairs:
        exact = "none" if pair["exact"] is None else f"{pair['exact']:g}"
        for rule in ("paper", "safe"):
            rows.append([pair["title"], exact, rule, *(_interval(found, pair["exact"]) for found in pair[rule])])
        if pair["search"] is not None:
            found = pair["search"]
            row = [_interval(found, pair["exact"])] + [""] * (len(cells) - 1)
            rows.append([pair["title"], exact, "BranchAndBound", *row])
    run.save({"cells": cells, "shown": SHOWN, "pairs": pairs}, markdown(header, rows))


def _interval(found: dict[str, Any], exact: float | None) -> str:
    if found["result"] in ("empty", "empty_surface", "existence_not_certified"):
        return found["result"]
    wrong = exact is None or not found["lower"] <= exact <= found["upper"]
    return f"[{found['lower']:.6g}, {found['upper']:.6g}]" + (" wrong" if wrong else "")


def _measured(
    run: Run, title: str, f: str, g: str, exact: float | None, planes: tuple[float, ...], cells: tuple[int, ...]
) -> dict[str, Any]:
    a, b = surface(f), surface(g)
    numbers: dict[str, Any] = {"title": title, "polynomials": [f, g], "exact": exact, "planes": planes}
    for rule in ("paper", "safe"):
        numbers[rule] = [_found(a, b, jhd.published.CubeIntervals(count, rule)) for count in cells]
    # The search would take longer to compile than a smoke run lasts.
    numbers["search"] = None if run.smoke else _found(a, b, jhd.BranchAndBound(atol=ATOL))
    numbers["slices"] = [[_slice(shape, plane) for plane in planes] for shape in (a, b)]
    return numbers


def _found(a: jhd.ImplicitSurface, b: jhd.ImplicitSurface, method: Any) -> dict[str, Any]:
    """Return both bounds, or that a surface was certified to be empty."""
    try:
        solution = jhd.directed_hausdorff(a, b, method, throw=False)
    except ValueError:
        return {"result": "empty", "lower": None, "upper": None, "point": None, "feet": None}
    w, upper = solution.witness, float(solution.upper)
    ends = {"lower": float(solution.lower), "upper": upper}
    return {"result": name_of(solution.result), **ends, "point": w.point, "feet": w.feet}


def _slice(shape: jhd.ImplicitSurface, plane: float) -> dict[str, Any]:
    """Return the kept cells of the layer that contains the plane, and which of them are certified to hold a point."""
    voxels = jhd.voxelize(shape, SHOWN, ranges="modified_affine")
    layer = int((plane - float(voxels.lower[2])) / float(voxels.spacing[2]))
    here = np.asarray(voxels.cells)[:, 2] == layer
    return {
        "cells": np.asarray(voxels.cells)[here][:, :2],
        "certified": np.asarray(voxels.proven)[here],
        "lower": voxels.lower,
        "spacing": voxels.spacing,
    }


if __name__ == "__main__":
    main()
