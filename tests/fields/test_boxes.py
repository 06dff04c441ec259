"""Children and corners of boxes, and the distances between the points of two of them."""

import itertools
from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from jhd.compiled import compiled
from jhd.fields import boxes

DISTANCE, SQUARES = compiled(boxes.distance), compiled(boxes.squared_distances)
VERTICES = compiled(boxes.vertex_distances)


def test_children_share_out_their_cell():
    parts = boxes.children(np.array([[0, 0, 0], [3, 1, 2]], np.int32))
    assert parts.shape == (16, 3) and parts.dtype == np.int32
    assert set(map(tuple, parts[8:])) == set(itertools.product((6, 7), (2, 3), (4, 5)))


def test_corners_are_those_of_the_box():
    found = boxes.corners(jnp.array([[0.0, 1.0, 2.0]]), jnp.array([[10.0, 11.0, 12.0]]))
    assert found.shape == (1, 8, 3)
    assert [tuple(x) for x in found[0].tolist()] == list(itertools.product((0, 10), (1, 11), (2, 12)))


def both(box, change=jnp.asarray):
    """Two corners, changed."""
    return change(box[0]), change(box[1])


def some_boxes(seed, count):
    """Boxes of all relations: apart, touching, overlapping, one in the other."""
    rng = np.random.default_rng(seed)
    lower = rng.integers(-4, 4, (count, 3)) / 4
    return lower, lower + rng.integers(0, 6, (count, 3)) / 4


def exact_squares(a, b):
    least = most = Fraction(0)
    for low, high, down, up in zip(*a, *b, strict=True):
        ends = [Fraction(float(x)) for x in (low - up, high - down)]
        least += 0 if ends[0] <= 0 <= ends[1] else min(x * x for x in ends)
        most += max(x * x for x in ends)
    return least, most


def test_intervals_hold_the_exact_ends_and_are_tight():
    a, b = some_boxes(0, 200), some_boxes(1, 200)
    found = DISTANCE(both(a), both(b))
    least, most = SQUARES(both(a, np.transpose), both(b, np.transpose))
    for i in range(200):
        exact = exact_squares(*([end[i] for end in box] for box in (a, b)))
        # The numbers are quarters, so the squares are exact.
        assert (Fraction(float(least[i])), Fraction(float(most[i]))) == exact
        lower, upper = Fraction(float(found.lower[i])), Fraction(float(found.upper[i]))
        assert lower**2 <= exact[0] and exact[1] <= upper**2
        assert float(exact[0]) ** 0.5 - float(lower) < 1e-14 and float(upper) - float(exact[1]) ** 0.5 < 1e-14


def test_corners_give_the_same_on_one_grid_and_miss_the_faces_elsewhere():
    cells = np.array(list(np.ndindex(4, 3, 3)), float)
    a, b = (jnp.zeros(3), jnp.ones(3)), (jnp.asarray(cells), jnp.asarray(cells + 1))
    least, most = VERTICES(a, b)
    squares = SQUARES(both(a, lambda x: np.asarray(x)[:, None]), both(b, np.transpose))
    assert np.allclose(least**2, squares[0], rtol=1e-15, atol=0) and np.allclose(
        most**2, squares[1], rtol=1e-15, atol=0
    )
    # A small box before the middle of a large face is nearer than any two corners.
    face = jnp.array([0.0, -5, -5]), jnp.array([1.0, 5, 5])
    small = jnp.array([3.0, -1, -1]), jnp.array([4.0, 1, 1])
    assert float(VERTICES(face, small)[0]) == 6
    assert abs(float(DISTANCE(face, small).lower) - 2) < 1e-14
