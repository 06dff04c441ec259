import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline, make_interp_spline, splprep

import jhd
from jhd import BSplineCurve
from jhd._results.solution import name_of
from tests.sweeps import swept

# A few roundings of numbers of size one, along chains of up to seven convex combinations.
ROUNDING = 1e-14
# The same for derivatives, which are larger by the degree over the width of a span: relative to their largest entry.
DERIVATIVE = 1e-13
# Central differences with step 1e-6 of functions whose third derivatives reach a few hundred.
DIFFERENCES = 1e-6

POINTS = np.random.default_rng(1).normal(size=(7, 2))
WEIGHTS = np.random.default_rng(2).uniform(0.5, 2.0, size=7)
# A cubic with a double and an unclamped end, and one whose curve jumps at 0.4 (multiplicity 4).
DOUBLE = np.array([-0.3, -0.2, 0.0, 0.0, 0.3, 0.3, 0.7, 1.0, 1.0, 1.1, 1.5])
JUMP = np.array([0.0, 0.0, 0.0, 0.0, 0.4, 0.4, 0.4, 0.4, 1.0, 1.0, 1.0, 1.0])
# Knots of a closed cubic with seven points, period 3, a triple knot inside and a double one at the seam.
CLOSED = np.array([0.0, 0.2, 0.5, 1.0, 1.0, 1.0, 2.4])
CLOSED = np.concatenate([CLOSED, CLOSED[:4] + 3.0])
HALF = np.sqrt(0.5)
SQUARE = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]


def random_spline(degree, seed=0):
    """A clamped or unclamped spline with a repeated inner knot; spans are at least 0.1 wide."""
    rng = np.random.default_rng([degree, seed])
    inner = np.cumsum(rng.uniform(0.1, 0.4, size=3))
    inner = np.repeat(inner, [1, min(degree, 2), 1])
    outer = rng.uniform(0.1, 0.4, size=degree + 1) * (degree % 2)
    knots = np.concatenate([-np.cumsum(outer)[::-1], inner, inner[-1] + 0.3 + np.cumsum(outer)])
    return knots, rng.normal(size=(len(knots) - degree - 1, 2 + degree % 2))


def domain_samples(curve, count=23):
    lower, upper = map(float, curve.domain)
    return np.linspace(lower, upper, count)[:-1]


@pytest.mark.parametrize("degree", swept([3, 6, 1, 7, 2, 4, 5], 2, 2))
def test_values_derivatives_and_segments_agree_with_scipy(degree):
    knots, points = random_spline(degree)
    reference, curve = BSpline(knots, points, degree), BSplineCurve(points, knots)
    assert (curve.degree, curve.dim) == (degree, points.shape[1])
    t = np.linspace(knots[0], knots[-1], 31)
    np.testing.assert_allclose(curve(t), reference(t), atol=ROUNDING * np.abs(reference(t)).max())
    inside = domain_samples(curve)
    expected = reference(inside, nu=1)
    np.testing.assert_allclose(curve.derivative()(inside), expected, atol=DERIVATIVE * np.abs(expected).max())
    segments = curve.segments()
    assert segments.count == len(points) - degree
    lower, upper = knots[degree:-degree][:-1], knots[degree:-degree][1:]
    for u in (0.0, 0.25, 0.5):
        values = segments.point(np.arange(segments.count), u)
        expected = reference(lower + u * (upper - lower))
        # At the end of the domain scipy evaluates from the left as well.
        np.testing.assert_allclose(values, expected, atol=ROUNDING)
    assert segments.next_segment.tolist() == [*range(1, segments.count), -1]


def test_a_spline_of_degree_zero_is_its_points():
    steps = BSplineCurve(POINTS[:3], [0, 1, 1, 3])
    np.testing.assert_array_equal(steps([0.5, 1.0, 2.0]), POINTS[[0, 2, 2]])
    np.testing.assert_array_equal(steps.derivative()(0.5), [0, 0])
    assert steps.segments().next_segment.tolist() == [-1, -1, -1]
    before, after = steps.split(2.0)
    np.testing.assert_array_equal(before.control_points, POINTS[:3])
    np.testing.assert_array_equal(after.control_points, POINTS[2:3])


def test_parameters_keep_their_shape():
    curve = BSplineCurve.clamped(POINTS)
    assert curve(0.5).shape == (2,)
    assert curve(np.full((2, 3), 0.5)).shape == (2, 3, 2)


