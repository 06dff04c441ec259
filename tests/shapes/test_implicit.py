"""Implicit surfaces: reading polynomials, values and gradients, affine images, and what is refused."""

from fractions import Fraction
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._arithmetic import exact_polynomials
from jhd._shapes import polynomial_text
from jhd._shapes.implicit import ImplicitSurface
from jhd._shapes.polynomial_text import PolynomialError

LOWER, UPPER = [-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]
# Rounding of a few dozen operations on numbers of order one to a hundred.
ROUNDING = 1e-11


def parsed(text):
    return ImplicitSurface.parse(text, LOWER, UPPER)


TEXTS = {
    "-x^2": {(2, 0, 0): -1},
    "2*-x": {(1, 0, 0): -2},
    "x**2*3 - .5e1*y": {(2, 0, 0): 3, (0, 1, 0): -5},
    "-2^2*x": {(1, 0, 0): -4},
    "x*(y+1/3)^2": {(1, 2, 0): 1, (1, 1, 0): Fraction(2, 3), (1, 0, 0): Fraction(1, 9)},
    "x^0*y": {(0, 1, 0): 1},
    "2^3^2*x": {(1, 0, 0): 512},
    "+x - -y": {(1, 0, 0): 1, (0, 1, 0): 1},
    " x\n + y\t/ (1/2 + 1/2)": {(1, 0, 0): 1, (0, 1, 0): 1},
    "0.1*z": {(0, 0, 1): Fraction(1, 10)},
    "x*x*x": {(3, 0, 0): 1},
    "x - x + z": {(0, 0, 1): 1},
    "1e-3*x/3": {(1, 0, 0): Fraction(1, 3000)},
    "2.*x": {(1, 0, 0): 2},
}


@pytest.mark.parametrize("text", TEXTS)
def test_text_is_read_exactly(text):
    assert polynomial_text.read(text) == TEXTS[text]


REFUSED = {
    "": (1, "found the end; needs a number, x, y, z or an opening parenthesis"),
    "x +": (4, "found the end"),
    "2x": (2, "found 'x'; needs an operator"),
    "sin(x)": (1, "found 'sin'"),
    "x + w": (5, "found 'w'"),
    "__import__('os').system('true')": (1, "found '__import__'"),
    "x.real": (2, "found '.'"),
    "x[0]": (2, "found '['"),
    "lambda: x": (1, "found 'lambda'"),
    "x**y": (4, "the exponent is no constant; needs a whole number from 0 to 32"),
    "x**-1": (4, "the exponent is -1"),
    "x^(1/2)": (3, "the exponent is 1/2"),
    "x^33": (3, "the exponent is 33"),
    "x^20*y^20": (6, "the degree is 40; at most 32 is supported"),
    "1/x": (3, "the divisor is no constant"),
    "x/(2 - 2)": (3, "the divisor is zero"),
    "(x": (3, "needs an operator or a closing parenthesis"),
    "x)": (2, "found ')'; needs an operator"),
    "x $ y": (3, "found '$'"),
    "x = 1": (3, "found '=', but f = g is written f - (g); needs"),
    "0.1.2*x": (4, "found '.2'"),
    "x^1_0": (4, "found '_0'"),
    "1e999*x": (1, "1e999 is outside the range of doubles"),
    "((((((2^32)^32)^32)^32)^32)^32)*x": (21, "more than 50000 bits"),
    "(" * 200 + "x" + ")" * 200: (41, "nested deeper than 40"),
    "-" * 2000 + "x": (41, "nested deeper than 40"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_no_polynomial_is_refused_with_its_column(text):
    column, message = REFUSED[text]
    with pytest.raises(PolynomialError) as found:
        parsed(text)
    assert found.value.column == column
    assert str(found.value).startswith(f"column {column}: ") and message in str(found.value)


def test_numbers_are_rounded_once():
    surface = parsed("0.1*x + 0.2*x + z/3 - 1e-400*1e399*y")
    assert surface.coefficients[1, 0, 0] == 0.3
    assert surface.coefficients[0, 0, 1] == 1 / 3
    assert surface.coefficients[0, 1, 0] == -0.1


def a_poly(terms, gens=("x", "z")):
    return SimpleNamespace(gens=gens, terms=lambda: terms)


def test_a_sympy_polynomial_is_taken_by_its_terms():
    third = SimpleNamespace(is_Rational=True, p=1, q=3)
    surface = parsed(a_poly([((2, 0), third), ((0, 1), 0.5)]))
    assert surface.coefficients.shape == (3, 1, 2)
    assert surface.coefficients[2, 0, 0] == 1 / 3 and surface.coefficients[0, 0, 1] == 0.5


@pytest.mark.parametrize(
    ("polynomial", "kind", "message"),
    [
        (a_poly([((1, 0), 1.0)], ("x", "t")), ValueError, "generators x, t; needs some of x, y and z"),
        (a_poly([((1, 0), 1j)]), ValueError, "needs real numbers"),
        (a_poly([((1, 0), float("nan"))]), ValueError, "needs real numbers"),
        (17, TypeError, "must be text or a sympy.Poly in x, y and z; got int"),
    ],
)
def test_other_objects_are_no_polynomials(polynomial, kind, message):
    with pytest.raises(kind, match=message):
        parsed(polynomial)


BALL = np.zeros((3, 3, 3))
BALL[2, 0, 0] = BALL[0, 2, 0] = BALL[0, 0, 2] = 1
BALL[0, 0, 0] = -1
HOLE = BALL.copy()
HOLE[1, 2, 0] = np.nan


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        ((np.zeros((3, 3, 3)), LOWER, UPPER), ValueError, "coefficients are all zero"),
        ((np.full((1, 1, 1), 3.0), LOWER, UPPER), ValueError, "the constant 3, which is zero nowhere; the surface is"),
        ((HOLE, LOWER, UPPER), ValueError, r"coefficients\[1, 2\] is not finite"),
        ((np.ones((2, 2)), LOWER, UPPER), ValueError, r"coefficients has shape \(2, 2\); needs \(i, j, k\)"),
        ((np.ones((2, 0, 1)), LOWER, UPPER), ValueError, r"coefficients has shape \(2, 0, 1\)"),
        ((BALL + 1j, LOWER, UPPER), TypeError, "coefficients must be real numbers"),
        ((BALL, [0, 0], UPPER), ValueError, r"lower has shape \(2,\); needs \(3,\)"),
        ((BALL, LOWER, [2, -3, 2]), ValueError, r"lower\[1\] is -2 and upper\[1\] is -3; needs lower < upper"),
        ((BALL, LOWER, [2, 2, -2]), ValueError, r"lower\[2\] is -2 and upper\[2\] is -2"),
        ((BALL, [0, 0, -np.inf], UPPER), ValueError, r"lower\[2\] is not finite"),
        ((BALL, LOWER, ["a", 1, 1]), TypeError, "upper must be real numbers"),
    ],
)
def test_what_is_no_surface_is_refused(arguments, kind, message):
    with pytest.raises(kind, match=message):
        ImplicitSurface(*arguments)


