"""Every refusal of what is no array of finite real numbers, and what passes."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jhd
from jhd._runtime.arrays import array_of, check_finite, is_traced, is_tracing, joined, real_array, taken


@pytest.mark.parametrize(
    "value",
    [
        1,
        2.5,
        True,
        [1, 2],
        ((1, 2), (3, 4)),
        np.float32(1.5),
        np.arange(3),
        jnp.ones((2, 3)),
        np.array(3, dtype=np.uint8),
    ],
    ids=lambda value: type(value).__name__,
)
def test_real_numbers_become_arrays_of_the_default_precision(value):
    array = real_array("x", value)
    assert array.dtype == jnp.zeros(()).dtype
    np.testing.assert_array_equal(array, np.asarray(value, dtype=float))


def test_numbers_of_half_precision_pass():
    np.testing.assert_array_equal(real_array("x", jnp.array([1.5, 2.0], dtype=jnp.bfloat16)), [1.5, 2.0])


@pytest.mark.parametrize(
    ("value", "dtype"),
    [
        (1j, "complex128"),
        ([1.0, 2j], "complex128"),
        (["a", "b"], "<U1"),
        (None, "object"),
        ([len], "object"),
        ([1.0, None], "object"),
        (np.array(["2020-01-01"], dtype="datetime64[D]"), "datetime64[D]"),
    ],
    ids=str,
)
def test_what_is_no_real_number_is_refused_with_its_type(value, dtype):
    with pytest.raises(TypeError) as caught:
        real_array("weights", value)
    assert str(caught.value) == f"weights must be real numbers; its dtype is {dtype}."


def test_a_percentage_is_refused_with_the_number_that_it_stands_for():
    bounds = np.array([0.0, 0.0]), np.array([3.0, 4.0])
    with pytest.raises(TypeError, match="threshold is '2%'; needs a number; for the diagonal") as caught:
        real_array("threshold", "2%")
    shape = type("Shape", (), {"bounds": bounds})
    written = str(caught.value).rpartition(" of a shape: ")[2].removesuffix(".")
    assert eval(written, {"np": np, "shape": shape}) == pytest.approx(0.1)


def test_a_percentage_of_a_relative_tolerance_is_a_fraction():
    with pytest.raises(TypeError, match=r"rtol is '1%'; needs a number: 1 / 100\."):
        real_array("rtol", "1%")


class InMeters(np.ndarray):
    """An array that knows its unit, as those of astropy and unyt."""

    unit = "m"


class Frame:
    """A table with names of columns, as those of pandas and polars."""

    def __array__(self, dtype=None, copy=None):
        return np.eye(2)

    def to_numpy(self):
        return np.eye(2)


class Tensor:
    """A tensor with a gradient, as those of PyTorch."""

    def __array__(self, dtype=None, copy=None):
        return np.eye(2)

    def detach(self):
        return self


HIDDEN = np.ma.masked_array([[0, 0], [1, 1e20]], mask=np.array([[0, 0], [0, 1]], bool))


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (HIDDEN, "x has a mask with 1 hidden entries; remove them first (np.ma.compress_rows)."),
        ([HIDDEN[0], HIDDEN[1]], "x has a mask with 1 hidden entries; remove them first (np.ma.compress_rows)."),
        (np.ones(2).view(InMeters), "x has the unit m, which is not read; pass the numbers without the unit."),
        (Frame(), "x is a tests.Frame, not an array; pass its to_numpy()."),
        ([Tensor(), Tensor()], "x is a tests.Tensor, not an array; pass its detach().cpu().numpy()."),
    ],
    ids=["mask", "mask of a row", "unit", "frame", "row of a tensor"],
)
def test_masks_units_names_and_gradients_are_not_dropped_without_a_word(value, message):
    with pytest.raises(ValueError if "unit" in message else TypeError) as caught:
        real_array("x", value)
    assert str(caught.value) == message
    assert real_array("x", np.ma.masked_array([1, 2])).tolist() == [1, 2]


def test_ragged_rows_are_refused():
    with pytest.raises(ValueError) as caught:
        real_array("points", [[1.0, 2.0], [3.0]])
    assert str(caught.value) == "points must be a rectangular array of numbers; its rows differ in length."


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.nan, "x is not finite: nan."),
        (-np.inf, "x is not finite: -inf."),
        ([0.0, 1.0, np.inf], "x[2] is not finite: inf."),
        ([[0.0, 1.0], [np.nan, 0.5]], "x[1] is not finite: (nan, 0.5)."),
        ([[[0.0, 1.0]], [[2.0, -np.inf]]], "x[1, 0] is not finite: (2, -inf)."),
        (np.float32("inf"), "x is not finite: inf."),
        ([0, float("nan")], "x[1] is not finite: nan."),
    ],
    ids=str,
)
def test_the_first_row_that_is_not_finite_is_named(value, message):
    with pytest.raises(ValueError) as caught:
        real_array("x", value)
    assert str(caught.value) == message


def test_numbers_too_large_for_the_precision_are_refused():
    with pytest.raises((ValueError, TypeError), match="^x "):
        real_array("x", [10**400])


def test_empty_arrays_are_left_to_the_caller():
    assert real_array("x", []).shape == (0,)


def test_tracers_pass_unchecked_and_complex_ones_do_not():
    np.testing.assert_array_equal(jax.jit(lambda x: real_array("x", x))(jnp.array([jnp.nan, 1.0])), [np.nan, 1.0])
    assert jax.jit(lambda x: real_array("x", x))(jnp.arange(3)).dtype == jnp.zeros(()).dtype
    with pytest.raises(TypeError, match=r"^x must be real numbers; its dtype is complex"):
        jax.jit(lambda x: real_array("x", x))(1j)


def test_derivatives_pass():
    value, slope = jax.value_and_grad(lambda x: jnp.sum(real_array("x", x) ** 2))(jnp.array([1.0, 2.0]))
    assert value == 5
    np.testing.assert_array_equal(slope, [2.0, 4.0])


def test_lists_of_tracers_pass():
    np.testing.assert_array_equal(jax.jit(lambda x, y: real_array("x", [x, y]))(1.0, 2.0), [1.0, 2.0])


def test_whether_a_leaf_is_traced_is_known():
    seen = []

    @jax.jit
    def look(x):
        seen.append((is_traced(x), is_traced({"a": [1.0, x]}), is_traced(1.0, "text", None, np.ones(2))))
        return x

    look(1.0)
    assert seen == [(True, True, False)]


def test_finiteness_of_tracers_is_not_checked():
    assert jax.jit(lambda x: check_finite("x", x) is None and x)(jnp.nan) is not None
    assert check_finite("x", np.ones((2, 2))) is None


def test_operations_on_known_numbers_are_traced_inside_programs_alone():
    seen = []

    def look(x):
        seen.append((is_tracing(), is_tracing(x), is_tracing(1.0)))
        return 2.0 * x

    look(1.0)
    jax.grad(look)(1.0)
    jax.vmap(look)(jnp.ones(2))
    jax.jit(look)(1.0)
    assert seen == [(False, False, False), (False, True, False), (False, True, False), (True, True, True)]


@pytest.mark.parametrize("value", [np.arange(3), np.float32(2.0), np.ones((2, 2), bool), jnp.ones(2), 1.5])
@pytest.mark.parametrize("dtype", [None, float])
def test_an_array_of_something_is_that_of_jax(value, dtype):
    for array in (array_of(value, dtype), jax.jit(lambda: array_of(value, dtype))()):
        expected = jnp.asarray(value, dtype)
        assert isinstance(array, jax.Array)
        assert jax.typeof(array) == jax.typeof(expected)
        assert np.array_equal(array, expected)


def test_rows_of_a_table_are_taken_and_joined():
    table = Table(np.arange(3), np.arange(6).reshape(3, 2))
    parts = [taken(table, [2, 0]), taken(table, slice(0)), taken(table, np.array([False, True, False]))]
    whole = joined(parts)
    assert isinstance(whole, Table) and whole.first.tolist() == [2, 0, 1]
    assert whole.second.tolist() == [[4, 5], [0, 1], [2, 3]]


class Table(NamedTuple):
    first: np.ndarray
    second: np.ndarray


def aligned(numbers):
    """An array that is aligned so that JAX on CPUs shares its memory."""
    numbers = np.asarray(numbers, float)
    room = np.empty(numbers.nbytes + 64, np.uint8)
    start = -room.ctypes.data % 64
    found = room[start : start + numbers.nbytes].view(float).reshape(numbers.shape)
    found[:] = numbers
    return found


def test_a_shape_does_not_change_with_the_array_that_it_is_made_of():
    rows, knots, corners = aligned(np.arange(8).reshape(4, 2)), aligned([0, 0, 0, 0, 1, 1, 1, 1]), aligned(np.eye(3))
    triangles = aligned([0, 1, 2]).view(np.int64).reshape(1, 3)
    triangles[:] = [0, 1, 2]
    made = [
        *(make(rows) for make in (jhd.BezierCurve, jhd.point_set, jhd.polyline)),
        jhd.BSplineCurve(rows, knots),
        jhd.TriangleMesh(corners, triangles),
    ]
    before = [jax.tree_util.tree_map(np.array, shape) for shape in made]
    for array in (rows, knots, corners, triangles):
        array[:] = 9
    for shape, known in zip(made, before, strict=True):
        assert jax.tree_util.tree_all(jax.tree_util.tree_map(np.array_equal, shape, known))
