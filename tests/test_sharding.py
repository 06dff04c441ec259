"""Batches whose axis is explicitly sharded give what they give elsewhere."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import NamedSharding, PartitionSpec

import jhd
from jhd._runtime.arrays import varying
from jhd._runtime.sharding import shared_by_devices

MESH = jax.make_mesh((1, 1), ("i", "j"))


def sharded(x, *axes):
    return jax.device_put(x, NamedSharding(MESH, PartitionSpec(*axes)))


def looked_up(table, k):
    """What JAX does for no explicitly sharded batch: it looks up in a loop."""
    start = varying(jnp.zeros(()), k)
    return jax.lax.scan(lambda total, i: (total + table[(k + i) % 3], k * table[i]), start, jnp.arange(3))


@pytest.mark.parametrize("axes", [("i",), (("i", "j"),), ("i", "j"), (None, "j"), ()])
@pytest.mark.parametrize("run", [jax.jit, lambda f: f])
def test_a_batch_is_computed_wherever_it_lies(run, axes):
    table, k = jnp.array([1.0, 2.0, 4.0]), jnp.arange(4).reshape(2, 2)
    double = run(jax.vmap(jax.vmap(shared_by_devices(looked_up), in_axes=(None, 0)), in_axes=(None, 0)))
    found = double(sharded(table), sharded(k, *axes))
    assert jax.typeof(found[0]).sharding.spec == PartitionSpec(*(*axes, None, None)[:2])
    for x, y in zip(found, double(table, k), strict=True):
        np.testing.assert_array_equal(x, y)
    assert found[0].tolist() == [[7.0, 7.0], [7.0, 7.0]]


def test_a_search_is_traced_of_an_explicitly_sharded_batch():
    rows = sharded(np.random.default_rng(6).uniform(1, 2, (4, 2, 4, 3)), "i")

    def distance(x):
        a, b = (jhd.BezierCurve(y[:, :2], y[:, 2]) for y in x)
        return jhd.hausdorff(a, b).value

    # JAX loses the mesh of some operations (0.12.0.1: the exponent of `frexp`), which shows as they are traced.
    assert jax.jit(jax.vmap(distance)).trace(rows).out_info.shape == (4,)


@pytest.mark.exhaustive
def test_distances_of_an_explicitly_sharded_batch():
    rows = jnp.asarray(np.random.default_rng(6).normal(size=(4, 2, 4, 2)))
    batch = jax.jit(jax.vmap(lambda x: jhd.hausdorff(jhd.BezierCurve(x[0]), jhd.BezierCurve(x[1]))))
    found, known = batch(sharded(rows, "i")), batch(rows)
    assert jax.typeof(found.value).sharding.spec == PartitionSpec("i")
    for name in ("value", "lower", "upper"):
        np.testing.assert_array_equal(getattr(found, name), getattr(known, name))
    np.testing.assert_array_equal(found.witness.feet, known.witness.feet)


@pytest.mark.parametrize(
    "made",
    [
        lambda x, height: jhd.BezierCurve(x[:, :2]),
        pytest.param(lambda x, height: jhd.BezierPatch(x.reshape(2, 2, 3) + [0, 0, height]), marks=pytest.mark.slow),
    ],
    ids=["curves", "patches"],
)
def test_plain_calls_do_not_see_the_mesh_of_the_user(made):
    rows = np.random.default_rng(6).normal(size=(2, 4, 3))

    def found():
        a, b = (made(x, height) for x, height in zip(rows, (0, 5), strict=True))
        return [call(a, b) for call in (jhd.hausdorff, jhd.minimum_distance)]

    known = found()
    with jax.set_mesh(MESH):
        # The arrays of shapes that are made here have the axes of the mesh.
        for x, y in zip(found(), known, strict=True):
            assert (x.value, x.lower, x.upper) == (y.value, y.lower, y.upper)
