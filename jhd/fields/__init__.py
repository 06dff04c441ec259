"""Fields: distance stored on cells."""

from jhd.fields.distance_map import DistanceMap, distance_map
from jhd.fields.octree import VoxelProgress, Voxels, voxelise
