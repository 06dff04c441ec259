"""What is known of the distance to one shape along another one, with its bounds."""

import json
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jhd._results.solution import HausdorffSolution, Projection, name_of, to_plain
from jhd._runtime.arrays import real_array
from jhd.decimals import interval_text
from jhd.distance.cells.weighted import Values, Weights, quantile_bounds, share_bounds
from jhd.distance.project import project
from jhd.distance.search.points import is_points
from jhd.shapes.checks import Numbers
from jhd.shapes.curve import AbstractCurve
from jhd.shapes.mesh import TriangleMesh


class Bounds(NamedTuple):
    """A number that is proven to lie between two others.

    Args:
        lower: the lower one.
        upper: the upper one; inf where nothing is proven.
    """

    lower: float
    upper: float

    @property
    def value(self) -> float:
        """The middle, which is off by at most half of what they are apart."""
        return 0.5 * self.lower + 0.5 * self.upper


class DistanceSamples(NamedTuple):
    """Parts of a that are all of it, for pictures and statistics.

    Args:
        place: the middle of each, about.
        lower: proven lower bounds of the distance everywhere in the part.
        upper: proven upper bounds.
        share: bounds of the share of a that it is, as length, area or number, (parts, 2), up to one common factor.
        ends: bounds by two affine functions of the place, by their values at the corners of a part; both are constant
            where none are known that say more.
    """

    place: Float[np.ndarray, "parts dim"]
    lower: Float[np.ndarray, " parts"]
    upper: Float[np.ndarray, " parts"]
    share: Float[np.ndarray, "parts 2"]
    ends: Float[np.ndarray, "parts corners 2"]


