"""Proofs of a certificate for two shapes of any kinds.

For a Hausdorff distance, cells prove the upper bound and a point proves the lower bound. For a minimum distance, pairs
of parts prove the lower bound and a point on each shape proves the upper bound.

Bounds as sharp as the solution's would need a cell for each of the last digits, so the proven ones may be a little
wider.
"""

import math
from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import partial
from typing import NamedTuple

import numpy as np

from jhd._distance.certificate.closest_pairs import PointSide, keep_apart
from jhd._distance.certificate.cutting import Entry, UncoveredError
from jhd._distance.certificate.cutting import Report as PartReport
from jhd._distance.certificate.shape_side import ShapeSide
from jhd._distance.certificate.sides import AbstractSide, ShapePlace
from jhd._distance.certificate.subdivision import CellCover, cover_by_cells, far_places
from jhd._distance.certificate.surface_cover import cover_with_surfaces
from jhd._distance.certificate.surface_side import SurfaceSide
from jhd._distance.certificate.verification.inequalities import is_hull_at_most
from jhd._distance.certificate.verification.pieces import difference
from jhd._distance.certificate.verification.proofs import as_piece, failure_of_witness
from jhd._distance.certificate.verification.structure import KINDS
from jhd._results.solution import Decision, HausdorffSolution, MinimumSolution, NotProvenError, name_of
from jhd._runtime.decimals import lower_text, upper_text
from jhd._shapes.as_shape import Shape
from jhd._shapes.implicit import ImplicitSurface

# Candidates next to implicit surfaces if none is known: samples, rounds of more around the farthest, and their number
# in each round.
_SAMPLED, _ROUNDS, _EACH = 200, 12, 8

Report = Callable[[str, int, int], None]


def _sides(a: Shape, b: Shape, hints: np.ndarray) -> dict[str, AbstractSide]:
    """Return both shapes on the host; if one is an implicit surface, in the unit of their coordinates."""
    if isinstance(a, ImplicitSurface) or isinstance(b, ImplicitSurface):
        frame: tuple[int, np.ndarray | float] = 0, 0.0
    else:
        both = np.array([shape.bounds for shape in (a, b)], float)
        low, high = both[:, 0].min(axis=0), both[:, 1].max(axis=0)
        size = max(float(np.max(0.5 * high - 0.5 * low)), 1e-300)
        frame = int(math.frexp(size)[1]), 0.5 * low + 0.5 * high
    return {
        name: SurfaceSide(shape, hints) if isinstance(shape, ImplicitSurface) else ShapeSide(shape, *frame)
        for name, shape in (("a", a), ("b", b))
    }


# ---- largest distances ---------------------------------------------------------------------------


class ToProve(NamedTuple):
    """A claim to prove: "directed" or "two_sided", the bounds, and the solution that they come from."""

    kind: str
    lower: float
    upper: float
    solution: HausdorffSolution | Decision


def asked_of(solution: HausdorffSolution | Decision, directed: bool, slack: float) -> ToProve:
    """Return the claim of a solution, or of the bound that answers a decision, widened by `slack`."""
    if isinstance(solution, Decision):
        directed = directed or solution.distance == "directed"
    elif directed and not solution.directed:
        raise ValueError(
            "directed is True, but the solution is two-sided: pass the one of jhd.directed_hausdorff(a, b)."
        )
    else:
        directed = solution.directed
    return ToProve("directed" if directed else "two_sided", *_bounds_of(solution, slack), solution)


def _bounds_of(solution: HausdorffSolution | MinimumSolution | Decision, slack: float) -> tuple[float, float]:
    """Return the bounds, widened by `slack`; for a decision that is made, only the bound that answers it."""
    answer = name_of(solution.answer) if isinstance(solution, Decision) else ""
    lower = 0.0 if answer == "yes" else float(solution.lower)
    upper = math.inf if answer == "no" else float(solution.upper)
    return max(lower - slack, 0.0), upper + slack


def prove_largest(
    a: Shape, b: Shape, asked: ToProve, max_cells: int, report: Report
) -> tuple[dict[str, list[Entry]] | None, Entry | None]:
    """Return the cells of each direction and the pairs of the witness, and the witness; None if no bound needs them.

    Raises:
        NotProvenError: a bound could not be proven for these shapes, or needs more cells.
    """
    sides = _sides(a, b, _hints(asked.solution))
    covers: dict[str, CellCover] = {}
    for direction in KINDS[asked.kind] if math.isfinite(asked.upper) else ():
        source, target = sides[direction[0]], sides[direction[-1]]
        try:
            covers[direction] = _covered(source, target, asked.upper, max_cells, partial(report, direction))
        except UncoveredError as error:
            reason = f"The upper bound {upper_text(asked.upper)} is not proven, {direction}: {error}"
            raise NotProvenError(reason, asked.solution) from error
    witness, cells = None, {name: cover.entries for name, cover in covers.items()}
    if asked.lower > 0:
        witness, pairs = _witness(asked, sides, covers, max_cells, report)
        if pairs is not None:
            cells["witness"] = pairs
    return cells or None, witness


def _hints(solution: HausdorffSolution | Decision) -> np.ndarray:
    if not isinstance(solution, HausdorffSolution):
        return np.zeros((0, 3))
    witness = solution.witness
    return np.concatenate([np.asarray(witness.point, float)[None], np.asarray(witness.feet, float)])


