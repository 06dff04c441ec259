"""Queries of triangles: boxes in a tree, the nearest triangle, exact pairs, winding numbers, pseudonormals."""