def test_one_number_is_the_end_of_the_box_along_all_axes(as_a_user):
    for box, meant in (((-2, 2), (LOWER, UPPER)), ((-2.0, [1, 2, 3]), ([-2] * 3, [1, 2, 3]))):
        surface = ImplicitSurface(BALL, *box)
        np.testing.assert_array_equal(surface.bounds, meant)
        assert surface.lower.shape == surface.upper.shape == (3,)
    np.testing.assert_array_equal(ImplicitSurface.parse("x", -1, 1).bounds, [[-1.0] * 3, [1.0] * 3])


@pytest.mark.parametrize("text", ["x - x", "3", "(x - y)^2 - x^2 + 2*x*y - y^2"])
def test_text_that_is_constant_is_refused(text):
    with pytest.raises(ValueError, match="all zero|is zero nowhere"):
        parsed(text)


def test_a_coefficient_that_is_no_double_is_refused():
    with pytest.raises(ValueError, match="above the largest double"):
        parsed("1e300*1e300*x + y")


def test_repeated_factors_are_taken_out_and_said_so():
    surface = parsed("(x^2 + y^2 + z^2 - 1)^2 * (z - 0.1)^3")
    assert surface.reduced and surface.degree == 3
    once = parsed("(x^2 + y^2 + z^2 - 1) * (10*z - 1)")
    assert not once.reduced
    assert np.array_equal(np.abs(surface.coefficients), np.abs(once.coefficients))
    # From floats as well, where they are a square exactly; and not where rounding has spoilt it.
    assert ImplicitSurface([[[0.25, -1.0, 1.0]]], LOWER, UPPER).coefficients.tolist() == [[[-1, 2]]]
    assert not ImplicitSurface([[[0.1**2, -0.2, 1.0]]], LOWER, UPPER).reduced


def test_the_square_free_part_is_taken_once(monkeypatch):
    taken, part = [], exact_polynomials.square_free_part
    monkeypatch.setattr(exact_polynomials, "square_free_part", lambda exact: taken.append(exact) or part(exact))
    surface = parsed("(x + y)^2")
    assert len(taken) == 1
    surface.transform(2 * np.eye(3)).transform(np.eye(3))
    assert len(taken) == 1
    ImplicitSurface(surface.coefficients, LOWER, UPPER)
    assert len(taken) == 2


def test_under_tracing_coefficients_stay_as_they_are():
    made = jax.jit(lambda c: ImplicitSurface(c, LOWER, UPPER))(jnp.array([[[0.25, -1.0, 1.0]]]))
    assert made.coefficients.shape == (1, 1, 3) and not made.reduced


POINTS = np.random.default_rng(1).uniform(-2, 2, (4, 5, 3))
QUARTIC = "(x^2 + y^2 + z^2 + 0.75)^2 - 4*(x^2 + y^2) + x*y*z - z/3"


def quartic(p):
    x, y, z = np.moveaxis(np.asarray(p), -1, 0)
    return (x**2 + y**2 + z**2 + 0.75) ** 2 - 4 * (x**2 + y**2) + x * y * z - z / 3


