"""Local feet: the same steps on the host and in compiled programs, towards roots of (B - P).B'."""

import jax
import jax.numpy as jnp
import numpy as np

from jhd._distance.nearest.feet import equation_of, foot_in, foot_speed, gauss_newton, newton_step, presses
from jhd._distance.normalization.jets import CurveJet, jet, polynomial_jet
from jhd._distance.normalization.pieces import Piece

RNG = np.random.default_rng(3)
POINTS = RNG.normal(size=(4, 2))
QUERIES, PARAMETERS = RNG.normal(size=(50, 2)), RNG.uniform(size=50)
# A few operations on numbers of order one, whose products may be fused or not.
ROUNDING = 1e-12


def test_steps_and_speeds_on_the_host_are_those_of_compiled_programs():
    here = equation_of(QUERIES, polynomial_jet(POINTS[:, None], PARAMETERS[:, None]))
    host = gauss_newton(PARAMETERS, here), foot_speed(PARAMETERS, here, QUERIES[::-1], 0.5)

    @jax.jit
    @jax.vmap
    def compiled(point, velocity, s):
        here = equation_of(point, jet(jnp.asarray(POINTS), None, s))
        return gauss_newton(s, here), foot_speed(s, here, velocity, 0.5)

    for known, found in zip(host, compiled(QUERIES, QUERIES[::-1], PARAMETERS), strict=True):
        assert isinstance(known, np.ndarray)
        np.testing.assert_allclose(known, found, rtol=ROUNDING, atol=ROUNDING)


def test_newton_goes_downhill_where_the_distance_is_not_convex():
    # On the far side of the center of curvature the slope of the equation is negative: the foot is a maximum.
    b = CurveJet(jnp.array([0.0, 0.0]), jnp.array([1.0, 0.0]), jnp.array([0.0, 2.0]))
    here = equation_of(jnp.array([0.1, 1.0]), b)
    assert here.slope < 0 and newton_step(here, 0.25) == 0.25
    assert newton_step(equation_of(jnp.array([-0.1, 1.0]), b), 0.25) == -0.25


def test_feet_stay_in_their_interval_and_are_roots_inside():
    piece, feet = (
        Piece(jnp.asarray(POINTS), None),
        jax.jit(jax.vmap(foot_in, (0, None, 0, None, None, None)), static_argnums=3),
    )
    found = np.asarray(feet(QUERIES, piece, np.clip(PARAMETERS, 0.3, 0.6), 40, 0.3, 0.6))
    assert np.all((found >= 0.3) & (found <= 0.6))
    here = equation_of(QUERIES, polynomial_jet(POINTS[:, None], found[:, None]))
    at_end = (found == 0.3) & (here.residual >= 0) | (found == 0.6) & (here.residual <= 0)
    assert np.all(at_end | (np.abs(here.residual) < ROUNDING * (1 + here.square))) and not at_end.all()


def test_a_foot_is_pressed_against_an_end_where_the_distance_falls_towards_it():
    ends = [(s, slope) for s in (0.0, 1.0) for slope in (-1.0, 1.0)]
    assert [bool(presses(s, slope, 1.0)) for s, slope in ends] == [False, True, True, False]
    assert not presses(0.5, 1.0, 1.0) and not presses(0.0, 1e-9, 1.0)
