"""Cells of a certificate for shapes of every kind: parts of a with maps into b, cut until integers accept them.

The whole of a is cut breadth first. The feet of the corners of a cell say which pieces of b are near, and each foot,
followed over the other corners, makes one affine map. The distance to one of the maps may be small enough. If several
maps are needed, for example along the lines from which two parts of b are equally far, a linear program over samples
of the cell finds affine multipliers. A cell without a proof is cut between the two corners that are farthest apart.

Between two curves no multipliers are needed. A foot makes two more maps there, with the speeds of the foot at both ends
of the cell (as in jhd._distance.cells.branches): a Moebius map if one of the curves is rational, and a cubic one. A
cell is cut where the distance is largest: an exact bound needs a cut there.

All of this is floating point; jhd._distance.certificate.verification checks the result exactly.

Source: Alt, Behrends & Bloemer for the covering; the multipliers are known as the S-procedure.
"""

from typing import Any, NamedTuple

import numpy as np

from jhd._arithmetic.bernstein import basis
from jhd._distance.cells.branches import hermite, moebius_weights
from jhd._distance.certificate.curve_cuts import CurveCells, CurveFeet, peaks, seams
from jhd._distance.certificate.cutting import (
    Entry,
    Report,
    UncoveredError,
    cell_name,
    first_cells,
    grid,
    half_of_cell,
    in_order,
    longest_side,
    prove_all,
    shortest,
)
from jhd._distance.certificate.multipliers import sampled_multipliers
from jhd._distance.certificate.shape_side import NearFeet, ShapeSide
from jhd._distance.certificate.verification.cells import MOST_CUTS
from jhd._distance.certificate.verification.inequalities import failure_of_cell
from jhd._distance.certificate.verification.pieces import simplex_map
from jhd._distance.certificate.verification.structure import MOST_FEET
from jhd._distance.nearest.feet import equation_of, foot_speed
from jhd._runtime.arrays import taken

# Parts into which an exact check may cut a cell here, with one foot and with several; a check that needs more parts
# fails, and the cell is cut.
_PARTS = {1: 60, 2: 300, 3: 300, 4: 300}
# Degrees of the grids on which maps are compared: on an interval, on a triangle.
_GRIDS = {1: 1, 2: 12, 3: 6}
# A sample this much above the bound, as a fraction of it and in the unit of coordinates, rejects a map without a check.
_SURELY = 1e-13
# Cells that are cut in one generation, and generations by the number of corners, if only far points are wanted.
_BEAM = {1: 0, 2: 16, 3: 48}
_GENERATIONS = {1: 0, 2: 48, 3: 24}


class CellCover(NamedTuple):
    """Entries of a certificate, and the points of a found on the way, the farthest first."""

    entries: list[Entry]
    farthest: list[tuple[int, np.ndarray]]


class _Open(NamedTuple):
    """Cells that are not proven: pieces, names, parameters of corners, their points, and the feet of these.

    If two feet are nearly equally far, the foot of a corner may be either of them. So `more` holds further starts on b,
    taken from the maps of the cell that was cut.
    """

    piece: np.ndarray
    name: np.ndarray
    x: np.ndarray
    points: np.ndarray
    feet: NearFeet
    more: NearFeet

    take = taken


class _Maps(NamedTuple):
    """Maps of each cell: the piece of b, the parameters of feet, squared distances on the grid.

    The parameters are Bernstein coefficients; for an affine map they are the feet of the corners. If there are weights,
    the coefficients are multiplied by them.
    """

    piece: np.ndarray
    x: np.ndarray
    weights: np.ndarray | None
    squares: np.ndarray

    take = taken


def cover_by_cells(source: ShapeSide, target: ShapeSide, upper: float, max_cells: int, report: Report) -> CellCover:
    """Return cells that cover the source, each proven to be at most `upper` away from the target.

    Args:
        source: the shape that is covered.
        target: the other shape, with the same exponent and center.
        upper: the bound to prove, in the unit of the stored arrays.
        max_cells: largest number of cells before the attempt is given up.
        report: called after each generation with the numbers of proven and of open cells.

    Raises:
        UncoveredError: a point is farther away, or too many or too narrow cells would be needed.
    """
    limit = float(np.ldexp(upper, -source.exponent))
    known = _Known()

    def step(cells: _Open) -> tuple[list[Entry], list[_Open]]:
        known.add(cells)
        maps, curved = _maps(source, target, cells)
        found = _accepted(source, target, cells, maps, curved, upper, limit)
        proven = [entry for entry in found if entry is not None]
        rest = np.flatnonzero([entry is None for entry in found])
        if not len(rest):
            return proven, []
        cells, maps, cuts = cells.take(rest), [each.take(rest) for each in maps], None
        if source.cell_corners == 2:
            cuts = _cuts(source, target, cells, maps, limit)
        if not _are_curves(source, target):
            cells = _with_starts(cells, maps)
        return proven, [_parts(source, target, cells, limit, cuts)]

    entries = prove_all([_first(source, target, limit)], step, max_cells, report, size=lambda cells: len(cells.piece))
    return CellCover(in_order(entries), known.farthest())


