"""Implicit surfaces against pieces of other shapes, where the distance is about constant along circles or regions."""

import numpy as np
import pytest

import jhd

# A circle of four quadratic arcs.
CIRCLE = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]], float)
WEIGHTS = np.array([1, np.sqrt(0.5)] * 4 + [1])
KNOTS = np.repeat(np.arange(5.0), [3, 2, 2, 2, 3])
BOX = [-1.75] * 3, [1.75] * 3


def rational_torus(tube):
    """About z, its tube about the unit circle, in 16 patches."""
    section = np.array([1.0, 0.0]) + tube * CIRCLE
    net = np.empty((9, 9, 3))
    net[..., :2] = CIRCLE[:, None] * section[None, :, :1]
    net[..., 2] = section[:, 1]
    return jhd.BSplineSurface(net, KNOTS, KNOTS, WEIGHTS[:, None] * WEIGHTS)


def polynomial_torus(tube):
    return jhd.ImplicitSurface.parse(f"(x**2 + y**2 + z**2 + {1 - tube**2})**2 - 4*(x**2 + y**2)", *BOX)


SPHERE = jhd.ImplicitSurface.parse("x**2 + y**2 + z**2 - 1", *BOX)
# The farthest point of the sphere is a pole, all points of a circle of the torus are as near to it.
CASES = {
    "sphere": (SPHERE, 0.375, np.sqrt(2) - 0.375, 1024),
    "offset": (polynomial_torus(0.375), 0.375 + 2**-4, 2**-4, 2**15),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_families_close_with_few_cells(name):
    a, tube, exact, most = CASES[name]
    atol = 1e-6 * 3.5 * np.sqrt(3)
    found = jhd.directed_hausdorff(a, rational_torus(tube), jhd.BranchAndBound(atol=atol))
    # Weights of circles and coefficients are rounded.
    assert float(found.lower) <= exact + 1e-15
    assert float(found.upper) >= exact - 1e-15
    assert float(found.upper - found.lower) <= atol * (1 + 1e-9)
    assert int(found.stats["cells"]) < most
