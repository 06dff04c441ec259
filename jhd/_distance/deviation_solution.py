"""Results of `deviation`: statistics of the distance to one shape over another, with their bounds."""

import numbers
from typing import NamedTuple, SupportsFloat

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from jhd._distance.cells.weighted import Values, Weights, quantile_bounds, share_bounds
from jhd._distance.project import project
from jhd._distance.search.bodies import body_of
from jhd._results.batches import AbstractSolution
from jhd._results.solution import RESULTS, Bounds, HausdorffSolution, Projection, name_of, to_plain
from jhd._runtime.arrays import number_instead
from jhd._shapes.as_shape import Shape
from jhd._shapes.checks import Numbers
from jhd._shapes.foreign import PolyData, Trimesh
from jhd._shapes.mesh import TriangleMesh


class DistanceSamples(NamedTuple):
    """Parts that make up `a`, with bounds of the distance to `b`, for pictures and statistics.

    Args:
        point: approximate midpoints of the parts, (parts, dim).
        lower: certified lower bounds of the distance on each part, (parts,).
        upper: certified upper bounds of the distance on each part, (parts,).
        fraction: lower and upper bounds of the fraction of `a` in each part, (parts, 2), up to a common factor.
        ends: bounds by two affine functions on each part, given by their values at its corners, (parts, corners, 2).
            Both functions are constant if no better ones are known.
    """

    point: Float[np.ndarray, "parts dim"]
    lower: Float[np.ndarray, " parts"]
    upper: Float[np.ndarray, " parts"]
    fraction: Float[np.ndarray, "parts 2"]
    ends: Float[np.ndarray, "parts corners 2"]


class UndifferentiatedBounds(Bounds):
    """Bounds of the mean or RMS under `jax.grad`, where a constant value would have derivative zero."""

    def __init__(self, lower: SupportsFloat, upper: SupportsFloat):
        super().__init__(lower, upper)

    def __float__(self) -> float:
        return float(Bounds(self.lower, self.upper))

    def __repr__(self) -> str:
        return repr(Bounds(self.lower, self.upper))

    @property
    @override
    def value(self) -> float:
        raise TypeError(
            "mean and rms of deviation have no derivative: use jhd.MeanDistance().estimate(a, b) or RMSDistance. "
            "float(...) returns the number."
        )


