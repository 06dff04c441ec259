"""The proof that a polynomial on a product of simplices is nowhere negative, if its least value is close to zero.

Near an inner minimum just above zero, halving alone needs a part for each of the last digits. There the polynomial is
proven to be convex on a part, because all Bernstein coefficients of its second derivatives, which are matrices, are
positive semidefinite. Then it is nowhere below its tangent plane at any point c, and the plane is not negative if it is
not negative at the corners. For a polynomial f of degree n_s in the barycentric coordinates of the simplex s, the value
of the plane at the corners i_s is

    f(c) (1 - sum_s n_s) + sum_s f_(i_s)(c),   f_i the derivative in the coordinate i,

since the sum of c_i f_i over a simplex is n_s f. The point c is found in floating point; everything else is exact.
"""

from collections.abc import Sequence

from jhd._distance.certificate.verification.polynomials import (
    BITS,
    MOST_PARTS,
    Degree,
    Domain,
    Polynomial,
    combined,
    elevated,
    failure,
    powers_of,
    variable,
)

# Steps towards the minimum, the least pivot, and the size of a step after which the minimum is reached.
_STEPS, _STILL, _NEAR = 30, 1e-17, 1e-9
# Barycentric coordinates are multiples of this power of two.
_SHARE_BITS = 60
_MASK = (1 << BITS) - 1


def failure_in_space(f: Polynomial, domain: Domain, degree: Degree, most_parts: int = MOST_PARTS) -> str | None:
    """Call `failure` with planes as a further proof."""
    # Parts are tested for convexity once in this many halvings.
    is_proven = lambda part, depth: depth % 3 == 0 and is_above_a_plane(part, domain, degree)  # noqa: E731
    return failure(f, domain, degree, most_parts, is_proven)


# ---- convexity -----------------------------------------------------------------------------------


def is_above_a_plane(f: Polynomial, domain: Domain, degree: Degree) -> bool:
    """Return whether the polynomial is proven to be convex, with a tangent plane that is nowhere negative."""
    c = _least(f, domain)
    if c is None:
        return False
    value = _at(f, c)
    total = sum(degree)
    plane = (1 - total) * value
    for variables in domain:
        # Derivatives have one factor less than the value.
        plane += min(_at(_derivative(f, v), c) for v in variables) << _SHARE_BITS
    return plane >= 0 and _is_convex(f, domain, degree)


def _derivative(f: Polynomial, v: int) -> Polynomial:
    """Return the derivative in one barycentric coordinate."""
    low, step = BITS * v, variable(v)
    return {i - step: c * ((i >> low) & _MASK) for i, c in f.items() if (i >> low) & _MASK}


def _is_convex(f: Polynomial, domain: Domain, degree: Degree) -> bool:
    """Return whether all Bernstein coefficients of the second derivatives are positive semidefinite."""
    along = [(k, v, variables[0]) for k, variables in enumerate(domain) for v in variables[1:]]
    rows: list[list[Polynomial]] = []
    for m, (k, v, base) in enumerate(along):
        slope = combined(_derivative(f, v), 1, _derivative(f, base), -1)
        row = []
        for j, w, other in along[: m + 1]:
            bend = combined(_derivative(slope, w), 1, _derivative(slope, other), -1)
            lower = list(degree)
            lower[k] -= 1
            lower[j] -= 1
            if min(lower) < 0:
                bend, lower = {}, list(degree)
            row.append(elevated(bend, domain, tuple(lower), degree))
        rows.append(row)
    codes = set().union(*(bend for row in rows for bend in row))
    return all(_is_semidefinite([[bend.get(i, 0) for bend in row] for row in rows]) for i in codes)


def _is_semidefinite(rows: list[list[int]]) -> bool:
    """Return whether a symmetric matrix of integers, given by its lower half, is positive semidefinite."""
    n = len(rows)
    for k in range(n):
        pivot = rows[k][k]
        column = [rows[i][k] for i in range(k + 1, n)]
        if pivot < 0 or (pivot == 0 and any(column)):
            return False
        if pivot:
            for i in range(k + 1, n):
                for j in range(k + 1, i + 1):
                    rows[i][j] = rows[i][j] * pivot - column[i - k - 1] * column[j - k - 1]
    return True


def _at(f: Polynomial, c: Sequence[int]) -> int:
    """Return the value at integer barycentric coordinates, without their powers of two."""
    found = 0
    for i, x in f.items():
        for share, n in zip(c, powers_of(i, len(c)), strict=True):
            x *= share**n
        found += x
    return found


