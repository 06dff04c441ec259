"""Cells of a certificate for pairs with an implicit surface, cut until integers accept them.

The cells of an implicit surface are tetrahedra of its box; a tetrahedron without a zero needs nothing more. The feet of
a few points in a cell show which parts of the opposite shape are near, and each foot, moved with the points of the
cell, makes one map. Linear programs find the multipliers (surface_multipliers), and integers check them.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from jhd._distance.certificate.sides import ShapeSide
from jhd._distance.certificate.subdivision import UncoveredError, half_of_cell, longest_side, shortest
from jhd._distance.certificate.surface_multipliers import (
    SurfaceMultipliers,
    Terms,
    TightPlace,
    convex_multipliers,
    plain_multipliers,
    tight_place,
)
from jhd._distance.certificate.surface_side import SurfaceFoot, SurfaceSide
from jhd._distance.certificate.verification.cells import MOST_CUTS, roots
from jhd._distance.certificate.verification.pieces import composed, simplex_map
from jhd._distance.certificate.verification.polynomials import exponents
from jhd._distance.certificate.verification.surface_proofs import failure_of_surface_cell
from jhd._distance.certificate.verification.zeros import is_free

Side = ShapeSide | SurfaceSide

# Parts into which an exact check may cut a cell here, and one that should need none.
_PARTS, _FEW_PARTS = 120, 6
# Degrees of the grids in cells, by the number of corners.
_GRIDS = {1: 1, 2: 6, 3: 3, 4: 2}
# How often maps are moved to the foot of the tight point, the move below which this ends, and the slack below which it
# is useless.
_MOVED, _STILL, _FAR = 5, 1e-9, 0.1
# Feet of a cell that are tried together, at most.
_FEET = 3
# Maps whose points are nearer than this fraction of the size count as one.
_ALIKE = 1e-6
# If a point is farther away than the bound by more than this fraction, the search decides.
_SURELY = 1e-9
# The points of feet are rounded to multiples of this fraction of the size.
_BITS = 2.0**40
# How much wider a tube is than its samples need, and the least width, as a fraction of the size.
_WIDER, _THIN = 1.5, 2.0**-26


class _SurfaceCell(NamedTuple):
    """A piece of the source, a part of it by name, and the parameters of the part's corners."""

    piece: int
    name: str
    x: np.ndarray


def cover_with_surfaces(
    source: Side, target: Side, upper: float, max_cells: int, report: Callable[[int, int], None]
) -> list[dict[str, Any]]:
    """Return cells as `cover_by_cells` does, for shapes with an implicit surface; all in the unit of the arrays."""
    if isinstance(target, SurfaceSide) and not target.is_found:
        raise UncoveredError("no point of the other surface is proven: no change of sign of its polynomial was found.")
    left, entries = _first(source), []
    while left:
        cell = left.pop()
        entry = _Tried(source, target, cell, upper).entry()
        if entry is None:
            left += _halves(source, cell)
        else:
            entries.append(entry)
        if len(entries) + len(left) > max_cells:
            raise UncoveredError(f"more than {max_cells} cells are needed: raise max_cells, or atol.")
        report(len(entries), len(left))
    return sorted(entries, key=lambda entry: (entry["piece"], entry["cell"] or []))


def _first(source: Side) -> list[_SurfaceCell]:
    cells = []
    for piece, exact in enumerate(source.exact):
        if source.cell_corners < 3:
            x = np.linspace(0.0, 1.0, source.cell_corners)[:, None][:, : source.parameters]
            cells.append(_SurfaceCell(piece, "", x))
            continue
        triangles = roots(exact)
        cells += [
            _SurfaceCell(piece, str(k) if len(triangles) > 1 else "", np.array(x)) for k, x in enumerate(triangles)
        ]
    return cells[::-1]


