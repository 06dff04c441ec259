"""Reference values of directed distances between implicit surfaces, by other means than the package's.

`solve` finds a maximum to 60 digits: Newton's method in mpmath on the Lagrange system of the largest squared distance,

    sum w_k (p - q_k) = lambda grad f_a(p),  q_k - p = mu_k grad f_b(q_k),  f_a(p) = 0,  f_b(q_k) = 0,
    |p - q_k|^2 = D,  sum w_k = 1,

where coordinates on a face of the box are constants. It takes coefficients and boxes of any kind of number, so central
differences of it are derivatives to 20 digits.

`counterexamples` looks for points that refute a claimed value: both surfaces are sampled where the lines of a grid
cross them, found by bisection, which includes the faces and the edges of the boxes.
"""

from typing import Any, NamedTuple

import numpy as np
from mpmath import mp, mpf

DIGITS = 60
# Places this near to a face, as a share of the box, lie on it.
_ON_FACE = 1e-9
# Share of the gradient along the faces, below which a surface touches them.
_TOUCHED = 1e-6


class Solved(NamedTuple):
    """A maximum in many digits, with the multipliers of feet and faces, which must not be negative."""

    value: Any
    point: list
    feet: list
    weights: list
    faces: list


class _Place:
    """Unknown coordinates of a point on a surface, the others on faces of its box."""

    def __init__(self, surface, x):
        self.f = {powers: mpf(c) for powers, c in np.ndenumerate(surface.coefficients) if c}
        corners = list(zip(x, surface.lower, surface.upper, strict=True))
        near = [_ON_FACE * (high - low) for _, low, high in corners]
        sides = [-1 if t <= low + n else int(t >= high - n) for (t, low, high), n in zip(corners, near, strict=True)]
        slopes = [abs(self.derivative([mpf(float(t)) for t in x], axis)) for axis in range(3)]
        rest = [slope for slope, side in zip(slopes, sides, strict=True) if side == 0]
        # A face that the surface touches leaves the place to the equations.
        steep = [bool(rest) and max(rest) <= _TOUCHED * max(slopes) < slope for slope in slopes]
        self.outward = [0 if touched else side for touched, side in zip(steep, sides, strict=True)]
        self.walls = [
            None if side == 0 else mpf(low if side < 0 else high)
            for side, (_, low, high) in zip(self.outward, corners, strict=True)
        ]
        self.free = [i for i in range(3) if self.walls[i] is None]
        self.start = [mpf(float(x[i])) for i in self.free]

    def put(self, numbers):
        """All three coordinates."""
        numbers = iter(numbers)
        return [next(numbers) if wall is None else wall for wall in self.walls]

    def derivative(self, x, *axes):
        """A partial derivative of the polynomial."""
        return mp.fsum(self._term(c, powers, x, axes) for powers, c in self.f.items())

    def _term(self, c, powers, x, axes):
        powers = list(powers)
        for axis in axes:
            c *= powers[axis]
            powers[axis] -= 1
        return c * mp.fprod(t**n for t, n in zip(x, powers, strict=True)) if c else c


