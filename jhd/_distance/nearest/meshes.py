"""Nearest points of a triangle mesh, with proven bounds.

If all numbers are known, the tree of jhd._triangles.closest_point is searched from the host. Under tracing every query
is compared with every triangle, in blocks that bound the memory; the proof is the same. The published local search,
VertexVoxels, is for comparison.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from jhd._arithmetic.rounding import largest, round_down, round_up, smallest_normal
from jhd._arithmetic.scaling import common_exponent, ldexp, times_two_to
from jhd._results.solution import RESULTS, Projection, result_where
from jhd._runtime.arrays import in_chunks, is_traced, undifferentiated, varying
from jhd._shapes.mesh import TriangleMesh
from jhd._triangles.closest_point import AbstractMeshSearch, ClosestPoints, closest_points
from jhd._triangles.point_triangle import absolute_floor, barycentric, error_factor, frames, squared_distances

# Points and triangles whose pairs are formed at once under tracing.
_POINTS, _TRIANGLES = 128, 512


def nearest_on_mesh(queries: Array, mesh: TriangleMesh, method: object = None) -> Projection:
    """Return the nearest points of a mesh, as constants; see jhd.project.

    Args:
        queries: (..., 3), as `checked_points` gives them.
        mesh: the mesh.
        method: None for the exact search, or the published one.

    Raises:
        TypeError: another method, or VertexVoxels under tracing.
        ValueError: a grid of more voxels than the capacity.
    """
    if method is not None and not isinstance(method, AbstractMeshSearch):
        accepted = "None for meshes, which is the exact search, or VertexVoxels"
        raise TypeError(f"method must be {accepted}; got {type(method).__name__}.")
    batch = queries.shape[:-1]
    fixed, still = undifferentiated((queries.reshape(-1, 3), mesh))
    if not is_traced(fixed, still):
        known = np.asarray(fixed)
        found = _known(closest_points(still, known) if method is None else method._search(known, still), still)
    elif method is None:
        found = _traced(fixed, still)
    else:
        raise TypeError("VertexVoxels runs on the host, not under jit or vmap; method=None is traced.")
    return jax.tree_util.tree_map(lambda x: jnp.asarray(x).reshape((*batch, *x.shape[1:])), found)


def _known(found: ClosestPoints, mesh: TriangleMesh) -> Projection:
    count = len(found.distance)
    result = jax.tree_util.tree_map(lambda x: np.broadcast_to(np.asarray(x), count), RESULTS.successful)
    element = jnp.asarray(found.triangle.astype(np.asarray(mesh.triangles).dtype))
    lengths = (jnp.asarray(x) for x in (found.distance, found.lower, found.upper, found.foot))
    return Projection(*lengths, element=element, t=jnp.asarray(found.t), result=result)


def _traced(points: Array, mesh: TriangleMesh) -> Projection:
    """Return the nearest points under tracing: every point is compared with every triangle."""
    good, corners = jnp.all(jnp.isfinite(points), axis=-1), mesh.corners
    if is_traced(mesh):
        good = good & jnp.all(jnp.isfinite(corners))
        corners = jnp.where(jnp.isfinite(corners), corners, 0.0)
    else:
        corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
    points = jnp.where(good[:, None], points, 0.0)
    exponent = common_exponent(corners, points)
    points, corners = ldexp(points, -exponent), ldexp(corners, -exponent)
    found = frames(corners, corners.dtype)
    factor = error_factor(found.defect, corners.dtype)
    square, triangle = _all_pairs(points, found.table)
    t = barycentric(points, found.table[triangle], found.turn[triangle])
    foot = jnp.sum(t[:, :, None] * corners[triangle], axis=1)
    distance = jnp.sqrt(square)
    error = round_up(round_up(factor * (distance + 2 * found.longest)) + absolute_floor(corners.dtype))
    nu, most = smallest_normal(corners.dtype), largest(corners.dtype)
    lower = times_two_to(jnp.maximum(round_down(distance - error), 0.0), exponent)
    lower = jnp.where(lower < 2 * nu, 0.0, jnp.minimum(lower, most))
    upper = jnp.maximum(times_two_to(round_up(distance + error), exponent), 2 * nu)
    result = jax.vmap(lambda g: result_where(g, RESULTS.successful, RESULTS.nonfinite_value))(good)
    return Projection(
        distance=jnp.where(good, times_two_to(distance, exponent), jnp.inf),
        lower=jnp.where(good, lower, 0.0),
        upper=jnp.where(good, upper, jnp.inf),
        foot=times_two_to(foot, exponent),
        element=triangle.astype(mesh.triangles.dtype),
        t=t,
        result=result,
    )


def _all_pairs(points: Array, table: Array) -> tuple[Array, Array]:
    """Return the least squared distances over all rows of the table, and the first row that attains each."""
    # The last row is repeated to fill the last block.
    count, size = table.shape[0], min(_TRIANGLES, table.shape[0])
    index = np.minimum(np.arange(-(-count // size) * size), count - 1).reshape(-1, size)

    def of_point(point: Array) -> tuple[Array, Array]:
        def step(best: tuple[Array, Array], block: tuple[Array, Array]) -> tuple[tuple[Array, Array], None]:
            squares = squared_distances(point, block[0])
            found = jnp.min(squares), block[1] + jnp.argmin(squares)
            better = found[0] < best[0]
            return (jnp.where(better, found[0], best[0]), jnp.where(better, found[1], best[1])), None

        start = jnp.array(jnp.inf, point.dtype), jnp.array(0)
        return lax.scan(step, varying(start, point, table), (table[index], jnp.asarray(index[:, 0])))[0]

    return in_chunks(of_point, points, _POINTS)
