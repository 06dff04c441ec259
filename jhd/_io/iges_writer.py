"""B-spline curves and surfaces to IGES files: entities 126 and 128, and 102 for joined segments.

The layout and the entities follow IGES 5.3 (US PRO/IPO-100, 1996), sections 2.2, 4.4, 4.23 and 4.24. Numbers are
written in double precision with all digits, so that `load_iges` reads the same floats back.
"""

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jhd._io.iges import COMPOSITE, CURVE, SURFACE
from jhd._io.iges_file import UNITS
from jhd._runtime.files import replace_file
from jhd._shapes.bezier import BezierCurve
from jhd._shapes.bspline import BSplineCurve
from jhd._shapes.bspline_surface import BSplineSurface
from jhd._shapes.curve import AbstractCurve, BezierSegments
from jhd._shapes.knots import unrolled
from jhd._shapes.patch import AbstractPatch, BezierPatch

# Numbers of lines have seven digits.
_MOST_LINES = 9_999_999
# Length that a reader need not tell from zero, as a fraction of the largest coordinate: the default gap of distances.
_RESOLUTION = 1e-10
# Parts of a composite curve depend on it.
_PART, _ALONE = "00010000", "00000000"


class _IgesEntity(NamedTuple):
    """The type, the status, and the words behind the type."""

    type: int
    status: str
    words: list[str]


def save_iges(
    file: str | Path,
    shapes: AbstractCurve | AbstractPatch | Sequence[AbstractCurve | AbstractPatch],
    *,
    unit: str = "MM",
) -> None:
    """Write curves and parametric surfaces to an IGES file, bit for bit.

    A B-spline or Bezier curve becomes an entity 126, in the plane z = 0 if it has two coordinates. Segments become one
    entity 126 each; joined segments form a composite curve 102. A B-spline surface or patch becomes an entity 128, and
    so does each of several patches. Rational shapes stay rational.

    >>> from tempfile import TemporaryDirectory
    >>> import jhd
    >>> with TemporaryDirectory() as folder:
    ...     jhd.io.save_iges(f"{folder}/curve.igs", jhd.BezierCurve([[0, 0], [1, 2], [2, 0]]))
    ...     jhd.io.load_iges(f"{folder}/curve.igs")[0].control_points.tolist()
    [[0.0, 0.0, 0.0], [1.0, 2.0, 0.0], [2.0, 0.0, 0.0]]

    Args:
        file: name of the file. An existing file is replaced.
        shapes: a curve or parametric surface, or several.
        unit: unit of the coordinates, stored in the file: IN, MM (the default), FT, MI, M, KM, MIL, UM, CM or UIN.
            Nothing is scaled.

    Returns:
        None.

    Raises:
        TypeError: an entry that is neither a curve nor a parametric surface.
        ValueError: no shape, a point set (degree 0), another unit, or more lines than an IGES file can have.
    """
    if unit not in UNITS:
        raise ValueError(f"unit is {unit!r}; needs one of {', '.join(UNITS)}.")
    several: Sequence[Any] = [shapes] if isinstance(shapes, AbstractCurve | AbstractPatch) else list(shapes)
    if not several:
        raise ValueError("shapes is empty; needs at least one curve or surface.")
    entities: list[_IgesEntity] = []
    for index, shape in enumerate(several):
        _append(entities, f"shapes[{index}]", shape)
    largest = max(float(np.abs(np.asarray(shape.control_points)).max()) for shape in several)
    replace_file(file, _sheet(Path(file).name, entities, largest, unit).encode("ascii"))


def _append(entities: list[_IgesEntity], name: str, shape: Any) -> None:
    """Append the entities of a shape."""
    if isinstance(shape, AbstractPatch):
        nets = [shape] if isinstance(shape, BSplineSurface | BezierPatch) else _patches(shape)
        for net in nets:
            _check_degrees(name, net.degrees)
            entities.append(_surface(net))
        return
    if not isinstance(shape, AbstractCurve):
        raise TypeError(f"{name} must be a curve or a parametric surface; got {type(shape).__name__}.")
    if isinstance(shape, BSplineCurve | BezierCurve):
        _check_degrees(name, [shape.degree])
        entities.append(_curve(shape, _ALONE))
        return
    segments = shape.segments()
    _check_degrees(name, [segments.degree])
    for run in _runs(segments):
        first = len(entities)
        entities.extend(_curve(piece, _PART if len(run) > 1 else _ALONE) for piece in run)
        if len(run) > 1:
            pointers = [str(2 * k + 1) for k in range(first, len(entities))]
            entities.append(_IgesEntity(COMPOSITE, _ALONE, [str(len(run)), *pointers]))


def _check_degrees(name: str, degrees: Sequence[int]) -> None:
    if min(degrees) < 1:
        raise ValueError(f"{name} has degree {min(degrees)}; the splines of IGES have degree 1 at least.")


def _patches(shape: AbstractPatch) -> list[BezierPatch]:
    whole = shape.patches()
    weights = [None] * whole.count if whole.weights is None else list(np.asarray(whole.weights))
    return [BezierPatch(*pair) for pair in zip(np.asarray(whole.control_points), weights, strict=True)]


def _runs(segments: BezierSegments) -> list[list[BezierCurve]]:
    """The segments as curves, grouped into runs of consecutive segments."""
    points, following = np.asarray(segments.control_points), np.asarray(segments.next_segment)
    weights = [None] * len(points) if segments.weights is None else list(np.asarray(segments.weights))
    runs: list[list[BezierCurve]] = []
    for k, pair in enumerate(zip(points, weights, strict=True)):
        if k == 0 or following[k - 1] != k:
            runs.append([])
        runs[-1].append(BezierCurve(*pair))
    return runs


