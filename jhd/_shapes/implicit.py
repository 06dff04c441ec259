"""Implicit surfaces: the zeros of a polynomial in three variables inside a box."""

from fractions import Fraction
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jhd._arithmetic import exact_polynomials
from jhd._arithmetic.polynomials import horner, slopes
from jhd._results.display import batch_text, between_text, described, is_known, opaque, value_text
from jhd._runtime.arrays import is_traced, real_array
from jhd._runtime.compiled import optimized
from jhd._shapes import polynomial_text
from jhd._shapes.approximation import Approximation, checked_tolerance
from jhd._shapes.checks import Numbers
from jhd._shapes.foreign import SymPyPolynomial
from jhd._shapes.implicit_mesh import triangulate
from jhd._shapes.mesh import TriangleMesh


class ImplicitSurface(eqx.Module):
    """The points of a box at which a polynomial is zero.

    The box is part of the shape. It cuts the surface off, and the cut is a border of the surface that counts in its
    distances. Repeated factors are removed exactly: (z - 1)^2 becomes z - 1, which has the same zeros and changes its
    sign there. `reduced` records this. Traced coefficients are left unchanged.

    Distances refer to the stored coefficients. A point counts if it can be proven, in one of two ways:

    - The polynomial changes its sign there.
    - The polynomial is zero exactly at an isolated point with simple fractions as coordinates. For example, (x - 1/2)^2
      + y^2 + z^2 describes one point. (x - 0.3)^2 + y^2 + z^2 describes none: with rounded coefficients the polynomial
      is positive everywhere.

    Curves without a sign change, for example x^2 + y^2, cannot be proven. They lead to RESULTS.existence_not_certified
    or to wider bounds; under `jit` isolated points do as well.

    >>> import jhd
    >>> sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2, -2, -2], [2, 2, 2])
    >>> float(sphere([1.0, 0.0, 2.0])), sphere.gradient([1.0, 0.0, 2.0]).tolist()
    (4.0, [2.0, 0.0, 4.0])

    Args:
        coefficients: (i, j, k) real numbers; entry [i, j, k] is the coefficient of x^i y^j z^k.
        lower: (3,) smallest coordinates of the box, in any unit of length, or one number for all axes.
        upper: (3,) largest coordinates of the box, in the same unit, or one number for all axes.
        reduced: None (the default) removes repeated factors. Pass True or False only if none are left: True if some
            were removed before.

    Raises:
        ValueError: wrong shapes, NaN or infinity, a box that is reversed or has no volume, the zero polynomial, or a
            constant, which has no zeros.
        TypeError: entries that are not real numbers.
    """

    coefficients: Float[Array, "i j k"]
    lower: Float[Array, "3"]
    upper: Float[Array, "3"]
    reduced: bool = eqx.field(static=True)

    def __init__(self, coefficients: Numbers, lower: Numbers, upper: Numbers, *, reduced: bool | None = None):
        array = real_array("coefficients", coefficients)
        if array.ndim != 3 or 0 in array.shape:
            raise ValueError(f"coefficients has shape {array.shape}; needs (i, j, k), at least (1, 1, 1).")
        if reduced is None and not is_traced(array):
            _check_not_constant(np.asarray(array))
            exact = exact_polynomials.integers(np.asarray(array))
            part = exact_polynomials.square_free_part(exact)
            reduced = part is not exact
            array = jnp.asarray(exact_polynomials.floats(part, scaled=False), array.dtype) if reduced else array
        self.coefficients, self.reduced = array, bool(reduced)
        self.lower, self.upper = (_corner(name, end) for name, end in (("lower", lower), ("upper", upper)))
        _check_box(self.lower, self.upper)

    @classmethod
    def parse(cls, polynomial: str | SymPyPolynomial, lower: Numbers, upper: Numbers) -> "ImplicitSurface":
        """The surface of a polynomial written as text, or of a `sympy.Poly`.

        Numbers are exact: 0.1 is one tenth. Repeated factors are removed before any rounding. Then every coefficient is
        rounded to the nearest double.

        >>> import jhd
        >>> cone = jhd.ImplicitSurface.parse("x^2/4 + y^2/4 - z^2/9", [-2, -2, -2], [2, 2, 2])
        >>> [float(cone.coefficients[i]) for i in ((2, 0, 0), (0, 2, 0), (0, 0, 2))]
        [0.25, 0.25, -0.1111111111111111]
        >>> jhd.ImplicitSurface.parse("(z - 0.1)**2", [0, 0, 0], [1, 1, 1]).coefficients.tolist()
        [[[-1.0, 10.0]]]

        Args:
            polynomial: sums and products of x, y, z, numbers and parentheses; integer powers (** or ^) from 0 to 32;
                divisions by constants.
            lower: (3,) smallest coordinates of the box, in any unit of length, or one number for all axes.
            upper: (3,) largest coordinates of the box, in the same unit, or one number for all axes.

        Returns:
            The surface inside the box.

        Raises:
            ValueError: arguments that the class refuses, or text that is not a polynomial (PolynomialError, which names
                the column).
            TypeError: `polynomial` is neither text nor a sympy.Poly.
        """
        text = isinstance(polynomial, str)
        terms = polynomial_text.read(polynomial) if text else polynomial_text.from_sympy(polynomial)
        given = np.full(np.max([(0, 0, 0), *terms], axis=0) + 1, Fraction(0))
        for index, x in terms.items():
            given[index] = x
        _check_not_constant(given)
        exact = exact_polynomials.integers(given)
        part = exact_polynomials.square_free_part(exact)
        reduced = part is not exact
        rounded = exact_polynomials.floats(part, scaled=False) if reduced else _rounded(given)
        _check_not_constant(rounded)
        return cls(rounded, lower, upper, reduced=reduced)

    def _equation(self) -> str:
        if not is_known(self.coefficients) or self.coefficients.ndim != 3:
            return f"coefficients={value_text(self.coefficients)}"
        known = np.asarray(self.coefficients)
        # Longer polynomials are printed as their degree and number of terms.
        if np.count_nonzero(known) > 12:
            return f"polynomial of degree {self.degree} with {np.count_nonzero(known)} terms"
        return f"{polynomial_text.written(known)} = 0"

    def __repr__(self) -> str:
        return opaque(self) or described(
            self,
            batch_text(self.coefficients, 3),
            self._equation(),
            between_text(self.lower, self.upper),
            "repeated factors taken out" if self.reduced else "",
        )

    @property
    def dim(self) -> int:
        """Number of coordinates: 3."""
        return 3

    @property
    def degrees(self) -> tuple[int, int, int]:
        """Largest degree in each variable that the array can hold."""
        i, j, k = self.coefficients.shape[-3:]
        return i - 1, j - 1, k - 1

    @property
    def degree(self) -> int:
        """Total degree, the largest i + j + k of a nonzero coefficient; traced coefficients count as nonzero."""
        if is_traced(self.coefficients):
            return sum(self.degrees)
        return exact_polynomials.total_degree(np.asarray(self.coefficients))

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper corner of the box."""
        return self.lower, self.upper

    def __call__(self, points: Numbers) -> Array:
        """Values of the polynomial at points (..., 3), inside or outside the box: shape (...)."""
        return _values(self.coefficients, _rows("points", points))

    def gradient(self, points: Numbers) -> Array:
        """Gradients of the polynomial at points (..., 3): shape (..., 3)."""
        return _gradients(self.coefficients, _rows("points", points))

    def transform(self, matrix: Numbers, offset: Numbers = 0.0) -> "ImplicitSurface":
        """The image under x -> matrix x + offset; differentiable in both, with ordinary rounding.

        The new box is the smallest axis-parallel box that contains the image of the old box. If the matrix only scales,
        mirrors or permutes the axes, both agree, and the result is the image of the surface. Any other matrix gives a
        larger box, which can contain additional zeros of the polynomial.

        Args:
            matrix: (3, 3) invertible matrix. If it mixes axes, the degree in each variable rises to the total degree.
            offset: (3,) translation in the unit of the coordinates, or one number for all axes.

        Returns:
            The surface of the new polynomial in the new box.

        Raises:
            ValueError: wrong shapes, NaN or infinity, or a singular matrix.
        """
        matrix, offset = real_array("matrix", matrix), real_array("offset", offset)
        if matrix.shape != (3, 3):
            raise ValueError(f"matrix has shape {matrix.shape}; needs (3, 3).")
        if offset.shape not in ((), (1,), (3,)):
            raise ValueError(f"offset has shape {offset.shape}; needs (3,).")
        mixed = ((True,) * 3,) * 3 if is_traced(matrix) else _pattern(np.asarray(matrix))
        image = _image(self.coefficients, self.lower, self.upper, matrix, offset, mixed, self.degree)
        return ImplicitSurface(*image, reduced=self.reduced)

    def to_mesh(self, tolerance: Numbers, *, max_triangles: int = 2_000_000) -> Approximation[TriangleMesh]:
        """A triangle mesh of a regular surface with a certified deviation of at most `tolerance` in both directions.

        Every point of the mesh is within the deviation of a zero of the polynomial in the box. Every zero in the box is
        within the deviation of the mesh. A surface is regular if, up to a fine grid:

        - the gradient vanishes nowhere on the surface,
        - the surface is tangent to no face of the box and lies in none,
        - the surface meets edges and corners of the box only if it enters the box there.

        For other surfaces nothing is proven, and NotRegularError names a point. Triangles are counter-clockwise, seen
        from the side on which the polynomial is positive. A surface that does not meet the faces of its box gives a
        closed mesh. All grid cells have one size, so their number depends on the largest curvature and the smallest
        gradient.

        >>> import jhd
        >>> sphere = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", [-2, -2, -2], [2, 2, 2])
        >>> mesh, deviation = sphere.to_mesh(0.1)
        >>> mesh.is_closed, deviation <= 0.1
        (True, True)

        Args:
            tolerance: largest deviation allowed in either direction, a positive length in the unit of the coordinates.
            max_triangles: largest number of triangles to produce; it grows like 1 / tolerance.

        Returns:
            The mesh with its deviation.

        Raises:
            NotRegularError: a ValueError; the surface could not be proven regular.
            ValueError: `tolerance` is not positive or needs more than `max_triangles`; or the surface is empty.
            TypeError: the surface is traced; the number of triangles depends on its numbers.
        """
        wanted = checked_tolerance(tolerance, self, "to_mesh needs a concrete surface", "triangles")
        coefficients, lower, upper = (np.asarray(x) for x in (self.coefficients, self.lower, self.upper))
        found = triangulate(coefficients, lower, upper, wanted, max_triangles)
        return Approximation(TriangleMesh(found.vertices, found.triangles), found.deviation)


def check_surface(name: str, value: object) -> None:
    """Raise TypeError unless the value is an implicit surface."""
    if not isinstance(value, ImplicitSurface):
        raise TypeError(f"{name} must be an ImplicitSurface; got {type(value).__name__}.")


def _corner(name: str, value: Any) -> Array:
    corner = real_array(name, value if is_traced(value) or np.ndim(value) else np.full(3, value))
    if corner.shape == ():
        corner = jnp.broadcast_to(corner, 3)
    if corner.shape != (3,):
        raise ValueError(f"{name} has shape {corner.shape}; needs (3,), or one number for all axes.")
    return corner


def _check_box(lower: Array, upper: Array) -> None:
    if is_traced(lower, upper):
        return
    low, high = np.asarray(lower), np.asarray(upper)
    bad = np.flatnonzero(low >= high)
    if len(bad):
        i = int(bad[0])
        raise ValueError(f"lower[{i}] is {float(low[i]):g} and upper[{i}] is {float(high[i]):g}; needs lower < upper.")


def _check_not_constant(coefficients: np.ndarray) -> None:
    others = coefficients.ravel()[1:]
    if np.any(others != 0):
        return
    constant = _rounded(coefficients[:1, :1, :1]).item()
    if constant == 0:
        raise ValueError("coefficients are all zero; every point of the box would be on the surface.")
    raise ValueError(f"the polynomial is the constant {constant:g}, which is zero nowhere; the surface is empty.")


def _rounded(given: np.ndarray) -> np.ndarray:
    try:
        return np.array([float(x) for x in given.flat]).reshape(given.shape)
    except OverflowError:
        raise ValueError("the polynomial has a coefficient above the largest double; scale it.") from None


def _rows(name: str, points: Numbers) -> Array:
    rows = real_array(name, points)
    if rows.ndim == 0 or rows.shape[-1] != 3:
        raise ValueError(f"{name} has shape {rows.shape}; needs (..., 3).")
    return rows


@optimized
def _values(coefficients: Array, points: Array) -> Array:
    """Values at points (..., 3)."""
    return horner(coefficients, points.reshape(-1, 3).T).reshape(points.shape[:-1])


@optimized
def _gradients(coefficients: Array, points: Array) -> Array:
    """Gradients at points (..., 3)."""
    return jnp.moveaxis(slopes(coefficients, jnp.moveaxis(points, -1, 0))[1], 0, -1)


def _pattern(matrix: np.ndarray) -> tuple[tuple[bool, ...], ...]:
    """The entries of the inverse that are not zero, exactly: its multiple by the determinant consists of minors.

    Raises:
        ValueError: the determinant is zero, or an entry of the inverse is no double.
    """
    m = [[Fraction(float(x)) for x in row] for row in matrix]
    # In cyclic order the minors have their signs.
    after = ((1, 2), (2, 0), (0, 1))
    adjugate = [[m[p][r] * m[q][s] - m[p][s] * m[q][r] for p, q in after] for r, s in after]
    determinant = sum(x * row[0] for x, row in zip(m[0], adjugate, strict=True))
    largest = Fraction(float(np.finfo(matrix.dtype).max))
    if any(abs(x) >= largest * abs(determinant) for row in adjugate for x in row):
        raise ValueError(f"matrix is singular: {matrix.tolist()}; needs an invertible one.")
    return tuple(tuple(x != 0 for x in row) for row in adjugate)


@partial(optimized, static=(5, 6))
def _image(
    coefficients: Array,
    lower: Array,
    upper: Array,
    matrix: Array,
    offset: Array,
    mixed: tuple[tuple[bool, ...], ...],
    degree: int,
) -> tuple[Array, Array, Array]:
    """Coefficients and box of the image under x -> matrix x + offset; `mixed` marks the inverse's nonzero entries."""
    offset = jnp.broadcast_to(offset, (3,))
    inverse = jnp.linalg.inv(matrix)
    origin = -jnp.sum(inverse * offset, axis=-1)
    ends = jnp.stack([matrix * lower, matrix * upper])
    image = _substituted(coefficients, degree, inverse, origin, mixed)
    return image, jnp.sum(ends.min(0), axis=-1) + offset, jnp.sum(ends.max(0), axis=-1) + offset


