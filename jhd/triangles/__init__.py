"""Queries of triangles: boxes in a tree, the nearest triangle, exact pairs, winding numbers, pseudonormals."""

from jhd.triangles.prepared import PreparedMesh, prepared
