"""Curves and surfaces of IGES files: B-splines, rational or not, lines, circular arcs, and composite curves.

The entities read follow IGES 5.3 (US PRO/IPO-100, 1996): spline curves 126 (section 4.23) and surfaces 128 (4.24),
lines 110 (4.13), arcs 100 (4.3), composite curves 102 (4.4), each with its transformation matrix 124 (4.21). Form
numbers classify splines and are not needed. Coordinates are converted from the unit of the file to millimeters, which
rounds them if the units differ.

Entities that are not shapes by themselves are skipped: hidden entities, annotation, definitions, curves in the
parameters of a surface, parts of other entities, and entities without geometry (colors, properties, groups, views). All
other entities are refused by name, including trimmed surfaces: dropping them would change the distance.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np

from jhd._io.errors import ParseError, read_bytes
from jhd._io.iges_file import UNITS, IgesEntry, IgesFile, IgesRecord, read_iges
from jhd._runtime.arrays import array_of
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.patch import BezierPatch, BezierPatches

IgesShape = BSplineCurve | BezierSegments | BSplineSurface

IGES_SUFFIXES = (".igs", ".iges")
ARC, COMPOSITE, LINE, MATRIX, CURVE, SURFACE = 100, 102, 110, 124, 126, 128
# Nothing to measure: null, directions, matrices, fonts, colors, units, groups, drawings, properties, views; and
# annotation, which has the types from 202 to 230.
_SILENT = frozenset((0, 123, MATRIX, 302, 304, 308, 310, 312, 314, 316, 320, 322, 402, 404, 406, 410, *range(202, 231)))
# Entity use flags of geometry, other and construction geometry; the rest is annotation, definitions, 2-D parameters.
_USES = (0, 3, 6)
_NAMES = {
    104: "conic arc", 106: "copious data", 108: "plane",
    112: "parametric spline curve", 114: "parametric spline surface", 116: "point", 118: "ruled surface",
    120: "surface of revolution", 122: "tabulated cylinder", 130: "offset curve", 140: "offset surface",
    141: "boundary", 142: "curve on a parametric surface", 143: "bounded surface", 144: "trimmed surface",
    150: "block", 154: "cylinder", 156: "cone frustum", 158: "sphere", 160: "torus", 162: "solid of revolution",
    180: "boolean tree", 184: "solid assembly", 186: "solid", 190: "plane surface", 192: "cylindrical surface",
    194: "conical surface", 196: "spherical surface", 198: "toroidal surface", 408: "subfigure instance",
    412: "rectangular array", 414: "circular array", 416: "external reference", 430: "solid instance",
    508: "loop", 510: "face", 514: "shell",
}  # fmt: skip


def load_iges(file: str | Path, unit: str | None = "MM") -> list[IgesShape]:
    """Load the curves and surfaces of an IGES file, in the order of its directory.

    Curves are in space, also if they lie in a plane. Circular arcs become rational quadratics of at most a quarter
    turn, up to rounding. They end at the points in the file; arcs whose ends coincide are full circles. A curve that is
    marked as periodic is returned as periodic if its points and knots repeat. Curves and surfaces are cut to the
    parameters that their entity names.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> with TemporaryDirectory() as folder:
    ...     jhd.io.save_iges(f"{folder}/curve.igs", jhd.BezierCurve([[0, 0, 0], [1, 2, 0], [2, 0, 0]]))
    ...     jhd.io.load_iges(f"{folder}/curve.igs")[0].control_points.tolist()
    [[0.0, 0.0, 0.0], [1.0, 2.0, 0.0], [2.0, 0.0, 0.0]]

    Args:
        file: name of a file in the fixed format of IGES 5.3 or earlier, with lines of 80 columns.
        unit: unit of the returned coordinates: IN, MM (the default), FT, MI, M, KM, MIL, UM, CM or UIN. The conversion
            rounds once or twice. None returns the numbers of the file, whatever its unit.

    Returns:
        B-spline curves and surfaces; lines, arcs and composite curves as BezierSegments.

    Raises:
        FileNotFoundError: the file does not exist.
        ParseError: a file that cannot be read, with the line and the entity; an unsupported entity, for example a
            trimmed surface; an unknown unit in the file; or a file without curves and surfaces.
        ValueError: `unit` is not one of these.
    """
    if unit is not None and unit not in UNITS:
        raise ValueError(f"unit is {unit!r}; needs one of {', '.join(UNITS)}, or None.")
    found = read_iges(file, read_bytes(file))
    reader = _IgesReader(found)
    shapes = [reader.shape(entry) for entry in found.entries.values() if _is_shape(entry) and not entry.dependent]
    if not shapes:
        raise ParseError("holds no curve or surface (entities 100, 102, 110, 126 and 128) that stands by itself.", file)
    factor = 1.0 if unit is None else UNITS[found.unit()][1] / UNITS[unit][1]
    return shapes if factor == 1 else [_scaled(found, shape, factor) for shape in shapes]


def _scaled(found: IgesFile, shape: Any, factor: float) -> Any:
    with np.errstate(over="ignore"):
        points = np.asarray(shape.control_points) * factor
    if not np.isfinite(points).all():
        raise ParseError("holds coordinates beyond the range of doubles in the unit that is asked for.", found.name)
    return eqx.tree_at(lambda known: known.control_points, shape, array_of(points))


def united(shapes: Sequence[IgesShape]) -> BezierSegments | BezierPatches:
    """Several curves, or several surfaces, as one."""
    curves = [_single(shape) for shape in shapes if isinstance(shape, AbstractCurve)]
    return BezierSegments.join(curves) if curves else BezierPatches.join([_single(shape) for shape in shapes])


def _single(shape: Any) -> Any:
    """The spline, as a Bezier curve or patch if it is one: the way through knots rounds products with weights."""
    points, weights = shape.control_points, shape.weights
    if isinstance(shape, BSplineCurve) and not shape.periodic and _is_span(shape.knots, shape.degree):
        return BezierCurve(points, weights)
    if isinstance(shape, BSplineSurface) and all(map(_is_span, (shape.knots_u, shape.knots_v), shape.degrees)):
        return BezierPatch(points, weights)
    return shape


def _is_span(knots: Any, degree: int) -> bool:
    """Whether the knots are two of multiplicity degree + 1."""
    known = np.asarray(knots)
    return len(known) == 2 * degree + 2 and bool(known[0] == known[degree] and known[-1] == known[degree + 1])


def _is_shape(entry: IgesEntry) -> bool:
    return not entry.blanked and entry.use in _USES and entry.type not in _SILENT


class _IgesReader:
    """Entities as shapes; each matrix is read once, and each curve is part of one composite curve at most."""

    def __init__(self, found: IgesFile):
        self.found = found
        self.parts: set[int] = set()
        self.matrices: dict[int, np.ndarray] = {}

    def shape(self, entry: IgesEntry) -> IgesShape:
        """The shape that an entity stands for."""
        if entry.type == COMPOSITE:
            return self._composite(entry)
        if entry.type not in _READ:
            known = _NAMES.get(entry.type, "an entity of another kind")
            message = (
                f"entity {entry.type} (D{entry.sequence}), {known}, is not read; needs lines (110), circular arcs "
            )
            message += "(100), and untrimmed B-spline curves (126) and surfaces (128)."
            raise ParseError(message, self.found.name, entry.line)
        record = self.found.record(entry)
        try:
            return _READ[entry.type](record, self._matrix(entry))
        except ParseError:
            raise
        except ValueError as error:
            raise record.error(f"is not a valid shape: {error}") from None

    def _composite(self, entry: IgesEntry) -> BezierSegments:
        """Entity 102: the number of parts and pointers to them; the parts joined in order and transformed."""
        record = self.found.record(entry)
        count = record.integer(1)
        if count < 1:
            raise record.error(f"has {count} parts; needs at least 1.")
        record.needs(1 + count)
        parts = []
        for k in range(count):
            pointer = record.integer(2 + k)
            part = self.found.entries.get(pointer)
            if part is None or part.type not in _PARTS:
                what = "which is not there" if part is None else f"entity {part.type}"
                raise record.error(
                    f"names D{pointer}, {what}; its parts must be lines (110), circular arcs "
                    "(100) or B-spline curves (126)."
                )
            if pointer in self.parts:
                raise record.error(f"names D{pointer}, which is part of a composite curve already.")
            self.parts.add(pointer)
            parts.append(self.shape(part))
        joined = BezierSegments.join([_single(part) for part in parts])
        matrix = self._matrix(entry)
        if matrix is None:
            return joined
        points = _placed(np.asarray(joined.control_points), matrix)
        return BezierSegments(points, joined.weights, joined.next_segment)

    def _matrix(self, entry: IgesEntry) -> np.ndarray | None:
        """The rows (R, T) of x -> R x + T, matrices of matrices multiplied; None if nothing is to be moved."""
        chain: dict[int, None] = {}
        at = entry.matrix
        while at and at not in self.matrices:
            known = self.found.entries.get(at)
            if known is None or known.type != MATRIX or at in chain:
                reason = "is not a transformation matrix (124)" if at not in chain else "refers to itself"
                message = f"D{at}, the matrix of D{entry.sequence}, {reason}."
                raise ParseError(message, self.found.name, entry.line)
            chain[at] = None
            at = known.matrix
        outer = self.matrices.get(at)
        for sequence in reversed(chain):
            outer = _composed(outer, _rows(self.found.record(self.found.entries[sequence])))
            self.matrices[sequence] = outer
        return outer


def _rows(record: IgesRecord) -> np.ndarray:
    """The rows of a transformation matrix; forms 10 to 12 hold coordinate systems of finite elements."""
    if record.entry.form not in (0, 1):
        raise record.error(f"is of form {record.entry.form}; needs 0 or 1.")
    record.needs(12)
    rows = np.array(record.reals(1, 12)).reshape(3, 4)
    if not np.isfinite(rows).all():
        raise record.error("holds a number that is not finite.")
    return rows


def _composed(outer: np.ndarray | None, inner: np.ndarray) -> np.ndarray:
    if outer is None:
        return inner
    return np.column_stack([_product(outer[:, :3], inner[:, :3]), _placed(inner[:, 3], outer)])


def _placed(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    # Numbers that overflow are refused as points that are not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        return _product(points, matrix[:, :3].T) + matrix[:, 3]


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The product a b, summed in a fixed order: equal points have equal images."""
    with np.errstate(over="ignore", invalid="ignore"):
        return a[..., 0, None] * b[0] + a[..., 1, None] * b[1] + a[..., 2, None] * b[2]


