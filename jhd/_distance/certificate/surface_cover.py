"""Cells of a certificate for pairs with an implicit surface, cut until integers accept them.

The cells of an implicit surface are tetrahedra of its box; a tetrahedron without a zero needs nothing more. The feet of
a few points in a cell show which parts of the opposite shape are near, and each foot, moved with the points of the
cell, makes one map. Linear programs find the multipliers (multipliers), and integers check them.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

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
    one_by_one,
    prove_all,
    shortest,
)
from jhd._distance.certificate.multipliers import (
    SurfaceMultipliers,
    Terms,
    TightPlace,
    convex_multipliers,
    plain_multipliers,
    tight_place,
)
from jhd._distance.certificate.sides import AbstractSide, FootMap
from jhd._distance.certificate.verification.cells import MOST_CUTS
from jhd._distance.certificate.verification.inequalities import failure_of_cell
from jhd._distance.certificate.verification.pieces import composed, simplex_map

# Degrees of the grids in cells, by the number of corners.
_GRIDS = {1: 1, 2: 6, 3: 3, 4: 2}
# If a point is farther away than the bound by more than this fraction, the search decides.
_SURELY = 1e-9


class _SurfaceCell(NamedTuple):
    """A piece of the source, a part of it by name, and the parameters of the part's corners."""

    piece: int
    name: str
    x: np.ndarray


def cover_with_surfaces(
    source: AbstractSide, target: AbstractSide, upper: float, max_cells: int, report: Report
) -> list[Entry]:
    """Return cells as `cover_by_cells` does, for shapes with an implicit surface; all in the unit of the arrays."""
    if not target.is_found:
        raise UncoveredError("no point of the other surface is proven: no change of sign of its polynomial was found.")
    first = [
        _SurfaceCell(piece, name, x)
        for piece, exact in enumerate(source.exact)
        for name, x in first_cells(exact, source.cell_corners)
    ]
    step = one_by_one(lambda cell: _Tried(source, target, cell, upper).entry(), partial(_halves, source))
    return in_order(prove_all(first[::-1], step, max_cells, report))


def _halves(source: AbstractSide, cell: _SurfaceCell) -> list[_SurfaceCell]:
    if source.cell_corners == 1 or len(cell.name) >= MOST_CUTS:
        raise UncoveredError.narrow(cell.piece, cell.x[0])
    letters = longest_side(source.points(np.full(len(cell.x), cell.piece), cell.x))
    return [
        _SurfaceCell(cell.piece, cell.name + letter, half_of_cell(cell.x, letter, len(cell.name)))
        for letter in reversed(letters)
    ]


