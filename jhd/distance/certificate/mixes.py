"""The proofs of a certificate of any two shapes.

Of a largest distance they are cells for the upper bound and a place for the lower one, of a smallest distance pairs of
parts for the lower bound and a place on each shape for the upper one.

Bounds that are as sharp as the solution's would need a cell for each of the last digits, so they may be a little wider.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from jhd._results.solution import Decision, HausdorffSolution, MinimumSolution, NotProvenError, name_of
from jhd.decimals import lower_text, upper_text
from jhd.distance.certificate.closest_pairs import closest_places, keep_apart
from jhd.distance.certificate.sides import ShapeSide, on_triangle, plain_shape
from jhd.distance.certificate.subdivision import CellCover, UncoveredError, cover_by_cells, far_places
from jhd.distance.certificate.verification.proofs import failure_of_witness, point_of
from jhd.distance.certificate.verification.structure import KINDS

# How much wider than the solution's the bounds may be by default, as a share of the diagonal of the box of both shapes.
_SLACK = 1e-9
# Parameters below this are zero: tiny numbers would make long integers.
_TINY = 1e-15

Report = Callable[[str, int, int], None]


def default_atol(a: Any, b: Any) -> float:
    """A billionth of the diagonal of the box of both shapes."""
    low, high = _ends(a, b)
    return _SLACK * float(np.linalg.norm(high - low))


class ToProve(NamedTuple):
    """What is to be proven: "directed" or "two_sided", the bounds, and what they were taken from."""

    kind: str
    lower: float
    upper: float
    solution: HausdorffSolution | Decision


def asked_of(solution: HausdorffSolution | Decision, directed: bool, atol: float) -> ToProve:
    """The bounds of a solution, or the one of a decision that answers, wider by atol."""
    lower, upper = float(solution.lower), float(solution.upper)
    if isinstance(solution, Decision):
        lower, upper = _of_answer(solution)
        directed = directed or solution.distance == "directed"
    else:
        directed = solution.directed
    return ToProve("directed" if directed else "two_sided", max(lower - atol, 0.0), upper + atol, solution)


def _of_answer(decision: Decision) -> tuple[float, float]:
    """The bound that answers, and of the other one nothing; both where it is undecided."""
    answer = name_of(decision.answer)
    return 0.0 if answer == "yes" else float(decision.lower), math.inf if answer == "no" else float(decision.upper)


def prove_mix(a: Any, b: Any, asked: ToProve, max_cells: int, report: Report) -> tuple[Any, Any]:
    """The cells of each direction, and the witness; None where no bound needs them.

    Raises:
        NotProvenError: a bound could not be proven of these shapes, or takes more cells.
    """
    frame = _frame(a, b)
    sides = {"a": ShapeSide(a, *frame), "b": ShapeSide(b, *frame)}
    covers: dict[str, CellCover] = {}
    for direction in KINDS[asked.kind] if math.isfinite(asked.upper) else ():
        source, target = sides[direction[0]], sides[direction[-1]]
        try:
            covers[direction] = cover_by_cells(source, target, asked.upper, max_cells, partial(report, direction))
        except UncoveredError as error:
            reason = f"The upper bound {upper_text(asked.upper)} is not proven, {direction}: {error}"
            raise NotProvenError(reason, asked.solution) from error
    witness = _witness(asked, sides, covers) if asked.lower > 0 else None
    return {name: cover.entries for name, cover in covers.items()} or None, witness


def _ends(a: Any, b: Any) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the box of both shapes."""
    rows = []
    for shape in (a, b):
        plain = plain_shape(shape)
        if plain["kind"] == "surface":
            numbers = np.array([plain["lower"], plain["upper"]], float)
        else:
            numbers = np.asarray(plain["vertices" if plain["kind"] == "mesh" else "control_points"], float)
        rows.append(numbers.reshape(-1, numbers.shape[-1]))
    both = np.concatenate(rows)
    return both.min(axis=0), both.max(axis=0)