def far_places(source: ShapeSide, target: ShapeSide) -> list[tuple[int, np.ndarray]]:
    """Return points of the source far from the target, the farthest first, found by cutting the farthest cells."""
    cells, known = _first(source, target), _Known()
    known.add(cells)
    for _ in range(_GENERATIONS[source.cell_corners]):
        farthest = np.argsort(-np.max(cells.feet.distance, axis=1))[: _BEAM[source.cell_corners]]
        cells = _parts(source, target, cells.take(farthest))
        known.add(cells)
    return known.farthest()


class _Known:
    """The corners of cells that are farthest from the target."""

    # How many are kept.
    MOST = 8

    def __init__(self) -> None:
        self.rows: dict[tuple[Any, ...], float] = {}

    def add(self, cells: _Open) -> None:
        """Add the corners of cells and keep the farthest."""
        flat = cells.feet.distance.ravel()
        piece = np.repeat(cells.piece, cells.x.shape[1])
        x = cells.x.reshape(len(flat), cells.x.shape[-1])
        for k in np.argsort(-flat)[: 2 * self.MOST]:
            self.rows[(int(piece[k]), *x[k].tolist())] = float(flat[k])
        self.rows = dict(sorted(self.rows.items(), key=lambda row: -row[1])[: self.MOST])

    def farthest(self) -> list[tuple[int, np.ndarray]]:
        """Return pieces and parameters, the farthest first."""
        return [(int(key[0]), np.array(key[1:], float)) for key in self.rows]


def _first(source: ShapeSide, target: ShapeSide, limit: float | None = None) -> _Open:
    """Return the pieces as cells; patches as two triangles each."""
    cells = [(k, *cell) for k, exact in enumerate(source.exact) for cell in first_cells(exact, source.cell_corners)]
    pieces, names, x = (list(rows) for rows in zip(*cells, strict=True))
    return _measured(source, target, np.array(pieces), np.array(names, object), np.array(x), limit)


def _measured(
    source: ShapeSide, target: ShapeSide, piece: np.ndarray, name: np.ndarray, x: np.ndarray, limit: float | None
) -> _Open:
    """Return cells with points and feet of their corners, each measured once; without a limit the nearest feet.

    Raises:
        UncoveredError: a corner is farther away than the limit.
    """
    count, corners, width = x.shape
    rows = np.concatenate([np.repeat(piece, corners)[:, None], x.reshape(count * corners, width)], axis=1)
    unique, back = np.unique(rows, axis=0, return_inverse=True)
    back = back.reshape(-1)
    points = source.points(unique[:, 0].astype(int), unique[:, 1:])
    feet = target.feet(points, proven=True) if limit is None else target.feet_within(points, limit)
    worst = int(np.argmax(feet.distance))
    if limit is not None and feet.distance[worst] > limit * (1 + 1e-12) + 1e-14:
        raise UncoveredError.far(int(unique[worst, 0]), unique[worst, 1:])
    shaped = NearFeet(*(rows[back].reshape(count, corners, *rows.shape[1:]) for rows in feet))
    return _Open(piece, name, x, points[back].reshape(count, corners, -1), shaped, shaped)


# ---- proposals -----------------------------------------------------------------------------------


def _maps(source: ShapeSide, target: ShapeSide, cells: _Open) -> tuple[list[_Maps], list[_Maps]]:
    """Return affine maps that follow the foot of each corner and the other starts; and curved maps between curves."""
    if _are_curves(source, target):
        branches = [_branch(source, target, cells, k) for k in range(2)]
        return [maps[0] for maps in branches], [each for maps in branches for each in maps[1:]]
    found = []
    pieces = np.concatenate([cells.feet.piece, cells.more.piece], axis=1)
    starts = np.concatenate([cells.feet.x, cells.more.x], axis=1)
    for k in range(pieces.shape[1]):
        piece, rows = pieces[:, k], []
        for j in range(cells.x.shape[1]):
            followed = starts[:, k] if j == k else target.local(piece, starts[:, k], cells.points[:, j]).x
            # Parameters of feet are rounded to multiples of this, which keeps integers short: the distance changes by
            # its square. Feet of curves on curves keep all digits: their distance may be less than the rounding of a
            # parameter.
            rows.append(target.rounded(followed, 2.0**36))
        found.append(_with_squares(source, target, cells, piece, np.stack(rows, axis=1)))
    return found, []


