"""Certificates: bounds of a Hausdorff distance together with what proves them, to be checked by anyone later.

`certify` makes one from the curves and a solution, on the host and in a way of its own: cells cover the curves breadth
first (jhd.distance.certificate.covering), and the lower bound is proven at one place. What it returns has been checked
exactly while it was made; `Certificate.verify` checks all of it again, by jhd.distance.certificate.verification alone.
"""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jhd.arrays import is_traced
from jhd.distance.certificate import verification
from jhd.distance.certificate.covering import Measure, UncoveredError, cover
from jhd.distance.certificate.host import host, jets, local_feet
from jhd.distance.certificate.verification import FORMAT, KINDS, VERSION, Proven
from jhd.distance.frame.coordinates import Frame
from jhd.distance.frame.curves import prepare
from jhd.files import replace_file
from jhd.shapes.as_shape import taken_as
from jhd.shapes.curve import AbstractCurve, BezierSegments, check_curve
from jhd.solution import HausdorffSolution, NotProvenError, name_of

# Samples of a segment of the other curve among which the nearest points of the witness are looked for.
_CUT_SAMPLES = 33
# Where the witness of the solution does not prove its lower bound: places tried among those known, then samples of
# each segment, of which the best are zoomed in on, each time by this factor, to the resolution of parameters.
_TRIED, _SAMPLES, _ZOOM, _ZOOMS = 12, 33, 8.0, 16
# A place this much below the lower bound, relative, is not worth an exact check.
_CLEARLY = 1e-9


@dataclass(frozen=True, repr=False)
class Certificate:
    """A claim lower <= distance <= upper about two curves, with what proves it.

    Args:
        content: the JSON object: `format`, `version`, the arrays `a` and `b`, the `claim`, `cells` and the `witness`.

    Raises:
        CertificateError: the content has another structure. Whether it proves its claim is left to `verify`.
    """

    content: dict[str, Any]

    def __post_init__(self) -> None:
        verification.check_structure(self.content)

    @property
    def lower(self) -> float:
        """The claimed lower bound."""
        return float(self.content["claim"]["lower"])

    @property
    def upper(self) -> float:
        """The claimed upper bound; inf where none is claimed."""
        upper = self.content["claim"]["upper"]
        return math.inf if upper is None else float(upper)

    @property
    def directed(self) -> bool:
        """Whether the claim is about the distance from a to b alone."""
        return self.content["claim"]["kind"] == "directed"

    @property
    def cells(self) -> int:
        """Number of cells that prove the upper bound."""
        return sum(map(len, (self.content["cells"] or {}).values()))

    def __repr__(self) -> str:
        name = "h(A, B)" if self.directed else "H(A, B)"
        return f"Certificate({self.lower!r} <= {name} <= {self.upper!r}, {self.cells} cells)"

    def verify(self) -> Proven:
        """Checks every number in exact arithmetic, without anything of the search.

        Returns:
            What is proven.

        Raises:
            CertificateError: a part of the claim is not proven; it says which.
        """
        return verification.verify(self.content)

    def matches(self, a: AbstractCurve, b: AbstractCurve) -> bool:
        """Whether the claim is about these curves: the same control points and weights, to the last digit."""
        return [self.content[name] for name in ("a", "b")] == [_plain_curve(curve.segments()) for curve in (a, b)]

    def to_json(self) -> str:
        """The certificate as JSON text, one cell a line; floats are written so that the same floats are read back."""
        entries = [f"{json.dumps(key)}: {_lines(value)}" for key, value in self.content.items()]
        return "{\n" + ",\n".join(entries) + "\n}\n"

    def save(self, file: str | Path) -> None:
        """Writes the certificate as JSON, as a whole or not at all."""
        replace_file(file, self.to_json())


