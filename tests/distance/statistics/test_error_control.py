"""Derivatives of measures that are not confirmed are refused outside of programs, and NaN inside."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._distance.statistics.error_control import Estimated


def chosen(first, second):
    """The derivative of the larger one of x and 2 x at one, of which so much is known."""

    def value(x):
        return Estimated(x, first).larger(Estimated(2 * x, second)).guarded()

    return float(jax.grad(value)(1.0))


def test_only_the_larger_value_needs_a_confirmed_derivative():
    assert chosen(0.0, 1e-7) == 2.0
    assert chosen(np.inf, 1e-7) == 2.0
    assert np.isnan(chosen(0.0, 1e-5))


def test_of_equal_values_both_count_half_where_both_are_confirmed():
    def value(x, off):
        return Estimated(x, off).larger(Estimated(2 - x, 0.0)).guarded()

    assert float(jax.grad(value)(1.0, 0.0)) == 0.0
    assert np.isnan(jax.grad(value)(1.0, 1e-3))


def test_what_is_not_differentiated_is_not_refused():
    assert float(Estimated(jnp.asarray(3.0), np.inf).guarded()) == 3.0


@pytest.mark.slow
def test_derivatives_over_more_pieces_than_are_looked_at_closely_are_refused():
    side = np.linspace(0.0, 1.0, 56)
    rows = jnp.stack([*np.meshgrid(side, side, indexing="ij"), np.zeros((56, 56))], axis=-1).reshape(-1, 3)
    k = (56 * np.arange(55)[:, None] + np.arange(55)).ravel()
    cells = np.concatenate([np.stack([k, k + 1, k + 57], axis=1), np.stack([k, k + 57, k + 56], axis=1)])

    def value(height, nodes=None):
        mesh = jhd.TriangleMesh(rows, cells)
        return jhd.MeanDistance(True).estimate(
            mesh, jhd.point_set(jnp.array([[0.3, 0.4, 0.5]]).at[0, 2].set(height)), None, nodes
        )

    known = float(value(0.5))
    with pytest.raises(jhd.NotProvenError, match=r"not to 1e-06.*nodes=n"):
        jax.grad(value)(0.5)
    smoothed, slope = jax.value_and_grad(lambda x: value(x, 4000))(0.5)
    # One place in each triangle, beside its middle.
    assert float(smoothed) == pytest.approx(known, rel=1e-2) and 0.5 < slope < 1.0
    inside, unknown = jax.jit(jax.value_and_grad(value))(0.5)
    assert float(inside) == pytest.approx(known, rel=1e-12) and np.isnan(unknown)
