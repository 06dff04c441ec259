"""Second derivatives of distances between shapes of any size, and of different sizes, with the witness off the axes."""

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.witness.balance import from_pair, from_place
from jhd._distance.witness.nets import from_nets
from jhd._distance.witness.rows import CornerRows, NetRows, Polynomial
from jhd._results.solution import DIRECTIONS, EVENTS, RESULTS, MinimumSolution, Witness
from tests.distance.witness.test_balance import sphere

NORMAL = np.array([2.0, 3, 6]) / 7
# Radii of the sphere that moves and of the one at the origin, and the distance of their centers.
MOVING, FIXED, APART = 1.5, 1.0, 4.0
SIZES = {
    np.float64: 10.0 ** np.array([-100, -50, -12, -4, 0, 3, 4, 6, 9, 12, 50, 100]),
    np.float32: 10.0 ** np.array([-12, -9, -6, -3, 0, 1, 2, 3, 4, 6, 9, 12]),
}
# What rounding leaves of entries of about one, in units of roundoff.
ROUNDING = 64
SIDE = np.sqrt(0.5)
# An octant of the unit sphere as a rational patch.
OCTANT = np.array(
    [[[1.0, 0, 0], [1, 0, 1], [0, 0, 1]], [[1, 1, 0], [1, 1, 1], [0, 0, 1]], [[0, 1, 0], [0, 1, 1], [0, 0, 1]]]
)
WEIGHTS = np.outer([1, SIDE, 1], [1, SIDE, 1])


def parameter(tangent):
    """Where a quarter of a circle has this tangent of its angle."""
    r = (np.sqrt(2 * (1 - tangent) ** 2 + 4 * tangent) - np.sqrt(2) * (1 - tangent)) / 2
    return r / (1 + r)


PARAMETERS = np.array([parameter(NORMAL[1] / NORMAL[0]), parameter(NORMAL[2] / np.hypot(*NORMAL[:2]))])


def rows_of(kind: str, radius: float, center: Any, size: Any, side: float) -> Any:
    """A sphere, as an octant with the normal on one side, or as an implicit surface in a box."""
    dtype = size.dtype
    if kind == "patch":
        return NetRows((side * radius * jnp.asarray(OCTANT, dtype) + center) * size, jnp.asarray(WEIGHTS, dtype))
    powers = np.sum(np.indices((3, 3, 3)), axis=0)
    # Each coefficient times its power of the size, none of which is formed alone.
    f = sphere(radius, center, dtype=dtype) * jnp.where(powers > 0, 1 / size, 1) * jnp.where(powers > 1, 1 / size, 1)
    return Polynomial(f, *(jnp.full(3, x, dtype) * size for x in (-8, 8)))


def coordinates(kind: str, dtype: Any) -> Any:
    return jnp.asarray(PARAMETERS if kind == "patch" else np.zeros(3), dtype)


def witness(t: Any, point: Any, feet: Any, params: Any) -> Witness:
    """A witness with one foot that counts."""
    multipliers = jnp.asarray([1, 0, 0, 0], point.dtype)
    first, none = jnp.asarray(0), jnp.zeros(4, int)
    return Witness(first, t, point, feet, none, params, multipliers, EVENTS.antipodal, DIRECTIONS.a_to_b)


def least(kinds: tuple[str, str], center: Any, size: Any) -> Any:
    """The least distance, which grows with that of the centers."""
    normal = jnp.asarray(NORMAL, size.dtype)
    rows = rows_of(kinds[0], MOVING, center, size, -1), rows_of(kinds[1], FIXED, jnp.zeros(3, size.dtype), size, 1)
    value = (APART - MOVING - FIXED) * size
    points = (normal * (APART - MOVING) * size, normal * FIXED * size)
    solution = MinimumSolution(value, value, value, *points, RESULTS.successful, {})
    x = jnp.concatenate([coordinates(kind, size.dtype) for kind in kinds])
    function = from_nets if set(kinds) == {"patch"} else from_pair
    return function(rows, (solution, x, jnp.ones((), size.dtype))).numbers["value"] / size