def _degree(record: IgesRecord, last: int, degree: int) -> None:
    if not 1 <= degree <= last:
        raise record.error(f"has degree {degree} and {last + 1} points; needs at least 1, and more points.")


def _weights(record: IgesRecord, weights: np.ndarray, polynomial: bool) -> np.ndarray | None:
    """The weights, None if the entity says that it is polynomial."""
    if polynomial and np.any(weights != weights.flat[0]):
        raise record.error("says that it is polynomial, and its weights differ.")
    return None if polynomial and weights.flat[0] > 0 else weights


def _ends(record: IgesRecord, ends: Sequence[float], knots: Sequence[float], degree: int) -> tuple[float, float]:
    """First and last parameter, clipped to the domain of the knots if they exceed it by rounding only."""
    lower, upper = knots[degree], knots[len(knots) - 1 - degree]
    # Largest distance of the ends of a spline beyond its knots, relative to their domain: other software writes ten
    # digits.
    room = 1e-9 * (upper - lower)
    start, stop = (min(max(end, lower), upper) if lower - room <= end <= upper + room else end for end in ends)
    if not lower <= start < stop <= upper:
        first, last, low, high = (f"{x:.12g}" for x in (*ends, lower, upper))
        raise record.error(f"runs from {first} to {last}; its knots have the domain {low} to {high}.")
    return start, stop


