"""Isolated zeros of a polynomial in three variables, at which it does not change its sign, in exact arithmetic.

As there is no change of sign, neither signs nor enclosures tell whether such a point exists. About a
point p write f as v + g.t + t.H t / 2 + G.n + the rest. Here n >= 0 are the inward coordinates in which p is on a face
of the box and f rises from it, and t are the other coordinates from p, which are free (also if they are on a face). Let
H - m 1 be positive definite, and let the sums of the coefficients prove, in all of a cube about p, that the rest takes
at most m |t|^2 / 4 and less than G.n. In this cube

    f >= v - |g| |t| + c |t|^2 + K.n,   c = m / 4,   K > 0.

So f has no zero in the cube if |g|^2 < 4 c v. Otherwise all zeros lie within a small radius of p. There is a zero if
v < 0, since f is positive farther out, and it is p itself if v and g vanish.

Source: ours.
"""

from collections.abc import Sequence
from fractions import Fraction
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from jhd._arithmetic import exact_polynomials
from jhd._arithmetic.polynomials import ORDERS, SYMMETRIC, powers

# Points closer than this count as one.
_SAME = 1e-6


class IsolatedZero(NamedTuple):
    """A cube about a point, with a radius about the point that contains all zeros in both cube and box."""

    place: list[Fraction]  # the point
    half: float  # half the side of the cube
    radius: float  # bound of the distance of these zeros from the point; negative if there are none
    there: bool  # whether a zero is proven


def isolated_zeros(
    polynomial: np.ndarray, floats: np.ndarray, lower: np.ndarray, upper: np.ndarray, simple: Any
) -> list[IsolatedZero]:
    """Isolated zeros found in a box, one entry each; others may be overlooked.

    Args:
        polynomial: a positive multiple of the polynomial, in integers.
        floats: its coefficients as floats, the largest about one.
        lower: the lower corner of the box.
        upper: the upper corner.
        simple: takes a point as floats; returns a nearby rational point that may be an exact zero, or None.
    """
    found: list[IsolatedZero] = []
    for place, held in _candidates(floats, lower, upper):
        inward = [0 if not h else (1 if x == low else -1) for h, x, low in zip(held, place, lower, strict=True)]
        start = [Fraction(float(x)) for x in place]
        guesses = [start, simple(place)]
        zero = _at_first(polynomial, [g for g in guesses if g is not None], inward, lower, upper)
        zero = zero or _about(polynomial, _sharpened(polynomial, start, inward), inward, lower, upper)
        if zero is not None and not any(_near(zero, other) for other in found):
            found.append(zero)
    return found


def _near(zero: IsolatedZero, other: IsolatedZero) -> bool:
    return max(abs(float(x - y)) for x, y in zip(zero.place, other.place, strict=True)) < _SAME


def _at_first(
    polynomial: np.ndarray, guesses: list[list[Fraction]], inward: list[int], lower: np.ndarray, upper: np.ndarray
) -> IsolatedZero | None:
    """The result of `_about` at the first guess that is an exact zero; None if there is no such guess."""
    for guess in guesses:
        here = exact_polynomials.substituted(polynomial, guess, [Fraction(1)] * 3)
        slopes = [_slope(here, axis) for axis in range(3)]
        if here[0, 0, 0] == 0 and all(s or slope == 0 for s, slope in zip(inward, slopes, strict=True)):
            rising = [s if slope else 0 for s, slope in zip(inward, slopes, strict=True)]
            return _about(polynomial, guess, rising, lower, upper)
    return None


def _slope(polynomial: np.ndarray, axis: int) -> int:
    """The coefficient of the first power of one coordinate."""
    return int(polynomial[tuple(np.eye(3, dtype=int)[axis])]) if polynomial.shape[axis] > 1 else 0


def _sharpened(polynomial: np.ndarray, place: list[Fraction], inward: list[int]) -> list[Fraction]:
    """Refine a point by exact Newton steps until its gradient along the free coordinates is zero to many digits."""
    free = [axis for axis in range(3) if not inward[axis]]
    # Newton steps in exact arithmetic, to 240 bits.
    for _ in range(4 if free else 0):
        here = exact_polynomials.substituted(polynomial, place, [Fraction(1)] * 3)
        unit = max(abs(x) for x in here.flat)
        bent = np.array([[float(Fraction(x, unit)) for x in row] for row in _hessian(here, free)])
        slope = [Fraction(_slope(here, axis), unit) for axis in free]
        size = max(abs(x) for x in slope)
        if size == 0:
            break
        step = np.linalg.solve(bent, [float(x / size) for x in slope])
        place = list(place)
        for axis, move in zip(free, step, strict=True):
            place[axis] = Fraction(round((place[axis] - size * Fraction(float(move))) * 2**240), 2**240)
    return place


