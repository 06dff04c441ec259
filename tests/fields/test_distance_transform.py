"""Distance transforms against SciPy's, against all pairs, and where the published templates fail."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

import jhd
from jhd._fields.distance_transform import _room
from tests.sweeps import swept


def reference(features, spacing: Any = 1.0) -> np.ndarray:
    return np.asarray(distance_transform_edt(~features, sampling=spacing))


def random_grid(rng, largest=40):
    """A grid of one to three axes and random sides, with few or many features, and the spacing."""
    axes = int(rng.integers(1, 4))
    features = rng.random(rng.integers(1, largest, axes)) < rng.choice([0.002, 0.02, 0.3])
    features[tuple(rng.integers(0, n) for n in features.shape)] = True
    spacing = rng.choice([rng.uniform(0.1, 3.0, axes), np.full(axes, rng.uniform(0.1, 3.0)), np.ones(axes)])
    return features, spacing


def check_against_scipy(features, spacing):
    transform = jhd.distance_transform(features, spacing)
    expected = reference(features, spacing)
    np.testing.assert_allclose(transform.distance, expected, rtol=1e-14, atol=0)
    check_attained(features, spacing, transform)


def check_attained(features, spacing, transform):
    """Every index is that of a feature, at the distance that is returned."""
    nearest = np.asarray(transform.nearest)
    assert nearest.shape == (*features.shape, features.ndim)
    assert features[tuple(np.moveaxis(nearest, -1, 0))].all()
    steps = (nearest - np.moveaxis(np.indices(features.shape), 0, -1)) * spacing
    np.testing.assert_allclose(transform.distance, np.sqrt((steps**2).sum(-1)), rtol=1e-14)


@pytest.mark.parametrize("seed", swept(range(6), 1, 1))
def test_distances_are_those_of_scipy_and_every_index_attains_its_distance(seed):
    rng = np.random.default_rng(seed)
    check_against_scipy(*random_grid(rng, largest=16))


@pytest.mark.parametrize("seed", swept(range(40), 0, 2))
def test_distances_are_those_of_scipy_on_larger_grids(seed):
    check_against_scipy(*random_grid(np.random.default_rng(1000 + seed)))


@pytest.mark.parametrize(
    "shape", swept([(x,) for x in ((1, 2000, 3), (2500,), (129, 65, 33), (700, 2, 40), (1, 1, 1))], 0, 3)
)
def test_long_grids_need_more_bits(shape):
    rng = np.random.default_rng(7)
    features = rng.random(shape) < 0.001
    features.flat[-1] = True
    check_against_scipy(features, np.full(len(shape), 0.5))


def test_one_feature_far_away_is_found_by_every_voxel():
    features = np.zeros((5, 11, 16), bool)
    features[4, 10, 15] = True
    transform = jhd.distance_transform(features)
    assert np.asarray(transform.distance)[0, 0, 0] == np.sqrt(16 + 100 + 225)
    assert (np.asarray(transform.nearest) == [4, 10, 15]).all()
    # Every row has a feature in its plane, and a nearer one many rows away.
    features = np.zeros((2, 60, 101), bool)
    features[:, :, 0] = features[:, 0, 100] = True
    for volume in (features, np.swapaxes(features, 1, 2)):
        check_against_scipy(volume, np.ones(3))


def test_sides_whose_squares_are_no_floats_order_features_as_their_ratios_do():
    features = np.zeros((5, 2), bool)
    features[[0, 4], [0, 1]] = True
    expected = reference(features, [1.0, 3.0])
    for size in (2.0**-530, 2.0**-1000, 2.0**600, 2.0**1000):
        for transform in (jhd.distance_transform, jax.jit(jhd.distance_transform)):
            found = transform(features, np.array([1.0, 3.0]) * size).distance
            np.testing.assert_array_equal(np.asarray(found) / size, expected)
        signed = jhd.signed_distance_transform(features, np.array([1.0, 3.0]) * size)
        assert float(signed[0, 0]) / size == -1
    with pytest.raises(ValueError, match="their squares vanish"):
        jhd.distance_transform(features, [1.0, 1e-160])


@pytest.mark.parametrize("method", ["exact", "vector_propagation"])
@pytest.mark.parametrize("spacing", [1.0, [0.5, 2.0, 1.0]])
def test_without_features_distances_are_infinite(method, spacing):
    transform = jhd.distance_transform(np.zeros((3, 4, 5), bool), spacing, method=method)
    assert np.isposinf(transform.distance).all() and (np.asarray(transform.nearest) == -1).all()


def test_the_signed_transform_is_the_difference_of_two():
    rng = np.random.default_rng(3)
    inside = rng.random((13, 9, 11)) < 0.5
    spacing = [1.0, 0.3, 2.0]
    expected = reference(inside, spacing) - reference(~inside, spacing)
    signed = np.asarray(jhd.signed_distance_transform(inside, spacing))
    np.testing.assert_allclose(signed, expected, rtol=1e-14)
    assert ((signed < 0) == inside).all()


def test_the_signed_transform_of_one_class_alone_is_infinite():
    assert np.isposinf(jhd.signed_distance_transform(np.zeros((4, 4), bool))).all()
    assert np.isneginf(jhd.signed_distance_transform(np.ones((4, 4), bool))).all()


@pytest.mark.parametrize("unit", [1e-200, 1e200])
def test_sides_near_the_ends_of_the_range(unit):
    features = np.array([[True, False, False], [False, False, False]])
    transform = jhd.distance_transform(features, np.array([3.0, 2.0]) * unit)
    np.testing.assert_allclose(np.asarray(transform.distance) / unit, [[0, 2, 4], [3, 13**0.5, 5]], rtol=1e-14)


def test_sides_below_the_normal_numbers_are_no_zeros():
    unit = 2.0**-1070
    features = np.array([[True, False, False], [False, False, False]])
    found = jhd.distance_transform(features, np.array([4.0, 3.0]) * unit).distance
    assert (np.asarray(found) / unit).tolist() == [[0, 3, 6], [4, 5, 7.1875]]
    assert (np.asarray(jhd.signed_distance_transform(features[0], unit)) / unit).tolist() == [-1, 1, 2]


def test_the_published_templates_find_small_and_convex_cases_exactly():
    rng = np.random.default_rng(5)
    features = rng.random((12, 10, 9)) < 0.02
    spacing = np.array([1.0, 1.5, 0.7])
    transform = jhd.distance_transform(features, spacing, method="vector_propagation")
    check_attained(features, spacing, transform)
    exact = reference(features, spacing)
    assert (np.asarray(transform.distance) >= exact * (1 - 1e-14)).all()
    assert np.mean(np.asarray(transform.distance) > exact * (1 + 1e-12)) < 1e-2


def shell(n):
    """Voxels about a sphere whose center is no voxel."""
    places = np.indices((n, n, n)) - (n / 2 - 0.3)
    return np.abs(np.sqrt((places**2).sum(0)) - n / 3) < 0.6


@pytest.mark.slow
def test_the_published_templates_err_on_few_voxels_by_little():
    features = shell(128)
    transform = jhd.distance_transform(features, method="vector_propagation")
    error = np.asarray(transform.distance) - reference(features)
    wrong = error > 1e-9
    assert error.min() > -1e-12
    # It is inexact; its error is known.
    assert 0 < wrong.mean() < 1e-3 and error.max() < 0.09


def test_batches_and_programs_give_the_same():
    rng = np.random.default_rng(2)
    features = rng.random((3, 7, 9)) < 0.1
    features[:, 0, 0] = True
    alone = [jhd.distance_transform(x, 0.5).distance for x in features]
    together = jax.jit(jax.vmap(lambda x: jhd.distance_transform(x, 0.5).distance))(features)
    np.testing.assert_array_equal(together, jnp.stack(alone))


def test_distances_are_differentiable_in_the_spacing():
    features = np.zeros((3, 4), bool)
    features[0, 0] = True

    def total(spacing):
        return jhd.distance_transform(features, spacing).distance[2, 3]

    np.testing.assert_allclose(jax.grad(total)(jnp.array([1.0, 2.0])), np.array([4.0, 18.0]) / np.sqrt(40), rtol=1e-14)
    # The voxel of a feature has the distance zero whatever the spacing.
    slope = jax.grad(lambda x: jhd.distance_transform(features, x).distance[0, 0])(jnp.array([1.0, 2.0]))
    np.testing.assert_array_equal(slope, [0.0, 0.0])


def test_grids_are_padded_to_few_shapes():
    shapes = [(1, 2, 3), (1, 1, 1), (40, 9, 33), (64, 1, 2), (65, 9, 128), (1, 129, 1)]
    rooms = [(1, 8, 8), (1, 1, 1), (64, 64, 64), (64, 1, 64), (80, 16, 128), (1, 160, 1)]
    assert [_room(x) for x in shapes] == rooms


@pytest.mark.parametrize(
    ("features", "options", "error", "message"),
    [
        (np.zeros((2, 2)), {}, TypeError, "features must be booleans; its dtype is float64."),
        (np.zeros((2, 2, 2, 2), bool), {}, ValueError, "features has 4 axes; needs one to three."),
        (np.zeros((), bool), {}, ValueError, "features has 0 axes; needs one to three."),
        (np.zeros((2, 0), bool), {}, ValueError, r"features has shape \(2, 0\); needs at least one voxel."),
        (np.zeros(2, bool), {"spacing": [1.0, 1.0]}, ValueError, r"spacing has shape \(2,\); needs one number or"),
        (np.zeros((2, 2), bool), {"spacing": [1.0, 0.0]}, ValueError, r"spacing\[1\] is 0; needs a positive number."),
        (np.zeros(2, bool), {"spacing": -1.0}, ValueError, "spacing is -1; needs a positive number."),
        (np.zeros(2, bool), {"spacing": np.nan}, ValueError, "spacing is not finite"),
        (np.zeros(2, bool), {"method": "fast"}, ValueError, "method is 'fast'; needs one of 'exact', 'vector"),
    ],
)
def test_what_makes_no_sense_is_refused(features, options, error, message):
    with pytest.raises(error, match=message):
        jhd.distance_transform(features, **options)