class Deviation(eqx.Module):
    """The distance d(x, b) for x along a, as a distribution over the length or area of a, or the number of its points.

    All bounds are proven: lower <= exact <= upper.

    Args:
        a: the shape along which the distance is looked at.
        b: the shape that distances are taken to.
        maximum: the largest distance, the directed Hausdorff distance; its value is differentiable as that is.
        mean: the mean distance.
        rms: the root of the mean of the squared distance.
        measure: the length or area of a, or the number of its points, in the unit of the coordinates.
        samples: parts of a with bounds, from which quantiles and shares are taken.
        result: successful where maximum, mean and rms are known to the tolerance, else why they are not.
        stats: counts.
    """

    a: Any = eqx.field(metadata={"stored": False})
    b: Any = eqx.field(metadata={"stored": False})
    maximum: HausdorffSolution
    mean: Bounds
    rms: Bounds
    measure: Bounds
    samples: DistanceSamples = eqx.field(metadata={"stored": False})
    result: Any
    stats: dict[str, int]

    def quantile(self, q: float) -> Bounds:
        """The least distance that a share q of a does not exceed; q = 0.5 is the median.

        Args:
            q: above 0 and at most 1; it counts as reached within its rounding, 2^-50 of it.

        Raises:
            ValueError: another q.
        """
        check_share("q", q)
        lower, upper = quantile_bounds(self._weights(), self._values(), float(q))
        return Bounds(lower, min(upper, float(self.maximum.upper)))

    def share_within(self, threshold: float) -> Bounds:
        """The share of a whose distance to b is at most the threshold, between 0 and 1.

        Args:
            threshold: a length of at least 0, in the unit of the coordinates.

        Raises:
            ValueError: a threshold that is no length.
        """
        if not threshold >= 0:
            raise ValueError(f"threshold is {threshold}; needs a length of at least 0.")
        return Bounds(*share_bounds(self._weights(), *self._values().within(threshold)))

    def at(self, places: Numbers | None = None) -> Projection:
        """Distances to b, with bounds and feet, at places of a; differentiable as `project` is.

        Args:
            places: None for the points of a set or the vertices of a mesh; of a curve parameters (...,) as in a call of
                it, of a parametric surface rows (..., 2) of its parameters.

        Raises:
            ValueError: no places on a curve or surface, places on points or a mesh, or rows of another length.
        """
        return project(_places(self.a, places), self.b, throw=False)

    def reached(self, quantile: float | None = None) -> dict[str, Bounds]:
        """The bounds by what they are of: the mean, the root mean square, the maximum, and a quantile if it is named.

        Args:
            quantile: a share, as of `quantile`.
        """
        largest = Bounds(float(self.maximum.lower), float(self.maximum.upper))
        ends = {"the mean": self.mean, "the root mean square": self.rms, "the maximum": largest}
        return ends if quantile is None else ends | {f"the quantile {quantile:g}": self.quantile(quantile)}

    def to_json(self, **options: Any) -> str:
        """The bounds as JSON text, and some quantiles; what is not proven is null.

        Args:
            options: handed to json.dumps, for example indent=2.
        """
        return json.dumps(self.to_plain(), **options)

    def to_plain(self) -> dict[str, Any]:
        """The bounds as JSON holds them."""
        quantiles = {str(q): to_plain(list(self.quantile(q))) for q in (0.5, 0.9, 0.99)}
        ends = {name: to_plain(list(getattr(self, name))) for name in ("mean", "rms", "measure")}
        return {"maximum": to_plain(self.maximum), **ends, "quantiles": quantiles, "result": name_of(self.result)} | {
            "stats": dict(self.stats)
        }

    def to_trimesh(self) -> Any:
        """A trimesh.Trimesh of a mesh a, with the distances at its vertices as the attribute `distance`.

        Raises:
            TypeError: a is no mesh.
            ImportError: trimesh is not installed.
        """
        made = self._mesh().to_trimesh()
        made.vertex_attributes["distance"] = np.asarray(self.at().distance)
        return made

    def to_pyvista(self) -> Any:
        """A pyvista.PolyData of a mesh a, with the distances at its points as the array `distance`.

        Raises:
            TypeError: a is no mesh.
            ImportError: PyVista is not installed.
        """
        data = self._mesh().to_pyvista()
        data.point_data["distance"] = np.asarray(self.at().distance)
        return data

    def _mesh(self) -> TriangleMesh:
        if not isinstance(self.a, TriangleMesh):
            raise TypeError(f"a is {type(self.a).__name__}; needs a TriangleMesh: take a.to_mesh(atol).mesh for it.")
        return self.a

    def _weights(self) -> Weights:
        return Weights(self.samples.share[:, 0], self.samples.share[:, 1])

    def _values(self) -> Values:
        return Values(self.samples.lower, self.samples.upper, self.samples.ends)

    def __float__(self) -> float:
        return self.mean.value

    def __repr__(self) -> str:
        largest = Bounds(float(self.maximum.lower), float(self.maximum.upper))
        rows = {"maximum": largest, "rms": self.rms, "mean": self.mean, "median": self.quantile(0.5)}
        text = ", ".join(f"{name} in {interval_text(*x, '.6g')}" for name, x in rows.items())
        return f"Deviation({text},\n  {len(self.samples.lower)} parts, {name_of(self.result)})"


def check_share(name: str, q: float) -> None:
    """Raises ValueError unless it is the share of a quantile."""
    if not 0 < q <= 1:
        raise ValueError(f"{name} is {q}; needs a number above 0 and at most 1.")


def _places(shape: Any, places: Any) -> Array:
    if isinstance(shape, TriangleMesh) or is_points(shape):
        if places is not None:
            raise ValueError("places is for curves and surfaces; those of a mesh are its vertices, of points all.")
        return shape.vertices if isinstance(shape, TriangleMesh) else shape.segments().control_points[:, 0]
    if places is None:
        raise ValueError("places is missing: the parameters on the curve or surface at which distances are wanted.")
    rows = real_array("places", places)
    if isinstance(shape, AbstractCurve):
        return shape(rows)
    if rows.ndim == 0 or rows.shape[-1] != 2:
        raise ValueError(f"places has shape {rows.shape}; needs (..., 2), the two parameters of a surface.")
    return shape(rows[..., 0], rows[..., 1])
