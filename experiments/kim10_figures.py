"""What do distance map, cones and trimmed parts of Kim et al. 2010 look like, and do they keep what they promise?

The curves a, b of each pair have 15 control points; there is one pair for each kind of event. Biarcs replace b. The
map of b stores for each pixel the distance and the nearest arc (figure 8 of the source). Over the plane it is the lower
envelope of cones about the arcs (figure 7). The map is read along a (figure 9). The largest reading, less the
deviation of the arcs and half the diagonal of a pixel, is the lower bound LB. If an arc of a is certified to lie in the
region of radius LB about b, it is trimmed (figures 10 and 17), by the package's exact test. Here only a is trimmed. The
rest of b after trimming both curves, as published, is kept for the picture. With --a A --b B the pair is two given
plane curves.

Claims: at random pixels the certified distance agrees with the stored one within the map's error; LB is below the
distance by less than twice the subtracted errors; the trimmed parts are certified, by branch and bound, to be within LB
of b; the location of the maximum is not trimmed; less than a tenth of a is left.

Feeds: figures "distance map, cones and trimming" and "four pairs" (figures 7 to 10, 17 and 18 of Kim et al. 2010 and
figure 1 of Cao et al. 2014, with data of our own).
Takes: 1 minute, 5 seconds once compiled.
"""

from typing import Any

import numpy as np
from common import Run, markdown
from common_kim10 import KINDS, pair

import jhd
from jhd._distance.normalization.curves import prepare
from jhd._distance.published.arc_bounds import ArcTarget
from jhd._distance.published.events.host_pair import HostPair
from jhd._distance.published.trimming import both_arcs
from jhd._shapes.curve import AbstractCurve

# The pair whose second curve is mapped.
MAPPED, COUNT = "self_bisector", 15
# The name of a pair that the user passes.
GIVEN = "given"
# Deviations as fractions of the diagonal: of the arcs drawn with the map, and of the arcs that trim.
COARSE, FINE = 3e-3, 1e-4
# Pixels along the sides of the map that is read, and of the drawn one; samples of a, about three a pixel.
PIXELS, DRAWN, READ = 512, 240, 6000
# Pixels of the map of each pair; of the samples of a, the figure shows one in EVERY.
SMALL, EVERY = 160, 10
# Number of pixels whose distance is compared with the certified one.
CHECKED = 2000
# Margin of the map around both curves as a fraction of the diagonal, and margin of the region in units of LB.
MARGIN, AROUND = 0.12, 1.15
# Upper limit of the fraction of the curve that is left.
LEFT = 0.1


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, pair=AbstractCurve)
    pixels, drawn, number = (128, 40, 50) if run.smoke else (PIXELS, DRAWN, CHECKED)
    own = {kind: pair(kind, COUNT) for kind in ((MAPPED,) if run.smoke else KINDS)}
    taken: dict[str, Any] = {GIVEN: run.shapes} if run.shapes else own
    pairs = {name: _trimmed(first, second, pixels, drawn) for name, (first, second) in taken.items()}
    mapped = GIVEN if run.shapes else MAPPED
    for kind, found in pairs.items():
        if kind != GIVEN and found["share_left"] >= LEFT:
            raise AssertionError(f"{found['share_left']:g} of a is left")
    b, (low, high), diagonal = (pairs[mapped][key] for key in ("b", "box", "diagonal"))
    field = jhd.distance_map(jhd.biarcs(b, COARSE * diagonal), low, high, drawn)
    checked = _checked(field, b, run.random, number)
    numbers = {"count": COUNT, "mapped": mapped, "map": _stored(field), "checked": checked, "pairs": pairs}
    run.save(numbers, _table(pairs) + "\n\n" + _map_table(checked))


def _stored(field: jhd.DistanceMap) -> dict[str, Any]:
    """Return the map for drawing, and its arcs as rational segments."""
    arcs = field.arcs.segments()
    return {
        **_drawn(field),
        "nearest": field.nearest,
        "arcs": {"control_points": arcs.control_points, "weights": arcs.weights},
        "deviation": np.max(np.asarray(field.arcs.deviation)),
    }


def _drawn(field: jhd.DistanceMap) -> dict[str, Any]:
    """Return distances to five digits, for drawing."""
    return {"x": field.centers[0], "y": field.centers[1], "distance": np.round(np.asarray(field.distance), 5)}


def _checked(
    field: jhd.DistanceMap, b: jhd.BezierSegments, random: np.random.Generator, number: int
) -> dict[str, float]:
    """Compare stored and certified distances at random pixels; the largest difference may not exceed the error."""
    i, j = (random.integers(0, size, number) for size in field.distance.shape)
    x, y = (np.asarray(center) for center in field.centers)
    found = jhd.project(np.stack([x[i], y[j]], axis=1), b)
    stored = np.asarray(field.distance)[i, j]
    off = np.maximum(np.asarray(found.lower) - stored, stored - np.asarray(found.upper))
    largest, error = float(np.max(off)), float(field.error)
    if largest > error:
        raise AssertionError(f"the map is off by {largest:g}; its error is {error:g}")
    return {"pixels": number, "largest": largest, "error": error}


