"""Multipliers that prove that two parts are apart, if at least one of them belongs to an implicit surface.

The polynomial that must not be negative, |x - y|^2 - bound^2 + m f_a(x) + n f_b(y), is linear in the numbers of the
multipliers, one for each corner of a part. Its columns are taken from the exact polynomials, as Bernstein coefficients
and as second derivatives at points; the conditions on them are as in multipliers.
"""

from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from jhd._distance.certificate.multipliers import (
    COST,
    KEPT,
    LARGEST,
    LEAST_FAR,
    SLOPE,
    TIGHT,
    Program,
    convex,
    few_bits,
    on_sides,
    unit_of,
)
from jhd._distance.certificate.sides import AbstractPieces
from jhd._distance.certificate.verification.inequalities import joined, slack_of
from jhd._distance.certificate.verification.pieces import Part, difference
from jhd._distance.certificate.verification.polynomials import elevated, powers_of
from jhd._distance.certificate.verification.zeros import ZeroForm, negative, of_corners, times, value_on

# Points of each part that are tried as nearest ones, and rounds in which more are tried around the nearest.
_TRIED, _ROUNDS = 48, 14


class PairColumns(NamedTuple):
    """Polynomials by exponents (terms, variables) and coefficients (terms, columns), over the sizes of the columns."""

    powers: np.ndarray
    rows: np.ndarray
    sizes: np.ndarray


def pair_multipliers(
    parts: tuple[Part, Part], sides: tuple[AbstractPieces, AbstractPieces], bound: float
) -> list[list[float] | None] | None:
    """Return multipliers for the surfaces among two parts, None for other shapes; None if none are found.

    Args:
        parts: both parts, each on a domain of its own.
        sides: the shapes of the parts.
        bound: the distance to prove.
    """
    mine, other, domain = joined(*parts)
    count = len(parts[0].domain)
    simplices = [list(range(count)), list(range(count, len(domain)))]
    forms = [negative(slack_of(difference(mine, other), bound))]
    for side, part, used in zip(sides, (mine, other), simplices, strict=True):
        if side.zeros is not None:
            value = value_on(side.zeros, part)
            forms += [times(of_corners(row, domain, used), value) for row in np.eye(4).tolist()]
    columns = _columns(forms, domain)
    nearest = _nearest(parts, sides, domain)
    if columns is None or nearest is None:
        return None
    z, distance = nearest
    least = (distance / bound) ** 2 - 1 if bound > 0 else 1.0
    x = _numbers(columns, z, least, domain) if least > 0 else None
    if x is None:
        return None
    x = x / columns.sizes * columns.sizes[0]
    found, used = [], 1
    for side in sides:
        found.append(None if side.zeros is None else few_bits(x[used : used + 4]).tolist())
        used += 0 if side.zeros is None else 4
    return found


def _columns(forms: Sequence[ZeroForm], domain: Sequence[tuple[int, ...]]) -> PairColumns | None:
    """Return the forms as columns of one degree; None if there are too many terms."""
    degree = tuple(map(max, zip(*(form.degree for form in forms), strict=True)))
    terms = [elevated(form.terms, tuple(domain), form.degree, degree) for form in forms]
    codes = sorted(set().union(*terms))
    # Largest number of terms of a polynomial that is tried.
    if len(codes) > 4000:
        return None
    count = 1 + max(map(max, domain))
    powers = np.array([powers_of(code, count) for code in codes])
    rows, sizes = [], []
    for form, found in zip(forms, terms, strict=True):
        size = max(map(abs, found.values()), default=1) or 1
        rows.append([found.get(code, 0) / size for code in codes])
        sizes.append(size / 2.0**form.bits)
    return PairColumns(powers, np.array(rows).T, np.array(sizes))


def _numbers(columns: PairColumns, z: np.ndarray, least: float, domain: Sequence[tuple[int, ...]]) -> np.ndarray | None:
    """Return the numbers of the multipliers after a leading one, in the unit of the columns."""
    from scipy.special import gammaln

    powers, rows, _ = columns
    counts = np.zeros(len(powers))
    for variables in domain:
        mine = powers[:, list(variables)]
        counts += gammaln(mine.sum(axis=1) + 1) - gammaln(mine + 1).sum(axis=1)
    coefficients = rows / np.exp(counts)[:, None]
    scale = np.maximum(np.max(np.abs(coefficients), axis=0), 1e-300)
    coefficients, rows = coefficients / scale, rows / scale
    # The value at the nearest points, in the unit of the first column.
    here = float(np.prod(z**powers, axis=1) @ rows[:, 0])
    clear = here > TIGHT
    degrees = np.maximum(np.stack([powers[:, list(v)].sum(axis=1) for v in domain], axis=1), 1)
    repeats = [len(variables) for variables in domain]
    nodes = powers / np.repeat(degrees, repeats, axis=1)
    far = np.ones(len(powers)) if clear else np.maximum(np.sum((nodes - z) ** 2, axis=1), LEAST_FAR)
    program = Program(1, LARGEST, np.zeros((0, rows.shape[1])), price=10 * COST)
    x = program.solved(coefficients, far, 0.0 if clear else KEPT * here)
    if x is None and not clear and here > 0:
        x = _convex(powers, rows, z, here, domain)
    return None if x is None else x / scale * scale[0]