def test_values_and_gradients_are_those_of_the_polynomial():
    surface = parsed(QUARTIC)
    assert surface.degrees == (4, 4, 4) and surface.degree == 4 and surface.dim == 3
    assert surface(POINTS).shape == (4, 5) and surface(POINTS[0, 0]).shape == ()
    assert np.abs(surface(POINTS) - quartic(POINTS)).max() < ROUNDING
    slopes = jax.vmap(jax.grad(surface))(jnp.asarray(POINTS.reshape(-1, 3)))
    assert np.abs(surface.gradient(POINTS).reshape(-1, 3) - slopes).max() < ROUNDING
    flat = parsed("x^2 - 2")
    assert flat.gradient([3.0, 1.0, 1.0]).tolist() == [6, 0, 0]


def test_values_are_differentiable_in_the_coefficients():
    slope = jax.grad(lambda c: ImplicitSurface(c, LOWER, UPPER)(jnp.array([2.0, 3.0, 0.5])))(jnp.asarray(BALL))
    assert slope[1, 2, 1] == 2 * 9 * 0.5


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize("points", [1.0, [1.0, 2.0], np.zeros((3, 2))])
def test_points_have_three_coordinates(points):
    with pytest.raises(ValueError, match=r"points has shape .*; needs \(\.\.\., 3\)"):
        parsed(QUARTIC)(points)


EXACT_MAPS = {
    "translation": (np.eye(3), [1.0, -2.0, 0.5], [-1, -4, -1.5], [3, 0, 2.5], (4, 4, 4)),
    "scaling": (np.diag([2.0, 0.5, 1.0]), 0.0, [-4, -1, -2], [4, 1, 2], (4, 4, 4)),
    "mirror": (np.diag([-1.0, 1.0, 1.0]), [1.0, 0.0, 0.0], [-1, -2, -2], [3, 2, 2], (4, 4, 4)),
    "exchange": (np.eye(3)[[1, 2, 0]], [1.0, 2.0, 3.0], [-1, 0, 1], [3, 4, 5], (4, 4, 4)),
    "rotation": (np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]), 1.0, [-1.8, -1.8, -1], [3.8, 3.8, 3], (4, 4, 4)),
    "shear": (np.array([[1.0, 0.25, 0], [0, 1, 0], [0, 0.5, 1]]), 0.0, [-2.5, -2, -3], [2.5, 2, 3], (4, 4, 4)),
}


@pytest.mark.parametrize("name", EXACT_MAPS)
def test_an_image_has_the_values_of_its_points_and_the_box_of_its_box(name):
    matrix, offset, lower, upper, degrees = EXACT_MAPS[name]
    image = parsed(QUARTIC).transform(matrix, offset)
    assert np.abs(image(POINTS @ matrix.T + offset) - quartic(POINTS)).max() < 1e2 * ROUNDING
    assert np.allclose(image.lower, lower, rtol=0, atol=1e-14) and np.allclose(image.upper, upper, rtol=0, atol=1e-14)
    assert image.degrees == degrees


def test_an_image_has_no_more_room_than_its_degree():
    square = parsed("x^2 - y")
    assert square.transform(np.diag([2.0, 1.0, 1.0])).degrees == (2, 1, 0)
    assert square.transform(EXACT_MAPS["rotation"][0]).degrees == (2, 2, 0)
    assert square.transform(np.eye(3)[[2, 0, 1]]).degrees == (0, 2, 1)


def test_an_image_is_differentiable_and_can_be_traced():
    matrix, point = jnp.asarray(EXACT_MAPS["shear"][0]), jnp.array([0.3, -0.2, 0.7])

    def at(scale):
        return ImplicitSurface(BALL, LOWER, UPPER).transform(scale * matrix, 0.1)(point)

    step = 1e-6
    slope = (at(1 + step) - at(1 - step)) / (2 * step)
    assert abs(jax.jit(jax.grad(at))(1.0) - slope) < 1e-7


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("matrix", "offset", "message"),
    [
        (np.ones((3, 3)), 0.0, "matrix is singular"),
        (np.diag([1.0, 1.0, 1e-320]), 0.0, "matrix is singular"),
        (np.eye(2), 0.0, r"matrix has shape \(2, 2\); needs \(3, 3\)"),
        (np.eye(3), [1.0, 2.0], r"offset has shape \(2,\); needs \(3,\)"),
        (np.diag([1.0, np.nan, 1.0]), 0.0, r"matrix\[1\] is not finite"),
    ],
)
def test_maps_that_are_none_are_refused(matrix, offset, message):
    with pytest.raises(ValueError, match=message):
        parsed(QUARTIC).transform(matrix, offset)


def test_a_box_of_one_traced_number_is_that_of_all_axes():
    def lowest(end):
        return ImplicitSurface(BALL, end, UPPER).lower

    np.testing.assert_array_equal(jax.jit(lowest)(-3.0), [-3.0, -3.0, -3.0])
