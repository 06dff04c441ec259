"""A new kind of shape that consists of Bezier segments or patches is one class; every entry serves it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typing_extensions import override

import jhd
from jhd._shapes.curve import AbstractCurve
from jhd._shapes.patch import AbstractPatch, BezierPatches


class CircularArc(AbstractCurve):
    """The arc about the origin from angle zero to an angle below pi."""

    radius: jax.Array
    angle: float

    def __init__(self, radius, angle):
        self.radius, self.angle = jnp.asarray(radius), angle

    @property
    def control_points(self):
        half = 0.5 * self.angle
        middle = jnp.array([1.0, jnp.tan(half)])
        return self.radius * jnp.array([[1.0, 0.0], middle, [jnp.cos(self.angle), jnp.sin(self.angle)]])

    @property
    def weights(self):
        return jnp.array([1.0, jnp.cos(0.5 * self.angle), 1.0])

    @property
    def _curve(self):
        return jhd.BezierCurve(self.control_points, self.weights)

    @override
    def __call__(self, t):
        return self._curve(t)

    @override
    def segments(self):
        return self._curve.segments()

    @override
    def derivative(self):
        return self._curve.derivative()

    @override
    def split(self, t):
        return self._curve.split(t)

    @override
    def reverse(self):
        return self._curve.reverse()

    @override
    def elevate(self, degree):
        return self._curve.elevate(degree)

    @override
    def transform(self, matrix, offset=0.0):
        return self._curve.transform(matrix, offset)

    @override
    def _summary(self):
        return f"angle {self.angle}"


class RuledSurface(AbstractPatch):
    """Segments between the points of two curves at the same parameter."""

    first: jhd.BezierCurve
    second: jhd.BezierCurve

    def __init__(self, first, second):
        self.first, self.second = first, second

    @property
    def control_points(self):
        return jnp.stack([self.first.control_points, self.second.control_points], axis=1)

    @property
    def weights(self):
        return None

    @property
    @override
    def degrees(self):
        return self.control_points.shape[0] - 1, 1

    @override
    def _value(self, u, v):
        return (1 - v) * self.first(u) + v * self.second(u)

    @override
    def patches(self) -> BezierPatches:
        return jhd.BezierPatch(self.control_points).patches()

    @override
    def transform(self, matrix, offset=0.0):
        return RuledSurface(self.first.transform(matrix, offset), self.second.transform(matrix, offset))


def wall(height):
    """A parabola in the plane z = 0, moved up to a height."""
    points = jnp.array([[0.0, 0, 0], [1, 1, 0], [2, 0, 0]])
    return RuledSurface(jhd.BezierCurve(points), jhd.BezierCurve(points.at[:, 2].add(height)))


# Its nearest point is (1, 1/2, height), where the surface ends.
POINT = jhd.point_set([(1.0, 0.5, 3.0)])


def test_distances_and_projections():
    assert float(jhd.directed_hausdorff(POINT, wall(1.0))) == pytest.approx(2.0, abs=1e-12)
    found = jhd.project([(1.0, 2.0, 0.25)], wall(1.0).transform(np.eye(3), [0.0, 0.0, -0.25]))
    np.testing.assert_allclose(found.foot, [(1.0, 0.5, 0.25)], atol=1e-12)
    assert "RuledSurface(degrees 2 x 1" in repr(wall(1.0))
    np.testing.assert_array_equal(wall(1.0)(0.5, 0.5), [1.0, 0.5, 0.5])


@pytest.mark.slow
def test_a_new_kind_of_curve():
    center = jhd.point_set([(0.0, 0.0)])
    known = CircularArc(2.0, 1.5)
    for function in (lambda arc: jhd.directed_hausdorff(center, arc), lambda arc: jhd.directed_hausdorff(arc, center)):
        found = function(known)
        assert found.lower <= 2.0 <= found.upper
    # Passed in, closed over, and built inside.
    assert float(jax.jit(function)(known).value) == pytest.approx(2.0, abs=1e-12)
    assert float(jax.jit(lambda shift: function(known.transform(np.eye(2), shift)).value)(0.0)) == (
        pytest.approx(2.0, abs=1e-12)
    )
    slope = jax.grad(lambda r: function(CircularArc(r, 1.5)).value)(2.0)
    assert float(slope) == pytest.approx(1.0, abs=1e-9)
    assert jhd.arc_length(known).lower <= 3.0 <= jhd.arc_length(known).upper
    assert repr(known).startswith("CircularArc(angle 1.5")


@pytest.mark.slow
def test_what_searches_over_it_and_what_proves_it():
    low, high = wall(1.0), wall(1.5)
    slope = jax.grad(lambda h: jhd.directed_hausdorff(POINT, wall(h)).value)(1.0)
    assert float(slope) == pytest.approx(-1.0, abs=1e-12)
    found = jhd.hausdorff(low, high)
    assert found.lower <= 0.5 <= found.upper
    jhd.verify(jhd.certify(low, high, found))
    nearest = jhd.minimum_distance(POINT, low)
    assert nearest.lower <= 2.0 <= nearest.upper
    area = jhd.surface_area(low)
    # The arc length of the parabola.
    assert area.lower <= np.sqrt(2) + np.log(1 + np.sqrt(2)) <= area.upper
    largest = jhd.deviation(high, low).maximum
    assert largest.lower <= 0.5 <= largest.upper
    for traced in (
        jax.jit(lambda a: jhd.hausdorff(a, high))(low),
        jax.jit(lambda z: jhd.hausdorff(wall(z), high))(1.0),
    ):
        assert traced.lower <= 0.5 <= traced.upper
    jhd.plot.solution(low, high, found)
