"""Bounds of cells of implicit surfaces against exact rational arithmetic, in all sizes and places."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jhd._distance.cells.signs import sign_bounds
from jhd._distance.cells.surfaces import FEET, upper_bounds
from jhd._distance.nearest.forms import boxes, form, lower_bounds
from jhd._distance.nearest.surface_points import local_feet, projected, proven_radius
from jhd._distance.nearest.surfaces import halved
from jhd._distance.normalization.surfaces import Side, prepare_surfaces
from jhd._shapes import ImplicitSurface
from tests.sweeps import swept

CELLS = 24
UPPER, LOWER, SIGN, FORM = (jax.jit(f) for f in (upper_bounds, lower_bounds, sign_bounds, form))
RADIUS, PROJECTED = jax.jit(proven_radius), jax.jit(lambda side, points, fixed: projected(side, points, fixed, 8))
FEET_OF = jax.jit(lambda side, points, starts: local_feet(side, points, starts, 3))


def random_side(rng, degree, error=0.0):
    """A random polynomial in the box [-1, 1]^3, with coefficients of many sizes."""
    a = rng.normal(size=(degree + 1,) * 3) * 2.0 ** rng.integers(-20, 1, (degree + 1,) * 3)
    a = a / np.abs(a).max() * 0.9
    corner = np.ones(3)
    return Side(a, np.full(a.shape, error), -corner, corner, np.zeros((3, 3, 3), bool))


def random_cells(rng, count, smallest=-45):
    center = rng.uniform(-0.9, 0.9, (3, count))
    half = 2.0 ** rng.uniform(smallest, -4, (1, count)) * rng.uniform(0.3, 1, (3, count))
    return boxes(jnp.asarray(center - half), jnp.asarray(center + half))


def exact_value(a, point):
    """The polynomial at a point of fractions."""
    total = Fraction(0)
    for index in np.argwhere(a != 0):
        term = Fraction(float(a[tuple(index)]))
        for x, power in zip(point, index, strict=True):
            term *= x ** int(power)
        total += term
    return total


def points_of(rng, cells, column):
    """Corners and inner points of a cell, as fractions."""
    low, high = ([Fraction(float(x)) for x in end[:, column]] for end in (cells.lower, cells.upper))
    shares = [rng.choice([0.0, 1.0, 0.5, rng.uniform()], 3) for _ in range(6)]
    return [[x + (y - x) * Fraction(float(s)) for x, y, s in zip(low, high, share, strict=True)] for share in shares]


@pytest.mark.parametrize("degree", swept([2, 4, 6], quick=[2], slow=[4]))
def test_forms_hold_every_exact_value(degree):
    rng = np.random.default_rng(degree)
    for _ in range(3):
        side = random_side(rng, degree)
        cells = random_cells(rng, CELLS)
        f = FORM(side, cells)
        least, most = np.asarray(f.terms.min(axis=0)), np.asarray(f.terms.max(axis=0))
        for i in range(CELLS):
            error = Fraction(float(f.error[i]))
            for point in points_of(rng, cells, i):
                value = exact_value(side.coefficients, point)
                assert Fraction(float(least[i])) - error <= value <= Fraction(float(most[i])) + error
        # Small cells are bounded to a few roundings: the error is no excuse for everything.
        assert np.max(f.error) < 1e-13 * (degree + 1) ** 3


def through_points(rng, side, cells):
    """The polynomial less its exact value at a point of each cell cannot be had for all; one cell at a time."""
    point = points_of(rng, cells, 0)[-1]
    constant = exact_value(side.coefficients, point)
    a = side.coefficients.copy()
    rounded = float(Fraction(float(a[0, 0, 0])) - constant)
    a[0, 0, 0] = rounded
    left = Fraction(rounded) - (Fraction(float(side.coefficients[0, 0, 0])) - constant)
    error = np.zeros_like(a)
    error[0, 0, 0] = 1.001 * abs(float(left)) + 1e-300
    return side._replace(coefficients=a, error=error), point


def squared(p, q):
    return sum((x - y) ** 2 for x, y in zip(p, q, strict=True))


@pytest.mark.parametrize("count", swept([12, 300], quick=[12]))
def test_bounds_hold_for_an_exact_point_of_the_surface(count):
    """A surface through a known rational point of the cell: no bound may exclude that point."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        cells = random_cells(rng, 1)
        side, point = through_points(rng, random_side(rng, 2), cells)
        f = FORM(side, cells)
        assert bool(f.may_vanish[0])
        reach = 10.0 ** rng.uniform(-12, 0)
        free = jnp.asarray(rng.uniform(size=(3, 1)) < 0.7)
        feet = np.asarray(cells.center)[None] + reach * rng.normal(size=(FEET, 3, 1))
        upper = Fraction(float(UPPER(f, cells, jnp.asarray(feet), jnp.zeros((FEET, 1)), free)[0]))
        least = min(squared(point, [Fraction(float(x)) for x in foot[:, 0]]) for foot in feet)
        assert least <= upper**2
        query = np.asarray(cells.center)[:, 0] + reach * rng.normal(size=3)
        lower = Fraction(float(LOWER(f, cells, jnp.asarray(query), free)[0]))
        assert lower**2 <= squared(point, [Fraction(float(x)) for x in query])


