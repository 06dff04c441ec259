"""jhd: certified, differentiable Hausdorff distances of curves, surfaces and meshes."""

import os as _os
from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

__version__ = "0.1.0"

# First, because all that follows takes time, in which interrupts come and for which help does not wait.
from jhd._runtime import starting as _starting  # noqa: F401

# isort: split
from jhd._cli import helping as _helping  # noqa: F401

# isort: split
import jax as _jax

# Bounds to 1e-10 of the size need float64, and jax has it only as a global switch; JAX_ENABLE_X64=0 keeps float32.
if _os.environ.get("JAX_ENABLE_X64", "").lower() not in ("0", "false", "no", "off"):
    _jax.config.update("jax_enable_x64", True)

from jhd import plot  # noqa: E402
from jhd._results import solution  # noqa: E402, F401
from jhd._results.solution import (  # noqa: E402
    ANSWERS,
    DIRECTIONS,
    EVENTS,
    RESULTS,
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
from jhd.distance import (  # noqa: E402
    AlgebraicEvents,
    BiarcTrimming,
    Bounds,
    BranchAndBound,
    Certificate,
    CertificateError,
    CollectionProgress,
    CubeIntervals,
    Deviation,
    DistanceSamples,
    Hausdorff,
    HybridProjection,
    IntervalHalving,
    Mean,
    MeasureSolution,
    MinimumProgress,
    NearestSearch,
    Neighbours,
    NewtonProjection,
    PairsWithin,
    Pairwise,
    Profile,
    Progress,
    ProjectedPolyhedron,
    Quantile,
    RootMeanSquare,
    Signatures,
    TiedPairs,
    TwoStep,
    VertexVoxels,
    VoxelPairs,
    certify,
    critical_pairs,
    deviation,
    directed_hausdorff,
    hausdorff,
    hausdorff_at_most,
    minimum_at_most,
    minimum_distance,
    nearest_shapes,
    pairs_within,
    pairwise,
    profile,
    project,
    signatures,
    signed_distance,
    stack_curves,
    stationary_points,
    verify,
)
from jhd.fields import (  # noqa: E402
    AdaptiveDistanceField,
    DistanceMap,
    DistanceTransform,
    FieldProgress,
    VoxelProgress,
    Voxels,
    distance_map,
    distance_transform,
    signed_distance_transform,
    voxelise,
)
from jhd.fit import fit_curve, fit_outline, minimise_hausdorff  # noqa: E402
from jhd.fitting.soft import soft_hausdorff  # noqa: E402
from jhd.shapes import (  # noqa: E402
    BezierCurve,
    BezierPatch,
    BezierPatches,
    BezierSegments,
    BiarcCurve,
    BSplineCurve,
    BSplineSurface,
    CurveApproximation,
    ImplicitMesh,
    ImplicitSurface,
    NotRegularError,
    Partials,
    PatchMesh,
    Prepared,
    TriangleMesh,
    as_shape,
    biarcs,
    circle,
    points,
    polyline,
    prepare,
)

if _TYPE_CHECKING:
    from jhd import io as io

__all__ = [
    "ANSWERS",
    "AdaptiveDistanceField",
    "AlgebraicEvents",
    "BSplineCurve",
    "BSplineSurface",
    "BezierCurve",
    "BezierPatch",
    "BezierPatches",
    "BezierSegments",
    "BiarcCurve",
    "BiarcTrimming",
    "Bounds",
    "BranchAndBound",
    "Certificate",
    "CertificateError",
    "CollectionProgress",
    "CriticalPairs",
    "CubeIntervals",
    "CurveApproximation",
    "DIRECTIONS",
    "Decision",
    "Deviation",
    "DistanceMap",
    "DistanceSamples",
    "DistanceTransform",
    "EVENTS",
    "FieldProgress",
    "FitSolution",
    "Hausdorff",
    "HausdorffSolution",
    "HybridProjection",
    "ImplicitMesh",
    "ImplicitSurface",
    "IntervalHalving",
    "Mean",
    "MeasureSolution",
    "MinimumProgress",
    "MinimumSolution",
    "NearestSearch",
    "Neighbours",
    "NewtonProjection",
    "NotProvenError",
    "NotRegularError",
    "PairsWithin",
    "Pairwise",
    "Partials",
    "PatchMesh",
    "Prepared",
    "Profile",
    "Progress",
    "ProjectedPolyhedron",
    "Projection",
    "Quantile",
    "RESULTS",
    "RootMeanSquare",
    "Signatures",
    "StationaryPoints",
    "TiedPairs",
    "TriangleMesh",
    "TwoStep",
    "VertexVoxels",
    "VoxelPairs",
    "VoxelProgress",
    "Voxels",
    "Witness",
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
    "minimise_hausdorff",
    "minimum_at_most",
    "minimum_distance",
    "nearest_shapes",
    "pairs_within",
    "pairwise",
    "plot",
    "points",
    "polyline",
    "prepare",
    "profile",
    "project",
    "signatures",
    "signed_distance",
    "signed_distance_transform",
    "soft_hausdorff",
    "stack_curves",
    "stationary_points",
    "verify",
    "voxelise",
]


def __getattr__(name: str) -> _Any:
    """jhd.io, imported when it is first asked for: its readers of files and fonts would double the time of all."""
    if name == "io":
        return _import_module("jhd.io")
    raise AttributeError(f"module 'jhd' has no attribute {name!r}")
