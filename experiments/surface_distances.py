"""How far apart are surfaces, curves, points and meshes, and how accurate are samples in that time?

Six pairs of different kinds:

- a sheet of 100 bicubic patches, and this sheet with its control points moved at random;
- a curve above the sheet;
- 10 000 noisy points of the sheet;
- a rational torus and a wider one about the same circle, at constant distance;
- a rational torus and a stretched and turned one;
- an ellipsoid as an implicit surface and a mesh of 588 triangles with bumps.

jhd measures each pair to a tolerance, given as a fraction of the diagonal. In the same process, a k-d tree measures
samples of both shapes, whose number is doubled until they take as long. Times are CPU seconds. jhd is timed in a second
call, because the first one compiles.

Claims: every pair closes to its tolerance (1e-10 of the diagonal, 1e-6 for tori, 1e-4 for the mesh) in less than two
seconds, and the distance of both tori, 0.05 exactly, is enclosed. In this time samples are off by more than 1e4 times
the tolerance for the first three pairs, by a hundred times for the wider torus, and by more than ten times the gap for
the stretched one. For the mesh, whose tolerance is wide, they are off by less than the tolerance.

Feeds: figure and table "distances of surfaces".
Takes: 1 minute, half for compilation (40 CPU seconds).
"""

from typing import Any, NamedTuple

import numpy as np
from common import Run, markdown
from common_meshes import bumpy_sphere
from common_parts import beside, bicubic, cpu, diagonal, sampled, sampled_directed, samples, stored, turned, wavy_net
from common_surfaces import surface

import jhd
from jhd._results.solution import name_of

_PATCHES, _SMOKE_PATCHES = 10, 1
_POINTS, _SMOKE_POINTS = 10_000, 400
_NOISE = 1e-3
_ELLIPSOID = "x^2/1.21 + (y - 0.1)^2 + z^2/0.81 - 1"
_CURVE = [[0, 0, 0.2], [0.3, 0.1, 0.3], [0.4, 0.6, -0.1], [0.7, 0.5, 0.3], [0.8, 0.9, 0.1], [1, 1, 0.2]]


class ShapePair(NamedTuple):
    """Two shapes, whether to measure only one direction, and the tolerance as a fraction of the diagonal."""

    name: str
    a: Any
    b: Any
    directed: bool
    share: float


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    found = [_measured(run, pair) for pair in _pairs(run)]
    header = ["pair", "lower", "upper - lower", "of the diagonal", "result", "seconds", "first call", "cells"]
    header += ["samples of each", "seconds", "say", "off by"]
    rows = []
    for pair in found:
        ours, tree = pair["solution"], pair["samples"]
        gap = float(ours.upper - ours.lower)
        cells = sum(int(x) for key, x in ours.stats.items() if key.endswith("cells"))
        row = [pair["name"], f"{float(ours.lower):.9f}", f"{gap:.1e}", f"{gap / pair['diagonal']:.1e}"]
        row += [name_of(ours.result), f"{pair['seconds']:.2f}", f"{pair['first']:.1f}", cells or "-"]
        rows.append([*row, tree["samples"], f"{tree['seconds']:.2f}", f"{tree['value']:.6f}", f"{tree['off']:.1e}"])
    run.save({"pairs": found}, markdown(header, rows))


def _pairs(run: Run) -> list[ShapePair]:
    net = wavy_net(_SMOKE_PATCHES if run.smoke else _PATCHES)
    sheet = bicubic(net)
    rows = samples(sheet, _SMOKE_POINTS if run.smoke else _POINTS)
    cloud = jhd.point_set(rows + _NOISE * run.random.normal(size=rows.shape))
    pairs = [
        ShapePair("sheet, moved sheet", sheet, bicubic(net + 0.01 * run.random.normal(size=net.shape)), False, 1e-10),
        ShapePair("points, sheet", cloud, sheet, True, 1e-10),
    ]
    if run.smoke:
        return pairs
    c, s = np.cos(0.7), np.sin(0.7)
    about_z, about_x = [[c, -s, 0], [s, c, 0], [0, 0, 1]], [[1, 0, 0], [0, c, -s], [0, s, c]]
    return [
        *pairs,
        ShapePair("curve, sheet", jhd.BSplineCurve.clamped(_CURVE), sheet, True, 1e-10),
        ShapePair("torus, wider torus", turned(), turned(0.05).transform(about_z), False, 1e-6),
        ShapePair("torus, stretched torus", turned(), turned(0.05, 0.2).transform(about_x), False, 1e-6),
        ShapePair("ellipsoid, mesh", surface(_ELLIPSOID, -1.8, 1.8), bumpy_sphere(7), False, 1e-4),
    ]


def _measured(run: Run, pair: ShapePair) -> dict[str, Any]:
    size = diagonal(pair.a, pair.b)
    method = jhd.BranchAndBound(atol=pair.share * size)
    entry = jhd.directed_hausdorff if pair.directed else jhd.hausdorff
    solution, first = cpu(lambda: entry(pair.a, pair.b, method, throw=False))
    _, again = (solution, first) if run.smoke else cpu(lambda: entry(pair.a, pair.b, method, throw=False))
    lower, upper = float(solution.lower), float(solution.upper)
    guess = sampled_directed if pair.directed else sampled
    tree = beside(run, lambda count: guess(pair.a, pair.b, count), again)
    tree["off"] = max(lower - tree["value"], tree["value"] - upper, 0.0)
    numbers = {"name": pair.name, "directed": pair.directed, "share": pair.share, "diagonal": size}
    numbers |= {"solution": solution, "seconds": again, "first": first, "samples": tree}
    return numbers | {"a": stored(pair.a), "b": stored(pair.b)}


if __name__ == "__main__":
    main()
