"""Types of other packages: accepted arguments, by the attributes that tell them apart, and returned objects.

None of these packages is imported. If one has no annotations, type checkers accept all of its objects.
"""
# ruff: noqa: D102

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from typing_extensions import TypeAliasType

if TYPE_CHECKING:
    import matplotlib.axes
    import matplotlib.path
    import pyvista  # pyright: ignore[reportMissingImports]
    import scipy.interpolate
    import shapely.geometry.base
    import trimesh

Axes = TypeAliasType("Axes", "matplotlib.axes.Axes")
Path = TypeAliasType("Path", "matplotlib.path.Path")
PolyData = TypeAliasType("PolyData", "pyvista.PolyData")
BSpline = TypeAliasType("BSpline", "scipy.interpolate.BSpline | scipy.interpolate.NdBSpline")
Geometry = TypeAliasType("Geometry", "shapely.geometry.base.BaseGeometry")
Trimesh = TypeAliasType("Trimesh", "trimesh.Trimesh")


@runtime_checkable
class ConvertsToArray(Protocol):
    """An object that NumPy converts to an array, for example the coordinates of a line of shapely."""

    def __array__(self) -> np.ndarray: ...


@runtime_checkable
class HasCoords(Protocol):
    """A line with coordinates, for example a shapely LineString."""

    @property
    def coords(self) -> object: ...


@runtime_checkable
class HasVertices(Protocol):
    """A mesh of trimesh or Open3D (with `faces` or `triangles`), or a matplotlib Path (with `codes`)."""

    @property
    def vertices(self) -> object: ...


@runtime_checkable
class HasPoints(Protocol):
    """A mesh, a set of lines or a point cloud of PyVista or Open3D."""

    @property
    def points(self) -> object: ...


@runtime_checkable
class TensorGeometry(Protocol):
    """A mesh, a set of lines or a point cloud of Open3D, as tensors: with the table `vertex` or `point`."""

    def to_legacy(self) -> object: ...


@runtime_checkable
class SciPySpline(Protocol):
    """A BSpline or NdBSpline of SciPy: knots, coefficients and degrees."""

    @property
    def t(self) -> object: ...

    @property
    def c(self) -> object: ...

    @property
    def k(self) -> object: ...


@runtime_checkable
class GeomdlSpline(Protocol):
    """A curve or surface of geomdl."""

    @property
    def ctrlpts(self) -> object: ...


@runtime_checkable
class SplinepySpline(Protocol):
    """A curve or surface of splinepy."""

    @property
    def control_mesh_resolutions(self) -> object: ...


@runtime_checkable
class ShapelyGeometry(Protocol):
    """A geometry of shapely."""

    @property
    def geom_type(self) -> str: ...


@runtime_checkable
class SymPyPolynomial(Protocol):
    """A Poly of SymPy."""

    @property
    def gens(self) -> object: ...

    def terms(self) -> object: ...


ForeignSpline = SciPySpline | GeomdlSpline | SplinepySpline
ForeignShape = HasVertices | HasPoints | TensorGeometry | ShapelyGeometry | ForeignSpline