@pytest.mark.parametrize("count", swept([8, 200], quick=[8]))
def test_bounds_from_signs_hold_between_planes(count):
    """Planes a and b in a large box: the exact distance of every point of a from b is known."""
    rng, finite = np.random.default_rng(1), 0
    for _ in range(count):
        normal, offset = rng.normal(size=3), 2.0 ** rng.uniform(-40, -4)
        tilt = rng.choice([0.0, 1e-3])
        planes = []
        for n, d in ((normal, 0.0), (normal + tilt * rng.normal(size=3), offset)):
            a = np.zeros((3, 3, 3))
            a[1, 0, 0], a[0, 1, 0], a[0, 0, 1], a[0, 0, 0] = *n, -d
            planes.append(random_side(rng, 2)._replace(coefficients=a / 8, error=np.zeros_like(a)))
        half = 2.0 ** rng.uniform(-30, -5)
        corner = rng.uniform(-0.2, 0.2, 3)
        corner -= normal * (normal @ corner) / (normal @ normal)
        cells = boxes(jnp.asarray(corner - half)[:, None], jnp.asarray(corner + half)[:, None])
        place = jnp.asarray(corner)[:, None]
        foot = FEET_OF(planes[1], place, place)
        free = jnp.ones((3, 1), bool)
        found = float(SIGN(FORM(planes[0], cells), planes[1], cells, free, place, foot, jnp.array(0.0))[0])
        # The corner of the cell moved onto a, in exact arithmetic.
        n, m = ([Fraction(float(p.coefficients[tuple(e)])) for e in np.eye(3, dtype=int)] for p in planes)
        constant = Fraction(float(planes[1].coefficients[0, 0, 0]))
        for corner_of in points_of(rng, cells, 0):
            off = sum(x * y for x, y in zip(n, corner_of, strict=True)) / sum(x * x for x in n)
            p = [x - off * y for x, y in zip(corner_of, n, strict=True)]
            low, high = ([Fraction(float(x)) for x in end[:, 0]] for end in (cells.lower, cells.upper))
            if all(x <= y <= z for x, y, z in zip(low, p, high, strict=True)):
                value = sum(x * y for x, y in zip(m, p, strict=True)) + constant
                assert value**2 / sum(x * x for x in m) <= Fraction(found) ** 2 if np.isfinite(found) else True
        finite += np.isfinite(found) and found < 1.1 * offset + 4 * half * (tilt + 1e-12) + 1e-13
    assert finite > count / 2


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_polynomial_of_one_sign_has_no_bound_from_signs(sign):
    # The plane z = 0, and (z - 1/4)^2 + 1/256 below zero, or (z + 1/4)^2 + 1/256 above it: both rise at the foot.
    plane, other = (np.zeros((3, 3, 3)) for _ in range(2))
    plane[0, 0, 1], other[0, 0] = 0.5, sign * np.array([0.0625 + 2.0**-8, 0.5 * sign, 1.0]) / 2
    a, b = (random_side(np.random.default_rng(0), 2)._replace(coefficients=x, error=0 * x) for x in (plane, other))
    half = jnp.full((3, 1), 2.0**-6)
    cells, place, foot = boxes(-half, half), jnp.zeros((3, 1)), jnp.array([[0.0], [0.0], [0.2]])
    assert np.isinf(SIGN(FORM(a, cells), b, cells, jnp.ones((3, 1), bool), place, foot, jnp.array(0.0))[0])


def test_bounds_of_a_small_cell_leave_a_slack_of_second_order():
    """The outer of two concentric spheres from the inner: with one foot, the slack is of the order of h^2."""
    outer = ImplicitSurface.parse("x^2 + y^2 + z^2 - 0.25", [-0.75] * 3, [0.75] * 3)
    inner = ImplicitSurface.parse("x^2 + y^2 + z^2 - 0.0625", [-0.75] * 3, [0.75] * 3)
    a, b, _ = prepare_surfaces(outer, inner)
    p, q = np.array([0.3, 0.4, 0.0]), np.array([0.15, 0.2, 0.0])
    slacks = []
    for half in (1e-2, 1e-3, 1e-4):
        cells = boxes(jnp.asarray(p - half)[:, None], jnp.asarray(p + half)[:, None])
        f, free = FORM(a, cells), jnp.ones((3, 1), bool)
        feet = jnp.asarray(np.broadcast_to(q[:, None], (FEET, 3, 1)))
        slacks.append(float(UPPER(f, cells, feet, jnp.zeros((FEET, 1)), free)[0]) - 0.25)
    assert 0 < slacks[0] < 10 * 1e-4 and slacks[1] < slacks[0] / 50 and slacks[2] < slacks[1] / 50