def _substituted(
    coefficients: Array, degree: int, matrix: Array, origin: Array, mixed: tuple[tuple[bool, ...], ...]
) -> Array:
    """Coefficients of w -> f(matrix w + origin), by Horner's rule whose numbers are polynomials in w.

    The result has room for the degree that each variable can reach.
    """
    old = np.array(coefficients.shape) - 1
    shape = tuple(int(n) + 1 for n in np.minimum(old @ np.array(mixed), degree))

    def times(polynomials: Array, variable: int) -> Array:
        result = origin[variable] * polynomials
        for axis in range(3):
            if mixed[variable][axis]:
                result = result + matrix[variable, axis] * _raised(polynomials, axis - 3)
        return result

    result = jnp.zeros((*coefficients.shape, *shape)).at[..., 0, 0, 0].set(coefficients)
    for variable in (2, 1, 0):
        rows = jnp.moveaxis(result, variable, 0)
        result = rows[-1]
        for row in rows[-2::-1]:
            result = times(result, variable) + row
    return result


def _raised(polynomials: Array, axis: int) -> Array:
    """The polynomials times the variable of the axis; the highest power, which must have zeros, is dropped."""
    inside = jax.lax.slice_in_dim(polynomials, 0, polynomials.shape[axis] - 1, axis=axis)
    padding = [(0, 0)] * polynomials.ndim
    padding[axis] = (1, 0)
    return jnp.pad(inside, padding)