def _halves(source: Side, cell: _SurfaceCell) -> list[_SurfaceCell]:
    if source.cell_corners == 1 or len(cell.name) >= MOST_CUTS:
        raise UncoveredError(f"piece {cell.piece} at {cell.x[0].tolist()} is not proven to be nearer than the bound.")
    if source.cell_corners == 4:
        letters = "ab"
    else:
        points = source.points(np.full(len(cell.x), cell.piece), cell.x)
        letters = longest_side(points)
    return [
        _SurfaceCell(cell.piece, cell.name + letter, np.asarray(half_of_cell(cell.x, letter, len(cell.name))))
        for letter in reversed(letters)
    ]


class _FootMap(NamedTuple):
    """A map of a cell into the target: rows of parameters or points, and a vector along which it crosses a surface."""

    piece: int
    rows: np.ndarray
    way: np.ndarray


class _Tried:
    """A cell for which an entry is searched."""

    def __init__(self, source: Side, target: Side, cell: _SurfaceCell, upper: float):
        self.source, self.target, self.cell, self.upper = source, target, cell, upper
        self.corners = len(cell.x)
        self.points = self._points(np.eye(self.corners))

    def entry(self) -> dict[str, Any] | None:
        """Return an entry that integers accept; None if none is found."""
        source, cell = self.source, self.cell
        exact = source.exact[cell.piece]
        self.map = simplex_map(exact, self.corners, cell.x.tolist())
        name: Any = cell.name if self.corners > 2 else cell.x[:, 0].tolist() if self.corners == 2 else None
        entry = {"piece": cell.piece, "cell": name, "feet": [], "multipliers": None, "bound": self.upper}
        if isinstance(source, SurfaceSide):
            entry["zero"] = None
            values = source.values(self._points(_grid(4, 4)))
            if np.min(values) * np.max(values) > 0 and self._is_free():
                return entry
        maps = self._maps()
        if not maps:
            return None
        for chosen in self._choices(maps):
            done = self._with(entry, chosen)
            if done is not None:
                return done
        return None

    def _is_free(self) -> bool:
        source = cast(SurfaceSide, self.source)
        return is_free(source.zeros, composed(source.exact[self.cell.piece], self.map))

    def _points(self, shares: np.ndarray) -> np.ndarray:
        return self.source.points(np.full(len(shares), self.cell.piece), shares @ self.cell.x)

    def _representatives(self) -> np.ndarray:
        """Return points of the source in the cell, for which feet are searched."""
        points = self._points(_grid(self.corners, _GRIDS[self.corners]))
        if not isinstance(self.source, SurfaceSide):
            return points
        shares = self.source.shares_on(self.points, _grid(4, _GRIDS[4]))
        return np.concatenate([shares, self.source.inside(self.points)]) @ self.points

    # ---- maps --------------------------------------------------------------------------------------

    def _maps(self) -> list[_FootMap]:
        """Return maps that follow the feet of some points of the cell."""
        places = self._representatives()
        if len(places):
            far = np.argsort(-np.sum((places - places.mean(axis=0)) ** 2, axis=1))
            chosen = np.concatenate([places[far[:4]], places[far[-1:]]])[::-1]
        else:
            chosen = self.points.mean(axis=0)[None]
        found: list[_FootMap] = []
        if isinstance(self.target, SurfaceSide):
            for place in chosen:
                feet = self.target.near(place)
                self._look(place, feet[0].distance if feet else np.inf, len(places) > 0)
                for foot in feet[: 1 if self.corners == 1 else 2]:
                    self._add(found, self._along_surface(place, foot))
            return found
        # Points that are not on the source cannot be too far away.
        near = self.target.feet_within(chosen, self.upper * (1 + _SURELY) if len(places) else np.inf)
        for k, place in enumerate(chosen):
            self._look(place, float(near.distance[k]), len(places) > 0)
            self._add(found, self._along_piece(int(near.piece[k]), near.x[k]))
        return found

    def _look(self, place: np.ndarray, distance: float, is_there: bool) -> None:
        """Raise UncoveredError if the point `place` of the source is farther away than the bound."""
        if not is_there:
            return
        if distance > self.upper * (1 + _SURELY):
            proven = self.target.proven_distance(place) if isinstance(self.target, SurfaceSide) else distance
            if proven > self.upper * (1 + 1e-12):
                raise UncoveredError(f"the place {place.tolist()} of piece {self.cell.piece} is farther away.")

    def _add(self, found: list[_FootMap], foot: _FootMap | None) -> None:
        if foot is None:
            return
        size = _ALIKE * float(np.max(np.abs(foot.rows), initial=1e-300))
        for other in found:
            if other.piece == foot.piece and np.max(np.abs(other.rows - foot.rows), initial=0.0) <= size:
                return
        found.append(foot)

    def _along_piece(self, piece: int, x: np.ndarray, u: np.ndarray | None = None) -> _FootMap:
        target, count = cast(ShapeSide, self.target), len(self.points)
        followed = target.local(np.full(count, piece), np.tile(x, (count, 1)), self.points).x
        followed = followed if u is None else followed + (x - u @ followed)
        rows = np.clip(np.round(followed * _BITS) / _BITS, 0.0, 1.0)
        if target.corners == (3,):
            rows[:, 1] = np.minimum(rows[:, 1], 1 - rows[:, 0])
        return _FootMap(piece, rows, np.zeros(3))

    def _along_surface(self, place: np.ndarray, foot: SurfaceFoot, u: np.ndarray | None = None) -> _FootMap | None:
        """Return the map that follows `foot` on the target surface, with a vector across it; None if it fails."""
        target = cast(SurfaceSide, self.target)
        free = ~foot.held
        slope = np.where(free, target.slopes(foot.point), 0.0)
        length = float(np.linalg.norm(slope))
        moved = foot.point + (self.points - place) @ foot.moves.T
        moved = moved if u is None else moved + (foot.point - u @ moved)
        if length == 0:
            is_zero = float(target.values(foot.point)) == 0
            return _FootMap(0, np.tile(foot.point, (self.corners, 1)), np.zeros(3)) if is_zero else None
        normal = slope / length
        rows = np.clip(moved, target.lower, target.upper)
        for _ in range(2):
            q = _grid(self.corners, _GRIDS[self.corners] + 1) @ rows
            s = _crossings(target, q, normal)
            if s is None:
                return None
            reach = _WIDER * float(np.max(np.abs(s))) + _THIN * target.size
            way = normal * reach
            low, high = target.lower + np.abs(way), target.upper - np.abs(way)
            if np.any(low > high):
                return None
            rows = np.where(free, np.clip(rows, low, high), foot.point)
        unit = 2.0 ** np.ceil(np.log2(target.size)) / _BITS
        rounded = np.where(free, np.round(rows / unit) * unit, foot.point)
        rounded = np.where(free & ((rounded < low) | (rounded > high)), rows, rounded)
        return _FootMap(0, rounded, target.without_tiny(np.where(free, way * (1 - 1e-9), 0.0)))

    # ---- proofs --------------------------------------------------------------------------------------

    def _choices(self, maps: list[_FootMap]) -> list[list[_FootMap]]:
        """Return single maps, the best first, or else one set of several maps."""
        places = self._representatives()
        if not len(places):
            return [maps[:1]]
        shares = self._shares(places)
        squares = np.stack([self._squares(foot, shares, places) for foot in maps])
        order = np.argsort(np.max(squares, axis=1))
        enough = self.upper**2 * (1 + _SURELY)
        single = [[maps[k]] for k in order[:2] if np.max(squares[k]) <= enough]
        if single:
            return single
        if np.max(np.min(squares, axis=0)) > enough or len(maps) < 2:
            return []
        chosen: list[int] = []
        while len(chosen) < _FEET:
            best = np.min(squares[chosen], axis=0) if chosen else np.full(len(places), np.inf)
            if np.all(best <= enough):
                break
            gains = [np.max(np.minimum(best, squares[k])) for k in range(len(maps))]
            chosen.append(int(np.argmin(gains)))
        return [[maps[k] for k in chosen]] if len(set(chosen)) > 1 else []

    def _shares(self, places: np.ndarray) -> np.ndarray:
        if isinstance(self.source, SurfaceSide):
            x = np.linalg.solve((self.points[1:] - self.points[0]).T, (places - self.points[0]).T).T
            return np.concatenate([1 - x.sum(axis=1, keepdims=True), x], axis=1)
        return _grid(self.corners, _GRIDS[self.corners])

    def _squares(self, foot: _FootMap, shares: np.ndarray, places: np.ndarray) -> np.ndarray:
        q = self._feet_at(foot, shares)
        if np.any(foot.way):
            normal = foot.way / np.linalg.norm(foot.way)
            s = _crossings(cast(SurfaceSide, self.target), q, normal)
            q = q if s is None else q + s[:, None] * normal
        return np.sum((places - q) ** 2, axis=1)

    def _feet_at(self, foot: _FootMap, shares: np.ndarray) -> np.ndarray:
        if isinstance(self.target, SurfaceSide):
            return shares @ foot.rows
        return self.target.points(np.full(len(shares), foot.piece), shares @ foot.rows)

    def _with(self, entry: dict[str, Any], feet: list[_FootMap]) -> dict[str, Any] | None:
        """Return the entry with these maps, moved to be sharp at the tight point; None if it is not proven."""
        intervals = len(feet) if isinstance(self.target, SurfaceSide) else 0
        tight = self._tight(feet, intervals)
        for _ in range(_MOVED):
            if tight is None or tight.is_clear or tight.least < -_FAR:
                break
            moved = [self._moved(foot, tight, k) for k, foot in enumerate(feet)]
            change = max(float(np.max(np.abs(x.rows - y.rows), initial=0.0)) for x, y in zip(feet, moved, strict=True))
            feet = moved
            tight = self._tight(feet, intervals, tight.u)
            if change < _STILL:
                break
        if tight is None or tight.least <= 0:
            return None
        terms = partial(self._terms, feet)
        found = plain_multipliers(terms, tight, len(feet), self._degrees(len(feet)))
        done = None if found is None else self._checked(entry, feet, found, _FEW_PARTS)
        if done is not None or tight.is_clear:
            return done
        found = convex_multipliers(terms, tight, len(feet))
        return None if found is None else self._checked(entry, feet, found, _PARTS)

    def _degrees(self, feet: int) -> tuple[int, int]:
        """Return the degrees of the polynomial to prove: in the cell and along a foot."""
        source, target = self.source, self.target
        mine, other = (1 if isinstance(side, SurfaceSide) else sum(side.degrees) for side in (source, target))
        inside, along = 2 * (mine + other) + (feet > 1), 0
        if isinstance(source, SurfaceSide):
            inside = max(inside, source.zeros.degree + 1)
        if isinstance(target, SurfaceSide):
            along = target.zeros.degree + 1
            inside = max(inside, along)
        return inside, along

    def _tight(self, feet: list[_FootMap], intervals: int, near: np.ndarray | None = None) -> TightPlace | None:
        constrain = partial(self._that_count, feet=feet[:intervals])
        return tight_place(partial(self._terms, feet), constrain, self.corners, intervals, near)

    def _moved(self, foot: _FootMap, tight: TightPlace, k: int) -> _FootMap:
        """Return the map that takes the tight point to its own foot; the map itself if no foot is near."""
        place, at = self._points(tight.u[None])[0], tight.u @ foot.rows
        if isinstance(self.target, SurfaceSide):
            found = self.target.foot(place, at + tight.s[k] * foot.way)
            moved = None if found is None else self._along_surface(place, found, tight.u)
        else:
            x = self.target.local(np.array([foot.piece]), at[None], place[None]).x[0]
            moved = self._along_piece(foot.piece, x, tight.u)
        return foot if moved is None else moved

    def _terms(self, feet: list[_FootMap], shares: np.ndarray, places: np.ndarray) -> Terms:
        """Return the slacks of feet, and the values of both polynomials, at samples of the cell."""
        points = self._points(shares)
        slacks, there = [], []
        mine = weights_of(self.source, self.cell.piece, shares @ self.cell.x)
        for k, foot in enumerate(feet):
            q, weight = self._feet_at(foot, shares), mine
            if isinstance(self.target, SurfaceSide):
                q = q + places[:, k : k + 1] * foot.way
                there.append(self.target.values(q))
            else:
                weight = mine * weights_of(self.target, foot.piece, shares @ foot.rows)
            slacks.append((1 - np.sum((points - q) ** 2, axis=1) / self.upper**2) * weight**2)
        here = self.source.values(points) if isinstance(self.source, SurfaceSide) else None
        return Terms(np.array(slacks), np.array(there).reshape(len(there), len(shares)), here)

    def _checked(
        self, entry: dict[str, Any], feet: list[_FootMap], found: SurfaceMultipliers, parts: int
    ) -> dict[str, Any] | None:
        """Return the entry, if integers accept it."""
        done = {**entry, "multipliers": found.feet}
        if isinstance(self.target, SurfaceSide):
            scale = self.upper**2 * self.target.scale
            done["feet"] = [
                {"map": shortest(foot.rows), "way": foot.way.tolist(), "zero": [x * scale for x in numbers]}
                for foot, numbers in zip(feet, found.there, strict=True)
            ]
        else:
            done["feet"] = [{"piece": f.piece, "map": shortest(f.rows), "weights": None} for f in feet]
        if isinstance(self.source, SurfaceSide):
            done["zero"] = [x * self.upper**2 * self.source.scale for x in found.here or [0.0]]
        zeros = [side.zeros if isinstance(side, SurfaceSide) else None for side in (self.source, self.target)]
        exact = self.source.exact[self.cell.piece]
        failed = failure_of_surface_cell(exact, self.map, self.target.exact, (zeros[0], zeros[1]), done, parts)
        return done if failed is None else None

    def _that_count(self, shares: np.ndarray, feet: list[_FootMap]) -> tuple[np.ndarray, np.ndarray]:
        """Return barycentric coordinates of source points near given ones, and the target points along the feet."""
        if isinstance(self.source, SurfaceSide):
            shares = self.source.shares_on(self.points, shares)
        places = np.zeros((len(shares), len(feet)))
        target = self.target
        for k, foot in enumerate(feet if isinstance(target, SurfaceSide) else []):
            length = float(np.linalg.norm(foot.way))
            if length > 0 and len(shares):
                s = _crossings(cast(SurfaceSide, target), shares @ foot.rows, foot.way / length)
                if s is None:
                    return shares[:0], places[:0]
                places[:, k] = np.clip(s / length, -1, 1)
        return shares, places


def weights_of(side: Side, piece: int, x: np.ndarray) -> np.ndarray:
    """Return the weights at parameters of a piece."""
    if isinstance(side, SurfaceSide):
        return np.ones(len(x))
    exact = side.exact[piece]
    first = side.rows[piece].reshape(-1, side.rows.shape[-1])[0, -1]
    return side.weights(np.full(len(x), piece), x) * (exact.weight[0] / 2.0**exact.bits / first)


def _grid(corners: int, degree: int) -> np.ndarray:
    return np.array(exponents(corners, degree), float) / degree


def _crossings(target: SurfaceSide, q: np.ndarray, normal: np.ndarray) -> np.ndarray | None:
    """Return the distances along the normal from points to the surface; None if Newton's method finds none."""
    s = np.zeros(len(q))
    for _ in range(8):
        at = q + s[:, None] * normal
        slope = target.slopes(at) @ normal
        s = s - target.values(at) / np.where(slope != 0, slope, 1.0)
        if np.max(np.abs(s)) > target.size:
            return None
    good = np.abs(target.values(q + s[:, None] * normal)) <= 1e-9 * (1e-3 + np.abs(slope)) * target.size
    return s if np.all(good & (slope > 0)) else None