def _are_curves(source: ShapeSide, target: ShapeSide) -> bool:
    return source.corners == target.corners == (2,)


def _branch(source: ShapeSide, target: ShapeSide, cells: _Open, k: int) -> list[_Maps]:
    """Return the maps between two curves that follow the foot of corner k: affine, Moebius if needed, and cubic."""
    piece, s = cells.feet.piece[:, k], cells.feet.x[:, k, 0]
    speed = _speeds(source, target, cells, piece, s, k)
    guess = np.clip(s - speed if k else s + speed, 0.0, 1.0)
    other = target.local(piece, guess[:, None], cells.points[:, 1 - k]).x[:, 0]
    ends, speeds = [s, other], [speed, _speeds(source, target, cells, piece, other, 1 - k)]
    if k:
        ends, speeds = ends[::-1], speeds[::-1]
    x = np.stack(ends, axis=1)[..., None]
    found = [_with_squares(source, target, cells, piece, x)]
    if source.is_rational or target.is_rational:
        weights = moebius_weights(*speeds)
        found.append(_with_squares(source, target, cells, piece, x * weights[..., None], weights))
    return [*found, _with_squares(source, target, cells, piece, hermite(*ends, *speeds)[..., None])]


def _speeds(source: ShapeSide, target: ShapeSide, cells: _Open, piece: np.ndarray, s: np.ndarray, k: int) -> np.ndarray:
    """Return the speeds of the feet of corner k on curves, in parameters over the length of the cell."""
    width = cells.x[:, 1, 0] - cells.x[:, 0, 0]
    point, velocity, _ = source.curve_jet(cells.piece, cells.x[:, k, 0])
    return width * foot_speed(s, equation_of(point, target.curve_jet(piece, s)), velocity, width)


def _with_squares(
    source: ShapeSide,
    target: ShapeSide,
    cells: _Open,
    piece: np.ndarray,
    x: np.ndarray,
    weights: np.ndarray | None = None,
) -> _Maps:
    """Return the maps with the squared distances on the grid."""
    samples = grid(source.cell_corners, _GRIDS[source.cell_corners])
    shares = samples if x.shape[1] == samples.shape[1] else basis(x.shape[1] - 1, samples[:, 1])
    feet = np.einsum("sk,nkp->nsp", shares, x)
    feet = feet if weights is None else feet / (weights @ shares.T)[..., None]
    e = _sampled(source, cells.piece, np.einsum("sk,nkp->nsp", samples, cells.x)) - _sampled(target, piece, feet)
    return _Maps(piece, x, weights, np.sum(e * e, axis=-1))