def _curve(record: IgesRecord, matrix: np.ndarray | None) -> BSplineCurve:
    """Entity 126: K, M, four flags, K + M + 2 knots, K + 1 weights, K + 1 points, first and last parameter."""
    record.needs(6)
    last, degree = record.integer(1), record.integer(2)
    _degree(record, last, degree)
    polynomial, periodic = record.flag(5), record.flag(6)
    count, knots_count = last + 1, last + degree + 2
    record.needs(6 + knots_count + 4 * count + 2)
    knots = record.reals(7, knots_count)
    weights = np.array(record.reals(7 + knots_count, count))
    points = np.array(record.reals(7 + knots_count + count, 3 * count)).reshape(count, 3)
    points = points if matrix is None else _placed(points, matrix)
    curve = BSplineCurve(points, knots, _weights(record, weights, polynomial))
    start, stop = _ends(record, record.reals(7 + knots_count + 4 * count, 2), knots, degree)
    if (start, stop) == (knots[degree], knots[count]):
        return curve.to_periodic() if periodic else curve
    curve = curve.split(start)[1] if start > knots[degree] else curve
    return curve.split(stop)[0] if stop < knots[count] else curve


def _surface(record: IgesRecord, matrix: np.ndarray | None) -> BSplineSurface:
    """Entity 128: K1, K2, M1, M2, five flags, knots, weights, points (both along u first), and the ends in u and v."""
    record.needs(9)
    last_u, last_v, p, q = (record.integer(k) for k in (1, 2, 3, 4))
    for last, degree in ((last_u, p), (last_v, q)):
        _degree(record, last, degree)
    polynomial = record.flag(7)
    rows, columns, knots_u, knots_v = last_u + 1, last_v + 1, last_u + p + 2, last_v + q + 2
    count = rows * columns
    record.needs(9 + knots_u + knots_v + 4 * count + 4)
    at = 10
    in_u, at = record.reals(at, knots_u), at + knots_u
    in_v, at = record.reals(at, knots_v), at + knots_v
    weights, at = np.array(record.reals(at, count)).reshape(columns, rows).T, at + count
    points, at = np.array(record.reals(at, 3 * count)).reshape(columns, rows, 3).swapaxes(0, 1), at + 3 * count
    points = points if matrix is None else _placed(points, matrix)
    surface = BSplineSurface(points, in_u, in_v, _weights(record, weights, polynomial))
    u = _ends(record, record.reals(at, 2), in_u, p)
    v = _ends(record, record.reals(at + 2, 2), in_v, q)
    whole = u == (in_u[p], in_u[rows]) and v == (in_v[q], in_v[columns])
    return surface if whole else surface.restrict(*u, *v)


