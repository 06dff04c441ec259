"""Curves: the distance of two of them with its proof, where it is attained, and its derivative."""

import math

import jax
import jax.numpy as jnp

import jhd

# A parabola and a segment above it, whose middle has two feet, equally near.
parabola = jhd.BezierCurve([(-2, 4), (0, -4), (2, 4)])
ends = jnp.array([(-0.5, 2.0), (0.5, 2.0)])
solution = jhd.directed_hausdorff(jhd.polyline(ends), parabola)
assert solution.lower <= math.sqrt(7) / 2 <= solution.upper
assert solution.event == jhd.EVENTS.one_to_two
print(solution)

# Each foot carries half of the derivative, which is zero sideways.
sideways, up = jax.grad(lambda shift: jhd.directed_hausdorff(jhd.polyline(ends + shift), parabola).value)(jnp.zeros(2))
print(f"moved sideways {sideways:.3g}, moved up {up:.6g}")
assert abs(sideways) < 1e-12 and abs(up - 1 / math.sqrt(7)) < 1e-12

# Is it at most 1.4? That takes fewer steps than the distance.
if jhd.hausdorff_at_most(jhd.polyline(ends), parabola, 1.4, directed=True):
    print("within 1.4, proven")
