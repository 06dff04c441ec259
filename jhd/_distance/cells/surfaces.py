"""Proven upper bounds of the distance over parts of implicit surfaces, for many cells at once, from feet.

A cell C is a box. With f_a zero on a, and q_k points of b, every point p of a in C has

    d(p, b)^2 <= min_k |p - q_k|^2 <= sum_k w_k |p - q_k|^2 - lambda f_a(p)

for all weights w in the simplex and all real lambda; so the largest Bernstein coefficient of the right side over C is a
bound. The weights and lambda that are tried make its gradient over a vanish, along the borders of the box too, which
leaves a slack of second order in the size of C at maxima of every kind.

Rounding: for forms and squared distances see jhd._distance.nearest.forms. The mean of some points is a float with an
error mu of its own, which adds 2 sum (|c_i - q_i| + h_i) mu_i, since

    sum_k w_k |p - q_k|^2 = |p - q|^2 + 2 (p - q).(q - sum_k w_k q_k) + sum_k w_k |q_k - q|^2   for every q.

Source: the bounds are ours. Bernstein form: Farouki & Rajan, CAGD 5 (1988).
"""

from itertools import combinations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jhd._arithmetic.rounding import gamma, round_up, smallest_normal, unit_roundoff
from jhd._distance.nearest.forms import Boxes, Form, finite_or_zero, positive, squares

# Feet that a cell carries: three balance on a smooth part of a, a fourth one at a singular point.
FEET = 4
# Pairs of weights and lambda that are evaluated in full, the best ones by a linear estimate.
_TRIED = 3
_PAIRS, _TRIPLES = (np.array(list(combinations(range(FEET), k))) for k in (2, 3))


def upper_bounds(
    form_a: Form,
    cells: Boxes,
    feet: Float[Array, "feet 3 cells"],
    radius: Float[Array, "feet cells"],
    free: Bool[Array, "3 cells"],
) -> Float[Array, " cells"]:
    """Upper bounds of d(p, b) over the points p of a in cells.

    Args:
        form_a: the polynomial of a on the cells.
        cells: the cells.
        feet: points close to b; unused entries repeat another one.
        radius: each foot has a point of b proven within its radius; the largest radius is added to the bound.
        free: whether a cell does not touch the box of a in each coordinate.
    """
    weights, factors = _trials(form_a, cells, feet, free)
    first = feet[0]
    others = feet[1:] - first
    moved = jnp.sum(weights[:, 1:, None] * others, axis=1)
    mean = first + moved
    u = unit_roundoff(mean.dtype)
    wrong = 4 * u * jnp.abs(mean) + 16 * u * jnp.sum(weights[:, 1:, None] * jnp.abs(others), axis=1)
    spread = jnp.sum((feet - mean[:, None]) ** 2, axis=2)
    variance = jnp.sum(weights * spread, axis=1)
    quadratic = squares(mean, cells, form_a.local.shape[0])
    reach = jnp.abs(cells.center - mean) + cells.half
    size = jnp.sum(reach**2, axis=1) + jnp.max(spread, axis=1)
    values = quadratic + variance[:, None] - factors[:, None] * form_a.terms
    error = gamma(24, size.dtype) * size + 2 * jnp.sum(reach * wrong, axis=1) + jnp.abs(factors) * form_a.error
    bound = jnp.min(_finite(jnp.max(values, axis=1) + 1.01 * error), axis=0)
    # Six roundings of the last sums and of the root.
    length = jnp.sqrt(jnp.maximum(bound, 0.0)) * (1 + 8 * u) + smallest_normal(mean.dtype) ** 0.5
    return round_up(length + jnp.max(radius, axis=0))