def test_clamped_splines_start_and_end_at_points():
    curve = BSplineCurve.clamped(POINTS, degree=2)
    assert [float(end) for end in curve.domain] == [0, 5]
    np.testing.assert_array_equal(curve([0.0, 5.0]), POINTS[[0, -1]])
    assert BSplineCurve.clamped(POINTS, degree=0).knots.tolist() == list(range(8))


def test_uniform_open_splines_have_integer_knots():
    curve = BSplineCurve.uniform(POINTS)
    assert curve.knots.tolist() == list(range(11))
    reference = BSpline(np.arange(11), POINTS, 3)
    np.testing.assert_allclose(curve(np.linspace(3, 7, 9)), reference(np.linspace(3, 7, 9)), atol=ROUNDING)


@pytest.mark.parametrize("degree", swept([4, 1], 1, 1))
def test_uniform_closed_splines_agree_with_scipy_on_wrapped_points(degree):
    curve = BSplineCurve.uniform(POINTS, degree, periodic=True)
    assert (curve.control_points.shape, curve.knots.shape) == ((7, 2), (8 + degree,))
    reference = BSpline(np.arange(8.0 + 2 * degree), np.vstack([POINTS, POINTS[:degree]]), degree)
    t = np.linspace(degree, degree + 7, 29)
    np.testing.assert_allclose(curve(t), reference(t), atol=ROUNDING)
    np.testing.assert_allclose(curve(t + 14), reference(t), atol=10 * ROUNDING)
    np.testing.assert_allclose(curve(t - 7), reference(t), atol=10 * ROUNDING)
    np.testing.assert_allclose(curve.derivative()(t[:-1]), reference(t[:-1], nu=1), atol=10 * ROUNDING)
    segments = curve.segments()
    assert segments.next_segment.tolist() == [1, 2, 3, 4, 5, 6, 0]
    starts = np.roll(segments.control_points[:, 0], -1, axis=0)
    np.testing.assert_allclose(segments.control_points[:, -1], starts, atol=ROUNDING)


@pytest.mark.parametrize("weights", swept([WEIGHTS, None], 1, 1))
def test_closed_splines_with_repeated_knots_agree_with_scipy(weights):
    curve = BSplineCurve(POINTS, CLOSED, weights, periodic=True)
    ones = np.ones(7) if weights is None else weights
    lifted = np.column_stack([POINTS * ones[:, None], ones])
    knots = np.concatenate([CLOSED, CLOSED[4:7] + 3])
    values = BSpline(knots, np.vstack([lifted, lifted[:3]]), 3)(np.linspace(1, 4, 31))
    np.testing.assert_allclose(curve(np.linspace(1, 4, 31)), values[:, :2] / values[:, 2:], atol=ROUNDING)
    assert curve.segments().next_segment.tolist() == [1, 2, 3, 4, 5, 6, 0]


def test_the_circle_of_nine_points_is_round():
    knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
    circle = BSplineCurve(SQUARE, knots, [1, HALF] * 4 + [1])
    t = np.linspace(0, 4, 41)
    np.testing.assert_allclose(np.hypot(*np.asarray(circle(t)).T), 1.0, atol=ROUNDING)
    tangents = np.asarray(circle.derivative()(t))
    assert circle.derivative().degree == 4
    np.testing.assert_allclose(np.sum(tangents * np.asarray(circle(t)), axis=1), 0.0, atol=DERIVATIVE)
    segments = circle.segments()
    assert segments.count == 7
    assert segments.next_segment.tolist() == [1, 2, 3, 4, 5, 6, 0]
    np.testing.assert_allclose(np.asarray(segments.weights)[::2], np.tile([1, HALF, 1], (4, 1)), atol=ROUNDING)
    np.testing.assert_allclose(segments.control_points[1], np.tile([0, 1], (3, 1)), atol=ROUNDING)


@pytest.mark.parametrize("periodic", swept([True, False], 1, 1))
def test_derivatives_of_rational_splines_agree_with_differences(periodic):
    curve = BSplineCurve(POINTS, CLOSED if periodic else DOUBLE, WEIGHTS, periodic)
    derivative = curve.derivative()
    assert (derivative.degree, derivative.periodic) == (6, periodic)
    t = domain_samples(curve) + 0.01
    differences = (curve(t + 1e-6) - curve(t - 1e-6)) / 2e-6
    np.testing.assert_allclose(derivative(t), differences, atol=DIFFERENCES)


