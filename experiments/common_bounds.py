"""Upper bounds of the distance over a cell, in NumPy and one cell at a time, to compare with the package's bound.

A segment is an array (points, dim + 1) of homogeneous Bernstein coefficients, the weight last. A cell is a parameter
interval of one segment a, with the parameter of a foot on one segment b at each end. Plain arithmetic: no outward
rounding, so these bounds hold to some 1e-15 of the coordinates.
"""

from functools import lru_cache
from math import comb
from typing import NamedTuple

import numpy as np

# Samples of b in the search for feet, and Newton steps that polish a foot.
_SAMPLES, _NEWTON = 128, 8
# Samples of a cell in the search for its peak, and golden sections that find a crossing to the last digit.
_NODES, _SECTIONS = 33, 75


class Interval(NamedTuple):
    """A cell: a parameter interval of a, and the parameters of a foot on b at either end."""

    t0: float
    t1: float
    s0: float
    s1: float


class Foot(NamedTuple):
    """The parameter of a foot and its speed ds/dt."""

    s: float
    speed: float


def homogeneous(points: np.ndarray, weights: np.ndarray | None) -> np.ndarray:
    """Convert control points (points, dim) and weights to the homogeneous form used here."""
    weights = np.ones(len(points)) if weights is None else weights
    return np.column_stack([points * weights[:, None], weights])


def jet(curve: np.ndarray, t: float) -> np.ndarray:
    """Return point, first and second derivative at t, in rows."""
    n, levels = len(curve) - 1, [curve]
    while len(levels[-1]) > 1:
        levels.append((1 - t) * levels[-1][:-1] + t * levels[-1][1:])
    x, first = levels[-1][0], n * np.diff(levels[-2], axis=0)[0]
    second = n * (n - 1) * np.diff(levels[-3], 2, axis=0)[0] if n > 1 else np.zeros_like(x)
    point = x[:-1] / x[-1]
    velocity = (first[:-1] - first[-1] * point) / x[-1]
    return np.stack([point, velocity, (second[:-1] - second[-1] * point - 2 * first[-1] * velocity) / x[-1]])


def restrict(curve: np.ndarray, t0: float, t1: float) -> np.ndarray:
    """Return the part [t0, t1]: coefficient i is the blossom at n - i times t0 and i times t1."""
    found = []
    for i in range(len(curve)):
        rows = curve
        for t in [t1] * i + [t0] * (len(curve) - 1 - i):
            rows = (1 - t) * rows[:-1] + t * rows[1:]
        found.append(rows[0])
    return np.array(found)


@lru_cache
def _binomials(n: int) -> np.ndarray:
    return np.array([[float(comb(n, k))] for k in range(n + 1)])


