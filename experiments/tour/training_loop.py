"""A training loop: gradient descent on the soft distance of a curve, with a falling temperature.

For the last digits, use `jhd.minimize_hausdorff`, which lowers several equal maxima at once.
"""

import jax
import jax.numpy as jnp

import jhd

target = jhd.BezierCurve([(0, 0), (1, 2), (3, 2), (4, 0)])
points = jnp.array([(0.0, 1.0), (1.0, 0.0), (3.0, 0.0), (4.0, 1.0)])


@jax.jit
def step(points, temperature):
    """One gradient step; the loss exceeds the distance by at most log(64) = 4.16 temperatures."""
    loss, slope = jax.value_and_grad(lambda x: jhd.soft_hausdorff(jhd.BezierCurve(x), target, temperature))(points)
    return points - 0.2 * slope, loss


before = jhd.hausdorff(jhd.BezierCurve(points), target)
for k in range(200):
    # The temperature starts at a third of the distance and decreases.
    points, loss = step(points, 0.3 * 0.98**k)
after = jhd.hausdorff(jhd.BezierCurve(points), target)
print(f"from {float(before):.4f} to {float(after):.4f}, certified at most {float(after.upper):.4f}")
assert after.upper < 0.1 * before.lower