def _covered(source: AbstractSide, target: AbstractSide, upper: float, max_cells: int, report: PartReport) -> CellCover:
    if isinstance(source, ShapeSide) and isinstance(target, ShapeSide):
        return cover_by_cells(source, target, upper, max_cells, report)
    return CellCover(cover_with_surfaces(source, target, upper, max_cells, report), [])


def _witness(
    asked: ToProve, sides: dict[str, AbstractSide], covers: dict[str, CellCover], max_cells: int, report: Report
) -> tuple[Entry, list[Entry] | None]:
    """Return a point that proves the lower bound; if the other shape is a surface, also the pairs of its parts.

    Raises:
        NotProvenError: no point that was tried proves the bound.
    """
    reason = "no point of these shapes is that far; pass them in the order of the call."
    for direction, place in _candidates(asked, sides, covers):
        if place is None:
            continue
        target, point = sides[direction[-1]], place.near.point
        bound, pairs = Fraction(asked.lower) + place.near.reach, None
        if target.zeros is not None:
            here = place.point
            # A point this much nearer than the lower bound, as a fraction of it, is not worth an exact check.
            if target.distance(here) < asked.lower * (1 - 1e-9):
                continue
            mine = PointSide(as_piece(point), here)
            try:
                _, pairs = keep_apart(mine, target, bound, max_cells, partial(report, "witness"), is_ordered=False)
            except UncoveredError as error:
                reason = str(error)
                continue
        elif any(failure_of_witness(point, piece, bound) for piece in target.exact):
            continue
        return {"direction": direction, **place.entry, "cuts": None}, pairs
    raise NotProvenError(f"The lower bound {lower_text(asked.lower)} is not proven: {reason}", asked.solution)


def _candidates(
    asked: ToProve, sides: dict[str, AbstractSide], covers: dict[str, CellCover]
) -> Iterator[tuple[str, ShapePlace | None]]:
    """Return the witness of the solution, the farthest corners of cells, and points found by a search."""
    if isinstance(asked.solution, HausdorffSolution):
        direction, witness = name_of(asked.solution.direction), asked.solution.witness
        if direction in KINDS[asked.kind]:
            t = np.atleast_1d(np.asarray(witness.t, float))
            yield direction, sides[direction[0]].named(int(witness.element), t, np.asarray(witness.point, float))
    for name, cover in covers.items():
        yield from ((name, sides[name[0]].named(*place)) for place in cover.farthest)
    for name in KINDS[asked.kind]:
        source, target = sides[name[0]], sides[name[-1]]
        if isinstance(source, ShapeSide) and isinstance(target, ShapeSide):
            yield from ((name, source.named(*place)) for place in far_places(source, target))
        else:
            yield from ((name, source.place(point)) for point in _far_points(source, target))


def _far_points(source: AbstractSide, target: AbstractSide) -> list[np.ndarray]:
    """Return points of the source that are far from the target, the farthest first."""
    if not source.is_found:
        return []
    draw = np.random.default_rng(0)
    points = source.samples(draw, _SAMPLED)
    distances = np.array([target.distance(point) for point in points])
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for k in range(_ROUNDS):
        best = points[np.argmax(distances)]
        more = source.beside(best + size * 0.4 ** (k + 2) * draw.normal(size=(_EACH, 3)))
        points = np.concatenate([points, more])
        distances = np.concatenate([distances, [target.distance(point) for point in more]])
    # Candidates that are tried.
    return list(points[np.argsort(-distances)[:3]])


# ---- least distances -----------------------------------------------------------------------------


def prove_minimum(
    a: Shape, b: Shape, solution: MinimumSolution | Decision, slack: float, max_cells: int, report: Report
) -> Entry:
    """Return the claim, the orders of the pieces, the pairs of parts and the two points.

    Raises:
        NotProvenError: a bound of the solution could not be proven for these shapes to within slack, or needs more
        pairs.
    """
    lower, upper = _bounds_of(solution, slack)
    points = np.array([solution.point_a, solution.point_b], float)
    sides = _sides(a, b, points)
    witness, cells, orders = None, None, {"a": None, "b": None}
    if math.isfinite(upper):
        witness = _closest(sides, points, upper)
        if witness is None:
            reason = f"The upper bound {upper_text(upper)} is not proven: no points of these shapes are that near."
            raise NotProvenError(reason, solution)
    if lower > 0:
        try:
            orders, pairs = keep_apart(
                sides["a"], sides["b"], lower, max_cells, partial(report, "apart"), points[1] - points[0]
            )
        except UncoveredError as error:
            raise NotProvenError(f"The lower bound {lower_text(lower)} is not proven: {error}", solution) from error
        cells = {"apart": pairs}
    claim = {"kind": "minimum", "lower": lower, "upper": upper if math.isfinite(upper) else None}
    return {"claim": claim, "orders": orders, "cells": cells, "witness": witness}


def _closest(sides: dict[str, AbstractSide], points: np.ndarray, upper: float) -> Entry | None:
    """Return a point on each shape, proven to be at most `upper` apart; None if none is found."""
    # Steps in turn from a foot on one shape to that on the other.
    for _ in range(6):
        first, second = (side.place(point) for side, point in zip(sides.values(), points, strict=True))
        if first is None or second is None:
            return None
        most = Fraction(upper) - first.near.reach - second.near.reach
        if most >= 0 and is_hull_at_most(difference(first.near.point, second.near.point), most):
            return {"a": first.entry, "b": second.entry}
        points = np.array([second.point, first.point])
    return None
