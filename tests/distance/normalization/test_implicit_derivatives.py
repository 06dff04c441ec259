"""Numbers that follow rows of arrays: first and second derivatives, and one program for arrays of any length."""

import jax
import jax.numpy as jnp
import numpy as np

from jhd._distance.normalization.implicit_derivatives import MovingNumbers, TouchedRows, following

TABLE = np.array([[0, 1], [2, 0], [1, 2]])
ARRAY = np.array([[1.0, 2.0], [3.0, 5.0], [7.0, 11.0]])


def moving(rows, constants):
    """A product and a sum of squares of rows; of the latter no derivatives where the constant is not positive."""
    first, (pair, whole) = rows[0], rows[1]
    numbers = {
        "product": first[0] * pair[0, 1] * whole[1, 1],
        "squares": jnp.sum(pair**2),
        "root": jnp.sqrt(first[1] - 1.0),
    }
    return MovingNumbers(numbers, {"product": True, "squares": constants > 0, "root": True})


def found(x, name, constant=1.0):
    """A number found, 10 times too large: only its derivatives are those of the function."""
    parts = [TouchedRows(x, jnp.array(-1)), (TouchedRows(x, jnp.array(1), TABLE), TouchedRows(x))]
    numbers = {"product": jnp.array(100.0), "squares": jnp.array(10.0), "root": jnp.array(0.0)}
    return following(moving, numbers, parts, jnp.array(constant))[name]


def expected(x, name):
    """The same, written out."""
    return x[0, 0] * x[2, 1] * x[1, 1] if name == "product" else jnp.sum(x[jnp.array([2, 0])] ** 2)


slope_of, bend_of = (jax.jit(change(expected), static_argnums=1) for change in (jax.grad, jax.hessian))


def test_derivatives_are_those_of_the_function_and_the_number_is_the_one_found():
    x = jnp.asarray(ARRAY)
    for name in ("product", "squares"):
        for change in (lambda f: f, jax.jit):
            value, slope = change(jax.value_and_grad(lambda x, name=name: found(x, name)))(x)
            assert float(value) == {"product": 100.0, "squares": 10.0}[name]
            np.testing.assert_array_equal(slope, slope_of(x, name))
            np.testing.assert_array_equal(change(jax.hessian(lambda x, name=name: found(x, name)))(x), bend_of(x, name))


def test_where_there_are_none_or_they_are_not_finite_derivatives_are_zero():
    x = jnp.asarray(ARRAY)
    assert not np.any(jax.grad(lambda x: found(x, "squares", 0.0))(x))
    # There is no root of a negative number.
    assert not np.any(jax.grad(lambda x: found(x.at[0, 1].set(0.5), "root"))(x))


def test_arrays_of_any_length_share_the_program_of_the_slopes():
    traced = []

    def counted(rows, constants):
        traced.append(rows[0].shape)
        return MovingNumbers({"sum": jnp.sum(rows[0])}, True)

    for count in (3, 4, 3):
        slope = jax.grad(
            lambda x: following(counted, {"sum": jnp.zeros(())}, [TouchedRows(x, jnp.array(1))], ())["sum"]
        )
        assert np.asarray(slope(jnp.ones((count, 2))))[1].tolist() == [1.0, 1.0]
    assert traced == [(2,)]


def test_second_derivatives_of_functions_of_the_numbers_have_all_their_terms():
    x = jnp.asarray(ARRAY)
    for change in (lambda f: f, jax.jit):
        bend = change(jax.hessian(lambda x: found(x, "product") ** 2))(x)
        slope = slope_of(x, "product")
        # The number found is a constant: only its derivatives are those of the function.
        expected_bend = 2 * slope[..., None, None] * slope + 200.0 * bend_of(x, "product")
        np.testing.assert_allclose(bend, expected_bend, rtol=1e-14, atol=1e-12)