def _convex(
    powers: np.ndarray, rows: np.ndarray, z: np.ndarray, here: float, domain: Sequence[tuple[int, ...]]
) -> np.ndarray | None:
    """Return numbers that make the polynomial convex, with no slope at the nearest points `z`; None without."""
    count = len(z)
    steps = np.array([np.eye(count)[v] - np.eye(count)[variables[0]] for variables in domain for v in variables[1:]])
    corners = [np.zeros(count)]
    for variables in domain:
        corners = [corner + np.eye(count)[v] for corner in corners for v in variables]
    seconds = np.array([_second(powers, rows, place) for place in (z, *corners)])
    bends = np.einsum("ai,mijc,bj->mabc", steps, seconds, steps)
    sizes = unit_of(bends[..., :1])
    slope = np.array([_derivative(powers, rows, z, i) for i in range(count)])
    ends = np.array([end - z for end in corners])
    # Along the steps: the barycentric coordinates of all corners but the first.
    shares = np.array([[end[v] for variables in domain for v in variables[1:]] for end in ends])
    lengths = np.maximum(np.linalg.norm(shares * sizes, axis=1), 1e-12)
    slopes = (ends @ slope) / lengths[:, None]
    program = Program(1, LARGEST, slopes, slope=SLOPE * float(np.sqrt(here)))
    return convex(program, bends / (sizes[:, None] * sizes)[:, :, None])


def _derivative(powers: np.ndarray, rows: np.ndarray, z: np.ndarray, *along: int) -> np.ndarray:
    """Derivatives in some variables one after the other, (columns,)."""
    factor, lower = np.ones(len(powers)), powers.copy()
    for i in along:
        factor *= lower[:, i]
        lower[:, i] -= 1
    return (factor * np.prod(z ** np.maximum(lower, 0), axis=1)) @ rows


def _second(powers: np.ndarray, rows: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Second derivatives in all variables, (variables, variables, columns)."""
    count = len(z)
    found = np.zeros((count, count, rows.shape[1]))
    for i, j in combinations_with_replacement(range(count), 2):
        found[i, j] = found[j, i] = _derivative(powers, rows, z, i, j)
    return found


def _nearest(
    parts: tuple[Part, Part], sides: tuple[AbstractPieces, AbstractPieces], domain: Sequence[tuple[int, ...]]
) -> tuple[np.ndarray, float] | None:
    """Barycentric coordinates of approximate nearest points of both parts, and their distance; None if one is empty."""
    draw = np.random.default_rng(len(domain))
    best: list[tuple[np.ndarray, np.ndarray]] = []
    reach, distance = 1.0, np.inf
    for _ in range(_ROUNDS):
        found = []
        for k, (part, side) in enumerate(zip(parts, sides, strict=True)):
            shares = _drawn(draw, part.domain, best[k][0] if best else None, reach)
            shares = side.shares_in(_points(part, np.eye(shares.shape[1])), shares) if side.zeros else shares
            points = _points(part, shares)
            if best:
                shares, points = np.concatenate([best[k][0][None], shares]), np.concatenate([best[k][1][None], points])
            found.append((shares, points))
        if not all(len(points) for _, points in found):
            return None
        (u, p), (v, q) = found
        squares = np.sum((p[:, None] - q[None]) ** 2, axis=-1)
        i, j = np.unravel_index(int(np.argmin(squares)), squares.shape)
        best, distance = [(u[i], p[i]), (v[j], q[j])], float(np.sqrt(squares[i, j]))
        # The region of each round as a fraction of the one before.
        reach *= 0.4
    return np.concatenate([best[0][0], best[1][0]]), distance


def _drawn(
    draw: np.random.Generator, domain: Sequence[tuple[int, ...]], center: np.ndarray | None, reach: float
) -> np.ndarray:
    """Draw barycentric coordinates of random points: with the corners at first, then around `center`."""
    found, used = [np.zeros((_TRIED, 0))], 0
    for variables in domain:
        count = len(variables)
        shares = draw.dirichlet(np.full(count, 0.5), size=_TRIED)
        if center is None:
            shares[:count] = np.eye(count)
        else:
            here = center[used : used + count]
            shares = on_sides(here + reach * (shares - here), here, reach)
        found.append(shares)
        used += count
    return np.concatenate(found, axis=1)


def _points(part: Part, shares: np.ndarray) -> np.ndarray:
    """Return the points of a part at barycentric coordinates."""

    def values(f: dict[int, int]) -> np.ndarray:
        found = np.zeros(len(shares))
        for code, c in f.items():
            found += c / 2.0**part.bits * np.prod(shares ** powers_of(code, shares.shape[1]), axis=1)
        return found

    weight = values(part.weight)
    return np.stack([values(f) / weight for f in part.coordinates], axis=-1)
