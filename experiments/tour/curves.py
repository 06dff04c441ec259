"""Curves: the distance of two curves with certified bounds, its witness, and its derivative."""

import math

import jax
import jax.numpy as jnp

import jhd

# A parabola and a segment above it. The midpoint of the segment has two foot points at the same distance.
parabola = jhd.BezierCurve([(-2, 4), (0, -4), (2, 4)])
ends = jnp.array([(-0.5, 2.0), (0.5, 2.0)])
solution = jhd.directed_hausdorff(jhd.polyline(ends), parabola)
assert solution.lower <= math.sqrt(7) / 2 <= solution.upper
assert solution.event == jhd.EVENTS.one_to_two
print(solution)

# Each foot point contributes half of the derivative, so moving sideways changes nothing to first order.
sideways, up = jax.grad(lambda shift: jhd.directed_hausdorff(jhd.polyline(ends + shift), parabola).value)(jnp.zeros(2))
print(f"moved sideways {sideways:.3g}, moved up {up:.6g}")
assert abs(sideways) < 1e-12 and abs(up - 1 / math.sqrt(7)) < 1e-12

# A decision takes fewer steps than the distance itself.
if jhd.hausdorff_at_most(jhd.polyline(ends), parabola, 1.4, directed=True):
    print("certified: at most 1.4")
