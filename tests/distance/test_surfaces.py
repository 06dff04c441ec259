"""The claim lower <= exact <= upper for implicit surfaces: the whole table, several tolerances, motions and scalings.

There is no tolerance and no list of exceptions: a bound that fails is an error of the theory or of the code.
"""

import itertools
import os
from fractions import Fraction

import jax
import numpy as np
import pytest

import jhd
from tests.processes import python
from tests.surface_cases import BY_NAME, CASES, SLOW, Polynomial, X, Y, Z
from tests.surface_cases import surface as surface_in
from tests.sweeps import swept

# The cones of the source have quick tests of their own, beside those of the search.
QUICK = ["hyperboloid_cylinder"]
# Families of maximizers cost much for little; their bounds are as true at a coarse tolerance.
COARSE, FINE = 1e-2, 1e-8


def enclosed(solution, exact):
    """Whether the bounds hold, in exact arithmetic."""
    lower, upper = float(solution.lower), float(solution.upper)
    if np.isinf(upper):
        return Fraction(lower) <= Fraction(exact)
    # The digits are cut off at the end.
    slack = Fraction(1, 10**30)
    return Fraction(lower) - slack <= Fraction(exact) <= Fraction(upper) + slack


def surfaces(case):
    return tuple(jhd.ImplicitSurface(s.coefficients, s.lower, s.upper) for s in (case.a, case.b))


def check(pair, maxima, method, name):
    """Both directions and the larger one, whose bounds must hold whether or not they met the tolerance."""
    (a, b), exact = pair, [Fraction(m.value) for m in maxima]
    for p, q, value in ((a, b, exact[0]), (b, a, exact[1])):
        found = jhd.directed_hausdorff(p, q, method, throw=False)
        assert enclosed(found, value), (name, found.lower, float(value), found.upper)
        assert float(found.lower) <= float(found.value) <= float(found.upper), name
    both = jhd.hausdorff(a, b, method, throw=False)
    assert enclosed(both, max(exact)), (name, both.lower, float(max(exact)), both.upper)


def tolerance_of(case, rtol):
    tolerance = COARSE if case.tags & {"degenerate", "coincident"} else rtol
    return tolerance * max(1e-3, float(case.ab.value), float(case.ba.value))


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", QUICK)
def test_bounds_of_quadrics_enclose_the_distance(name):
    case = BY_NAME[name]
    check(surfaces(case), (case.ab, case.ba), jhd.BranchAndBound(atol=tolerance_of(case, FINE)), name)


@pytest.mark.parametrize(("name", "rtol"), swept(itertools.product(BY_NAME, [COARSE, FINE])))
def test_bounds_enclose_the_distance(name, rtol):
    case = BY_NAME[name]
    check(surfaces(case), (case.ab, case.ba), jhd.BranchAndBound(atol=tolerance_of(case, rtol)), name)


def images(case, generator):
    """The case under a signed permutation of the axes, a dyadic translation and a power of two: nothing is rounded."""
    order, signs = generator.permutation(3), generator.choice([-1.0, 1.0], 3)
    scale, offset = 2.0 ** generator.integers(-3, 4), generator.integers(-4, 5, 3) / 2.0
    found = []
    for s in (case.a, case.b):
        f = np.transpose(s.coefficients, order)
        powers = np.indices(f.shape)
        f = f * np.prod([t ** powers[i] for i, t in enumerate(signs / scale)], axis=0)
        ends = np.array([s.lower, s.upper])[:, order] * signs * scale
        surface = jhd.ImplicitSurface(f, ends.min(axis=0), ends.max(axis=0))
        found.append(surface)
    return (*found, Fraction(scale), offset)


MOVED = ["paper_cones", "sphere_ellipsoid", "plane_at_a_corner", "clebsch_cayley", "plane_in_a_prism", "saddle_plane"]


@pytest.mark.parametrize(("name", "seed"), swept(itertools.product(MOVED, range(2)), slow=[("paper_cones", 0)]))
def test_bounds_enclose_the_distance_after_mirrors_exchanged_axes_and_scalings(name, seed):
    case = BY_NAME[name]
    a, b, scale, _ = images(case, np.random.default_rng(seed))
    wanted = tolerance_of(case, FINE)
    scaled = [m._replace(value=str(Fraction(m.value) * scale)) for m in (case.ab, case.ba)]
    check((a, b), scaled, jhd.BranchAndBound(atol=wanted * float(scale)), name)


