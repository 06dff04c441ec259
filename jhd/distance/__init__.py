"""Distances of shapes, in the order of the argument that proves them.

Two shapes are brought into common coordinates (`frame`). The distance of a place of a from b is that of the nearest
point, proven from both sides (`nearest`). Over a cell of a, any map into b bounds the distance from above (`cells`).
What is attained satisfies a few equations, solved to the last digits, and the value has the derivative of these
(`witness`). The search keeps cells that cover a, cuts the one with the largest bound, and proves places where that
raises the lower one, until both bounds meet; or keeps pairs of cells, for the smallest distance (`search`). The methods
of the sources do without one or the other proof (`published`). Integers can check what was found (`certificate`). Above
stand the entries: `hausdorff`, `critical_pairs`, `minimum`, `project`, `signed_distance`, `deviation`, the `measures`,
which integrate what `project` finds, and for many shapes at once (`many`) `collections`.
"""

from jhd.distance.certificate.certificate import Certificate, certify
from jhd.distance.certificate.verification import CertificateError, verify
from jhd.distance.collections import (
    Neighbours,
    PairsWithin,
    Pairwise,
    nearest_shapes,
    pairs_within,
    pairwise,
    signatures,
)
from jhd.distance.critical_pairs import critical_pairs
from jhd.distance.deviation import deviation
from jhd.distance.deviation_solution import Bounds, Deviation, DistanceSamples
from jhd.distance.frame.stacked import stack_curves
from jhd.distance.hausdorff import directed_hausdorff, hausdorff, hausdorff_at_most
from jhd.distance.many.signatures import Signatures
from jhd.distance.many.tasks import CollectionProgress
from jhd.distance.measures.measures import Hausdorff, Mean, MeasureSolution, Quantile, RootMeanSquare
from jhd.distance.minimum import minimum_at_most, minimum_distance
from jhd.distance.profile import Profile, profile
from jhd.distance.project import project, stationary_points
from jhd.distance.project_methods import (
    HybridProjection,
    IntervalHalving,
    NearestSearch,
    NewtonProjection,
    ProjectedPolyhedron,
)
from jhd.distance.published.algebraic import AlgebraicEvents
from jhd.distance.published.cube_intervals import CubeIntervals
from jhd.distance.published.trimming import BiarcTrimming
from jhd.distance.published.two_step import TwoStep
from jhd.distance.published.vertex_voxels import VertexVoxels
from jhd.distance.published.voxel_pairs import TiedPairs, VoxelPairs
from jhd.distance.search.branch_and_bound import BranchAndBound
from jhd.distance.search.search import Progress
from jhd.distance.search.search import Progress as MinimumProgress
from jhd.distance.signed_distance import signed_distance
