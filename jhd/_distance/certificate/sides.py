"""What certificates ask of a shape: points and feet in floating point, and the pieces in integers.

The proposals made here are checked in integers on the stored arrays; nothing is proven here. `ShapeSide` holds points,
curves, parametric surfaces and meshes, `SurfaceSide` an implicit surface.
"""

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np

from jhd._distance.certificate.cutting import Entry
from jhd._distance.certificate.verification.pieces import ExactPiece, Part
from jhd._distance.certificate.verification.structure import digest
from jhd._distance.certificate.verification.zeros import NearZero, ZeroSet
from jhd._shapes.as_shape import Shape
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.mesh import TriangleMesh


def plain_shape(shape: Shape) -> dict[str, Any]:
    """The arrays of a shape in the form in which certificates hold them, with their hash."""
    if isinstance(shape, ImplicitSurface):
        plain = {"kind": "surface", "coefficients": _rows(shape.coefficients)}
        plain |= {"lower": _rows(shape.lower), "upper": _rows(shape.upper)}
    elif isinstance(shape, TriangleMesh):
        plain = {"kind": "mesh", "vertices": _rows(shape.vertices), "triangles": _rows(shape.triangles)}
    else:
        is_curve = isinstance(shape, AbstractCurve)
        working = shape.segments() if is_curve else shape.patches()
        weights = None if working.weights is None else _rows(working.weights)
        kind = "curve" if is_curve else "patches"
        plain = {"kind": kind, "control_points": _rows(working.control_points), "weights": weights}
    return {**plain, "sha256": digest(plain)}


def _rows(numbers: Any) -> list[Any]:
    return np.asarray(numbers).tolist()


class ShapePlace(NamedTuple):
    """A point of a shape: its entry in a certificate, and a nearby point with a bound of the distance to it."""

    entry: Entry
    near: NearZero

    @property
    def point(self) -> np.ndarray:
        """Return the point in floating point."""
        weight = self.near.point.weight[0]
        return np.array([f.get(0, 0) / weight for f in self.near.point.coordinates])


class FootMap(NamedTuple):
    """A map of a cell into a shape, and a vector along which it crosses an implicit surface.

    `rows` holds the parameters on the piece at the corners of the cell; on an implicit surface, points.
    """

    piece: int
    rows: np.ndarray
    way: np.ndarray


class NearMaps(NamedTuple):
    """The distance of a point of a cell, and maps of the cell that follow the feet of this point."""

    distance: float
    maps: list[FootMap]


class AbstractPieces(ABC):
    """Pieces of a shape: in integers, and in floating point.

    Cells are given by the points of their corners, (corners, dim), and points of a cell by their barycentric
    coordinates, (samples, corners).
    """

    exact: list[ExactPiece]
    # Number of corners of the simplices that cover a piece.
    cell_corners: int
    # Coordinates are divided by two to this power.
    exponent: int
    # Control points whose hulls hold the pieces, (pieces, points, dim).
    hulls: np.ndarray
    # The polynomial of an implicit surface.
    zeros: ZeroSet | None = None
    # Values of the polynomial in floating point are the polynomial's values times this.
    scale: float = 1.0

    def scaled(self, points: np.ndarray) -> np.ndarray:
        """Return points given in the unit of the stored arrays, in the unit of the side."""
        return points

    @abstractmethod
    def points(self, piece: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Return the points at parameters (n, parameters) of pieces (n,)."""

    def values_at(self, points: np.ndarray) -> np.ndarray | None:
        """Return the values of the polynomial of an implicit surface."""
        return None

    def is_empty(self, part: Part, points: np.ndarray) -> bool:
        """Return whether a part is proven to hold no point of the shape; `points` are some of its points."""
        return False

    def shares_in(self, corners: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Return samples of the shape in a cell: near given ones, and others that are known."""
        return shares

    def shares_on(self, corners: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Return samples of the shape in a cell, near given ones."""
        return shares


class AbstractSide(AbstractPieces):
    """A shape of a pair.

    Positions along the vectors of maps go from -1 to 1; maps into parametric shapes have none.
    """

    # Degree of the points of a cell in the coordinates of the cell.
    cell_degree: int

    @property
    def is_found(self) -> bool:
        """Return whether any points of the shape are known."""
        return True

    @abstractmethod
    def distance(self, point: np.ndarray) -> float:
        """Approximate distance of a point given in the unit of the stored arrays."""

    @abstractmethod
    def place(self, point: np.ndarray) -> ShapePlace | None:
        """Return a point of the shape near a point in the unit of the stored arrays; None if none is proven."""

    @abstractmethod
    def named(self, piece: int, t: np.ndarray, point: np.ndarray | None = None) -> ShapePlace | None:
        """Return the point of the shape at parameters of a piece, or next to `point`; None if there is none."""

    @abstractmethod
    def samples(self, draw: np.random.Generator, count: int) -> np.ndarray:
        """Return at most `count` points of the shape."""

    @abstractmethod
    def beside(self, points: np.ndarray) -> np.ndarray:
        """Return points of the shape near some points."""

    # ---- cells of the shape ------------------------------------------------------------------------

    @abstractmethod
    def weights_at(self, piece: int, x: np.ndarray) -> np.ndarray:
        """Return the weights at parameters of a piece, in the unit of its integers."""

    # ---- maps of cells into the shape ----------------------------------------------------------------

    @abstractmethod
    def maps_near(self, corners: np.ndarray, points: np.ndarray, limit: float) -> list[NearMaps]:
        """Return for points of a cell their distances, and maps of the cell that follow their feet.

        Feet that are farther than the limit are searched again, if a search for the nearest one may help.
        """

    def proven_distance(self, point: np.ndarray, distance: float) -> float:
        """Return a lower bound of the distance of a point, whose approximate distance is known."""
        return distance

    @abstractmethod
    def moved(
        self, corners: np.ndarray, foot: FootMap, u: np.ndarray, point: np.ndarray, position: float
    ) -> FootMap | None:
        """Return a map that takes a point of the cell, at the coordinates `u`, to its own foot; None without one.

        `position` is the position of the foot along the vector of the map.
        """

    @abstractmethod
    def feet_at(self, foot: FootMap, shares: np.ndarray) -> np.ndarray:
        """Return the points of a map."""

    def crossings(self, foot: FootMap, feet: np.ndarray) -> np.ndarray | None:
        """Return the positions of points of the shape along the vector of a map; None if they are not found."""
        return np.zeros(len(feet))
