"""Distances: projection, the Hausdorff methods and the entries."""

from jhd.distance.algebraic import AlgebraicEvents
from jhd.distance.branch_and_bound import BranchAndBound
from jhd.distance.certificate import Certificate, certify
from jhd.distance.critical import critical_pairs
from jhd.distance.cube_intervals import CubeIntervals
from jhd.distance.driver import Progress
from jhd.distance.hausdorff import directed_hausdorff, hausdorff, hausdorff_at_most
from jhd.distance.mesh_projection import VertexVoxels
from jhd.distance.minimum import MinimumProgress, minimum_distance
from jhd.distance.projection import (
    HybridProjection,
    IntervalHalving,
    NearestSearch,
    NewtonProjection,
    ProjectedPolyhedron,
    project,
    stationary_points,
)
from jhd.distance.signed_distance import signed_distance
from jhd.distance.trimming import BiarcTrimming
from jhd.distance.two_step import TwoStep
from jhd.distance.verification import CertificateError, verify
from jhd.distance.voxel_pairs import TiedPairs, VoxelPairs
