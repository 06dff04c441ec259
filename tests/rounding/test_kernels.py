"""The constants of kernels of surfaces are at least the errors that are derived from their steps."""

import math

import numpy as np
import pytest

from jhd._arithmetic.rounding import gamma
from jhd._distance.nearest import curves as nearest
from jhd._distance.normalization import curves as preparation
from jhd._distance.normalization import net_jets
from tests.rounding import curve_kernels, shape_kernels
from tests.rounding.interpreter import evaluate
from tests.rounding.margins import format_of, margin

DTYPE = np.float32


def derived(function, inputs):
    """Numbers with their errors, from inputs that are exact."""
    return evaluate(function, format_of(DTYPE), inputs, [None] * len(inputs))


def quick_or_slow(names):
    return [pytest.param(name, marks=[pytest.mark.slow] * (name in shape_kernels.SLOW)) for name in names]


@pytest.mark.parametrize("name", quick_or_slow(shape_kernels.BOUNDS))
def test_bounds_have_room_for_the_derived_error(name):
    function, inputs, modules, sign = shape_kernels.BOUNDS[name]
    left, error = margin(function, inputs, modules, sign)
    assert np.all(left >= error) and np.any(error > 0)


@pytest.mark.parametrize("name", shape_kernels.TOLD)
def test_errors_that_are_told_are_at_least_the_derived_ones(name):
    values, bound = derived(*shape_kernels.TOLD[name])
    assert np.all(bound.low - bound.error >= values.error) and np.any(values.error > 0)


@pytest.mark.parametrize("rational", (False, True))
@pytest.mark.parametrize("degrees", ((3, 0), (2, 2), (4, 3)))
def test_points_of_nets_and_of_their_parts_are_as_close_as_told(degrees, rational):
    function, inputs, net = shape_kernels.net_points(True, degrees, rational)
    assert np.max(derived(function, inputs).error) <= net_jets.eta(net)
    function, inputs, net = shape_kernels.net_points(False, degrees, rational)
    assert np.max(_length(derived(function, inputs).error)) <= net_jets.point_error(net)


@pytest.mark.parametrize("degrees, dim, rational", (((3, 3), 2, False), ((2, 2), 3, True)))
def test_curves_are_moved_by_at_most_what_is_told(degrees, dim, rational, monkeypatch):
    # A power of two, which changes no digit.
    monkeypatch.setattr(preparation, "unit_weights", lambda weights: weights)
    pairs, degree = curve_kernels.Pairs(degrees, dim, rational), preparation.raised_degree(degrees[0])
    told, evaluation = (
        preparation.preparation_error(degrees[0], dim, DTYPE),
        math.sqrt(dim) * gamma(6 * degree + 6, DTYPE),
    )
    points, point = (
        derived(of(degree), pairs.inputs) for of in (curve_kernels.prepared_points, curve_kernels.prepared_point)
    )
    # The coordinates are up to two here.
    assert np.max(_length(points.error)) <= 2 * told
    assert np.max(_length(point.error)) <= 2 * (told + evaluation)


@pytest.mark.parametrize("degrees, dim, rational", (((3, 3), 2, False), ((2, 5), 3, True)))
def test_distances_of_points_have_room_for_the_derived_error(degrees, dim, rational):
    pairs = curve_kernels.Pairs(degrees, dim, rational)
    vector = derived(curve_kernels.on_all(curve_kernels.foot), pairs.inputs)
    # The bound is one of the vector as computed: its length differs by the error of the vector at most.
    left, error = margin(curve_kernels.on_all(curve_kernels.length), pairs.inputs, (nearest,), 1)
    assert np.all(left >= error + 0.5 * np.max(_length(vector.error)))


def _length(vectors):
    return np.sqrt(np.sum(vectors**2, axis=-1))
