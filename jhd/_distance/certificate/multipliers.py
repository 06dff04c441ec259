"""Multipliers that prove the bound of a cell, found by linear programs.

The polynomial that must not be negative,

    sum_k (l_k P_k + m_k f_b) + m f_a

as in `verification.inequalities`, is linear in all multipliers, which are affine in the cell and in the points along
the feet. If there is room, all of its Bernstein coefficients are made positive. If the bound is sharp, they cannot be:
at points where all polynomials are zero it does not depend on their multipliers, and the one of these points at which
the largest slack is smallest is tight. There the polynomial must have no slope. It is made convex by conditions on
second derivatives, with directions added where it is not convex.

Without implicit surfaces, a combination of slacks that are about zero at the tight point bends upward there if each
multiplier grows where its slack grows. So it is made positive on samples that are dense near that point.
"""

from collections.abc import Callable
from functools import cache
from itertools import combinations_with_replacement, product
from typing import NamedTuple

import numpy as np

from jhd._distance.certificate.verification.polynomials import exponents, multinomials

# A slack above this fraction of the largest is not tight. The tight point is searched in this many rounds, from scratch
# and from a known neighborhood, each with this many points in a region that shrinks by this factor.
TIGHT, _ZOOMS, _ZOOM, _TRIED = 0.03, (4, 11), 0.25, 16
# The largest multiplier of polynomials whose largest value is one, over the largest slack; the cost of a sum of them.
LARGEST, COST = 30.0, 1e-4
# The second derivative that is enough, the least one that is taken, and roots of one that are as good as zero.
_GROWTH, _CONVEX, _FLAT = 1.0, 0.1, 1e-8
# Differences that stand for first and second derivatives, and slopes that count as zero, over the root of the slack, in
# the unit of the second derivatives.
_DIFFERENCE, _BENT, SLOPE = 1e-7, 1e-3, 0.05
# The fraction of the slack at a tight point that is kept everywhere, and the least square of a distance to it.
KEPT, LEAST_FAR = 0.5, 1e-7
# Fractions of the way from the tight point to a corner, or to the middle of two, at which samples lie.
_SHARES = 2.0 ** -np.arange(1, 25)


class Terms(NamedTuple):
    """Factors of the multipliers at samples: slacks of the feet, and the polynomials there and on the source."""

    slacks: np.ndarray  # (feet, samples), divided by the square of the bound
    there: np.ndarray  # (feet, samples), or no rows if the target is no implicit surface
    here: np.ndarray | None  # (samples,), or None if the source is no implicit surface


class SurfaceMultipliers(NamedTuple):
    """Multipliers of the feet (None for one foot), of the polynomials of the feet, and of the source's polynomial."""

    feet: list[list[float]] | None
    there: list[list[float]]
    here: list[float] | None


# Returns the terms at barycentric coordinates (samples, corners) and positions (samples, feet) from -1 to 1.
Evaluate = Callable[[np.ndarray, np.ndarray], Terms]
# Returns the coordinates and positions near given coordinates at which all polynomials are zero, as many as there are.
Constrain = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class TightPlace(NamedTuple):
    """The admissible point at which the largest slack is smallest, and this slack."""

    u: np.ndarray
    s: np.ndarray
    least: float

    @property
    def is_clear(self) -> bool:
        """Return whether the slack is large everywhere."""
        return self.least > TIGHT


