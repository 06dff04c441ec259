"""jhd: certified, differentiable Hausdorff distances of curves, surfaces and meshes.

A *shape* is a curve, a parametric surface, an implicit surface, a triangle mesh or a point set. The directed Hausdorff
distance from `a` to `b` is the largest distance from a point of `a` to `b`. Results have a differentiable `value`, and
bounds with `lower <= exact <= upper`, rounding included. The *witness* is the point that attains the distance, with its
*foot points*, the nearest points on the other shape.

>>> import jhd
>>> found = jhd.hausdorff(jhd.point_set([(0, 3)]), jhd.point_set([(0, 0), (4, 0)]))
>>> float(found.value), bool(found.lower <= 5 <= found.upper)
(5.0, True)

# Which call do I need?

- How far apart are two shapes at most: `hausdorff`; from one shape only: `directed_hausdorff`.
- The minimum distance between them: `minimum_distance`.
- Is a distance below a limit: `hausdorff_at_most`, `minimum_at_most`.
- Mean, root mean square and quantiles of the distance: `deviation`; as a loss: `MeanDistance`, `RMSDistance`,
  `QuantileDistance`.
- The nearest point on a shape: `project`; all stationary points on a curve: `stationary_points`.
- Inside or outside of a mesh: `signed_distance`; millions of such queries: `AdaptiveDistanceField`.
- A shape that fits another one: `fit_curve`, `fit_outline`, `minimize_hausdorff`; a smooth loss: `soft_hausdorff`.
- Many shapes, by Hausdorff distance: `pairwise`, `nearest_shapes`, `pairs_within`.
- A proof for others to check: `certify`, `verify`.
- Files and glyphs: `jhd.io`. Pictures: `jhd.plot`. Objects of other packages: `as_shape`.

# Choose a method

The default, `BranchAndBound`, certifies both bounds and serves every pair of shapes. The bounds differ by at most 1e-10
of the diagonal of the joint bounding box; pass `atol=` (a length) or `rtol=` (relative to `upper`) for another
tolerance. The methods in `jhd.published` are for comparison. `TwoStep` refines samples of curves and certifies a lower
bound only. `AlgebraicEvents` and `BiarcTrimming` solve for all candidate events of plane curves. `CubeIntervals` and
`VoxelPairs` work on cells of surfaces.

# Questions and answers

**Why do my arrays have 64 bits?** Bounds of 1e-10 need float64, and JAX switches it on globally. With
`JAX_ENABLE_X64=0` in the environment, jhd computes in float32. The bounds stay true, and become wider.

**Why does the first call take seconds?** It compiles. On CPUs the compiled searches are kept on disk, and other
processes read them: see `jhd doctor`. `jhd precompile plane` compiles in advance.

**What does gap_not_closed mean?** The bounds are true, but the search ended before they met. Raise `max_steps`, or
pass a larger `atol`. If whole regions are equally far, for example on a shape and its offset, the work grows as the gap
shrinks.

**How do I get a result instead of an exception?** Pass `throw=False` and read `ok`, or `result`, a member of `RESULTS`.

**Can I use it inside `jit`, `vmap` and `grad`?** Yes. On CPUs the compiled function calls the search on the host, which
keeps its compiled searches on disk; a batch uses all cores. On GPUs searches for points and curves, and for two
implicit surfaces, become part of the compiled function; `inline_searches` has the same effect on CPUs, for example
for `jax.export`. Shapes may be arguments, closed over, or built inside.

**How do I fit in my own loop, for example with optax?** To noisy points, minimize the mean square of
`project(points, shape).distance`; see `experiments/tour/optax_loop.py`. To a shape, minimize `hausdorff(...).value`,
`soft_hausdorff` or a statistic such as `RMSDistance().estimate(a, b)`. All of them work under `jit`. For statistics of
sampled points use `directed=True`: the direction from the shape to the points includes the spacing of the points.

**How do I read the gradient of a curve?** `jax.grad` returns a curve whose `control_points` are derivatives. A joint of
`BezierSegments` is stored in both of its segments, and its derivative is the sum of both.

**Which derivative do I get?** The derivative of the distance at the witness. If the witness has several foot points,
each contributes with its multiplier. If several witnesses are equally far, it is the derivative at one of them. At
distance zero it is zero.
"""

import os as _os
from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

__version__ = "0.1.0"

# First: the imports below take a second. An interrupt can come during them, and help must not wait for them.
from jhd._runtime import starting as _starting  # noqa: F401

# isort: split
from jhd._cli import helping as _helping  # noqa: F401

# isort: split
import jax as _jax

# Bounds to 1e-10 of the size need float64, which is a global switch of JAX; JAX_ENABLE_X64=0 keeps float32.
if _os.environ.get("JAX_ENABLE_X64", "").lower() not in ("0", "false", "no", "off"):
    _jax.config.update("jax_enable_x64", True)