def _hessian(here: np.ndarray, free: Sequence[int]) -> list[list[int]]:
    rows = []
    for i in free:
        row = []
        for j in free:
            power = [0, 0, 0]
            power[i] += 1
            power[j] += 1
            inside = all(p < n for p, n in zip(power, here.shape, strict=True))
            row.append((2 if i == j else 1) * int(here[tuple(power)]) if inside else 0)
        rows.append(row)
    return rows


def _about(
    polynomial: np.ndarray, place: list[Fraction], inward: list[int], lower: np.ndarray, upper: np.ndarray
) -> IsolatedZero | None:
    """The zero that the expansion about a point proves or excludes (see the module); None if it proves nothing."""
    free = [axis for axis in range(3) if not inward[axis]]
    ends = [(Fraction(float(lower[k])), Fraction(float(upper[k]))) for k in range(3)]
    if any(not ends[k][0] <= place[k] <= ends[k][1] for k in free):
        return None
    # A rounded guess may lie next to the face: then the box does not begin at the point.
    if any(place[k] != ends[k][0 if inward[k] > 0 else 1] for k in range(3) if inward[k]):
        return None
    here = exact_polynomials.substituted(polynomial, place, [Fraction(1)] * 3)
    rising = [_slope(here, k) * inward[k] for k in range(3) if inward[k]]
    trace = sum(row[i] for i, row in enumerate(_hessian(here, free)))
    sign = -1 if (trace if free else rising[0]) < 0 else 1
    unit = max(abs(x) for x in here.flat) * sign
    least = _least_eigenvalue([[Fraction(x, unit) for x in row] for row in _hessian(here, free)])
    rising = [Fraction(x, unit) for x in rising]
    if least is None or any(x <= 0 for x in rising):
        return None
    size = float(max(upper - lower))
    # The first cube has half the size of the box for its half side, and is halved at most so often.
    for power in range(24):
        half = Fraction(0.5 * size) / (1 << power)
        bent, falling = _rest(here, abs(unit), inward, half)
        if all(2 * x < y for x, y in zip(falling, rising, strict=True)) and (not free or 4 * bent <= least):
            break
    else:
        return None
    value = Fraction(int(here[0, 0, 0]), unit)
    slopes = [Fraction(_slope(here, k), unit) for k in free]
    radius = _radius(value, slopes, least / 4, [x / 2 for x in rising])
    # A point on a face counts as inside: the box extends away from that face.
    inside = all(place[k] in ends[k] or min(place[k] - ends[k][0], ends[k][1] - place[k]) > 2 * radius for k in free)
    thick = all(upper[k] - lower[k] > 2 * radius for k in range(3))
    # A larger radius does not count as isolated: signs resolve larger parts of a surface.
    if radius >= min(0.25 * float(half), 1e-6 * size) or not (inside and thick):
        return None
    return IsolatedZero(place, float(half), radius, value < 0 or (value == 0 and not any(slopes)))


def _least_eigenvalue(matrix: list[list[Fraction]]) -> Fraction | None:
    """A proven positive lower bound of all eigenvalues, or None; one for an empty matrix."""
    if not matrix:
        return Fraction(1)
    least = float(np.linalg.eigvalsh(np.array(matrix, dtype=float))[0])
    if not least > 0:
        return None
    bound = Fraction(0.9 * least)
    rest = [[x - (bound if i == j else 0) for j, x in enumerate(row)] for i, row in enumerate(matrix)]
    for k in range(len(rest)):
        if rest[k][k] <= 0:
            return None
        for i in range(k + 1, len(rest)):
            share = rest[i][k] / rest[k][k]
            rest[i] = [x - share * y for x, y in zip(rest[i], rest[k], strict=True)]
    return bound


def _rest(here: np.ndarray, unit: int, inward: list[int], half: Fraction) -> tuple[Fraction, list[Fraction]]:
    """Bounds of the higher terms in the cube: of terms in t alone divided by |t|^2, of the others divided by each n."""
    held = [axis for axis in range(3) if inward[axis]]
    # Bounds of sqrt(k), k = 0, 1, 2, 3: the distance from the middle of a cube to a corner, in half sides.
    long = half * (Fraction(0), Fraction(1), Fraction(3, 2), Fraction(7, 4))[3 - len(held)]
    bent, falling = Fraction(0), {axis: Fraction(0) for axis in held}
    for power in product(*map(range, here.shape)):
        degree, size = sum(power), abs(Fraction(int(here[power]), unit))
        owner = next((axis for axis in held if power[axis]), None)
        if owner is not None and degree > 1:
            falling[owner] += size * half ** (degree - 1)
        elif owner is None and degree > 2:
            bent += size * long ** (degree - 2)
    return bent, [falling[axis] for axis in held]


