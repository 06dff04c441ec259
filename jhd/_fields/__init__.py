"""Distance fields and distance grids of surfaces, meshes and plane curves."""

from jhd._fields.adaptive import AdaptiveDistanceField
from jhd._fields.distance_map import DistanceMap, distance_map
from jhd._fields.distance_transform import DistanceTransform, distance_transform, signed_distance_transform
from jhd._fields.octree import Voxels, voxelize
