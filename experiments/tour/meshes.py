"""Meshes: their Hausdorff distance and its derivative, the minimum distance, and a field of signed distances."""

import math

import jax
import jax.numpy as jnp

import jhd

corners = jnp.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
mesh = jhd.TriangleMesh(corners, faces)


def moved(x):
    """The tetrahedron, translated by x to the right."""
    return jhd.TriangleMesh(corners + jnp.array([x, 0, 0]), faces)


solution = jhd.hausdorff(mesh, moved(0.5))
print(solution)
assert solution.lower <= 0.5 <= solution.upper <= solution.lower + 1e-9

slope = jax.grad(lambda x: jhd.hausdorff(mesh, moved(x)).value)(0.5)
print(f"derivative in the translation: {slope:.6g}")
assert abs(slope - 1) < 1e-12

# The meshes intersect, so the minimum distance is zero.
assert jhd.minimum_distance(mesh, moved(0.5)).upper == 0

field = jhd.AdaptiveDistanceField.build(mesh, tolerance=0.01)
print(field, field([0.0, 0.0, 0.0]))
assert abs(field([0.0, 0.0, 0.0]) + 1 / math.sqrt(3)) < 0.01
