"""Cells of a certificate for shapes of every kind: parts of a with affine maps into b, cut until integers accept them.

All of a is cut breadth first, cells between the two corners that are farthest apart. The feet of the corners say which
pieces of b are near; each of them, followed over the other corners, makes one map. The distance to one of the maps may
be small enough; where two or more are needed, as along the lines from which two parts of b are equally far, a linear
programme over samples of the cell finds multipliers that are affine. What is found in floating point is checked exactly
by jhd.distance.certificate.verification.

Source: METHODS in the sense of Alt, Behrends & Bloemer for the covering; the multipliers are those of the S-procedure.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from jhd.distance.certificate.covering import UncoveredError
from jhd.distance.certificate.multipliers import multipliers
from jhd.distance.certificate.sides import NearFeet, ShapeSide
from jhd.distance.certificate.verification.cells import MOST_CUTS, half, roots
from jhd.distance.certificate.verification.pieces import composed, difference, simplex_map
from jhd.distance.certificate.verification.polynomials import exponents
from jhd.distance.certificate.verification.proofs import failure_at_most
from jhd.distance.certificate.verification.structure import MOST_FEET

# Parts into which an exact check may cut a cell here, with one foot and with several; what takes more is cut as a cell.
_PARTS = {1: 60, 2: 300, 3: 300, 4: 300}
# Degrees of the grids on which maps are compared: on an interval, on a triangle.
_GRIDS = {1: 0, 2: 12, 3: 6}
# Places of feet are rounded to multiples of this, which keeps integers short: the distance changes by its square.
_BITS = 2.0**36
# A sample this much above the bound, as a share of it, rejects a map without an exact check.
_SURELY = 1e-13
# Maps whose parameters are nearer than this are one.
_ALIKE = 1e-9
# Cells that are cut in one generation, and generations, where far places alone are looked for.
_BEAM, _GENERATIONS = 48, 24
# The letters of the halves of a triangle, for each pair of corners between which it is cut.
_LETTERS = {(0, 1): "ab", (0, 2): "cd", (1, 2): "ef"}


class CellCover(NamedTuple):
    """Entries of a certificate, and the places of a that were met, the farthest first."""

    entries: list[dict[str, Any]]
    farthest: list[tuple[int, np.ndarray]]


class _Open(NamedTuple):
    """Cells that are not proven: pieces, names, the parameters of corners, their points, and the feet of these.

    Where two feet are nearly equally far, that of a corner may be either of them: `more` holds places of b that are
    tried as starts besides, those of the maps of the cell that was cut.
    """

    piece: np.ndarray
    name: np.ndarray
    x: np.ndarray
    points: np.ndarray
    feet: NearFeet
    more: NearFeet

    def take(self, index: np.ndarray) -> "_Open":
        """Some of them."""
        feet, more = (NearFeet(*(rows[index] for rows in each)) for each in (self.feet, self.more))
        return _Open(self.piece[index], self.name[index], self.x[index], self.points[index], feet, more)


class _Maps(NamedTuple):
    """Maps of each cell: the piece of b, the parameters of the feet of the corners, squared distances on the grid."""

    piece: np.ndarray
    x: np.ndarray
    squares: np.ndarray


def cover_by_cells(
    source: ShapeSide, target: ShapeSide, upper: float, max_cells: int, report: Callable[[int, int], None]
) -> CellCover:
    """Cells that cover the source, each proven to be at most `upper` away from the target.

    Args:
        source: the shape that is covered.
        target: the other one, with the same exponent.
        upper: the bound to prove, in the unit of the stored arrays.
        max_cells: most cells, before it is given up.
        report: called after each generation with the numbers of proven and of open cells.

    Raises:
        UncoveredError: a place is farther away, or too many or too narrow cells would be needed.
    """
    limit = float(np.ldexp(upper, -source.exponent))
    cells, entries, known = _first(source, target, limit), [], _Known()
    while len(cells.piece):
        known.add(cells)
        maps = _maps(source, target, cells)
        found = _accepted(source, target, cells, maps, upper, limit)
        entries += [entry for entry in found if entry is not None]
        rest = np.array([entry is None for entry in found])
        report(len(entries), int(rest.sum()))
        if len(entries) + rest.sum() > max_cells:
            raise UncoveredError(f"more than {max_cells} cells are needed: raise max_cells, or atol.")
        cells = _with_starts(cells, maps).take(np.flatnonzero(rest))
        cells = _halves(source, target, cells, limit)
    return CellCover(sorted(entries, key=lambda entry: (entry["piece"], entry["cell"] or [])), known.farthest())


def far_places(source: ShapeSide, target: ShapeSide) -> list[tuple[int, np.ndarray]]:
    """Places of the source that are far from the target, the farthest first: corners of cells about them are cut on."""
    cells, known = _first(source, target, np.inf), _Known()
    known.add(cells)
    for _ in range(_GENERATIONS if source.cell_corners > 1 else 0):
        farthest = np.argsort(-np.max(cells.feet.distance, axis=1))[:_BEAM]
        cells = _halves(source, target, cells.take(farthest), np.inf)
        known.add(cells)
    return known.farthest()


class _Known:
    """The places of corners that are farthest from the target."""

    # How many are kept.
    MOST = 8

    def __init__(self) -> None:
        self.rows: dict[tuple[Any, ...], float] = {}

    def add(self, cells: _Open) -> None:
        """Looks at the corners of cells."""
        flat = cells.feet.distance.ravel()
        piece = np.repeat(cells.piece, cells.x.shape[1])
        x = cells.x.reshape(len(flat), cells.x.shape[-1])
        for k in np.argsort(-flat)[: 2 * self.MOST]:
            self.rows[(int(piece[k]), *x[k].tolist())] = float(flat[k])
        self.rows = dict(sorted(self.rows.items(), key=lambda row: -row[1])[: self.MOST])

    def farthest(self) -> list[tuple[int, np.ndarray]]:
        """Pieces and parameters, the farthest first."""
        return [(int(key[0]), np.array(key[1:], float)) for key in self.rows]


def _first(source: ShapeSide, target: ShapeSide, limit: float) -> _Open:
    """The pieces as cells; patches as two triangles each."""
    pieces = np.arange(len(source.exact))
    if source.cell_corners < 3:
        x = np.tile(np.linspace(0.0, 1.0, source.cell_corners)[:, None][:, : source.parameters], (len(pieces), 1, 1))
        return _measured(source, target, pieces, np.full(len(pieces), "", object), x, limit)
    triangles = roots(source.exact[0])
    names = [str(k) if len(triangles) > 1 else "" for k in range(len(triangles))]
    x = np.tile(np.array(triangles), (len(pieces), 1, 1))
    name = np.array(names * len(pieces), object)
    return _measured(source, target, np.repeat(pieces, len(triangles)), name, x, limit)


def _measured(
    source: ShapeSide, target: ShapeSide, piece: np.ndarray, name: np.ndarray, x: np.ndarray, limit: float
) -> _Open:
    """The cells with points and feet of their corners; each place is measured once.

    Raises:
        UncoveredError: one of them is farther away than the limit.
    """
    count, corners, width = x.shape
    rows = np.concatenate([np.repeat(piece, corners)[:, None], x.reshape(count * corners, width)], axis=1)
    unique, back = np.unique(rows, axis=0, return_inverse=True)
    back = back.reshape(-1)
    points = source.points(unique[:, 0].astype(int), unique[:, 1:])
    feet = target.feet_within(points, limit)
    worst = int(np.argmax(feet.distance))
    if feet.distance[worst] > limit * (1 + 1e-12) + 1e-14:
        raise UncoveredError(f"piece {int(unique[worst, 0])} at {unique[worst, 1:].tolist()} is farther away.")
    shaped = NearFeet(*(rows[back].reshape(count, corners, *rows.shape[1:]) for rows in feet))
    return _Open(piece, name, x, points[back].reshape(count, corners, -1), shaped, shaped)


# ---- what is proposed ----------------------------------------------------------------------------


def _grid(corners: int) -> np.ndarray:
    """Barycentric coordinates of the samples of a cell, (samples, corners)."""
    degree = max(_GRIDS[corners], 1)
    return np.array(exponents(corners, degree), float) / degree


def _maps(source: ShapeSide, target: ShapeSide, cells: _Open) -> list[_Maps]:
    """For each corner the map that follows its foot, and those from the other starts."""
    grid, corners = _grid(source.cell_corners), cells.x.shape[1]
    samples, count = len(grid), len(cells.piece)
    places = np.einsum("sk,nkp->nsp", grid, cells.x).reshape(count * samples, cells.x.shape[-1])
    points = source.points(np.repeat(cells.piece, samples), places)
    found = []
    pieces = np.concatenate([cells.feet.piece, cells.more.piece], axis=1)
    starts = np.concatenate([cells.feet.x, cells.more.x], axis=1)
    for k in range(pieces.shape[1]):
        piece, rows = pieces[:, k], []
        for j in range(corners):
            followed = starts[:, k] if j == k else target.local(piece, starts[:, k], cells.points[:, j]).x
            rows.append(_rounded(target, followed))
        x = np.stack(rows, axis=1)
        feet = np.einsum("sk,nkp->nsp", grid, x).reshape(count * samples, x.shape[-1])
        e = points - target.points(np.repeat(piece, samples), feet)
        found.append(_Maps(piece, x, np.sum(e * e, axis=-1).reshape(count, samples)))
    return found


def _rounded(target: ShapeSide, x: np.ndarray) -> np.ndarray:
    """Parameters with few digits, inside their domain."""
    x = np.clip(np.round(x * _BITS) / _BITS, 0.0, 1.0)
    if target.corners == (3,):
        x[:, 1] = np.minimum(x[:, 1], 1 - x[:, 0])
    return x


def _accepted(
    source: ShapeSide, target: ShapeSide, cells: _Open, maps: list[_Maps], upper: float, limit: float
) -> list[dict[str, Any] | None]:
    """For each cell an entry that the exact check accepts."""
    tops = np.stack([np.max(each.squares, axis=1) for each in maps])
    least = np.max(np.min([each.squares for each in maps], axis=0), axis=1)
    enough = limit * limit * (1 + _SURELY)
    found: list[dict[str, Any] | None] = []
    for k in range(len(cells.piece)):
        entry = None
        if least[k] <= enough:
            best = int(np.argmin(tops[:, k]))
            if tops[best, k] <= enough:
                entry = _checked(source, target, cells, k, [maps[best]], None, upper)
            if entry is None and len(maps) > 1:
                entry = _by_several(source, target, cells, k, maps, upper, limit)
        found.append(entry)
    return found


def _by_several(
    source: ShapeSide, target: ShapeSide, cells: _Open, k: int, maps: list[_Maps], upper: float, limit: float
) -> dict[str, Any] | None:
    """An entry with several feet, where multipliers for them are found."""
    chosen = [maps[i] for i in _different(maps, k)[:MOST_FEET]]
    if len(chosen) < 2:
        return None

    def slack(shares: np.ndarray) -> np.ndarray:
        points = source.points(np.full(len(shares), cells.piece[k]), shares @ cells.x[k])
        found = []
        for each in chosen:
            piece, x = np.full(len(shares), each.piece[k]), shares @ each.x[k]
            square = np.sum((points - target.points(piece, x)) ** 2, axis=-1)
            # As the checker has it: times the square of the weight.
            found.append((limit * limit - square) * target.weights(piece, x) ** 2)
        return np.stack(found)

    rows = multipliers(slack, _grid(source.cell_corners))
    return None if rows is None else _checked(source, target, cells, k, chosen, rows, upper)


def _different(maps: list[_Maps], k: int) -> list[int]:
    """The maps of a cell that are not alike, those that are somewhere the nearest first."""
    squares = np.stack([each.squares[k] for each in maps])
    order = np.argsort(np.min(squares - squares.min(axis=0), axis=1), kind="stable")
    chosen: list[int] = []
    for i in order:
        like = (maps[j] for j in chosen if maps[i].piece[k] == maps[j].piece[k])
        if not any(np.allclose(maps[i].x[k], other.x[k], atol=_ALIKE) for other in like):
            chosen.append(int(i))
    return chosen


def _with_starts(cells: _Open, maps: list[_Maps]) -> _Open:
    """The cells with starts from their own maps for those that they are cut into."""
    count, corners, _ = cells.x.shape
    index = np.array([(_different(maps, k) * corners)[:corners] for k in range(count)])
    rows = np.arange(count)[:, None]
    piece = np.stack([each.piece for each in maps])[index, rows]
    x = np.stack([each.x[:, 0] for each in maps])[index, rows]
    return cells._replace(more=NearFeet(piece, x, np.zeros(piece.shape)))


def _checked(
    source: ShapeSide,
    target: ShapeSide,
    cells: _Open,
    k: int,
    maps: list[_Maps],
    weights: list[list[float]] | None,
    upper: float,
) -> dict[str, Any] | None:
    """The entry of a cell with these maps; None where the exact check does not accept it."""
    piece, corners = int(cells.piece[k]), source.cell_corners
    feet = [{"piece": int(each.piece[k]), "map": _shortest(each.x[k]), "weights": None} for each in maps]
    part = composed(source.exact[piece], simplex_map(source.exact[piece], corners, cells.x[k].tolist()))
    apart = []
    for foot in feet:
        other = target.exact[foot["piece"]]
        apart.append(difference(part, composed(other, simplex_map(other, corners, foot["map"]))))
    if failure_at_most(apart, upper, weights, _PARTS[len(maps)]) is not None:
        return None
    name = str(cells.name[k]) if corners == 3 else cells.x[k, :, 0].tolist() if corners == 2 else None
    return {"piece": piece, "cell": name, "feet": feet, "multipliers": weights, "bound": upper}


def _shortest(x: np.ndarray) -> list[list[float]]:
    """The rows of a map; one where all are the same place."""
    return x[:1].tolist() if np.all(x == x[0]) else x.tolist()


# ---- cuts ----------------------------------------------------------------------------------------


def _halves(source: ShapeSide, target: ShapeSide, cells: _Open, limit: float) -> _Open:
    """Both halves of each cell, cut between the corners that are farthest apart.

    Raises:
        UncoveredError: there is a cell that cannot be cut.
    """
    if not len(cells.piece):
        return cells
    depth = max(len(name) for name in cells.name)
    if source.cell_corners == 1 or depth >= MOST_CUTS:
        place = f"piece {int(cells.piece[0])} at {cells.x[0, 0].tolist()}"
        raise UncoveredError(f"{place} is not proven to be nearer than the bound.")
    piece, names, corners, parent = [], [], [], []
    for k in range(len(cells.piece)):
        for letter in longest_side(cells.points[k]):
            parent.append(k)
            piece.append(cells.piece[k])
            names.append(cells.name[k] + letter)
            corners.append(half_of_cell(cells.x[k], letter))
    found = _measured(source, target, np.array(piece), np.array(names, object), np.array(corners), limit)
    return found._replace(more=NearFeet(*(rows[np.array(parent)] for rows in cells.more)))


def longest_side(points: np.ndarray) -> str:
    """The letters of the halves between those corners of an interval or a triangle that are farthest apart."""
    pairs = list(_LETTERS) if len(points) == 3 else [(0, 1)]
    return _LETTERS[max(pairs, key=lambda pair: float(np.sum((points[pair[0]] - points[pair[1]]) ** 2)))]


def half_of_cell(x: np.ndarray, letter: str, depth: int = 0) -> Any:
    """The half that a letter names of a cell with these parameters of its corners, which has been cut so often."""
    if len(x) > 2:
        return half(tuple(map(tuple, x.tolist())), letter, depth)
    middle = 0.5 * (x[0] + x[1])
    return [x[0], middle] if letter == "a" else [middle, x[1]]