# Knots of high multiplicity


def test_empty_spans_are_points_of_the_curve():
    curve = BSplineCurve(POINTS, DOUBLE)
    segments = curve.segments()
    assert segments.next_segment.tolist() == [1, 2, 3, -1]
    np.testing.assert_allclose(segments.control_points[1], np.tile(curve(0.3), (4, 1)), atol=ROUNDING)
    starts = BSplineCurve(POINTS[:5], [0, 0, 0, 0, 0, 1, 1, 1, 1]).segments()
    np.testing.assert_array_equal(starts.control_points[0], np.tile(POINTS[1], (4, 1)))


def test_a_jump_is_a_free_end_and_a_kink_is_none():
    points = np.vstack([POINTS, [[3, 3]]])
    curve = BSplineCurve(points, JUMP)
    segments = curve.segments()
    # Three empty spans at the jump, where the curve still is at its left end.
    assert segments.next_segment.tolist() == [1, 2, 3, -1, -1]
    np.testing.assert_allclose(segments.control_points[1:4], np.tile(POINTS[3], (3, 4, 1)), atol=ROUNDING)
    np.testing.assert_allclose(curve(0.4), POINTS[4], atol=ROUNDING)
    points[4] = points[3]
    assert BSplineCurve(points, JUMP).segments().next_segment.tolist() == [1, 2, 3, 4, -1]
    np.testing.assert_allclose(curve.derivative()(0.3), BSpline(JUMP, curve.control_points, 3)(0.3, nu=1))


def test_a_closed_spline_with_a_jump_at_its_seam_has_two_ends():
    knots = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 2.5])
    curve = BSplineCurve(POINTS, np.concatenate([knots, knots[:4] + 3]), periodic=True)
    assert curve.segments().next_segment.tolist() == [1, 2, 3, 4, 5, 6, -1]


def test_open_splines_whose_ends_agree_are_closed():
    points = np.vstack([POINTS, POINTS[:1]])
    assert BSplineCurve.clamped(points).segments().next_segment.tolist() == [1, 2, 3, 4, 0]


# Splitting, inserting, elevating, reversing, transforming

CURVES = pytest.mark.parametrize(
    "curve",
    [
        BSplineCurve(POINTS, DOUBLE),
        # The closed one has weights as well.
        pytest.param(BSplineCurve(POINTS, DOUBLE, WEIGHTS), marks=pytest.mark.slow),
        BSplineCurve(POINTS, CLOSED, WEIGHTS, periodic=True),
    ],
    ids=["open", "rational", "closed"],
)


@CURVES
def test_parts_of_a_split_cover_the_curve(curve):
    start, stop = map(float, curve.domain)
    # On a double or a simple knot, and close to the end.
    for u in (2.4 if curve.periodic else 0.3, stop - 0.01):
        before, after = curve.split(u)
        t = np.concatenate([domain_samples(curve), [u]])
        expected = curve(t)
        parts = np.where((t < u)[:, None], before(t), after(t))
        np.testing.assert_allclose(parts, expected, atol=10 * ROUNDING)
        assert [float(end) for end in (*before.domain, *after.domain)] == pytest.approx([start, u, u, stop], abs=0)
        np.testing.assert_allclose(before.control_points[-1], after.control_points[0], atol=ROUNDING)
        assert before.periodic is after.periodic is False


def test_split_at_a_known_parameter_may_be_compiled():
    curve = BSplineCurve(POINTS, CLOSED, WEIGHTS, periodic=True)
    cut = jax.jit(lambda points: eqx.tree_at(lambda c: c.control_points, curve, points).split(1.5)[0](1.2))
    np.testing.assert_allclose(cut(POINTS), curve(1.2), atol=10 * ROUNDING)
    with pytest.raises(ValueError, match=r"t is 4; needs 1 < t < 4\."):
        jax.jit(lambda _: curve.split(4.0)[0](1.2))(0.0)


def test_a_split_at_a_jump_takes_both_sides():
    curve = BSplineCurve(np.vstack([POINTS, POINTS[:1]]), JUMP)
    before, after = curve.split(0.4)
    np.testing.assert_array_equal(before.control_points, curve.control_points[:4])
    np.testing.assert_array_equal(after.control_points, curve.control_points[4:])