def _trials(form_a: Form, cells: Boxes, feet: Array, free: Array) -> tuple[Array, Array]:
    """Weights (trials, feet, cells) and factors lambda (trials, cells), none of which needs to be good."""
    apart = cells.center - feet
    pulls = 2 * apart * cells.half
    slope = form_a.slope
    singles = jnp.eye(FEET, dtype=pulls.dtype)[..., None] * jnp.ones_like(pulls[0, 0])
    weights, factors = [singles, *[singles] * 3], [jnp.zeros_like(pulls[:, 0])]
    factors += [pulls[:, i] / jnp.where(slope[i] != 0, slope[i], jnp.inf) for i in range(3)]

    def within(mask: Array) -> tuple[Array, Array]:
        seen = jnp.where(mask, pulls, 0.0)
        chosen = jnp.concatenate([singles, *_balanced(seen, jnp.where(mask, slope, 0.0))])
        pull = jnp.sum(chosen[:, :, None] * seen, axis=1)
        return chosen, jnp.sum(pull * slope, axis=1) / positive(jnp.sum(jnp.where(mask, slope**2, 0.0), axis=0))

    # In the whole space and within the faces in one call: the compiled function is half as large.
    chosen, along = jax.vmap(within)(jnp.stack([jnp.ones_like(free), free]))
    weights.append(chosen.reshape(-1, *chosen.shape[2:]))
    factors.append(along.reshape(-1, along.shape[-1]))
    w, factor = jnp.concatenate(weights), finite_or_zero(jnp.concatenate(factors))
    squares = jnp.sum(apart**2, axis=1)
    pull = jnp.sum(w[:, :, None] * pulls, axis=1)
    linear = jnp.sum(w * squares, axis=1) - factor * form_a.value
    estimate = linear + jnp.sum(jnp.abs(pull - factor[:, None] * slope), axis=1) + jnp.abs(factor) * form_a.rest
    estimate = _finite(estimate)
    best = []
    for _ in range(_TRIED):
        least = jnp.argmin(estimate, axis=0)
        best.append(least)
        estimate = jnp.where(jnp.arange(estimate.shape[0])[:, None] == least, jnp.inf, estimate)
    index = jnp.stack(best)
    return jnp.take_along_axis(w, index[:, None], axis=0), jnp.take_along_axis(factor, index, axis=0)


def _balanced(pulls: Array, slope: Array) -> list[Array]:
    """Weights of pairs and triples of feet whose pulls along the surface cancel as far as they can."""
    along = jnp.sum(pulls * slope, axis=1) / positive(jnp.sum(slope**2, axis=0))
    tangent = pulls - along[:, None] * slope
    x, y = tangent[_PAIRS[:, 0]], tangent[_PAIRS[:, 1]]
    share = jnp.sum(x * (x - y), axis=1) / positive(jnp.sum((x - y) ** 2, axis=1))
    share = finite_or_zero(share)
    pairs = _spread([1 - share, share], _PAIRS)
    x, y, z = (tangent[_TRIPLES[:, k]] for k in range(3))
    areas = [_volume(p, q, slope) for p, q in ((y, z), (z, x), (x, y))]
    return [pairs, _spread(areas, _TRIPLES)]


def _volume(x: Array, y: Array, z: Array) -> Array:
    """The determinant of vectors x, y (sets, 3, cells) and z (3, cells)."""
    first, second, third = (x[:, j] * y[:, k] - x[:, k] * y[:, j] for j, k in ((1, 2), (2, 0), (0, 1)))
    return z[0] * first + z[1] * second + z[2] * third


def _spread(shares: list[Array], places: np.ndarray) -> Array:
    """Weights (sets, feet, cells) of sum at most one from numbers of one sign; the rest goes to the first foot.

    The weight of the first foot is one minus the other weights, so their sum is kept a little below one. The first foot
    need not be in the set.
    """
    shares_of = jnp.stack(shares)
    shares_of = shares_of * jnp.sign(jnp.sum(shares_of, axis=0))
    shares_of = jnp.maximum(shares_of, 0.0)
    total = jnp.sum(shares_of, axis=0)
    part = finite_or_zero(shares_of / positive(total)) * (1 - 16 * unit_roundoff(total.dtype))
    member = places.T[:, :, None, None] == np.arange(FEET)[:, None]
    weights = jnp.sum(jnp.where(member, part[:, :, None], 0.0), axis=0)
    return weights.at[:, 0].set(jnp.maximum(1.0 - jnp.sum(weights[:, 1:], axis=1), 0.0))


def _finite(x: Array) -> Array:
    return jnp.where(jnp.isnan(x), jnp.inf, x)
