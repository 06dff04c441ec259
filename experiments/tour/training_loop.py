"""A training loop: a curve moved by the gradient of the soft distance, whose temperature falls.

The last digits come from `jhd.minimise_hausdorff`, which lowers several equal maxima at once.
"""

import jax
import jax.numpy as jnp

import jhd

target = jhd.BezierCurve([(0, 0), (1, 2), (3, 2), (4, 0)])
points = jnp.array([(0.0, 1.0), (1.0, 0.0), (3.0, 0.0), (4.0, 1.0)])


@jax.jit
def step(points, temperature):
    """One step down the slope; the loss is above the distance by at most 4.16 temperatures."""
    loss, slope = jax.value_and_grad(lambda x: jhd.soft_hausdorff(jhd.BezierCurve(x), target, temperature))(points)
    return points - 0.2 * slope, loss


before = jhd.hausdorff(jhd.BezierCurve(points), target)
for k in range(200):
    # From a third of the distance to less and less.
    points, loss = step(points, 0.3 * 0.98**k)
after = jhd.hausdorff(jhd.BezierCurve(points), target)
print(f"from {float(before):.4f} to {float(after):.4f}, proven to lie below {float(after.upper):.4f}")
assert after.upper < 0.1 * before.lower