def test_a_point_is_proven_only_where_the_exact_polynomial_changes_its_sign():
    rng, proven = np.random.default_rng(2), 0
    for _ in range(4):
        side = random_side(rng, 2)
        starts = jnp.asarray(rng.uniform(-1, 1, (3, 32)))
        points = PROJECTED(side, starts, jnp.zeros((3, 32), bool))
        radius = np.asarray(RADIUS(side, points))
        for point, r in zip(np.asarray(points).T, radius, strict=True):
            if np.isfinite(r):
                # Along the steepest axis the exact values at the distance r have two signs, or there are none to see.
                proven += 1
                assert np.all(np.abs(point) <= 1) and 0 <= r
                at = [Fraction(float(x)) for x in point]
                slope = max(
                    abs(
                        exact_value(side.coefficients, [x + Fraction(r) * (i == k) for i, x in enumerate(at)])
                        - exact_value(side.coefficients, [x - Fraction(r) * (i == k) for i, x in enumerate(at)])
                    )
                    for k in range(3)
                )
                assert abs(exact_value(side.coefficients, at)) <= 2 * slope
    assert proven > 40
    nowhere = random_side(rng, 2)._replace(coefficients=np.zeros((3, 3, 3)))
    nowhere.coefficients[0, 0, 0] = 1e-14
    nowhere.coefficients[2, 0, 0] = nowhere.coefficients[0, 2, 0] = nowhere.coefficients[0, 0, 2] = 0.5
    assert np.all(np.isinf(RADIUS(nowhere, jnp.asarray(1e-6 * rng.normal(size=(3, 32))))))


def test_a_surface_in_a_face_of_its_box_is_proven_there():
    plane = ImplicitSurface.parse("z - 1", [0, 0, 0], [1, 1, 1])
    side, _, _ = prepare_surfaces(plane, plane)
    points = jnp.asarray(np.array([[0.25, 0.3], [0.5, 0.1], [side.upper[2], 0.2]]))
    assert RADIUS(side, points).tolist() == [0.0, np.inf]


def test_parts_of_cells_cover_them_without_gaps():
    rng = np.random.default_rng(3)
    low = rng.normal(size=(3, 5))
    high = low + 10.0 ** rng.uniform(-16, 0, (3, 5))
    parts = [np.asarray(x).reshape(3, 8, 5) for x in halved(jnp.asarray(low), jnp.asarray(high))]
    assert np.array_equal(parts[0].min(axis=1), low) and np.array_equal(parts[1].max(axis=1), high)
    middle = np.asarray(parts[1][:, 0])
    for corner, (x, y) in enumerate(zip(parts[0].transpose(1, 0, 2), parts[1].transpose(1, 0, 2), strict=True)):
        for axis in range(3):
            upper_half = corner >> (2 - axis) & 1
            assert np.array_equal((x if upper_half else y)[axis], middle[axis])


def test_common_coordinates_are_the_exact_ones_with_their_errors():
    """The coefficients written about another place are within their errors of the exact ones, traced or not."""
    rng = np.random.default_rng(4)
    for size, shift in ((1.0, 0.0), (2.0**60, 0.0), (2.0**-70, 0.0), (1.0, 1e3), (1.0, 1e6)):
        given = rng.normal(size=(3, 2, 3))
        low = shift + np.array([-1.0, -0.5, 0.25]) * size
        surface = ImplicitSurface(given, low, low + size)
        for run in (prepare_surfaces, jax.jit(prepare_surfaces)):
            side, _, frame = run(surface, surface)
            unit = Fraction(2) ** int(frame.first + frame.second)
            origin = [Fraction(float(x)) * Fraction(2) ** int(frame.first) for x in frame.center]
            corners = [np.asarray(x) for x in (side.lower, side.upper)]
            for corner, exact in zip(corners, surface.bounds, strict=True):
                for x, o, y in zip(corner, origin, np.asarray(exact), strict=True):
                    assert Fraction(float(x)) * unit + o == Fraction(float(y))
                assert np.max(np.abs(corner)) <= 1
            # Both polynomials at rational places, the factor between them taken from the largest coefficient.
            a, e = np.asarray(side.coefficients), np.asarray(side.error)
            exact = shifted(given, origin, unit)
            ratios = [exact[k] / Fraction(float(a[k])) for k in np.ndindex(given.shape) if abs(a[k]) > 0.4]
            factor = min(ratios, key=lambda x: abs(float(x)))
            for k in np.ndindex(given.shape):
                slack = Fraction(float(e[k])) + 2 * Fraction(float(np.max(e))) * abs(Fraction(float(a[k])))
                assert abs(exact[k] / factor - Fraction(float(a[k]))) <= 4 * slack + Fraction(1, 2**900)


def shifted(a, origin, unit):
    """Exact coefficients of w -> f(origin + unit w)."""
    current = {k: Fraction(float(a[k])) for k in np.ndindex(a.shape)}
    for axis in range(3):
        n = a.shape[axis]
        for first in range(n - 1):
            for i in range(n - 2, first - 1, -1):
                for k in list(current):
                    if k[axis] == i:
                        current[k] += origin[axis] * current[(*k[:axis], i + 1, *k[axis + 1 :])]
        current = {k: x * unit ** k[axis] for k, x in current.items()}
    return current