def _trimmed(first: AbstractCurve, second: AbstractCurve, pixels: int, drawn: int) -> dict[str, Any]:
    """Return the published lower bound, the parts of a that it leaves, and the check of both."""
    a, b = first.segments(), second.segments()
    low, high = (np.asarray(x) for x in jhd.BezierSegments.join([a, b]).bounds)
    diagonal = float(np.linalg.norm(high - low))
    box = low - MARGIN * diagonal, high + MARGIN * diagonal
    certified = jhd.directed_hausdorff(a, b)
    field = jhd.distance_map(jhd.biarcs(b, FINE * diagonal), *box, pixels)
    along = np.linspace(0, a.count, READ)
    read = np.asarray(field.enclose(a(along)).lower)
    lower = float(np.max(read))
    if not 0 <= float(certified.lower) - lower <= 2 * float(field.max_error):
        raise AssertionError(
            f"LB is {lower:g}; the distance is {certified}, the subtracted error {float(field.max_error):g}"
        )
    p, q, frame = prepare(a, b)
    mine, others = both_arcs(HostPair.of(p, q), float(frame.common(FINE * diagonal)))
    limit = float(frame.common(lower))
    left = ArcTarget(others).reach_by_quarters(mine) >= limit
    segment, t0, t1 = mine.segment, mine.t0, mine.t1
    parts = [_part(a, *place) for place in zip(segment[~left], t0[~left], t1[~left], strict=True)]
    farthest = jhd.directed_hausdorff(jhd.BezierSegments.join(parts), b)
    if float(farthest.upper) > lower:
        raise AssertionError(f"a trimmed part is {farthest} from b; LB is {lower:g}")
    place = int(certified.witness.element), float(certified.witness.t)
    if not np.any((segment[left] == place[0]) & (t0[left] <= place[1]) & (place[1] <= t1[left])):
        raise AssertionError(f"the place of the maximum, {place}, is trimmed")
    share = float(np.sum((t1 - t0)[left])) / a.count
    left_of_b = ArcTarget(mine).reach_by_quarters(others) >= limit
    coarse = jhd.distance_map(jhd.biarcs(b, COARSE * diagonal), *box, min(SMALL, drawn))
    return {
        "a": a,
        "b": b,
        "box": box,
        "diagonal": diagonal,
        "region": _drawn(jhd.distance_map(field.arcs, low - AROUND * lower, high + AROUND * lower, drawn // 2)),
        "solution": certified,
        "lower": lower,
        "max_error": field.max_error,
        "pixels": pixels,
        "arcs": {"a": len(t0), "b": len(others.t0)},
        "deviation": FINE * diagonal,
        "map": _stored(coarse),
        "profile": {"t": along[::EVERY], "lower": np.round(read[::EVERY], 6)},
        "parts": {"segment": segment, "t0": t0, "t1": t1, "left": left},
        # As published, b is trimmed by this bound too, which belongs to the larger direction here.
        "parts_of_b": {"segment": others.segment, "t0": others.t0, "t1": others.t1, "left": left_of_b},
        "share_left": share,
        "share_left_of_b": float(np.sum((others.t1 - others.t0)[left_of_b])) / b.count,
        "trimmed_reaches": farthest.upper,
        "ours": jhd.directed_hausdorff(a, b, jhd.published.BiarcTrimming()).stats,
    }


def _part(curve: jhd.BezierSegments, segment: int, t0: float, t1: float) -> jhd.BezierSegments:
    """Return a part of one segment."""
    weights = None if curve.weights is None else curve.weights[segment : segment + 1]
    return jhd.BezierSegments(curve.control_points[segment : segment + 1], weights).restrict(t0, t1)


def _table(pairs: dict[str, dict[str, Any]]) -> str:
    header = ["pair", "distance", "LB by the map", "subtracted", "farthest of what is trimmed, upper bound"]
    header += ["arcs of a", "of b", "left of a (%)", "by BiarcTrimming (%)"]
    rows = [
        [
            kind,
            f"{float(found['solution'].value):.9f}",
            f"{found['lower']:.9f}",
            f"{float(found['max_error']):.6f}",
            f"{float(found['trimmed_reaches']):.9f}",
            *found["arcs"].values(),
            f"{100 * found['share_left']:.2f}",
            f"{100 * (1 - float(found['ours']['trimmed'])):.2f}",
        ]
        for kind, found in pairs.items()
    ]
    return markdown(header, rows)


def _map_table(checked: dict[str, float]) -> str:
    rows = [[checked["pixels"], f"{checked['largest']:.2e}", f"{checked['error']:.2e}"]]
    return markdown(["pixels compared", "largest error", "certified error"], rows)


if __name__ == "__main__":
    main()