class Program(NamedTuple):
    """A linear program for multipliers."""

    fixed: int  # number of leading variables, which are not negative and have the sum one
    most: float  # largest absolute value of the other variables
    slopes: np.ndarray  # rows whose products with the variables are not negative, up to `slope`
    slope: float = 0.0  # tolerance of these products
    price: float = COST  # cost of the other variables if all are as large as possible

    def solved(self, rows: np.ndarray, far: np.ndarray, least: float) -> np.ndarray | None:
        """Return variables with all rows at least `least` + t `far` for the largest t; None if t is not positive.

        Args:
            rows: coefficients of the variables.
            far: positive, one for each row.
            least: lower bound of all rows.
        """
        from scipy.optimize import linprog

        count = rows.shape[1]
        free = count - self.fixed
        sizes = (far + least)[:, None]
        # Numbers of any sign are differences of two positive ones, whose sum costs a little.
        above = np.concatenate([-rows, rows[:, self.fixed :], far[:, None]], axis=1) / sizes
        slopes = np.concatenate([-self.slopes, self.slopes[:, self.fixed :]], axis=1)
        above = np.concatenate([above, np.pad(slopes, ((0, 0), (0, 1)))])
        limits = np.append(-least / sizes[:, 0], np.full(len(slopes), self.slope))
        total = np.zeros((1, count + free + 1))
        total[0, : self.fixed] = 1.0
        bounds = [(0, None)] * self.fixed + [(0, self.most)] * (2 * free) + [(None, _GROWTH)]
        cost = np.concatenate([np.zeros(self.fixed), np.full(2 * free, self.price / self.most), [-1.0]])
        options = {"primal_feasibility_tolerance": 1e-9, "dual_feasibility_tolerance": 1e-9}
        done = linprog(cost, A_ub=above, b_ub=limits, A_eq=total, b_eq=[1.0], bounds=bounds, options=options)
        if done.status != 0 or done.x[-1] <= (_CONVEX if len(slopes) else 0.0):
            return None
        x = done.x[:count].copy()
        x[self.fixed :] -= done.x[count:-1]
        return x


def sampled_multipliers(slack: Callable[[np.ndarray], np.ndarray], grid: np.ndarray) -> list[list[float]] | None:
    """Return affine multipliers, by their values at the corners, for which a sum of slacks is positive on samples.

    Args:
        slack: evaluates slacks (feet, samples), over the squared bound, at barycentric coordinates (samples, corners).
        grid: a few points all over the cell.

    Returns:
        A row for each foot, or None if none are found.
    """
    corners = grid.shape[1]
    draw, tried, q, reach = np.random.default_rng(corners), grid, grid[0], 1.0
    for _ in range(28):
        q = tried[np.argmin(np.max(slack(tried), axis=0))]
        reach *= 0.5
        tried = np.concatenate([q[None], on_sides(q + reach * (_drawn(draw, corners) - q), q, reach)])
    towards = np.concatenate([np.eye(corners), 0.5 * (np.eye(corners) + np.roll(np.eye(corners), 1, axis=1))])
    shares = np.concatenate([grid, (q + _SHARES[:, None, None] * (towards - q)).reshape(-1, corners)])
    far = np.append(np.ones(len(grid)), np.repeat(_SHARES, len(towards)))
    slacks, here = slack(shares), slack(q[None])[:, 0]
    # Feet that are far at q would hide the others there; they take part only if the others do not suffice.
    # A slack that is smaller by this fraction of the largest one belongs to a foot that is far away.
    for active in (here >= here.max() - 1e-2 * np.max(np.abs(slacks)), np.ones(len(here), bool)):
        # Fractions of the largest slack at each sample.
        rows = slacks[active] / np.maximum(np.max(np.abs(slacks[active]), axis=0), 1e-300)
        columns = np.concatenate([shares * row[:, None] for row in rows], axis=1)
        x = Program(columns.shape[1], 1.0, np.zeros((0, columns.shape[1]))).solved(columns, far, 0.0)
        if x is not None:
            found = iter((np.round(x * 2.0**30) / 2.0**30).reshape(len(rows), corners).tolist())
            return [next(found) if each else [0.0] for each in active]
    return None