# ---- the minimizer, in floating point ------------------------------------------------------------


def _least(f: Polynomial, domain: Domain) -> list[int] | None:
    """Approximate minimizer in multiples of a power of two; None if no convex polynomial has its minimum there."""
    size, count = max(abs(x) for x in f.values()), 1 + max(map(max, domain))
    rows = [(powers_of(i, count), x / size) for i, x in f.items()]
    x = [0.0] * count
    for variables in domain:
        for v in variables:
            x[v] = 1 / len(variables)
    free = [list(variables) for variables in domain]
    for _ in range(_STEPS):
        slope, bend = _jet(rows, x)
        step = _newton(slope, bend, free)
        if step is None:
            return None
        hit = _stepped(x, step)
        if hit is not None:
            next(variables for variables in free if hit in variables).remove(hit)
        elif max(abs(d) for d in step.values()) < _NEAR:
            released = _released(slope, domain, free)
            if released is None:
                break
            released[0].append(released[1])
    return _rounded(x, domain)


def _stepped(x: list[float], step: dict[int, float]) -> int | None:
    """Add a step, shortened so that no coordinate becomes negative; return the coordinate that stops it."""
    share, hit = 1.0, None
    for v, d in step.items():
        if x[v] + share * d < 0:
            share, hit = -x[v] / d, v
    for v, d in step.items():
        x[v] += share * d
    if hit is not None:
        x[hit] = 0.0
    return hit


def _released(slope: list[float], domain: Domain, free: list[list[int]]) -> tuple[list[int], int] | None:
    """Return a coordinate that is zero and should grow, with the free ones of its simplex."""
    for variables, mine in zip(domain, free, strict=True):
        here = min(slope[v] for v in mine)
        for v in variables:
            if v not in mine and slope[v] < here - 1e-12:
                return mine, v
    return None


def _rounded(x: list[float], domain: Domain) -> list[int]:
    found = [max(round(share * 2.0**_SHARE_BITS), 0) for share in x]
    for variables in domain:
        most = max(variables, key=lambda v: found[v])
        found[most] += (1 << _SHARE_BITS) - sum(found[v] for v in variables)
    return found


def _jet(rows: list[tuple[list[int], float]], x: list[float]) -> tuple[list[float], list[list[float]]]:
    """Return first and second derivatives in all barycentric coordinates."""
    n = len(x)
    slope, bend = [0.0] * n, [[0.0] * n for _ in range(n)]
    for powers, c in rows:
        used = [k for k in range(n) if powers[k]]
        for a, i in enumerate(used):
            slope[i] += c * powers[i] * _product(powers, x, i, None)
            for j in used[: a + 1]:
                factor = powers[i] * (powers[i] - 1) if i == j else powers[i] * powers[j]
                if factor:
                    bend[i][j] += c * factor * _product(powers, x, i, j)
    for i in range(n):
        for j in range(i):
            bend[j][i] = bend[i][j]
    return slope, bend


def _product(powers: list[int], x: list[float], i: int, j: int | None) -> float:
    found = 1.0
    for k, p in enumerate(powers):
        p -= (k == i) + (k == j)
        if p:
            found *= x[k] ** p
    return found


def _newton(slope: list[float], bend: list[list[float]], free: list[list[int]]) -> dict[int, float] | None:
    """Return the step to the minimum of the quadratic on the free coordinates with fixed sums; None without."""
    used = [v for variables in free for v in variables]
    n, count = len(used), len(used) + len(free)
    matrix = [[0.0] * (count + 1) for _ in range(count)]
    for a, i in enumerate(used):
        for b, j in enumerate(used):
            matrix[a][b] = bend[i][j]
        matrix[a][count] = -slope[i]
        for k, variables in enumerate(free):
            if i in variables:
                matrix[a][n + k] = matrix[n + k][a] = 1.0
    for k in range(count):
        p = max(range(k, count), key=lambda i: abs(matrix[i][k]))
        if abs(matrix[p][k]) < _STILL:
            return None
        matrix[k], matrix[p] = matrix[p], matrix[k]
        for i in range(count):
            if i != k and matrix[i][k]:
                factor = matrix[i][k] / matrix[k][k]
                matrix[i] = [x - factor * y for x, y in zip(matrix[i], matrix[k], strict=True)]
    return {v: matrix[k][count] / matrix[k][k] for k, v in enumerate(used)}
