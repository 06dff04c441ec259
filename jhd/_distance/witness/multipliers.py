"""Multipliers of equally near feet: how much each counts in the derivative of a distance.

Let u_k be the unit vectors from the feet to the farthest point p of a, so that the distance to foot k has the slope
u_k.e along a direction e. To first order the distance of b at p + e, with the distances moved by c_k, is
min_k (c_k + u_k.e), and the derivative of its maximum over the directions e into a, a cone C, is by duality of linear
programs

    max over e in C of min_k (c_k + u_k.e)  =  min over l in L of sum l_k c_k,
    L = the l >= 0 of sum one with sum l_k u_k.e <= 0 for all e in C:

no direction into a raises the combined distance. So every l in L gives a derivative between the one-sided derivatives,
in every direction of change, and an l outside of L does not. Inside of a curve or face C is a line or plane, and the
slopes cancel; at an end C is one ray. At a corner of a curve, and at edges and vertices of a mesh, C is a union of rays
or of convex cones, and each of them has its own condition. If these conditions exclude each other, the maximum is the
larger of one on each cone. With two feet, multipliers between them still give a derivative between the one-sided
derivatives; with more feet, one of the generalized derivatives.

Among the admissible multipliers, the ones that weight the nearest foot the most are taken. The derivative then belongs
to the nearest foot, or, also if the tie is not exact, to the point inside of a at which two feet are equally near. If
no multipliers are admissible, the multipliers with the least violation are taken.

Source: Danskin, The theory of max-min and its application to weapons allocation problems (1967); duality as in any
text on linear programming.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from jhd._arithmetic.least_squares import non_negative
from jhd._arithmetic.scaling import unit
from jhd._distance.cells.surfaces import FEET
from jhd._runtime.arrays import varying

# Slopes of unit vectors along unit vectors below this are zero: rounding of feet leaves 1e-12.
_FLAT = 1e-11


def share(first: Float[Array, "*batch rays"], second: Float[Array, "*batch rays"]) -> Float[Array, "*batch"]:
    """Return the largest multiplier of the first of two feet that no ray forbids, from the slopes along each ray.

    If one ray requires more of the first foot than another one allows, the allowed multiplier is returned.
    """
    spread = first - second
    asked = (first > _FLAT) & (spread > 0)
    most = jnp.clip(-second / jnp.where(asked, spread, 1.0), 0.0, 1.0)
    return jnp.min(jnp.where(asked, most, 1.0), axis=-1)


def two_of(
    slopes: Float[Array, "feet 2"],
    active: Bool[Array, " feet"],
    nearest: Int[Array, ""],
    excess: Float[Array, " feet"] | float = 0.0,
) -> tuple[Int[Array, "2"], Float[Array, ""]]:
    """Return two feet that are admissible together, with the nearest if possible, and the multiplier of the first.

    For two rays two feet suffice: the combinations that two inequalities allow, if there are any, meet the border of
    each face of the simplex. They are the feet at the maximum over m in [0, 1] of min_k of (1 - m) f_k + m g_k, with
    the slopes f and g along the rays, which is concave in m.

    Args:
        slopes: slopes of the distances to the feet along both rays.
        active: mask of the feet that count.
        nearest: the nearest foot.
        excess: by how much each foot is farther, as a fraction of how far along the rays the maximum can be.
    """
    f, g = slopes.T + excess
    left, right = (jnp.argmin(jnp.where(active, x, jnp.inf)) for x in (f, g))

    def below(_: Any, lines: tuple[Array, Array]) -> tuple[Array, Array]:
        left, right = lines
        rise, fall = g[left] - f[left], f[right] - g[right]
        m = jnp.clip((f[right] - f[left]) / jnp.where(rise + fall > 0, rise + fall, 1.0), 0.0, 1.0)
        line = jnp.where(active, (1 - m) * f + m * g, jnp.inf)
        lowest = jnp.argmin(line)
        found, rising = line[lowest] < line[left] - _FLAT, g[lowest] > f[lowest]
        return jnp.where(found & rising, lowest, left), jnp.where(found & ~rising, lowest, right)

    # Each round looks below the crossing of the two lines found so far; three feet need one.
    crossing = jax.lax.fori_loop(0, 2, below, varying((left, right), slopes, active, nearest))
    firsts = jnp.stack([nearest, nearest, crossing[0]])
    seconds = jnp.stack([left, right, crossing[1]])
    shares = share(slopes[firsts], slopes[seconds])
    pull = shares[:, None] * slopes[firsts] + (1 - shares)[:, None] * slopes[seconds]
    violation = jnp.max(pull, axis=-1)
    best = jnp.argmax(violation <= jnp.maximum(jnp.min(violation), 0.0) + _FLAT)
    return jnp.stack([firsts[best], seconds[best]]), shares[best]


def balanced_feet(
    point: Float[np.ndarray, "3"],
    feet: Float[np.ndarray, "feet 3"],
    distance: Float[np.ndarray, " feet"],
    limits: tuple[float, float],
    rays: Sequence[Float[np.ndarray, "_ 3"]],
) -> tuple[Any, Any]:
    """Return the rows (FEET,) of the feet that are nearest to a point and balance there, and their multipliers.

    Unused rows repeat the first one, with multiplier zero.

    Args:
        point: the farthest point.
        feet: points that may be nearest to it.
        distance: their distances from the point.
        limits: by how much a foot may be farther than the nearest one, and the distance up to which two feet are one.
        rays: sets of directions along a. The first set that the multipliers balance counts, else the last one.
    """
    (equal, same), least, kept = limits, np.min(distance), [int(np.argmin(distance))]
    for k in np.argsort(distance, kind="stable"):
        if distance[k] <= least + equal and np.min(np.max(np.abs(feet[kept] - feet[k]), axis=1)) > same:
            kept.append(int(k))
    units, excess = unit(point - feet[kept]), (distance[kept] - least) / equal
    for directions in rays:
        shares = balanced(units, directions, excess)
        # Multipliers that balance leave at most this residual.
        if np.max(np.abs(directions @ units.T @ shares), initial=0.0) <= 1e-4:
            break
    chosen = np.flatnonzero(shares)
    unused = FEET - len(chosen)
    return np.array(kept)[np.append(chosen, np.full(unused, chosen[0]))], np.append(shares[chosen], np.zeros(unused))


def balanced(
    units: Float[np.ndarray, "feet 3"], rays: Float[np.ndarray, "rays 3"], excess: Float[np.ndarray, " feet"]
) -> Any:
    """Return the multipliers of any number of feet in space, at most four positive, of least violation.

    They minimize |max(sum l_k u_k.e_r, 0)|, as least squares with one more unknown for each ray that may fall.

    Args:
        units: unit vectors from the feet to the point.
        rays: vectors whose combinations are the directions into a.
        excess: by how much each foot is farther than the nearest, as a fraction of the margin of equally near feet.
    """
    feet, count = len(units), len(rays)
    rows = np.zeros((count + feet + 1, feet + count))
    rows[:count, :feet], rows[:count, feet:] = rays @ units.T, np.eye(count)
    # Penalty, in units of a violation, for replacing the nearest foot by the farthest foot that counts as equally near.
    rows[count:-1, :feet] = 1e-4 * np.diag(excess)
    rows[-1, :feet] = 1.0
    found = non_negative(rows, np.append(np.zeros(count + feet), 1.0))[:feet]
    found = _of_sum_one(found)
    if np.count_nonzero(found) > FEET:
        # Four vectors in space give every combination that more vectors give.
        used = np.flatnonzero(found)
        pull = np.append(found @ units, 1.0)
        found[used] = _of_sum_one(non_negative(np.vstack([units[used].T, np.ones(len(used))]), pull))
    # Multipliers below this are zero: the violation is no larger then.
    return _of_sum_one(np.where(found > 1e-6, found, 0.0))


def _of_sum_one(found: Float[np.ndarray, " feet"]) -> Any:
    """Return multipliers divided by their sum; the first foot gets one if all are zero."""
    total = found.sum()
    return found / total if total > 0 else np.eye(len(found))[0]