def plain_multipliers(
    evaluate: Evaluate, tight: TightPlace, feet: int, degrees: tuple[int, int]
) -> SurfaceMultipliers | None:
    """Return multipliers that make all Bernstein coefficients positive, so that no cut is needed; None without.

    Args:
        evaluate: returns the terms at any points.
        tight: the tight point, with a positive slack.
        feet: number of feet.
        degrees: degrees of the polynomial, in the cell and along each foot.
    """
    corners, intervals = len(tight.u), len(tight.s)
    nodes, matrix = _interpolation(corners, degrees[0])
    along, back = _interpolation(2, degrees[1])
    ends, places = along @ np.array([-1.0, 1.0]), np.zeros((1, 0))
    for _ in range(intervals):
        places = np.concatenate([np.repeat(places, len(ends), axis=0), np.tile(ends, len(places))[:, None]], axis=1)
        matrix = np.kron(matrix, back)
    # Coefficients of the largest polynomial that is made positive at once.
    if len(matrix) > 1200:
        return None
    shares, places = np.repeat(nodes, len(places), axis=0), np.tile(places, (len(nodes), 1))
    rows = _MultiplierRows(evaluate(shares, places), shares, places)
    rows.rows = matrix @ rows.rows
    far = np.sum((shares - tight.u) ** 2, axis=1)
    # If there is room, the coefficients are as large as possible, near a tight point as large as possible there.
    far = np.ones(len(far)) if tight.is_clear else np.maximum(far, LEAST_FAR)
    least = 0.0 if tight.is_clear else KEPT * tight.least
    x = rows.solved(far, least, 10 * COST)
    return None if x is None else rows.written(x, corners, feet, intervals)