def _sampled(side: ShapeSide, piece: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return points of a shape at parameters (cells, samples, parameters); the samples of a cell are on one piece."""
    count, samples, width = x.shape
    return side.points(np.repeat(piece, samples), x.reshape(count * samples, width)).reshape(count, samples, -1)


def _accepted(
    source: ShapeSide,
    target: ShapeSide,
    cells: _Open,
    maps: list[_Maps],
    curved: list[_Maps],
    upper: float,
    limit: float,
) -> list[Entry | None]:
    """Return for each cell an entry that the exact check accepts: of the best affine map, a curved one, or several."""
    best = np.argmin([np.max(each.squares, axis=1) for each in maps], axis=0)
    least = np.max(np.min([each.squares for each in maps], axis=0), axis=1)
    enough = (limit * (1 + _SURELY) + _SURELY) ** 2
    found: list[Entry | None] = []
    for k in range(len(cells.piece)):
        affine = maps if curved else [maps[best[k]]]
        single = (each for each in (*affine, *curved) if np.max(each.squares[k]) <= enough)
        tried = (_checked(source, target, cells, k, [each], None, upper) for each in single)
        entry = next((each for each in tried if each is not None), None)
        if entry is None and least[k] <= enough and not _are_curves(source, target):
            entry = _by_several(source, target, cells, k, maps, upper, limit)
        found.append(entry)
    return found


def _by_several(
    source: ShapeSide, target: ShapeSide, cells: _Open, k: int, maps: list[_Maps], upper: float, limit: float
) -> Entry | None:
    """Return an entry with several feet, if multipliers for them are found."""
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
            found.append((limit**2 - square) / max(limit**2, 1e-300) * target.weights(piece, x) ** 2)
        return np.stack(found)

    rows = sampled_multipliers(slack, grid(source.cell_corners, _GRIDS[source.cell_corners]))
    return None if rows is None else _checked(source, target, cells, k, chosen, rows, upper)


def _different(maps: list[_Maps], k: int) -> list[int]:
    """Return the distinct maps of a cell, in the order of how close each comes to being nearest at some sample."""
    squares = np.stack([each.squares[k] for each in maps])
    order = np.argsort(np.min(squares - squares.min(axis=0), axis=1), kind="stable")
    chosen: list[int] = []
    for i in order:
        like = (maps[j] for j in chosen if maps[i].piece[k] == maps[j].piece[k])
        # Maps whose parameters are nearer than this are one.
        if not any(np.allclose(maps[i].x[k], other.x[k], atol=1e-9) for other in like):
            chosen.append(int(i))
    return chosen


def _with_starts(cells: _Open, maps: list[_Maps]) -> _Open:
    """Return the cells with starts from their own maps, for the parts that they are cut into."""
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
) -> Entry | None:
    """Return the entry of a cell with these maps; None if the exact check does not accept it."""
    piece, feet = int(cells.piece[k]), [_foot(each, k) for each in maps]
    cell = simplex_map(source.exact[piece], source.cell_corners, cells.x[k].tolist())
    name = cell_name(str(cells.name[k]), cells.x[k])
    entry: Entry = {"piece": piece, "cell": name, "feet": feet, "multipliers": weights, "bound": upper}
    failed = failure_of_cell(source.exact[piece], cell, target.exact, (None, None), entry, _PARTS[len(maps)])
    return entry if failed is None else None


def _foot(maps: _Maps, k: int) -> Entry:
    """Return the map of a cell in the form of certificates."""
    if maps.weights is None:
        return {"piece": int(maps.piece[k]), "map": shortest(maps.x[k]), "weights": None}
    return {"piece": int(maps.piece[k]), "map": maps.x[k].tolist(), "weights": maps.weights[k].tolist()}


# ---- cuts ----------------------------------------------------------------------------------------


def _cuts(source: ShapeSide, target: ShapeSide, cells: _Open, maps: list[_Maps], limit: float) -> np.ndarray:
    """Return parameters at which to cut intervals, (cells, 2): the middle, or, between curves, as an exact bound needs.

    This is the peak of the distance. If the peak is not too high, it is the parameter at which the foot of a branch
    reaches the end of its piece; beyond, another piece has to be followed. Near an end the interval is cut in the
    middle, too.
    """
    t0, t1 = cells.x[:, 0, 0], cells.x[:, -1, -1]
    width, middle = t1 - t0, 0.5 * (t0 + t1)
    if not _are_curves(source, target):
        return np.stack([middle, middle], axis=1)
    intervals = CurveCells(cells.piece, t0, t1)
    feet = CurveFeet(np.stack([each.piece for each in maps]), np.stack([each.x[..., 0] for each in maps]))
    cut, top, is_smooth = peaks(source, target, intervals, feet)
    for each, far in ((maps[1], 0), (maps[0], 1)):
        end = each.x[:, far, 0]
        seam = seams(source, target, intervals, each.piece, end)
        inside = (seam > t0 + _SURELY) & (seam < t1 - _SURELY) & (maps[0].piece != maps[1].piece)
        cut = np.where(inside & (top <= limit**2) & ((end == 0) | (end == 1)), seam, cut)
    # A cut this near to an end does not count; at a smooth peak, where the distance is flat, within this fraction.
    cut = np.where(np.minimum(cut - t0, t1 - cut) <= np.where(is_smooth, 1e-9 * width, 4e-16), middle, cut)
    # A cut nearer to an end than this fraction of the interval is not the only one.
    near = np.minimum(cut - t0, t1 - cut) < 0.05 * width
    return np.stack([cut, np.where(near, middle, cut)], axis=1)


def _parts(
    source: ShapeSide,
    target: ShapeSide,
    cells: _Open,
    limit: float | None = None,
    cuts: np.ndarray | None = None,
) -> _Open:
    """Return the parts of each cell: between the cuts of an interval, by default halves; halves of a triangle.

    Raises:
        UncoveredError: there is a cell that cannot be cut.
    """
    # All cells of a generation have been cut equally often.
    if source.cell_corners == 1 or len(cells.name[0]) >= MOST_CUTS:
        raise UncoveredError.narrow(int(cells.piece[0]), cells.x[0, 0])
    names, corners, parent = [], [], []
    for k in range(len(cells.piece)):
        if cuts is None:
            parts = [(letter, half_of_cell(cells.x[k], letter)) for letter in longest_side(cells.points[k])]
        else:
            ends = np.unique([*cells.x[k, :, 0], *cuts[k]])[:, None]
            parts = [("a", np.stack(pair)) for pair in zip(ends[:-1], ends[1:], strict=True)]
        for letter, x in parts:
            parent.append(k)
            names.append(cells.name[k] + letter)
            corners.append(x)
    rows = np.array(parent)
    found = _measured(source, target, cells.piece[rows], np.array(names, object), np.array(corners), limit)
    return found._replace(more=NearFeet(*(each[rows] for each in cells.more)))