def multiply(f: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Return the Bernstein coefficients of the products of a scalar f with the columns of g."""
    n, m = len(f) - 1, len(g) - 1
    scaled_f, scaled_g = _binomials(n)[:, 0] * f, _binomials(m) * g
    return np.stack([np.convolve(scaled_f, column) for column in scaled_g.T], axis=1) / _binomials(n + m)


def feet(b: np.ndarray, point: np.ndarray) -> tuple[float, float]:
    """Return the parameter of the nearest point of b and its distance: the minima of samples, polished."""
    grid, offsets = _sampled(b.tobytes(), b.shape)
    d = np.linalg.norm(offsets - point, axis=1)
    wide = np.pad(d, 1, constant_values=np.inf)
    starts = grid[(d <= wide[:-2]) & (d <= wide[2:])]
    polished = [_polished(point, np.zeros_like(point), b, s).s for s in starts]
    distance, s = min((float(np.linalg.norm(jet(b, s)[0] - point)), s) for s in polished)
    return s, distance


@lru_cache
def _sampled(content: bytes, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return sampled parameters and points of a curve, cached for the next call."""
    curve = np.frombuffer(content).reshape(shape)
    grid = np.linspace(0.0, 1.0, _SAMPLES + 1)
    return grid, np.array([jet(curve, s)[0] for s in grid])


def _polished(point: np.ndarray, velocity: np.ndarray, b: np.ndarray, s: float) -> Foot:
    """Return the local foot near s of a point, and its speed when the point moves with this velocity."""
    speed = 0.0
    for _ in range(_NEWTON):
        at, first, second = jet(b, s)
        square = first @ first
        slope = square + (at - point) @ second
        slope = slope if slope > 1e-3 * square else square
        s, speed = float(np.clip(s - (at - point) @ first / slope, 0.0, 1.0)), float(velocity @ first / slope)
    return Foot(s, speed)


def _followed(a: np.ndarray, b: np.ndarray, cell: Interval, from_left: bool) -> tuple[Foot, Foot]:
    """Return the feet at both ends of a cell on the branch that starts from its foot at one end."""
    start, stop, s = (cell.t0, cell.t1, cell.s0) if from_left else (cell.t1, cell.t0, cell.s1)
    point, velocity, _ = jet(a, start)
    near = _polished(point, velocity, b, s)
    point, velocity, _ = jet(a, stop)
    far = _polished(point, velocity, b, float(np.clip(near.s + near.speed * (stop - start), 0.0, 1.0)))
    return (near, far) if from_left else (far, near)


def _sigma(kind: str, ends: tuple[Foot, Foot], width: float) -> tuple[np.ndarray, np.ndarray]:
    """Bernstein coefficients of the map into b and of its complement; if Moebius, times its denominator."""
    (s0, v0), (s1, v1) = ends
    if kind == "cubic":
        sigma = np.array([s0, *np.clip([s0 + v0 * width / 3, s1 - v1 * width / 3], 0.0, 1.0), s1])
        return sigma, 1 - sigma
    sigma, weights = np.array([s0, s1]), np.ones(2)
    if kind == "Moebius" and v0 * v1 > 0:
        weights[1] = np.sqrt(v0 / v1)
    return sigma * weights, (1 - sigma) * weights


def _composed(b: np.ndarray, sigma: np.ndarray, complement: np.ndarray) -> np.ndarray:
    """Compute the homogeneous coefficients of b(sigma(u)) by de Casteljau's algorithm on polynomials."""
    rows = [c[None] for c in b]
    while len(rows) > 1:
        pairs = zip(rows[:-1], rows[1:], strict=True)
        rows = [multiply(complement, low) + multiply(sigma, high) for low, high in pairs]
    return rows[0]


def branches(a: np.ndarray, b: np.ndarray, cell: Interval, kind: str) -> list[np.ndarray]:
    """Homogeneous coefficients of A(u) - B(sigma(u)) over the cell for the branches from its left and right foot.

    Args:
        a: a segment.
        b: a segment.
        cell: part of a.
        kind: of the map sigma: "affine" between the feet, "cubic" with their speeds, or "Moebius" with their ratio.
    """
    part, found = restrict(a, cell.t0, cell.t1), []
    for from_left in (True, False):
        path = _composed(b, *_sigma(kind, _followed(a, b, cell, from_left), cell.t1 - cell.t0))
        e = multiply(path[:, -1], part) - multiply(part[:, -1], path)
        e[:, -1] = multiply(path[:, -1], part[:, -1:])[:, 0]
        found.append(e)
    return found


def squared(e: np.ndarray) -> np.ndarray:
    """Coefficients whose range encloses |A - B(sigma)|^2."""
    squares = sum(multiply(x, x[:, None]) for x in e[:, :-1].T)
    return (squares / multiply(e[:, -1], e[:, -1:]))[:, 0]


def lipschitz(a: np.ndarray, cell: Interval, middle: float) -> float:
    """The distance at the middle of the cell and half the cell's largest possible length (of a polynomial a)."""
    part = restrict(a, cell.t0, cell.t1)[:, :-1]
    return middle + 0.5 * (len(part) - 1) * float(np.max(np.linalg.norm(np.diff(part, axis=0), axis=1)))


def one_branch(pair: list[np.ndarray]) -> float:
    """Return the smaller bound of the two branches, each bounded by its largest coefficient."""
    return min(float(np.sqrt(np.max(squared(e)))) for e in pair)


def combined(pair: list[np.ndarray]) -> float:
    """Minimize the largest coefficient of lambda D_X + (1 - lambda) D_Y over lambda in [0, 1] (polynomial curves).

    The maximum of straight lines in lambda is lowest at an end or at a crossing of two lines: all of these are tried.
    """
    f, g = (squared(e) for e in pair)
    rise, (i, j) = f - g, np.triu_indices(len(f), 1)
    i, j = i[rise[i] != rise[j]], j[rise[i] != rise[j]]
    crossings = (g[j] - g[i]) / (rise[i] - rise[j])
    tried = np.concatenate([[0.0, 1.0], crossings[(crossings > 0) & (crossings < 1)]])
    return float(np.sqrt(np.min(np.max(g + tried[:, None] * rise, axis=1))))


def split_at_peak(pair: list[np.ndarray]) -> float:
    """Split both branches at the peak of their minimum: the package's bound, with any map and no rounding.

    Golden sections find a crossing; from there a Newton step on either branch finds a smooth top. All three parameters
    give a bound, and the smallest one is returned.
    """
    nodes = np.linspace(0.0, 1.0, _NODES)
    k = int(np.argmax([_height(pair, u) for u in nodes]))
    low, high = nodes[max(k - 1, 0)], nodes[min(k + 1, _NODES - 1)]
    golden = (np.sqrt(5) - 1) / 2
    for _ in range(_SECTIONS):
        left, right = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, right) if _height(pair, left) >= _height(pair, right) else (left, high)
    u = 0.5 * (low + high)
    return min(_split(pair, v) for v in (u, *(_top(e, u) for e in pair)))


def _height(pair: list[np.ndarray], u: float) -> float:
    return min(float(np.sum(jet(e, u)[0] ** 2)) for e in pair)


def _top(e: np.ndarray, u: float) -> float:
    point, first, second = jet(e, u)
    slope = first @ first + point @ second
    return float(np.clip(u - point @ first / slope, 0.0, 1.0)) if slope < 0 else u


def _split(pair: list[np.ndarray], u: float) -> float:
    halves = [min(np.max(squared(restrict(e, *ends))) for e in pair) for ends in ((0.0, u), (u, 1.0))]
    return float(np.sqrt(max(halves)))
