"""The table of cases is well formed and true, and the reference that knows its values is right.

The values of the table are checked twice: against the search of `reference` in float64, which is global, and against
Newton's method in 60 digits on the equations of the event found, which is local. What both say is true.
"""

from decimal import Decimal, localcontext
from functools import cache

import numpy as np
import pytest

from tests import reference
from tests.cases import CASES, DIGITS, EVENTS, FEET, Case, Shape, by_tag, names

# The reference against the table, in diagonals: it stops searching when nothing can be larger by 1e-12 of the diagonal.
REFERENCE = 2e-12
# A distance of the reference is off by the rounding of a few sums of coordinates of the size of the diagonal.
ROUNDING = 1e-14
# Newton in 60 digits against 30 digits stored, in diagonals.
STORED = Decimal("1e-27")
# Parameters nearer than this to 0 or 1 are the end: maxima at ends are found to 1e-16, and flat ones to 1e-8.
AT_END = 1e-7
BY_NAME = {case.name: case for case in CASES}
BOTH = [(case, direction) for case in CASES for direction in ("ab", "ba")]
WITH_EVENT = [case for case in CASES if case.tags & set(EVENTS)]
SHAPES = (
    "smooth cusp loop line polyline degree_0 point_curve closed contours space rational spline weights center flat tie "
    "far scale close"
).split()


def directed(case: Case, direction: str):
    """The two shapes in order and what the table says of them."""
    return (case.a, case.b, case.exact_ab) if direction == "ab" else (case.b, case.a, case.exact_ba)


def every(step, parameters, rest):
    """Parameters, a case each or a case with a direction; one in `step` is slow, the rest has a mark of its own."""
    marked = []
    for k, parameter in enumerate(parameters):
        values = parameter if isinstance(parameter, tuple) else (parameter,)
        name = "-".join([values[0].name, *values[1:]])
        marked.append(pytest.param(*values, id=name, marks=pytest.mark.slow if k % step == 0 else rest))
    return marked


@cache
def solved(name, direction):
    """The directed distance of the reference, once for all tests."""
    a, b, _ = directed(BY_NAME[name], direction)
    return reference.directed_hausdorff(a, b)


# ---- events --------------------------------------------------------------------------------------


def end_tangent(points, end):
    """The unit tangent that points into the segment from its end 0 or 1; None where all its points are equal."""
    points = points if end == 0 else points[::-1]
    for step in points[1:] - points[0]:
        if step.any():
            return step / np.linalg.norm(step)
    return None


def kind_of_end(shape: Shape, segment, end):
    """`end` where no segment follows, else `smooth` or `corner`."""
    points = shape.control_points
    here, tangent = points[segment, -end], end_tangent(points[segment], end)
    followers = [end_tangent(other, 1 - end) for other in points if np.array_equal(other[end - 1], here)]
    if tangent is None or not followers or len(points[segment]) == 1:
        return "end"
    return "smooth" if any(t is not None and np.allclose(t, -tangent, atol=1e-9) for t in followers) else "corner"


def place(shape: Shape, segment, t):
    """`inside`, `smooth`, `corner` or `end`."""
    if AT_END < t < 1 - AT_END and shape.control_points.shape[1] > 1:
        return "inside"
    return kind_of_end(shape, segment, round(t))


def feet_of(solution, a: Shape, b: Shape):
    """The feet of the point that the reference found, all relative to a common center."""
    center = b.control_points[0, 0]
    a, b = (Shape(shape.control_points - center, shape.weights) for shape in (a, b))
    weights = None if a.weights is None else a.weights[solution.segment : solution.segment + 1]
    point = reference.evaluate(a.control_points[solution.segment][None], weights, solution.t)[0]
    # At a tie the distances differ by what the witness is off: 1e-12 of the diagonal, or much less in close shapes.
    slack = min(1e-9 * reference.diagonal(a, b), 1e-3 * solution.value)
    return reference.feet(point, b.control_points, b.weights, slack=slack)


