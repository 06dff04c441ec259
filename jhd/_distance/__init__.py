"""Distances of shapes, in the order of the argument that certifies them.

1. Two shapes are brought into common coordinates (`normalization`).
2. The distance from a point of a to b is the distance to its nearest point, bounded from both sides (`nearest`).
3. Over a cell of a, any map into b bounds the distance from above (`cells`).
4. A maximum satisfies a few equations. They are solved to the last digits, and give the derivative of the value
   (`witness`).
5. The search keeps cells that cover a, and cuts the cell with the largest bound. It measures points of a to raise the
   lower bound, until both bounds meet. For the minimum distance it keeps pairs of cells (`search`).
6. Published methods omit one proof or another (`published`).
7. A result can be checked in integer arithmetic (`certificate`).

The entry points are `hausdorff`, `critical_pairs`, `minimum`, `project`, `signed_distance` and `deviation`.
`statistics` integrate the distances found by `project`, and `collections` compare many shapes at once.
"""

from jhd._distance.certificate.certificate import Certificate, certify, verify
from jhd._distance.certificate.verification import CertificateError
from jhd._distance.collections.entries import (
    PairsWithin,
    Pairwise,
    nearest_shapes,
    pairs_within,
    pairwise,
    pivot_distances,
)
from jhd._distance.collections.neighbors import Neighbors
from jhd._distance.collections.pivots import PivotDistances
from jhd._distance.critical_pairs import critical_pairs
from jhd._distance.deviation import deviation
from jhd._distance.deviation_solution import Deviation, DistanceSamples
from jhd._distance.hausdorff import directed_hausdorff, hausdorff, hausdorff_at_most
from jhd._distance.minimum import minimum_at_most, minimum_distance
from jhd._distance.normalization.stacked import stack_curves
from jhd._distance.profiles import DistanceProfile, distance_profile
from jhd._distance.project import project, stationary_points
from jhd._distance.project_methods import (
    BestFirstProjection,
    HybridProjection,
    IntervalHalvingProjection,
    NewtonProjection,
    ProjectedPolyhedronProjection,
)
from jhd._distance.search.branch_and_bound import BranchAndBound
from jhd._distance.signed_distance import signed_distance
from jhd._distance.sizes import arc_length, surface_area
from jhd._distance.statistics.statistics import (
    MaxDistance,
    MeanDistance,
    QuantileDistance,
    RMSDistance,
    StatisticSolution,
)
