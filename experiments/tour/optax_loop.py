"""An optax loop: a closed B-spline is fitted to noisy points by the squares of their distances.

Needs optax (`pip install optax`).
"""

import jax
import jax.numpy as jnp
import numpy as np
import optax

import jhd

random = np.random.default_rng(0)
angle = np.sort(random.uniform(0, 2 * np.pi, 200))
scan = np.stack([2 * np.cos(angle), np.sin(angle)], axis=1) + 0.01 * random.normal(size=(200, 2))


def spline(control_points):
    """The closed cubic spline with these control points; its knots are fixed."""
    return jhd.BSplineCurve.uniform(control_points, degree=3, periodic=True)


adam = optax.adam(0.05)
loss = jax.value_and_grad(lambda p: jnp.mean(jhd.project(scan, spline(p)).distance ** 2))


@jax.jit
def step(p, state):
    """One step of the optimizer; `scan` is known, and the spline is built inside."""
    value, slope = loss(p)
    change, state = adam.update(slope, state)
    return optax.apply_updates(p, change), state, value


turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
p = jnp.stack([1.5 * jnp.cos(turn), 1.5 * jnp.sin(turn)], axis=1)
state = adam.init(p)
for _ in range(100):
    p, state, value = step(p, state)

print(f"root mean square in the loop: {float(value) ** 0.5:.4f}")
print("the same with certified bounds:", jhd.RMSDistance(directed=True)(jhd.point_set(scan), spline(p)))
assert value**0.5 < 0.02
