# pyright: strict
"""Surfaces: the distance of two cones (implicit surfaces in a box), and the interval of a published method."""

import math

import jhd

box = [-2, -2, -2], [2, 2, 2]
a = jhd.ImplicitSurface.parse("x**2/4 + y**2/4 - z**2/9", *box)
b = jhd.ImplicitSurface.parse("x**2/16 + y**2/4 - z**2/9", *box)
solution = jhd.hausdorff(a, b)
assert solution.lower <= (math.sqrt(43) - 4) / 3 <= solution.upper <= solution.lower + 1e-9
print(solution)

# The published rule treats cells as points. With 64 cells along the box (side 1/16), it gives the published interval.
cells = jhd.hausdorff(a, b, jhd.published.CubeIntervals(64, rule="paper"))
assert (cells.lower, cells.upper) == (math.sqrt(17 / 32), math.sqrt(103 / 128))
print(cells)