@pytest.mark.parametrize("name", swept(["sphere_ellipsoid", "plane_at_a_corner"], slow=["sphere_ellipsoid"]))
def test_bounds_enclose_the_distance_after_translations(name):
    """Dyadic translations of dyadic quadrics round nothing."""
    case = BY_NAME[name]
    _, _, _, offset = images(case, np.random.default_rng(7))
    a, b = (s.transform(np.eye(3), offset) for s in surfaces(case))
    check((a, b), (case.ab, case.ba), jhd.BranchAndBound(atol=tolerance_of(case, FINE)), name)


def turned(surface, quaternion, side):
    """The surface turned by an integer quaternion, times a power of its norm, which keeps all coefficients exact."""
    w, x, y, z = (Fraction(int(q)) for q in quaternion)
    norm = w * w + x * x + y * y + z * z
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    # The inverse turn of the point x, times the norm.
    back = [X * rows[0][k] + Y * rows[1][k] + Z * rows[2][k] for k in range(3)]
    terms = [
        (tuple(map(int, p)), Fraction(float(surface.coefficients[tuple(p)]))) for p in np.argwhere(surface.coefficients)
    ]
    degree = max(sum(p) for p, _ in terms)
    total = sum(
        (c * norm ** (degree - sum(p)) * back[0] ** p[0] * back[1] ** p[1] * back[2] ** p[2] for p, c in terms),
        Polynomial(),
    )
    assert all(Fraction(float(c)) == c for c in total.values())
    return surface_in(total, side)


CLOSED = {"sphere_ellipsoid": 4, "spheres_apart": 6, "torus_tilted_torus": 4}


def check_turned(name, seed):
    case = BY_NAME[name]
    quaternion = np.random.default_rng(seed).integers(-3, 4, 4) | np.array([1, 0, 0, 0])
    a, b = (turned(s, quaternion, CLOSED[name]) for s in (case.a, case.b))
    pair = tuple(jhd.ImplicitSurface(s.coefficients, s.lower, s.upper) for s in (a, b))
    check(pair, (case.ab, case.ba), jhd.BranchAndBound(atol=tolerance_of(case, FINE)), name)


@pytest.mark.slow
def test_bounds_enclose_the_distance_after_a_turn():
    check_turned("sphere_ellipsoid", 1)


@pytest.mark.parametrize(
    ("name", "seed"),
    swept(itertools.product(CLOSED, range(2, 8)), slow=[("spheres_apart", 2)]),
)
def test_bounds_enclose_the_distance_after_turns(name, seed):
    check_turned(name, seed)


@pytest.mark.parametrize("name", swept([c.name for c in CASES if "degenerate" not in c.tags], slow=SLOW[4::3]))
def test_a_witness_lies_on_its_surface_and_its_feet_on_the_other(name):
    case = BY_NAME[name]
    a, b = surfaces(case)
    found = jhd.directed_hausdorff(a, b, throw=False)
    scale = float(np.max(np.asarray(a.upper) - np.asarray(a.lower)))
    for surface, points in ((a, found.witness.point[None]), (b, found.witness.feet)):
        assert np.all((np.asarray(points) >= surface.lower) & (np.asarray(points) <= surface.upper))
        slope = np.linalg.norm(np.asarray(surface.gradient(points)), axis=1)
        size = np.sum(np.abs(np.asarray(surface.coefficients)))
        # At a singular point the value is of second order.
        assert np.all(np.abs(np.asarray(surface(points))) <= np.maximum(1e-9 * scale * slope, 1e-12 * size))
    distances = np.linalg.norm(np.asarray(found.witness.feet) - np.asarray(found.witness.point), axis=1)
    assert np.allclose(distances, float(found.value), rtol=1e-6, atol=1e-12 * scale)
    # A branch of `jax.lax.cond` refuses a solution with a weakly typed index beside one of another kind.
    assert not any(x.weak_type for x in jax.tree_util.tree_leaves(found))


SINGLE = """
import jhd
import os
import subprocess
import sys
from fractions import Fraction
from tests.surface_cases import BY_NAME
for name in ("sphere_ellipsoid", "crossed_cylinders", "hyperboloid_cylinder", "apex_over_a_plane"):
    case = BY_NAME[name]
    a, b = (jhd.ImplicitSurface(*s) for s in (case.a, case.b))
    for pair, exact in (((a, b), case.ab.value), ((b, a), case.ba.value)):
        found = jhd.directed_hausdorff(*pair, throw=False)
        lower, upper = Fraction(float(found.lower)), Fraction(float(found.upper))
        assert found.lower.dtype == "float32"
        assert lower <= Fraction(exact) <= upper <= lower + Fraction(1, 100), (name, found)
print("done")
"""


@pytest.mark.exhaustive
def test_in_single_precision_the_bounds_stay_true_and_close():
    environment = os.environ | {"JAX_ENABLE_X64": "0"}
    assert python("-c", SINGLE, env=environment).stdout.strip() == "done"
