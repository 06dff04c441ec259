"""Certificates that must be refused: each differs from a true one so that its claim is false, wholly or in part.

Three groups. `claims`: bounds that contradict a distance known otherwise, from the last digit upward, and bounds of the
other direction or of other pairs. `proofs`: missing or repeated cells of the cover, and false statements about cells,
feet, planes and witnesses that a sampled point contradicts. `shapes`: changed numbers of the shapes, so that the hash
is wrong, the shapes differ from the user's, or the claim is false. If a change leaves the proof valid (for example, a
foot moved by one digit), it is no forgery.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, cycle
from typing import Any, NamedTuple

import numpy as np
from common_certificates import Places, changes, value

from jhd._distance.certificate.verification import digest
from jhd._distance.certificate.verification.cells import half, roots
from jhd._distance.certificate.verification.pieces import ExactPiece, pieces_of
from jhd._distance.certificate.verification.proofs import point_of

Content = dict[str, Any]
# Factor beyond a bound from which floating point shows that the bound is violated.
_CLEARLY = 1.001
# Fraction of all forgeries in each group; if a group yields fewer, claims fill the gap.
_SHARES = {"proofs": 0.3, "shapes": 0.2}
# Consecutive draws without a new forgery, and all draws of one kind of change if few of them may be false.
_TRIES = 60
_DRAWS = 2000
_ARRAYS = ("control_points", "weights", "vertices", "coefficients", "lower", "upper")


class Forgery(NamedTuple):
    """The change, the certificate, and whether to compare it with the shapes that it was made for."""

    group: str
    change: str
    content: Content
    compared: bool = False


class Known(NamedTuple):
    """A true certificate, distance bounds by the search alone, certificates of other pairs, and sampled points."""

    content: Content
    # For "a_to_b", "b_to_a", "two_sided" and "minimum", if known.
    bounds: dict[str, tuple[float, float]]
    others: Sequence[Content]
    places: dict[str, Places]

    @property
    def claim(self) -> dict[str, Any]:
        """Return the claim."""
        return self.content["claim"]

    @property
    def truth(self) -> tuple[float, float]:
        """Return bounds of the claimed distance."""
        kind = self.claim["kind"]
        return self.bounds["a_to_b" if kind == "directed" else kind]


def forgeries(known: Known, random: np.random.Generator, count: int) -> list[Forgery]:
    """Generate `count` different forgeries, or all of them if there are fewer."""
    found: dict[str, Forgery] = {}
    for group, share in _SHARES.items():
        _take(found, group, [way(known, random) for way in _WAYS[group]], round(share * count))
    _take(found, "claims", [way(known, random) for way in _WAYS["claims"]], count - len(found))
    return list(found.values())


def _take(found: dict[str, Forgery], group: str, ways: list[Iterator[tuple]], count: int) -> None:
    """Draw from all iterators in turn, each as long as it yields new forgeries."""
    idle, wanted = dict.fromkeys(range(len(ways)), 0), len(found) + count
    for k in cycle(range(len(ways))):
        if len(found) == wanted or min(idle.values()) > _TRIES:
            return
        drawn = next(ways[k], None) if idle[k] <= _TRIES else None
        key = None if drawn is None else json.dumps(drawn[1:])
        if drawn is None or key in found:
            idle[k] += _TRIES + 1 if drawn is None else 1
        else:
            found[str(key)], idle[k] = Forgery(group, *drawn), 0


# ---- claims --------------------------------------------------------------------------------------


def _above(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Raise the lower bound above the distance; every second forgery claims the lower bound alone."""
    upper = known.truth[1]
    for k, bound in enumerate(chain([np.nextafter(upper, np.inf)], _beyond(upper, 1, random))):
        if not known.claim["lower"] > 0:
            return
        base = known.content if k % 2 else _lower_only(known.content)
        most = base["claim"]["upper"]
        raised = {"lower": bound, "upper": None if most is None else max(most, bound)}
        yield "lower bound too high", _claiming(base, **raised)


