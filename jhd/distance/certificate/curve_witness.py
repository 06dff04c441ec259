"""The witness of a certificate of two curves: a place of one of them, and cuts of the other that show how far it is.

The place of the solution comes first; where it does not prove the bound, the farthest ones that the cover has met, and
those found from a dense sample. Whatever is proposed is checked exactly.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from jhd._results.solution import Decision, HausdorffSolution, NotProvenError, name_of
from jhd.decimals import lower_text
from jhd.distance.certificate.covering import Measure
from jhd.distance.certificate.host import jets, local_feet
from jhd.distance.certificate.verification.proofs import failure_of_witness, point_of
from jhd.distance.frame.coordinates import Frame

# Samples of a segment of the other curve among which the nearest points of the witness are looked for.
_CUT_SAMPLES = 33
# Where the witness of the solution does not prove its lower bound: places tried among those known, then samples of
# each segment, of which the best are zoomed in on, each time by this factor, to the resolution of parameters.
_TRIED, _SAMPLES, _ZOOM, _ZOOMS = 12, 33, 8.0, 16
# A place this much below the lower bound, relative, is not worth an exact check.
_CLEARLY = 1e-9


def witness_of(
    solution: HausdorffSolution | Decision, lower: float, measures: dict[str, Measure], frame: Frame
) -> dict[str, Any]:
    """A place that proves the lower bound, and the cuts that show it.

    Raises:
        NotProvenError: none of those tried does.
    """
    limit = math.ldexp(lower, -int(frame.first + frame.second)) * (1 - _CLEARLY)
    for direction, segment, t in _candidates(solution, measures, limit):
        cuts = _cuts(measures[direction], segment, t, lower)
        if cuts is not None:
            at = [t] if measures[direction].a.exact[segment].corners else []
            uncut = all(len(ends) == 2 for ends in cuts)
            return {"direction": direction, "piece": segment, "at": at, "cuts": None if uncut else cuts}
    raise NotProvenError(
        f"The lower bound {lower_text(lower)} is not proven: no place of these curves is that far.", solution
    )


def _candidates(
    solution: HausdorffSolution | Decision, measures: dict[str, Measure], limit: float
) -> Iterator[tuple[str, int, float]]:
    """The witness of the solution, the farthest places known, and the farthest found from a dense sample."""
    if isinstance(solution, HausdorffSolution):
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
    piece = measure.a.exact[segment]
    point = point_of(piece, [t] if piece.corners else [])
    place = np.asarray(jets(measure.a, np.array([segment]), np.array([t]))[0])
    cuts = []
    for index, other in enumerate(measure.b.exact):
        tried = [0.0, 1.0]
        if failure_of_witness(point, other, lower) is not None:
            if not other.corners:
                return None
            tried = _nearby(measure, index, place)
            if any(failure_of_witness(point, other, lower, ends) for ends in zip(tried[:-1], tried[1:], strict=True)):
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