@CURVES
def test_knot_insertion_keeps_the_curve(curve):
    start, stop = map(float, curve.domain)
    t = domain_samples(curve)
    for u in (0.6 * start + 0.4 * stop, 2.4 if curve.periodic else 0.3, start + 0.01, stop - 0.01):
        refined = curve.insert_knot(u)
        assert refined.control_points.shape == (8, 2)
        assert refined.periodic == curve.periodic
        np.testing.assert_allclose(refined(t), curve(t), atol=10 * ROUNDING)
    traced = jax.jit(lambda u: curve.insert_knot(u)(t))(0.5 * (start + stop))
    np.testing.assert_allclose(traced, curve(t), atol=10 * ROUNDING)


@CURVES
def test_elevation_and_reversal_keep_the_curve(curve):
    start, stop = map(float, curve.domain)
    t = domain_samples(curve)
    raised = curve.elevate(5)
    assert (raised.degree, raised.periodic) == (5, curve.periodic)
    np.testing.assert_allclose(raised(t), curve(t), atol=10 * ROUNDING)
    back = curve.reverse()
    assert [float(end) for end in back.domain] == pytest.approx([start, stop])
    np.testing.assert_allclose(back(start + stop - t), curve(t), atol=10 * ROUNDING)


@CURVES
def test_transform_is_affine(curve):
    matrix, offset = np.array([[1.0, 2.0], [0.0, 3.0]]), np.array([5.0, -1.0])
    t = domain_samples(curve)
    image = curve.transform(matrix, offset)
    assert image.periodic == curve.periodic
    np.testing.assert_allclose(image(t), curve(t) @ matrix.T + offset, atol=10 * ROUNDING)


def test_the_opened_curve_is_the_same():
    curve = BSplineCurve(POINTS, CLOSED, WEIGHTS, periodic=True)
    t = domain_samples(curve)
    assert not curve.to_open().periodic
    np.testing.assert_allclose(curve.to_open()(t), curve(t), atol=ROUNDING)


# From scipy


def test_scipy_splines_become_curves():
    knots, points = random_spline(3)
    reference = BSpline(knots, points, 3)
    curve = BSplineCurve.from_scipy(reference)
    t = domain_samples(curve)
    np.testing.assert_allclose(curve(t), reference(t), atol=ROUNDING)
    longer = BSpline(knots, np.vstack([points, points[:2]]), 3)
    np.testing.assert_array_equal(BSplineCurve.from_scipy(longer).control_points, points)


def test_periodic_scipy_splines_become_closed_ones():
    angle = np.linspace(0, 2 * np.pi, 9)
    rows = np.column_stack([np.cos(angle), np.sin(2 * angle)])
    rows[-1] = rows[0]
    reference = make_interp_spline(angle, rows, k=3, bc_type="periodic")
    curve = BSplineCurve.from_scipy(reference)
    assert (curve.periodic, curve.control_points.shape) == (True, (8, 2))
    t = np.linspace(0, 8, 21)
    np.testing.assert_allclose(curve(t), reference(t), atol=10 * ROUNDING)
    assert curve.segments().next_segment.tolist() == [1, 2, 3, 4, 5, 6, 7, 0]


def test_scipy_splines_that_only_wrap_their_parameter_stay_open():
    reference = BSpline(DOUBLE, POINTS, 3, extrapolate="periodic")  # pyright: ignore[reportArgumentType]
    curve = BSplineCurve.from_scipy(reference)
    assert not curve.periodic
    np.testing.assert_allclose(curve(0.4), reference(0.4), atol=ROUNDING)


def test_closed_fits_of_scipy_are_closed():
    angle = np.linspace(0, 2 * np.pi, 9)
    rows = np.column_stack([np.cos(angle), np.sin(angle)])
    rows[-1] = rows[0]
    (knots, coefficients, degree), _ = splprep(rows.T, per=1, s=0)
    segments = BSplineCurve.from_scipy(BSpline(knots, np.transpose(coefficients), degree)).segments()
    assert segments.next_segment.tolist() == [1, 2, 3, 4, 5, 6, 7, 0]


@pytest.mark.parametrize(
    ("coefficients", "message"),
    [
        (np.ones(7), r"spline\.c has shape \(7,\); needs \(points, 2\) or \(points, 3\)\."),
        (np.ones((7, 4)), r"spline\.c has shape \(7, 4\)"),
        (np.ones((7, 2, 2)), r"spline\.c has shape \(7, 2, 2\)"),
    ],
)
def test_scipy_splines_whose_coefficients_are_no_points_are_refused(coefficients, message):
    with pytest.raises(ValueError, match=message):
        BSplineCurve.from_scipy(BSpline(DOUBLE, coefficients, 3))