@cache
def _interpolation(corners: int, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes of a simplex, and the matrix from values at the nodes to Bernstein coefficients."""
    terms = np.array(exponents(corners, degree))
    nodes = terms / max(degree, 1) if degree else np.full((1, corners), 1 / corners)
    powers = np.prod(nodes[:, None] ** terms[None], axis=-1)
    return nodes, np.linalg.inv(powers * np.array(multinomials(corners, degree)))


def convex_multipliers(evaluate: Evaluate, tight: TightPlace, feet: int) -> SurfaceMultipliers | None:
    """Return multipliers for a polynomial that is convex and has no slope at the tight point; None if none exist.

    Args:
        evaluate: returns the terms at any points.
        tight: the tight point, with a positive slack.
        feet: number of feet.
    """
    u, s, _ = tight
    corners, intervals = len(u), len(s)
    ends = np.array(list(product([-1.0, 1.0], repeat=intervals))).reshape(2**intervals, intervals)
    shares = np.concatenate([u[None], np.repeat(np.eye(corners), len(ends), axis=0)])
    places = np.concatenate([s[None], np.tile(ends, (corners, 1))])
    rows = _MultiplierRows(evaluate(shares, places), shares, places)
    bends = _bends(rows, evaluate, shares, places)
    size = bends.shape[1]
    if not size:
        return None
    sizes = unit_of(bends[..., : rows.fixed])
    slopes = _slopes(rows, evaluate, u, s, sizes)
    program = Program(rows.fixed, rows.most, slopes, slope=SLOPE * float(np.sqrt(tight.least)))
    x = convex(program, bends / (sizes[:, None] * sizes)[:, :, None])
    return None if x is None else rows.written(x, corners, feet, intervals)


def unit_of(bends: np.ndarray) -> np.ndarray:
    """Return a unit for each direction: roots of second derivatives (places, directions, directions, columns)."""
    sizes = np.sqrt(np.max(np.abs(np.einsum("maac->mac", bends)), axis=(0, 2)))
    return np.maximum(sizes, max(_FLAT * float(np.max(sizes, initial=0.0)), _FLAT**2))


def convex(program: Program, bends: np.ndarray) -> np.ndarray | None:
    """Return variables for which the second derivatives are positive definite at all points; None if none exist."""
    axes = np.eye(bends.shape[1])
    pairs = [axes[a] + w * axes[b] for a in range(len(axes)) for b in range(a) for w in (-1, 1)]
    directions = np.array([*axes, *pairs])
    rows = np.einsum("mabc,ra,rb->mrc", bends, directions, directions).reshape(-1, bends.shape[-1])
    far = np.tile(np.sum(directions**2, axis=1), len(bends))
    # Rounds in which directions are added.
    for _ in range(8):
        x = program.solved(rows, far, 0.0)
        if x is None:
            return None
        values, vectors = np.linalg.eigh(np.einsum("mabc,c->mab", bends, x))
        if np.min(values) > 0.5 * _CONVEX:
            return x
        low = vectors[:, :, 0]
        rows = np.concatenate([rows, np.einsum("mabc,ma,mb->mc", bends, low, low)])
        far = np.concatenate([far, np.ones(len(low))])
    return None


def _bends(rows: "_MultiplierRows", evaluate: Evaluate, shares: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the second derivatives of the rows at some points, (places, directions, directions, columns)."""
    corners, intervals = shares.shape[1], places.shape[1]
    steps = [(np.eye(corners)[k] - np.eye(corners)[0], np.zeros(intervals)) for k in range(1, corners)]
    steps += [(np.zeros(corners), np.eye(intervals)[k]) for k in range(intervals)]
    found = np.zeros((len(shares), len(steps), len(steps), rows.rows.shape[1]))
    for a, b in combinations_with_replacement(range(len(steps)), 2):
        total = np.zeros_like(found[:, 0, 0])
        for p, q in product((-_BENT, _BENT), repeat=2):
            u = shares + p * steps[a][0] + q * steps[b][0]
            s = places + p * steps[a][1] + q * steps[b][1]
            total += np.sign(p * q) * rows.of(evaluate(u, s), u, s)
        found[:, a, b] = found[:, b, a] = total / (4 * _BENT * _BENT)
    return found


def tight_place(
    evaluate: Evaluate, constrain: Constrain, corners: int, intervals: int, near: np.ndarray | None = None
) -> TightPlace | None:
    """Return the tight point; None if none is found in a cell of one corner.

    Args:
        evaluate: returns the terms at any points.
        constrain: returns the nearest admissible points.
        corners: number of corners of the cell.
        intervals: number of feet with an interval of points along them.
        near: barycentric coordinates of a nearby point, around which the search starts in a smaller region.
    """
    draw = np.random.default_rng(corners + 64 * intervals)
    if near is None:
        tried = np.concatenate([np.eye(corners), _drawn(draw, corners)])
        reach, zooms = 0.5, _ZOOMS[0]
    else:
        tried, reach, zooms = near[None], 0.25, _ZOOMS[1]
    best: TightPlace | None = None
    for _ in range(zooms):
        u, s = constrain(tried)
        if len(u):
            values = np.max(evaluate(u, s).slacks, axis=0)
            k = int(np.argmin(values))
            if best is None or values[k] < best.least:
                best = TightPlace(u[k], s[k], float(values[k]))
        if best is None or corners == 1 or best.is_clear or best.least < -TIGHT:
            break
        tried = on_sides(best.u + reach * (_drawn(draw, corners) - best.u), best.u, reach)
        reach *= _ZOOM
    if best is None and corners > 1:
        # A cell without admissible points, not known to be free of them, has room.
        return TightPlace(np.full(corners, 1 / corners), np.zeros(intervals), 1.0)
    return best


def _drawn(draw: np.random.Generator, corners: int) -> np.ndarray:
    """Draw barycentric coordinates of random points, some of them on sides."""
    if corners == 1:
        return np.ones((1, 1))
    shares = draw.dirichlet(np.full(corners, 0.7), size=_TRIED)
    kept = draw.uniform(size=shares.shape) < np.where(np.arange(_TRIED) % 2, 0.6, 1.0)[:, None]
    return np.where(kept.sum(axis=1, keepdims=True) > 1, _normal(shares * kept), shares)


def on_sides(shares: np.ndarray, center: np.ndarray, reach: float) -> np.ndarray:
    """Return points, a third of them moved to the sides that hold `center`, and a third to the sides near them."""
    number = np.arange(len(shares))[:, None] % 3
    kept = np.where(number == 1, center > 0, np.where(number == 2, shares >= reach, True))
    return np.where(kept.any(axis=1, keepdims=True), _normal(shares * kept), shares)


def _normal(shares: np.ndarray) -> np.ndarray:
    total = shares.sum(axis=1, keepdims=True)
    return shares / np.where(total > 0, total, 1.0)


def _slopes(rows: "_MultiplierRows", evaluate: Evaluate, u: np.ndarray, s: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the derivatives of the rows at a point in all directions that stay in the domain, each of length one."""
    ends = [(corner, s) for corner in np.eye(len(u))]
    for k in range(len(s)):
        for end in (-1.0, 1.0):
            if s[k] != end:
                ends.append((u, np.where(np.arange(len(s)) == k, s[k] + np.sign(end - s[k]), s)))
    steps = np.array([[0.0], [_DIFFERENCE]])
    found = []
    for to_u, to_s in ends:
        shares, places = u + steps * (to_u - u), s + steps * (to_s - s)
        values = rows.of(evaluate(shares, places), shares, places)
        length = float(np.linalg.norm(sizes * np.concatenate([(to_u - u)[1:], to_s - s])))
        found.append((values[1] - values[0]) / (_DIFFERENCE * max(length, _DIFFERENCE)))
    return np.array(found)


class _MultiplierRows:
    """The linear program: a row for each sample, a column for each number of the multipliers, or one for a constant.

    Args:
        terms: the terms at the samples.
        shares: barycentric coordinates of the samples.
        places: positions along the feet.
    """

    def __init__(self, terms: Terms, shares: np.ndarray, places: np.ndarray):
        self.scales = [max(float(np.max(np.abs(row))), 1e-300) for row in terms.there]
        self.scale = 1.0 if terms.here is None else max(float(np.max(np.abs(terms.here))), 1e-300)
        self.rows = self.of(terms, shares, places)
        # Larger ones only make the polynomial harder to prove.
        self.most = LARGEST * max(float(np.max(np.abs(terms.slacks))), 1.0)
        self.fixed = len(terms.slacks) * shares.shape[1] if len(terms.slacks) > 1 else 1

    def of(self, terms: Terms, shares: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the rows of samples."""
        if len(terms.slacks) == 1:
            columns = [terms.slacks[0][:, None]]
        else:
            columns = [shares * row[:, None] for row in terms.slacks]
        for k, (row, scale) in enumerate(zip(terms.there, self.scales, strict=True)):
            ends = np.stack([(1 - places[:, k]) / 2, (1 + places[:, k]) / 2], axis=1)
            both = (shares[:, :, None] * ends[:, None]).reshape(len(shares), -1)
            columns.append(both * (row / scale)[:, None])
        if terms.here is not None:
            columns.append(shares * (terms.here / self.scale)[:, None])
        return np.concatenate(columns, axis=1)

    def solved(self, far: np.ndarray, least: float, price: float) -> np.ndarray | None:
        """Return variables with all rows at least `least` + t `far` for the largest t; None if t is not positive."""
        program = Program(self.fixed, self.most, np.zeros((0, self.rows.shape[1])), price=price)
        return program.solved(self.rows, far, least)

    def written(self, x: np.ndarray, corners: int, feet: int, intervals: int) -> SurfaceMultipliers:
        """Return the multipliers in the unit of the terms."""
        used = 1 if feet == 1 else feet * corners
        rows = None if feet == 1 else few_bits(x[:used] + 1e-9).reshape(feet, corners).tolist()
        there = []
        for k in range(intervals):
            there.append(few_bits(x[used : used + 2 * corners] / self.scales[k]).tolist())
            used += 2 * corners
        here = few_bits(x[used:] / self.scale).tolist() if used < len(x) else None
        return SurfaceMultipliers(rows, there, here)


def few_bits(x: np.ndarray) -> np.ndarray:
    """Return nearby numbers with few digits."""
    size = float(np.max(np.abs(x)))
    if size == 0:
        return x
    # Multipliers are rounded to multiples of this fraction of the largest.
    unit = 2.0 ** np.floor(np.log2(size)) / 2.0**44
    return np.round(x / unit) * unit