def certify(
    a: Any,
    b: Any,
    solution: HausdorffSolution,
    *,
    max_cells: int = 100_000,
    progress: Callable[[dict[str, Any]], None] | None = None,
) -> Certificate:
    """A certificate of the bounds of a solution.

    An upper bound of inf and a lower bound of 0, where a method proves none, are not claimed or need no proof.

    Args:
        a: the first curve of the distance, as it was handed in.
        b: the second one.
        solution: what directed_hausdorff or hausdorff returned for them: one, not a batch.
        max_cells: most cells in one direction. A smooth segment takes a handful, more where b is far from smooth.
        progress: called with a dictionary of `direction`, `cells` and `open` after each generation of cells.

    Returns:
        The certificate; every bound of it has been checked in exact arithmetic.

    Raises:
        TypeError: a shape or solution of another kind, a traced one or a batch.
        ValueError: curves of different dimensions, or max_cells that is no positive whole number.
        NotProvenError: a bound of the solution could not be proven of these curves, or takes more cells.
    """
    a, b = taken_as("a", a), taken_as("b", b)
    _check_arguments(a, b, solution, max_cells)
    x, y = a.segments(), b.segments()
    p, q, frame = prepare(x, y)
    first, second = host(x, frame), host(y, frame)
    measures = {"a_to_b": Measure(first, second, q), "b_to_a": Measure(second, first, p)}
    kind = "directed" if solution.directed else "two_sided"
    lower, upper = float(solution.lower), float(solution.upper)
    cells: dict[str, Any] | None = {} if math.isfinite(upper) else None
    for direction in KINDS[kind] if cells is not None else ():
        try:
            found = cover(measures[direction], upper, frame, max_cells, _reporting(progress, direction))
        except UncoveredError as error:
            raise NotProvenError(f"The upper bound {upper!r} is not proven, {direction}: {error}", solution) from error
        cells = {**(cells or {}), direction: found}
    witness = None
    if lower > 0:
        witness = _witness(solution, {name: measures[name] for name in KINDS[kind]}, frame)
    claim = {"kind": kind, "lower": lower, "upper": upper if math.isfinite(upper) else None}
    curves = {"a": _plain_curve(x), "b": _plain_curve(y)}
    content = {"format": FORMAT, "version": VERSION, "claim": claim, **curves, "cells": cells, "witness": witness}
    return Certificate(content)


def _check_arguments(a: object, b: object, solution: object, max_cells: object) -> None:
    check_curve("a", a)
    check_curve("b", b)
    if not isinstance(solution, HausdorffSolution):
        raise TypeError(f"solution must be a HausdorffSolution; got {type(solution).__name__}.")
    if is_traced(a, b, solution) or np.ndim(solution.value) > 0:
        raise TypeError("certify needs concrete curves and one concrete solution; index a batch first.")
    if not isinstance(max_cells, int) or isinstance(max_cells, bool) or max_cells < 1:
        raise ValueError(f"max_cells is {max_cells!r}; needs a positive whole number.")
    dims = [shape.segments().dim for shape in (a, b) if isinstance(shape, AbstractCurve)]
    if dims[0] != dims[1]:
        raise ValueError(f"a has {dims[0]} coordinates a point and b has {dims[1]}; needs the same.")


def _reporting(progress: Callable[[dict[str, Any]], None] | None, direction: str) -> Callable[[int, int], None]:
    def report(proven: int, left: int) -> None:
        if progress is not None:
            progress({"direction": direction, "cells": proven, "open": left})

    return report


def _plain_curve(curve: BezierSegments) -> dict[str, Any]:
    weights = None if curve.weights is None else np.asarray(curve.weights).tolist()
    return {"control_points": np.asarray(curve.control_points).tolist(), "weights": weights}