def test_what_is_no_scipy_spline_is_refused():
    with pytest.raises(TypeError, match=r"spline must be a scipy\.interpolate\.BSpline \(t, c and k\); got tuple\."):
        BSplineCurve.from_scipy((DOUBLE, POINTS, 3))  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match=r"control_points must be real numbers"):
        BSplineCurve.from_scipy(BSpline(DOUBLE, POINTS * 1j, 3))


# Refusals


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: BSplineCurve(POINTS[:3], np.arange(7)),
            r"control_points has 3 points; degree 3 \(7 knots\) needs at least 4\.",
        ),
        (lambda: BSplineCurve.uniform(POINTS[:3]), r"control_points has 3 points; degree 3 .* needs at least 4\."),
        (lambda: BSplineCurve.clamped(POINTS[:2], 2), r"control_points has 2 points; degree 2 .* needs at least 3\."),
        (
            lambda: BSplineCurve.uniform(POINTS[:2], periodic=True),
            r"control_points has 2 points; periodic degree 3 \(6 knots\) needs at least 3\.",
        ),
        (lambda: BSplineCurve(POINTS, np.arange(7)), r"knots has 7 entries; 7 points need at least 8\."),
        (lambda: BSplineCurve(POINTS, np.zeros((11, 1))), r"knots has shape \(11, 1\); needs \(knots,\)\."),
        (lambda: BSplineCurve(POINTS, []), r"knots has 0 entries"),
        (
            lambda: BSplineCurve(POINTS, [0, 0, 0, 0, 2, 1, 3, 4, 4, 4, 4]),
            r"knots\[5\] is 1; needs at least knots\[4\] = 2\.",
        ),
        (lambda: BSplineCurve(POINTS, np.arange(11) * np.nan), r"knots\[0\] is not finite: nan\."),
        (
            lambda: BSplineCurve(POINTS[:4], [0, 0, 0, 1, 1, 2, 2, 2]),
            r"knots\[3\] and knots\[4\] are both 1; the domain has length zero\.",
        ),
        (
            lambda: BSplineCurve(POINTS, np.zeros(11), periodic=True),
            r"knots\[3\] and knots\[10\] are both 0; the domain has length zero\.",
        ),
        (
            lambda: BSplineCurve(POINTS, [*range(10), 9.5], periodic=True),
            r"knots\[10\] is 9\.5; a periodic spline needs knots\[3\] \+ period = 10\.",
        ),
        (lambda: BSplineCurve(POINTS, DOUBLE, WEIGHTS[:3]), r"weights has 3 entries; control_points has 7 points\."),
        (lambda: BSplineCurve.uniform(POINTS, 3, True, [1]), r"weights has 1 entries; control_points has 7 points\."),
        (lambda: BSplineCurve(POINTS, DOUBLE, -WEIGHTS), r"weights\[0\] is not positive: -"),
        (lambda: BSplineCurve(POINTS, DOUBLE, [1, 1, 0, 1, 1, 1, 1]), r"weights\[2\] is not positive: 0\."),
        (lambda: BSplineCurve(POINTS, DOUBLE, WEIGHTS * np.inf), r"weights\[0\] is not finite: inf\."),
        (lambda: BSplineCurve([*POINTS[:6], [0, np.inf]], DOUBLE), r"control_points\[6\] is not finite: \(0, inf\)\."),
        (lambda: BSplineCurve(np.zeros((0, 2)), DOUBLE), r"control_points is empty: its shape is \(0, 2\)\."),
        (lambda: BSplineCurve.uniform([]), r"control_points has shape \(0,\); needs \(points, dim\)\."),
        (lambda: BSplineCurve.clamped(np.zeros((7, 5))), r"control_points has 5 coordinates a point; needs 2 or 3\."),
        (lambda: BSplineCurve.uniform(POINTS, -1), r"degree is -1; needs at least 0\."),
        (lambda: BSplineCurve.clamped(POINTS, -2), r"degree is -2; needs at least 0\."),
        (lambda: BSplineCurve(POINTS, DOUBLE).split(0.0), r"t is 0; needs 0 < t < 1\."),
        (lambda: BSplineCurve(POINTS, DOUBLE).split(1.2), r"t is 1\.2; needs 0 < t < 1\."),
        (lambda: BSplineCurve(POINTS, DOUBLE).insert_knot(-0.25), r"t is -0\.25; needs 0 < t < 1\."),
        (lambda: BSplineCurve(POINTS, DOUBLE).insert_knot([0.5]), r"t has shape \(1,\); needs a scalar\."),
        (lambda: BSplineCurve(POINTS, DOUBLE)([0.5, np.nan]), r"t\[1\] is not finite: nan\."),
        (lambda: BSplineCurve(POINTS, DOUBLE).elevate(2), r"degree is 3; cannot elevate to 2\."),
        (
            lambda: BSplineCurve(POINTS, DOUBLE).transform(np.eye(3)),
            r"matrix has shape \(3, 3\); needs \(new_dim, 2\)\.",
        ),
    ],
)
def test_wrong_values_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        # With the run-time type checks on, those speak first.
        (lambda: BSplineCurve.uniform(POINTS, 2.5), "degree must be an integer; got 2.5|parameter 'degree'"),  # pyright: ignore[reportArgumentType]
        (lambda: BSplineCurve.clamped(POINTS, "3"), "degree must be an integer; got '3'|parameter 'degree'"),  # pyright: ignore[reportArgumentType]
        (lambda: BSplineCurve("abc", DOUBLE), r"control_points is 'abc'; needs numbers\."),  # pyright: ignore[reportArgumentType]
        (lambda: BSplineCurve(POINTS, ["a"] * 11), r"knots must be real numbers; its dtype is"),  # pyright: ignore[reportArgumentType]
        (lambda: BSplineCurve(POINTS, DOUBLE * 1j), r"knots must be real numbers; its dtype is complex128\."),
        (lambda: BSplineCurve(POINTS, DOUBLE, WEIGHTS * 1j), r"weights must be real numbers; its dtype is"),
    ],
)
def test_wrong_kinds_are_refused(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_split_refuses_traced_parameters_and_knots():
    with pytest.raises(TypeError, match=r"split of a BSplineCurve needs concrete t and knots"):
        jax.jit(lambda t: BSplineCurve(POINTS, DOUBLE).split(t)[0].knots)(0.5)
    with pytest.raises(TypeError, match=r"split of a BSplineCurve needs concrete t and knots"):
        jax.jit(lambda knots: BSplineCurve(POINTS, knots).split(0.5)[0].knots)(DOUBLE)


# Transformations of JAX


def test_a_curve_is_a_tree_of_its_arrays():
    curve = BSplineCurve(POINTS, CLOSED, WEIGHTS, periodic=True)
    leaves, structure = jax.tree_util.tree_flatten(curve)
    assert [leaf.shape for leaf in leaves] == [(7, 2), (11,), (7,)]
    again = jax.tree_util.tree_unflatten(structure, leaves)
    assert bool(eqx.tree_equal(curve, again))
    assert again.periodic


@pytest.mark.slow
def test_curves_are_mapped_over():
    batch = eqx.filter_vmap(lambda c: BSplineCurve.uniform(c, periodic=True))(np.stack([POINTS, 2 * POINTS]))
    assert (batch.degree, batch.dim) == (3, 2)
    t = np.linspace(3, 9, 5)
    values = jax.jit(jax.vmap(lambda curve: curve(t)))(batch)
    np.testing.assert_allclose(values[1], 2 * values[0], atol=ROUNDING)
    segments = jax.vmap(lambda curve: curve.segments())(batch)
    assert segments.control_points.shape == (2, 7, 4, 2)
    assert segments.next_segment.tolist() == [[1, 2, 3, 4, 5, 6, 0]] * 2


@pytest.mark.parametrize(("knots", "periodic"), swept([(CLOSED, True), (DOUBLE, False)], 0, 1))
def test_gradients_in_points_knots_and_weights_are_finite_at_repeated_knots(knots, periodic):
    def total(points, knots, weights):
        curve = BSplineCurve(points, knots, weights, periodic)
        segments = curve.segments()
        parts = (segments.control_points, segments.weights, curve(1.0), curve.derivative().control_points)
        return sum(jnp.sum(jnp.square(jnp.asarray(part))) for part in parts)

    value, gradients = jax.jit(jax.value_and_grad(total, argnums=(0, 1, 2)))(POINTS, knots, WEIGHTS)
    np.testing.assert_allclose(value, total(POINTS, knots, WEIGHTS), rtol=1e-12)
    assert all(bool(jnp.all(jnp.isfinite(gradient))) for gradient in gradients)


def test_the_gradient_in_simple_knots_agrees_with_differences():
    knots, points = random_spline(3, seed=5)
    knots = np.linspace(0, 1, len(knots)) ** 1.5
    t = 0.5

    def value(knots):
        return BSplineCurve(points, knots)(t)[0]

    gradient = jax.jit(jax.grad(value))(knots)
    differences = [(value(knots + h) - value(knots - h)) / 2e-6 for h in 1e-6 * np.eye(len(knots))]
    np.testing.assert_allclose(gradient, differences, atol=DIFFERENCES)


def test_a_traced_domain_of_length_zero_gives_numbers():
    value, gradient = jax.jit(jax.value_and_grad(lambda k: jnp.sum(BSplineCurve(POINTS, k)(0.0))))(jnp.zeros(11))
    assert bool(jnp.isfinite(value)) and bool(jnp.all(jnp.isfinite(gradient)))
    closed = jax.jit(lambda k: BSplineCurve(POINTS, k, periodic=True)(1.0))(jnp.zeros(11))
    assert bool(jnp.all(jnp.isfinite(closed)))


@pytest.mark.parametrize(
    ("knots", "periodic", "weights"),
    swept([(DOUBLE, False, None), (CLOSED, True, WEIGHTS), (DOUBLE, False, WEIGHTS), (CLOSED, True, None)], 2),
)
def test_segments_of_known_numbers_compile_nothing_and_are_those_of_a_program(knots, periodic, weights):
    curve = BSplineCurve(POINTS, knots, weights, periodic)
    compiled = []

    def listener(event: str, *_: object, **__: object) -> None:
        compiled.append(event) if "backend_compile" in event else None

    jax.monitoring.register_event_duration_secs_listener(listener)
    try:
        found = curve.segments()
    finally:
        jax.monitoring.unregister_event_duration_listener(listener)
    assert compiled == []
    traced = jax.jit(lambda c: c.segments())(curve)
    np.testing.assert_allclose(found.homogeneous, traced.homogeneous, atol=ROUNDING)
    np.testing.assert_array_equal(found.links, traced.links)


@pytest.mark.parametrize("arguments", [(3,), (DOUBLE, 3)], ids=["as_knots", "as_weights"])
def test_a_degree_in_the_place_of_an_array_is_named(arguments):
    place = ("knots", "weights")[len(arguments) - 1]
    with pytest.raises(TypeError, match=rf"{place} is 3; BSplineCurve\(\) takes no degree.*BSplineCurve\.clamped"):
        BSplineCurve(POINTS, *arguments)


@pytest.mark.slow
def test_knots_that_an_optimizer_has_let_decrease_are_refused():
    curve = BSplineCurve(POINTS, CLOSED, periodic=True)
    steps = BSplineCurve(POINTS, np.arange(8.0))
    rows = np.random.default_rng(3).normal(size=(4, 4, 3))
    surface = jhd.BSplineSurface.clamped(rows, (2, 2))
    points = {2: jhd.point_set(POINTS), 3: jhd.point_set(rows[0])}
    of_curve = lambda s: s.knots  # noqa: E731
    for shape, where, name in (
        (curve, of_curve, "knots"),
        (steps, of_curve, "knots"),
        (surface, lambda s: s.knots_u, "knots_u"),
    ):
        wrong = eqx.tree_at(where, shape, where(shape).at[3].set(-1.0))
        distance = lambda shape: jhd.directed_hausdorff(points[shape.dim], shape, throw=False)  # noqa: E731
        with pytest.raises(ValueError, match=rf"{name}\[3\] is -1; needs at least {name}\[2\]"):
            distance(wrong)
        found = jax.jit(distance)(wrong)
        assert name_of(found.result) == "nonfinite_value" and float(found.upper) == np.inf
    # Nor is there a spline over a domain of length zero, nor one whose last knot is another than the first.
    for knots in (jnp.zeros_like(curve.knots), curve.knots.at[-1].add(0.25)):
        found = jax.jit(distance)(eqx.tree_at(of_curve, curve, knots))
        assert name_of(found.result) == "nonfinite_value" and float(found.upper) == np.inf