def _below(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Lower the upper bound below the distance; every second forgery claims the upper bound alone."""
    lower = known.truth[0]
    for k, bound in enumerate(chain([np.nextafter(lower, 0.0)], _beyond(lower, -1, random))):
        if known.claim["upper"] is None:
            return
        base = known.content if k % 2 else _upper_only(known.content)
        yield "upper bound too low", _claiming(base, min(base["claim"]["lower"], bound), bound)


def _beyond(x: float, sign: int, random: np.random.Generator) -> Iterator[float]:
    """Yield numbers on one side of x, at distances from a few digits to half of x."""
    while True:
        bound = float(x * (1 + sign * 2.0 ** -random.uniform(1, 52)))
        if bound != x:
            yield bound


def _of_others(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Yield claims of other pairs that are false for this pair."""
    for other in known.others:
        lower, upper = (other["claim"][key] for key in ("lower", "upper"))
        above = lower > known.truth[1] and known.claim["lower"] > 0
        below = upper is not None and upper < known.truth[0] and known.claim["upper"] is not None
        if above or below:
            base = known.content
            if upper is None or base["claim"]["upper"] is None:
                base, upper = _lower_only(base), None
            elif not (lower > 0 and base["claim"]["lower"] > 0):
                base, lower = _upper_only(base), 0.0
            yield "claim of another pair", _claiming(base, lower, upper)


def _of_one_direction(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Claim for one direction a bound that holds only for the other direction or for the larger distance."""
    claim, cells = known.claim, known.content["cells"]
    least, most = known.bounds.get("b_to_a", (0.0, np.inf))
    too_high, too_low = most < claim["lower"], claim["upper"] is not None and least > claim["upper"]
    if claim["kind"] == "directed" and (too_high or too_low):
        yield "other direction", _exchanged(known.content)
    for way in ("a_to_b", "b_to_a"):
        if claim["kind"] == "two_sided" and 0 < claim["lower"] and known.bounds[way][1] < claim["lower"]:
            base = known.content if way == "a_to_b" else _exchanged(known.content)
            witness = {**base["witness"], "direction": "a_to_b"}
            kept = {name: cells[name] for name in ("a_to_b", "witness") if cells and name in cells}
            kept |= {"a_to_b": cells[way]} if kept.get("a_to_b") else {}
            claimed = {**claim, "kind": "directed"}
            yield "other direction", {**base, "claim": claimed, "cells": kept or None, "witness": witness}


def _claiming(content: Content, lower: float, upper: float | None) -> Content:
    """Replace the bounds, and limit the bound of each cell to the new upper one."""
    cells = content["cells"]
    if cells and upper is not None:
        lowered = {name: [_at_most(row, upper) for row in rows] for name, rows in cells.items()}
        content = {**content, "cells": lowered}
    return {**content, "claim": {**content["claim"], "lower": float(lower), "upper": upper}}


def _at_most(row: dict[str, Any], upper: float) -> dict[str, Any]:
    return {**row, "bound": min(row["bound"], upper)} if "bound" in row else row


def _lower_only(content: Content) -> Content:
    """Return the certificate of the lower bound alone."""
    cells, claim = content["cells"], {**content["claim"], "upper": None}
    if claim["kind"] == "minimum":
        return {**content, "claim": claim, "witness": None}
    kept = {"witness": cells["witness"]} if cells and "witness" in cells else None
    return {**content, "claim": claim, "cells": kept}


def _upper_only(content: Content) -> Content:
    """Return the certificate of the upper bound alone."""
    claim = {**content["claim"], "lower": 0.0}
    if claim["kind"] == "minimum":
        return {**content, "claim": claim, "cells": None}
    kept = {name: rows for name, rows in (content["cells"] or {}).items() if name != "witness"}
    return {**content, "claim": claim, "cells": kept or None, "witness": None}


def _exchanged(content: Content) -> Content:
    return {**content, "a": content["b"], "b": content["a"]}


# ---- proofs --------------------------------------------------------------------------------------


def _removed(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Remove one cell or several consecutive cells."""
    for section, k, rows in _drawn_cells(known, random):
        last = k + int(random.choice([1, 1, 2, len(rows)]))
        yield "cells removed", _with_rows(known.content, section, rows[:k] + rows[last:])


def _repeated(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Replace a cell by a copy of another cell."""
    for section, k, rows in _drawn_cells(known, random):
        other = int(random.integers(len(rows)))
        if rows[other] != rows[k]:
            yield "a cell twice", _with_rows(known.content, section, [*rows[:k], rows[other], *rows[k + 1 :]])


def _far_feet(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Move all feet of a cell to one point that is farther than the bound from a point of the cell."""
    for section, k, rows in _drawn_cells(known, random, "feet"):
        place, target = _place_in(known.content[section[0]], rows[k]), known.places[section[-1]]
        far = int(random.integers(len(target.points)))
        if place is not None and np.linalg.norm(target.points[far] - place) > _CLEARLY * rows[k]["bound"]:
            changed = {**rows[k], "feet": [_foot(target.names[far])], "multipliers": None}
            yield "foot too far", _with_row(known.content, section, k, changed)


def _one_foot(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Keep the multiplier of one foot only, if the cell's corner is farther from this foot than the bound."""
    for section, k, rows in _drawn_cells(known, random, "multipliers"):
        row, (mine, other) = rows[k], (known.content[section[0]], known.content[section[-1]])
        chosen = int(random.integers(len(row["feet"])))
        foot = row["feet"][chosen]
        if mine["kind"] == "surface" or other["kind"] == "surface":
            continue
        share = 1.0 if foot["weights"] is None else foot["weights"][0]
        there = _point(pieces_of(other)[foot["piece"]], [x / share for x in foot["map"][0]])
        is_far = np.linalg.norm(there - _corners(mine, row)[0]) > _CLEARLY * row["bound"]
        if is_far and row["multipliers"][chosen][0] > 0:
            kept = [m if j == chosen else [0.0] * len(m) for j, m in enumerate(row["multipliers"])]
            yield "multipliers of one foot", _with_row(known.content, section, k, {**row, "multipliers": kept})


def _called_free(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Declare a cell of an implicit surface empty although it holds a zero."""
    for section, k, rows in _drawn_cells(known, random, "zero"):
        if _place_in(known.content[section[0]], rows[k]) is not None:
            changed = {**rows[k], "zero": None, "feet": [], "multipliers": None}
            yield "called empty", _with_row(known.content, section, k, changed)


def _turned(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Exchange the sides of a plane."""
    for section, k, rows in _drawn_cells(known, random, "plane"):
        turned = [-x * float(2.0 ** random.integers(-3, 4)) for x in rows[k]["plane"]]
        yield "plane turned", _with_row(known.content, section, k, {**rows[k], "plane": turned})


def _other_witness(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Replace the witness by a point nearer to the other shape, or a pair farther apart, than the claim."""
    witness, claim = known.content["witness"], known.claim
    for _ in range(_DRAWS):
        if witness is None:
            return
        if claim["kind"] == "minimum":
            p, q = (int(random.integers(len(known.places[name].points))) for name in "ab")
            found = {name: known.places[name].names[k] for name, k in (("a", p), ("b", q))}
            gap = np.linalg.norm(known.places["a"].points[p] - known.places["b"].points[q])
            false = gap > _CLEARLY * claim["upper"]
            base = known.content if random.integers(2) else _upper_only(known.content)
        else:
            mine, other = (known.places[witness["direction"][k]] for k in (0, -1))
            p = int(random.integers(len(mine.points)))
            gap = np.linalg.norm(mine.points[p] - other.points, axis=1).min()
            found = {**witness, **mine.names[p]}
            false = gap * _CLEARLY < claim["lower"]
            base = known.content if random.integers(2) else _lower_only(known.content)
        if false:
            yield "another witness", {**base, "witness": found}


def _drawn_cells(
    known: Known, random: np.random.Generator, key: str | None = None
) -> Iterator[tuple[str, int, list[Any]]]:
    """Draw cells at random, with their section; if a key is given, only cells with a value under it."""
    cells = known.content["cells"] or {}
    wanted = [(name, k) for name, rows in cells.items() for k, row in enumerate(rows) if key is None or row.get(key)]
    for _ in range(_DRAWS if wanted else 0):
        name, k = wanted[random.integers(len(wanted))]
        yield name, k, cells[name]


def _with_rows(content: Content, section: str, rows: list[Any]) -> Content:
    return {**content, "cells": {**content["cells"], section: rows}}


def _with_row(content: Content, section: str, k: int, row: dict[str, Any]) -> Content:
    rows = content["cells"][section]
    return _with_rows(content, section, [*rows[:k], row, *rows[k + 1 :]])


def _foot(place: dict[str, Any]) -> dict[str, Any]:
    """Return a foot that stays at one parameter."""
    if "way" in place:
        return {"map": [place["at"]], "way": place["way"], "zero": [0.0]}
    return {"piece": place["piece"], "map": [place["at"]], "weights": None}


def _place_in(shape: dict[str, Any], row: dict[str, Any]) -> np.ndarray | None:
    """Return a point of a shape in a cell: a corner, or a zero on an edge; None if no edge shows a sign change."""
    corners = _corners(shape, row)
    if shape["kind"] != "surface":
        return corners[0]
    for i, p in enumerate(corners):
        for q in corners[:i]:
            if value(shape, p) * value(shape, q) < 0:
                return changes(shape, p[None], q[None])[0][0]
    return None


def _corners(shape: dict[str, Any], row: dict[str, Any]) -> list[np.ndarray]:
    """Return the corners of a cell in space."""
    piece, cell = pieces_of(shape)[row["piece"]], row["cell"]
    if cell is None:
        return [_point(piece, [])]
    if not isinstance(cell, str):
        return [_point(piece, [t]) for t in cell]
    several = len(roots(piece)) > 1
    simplex = roots(piece)[int(cell[0])] if several else roots(piece)[0]
    for depth, letter in enumerate(cell[several:]):
        simplex = half(simplex, letter, depth)
    return [_point(piece, corner) for corner in simplex]


def _point(piece: ExactPiece, at: Sequence[float]) -> np.ndarray:
    found = point_of(piece, at)
    return np.array([f.get(0, 0) / found.weight[0] for f in found.coordinates])


# ---- shapes --------------------------------------------------------------------------------------


def _wrong_hash(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Change a number of a shape but not its hash."""
    while True:
        name, shape = _with_another_number(known, random)
        yield "number without its hash", {**known.content, name: shape}


def _wrong_shape(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content, bool]]:
    """Change a number of a shape and its hash, and compare with the true shapes."""
    while True:
        name, shape = _with_another_number(known, random)
        yield "another number", {**known.content, name: _named(shape)}, True


def _other_shape(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content, bool]]:
    """Insert a shape of another pair, and compare with the true shapes."""
    for other in known.others:
        for name in "ab":
            yield "shape of another pair", {**known.content, name: other[name]}, True


def _scaled(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Scale both shapes, and so their distance, by a power of two, if this makes the claim false."""
    lower, upper = known.claim["lower"], known.claim["upper"]
    for k in range(1, 9):
        for power in (k, -k):
            least, most = (x * 2.0**power for x in known.truth)
            if most < lower or (upper is not None and least > upper):
                shapes = {name: _named(_times(known.content[name], 2.0**power)) for name in "ab"}
                yield "other size", {**known.content, **shapes}


def _moved(known: Known, random: np.random.Generator) -> Iterator[tuple[str, Content]]:
    """Move a shape so far that the distance exceeds the upper bound."""
    names = [name for name in "ab" if known.content[name]["kind"] != "surface"]
    while names and known.claim["upper"] is not None:
        name = str(random.choice(names))
        points = np.concatenate([seen.points for seen in known.places.values()])
        way = random.normal(size=points.shape[1])
        far = known.claim["upper"] + 2 * float(np.linalg.norm(np.ptp(points, axis=0)))
        by = way / np.linalg.norm(way) * far * float(random.uniform(1, 10))
        yield "shape moved away", {**known.content, name: _named(_shifted(known.content[name], by))}


def _with_another_number(known: Known, random: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """Change one nonzero number of a random shape, in its last digit or an earlier one."""
    while True:
        name = str(random.choice(["a", "b"]))
        shape = json.loads(json.dumps(known.content[name]))
        rows = shape[str(random.choice([key for key in _ARRAYS if shape.get(key) is not None]))]
        while isinstance(rows[0], list):
            rows = rows[random.integers(len(rows))]
        k = int(random.integers(len(rows)))
        rows[k] *= 1 + float(random.choice([-1, 1])) * 2.0 ** -float(random.integers(1, 53))
        if shape != known.content[name]:
            return name, shape


def _times(shape: dict[str, Any], factor: float) -> dict[str, Any]:
    """Scale a shape; this is exact if the factor is a power of two."""
    if shape["kind"] == "surface":
        rows = np.array(shape["coefficients"], float)
        powers = np.indices(rows.shape).sum(axis=0)
        return {
            **shape,
            "coefficients": (rows * factor ** -powers.astype(float)).tolist(),
            **{end: (factor * np.array(shape[end])).tolist() for end in ("lower", "upper")},
        }
    key = "vertices" if shape["kind"] == "mesh" else "control_points"
    return {**shape, key: (factor * np.array(shape[key], float)).tolist()}


def _shifted(shape: dict[str, Any], by: np.ndarray) -> dict[str, Any]:
    key = "vertices" if shape["kind"] == "mesh" else "control_points"
    return {**shape, key: (np.array(shape[key], float) + by).tolist()}


def _named(shape: dict[str, Any]) -> dict[str, Any]:
    """Return the shape with its own hash."""
    return {**shape, "sha256": digest(shape)}


_Way = Callable[[Known, np.random.Generator], Iterator[tuple]]
_WAYS: dict[str, list[_Way]] = {
    "claims": [_of_others, _of_one_direction, _above, _below],
    "proofs": [_removed, _repeated, _far_feet, _one_foot, _called_free, _turned, _other_witness],
    "shapes": [_wrong_hash, _wrong_shape, _other_shape, _scaled, _moved],
}
