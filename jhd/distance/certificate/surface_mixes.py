"""The proofs of a certificate of two shapes of which one at least is a polynomial surface: as in mixes, of other cells.

A place of a surface is written down with a way across it, along which the polynomial changes its sign.
"""

import math
from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from jhd._results.solution import Decision, HausdorffSolution, MinimumSolution, NotProvenError, name_of
from jhd.decimals import lower_text, upper_text
from jhd.distance.certificate.mixes import Report, ToProve
from jhd.distance.certificate.sides import ShapeSide, on_triangle
from jhd.distance.certificate.subdivision import UncoveredError
from jhd.distance.certificate.surface_cover import Side, cover_with_surfaces
from jhd.distance.certificate.surface_pairs import keep_surfaces_apart, part_of_point, parts_of
from jhd.distance.certificate.surface_side import SurfaceSide
from jhd.distance.certificate.verification.pieces import difference
from jhd.distance.certificate.verification.proofs import as_piece, failure_at_most, failure_of_witness, point_of
from jhd.distance.certificate.verification.structure import KINDS
from jhd.distance.certificate.verification.values import CertificateError
from jhd.distance.certificate.verification.zeros import NearZero, place_of
from jhd.shapes.implicit import ImplicitSurface

# Lengths of ways across a surface that are tried, as shares of the size of its box.
_WAYS = (0.0, *(2.0**k for k in range(-52, -24, 3)))
# Places this near to a face of the box, as a share of its size, are looked for on it.
_AT_FACE = 2.0**-44
# Witnesses that are tried, and where none is known: samples, rounds of more about the farthest, and how many each.
_WITNESSES, _SAMPLED, _ROUNDS, _EACH = 3, 200, 12, 8
# Steps in turn from a foot on one shape to that on the other.
_TURNS = 6
# Parameters below this are zero: tiny numbers would make long integers.
_TINY = 1e-15


def side_of(shape: Any, hints: np.ndarray) -> Side:
    """A shape on the host, in the unit of its coordinates."""
    return SurfaceSide(shape, hints) if isinstance(shape, ImplicitSurface) else ShapeSide(shape, 0)


def prove_surface_mix(a: Any, b: Any, asked: ToProve, max_cells: int, report: Report) -> tuple[Any, Any]:
    """The cells of each direction and the pairs of the witness, and the witness; None where no bound needs them.

    Raises:
        NotProvenError: a bound could not be proven of these shapes, or takes more cells.
    """
    hints = _hints(asked.solution)
    sides = {"a": side_of(a, hints), "b": side_of(b, hints)}
    cells: dict[str, list[dict[str, Any]]] = {}
    for direction in KINDS[asked.kind] if math.isfinite(asked.upper) else ():
        source, target = sides[direction[0]], sides[direction[-1]]
        try:
            found = cover_with_surfaces(source, target, asked.upper, max_cells, partial(report, direction))
        except UncoveredError as error:
            reason = f"The upper bound {upper_text(asked.upper)} is not proven, {direction}: {error}"
            raise NotProvenError(reason, asked.solution) from error
        cells[direction] = found.entries
    witness = None
    if asked.lower > 0:
        witness, pairs = _witness(asked, sides, max_cells, report)
        if pairs is not None:
            cells["witness"] = pairs
    return cells or None, witness


def _hints(solution: HausdorffSolution | Decision) -> np.ndarray:
    if not isinstance(solution, HausdorffSolution):
        return np.zeros((0, 3))
    witness = solution.witness
    return np.concatenate([np.asarray(witness.point, float)[None], np.asarray(witness.feet, float)])


# ---- from below ----------------------------------------------------------------------------------


def _witness(
    asked: ToProve, sides: dict[str, Side], max_cells: int, report: Report
) -> tuple[dict[str, Any], list[dict[str, Any]] | None]:
    """A place that proves the lower bound, and the pairs of it and parts of the other shape, if this is a surface.

    Raises:
        NotProvenError: none of those tried does.
    """
    reason = "no place of these shapes is that far."
    for direction, point in _candidates(asked, sides):
        source, target = sides[direction[0]], sides[direction[-1]]
        found = _place(source, point)
        if found is None:
            continue
        place, near = found
        bound = Fraction(asked.lower) + near.reach
        witness = {"direction": direction, **place, "cuts": None}
        if not isinstance(target, SurfaceSide):
            if all(failure_of_witness(near.point, piece, bound) is None for piece in target.exact):
                return witness, None
            continue
        if _distance(target, np.asarray(point)) < asked.lower * (1 - 1e-9):
            continue
        try:
            mine = part_of_point(as_piece(near.point))
            _, pairs = keep_surfaces_apart(
                mine, parts_of(target, is_ordered=False), bound, max_cells, partial(report, "witness")
            )
        except UncoveredError as error:
            reason = str(error)
            continue
        return witness, pairs
    raise NotProvenError(f"The lower bound {lower_text(asked.lower)} is not proven: {reason}", asked.solution)


