"""Cells of a mesh that are cut along a line are all of it, and none lies on both sides."""

from fractions import Fraction

import numpy as np

from jhd._distance.search.weighted_cells import MeasuredMesh

UNIT = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# Heights at the corners whose quotients are floats, with one corner alone, a zero, and no change of sign.
HEIGHTS = [(1, -3, -1), (-1, 1, 3), (3, -1, 1), (0, 1, -1), (-1, 0, 3), (1, -3, 0), (1, 2, 0), (0, 0, -1), (0, 0, 0)]


def test_the_parts_along_a_line_are_the_whole_and_on_one_side():
    measured = MeasuredMesh(np.repeat(UNIT[None], len(HEIGHTS), axis=0), 0.0)
    cells, heights = measured.cover(), np.array(HEIGHTS, float)
    parts, parent = measured.cut(cells, measured.flat(cells), heights)
    flat = measured.flat(parts)
    for k, (first, second, third) in enumerate(HEIGHTS):
        corners = flat.corners[parent == k]
        cut = first * second < 0 or second * third < 0 or third * first < 0
        assert len(corners) == (4 if not cut else 2 if 0 in (first, second, third) else 3)
        x, y = corners[..., 0], corners[..., 1]
        areas = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
        assert np.all(areas > 0) and sum(map(Fraction, areas)) == 1
        at = first + x * (second - first) + y * (third - first)
        assert not cut or np.all((np.min(at, axis=1) >= 0) | (np.max(at, axis=1) <= 0))
    assert np.sum(flat.lower) <= len(HEIGHTS) / 2 <= np.sum(flat.upper)