def _radius(value: Fraction, slopes: list[Fraction], curved: Fraction, rising: list[Fraction]) -> float:
    """Radius that contains all zeros if f >= value - |slopes| |t| + curved |t|^2 + rising.n; negative for none."""
    square = sum((x * x for x in slopes), Fraction(0))
    under = square - 4 * curved * value
    if under < 0:
        return -1.0
    if value == 0 and square == 0:
        return 0.0
    # Exact numbers may be far below the smallest float.
    tiny = 1e-150
    along = (float(square) ** 0.5 + float(under) ** 0.5) / (2 * float(curved)) + tiny
    inward = max(float(square / (4 * curved) - value), 0.0)
    away = [inward / float(x) + tiny for x in rising]
    # The factor covers the rounding of sums of floats.
    return float(np.sqrt(along**2 + sum(x**2 for x in away))) * (1 + 1e-9)


def _candidates(a: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Points with nearly zero value and gradient and a definite Hessian, each with the coordinates that faces hold."""
    # Five starts along each free axis.
    shares, held = (x.T for x in strata(5))
    x = np.where(shares == 1, upper, lower + (upper - lower) * shares)
    # Newton steps in floating point.
    for k in range(10):
        value, slope, bent = _jets(a, x)
        # Starts whose values are still large are dropped.
        if k == 4:
            x, held, slope, bent = (row[np.abs(value) <= 1e-2] for row in (x, held, slope, bent))
        move = _newton(np.where(held, 0.0, slope), bent, held)
        long = 0.3 * np.max(upper - lower) / np.maximum(np.linalg.norm(move, axis=1), 1e-300)
        x = np.where(held, x, np.clip(x - move * np.minimum(1.0, long)[:, None], lower, upper))
    value, slope, bent = _jets(a, x)
    size = np.max(np.abs(bent), axis=(1, 2)) + np.max(np.abs(slope), axis=1)
    values = np.linalg.eigvalsh(np.where(held[:, :, None] | held[:, None], 0.0, bent))
    # Smaller eigenvalues may be due to rounding, and smaller values and slopes zero.
    least, small = 1e-5 * size[:, None] + 1e-300, 1e-9 * size
    # Held coordinates add eigenvalues zero.
    count = 3 - np.sum(held, axis=1)
    definite = (np.sum(values > least, axis=1) == count) | (np.sum(values < -least, axis=1) == count)
    flat = np.max(np.where(held, 0.0, np.abs(slope)), axis=1) <= small
    inside = np.all(held | ((x > lower) & (x < upper)), axis=1)
    good = definite & flat & inside & (np.abs(value) <= small)
    _, first = np.unique(np.round(x[good] / (_SAME * np.max(upper - lower))), axis=0, return_index=True)
    return [(x[good][k], held[good][k]) for k in first]


def strata(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (3, points) in the unit cube, on its faces, edges and corners, and a mask of the coordinates held there.

    Along each free axis there are `count` points.
    """
    inner = (np.arange(count) + 0.5) / count
    rows, held = [], []
    for stratum in np.ndindex(2, 2, 2):
        axes = [np.array([0.0, 1.0]) if h else inner for h in stratum]
        grid = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(3, -1)
        rows.append(grid)
        held.append(np.broadcast_to(np.array(stratum, bool)[:, None], grid.shape))
    return np.concatenate(rows, axis=1), np.concatenate(held, axis=1)


def _newton(slope: np.ndarray, bent: np.ndarray, held: np.ndarray) -> np.ndarray:
    eye = np.eye(3)
    bent = np.where(held[:, :, None] | held[:, None], eye, bent)
    # A singular Hessian leads to no isolated zero.
    size = np.max(np.abs(bent), axis=(1, 2))
    bent = np.where((np.abs(np.linalg.det(bent)) > 1e-12 * size**3)[:, None, None], bent, eye)
    return np.linalg.solve(bent, slope[..., None])[..., 0]


def _jets(a: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values, gradients and second derivatives at rows of points."""
    along = powers(x.T, max(a.shape), 2)
    # Matrix products here and not `polynomials.jets`, whose sums form all products at once.
    found = np.einsum("oil,ijk->ojkl", along[:, : a.shape[0], 0], a, optimize=True)
    found = np.einsum("pjl,ojkl->opkl", along[:, : a.shape[1], 1], found)
    found = np.einsum("qkl,opkl->opql", along[:, : a.shape[2], 2], found)[tuple(ORDERS.T)]
    return found[0], found[1:4].T, np.moveaxis(found[4 + SYMMETRIC], -1, 0)