def _line(record: IgesRecord, matrix: np.ndarray | None) -> BezierSegments:
    """Entity 110: the coordinates of both ends; forms 1 and 2 have no second end, or none."""
    if record.entry.form != 0:
        raise record.error(f"is of form {record.entry.form}, a line without an end; needs form 0.")
    record.needs(6)
    points = np.array(record.reals(1, 6)).reshape(1, 2, 3)
    return BezierSegments(points if matrix is None else _placed(points, matrix))


def _arc(record: IgesRecord, matrix: np.ndarray | None) -> BezierSegments:
    """Entity 100: the height of its plane, then x and y of the center and both ends; counter-clockwise from above."""
    record.needs(7)
    height, *numbers = record.reals(1, 7)
    center, start, end = np.array(numbers).reshape(3, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        first, last = start - center, end - center
        radii = np.hypot(*first), np.hypot(*last)
        # Largest relative difference of the distances of the ends of an arc from its center: files of few digits are
        # read.
        if not (min(radii) > 0 and abs(radii[0] - radii[1]) <= 1e-4 * radii[0]):
            raise record.error(f"ends {radii[0]:g} and {radii[1]:g} from its center; an arc has one radius, above 0.")
    turn = float(np.arctan2(first[0] * last[1] - first[1] * last[0], first @ last)) % (2 * np.pi)
    if np.array_equal(start, end):
        turn = 2 * np.pi
    count = max(1, int(np.ceil(turn / (0.5 * np.pi) * (1 - 1e-12))))
    angles = turn / count * np.arange(count + 1)
    legs = np.stack([first, [-first[1], first[0]]])
    around = np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ legs
    around[-1] = last
    cosine = np.cos(0.5 * turn / count)
    middle = 0.5 * (around[:-1] + around[1:]) / cosine**2
    points = np.stack([around[:-1], middle, around[1:]], axis=1) + center
    # The ends themselves, so that joints stay joints.
    points[0, 0], points[-1, 2] = start, end
    points = np.concatenate([points, np.full((count, 3, 1), height)], axis=-1)
    weights = np.tile([1.0, cosine, 1.0], (count, 1))
    return BezierSegments(points if matrix is None else _placed(points, matrix), weights)


# Entities that are shapes by themselves, and parts of composite curves.
_READ = {ARC: _arc, LINE: _line, CURVE: _curve, SURFACE: _surface}
_PARTS = (ARC, LINE, CURVE)
