"""The proofs of a certificate of any two shapes: cells for the upper bound, and a place for the lower one.

Bounds that are as sharp as the solution's would need a cell for each of the last digits, so they may be a little wider.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from jhd.distance.certificate.covering import UncoveredError
from jhd.distance.certificate.host import plain_shape
from jhd.distance.certificate.sides import ShapeSide
from jhd.distance.certificate.subdivision import CellCover, cover_by_cells
from jhd.distance.certificate.verification.proofs import failure_of_witness, point_of
from jhd.distance.certificate.verification.structure import KINDS
from jhd.solution import HausdorffSolution, NotProvenError, name_of

# How much wider than the solution's the bounds may be by default, as a share of the diagonal of the box of both shapes.
_SLACK = 1e-9
# Parameters below this are zero: tiny numbers would make long integers.
_TINY = 1e-15

Report = Callable[[str, int, int], None]


def default_atol(a: Any, b: Any) -> float:
    """A billionth of the diagonal of the box of both shapes."""
    low, high = _ends(a, b)
    return _SLACK * float(np.linalg.norm(high - low))


def prove_mix(
    a: Any, b: Any, solution: HausdorffSolution, atol: float, max_cells: int, report: Report
) -> tuple[dict[str, Any], dict[str, Any] | None, dict[str, Any] | None]:
    """The claim, the cells of each direction, and the witness.

    Raises:
        NotProvenError: a bound of the solution could not be proven of these shapes to within atol, or takes more cells.
    """
    low, high = _ends(a, b)
    exponent = int(math.frexp(max(float(np.max(np.abs([low, high]))), 1e-300))[1])
    sides = {"a": ShapeSide(a, exponent), "b": ShapeSide(b, exponent)}
    kind = "directed" if solution.directed else "two_sided"
    upper = float(solution.upper) + atol
    covers: dict[str, CellCover] = {}
    for direction in KINDS[kind] if math.isfinite(upper) else ():
        source, target = sides[direction[0]], sides[direction[-1]]
        try:
            covers[direction] = cover_by_cells(
                source, target, upper, max_cells, lambda proven, left, name=direction: report(name, proven, left)
            )
        except UncoveredError as error:
            reason = f"The upper bound {upper!r} is not proven, {direction}: {error}"
            raise NotProvenError(reason, solution) from error
    lower = max(float(solution.lower) - atol, 0.0)
    witness = None
    if lower > 0:
        known = {name: cover.farthest for name, cover in covers.items()}
        witness = _witness(solution, sides, known, lower, KINDS[kind])
    claim = {"kind": kind, "lower": lower, "upper": upper if math.isfinite(upper) else None}
    return claim, {name: cover.entries for name, cover in covers.items()} or None, witness


def _ends(a: Any, b: Any) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the box of both shapes."""
    rows = []
    for shape in (a, b):
        plain = plain_shape(shape)
        numbers = np.asarray(plain["vertices"] if plain["kind"] == "mesh" else plain["control_points"], float)
        rows.append(numbers.reshape(-1, numbers.shape[-1]))
    both = np.concatenate(rows)
    return both.min(axis=0), both.max(axis=0)


def _witness(
    solution: HausdorffSolution,
    sides: dict[str, ShapeSide],
    known: dict[str, list[tuple[int, np.ndarray]]],
    lower: float,
    directions: Sequence[str],
) -> dict[str, Any]:
    """A place that proves the lower bound: that of the solution, or the farthest corner of a cell.

    Raises:
        NotProvenError: none of those tried does.
    """
    for direction, piece, at in _candidates(solution, sides, known, directions):
        point = point_of(sides[direction[0]].exact[piece], at)
        if all(failure_of_witness(point, other, lower) is None for other in sides[direction[-1]].exact):
            return {"direction": direction, "piece": piece, "at": at, "cuts": None}
    raise NotProvenError(f"The lower bound {lower!r} is not proven: no place of these shapes is that far.", solution)


def _candidates(
    solution: HausdorffSolution,
    sides: dict[str, ShapeSide],
    known: dict[str, list[tuple[int, np.ndarray]]],
    directions: Sequence[str],
) -> Iterator[tuple[str, int, list[float]]]:
    direction, piece = name_of(solution.direction), int(solution.witness.segment)
    if direction in directions and 0 <= piece < len(sides[direction[0]].exact):
        yield direction, piece, _inside(sides[direction[0]], np.atleast_1d(np.asarray(solution.witness.t, float)))
    for name, places in known.items():
        for piece, x in places:
            yield name, piece, _inside(sides[name[0]], x)


def _inside(side: ShapeSide, t: np.ndarray) -> list[float]:
    """Parameters in the form and the domain of a piece; of triangles barycentric coordinates are three."""
    triangle = side.corners == (3,)
    x = np.clip(t[1:] if triangle and len(t) == 3 else t[: side.parameters], 0.0, 1.0)
    x = np.where(x < _TINY, 0.0, x)
    if triangle:
        x[1] = min(x[1], 1 - x[0])
    return x.tolist()