class _Tried:
    """A cell for which an entry is searched."""

    def __init__(self, source: AbstractSide, target: AbstractSide, cell: _SurfaceCell, upper: float):
        self.source, self.target, self.cell, self.upper = source, target, cell, upper
        self.count = len(cell.x)
        self.corners = self._points(np.eye(self.count))
        self.map = simplex_map(source.exact[cell.piece], self.count, cell.x.tolist())

    def entry(self) -> Entry | None:
        """Return an entry that integers accept; None if none is found."""
        source, cell = self.source, self.cell
        name = cell_name(cell.name, cell.x)
        entry: Entry = {"piece": cell.piece, "cell": name, "feet": [], "multipliers": None, "bound": self.upper}
        if source.zeros is not None:
            entry["zero"] = None
            if source.is_empty(composed(source.exact[cell.piece], self.map), self._points(grid(4, 4))):
                return entry
        # Points of the source in the cell, for which feet are searched.
        shares = source.shares_in(self.corners, grid(self.count, _GRIDS[self.count]))
        points = self._points(shares)
        maps = self._maps(shares, points)
        tried = (self._with(entry, chosen) for chosen in self._choices(maps, shares, points))
        return next((done for done in tried if done is not None), None)

    def _points(self, shares: np.ndarray) -> np.ndarray:
        return self.source.points(np.full(len(shares), self.cell.piece), shares @ self.cell.x)

    # ---- maps --------------------------------------------------------------------------------------

    def _maps(self, shares: np.ndarray, points: np.ndarray) -> list[FootMap]:
        """Return maps that follow the feet of some points of the cell, given with their barycentric coordinates.

        Raises:
            UncoveredError: a point of the source is farther away than the bound.
        """
        limit = self.upper * (1 + _SURELY)
        if len(points):
            far = np.argsort(-np.sum((points - points.mean(axis=0)) ** 2, axis=1))
            rows = np.append(far[:4], far[-1])[::-1]
            shares, points = shares[rows], points[rows]
        else:
            # The middle is not on the source, and cannot be too far away.
            shares, points, limit = np.full((1, self.count), 1 / self.count), self.corners.mean(axis=0)[None], np.inf
        found: list[FootMap] = []
        for u, point, near in zip(shares, points, self.target.maps_near(self.corners, points, limit), strict=True):
            if near.distance > limit and self.target.proven_distance(point, near.distance) > self.upper * (1 + 1e-12):
                raise UncoveredError.far(self.cell.piece, u @ self.cell.x)
            for each in near.maps:
                if not any(_are_alike(each, other) for other in found):
                    found.append(each)
        return found

    # ---- proofs --------------------------------------------------------------------------------------

    def _choices(self, maps: list[FootMap], shares: np.ndarray, points: np.ndarray) -> list[list[FootMap]]:
        """Return single maps, the best first, or else one set of several maps."""
        if not len(points) or not maps:
            return [maps[:1]] if maps else []
        squares = np.stack([np.sum((points - self._feet(foot, shares)) ** 2, axis=1) for foot in maps])
        order = np.argsort(np.max(squares, axis=1))
        enough = self.upper**2 * (1 + _SURELY)
        single = [[maps[k]] for k in order[:2] if np.max(squares[k]) <= enough]
        if single:
            return single
        if np.max(np.min(squares, axis=0)) > enough or len(maps) < 2:
            return []
        chosen: list[int] = []
        # Feet of a cell that are tried together, at most.
        while len(chosen) < 3:
            best = np.min(squares[chosen], axis=0) if chosen else np.full(len(points), np.inf)
            if np.all(best <= enough):
                break
            gains = [np.max(np.minimum(best, squares[k])) for k in range(len(maps))]
            chosen.append(int(np.argmin(gains)))
        return [[maps[k] for k in chosen]] if len(set(chosen)) > 1 else []

    def _feet(self, foot: FootMap, shares: np.ndarray) -> np.ndarray:
        """Return the points of a map, moved to the target if they cross it."""
        q = self.target.feet_at(foot, shares)
        positions = self.target.crossings(foot, q)
        return q if positions is None else q + positions[:, None] * foot.way

    def _with(self, entry: Entry, feet: list[FootMap]) -> Entry | None:
        """Return the entry with these maps, moved to be sharp at the tight point; None if it is not proven."""
        intervals = len(feet) if self.target.zeros else 0
        tight = self._tight(feet, intervals)
        # How often maps are moved to the foot of the tight point.
        for _ in range(5):
            # A tight point with less slack is useless.
            if tight is None or tight.is_clear or tight.least < -0.1:
                break
            moved = [self._moved(foot, tight, k) for k, foot in enumerate(feet)]
            change = max(float(np.max(np.abs(x.rows - y.rows), initial=0.0)) for x, y in zip(feet, moved, strict=True))
            feet = moved
            tight = self._tight(feet, intervals, tight.u)
            # A smaller move ends this.
            if change < 1e-9:
                break
        if tight is None or tight.least <= 0:
            return None
        terms = partial(self._terms, feet)
        found = plain_multipliers(terms, tight, len(feet), self._degrees(len(feet)))
        # Parts into which an exact check that should need none may cut a cell.
        done = None if found is None else self._checked(entry, feet, found, 6)
        if done is not None or tight.is_clear:
            return done
        found = convex_multipliers(terms, tight, len(feet))
        # Parts into which an exact check may cut a cell here.
        return None if found is None else self._checked(entry, feet, found, 120)

    def _degrees(self, feet: int) -> tuple[int, int]:
        """Return the degrees of the polynomial to prove: in the cell and along a foot."""
        zeros = [side.zeros.degree + 1 for side in (self.source, self.target) if side.zeros]
        inside = 2 * (self.source.cell_degree + self.target.cell_degree) + (feet > 1)
        return max(inside, *zeros), self.target.zeros.degree + 1 if self.target.zeros else 0

    def _tight(self, feet: list[FootMap], intervals: int, near: np.ndarray | None = None) -> TightPlace | None:
        constrain = partial(self._that_count, feet=feet[:intervals])
        return tight_place(partial(self._terms, feet), constrain, self.count, intervals, near)

    def _moved(self, foot: FootMap, tight: TightPlace, k: int) -> FootMap:
        """Return the map that takes the tight point to its own foot; the map itself if no foot is near."""
        position = float(tight.s[k]) if len(tight.s) else 0.0
        return self.target.moved(self.corners, foot, tight.u, self._points(tight.u[None])[0], position) or foot

    def _terms(self, feet: list[FootMap], shares: np.ndarray, places: np.ndarray) -> Terms:
        """Return the slacks of feet, and the values of both polynomials, at samples of the cell."""
        points, target = self._points(shares), self.target
        slacks, there = [], []
        mine = self.source.weights_at(self.cell.piece, shares @ self.cell.x)
        for k, foot in enumerate(feet):
            q = target.feet_at(foot, shares)
            q = q + places[:, k : k + 1] * foot.way if places.shape[1] else q
            values = target.values_at(q)
            there += [] if values is None else [values]
            weight = mine * target.weights_at(foot.piece, shares @ foot.rows)
            slacks.append((1 - np.sum((points - q) ** 2, axis=1) / self.upper**2) * weight**2)
        return Terms(np.array(slacks), np.array(there).reshape(len(there), len(shares)), self.source.values_at(points))

    def _checked(self, entry: Entry, feet: list[FootMap], found: SurfaceMultipliers, parts: int) -> Entry | None:
        """Return the entry, if integers accept it."""
        done = {**entry, "multipliers": found.feet}
        if self.target.zeros:
            scale = self.upper**2 * self.target.scale
            done["feet"] = [
                {"map": shortest(foot.rows), "way": foot.way.tolist(), "zero": [x * scale for x in numbers]}
                for foot, numbers in zip(feet, found.there, strict=True)
            ]
        else:
            done["feet"] = [{"piece": f.piece, "map": shortest(f.rows), "weights": None} for f in feet]
        if self.source.zeros:
            done["zero"] = [x * self.upper**2 * self.source.scale for x in found.here or [0.0]]
        zeros = self.source.zeros, self.target.zeros
        exact = self.source.exact[self.cell.piece]
        failed = failure_of_cell(exact, self.map, self.target.exact, zeros, done, parts)
        return done if failed is None else None

    def _that_count(self, shares: np.ndarray, feet: list[FootMap]) -> tuple[np.ndarray, np.ndarray]:
        """Return barycentric coordinates of source points near given ones, and the target points along the feet."""
        shares = self.source.shares_on(self.corners, shares)
        places = np.zeros((len(shares), len(feet)))
        for k, foot in enumerate(feet):
            positions = self.target.crossings(foot, self.target.feet_at(foot, shares))
            if positions is None:
                return shares[:0], places[:0]
            places[:, k] = np.clip(positions, -1, 1)
        return shares, places


def _are_alike(foot: FootMap, other: FootMap) -> bool:
    # Maps whose points are nearer than this fraction of the size count as one.
    size = 1e-6 * float(np.max(np.abs(foot.rows), initial=1e-300))
    return other.piece == foot.piece and bool(np.max(np.abs(other.rows - foot.rows), initial=0.0) <= size)