from jhd import arithmetic, plot, progress, published, typing  # noqa: E402
from jhd._distance import (  # noqa: E402
    BestFirstProjection,
    BranchAndBound,
    Certificate,
    CertificateError,
    Deviation,
    DistanceProfile,
    DistanceSamples,
    HybridProjection,
    IntervalHalvingProjection,
    MaxDistance,
    MeanDistance,
    Neighbors,
    NewtonProjection,
    PairsWithin,
    Pairwise,
    PivotDistances,
    ProjectedPolyhedronProjection,
    QuantileDistance,
    RMSDistance,
    StatisticSolution,
    arc_length,
    certify,
    critical_pairs,
    deviation,
    directed_hausdorff,
    distance_profile,
    hausdorff,
    hausdorff_at_most,
    minimum_at_most,
    minimum_distance,
    nearest_shapes,
    pairs_within,
    pairwise,
    pivot_distances,
    project,
    signed_distance,
    stack_curves,
    stationary_points,
    surface_area,
    verify,
)
from jhd._fields import (  # noqa: E402
    AdaptiveDistanceField,
    DistanceMap,
    DistanceTransform,
    Voxels,
    distance_map,
    distance_transform,
    signed_distance_transform,
    voxelize,
)
from jhd._fitting.fit import fit_curve, fit_outline, minimize_hausdorff  # noqa: E402
from jhd._fitting.soft import soft_hausdorff  # noqa: E402
from jhd._results import solution  # noqa: E402, F401
from jhd._results.solution import (  # noqa: E402
    ANSWERS,
    DIRECTIONS,
    EVENTS,
    RESULTS,
    Bounds,
    CriticalPairs,
    Decision,
    FitSolution,
    HausdorffSolution,
    MinimumSolution,
    NotProvenError,
    Projection,
    StationaryPoints,
    Witness,
)
from jhd._runtime.compiled import inline_searches  # noqa: E402
from jhd._shapes import (  # noqa: E402
    Approximation,
    BezierCurve,
    BezierPatch,
    BezierPatches,
    BezierSegments,
    BiarcCurve,
    BSplineCurve,
    BSplineSurface,
    ImplicitSurface,
    NotRegularError,
    Partials,
    PatchMesh,
    Prepared,
    TriangleMesh,
    as_shape,
    biarcs,
    circle,
    point_set,
    polyline,
    prepare,
)

if _TYPE_CHECKING:
    from jhd import io as io

__all__ = [
    "ANSWERS",
    "AdaptiveDistanceField",
    "Approximation",
    "BSplineCurve",
    "BSplineSurface",
    "BezierCurve",
    "BezierPatch",
    "BezierPatches",
    "BezierSegments",
    "BiarcCurve",
    "Bounds",
    "BranchAndBound",
    "Certificate",
    "CertificateError",
    "CriticalPairs",
    "DIRECTIONS",
    "Decision",
    "Deviation",
    "DistanceMap",
    "DistanceSamples",
    "DistanceTransform",
    "EVENTS",
    "FitSolution",
    "MaxDistance",
    "HausdorffSolution",
    "HybridProjection",
    "ImplicitSurface",
    "IntervalHalvingProjection",
    "MeanDistance",
    "StatisticSolution",
    "MinimumSolution",
    "BestFirstProjection",
    "Neighbors",
    "NewtonProjection",
    "NotProvenError",
    "NotRegularError",
    "PairsWithin",
    "Pairwise",
    "Partials",
    "PatchMesh",
    "Prepared",
    "DistanceProfile",
    "ProjectedPolyhedronProjection",
    "Projection",
    "QuantileDistance",
    "RESULTS",
    "RMSDistance",
    "PivotDistances",
    "StationaryPoints",
    "TriangleMesh",
    "Voxels",
    "Witness",
    "arc_length",
    "arithmetic",
    "as_shape",
    "biarcs",
    "certify",
    "circle",
    "critical_pairs",
    "deviation",
    "directed_hausdorff",
    "distance_map",
    "distance_transform",
    "fit_curve",
    "fit_outline",
    "hausdorff",
    "hausdorff_at_most",
    "io",
    "minimize_hausdorff",
    "minimum_at_most",
    "minimum_distance",
    "nearest_shapes",
    "pairs_within",
    "pairwise",
    "plot",
    "progress",
    "published",
    "point_set",
    "polyline",
    "prepare",
    "distance_profile",
    "project",
    "pivot_distances",
    "inline_searches",
    "signed_distance",
    "signed_distance_transform",
    "soft_hausdorff",
    "stack_curves",
    "stationary_points",
    "surface_area",
    "typing",
    "verify",
    "voxelize",
]


def __getattr__(name: str) -> _Any:
    """The module jhd.io, imported at its first use: its readers of files and fonts would double the import time."""
    if name == "io":
        return _import_module("jhd.io")
    raise AttributeError(f"module 'jhd' has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, `io` among them before its first use."""
    return [*__all__, "__version__"]