def _witness(asked: ToProve, sides: dict[str, ShapeSide], covers: dict[str, CellCover]) -> dict[str, Any]:
    """A place that proves the lower bound: that of the solution, a corner of a cell, or one that is looked for.

    Raises:
        NotProvenError: none of those tried does.
    """
    for direction, piece, at in _candidates(asked, sides, covers):
        point = point_of(sides[direction[0]].exact[piece], at)
        if all(failure_of_witness(point, other, asked.lower) is None for other in sides[direction[-1]].exact):
            return {"direction": direction, "piece": piece, "at": at, "cuts": None}
    reason = f"The lower bound {lower_text(asked.lower)} is not proven: no place of these shapes is that far."
    raise NotProvenError(reason, asked.solution)


def _candidates(
    asked: ToProve, sides: dict[str, ShapeSide], covers: dict[str, CellCover]
) -> Iterator[tuple[str, int, list[float]]]:
    if isinstance(asked.solution, HausdorffSolution):
        direction, witness = name_of(asked.solution.direction), asked.solution.witness
        if direction in KINDS[asked.kind] and 0 <= int(witness.segment) < len(sides[direction[0]].exact):
            yield (
                direction,
                int(witness.segment),
                _inside(sides[direction[0]], np.atleast_1d(np.asarray(witness.t, float))),
            )
    for name, cover in covers.items():
        for piece, x in cover.farthest:
            yield name, piece, _inside(sides[name[0]], x)
    for name in KINDS[asked.kind]:
        for piece, x in far_places(sides[name[0]], sides[name[-1]]):
            yield name, piece, _inside(sides[name[0]], x)


def _inside(side: ShapeSide, t: np.ndarray) -> list[float]:
    """Parameters in the form and the domain of a piece; of triangles barycentric coordinates are three."""
    triangle = side.corners == (3,)
    x = np.clip(t[1:] if triangle and len(t) == 3 else t[: side.parameters], 0.0, 1.0)
    x = np.where(x < _TINY, 0.0, x)
    return (on_triangle(x) if triangle else x).tolist()


def bounds_of_minimum(solution: MinimumSolution | Decision, atol: float) -> tuple[float, float]:
    """The bounds of a minimum distance that are to be proven, as in `asked_of`."""
    is_decision = isinstance(solution, Decision)
    lower, upper = _of_answer(solution) if is_decision else (float(solution.lower), float(solution.upper))
    return max(lower - atol, 0.0), upper + atol


def prove_minimum(
    a: Any, b: Any, solution: MinimumSolution | Decision, atol: float, max_cells: int, report: Report
) -> dict[str, Any]:
    """The claim, the orders of the pieces, the pairs of parts and the two places.

    Raises:
        NotProvenError: a bound of the solution could not be proven of these shapes to within atol, or takes more pairs.
    """
    frame = _frame(a, b)
    first, second = ShapeSide(a, *frame), ShapeSide(b, *frame)
    points = tuple(np.asarray(x, float) for x in (solution.point_a, solution.point_b))
    lower, upper = bounds_of_minimum(solution, atol)
    witness, cells, orders = None, None, {"a": None, "b": None}
    if math.isfinite(upper):
        witness = closest_places(first, second, (points[0], points[1]), upper)
        if witness is None:
            reason = f"The upper bound {upper_text(upper)} is not proven: no places of these shapes are that near."
            raise NotProvenError(reason, solution)
    if lower > 0:
        try:
            orders, pairs = keep_apart(
                first, second, points[1] - points[0], lower, max_cells, lambda done, left: report("apart", done, left)
            )
        except UncoveredError as error:
            raise NotProvenError(f"The lower bound {lower_text(lower)} is not proven: {error}", solution) from error
        cells = {"apart": pairs}
    claim = {"kind": "minimum", "lower": lower, "upper": upper if math.isfinite(upper) else None}
    return {"claim": claim, "orders": orders, "cells": cells, "witness": witness}


def _frame(a: Any, b: Any) -> tuple[int, np.ndarray]:
    """The power of two by which coordinates are divided, and the middle of the box of both shapes."""
    low, high = _ends(a, b)
    return int(math.frexp(max(float(np.max(0.5 * high - 0.5 * low)), 1e-300))[1]), 0.5 * low + 0.5 * high
