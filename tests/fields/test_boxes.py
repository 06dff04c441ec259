"""Children of boxes, and the distances between the points of two of them."""

import itertools
from fractions import Fraction

import jax.numpy as jnp
import numpy as np

from jhd._fields import boxes
from jhd._runtime.compiled import compiled

SQUARES = compiled(boxes.squared_distances)


def test_children_share_out_their_cell():
    parts = boxes.children(np.array([[0, 0, 0], [3, 1, 2]], np.int32))
    assert parts.shape == (16, 3) and parts.dtype == np.int32
    assert set(map(tuple, parts[8:])) == set(itertools.product((6, 7), (2, 3), (4, 5)))


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


def test_squared_distances_are_exact_for_quarters():
    a, b = some_boxes(0, 200), some_boxes(1, 200)
    least, most = SQUARES(both(a, np.transpose), both(b, np.transpose))
    for i in range(200):
        exact = exact_squares(*([end[i] for end in box] for box in (a, b)))
        assert (Fraction(float(least[i])), Fraction(float(most[i]))) == exact