def event_tags(solution, a: Shape, b: Shape):
    """The tags of the event at the witness that the reference found."""
    feet = feet_of(solution, a, b)
    if solution.value < ROUNDING * reference.diagonal(a, b):
        return {"coincident"}
    place_a = place(a, solution.segment, solution.t)
    if place_a in ("end", "corner"):
        return {"a_end" if place_a == "end" else "corner"}
    ends = [place(b, foot.segment, foot.s) in ("end", "corner") for foot in feet]
    if len(feet) == 1:
        return {"b_end" if ends[0] else "antipodal"}
    return {"one_to_two", ("foot_and_foot", "foot_and_end", "end_and_end")[sum(ends)]} if len(feet) == 2 else {"many"}


# ---- sixty digits --------------------------------------------------------------------------------


def precise_curve(shape: Shape, segment, t: Decimal):
    """Point and derivative of a segment by de Casteljau's algorithm in decimals."""
    weights = np.ones(shape.control_points.shape[1]) if shape.weights is None else shape.weights[segment]
    decimals = [Decimal(float(w)) for w in weights]
    rows = [
        [Decimal(float(x)) * w for x in point] + [w]
        for point, w in zip(shape.control_points[segment], decimals, strict=True)
    ]
    degree = len(rows) - 1
    while len(rows) > 2:
        rows = [[p + (q - p) * t for p, q in zip(u, v, strict=True)] for u, v in zip(rows[:-1], rows[1:], strict=True)]
    slope = [degree * (q - p) for p, q in zip(rows[0], rows[-1], strict=True)]
    *point, weight = [p + (q - p) * t for p, q in zip(rows[0], rows[-1], strict=True)]
    point = [x / weight for x in point]
    return point, [(d - x * slope[-1]) / weight for d, x in zip(slope[:-1], point, strict=True)]


def dot(u, v):
    return sum((x * y for x, y in zip(u, v, strict=True)), Decimal(0))


def difference(u, v):
    return [x - y for x, y in zip(u, v, strict=True)]


