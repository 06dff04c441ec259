"""Where are six pairs of well-known algebraic surfaces farthest from each other, and what does certifying it cost?

Each pair lies in one box and is compared in both directions by BranchAndBound, the default, to a tolerance of 1e-6. The
first call compiles for the degrees of the pair; a second call is timed. For comparison: the interval that
CubeIntervals proves in this process with cells of a 64th of the box.

Claims: every pair but one is closed to the tolerance within a second once compiled. The torus has a whole circle of
feet, around which cells must be cut finer and finer. Its bounds end about as far apart as the tolerance, with the
result `capacity_reached`. The interval of cells holds the distance too, and is at least ten thousand times as wide.

Feeds: figure "surface gallery" and its table.
Takes: 3 minutes, mostly compilation.
"""

import time
from typing import Any

import numpy as np
from common import Run, markdown
from common_surfaces import BARTH, CAYLEY, CLEBSCH, CONES, TANGLECUBE, TORUS, surface

import jhd
from jhd._results.solution import name_of

ATOL = 1e-6
# Name, both polynomials, the box.
PAIRS = (
    ("two cones", *CONES, -2.0, 2.0),
    ("sphere, ellipsoid", "x^2 + y^2 + z^2 - 1", "(x - 0.2)^2/2.25 + y^2 + (z + 0.1)^2/0.49 - 1", -1.8, 1.8),
    ("torus, ellipsoid", TORUS, "(x - 0.1)^2/2.56 + y^2/1.69 + z^2/0.25 - 1", -1.8, 1.8),
    ("tanglecube, sphere", TANGLECUBE, "x^2 + y^2 + z^2 - 4.41", -2.5, 2.5),
    ("Clebsch, Cayley cubic", CLEBSCH, CAYLEY, -1.0, 1.0),
    ("Barth sextic, sphere", BARTH, "(x - 0.1)^2 + y^2 + (z - 0.05)^2 - 1.44", -2.0, 2.0),
)
SMOKE_CELLS, CELLS = 16, 64


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    pairs = [_measured(run, *pair) for pair in (PAIRS[1:2] if run.smoke else PAIRS)]
    header = ["pair", "lower", "upper - lower", "event", "direction", "result", "seconds", "first call, s", "cells"]
    header += ["of cells: lower", "upper", "seconds"]
    rows = []
    for pair in pairs:
        found, cells = pair["solution"], pair["cubes"]
        gap = f"{found.upper - found.lower:.1e}"
        row = [pair["name"], f"{float(found.lower):.9f}", gap, name_of(found.event), name_of(found.direction)]
        row += [name_of(found.result), f"{pair['seconds']:.2f}", f"{pair['first']:.0f}", pair["examined"]]
        rows.append([*row, f"{cells['lower']:.4f}", f"{cells['upper']:.4f}", f"{cells['seconds']:.2f}"])
    run.save({"atol": ATOL, "pairs": pairs}, markdown(header, rows))


def _measured(run: Run, name: str, f: str, g: str, lower: float, upper: float) -> dict[str, Any]:
    a, b = surface(f, lower, upper), surface(g, lower, upper)
    method = jhd.BranchAndBound(atol=1e-2 if run.smoke else ATOL)
    solution, first = _timed(a, b, method)
    _, again = (solution, first) if run.smoke else _timed(a, b, method)
    cubes = jhd.published.CubeIntervals(SMOKE_CELLS if run.smoke else CELLS)
    run.warm(lambda: _timed(a, b, cubes))
    cells, seconds = _timed(a, b, cubes)
    numbers = {"name": name, "polynomials": [f, g], "lower": a.lower, "upper": a.upper}
    numbers |= {"coefficients": [a.coefficients, b.coefficients], "solution": solution}
    numbers |= {"seconds": again, "first": first}
    numbers["examined"] = sum(int(x) for key, x in solution.stats.items() if key.endswith("_cells"))
    numbers["cubes"] = {"lower": float(cells.lower), "upper": float(cells.upper), "seconds": seconds}
    return numbers


def _timed(a: jhd.ImplicitSurface, b: jhd.ImplicitSurface, method: Any) -> tuple[jhd.HausdorffSolution, float]:
    start = time.perf_counter()
    solution = jhd.hausdorff(a, b, method, throw=False)
    np.asarray(solution.upper)
    return solution, time.perf_counter() - start


if __name__ == "__main__":
    main()