def largest(kinds: tuple[str, str], center: Any, size: Any) -> Any:
    """The largest distance, from the far side of the sphere that moves to the near side of the other one."""
    normal = jnp.asarray(NORMAL, size.dtype)
    rows = rows_of(kinds[0], MOVING, center, size, 1), rows_of(kinds[1], FIXED, jnp.zeros(3, size.dtype), size, 1)
    if kinds[1] == "patch":
        rows = rows[0], jax.tree_util.tree_map(lambda x: jnp.broadcast_to(x, (4, *x.shape)), rows[1])
    params = coordinates(kinds[1], size.dtype)
    feet = jnp.broadcast_to(normal * FIXED * size, (4, 3))
    found = witness(coordinates(kinds[0], size.dtype), normal * (APART + MOVING) * size, feet, jnp.tile(params, (4, 1)))
    return from_place(rows, ((APART + MOVING - FIXED) * size, found)).numbers["value"] / size


KINDS = ("implicit", "implicit"), ("patch", "implicit"), ("patch", "patch")
# The unit is one for all kinds: single precision shows it with two implicit surfaces, which compile soonest. In double
# precision each function of the package gets a patch, and an octant is the first and the second surface.
SLOW = [(function, KINDS[0], np.float32) for function in (least, largest)]
SLOW += [(least, KINDS[1], np.float64), (least, KINDS[2], np.float64), (largest, KINDS[2], np.float64)]
CASES = [
    pytest.param(
        *case,
        id="-".join([case[0].__name__, *case[1], case[2].__name__]),
        marks=pytest.mark.slow if case in SLOW else pytest.mark.exhaustive,
    )
    for case in itertools.product((least, largest), KINDS, SIZES)
]


@pytest.mark.parametrize(("distance", "kinds", "dtype"), CASES)
def test_second_derivatives_between_spheres_do_not_depend_on_their_size(distance, kinds, dtype):
    center, sizes = jnp.asarray(APART * NORMAL, dtype), jnp.asarray(SIZES[dtype], dtype)

    def gradient(center: Any, size: Any) -> Any:
        slope = jax.grad(lambda center: distance(kinds, center, size))(center)
        return slope, slope

    bent, slopes = jax.jit(jax.vmap(jax.jacfwd(gradient, has_aux=True), in_axes=(None, 0)))(center, sizes)
    within = ROUNDING * np.finfo(dtype).eps
    np.testing.assert_allclose(slopes, np.broadcast_to(NORMAL, slopes.shape), atol=within, rtol=0)
    expected = (np.eye(3) - np.outer(NORMAL, NORMAL)) / APART
    np.testing.assert_allclose(bent, np.broadcast_to(expected, bent.shape), atol=within, rtol=0)


@pytest.mark.slow
def test_a_foot_on_a_triangle_of_another_size_moves_along_its_plane():
    # The farthest point of a sphere from the plane of the triangle is over the same point of it as the center.
    edges = np.linalg.svd(NORMAL[None])[2][1:]
    corners = jnp.asarray([*edges, -edges[0] - edges[1]])
    center, sizes = jnp.asarray(APART * NORMAL), jnp.asarray([1e-3, 1e-2, 1e-1, 1, 1e3, 1e6])
    point, value, thirds = center + MOVING * NORMAL, jnp.asarray(APART + MOVING), jnp.full((4, 3), 1 / 3)
    found = witness(jnp.zeros(3), point, jnp.zeros((4, 3)), thirds)

    def feet(center: Any, size: Any) -> Any:
        triangles = CornerRows(jnp.broadcast_to(size * corners, (4, 3, 3)))
        rows = rows_of("implicit", MOVING, center, jnp.ones(()), 1), triangles
        return from_place(rows, (value, found)).numbers["value"]

    bent = jax.jit(jax.vmap(jax.hessian(feet), in_axes=(None, 0)))(center, sizes)
    np.testing.assert_allclose(bent, np.zeros_like(bent), atol=1e-10)