def _bezier_knots(degree: int) -> np.ndarray:
    return np.repeat([0.0, 1.0], degree + 1)


def _curve(curve: BSplineCurve | BezierCurve, status: str) -> _IgesEntity:
    points, weights, p = np.asarray(curve.control_points), curve.weights, curve.degree
    weights = None if weights is None else np.asarray(weights)
    knots, periodic = _bezier_knots(p), isinstance(curve, BSplineCurve) and curve.periodic
    if isinstance(curve, BSplineCurve):
        knots = unrolled(np.asarray(curve.knots), p, periodic)
    if periodic:
        points = np.concatenate([points, points[:p]])
        weights = None if weights is None else np.concatenate([weights, weights[:p]])
    flat = points.shape[1] == 2
    points = np.column_stack([points, np.zeros(len(points))]) if flat else points
    closed = periodic or _returns(points, knots, p)
    words = [str(len(points) - 1), str(p), *(str(int(x)) for x in (flat, closed, weights is None, periodic))]
    weights = np.ones(len(points)) if weights is None else weights
    ends = knots[[p, len(points)]]
    return _IgesEntity(CURVE, status, words + _reals(knots, weights, points, ends, [0.0, 0.0, float(flat)]))


def _surface(surface: BSplineSurface | BezierPatch) -> _IgesEntity:
    points, weights, (p, q) = np.asarray(surface.control_points), surface.weights, surface.degrees
    rows, columns = points.shape[:2]
    in_u, in_v = _bezier_knots(p), _bezier_knots(q)
    if isinstance(surface, BSplineSurface):
        in_u, in_v = np.asarray(surface.knots_u), np.asarray(surface.knots_v)
    closed = _returns(points, in_u, p), _returns(points.swapaxes(0, 1), in_v, q)
    words = [str(x) for x in (rows - 1, columns - 1, p, q, int(closed[0]), int(closed[1]), int(weights is None), 0, 0)]
    weights = np.ones((rows, columns)) if weights is None else np.asarray(weights)
    ends = [*in_u[[p, rows]], *in_v[[q, columns]]]
    # The first index runs first.
    return _IgesEntity(SURFACE, _ALONE, words + _reals(in_u, in_v, weights.T, points.swapaxes(0, 1), ends))


def _returns(points: np.ndarray, knots: np.ndarray, degree: int) -> bool:
    """Whether a clamped spline ends where it starts."""
    clamped = knots[0] == knots[degree] and knots[-1] == knots[len(points)]
    return bool(clamped and np.array_equal(points[0], points[-1]))


def _reals(*arrays: Any) -> list[str]:
    return [_real(x) for array in arrays for x in np.asarray(array, np.float64).ravel().tolist()]


def _real(x: float) -> str:
    """The shortest number that is read as x, with a decimal point and D before its exponent (2.2.2.2)."""
    mantissa, _, exponent = repr(x).partition("e")
    mantissa = mantissa if "." in mantissa else mantissa + "."
    return f"{mantissa}D{int(exponent)}" if exponent else mantissa


def _sheet(name: str, entities: Sequence[_IgesEntity], largest: float, unit: str) -> str:
    """The text of an IGES file with these entities: start, global, directory, parameter and terminate section."""
    directory, parameters = [], []
    for index, entity in enumerate(entities):
        # Columns of data in the parameter section.
        rows = _rows([str(entity.type), *entity.words], 64)
        first = (entity.type, len(parameters) + 1, 0, 0, 0, 0, 0, 0)
        second = (entity.type, 0, 0, len(rows), 0, "", "", "", 0)
        directory.append("".join(f"{x:>8}" for x in first) + entity.status)
        directory.append("".join(f"{x:>8}" for x in second))
        parameters += [f"{row:<64} {2 * index + 1:>7}" for row in rows]
    # Columns of data in the global section.
    sections = {
        "S": ["B-spline curves and surfaces, written by jhd"],
        "G": _rows(_global_words(name, largest, unit), 72),
        "D": directory,
        "P": parameters,
    }
    if len(parameters) > _MOST_LINES:
        raise ValueError(f"the shapes take {len(parameters)} lines of parameters; an IGES file has {_MOST_LINES}.")
    sections["T"] = ["".join(f"{letter}{len(rows):07}" for letter, rows in sections.items())]
    return "".join(
        f"{row:<72}{letter}{number:>7}\n" for letter, rows in sections.items() for number, row in enumerate(rows, 1)
    )


def _global_words(name: str, largest: float, unit: str) -> list[str]:
    """The parameters of the global section (2.2.4.3), delimiters first."""
    plain = "".join(x if 32 <= ord(x) < 127 else "?" for x in name)[-60:] or "?"
    now = datetime.now(UTC).strftime("%Y%m%d.%H%M%S")
    numbers = ["32", "38", "6", "308", "15"]
    resolution = _RESOLUTION * largest or _RESOLUTION
    texts = [f"{len(x)}H{x}" for x in ("jhd", plain, "jhd", "1")]
    scale = ["1.", str(UNITS[unit][0]), f"{len(unit)}H{unit}", "1", "1."]
    sizes = [f"15H{now}", _real(resolution), _real(largest)]
    return ["1H,", "1H;", *texts, *numbers, "3Hjhd", *scale, *sizes, "3Hjhd", "3Hjhd", "11", "0", f"15H{now}", ""]


def _rows(words: Iterable[str], width: int) -> list[str]:
    """The words, separated by commas and ended by a semicolon, in lines that break after a comma."""
    words = list(words)
    rows = [""]
    for k, word in enumerate(words):
        part = word + (";" if k == len(words) - 1 else ",")
        if len(rows[-1]) + len(part) > width:
            rows.append("")
        rows[-1] += part
    return rows