def _candidates(asked: ToProve, sides: dict[str, Side]) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(asked.solution, HausdorffSolution):
        direction = name_of(asked.solution.direction)
        if direction in KINDS[asked.kind]:
            yield direction, np.asarray(asked.solution.witness.point, float)
    for direction in KINDS[asked.kind]:
        yield from ((direction, point) for point in _far_places(sides[direction[0]], sides[direction[-1]]))


def _far_places(source: Side, target: Side) -> list[np.ndarray]:
    """Places of the source that are far from the target, the farthest first."""
    draw = np.random.default_rng(0)
    points = source.samples(draw, _SAMPLED)
    distances = np.array([_distance(target, point) for point in points])
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for k in range(_ROUNDS):
        best = points[np.argmax(distances)]
        more = source.beside(best + size * 0.4 ** (k + 2) * draw.normal(size=(_EACH, 3)))
        points = np.concatenate([points, more])
        distances = np.concatenate([distances, [_distance(target, point) for point in more]])
    return list(points[np.argsort(-distances)[:_WITNESSES]])


def _distance(target: Side, point: np.ndarray) -> float:
    if isinstance(target, SurfaceSide):
        feet = target.near(point)
        return feet[0].distance if feet else math.inf
    return float(target.feet(point[None]).distance[0])


def _place(side: Side, point: np.ndarray) -> tuple[dict[str, Any], NearZero] | None:
    """The place of a shape next to a point, as certificates have it and as it is checked; None where none is proven."""
    if isinstance(side, SurfaceSide):
        return _place_on_surface(side, point)
    found = side.feet(point[None])
    x = np.where(found.x[0] < _TINY, 0.0, found.x[0])
    x = on_triangle(x) if side.corners == (3,) else x
    piece, at = int(found.piece[0]), [float(t) for t in x]
    return {"piece": piece, "at": at}, NearZero(point_of(side.exact[piece], at), Fraction(0))


def _place_on_surface(side: SurfaceSide, point: np.ndarray) -> tuple[dict[str, Any], NearZero] | None:
    foot = side.foot(point, point)
    if foot is None:
        return None
    for near in (_AT_FACE * side.size, 0.0):
        low, high = foot.point - side.lower <= near, side.upper - foot.point <= near
        at = np.where(low, side.lower, np.where(high, side.upper, foot.point))
        # A way across a face would leave the box.
        slope = np.where(low | high, 0.0, side.slopes(at))
        length = float(np.linalg.norm(slope))
        for share in _WAYS if length > 0 else _WAYS[:1]:
            way = share * side.size * slope / max(length, 1e-300)
            place = {"at": side.without_tiny(at).tolist(), "way": side.without_tiny(way).tolist()}
            try:
                return place, place_of(side.zeros, place, "witness")
            except CertificateError:
                continue
    return None


# ---- least distances -----------------------------------------------------------------------------


def prove_surface_minimum(
    a: Any, b: Any, solution: MinimumSolution | Decision, bounds: tuple[float, float], max_cells: int, report: Report
) -> dict[str, Any]:
    """The claim, the orders of the pieces, the pairs of parts and the two places, as in mixes.

    Raises:
        NotProvenError: a bound could not be proven of these shapes, or takes more pairs.
    """
    lower, upper = bounds
    points = np.array([solution.point_a, solution.point_b], float)
    sides = [side_of(shape, points) for shape in (a, b)]
    witness, cells, orders = None, None, {"a": None, "b": None}
    if math.isfinite(upper):
        witness = _closest(sides, points, upper)
        if witness is None:
            reason = f"The upper bound {upper_text(upper)} is not proven: no places of these shapes are that near."
            raise NotProvenError(reason, solution)
    if lower > 0:
        parts = [parts_of(side) for side in sides]
        try:
            orders, pairs = keep_surfaces_apart(parts[0], parts[1], lower, max_cells, partial(report, "apart"))
        except UncoveredError as error:
            raise NotProvenError(f"The lower bound {lower_text(lower)} is not proven: {error}", solution) from error
        cells = {"apart": pairs}
    claim = {"kind": "minimum", "lower": lower, "upper": upper if math.isfinite(upper) else None}
    return {"claim": claim, "orders": orders, "cells": cells, "witness": witness}


def _closest(sides: list[Side], points: np.ndarray, upper: float) -> dict[str, Any] | None:
    """A place on each shape, proven to be at most `upper` apart; None where none is found."""
    for _ in range(_TURNS):
        first, second = (_place(side, point) for side, point in zip(sides, points, strict=True))
        if first is None or second is None:
            return None
        (place, p), (other, q) = first, second
        most = Fraction(upper) - p.reach - q.reach
        if most >= 0 and failure_at_most([difference(p.point, q.point)], most, None) is None:
            return {"a": place, "b": other}
        points = np.array([_floats(q), _floats(p)])
    return None


def _floats(place: NearZero) -> np.ndarray:
    weight = place.point.weight[0]
    return np.array([f.get(0, 0) / weight for f in place.point.coordinates])
