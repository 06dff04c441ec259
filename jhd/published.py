"""Published methods for comparison with the searches of this package; pass an instance as `method`.

`TwoStep`, `BiarcTrimming`, `AlgebraicEvents` and `CubeIntervals` serve `jhd.hausdorff` and `jhd.directed_hausdorff`,
`VoxelPairs` serves `jhd.minimum_distance`, and `VertexVoxels` serves `jhd.project` and `jhd.signed_distance`. The class
docstrings name the sources, the changes to them, and the guarantees of each result.

>>> import jhd
>>> line, hill = jhd.polyline([(0, 0), (2, 0)]), jhd.BezierCurve([(0, 1), (1, 3), (2, 1)])
>>> round(float(jhd.hausdorff(line, hill, jhd.published.TwoStep())), 9)
2.0
"""

from jhd._distance.published.algebraic import AlgebraicEvents
from jhd._distance.published.cube_intervals import CubeIntervals
from jhd._distance.published.trimming import BiarcTrimming
from jhd._distance.published.two_step import TwoStep
from jhd._distance.published.vertex_voxels import VertexVoxels
from jhd._distance.published.voxel_pairs import TiedPairs, VoxelPairs

__all__ = [
    "AlgebraicEvents",
    "BiarcTrimming",
    "CubeIntervals",
    "TiedPairs",
    "TwoStep",
    "VertexVoxels",
    "VoxelPairs",
]