class _System:
    """The Lagrange system: unknown coordinates, multipliers of the polynomials, weights, squared distance."""

    def __init__(self, a, b, point, feet):
        self.places = [_Place(a, point), *(_Place(b, q) for q in feet)]
        self.columns, size = [], 0
        for place in self.places:
            self.columns.append({axis: size + i for i, axis in enumerate(place.free)})
            size += len(place.free)
        self.multiplier, self.weight = size, size + len(feet)
        self.total = size + 2 * len(feet) + 2
        self.feet = range(1, len(feet) + 1)

    def start(self):
        """The given places, with equal weights and the multipliers that fit best."""
        y = mp.matrix(self.total, 1)
        for place, columns in zip(self.places, self.columns, strict=True):
            for t, column in zip(place.start, columns.values(), strict=True):
                y[column] = t
        at = self.located(y)
        for k in self.feet:
            y[self.weight + k] = mpf(1) / len(self.feet)
        y[self.total - 1] = sum(t**2 for t in self.apart(at, 1))
        for i, place in enumerate(self.places):
            n = {axis: place.derivative(at[i], axis) for axis in place.free}
            toward = self.pull(y, at, i)
            y[self.multiplier + i] = sum(toward[axis] * n[axis] for axis in n) / (sum(t**2 for t in n.values()) or 1)
        return y

    def located(self, y):
        """Coordinates of all places."""
        pairs = zip(self.places, self.columns, strict=True)
        return [place.put([y[column] for column in columns.values()]) for place, columns in pairs]

    def apart(self, at, k):
        """p - q_k."""
        return [s - t for s, t in zip(at[0], at[k], strict=True)]

    def pull(self, y, at, i):
        """sum w_k (p - q_k) for the point, q_k - p for a foot."""
        if i:
            return [-t for t in self.apart(at, i)]
        return [mp.fsum(y[self.weight + k] * self.apart(at, k)[axis] for k in self.feet) for axis in range(3)]

    def equations(self, y):
        """Left sides, and rows of their derivatives as dictionaries by column."""
        at = self.located(y)
        return [
            *(self._stationary(y, at, i, axis) for i, place in enumerate(self.places) for axis in place.free),
            *(self._closed(y, at, i) for i in range(len(self.places))),
            *(self._equal(y, at, k) for k in self.feet),
            (mp.fsum(y[self.weight + k] for k in self.feet) - 1, {self.weight + k: mpf(1) for k in self.feet}),
        ]

    def _stationary(self, y, at, i, axis):
        place, m = self.places[i], self.multiplier + i
        slope = place.derivative(at[i], axis)
        row = {column: -y[m] * place.derivative(at[i], axis, other) for other, column in self.columns[i].items()}
        row[self.columns[i][axis]] += mp.fsum(y[self.weight + k] for k in self.feet) if i == 0 else 1
        row[m] = -slope
        for k in self.feet if i == 0 else (0,):
            if axis in self.columns[k]:
                row[self.columns[k][axis]] = -y[self.weight + k] if i == 0 else mpf(-1)
            if i == 0:
                row[self.weight + k] = self.apart(at, k)[axis]
        return self.pull(y, at, i)[axis] - y[m] * slope, row

    def _closed(self, y, at, i):
        if not self.places[i].free:
            return y[self.multiplier + i], {self.multiplier + i: mpf(1)}
        row = {column: self.places[i].derivative(at[i], axis) for axis, column in self.columns[i].items()}
        return self.places[i].derivative(at[i]), row

    def _equal(self, y, at, k):
        apart = self.apart(at, k)
        row = {column: 2 * apart[axis] for axis, column in self.columns[0].items()}
        row |= {column: -2 * apart[axis] for axis, column in self.columns[k].items()}
        row[self.total - 1] = mpf(-1)
        return sum(t**2 for t in apart) - y[self.total - 1], row

    def newton(self, y):
        """One step."""
        left, jacobian = mp.matrix(self.total, 1), mp.matrix(self.total, self.total)
        for i, (value, row) in enumerate(self.equations(y)):
            left[i] = value
            for column, slope in row.items():
                jacobian[i, column] = slope
        return y - mp.lu_solve(jacobian, left)

    def faces(self, y, at):
        """Multipliers of the faces, outward."""
        found = []
        for i, place in enumerate(self.places):
            # A foot wants towards p.
            sign = 1 if i == 0 else -1
            pull = self.pull(y, at, i)
            for axis, side in enumerate(place.outward):
                rest = pull[axis] - y[self.multiplier + i] * place.derivative(at[i], axis) if side else 0
                found += [side * sign * rest] if side else []
        return found


def solve(a, b, point, feet, digits=DIGITS):
    """The maximum of the distance from a to b next to a point of a with some feet on b.

    Args:
        a: coefficients, lower, upper.
        b: the other surface.
        point: the start; its coordinates on faces stay there.
        feet: starts of the feet, one to three.
        digits: of the arithmetic; Newton's method starts at about 15.
    """
    with mp.workdps(digits):
        system = _System(a, b, point, feet)
        y = system.start()
        for _ in range(int(digits / 10)):
            y = system.newton(y)
        left = max(abs(value) for value, _ in system.equations(y))
        if left > mpf(10) ** (15 - digits) * (1 + abs(y[system.total - 1])):
            raise ArithmeticError(f"Newton's method left {mp.nstr(left, 5)}.")
        at = system.located(y)
        weights = [y[system.weight + k] for k in system.feet]
        return Solved(mp.sqrt(y[system.total - 1]), at[0], at[1:], weights, system.faces(y, at))


def values(coefficients, points):
    """Values of a polynomial at points (..., 3), by Horner's rule."""

    def horner(rows, t):
        total = rows[-1] * np.ones_like(t)
        for row in rows[-2::-1]:
            total = total * t + row
        return total

    x, y, z = np.moveaxis(points, -1, 0)
    return horner([horner([horner(line, z) for line in sheet], y) for sheet in coefficients], x)


def cloud(surface, cells):
    """Points of a surface: where the lines of a grid over its box change sign, by bisection."""
    f, lower, upper = surface.coefficients, np.asarray(surface.lower), np.asarray(surface.upper)
    axes = [np.linspace(low, high, cells + 1) for low, high in zip(lower, upper, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    at = values(f, grid)
    found = [grid[at == 0]]
    for axis in range(3):
        before, after = ((slice(None),) * axis + (part,) for part in (slice(None, -1), slice(1, None)))
        crossed = at[before] * at[after] < 0
        p, q, sign = grid[before][crossed], grid[after][crossed], np.sign(at[before][crossed])
        for _ in range(45):
            middle = (p + q) / 2
            same = np.sign(values(f, middle)) == sign
            p, q = np.where(same[:, None], middle, p), np.where(same[:, None], q, middle)
        found.append((p + q) / 2)
    return np.concatenate(found)