def solve(matrix, right):
    """Gauss elimination with pivots for a handful of unknowns; ZeroDivisionError or InvalidOperation where singular."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for k in range(len(rows)):
        pivot = max(range(k, len(rows)), key=lambda i: abs(rows[i][k]))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(len(rows)):
            if i != k:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [row[-1] for row in rows]


class EventEquations:
    """The equations of the event at a witness, whose free unknowns are t (inside a) and s of each foot inside b.

    One foot: (A-B).A' = 0 and (A-B).B' = 0. Two feet: |A-B1|^2 = |A-B2|^2 and (A-Bi).Bi' = 0. A parameter at an end is
    fixed.
    """

    def __init__(self, a, b, solution, feet):
        self.a, self.b, self.segment = a, b, solution.segment
        # At an end of a only the nearest foot matters: a second one that is equally far is a coincidence.
        self.feet = feet if self.is_free(a, solution.segment, solution.t) else feet[:1]
        parameters = [(a, solution.segment, solution.t), *((b, foot.segment, foot.s) for foot in self.feet)]
        self.free = [self.is_free(*parameter) for parameter in parameters]
        values = [parameter[2] for parameter in parameters]
        self.start = [Decimal(x) if free else Decimal(round(x)) for x, free in zip(values, self.free, strict=True)]
        self.unit = Decimal(reference.diagonal(a, b)) ** 2

    @staticmethod
    def is_free(shape, segment, t):
        return place(shape, segment, t) in ("inside", "smooth")

    def distances_and_residuals(self, unknowns):
        t, *parameters = unknowns
        point, tangent = precise_curve(self.a, self.segment, t)
        residuals, joins = [], []
        for foot, s, free in zip(self.feet, parameters, self.free[1:], strict=True):
            foot_point, foot_tangent = precise_curve(self.b, foot.segment, s)
            joins.append(difference(point, foot_point))
            residuals += [dot(joins[-1], foot_tangent) / self.unit] if free else []
        if self.free[0]:
            own = dot(joins[0], tangent) if len(joins) == 1 else dot(joins[0], joins[0]) - dot(joins[1], joins[1])
            residuals.insert(0, own / self.unit)
        return dot(joins[0], joins[0]).sqrt(), residuals

    def newton(self):
        """The distance at the solution, or None where the equations are singular or lead away from the witness."""
        unknowns, step = list(self.start), Decimal("1e-28")
        free = [i for i, is_free in enumerate(self.free) if is_free]
        for _ in range(12):
            distance, residuals = self.distances_and_residuals(unknowns)
            columns = []
            for i in free:
                moved = [x + step if k == i else x for k, x in enumerate(unknowns)]
                columns.append([x / step for x in difference(self.distances_and_residuals(moved)[1], residuals)])
            try:
                change = solve([list(row) for row in zip(*columns, strict=True)], residuals)
            except ArithmeticError:
                return None
            for i, x in zip(free, change, strict=True):
                unknowns[i] -= x
            if all(abs(x) < Decimal("1e-40") for x in change):
                near = all(abs(x - y) < Decimal("1e-4") for x, y in zip(unknowns, self.start, strict=True))
                return distance if near else None
        return None


# ---- the table -----------------------------------------------------------------------------------


def test_names_are_unique_and_there_are_at_least_85():
    assert len(set(names)) == len(names) >= 85


@pytest.mark.parametrize("event", (*EVENTS, *FEET))
def test_every_kind_of_event_has_at_least_four_cases(event):
    assert len(by_tag(event)) >= 4


@pytest.mark.parametrize("tag", SHAPES)
def test_every_kind_of_shape_has_cases(tag):
    assert len(by_tag(tag)) >= 3


def test_every_degree_from_0_to_10_occurs_on_both_sides():
    for side in ("a", "b"):
        assert {getattr(case, side).control_points.shape[1] - 1 for case in CASES} >= set(range(11))


def test_arrays_are_finite_and_of_the_right_shapes():
    for case in CASES:
        for shape in (case.a, case.b):
            assert shape.control_points.dtype == np.float64, case.name
            assert shape.control_points.ndim == 3, case.name
            assert np.isfinite(shape.control_points).all(), case.name
            if shape.weights is not None:
                assert shape.weights.shape == shape.control_points.shape[:2], case.name
                assert np.isfinite(shape.weights).all() and (shape.weights > 0).all(), case.name
        assert case.a.control_points.shape[2] == case.b.control_points.shape[2] in (2, 3), case.name


def test_values_are_strings_of_numbers_or_ordered_intervals():
    for case in CASES:
        for value in (case.exact_ab, case.exact_ba):
            if isinstance(value, tuple):
                assert 0 <= value[0] <= value[1], case.name
            elif value is not None:
                assert Decimal(value) >= 0, case.name
        assert len(case.tags & set(EVENTS)) <= 1, case.name
        assert ("one_to_two" in case.tags) == bool(case.tags & set(FEET)), case.name


@pytest.mark.parametrize(("case", "direction"), every(24, BOTH, pytest.mark.exhaustive))
def test_the_reference_agrees_with_the_table(case, direction):
    a, b, exact = directed(case, direction)
    if exact is None:
        return
    solution = solved(case.name, direction)
    unit = reference.diagonal(a, b)
    lower, upper = map(Decimal, exact if isinstance(exact, tuple) else (exact, exact))
    assert lower - Decimal(solution.value) <= Decimal(REFERENCE * unit)
    assert Decimal(solution.value) - upper <= Decimal(ROUNDING * unit)
    assert Decimal(solution.upper) >= lower - Decimal(ROUNDING * unit)


@pytest.mark.parametrize(
    ("case", "direction"), every(24, [p for p in BOTH if isinstance(directed(*p)[2], str)], pytest.mark.exhaustive)
)
def test_sixty_digits_agree_with_the_table(case, direction):
    a, b, exact = directed(case, direction)
    assert isinstance(exact, str)
    solution = solved(case.name, direction)
    if Decimal(exact) == 0:
        return
    feet = feet_of(solution, a, b)
    with localcontext() as context:
        context.prec = 60
        value = EventEquations(a, b, solution, feet).newton() if len(feet) <= 2 else None
        unit = Decimal(reference.diagonal(a, b))
        if value is None:
            # Singular equations or more than two feet: such a value has a closed form.
            assert DIGITS.get(case.name, (None, None))[direction == "ba"] is None
        elif "near_tie" in case.tags:
            assert abs(value - Decimal(exact)) <= Decimal(ROUNDING) * unit
        else:
            assert abs(value - Decimal(exact)) <= STORED * max(unit, value)


@pytest.mark.parametrize("case", every(15, WITH_EVENT, pytest.mark.exhaustive))
def test_event_tags_are_those_of_the_witness(case):
    assert event_tags(solved(case.name, "ab"), case.a, case.b) == case.tags & {*EVENTS, *FEET}


# ---- the reference -------------------------------------------------------------------------------


def brute_force_distance(point, shape, samples):
    """The smallest distance to samples, an upper bound of the distance."""
    local = reference.evaluate(shape.control_points - point, shape.weights, np.linspace(0, 1, samples))
    return np.linalg.norm(local, axis=-1).min()


def queries(shape, count, seed):
    """Points in a box somewhat larger than that of the control points, and some on the curve."""
    rng = np.random.default_rng(seed)
    points = shape.control_points.reshape(-1, shape.control_points.shape[2])
    low, size = points.min(axis=0), np.ptp(points, axis=0).max()
    inside = low - 0.25 * size + 1.5 * size * rng.random((count, points.shape[1]))
    return np.concatenate([inside, reference.evaluate(shape.control_points, shape.weights, 0.375)])


@pytest.mark.parametrize("case", every(15, CASES, pytest.mark.exhaustive))
def test_projection_is_never_above_brute_force_and_hardly_below(case):
    shape = case.b
    samples = 4001 // len(shape.control_points) + 201
    for point in queries(shape, 6, seed=7):
        distance, segment, s = reference.project(point, *shape)
        brute = brute_force_distance(point, shape, samples)
        unit = max(distance, np.ptp(shape.control_points, axis=(0, 1)).max())
        assert distance <= brute + ROUNDING * unit
        weights = None if shape.weights is None else shape.weights[segment][None]
        on_curve = reference.evaluate((shape.control_points[segment] - point)[None], weights, s)[0]
        assert abs(np.linalg.norm(on_curve) - distance) <= ROUNDING * unit
        # The distance is Lipschitz in s: the speed of the polygon and its weights times half a step bounds the rest.
        ratio = 1.0 if shape.weights is None else np.max(shape.weights.max(axis=1) / shape.weights.min(axis=1)) ** 2
        gaps = np.linalg.norm(np.diff(shape.control_points, axis=1), axis=-1).max(initial=0.0)
        speed = (shape.control_points.shape[1] - 1) * ratio * gaps
        assert brute - distance <= speed / (2 * (samples - 1)) + ROUNDING * unit


def test_profile_is_the_projection_of_each_point():
    for case in CASES[::24]:
        points = queries(case.b, 10, seed=3)
        profile = reference.distance_profile(points, *case.b)
        assert [reference.project(point, *case.b)[0] for point in points] == pytest.approx(profile, rel=1e-12, abs=0)


def test_projection_above_an_arc_is_the_nearer_end():
    # The arc is y = x^2 over |x| <= 1/2.
    arc = BY_NAME["parabola_through_center"].a
    assert reference.project((0.0, 2.0), *arc)[0] == pytest.approx(np.hypot(0.5, 1.75), rel=1e-15)


@pytest.mark.parametrize("name", ["circle_around_its_center", "segment_to_point_curve"])
def test_projection_to_a_point_is_the_distance_to_it(name):
    shape = BY_NAME[name].b
    place = shape.control_points[0, 0]
    assert reference.project(place + (3.0, 4.0), *shape)[0] == 5.0
    assert reference.project(place, *shape)[0] == 0.0


def test_projection_from_the_center_of_a_circle_is_the_radius():
    circle = BY_NAME["concentric_circles"].b
    assert reference.project((0.0, 0.0), *circle)[0] == pytest.approx(2.0, rel=1e-15)
    assert len(reference.feet((0.0, 0.0), *circle, slack=1e-14)) > 4


def test_projection_at_a_center_of_curvature_is_exact():
    parabola = BY_NAME["segment_over_parabola"].b
    assert reference.project((0.0, 0.5), *parabola)[0] == pytest.approx(0.5, rel=1e-15)


def test_feet_at_a_tie_are_both_found():
    parabola = BY_NAME["segment_over_parabola"].b
    feet = reference.feet((0.0, 2.0), *parabola, slack=1e-14)
    assert sorted(foot.point[0] for foot in feet) == pytest.approx([-np.sqrt(1.5), np.sqrt(1.5)], rel=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 6, 10])
def test_evaluation_is_the_sum_of_bernstein_polynomials(degree):
    rng = np.random.default_rng(degree)
    control_points, weights = rng.normal(size=(2, degree + 1, 3)), 1.0 + rng.random((2, degree + 1))
    t = np.linspace(0, 1, 9)
    powers = np.stack([t**i * (1 - t) ** (degree - i) for i in range(degree + 1)])
    basis = powers * np.array([float(reference.comb(degree, i)) for i in range(degree + 1)])[:, None]
    denominator = np.einsum("it,ki->kt", basis, weights)[..., None]
    expected = np.einsum("it,ki,kij->ktj", basis, weights, control_points) / denominator
    np.testing.assert_allclose(reference.evaluate(control_points, weights, t), expected, rtol=1e-13, atol=1e-14)


def test_restriction_keeps_the_curve():
    rows = np.random.default_rng(5).normal(size=(4, 6, 3))
    start, stop = np.array([0.0, 0.25, 0.5, 1.0]), np.array([1.0, 0.5, 0.75, 1.0])
    u = np.linspace(0, 1, 7)
    part = reference.restrict(rows, start, stop)
    for k in range(4):
        whole = reference.evaluate(rows[k][None], None, start[k] + (stop[k] - start[k]) * u)
        np.testing.assert_allclose(reference.evaluate(part[k][None], None, u), whole, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [2.0**-40, 2.0**40, 1e-12, 3e12])
def test_distances_scale_with_the_shapes(factor):
    for case in CASES[::29]:
        value = solved(case.name, "ab").value
        a, b = (Shape(shape.control_points * factor, shape.weights) for shape in (case.a, case.b))
        scaled = reference.directed_hausdorff(a, b).value
        assert abs(scaled / factor - value) <= REFERENCE * reference.diagonal(case.a, case.b)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wave_over_line", "splines_12", "circle_in_ellipse", "loop_and_line"])
def test_the_upper_bound_closes_in_and_a_small_budget_leaves_it_true(name):
    case = BY_NAME[name]
    unit = reference.diagonal(case.a, case.b)
    full = solved(name, "ab")
    cut = reference.directed_hausdorff(case.a, case.b, budget=0)
    assert 0 <= full.upper - full.value <= REFERENCE * unit
    assert cut.upper >= full.value - ROUNDING * unit


@pytest.mark.parametrize("case", every(24, CASES, pytest.mark.exhaustive))
def test_no_sample_of_a_is_farther_than_the_directed_distance(case):
    value = solved(case.name, "ab").value
    center = case.b.control_points[0, 0]
    a = Shape(case.a.control_points - center, case.a.weights)
    samples = reference.evaluate(*a, np.linspace(0, 1, 1000 // len(a.control_points) + 7))
    points = samples.reshape(-1, a.control_points.shape[2])
    profile = reference.distance_profile(points, case.b.control_points - center, case.b.weights)
    assert profile.max() <= value + REFERENCE * reference.diagonal(case.a, case.b)


def test_hausdorff_is_the_larger_direction():
    case = BY_NAME["circle_in_ellipse"]
    assert reference.hausdorff(case.a, case.b) == pytest.approx(1.0, rel=1e-14)