class Deviation(AbstractSolution):
    """Distribution of the distance d(x, b) over x in `a`, by length, area or number of points.

    All bounds are certified: lower <= exact <= upper. `float(deviation)` is the mean.

    Args:
        a: the shape over which the distance is taken.
        b: the shape to which distances are measured.
        maximum: the largest distance: the directed Hausdorff distance, with its differentiable value.
        mean: the mean distance.
        rms: the root of the mean squared distance.
        size: the length or area of `a`, in the unit of the coordinates, or the number of its points.
        samples: the parts of `a` with their bounds, from which quantiles and fractions are computed.
        result: the member successful of RESULTS if maximum, mean and rms reach the tolerance; otherwise the reason.
        stats: counts of the work.
    """

    a: Shape = eqx.field(metadata={"stored": False})
    b: Shape = eqx.field(metadata={"stored": False})
    maximum: HausdorffSolution
    mean: Bounds
    rms: Bounds
    size: Bounds
    samples: DistanceSamples = eqx.field(metadata={"stored": False})
    result: RESULTS
    stats: dict[str, int]

    def quantile(self, q: float) -> Bounds:
        """Bounds of the q-quantile of the distance: the least distance that a fraction q of `a` does not exceed.

        The 0.5 quantile is the median. The 0.9 quantile ignores up to 10 % of outliers. Only the quantile that was
        passed to `deviation` is within its tolerance; others may be wider.

        >>> import jhd
        >>> line, origin = jhd.polyline([(0, 0), (1, 0)]), jhd.point_set([(0, 0)])
        >>> median = jhd.deviation(line, origin, quantile=0.5).quantile(0.5)
        >>> median.lower <= 0.5 <= median.upper, median.upper - median.lower < 1e-3
        (True, True)

        Args:
            q: a fraction, above 0 and at most 1. Rounding of q is tolerated, up to 2^-50 q.

        Returns:
            Bounds of the quantile, in the unit of the coordinates.

        Raises:
            ValueError: q is out of range.
        """
        check_share("q", q)
        lower, upper = quantile_bounds(self._weights(), self._values(), float(q))
        return Bounds(lower, min(upper, float(self.maximum.upper)))

    def fraction_within(self, threshold: float) -> Bounds:
        """Bounds of the fraction of `a` whose distance to `b` is at most a threshold.

        No tolerance applies to them; a smaller tolerance of the deviation narrows them.

        >>> import jhd
        >>> scan, model = jhd.point_set([(0, 0), (1, 0), (2, 0), (3, 8)]), jhd.polyline([(0, 0), (3, 0)])
        >>> round(jhd.deviation(scan, model).fraction_within(1.0).value, 6)
        0.75

        Args:
            threshold: a length of at least 0, in the unit of the coordinates.

        Returns:
            Bounds of the fraction, between 0 and 1.

        Raises:
            TypeError: the threshold is a text.
            ValueError: the threshold is not one number of at least 0.
        """
        if isinstance(threshold, str):
            raise TypeError(f"threshold is {threshold!r}; needs {number_instead('threshold', threshold)}.")
        if not _is_number(threshold) or not float(threshold) >= 0:
            raise ValueError(f"threshold is {threshold!r}; needs a length of at least 0, as a number.")
        return Bounds(*share_bounds(self._weights(), *self._values().within(threshold)))

    def at(self, params: Numbers | None = None) -> Projection:
        """Distances from given points of `a` to `b`, with bounds and foot points; differentiable like `project`.

        >>> import jhd
        >>> line, origin = jhd.polyline([(0, 0), (1, 0)]), jhd.point_set([(0, 0)])
        >>> jhd.deviation(line, origin).at([0.5, 1.0]).distance.round(6).tolist()
        [0.5, 1.0]

        Args:
            params: for a curve its parameters (...,), as in a call of the curve; for a parametric surface rows (..., 2)
                of its parameters. Leave it out for point sets and meshes, whose points or vertices are used.

        Returns:
            A Projection: distances, bounds and foot points.

        Raises:
            ValueError: `params` is missing for a curve or surface, is given for points or a mesh, or has a wrong shape.
        """
        return project(body_of(self.a).at(params), self.b, throw=False)

    def _reached(self, quantile: float | None = None) -> dict[str, Bounds]:
        """The bounds of mean, root mean square and maximum, and of a quantile if one is given, by names in messages."""
        largest = Bounds(self.maximum.lower, self.maximum.upper)
        ends = {"the mean": self.mean, "the root mean square": self.rms, "the maximum": largest}
        return ends if quantile is None else ends | {f"the quantile {quantile:g}": self.quantile(quantile)}

    def to_dict(self) -> dict[str, object]:
        """The bounds and the quantiles 0.5, 0.9 and 0.99 as nested dictionaries, lists, numbers and names.

        Returns:
            The entries maximum, mean, rms, size, result, stats and quantiles. Bounds have the entries lower and upper,
            which are None if they are not certified.
        """
        return to_plain(self) | {"quantiles": {str(q): to_plain(self.quantile(q)) for q in (0.5, 0.9, 0.99)}}

    def to_trimesh(self) -> Trimesh:
        """The mesh `a` as a trimesh.Trimesh, with the distances at its vertices as the vertex attribute `distance`.

        Returns:
            A trimesh.Trimesh.

        Raises:
            TypeError: `a` is not a mesh.
            ImportError: trimesh is not installed.
        """
        made = self._mesh().to_trimesh()
        made.vertex_attributes["distance"] = np.asarray(self.at().distance)
        return made

    def to_pyvista(self) -> PolyData:
        """The mesh `a` as a pyvista.PolyData, with the distances at its vertices as the point array `distance`.

        Returns:
            A pyvista.PolyData.

        Raises:
            TypeError: `a` is not a mesh.
            ImportError: PyVista is not installed.
        """
        data = self._mesh().to_pyvista()
        data.point_data["distance"] = np.asarray(self.at().distance)
        return data

    def _mesh(self) -> TriangleMesh:
        if not isinstance(self.a, TriangleMesh):
            raise TypeError(
                f"a is {type(self.a).__name__}; needs a TriangleMesh: measure a.to_mesh(tolerance).shape instead."
            )
        return self.a

    def _weights(self) -> Weights:
        return Weights(self.samples.fraction[:, 0], self.samples.fraction[:, 1])

    def _values(self) -> Values:
        return Values(self.samples.lower, self.samples.upper, self.samples.ends)

    def __float__(self) -> float:
        return float(self.mean)

    def __repr__(self) -> str:
        rows = {"maximum": self.maximum, "rms": self.rms, "mean": self.mean}
        text = ", ".join(f"{name} in {x:.6g}" for name, x in rows.items())
        return f"Deviation({text},\n  {len(self.samples.lower)} parts, {name_of(self.result)})"


def check_share(name: str, q: float) -> None:
    """Raise ValueError unless q is a fraction above 0 and at most 1."""
    if not _is_number(q) or not 0 < float(q) <= 1:
        raise ValueError(f"{name} is {q!r}; needs a number above 0 and at most 1.")


def _is_number(x: object) -> bool:
    return isinstance(x, numbers.Real) or (isinstance(x, np.ndarray | jax.Array) and x.ndim == 0)
