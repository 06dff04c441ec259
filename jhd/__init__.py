"""jhd: Hausdorff distances with a proof and with a gradient."""

import os as _os

import jax as _jax

# Bounds to 1e-10 of the size need float64, and jax has it only as a global switch; JAX_ENABLE_X64=0 keeps float32.
if _os.environ.get("JAX_ENABLE_X64", "").lower() not in ("0", "false", "no", "off"):
    _jax.config.update("jax_enable_x64", True)

from jhd import plot  # noqa: E402
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
    TriangleMesh,
    as_shape,
    biarcs,
    circle,
    points,
    polyline,
)
from jhd.solution import (  # noqa: E402
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
from jhd.triangles import PreparedMesh, prepared  # noqa: E402

__version__ = "0.1.0"