def _lines(value: Any) -> str:
    """JSON with each cell, each segment and each list of cuts on a line of its own."""
    if isinstance(value, dict) and any(isinstance(item, list) and len(item) > 0 for item in value.values()):
        return "{" + ", ".join(f"{json.dumps(key)}: {_lines(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list) and len(value) > 0:
        return "[\n" + ",\n".join(json.dumps(item, allow_nan=False) for item in value) + "\n]"
    return json.dumps(value, allow_nan=False)


# ---- the lower bound -----------------------------------------------------------------------------


def _witness(solution: HausdorffSolution, measures: dict[str, Measure], frame: Frame) -> dict[str, Any]:
    """A place that proves the lower bound, and the cuts that show it.

    Raises:
        NotProvenError: none of those tried does.
    """
    lower = float(solution.lower)
    limit = math.ldexp(lower, -int(frame.first + frame.second)) * (1 - _CLEARLY)
    for direction, segment, t in _candidates(solution, measures, limit):
        cuts = _cuts(measures[direction], segment, t, lower)
        if cuts is not None:
            return {"direction": direction, "segment": segment, "t": t, "cuts": cuts}
    raise NotProvenError(f"The lower bound {lower!r} is not proven: no place of these curves is that far.", solution)


def _candidates(
    solution: HausdorffSolution, measures: dict[str, Measure], limit: float
) -> Iterator[tuple[str, int, float]]:
    """The witness of the solution, the farthest places known, and the farthest found from a dense sample."""
    witness, direction = solution.witness, name_of(solution.direction)
    if direction in measures and 0 <= int(witness.segment) < len(measures[direction].a.rows):
        yield direction, int(witness.segment), float(witness.t)
    yield from _farthest(measures, limit, _TRIED)
    for measure in measures.values():
        count = len(measure.a.rows)
        places = measure(np.repeat(np.arange(count), _SAMPLES), np.tile(np.linspace(0, 1, _SAMPLES), count))
        for k in np.argsort(-places.distance)[:2]:
            _zoom(measure, int(places.segment[k]), float(places.t[k]))
    yield from _farthest(measures, limit, _TRIED)


def _farthest(measures: dict[str, Measure], limit: float, count: int) -> list[tuple[str, int, float]]:
    """The places measured so far that are farthest from the other curve, as far as they are above the limit."""
    found: list[tuple[float, str, int, float]] = []
    for direction, measure in measures.items():
        for places in measure.known:
            rows = zip(places.distance.tolist(), places.segment.tolist(), places.t.tolist(), strict=True)
            found += [(distance, direction, segment, t) for distance, segment, t in rows if distance >= limit]
    return [place[1:] for place in sorted(found, reverse=True)[:count]]


def _zoom(measure: Measure, segment: int, t: float) -> None:
    """Measures ever closer samples about the farthest one."""
    reach = 1 / (_SAMPLES - 1)
    for _ in range(_ZOOMS):
        ts = np.linspace(max(t - reach, 0.0), min(t + reach, 1.0), _SAMPLES)
        places = measure(np.full(_SAMPLES, segment), ts)
        t, reach = float(ts[np.argmax(places.distance)]), reach / _ZOOM


def _cuts(measure: Measure, segment: int, t: float, lower: float) -> list[list[float]] | None:
    """For each segment of the other curve cuts that show it to be no nearer to the place than `lower`; None if not."""
    point = verification.restricted(measure.a.exact[segment], [t])
    place = np.asarray(jets(measure.a, np.array([segment]), np.array([t]))[0])

    def failed(part: verification.Part) -> bool:
        return verification.failure_at_least(*verification.distance_sq(point, part), lower) is not None

    cuts = []
    for index, other in enumerate(measure.b.exact):
        tried = [0.0, 1.0]
        if failed(other):
            tried = _nearby(measure, index, place)
            if any(failed(verification.restricted(other, pair)) for pair in zip(tried[:-1], tried[1:], strict=True)):
                return None
        cuts.append(tried)
    return cuts


def _nearby(measure: Measure, index: int, place: np.ndarray) -> list[float]:
    """0, the parameters of the local minima of the distance to the place, and 1."""
    s = np.linspace(0.0, 1.0, _CUT_SAMPLES)
    segments = np.full(s.shape, index)
    squares = np.sum((jets(measure.b, segments, s)[0] - place) ** 2, axis=-1)
    padded = np.pad(squares, 1, constant_values=np.inf)
    low = (squares <= padded[:-2]) & (squares <= padded[2:])
    minima = local_feet(measure.b, segments[low], s[low], np.broadcast_to(place, (int(low.sum()), place.shape[-1])), 8)
    return [0.0, *sorted({float(x) for x in minima} - {0.0, 1.0}), 1.0]
