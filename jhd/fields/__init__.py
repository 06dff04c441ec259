"""Distance fields and distance grids of surfaces, meshes and plane curves."""

from jhd.fields.adaptive import AdaptiveDistanceField
from jhd.fields.distance_map import DistanceMap, distance_map
from jhd.fields.distance_transform import DistanceTransform, distance_transform, signed_distance_transform
from jhd.fields.octree import Voxels, voxelize
from jhd.triangles.closest_point import ClosestPoints, closest_points
from jhd.triangles.winding import is_inside, winding_numbers
