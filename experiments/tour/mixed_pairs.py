"""Mixed pairs: a scan (a point set) compared with a sphere and a mesh, and the derivative in the points."""

import jax
import jax.numpy as jnp
import numpy as np

import jhd

rows = np.random.default_rng(1).normal(size=(2_000, 3))
rows *= (1 + 0.05 * np.sin(rows[:, :1])) / np.linalg.norm(rows, axis=1, keepdims=True)
scan = jhd.point_set(rows)
sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2, -2, -2], [2, 2, 2])

solution = jhd.directed_hausdorff(scan, sphere)
off = np.abs(np.linalg.norm(rows, axis=1) - 1)
assert solution.lower <= off.max() * (1 + 1e-15) and off.max() * (1 - 1e-15) <= solution.upper
print(solution)

# The nearest points of the sphere, each with bounds.
nearest = jhd.project(rows[:5], sphere)
assert np.all(nearest.lower <= off[:5] + 1e-15) and np.all(off[:5] - 1e-15 <= nearest.upper)
print(nearest)

# Only the witness has a nonzero derivative.
pull = jax.grad(lambda x: jhd.directed_hausdorff(jhd.point_set(x), sphere).value)(jnp.asarray(rows))
assert np.count_nonzero(np.any(pull != 0, axis=1)) == 1

faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
mesh = jhd.TriangleMesh([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], faces)
smallest = jhd.minimum_distance(scan, mesh)
print(smallest)
assert smallest.upper < 1
