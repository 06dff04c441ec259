"""A slow and simple reference for distances of Bezier curves: NumPy only, and nothing of the package it checks.

A curve is `control_points` of shape (segments, points, dim) with `weights` None or (segments, points), all positive; a
pair of curves is two tuples `(control_points, weights)`. Segments need not be connected, the degree may be 0, and dim
is 2 or 3 (any number works). Everything is float64; coordinates are taken relative to the query point or to a common
center before anything else is done, so the errors are a few 1e-16 of the *size of the configuration*, wherever that
lies.

Global nearest points come from all roots of the stationarity polynomial (eigenvalues of its colleague matrix in the
Chebyshev basis), the ends of every segment and the local minima of a sampling; each is polished by descent on the
distance itself, so that a root that the eigenvalues blur (cusps, centers of curvature, polynomials that vanish) costs
no accuracy of the distance. Directed distances come from a breadth-first search that halves parameter cells of A and
drops those whose bound cannot matter.
"""

from math import comb
from typing import NamedTuple

import numpy as np

# Samples of each segment of B. A power of two keeps the sample parameters exact.
SAMPLES = 16
# How many of the candidates of one segment are polished: roots come in conjugate pairs and beside samples of the same
# minimum.
POLISHED = 6
# Descent steps at most: Newton needs about five; a flat minimum (quartic or higher) shrinks by 2/3 a step.
DESCENT_STEPS = 40
# Chebyshev coefficients below this part of the largest one are rounding; keeping them as leading ones would spoil every
# root.
NEGLIGIBLE = 1e-13
# Entries of the largest array of point-sample distances, so that memory stays near 100 MB.
CHUNK = 2_000_000


class Directed(NamedTuple):
    """The directed distance `value`, attained at `t` of `segment` of A, and its bound `upper`, both without rounding.

    `value <= h(A, B) <= upper` in exact arithmetic. `upper - value` is at most the accuracy asked for, unless the
    budget of cells ran out, which it does where the distance is constant along a stretch.
    """

    value: float
    segment: int
    t: float
    upper: float


class Foot(NamedTuple):
    """A local minimum of the distance from a point to a curve."""

    distance: float
    segment: int
    s: float
    point: np.ndarray


def bernstein_basis(degree, t):
    """The Bernstein polynomials B_i(t) = C(n,i) t^i (1-t)^(n-i), in a new last axis.

    By the recurrence B_i^k = (1-t) B_i^(k-1) + t B_(i-1)^(k-1), which only adds what is not negative.
    """
    t = np.asarray(t, dtype=float)
    basis = np.zeros((degree + 1, *t.shape))
    basis[0] = 1.0
    for k in range(1, degree + 1):
        for i in range(k, 0, -1):
            basis[i] = (1.0 - t) * basis[i] + t * basis[i - 1]
        basis[0] = (1.0 - t) * basis[0]
    return np.moveaxis(basis, 0, -1)


def bernstein_product(f, g):
    """Bernstein coefficients (last axis) of the product f g."""
    n, m = f.shape[-1] - 1, g.shape[-1] - 1
    shape = np.broadcast_shapes(f.shape[:-1], g.shape[:-1])
    result = np.zeros((*shape, n + m + 1))
    for i in range(n + 1):
        for j in range(m + 1):
            result[..., i + j] += comb(n, i) * comb(m, j) / comb(n + m, i + j) * f[..., i] * g[..., j]
    return result


def homogeneous(control_points, weights):
    """The rows (w b, w) of a rational curve: shape (segments, points, dim + 1)."""
    control_points = np.asarray(control_points, dtype=float)
    if weights is None:
        weights = np.ones(control_points.shape[:-1])
    weights = np.asarray(weights, dtype=float)[..., None]
    return np.concatenate([weights * control_points, weights], axis=-1)


def restrict(rows, start, stop):
    """Control rows of the part [start, stop] of each curve (cells, points, width), by two de Casteljau cuts."""
    start, stop = start[:, None], stop[:, None]
    right = [rows[:, i] for i in range(rows.shape[1])]
    for k in range(len(right) - 1):
        # Row i of step k is complete once i + k passes the degree; what is overwritten is never read again.
        for i in range(len(right) - 1 - k):
            right[i] = (1.0 - start) * right[i] + start * right[i + 1]
    ratio = np.where(start < 1.0, (stop - start) / np.where(start < 1.0, 1.0 - start, 1.0), 0.0)
    left = []
    for _ in range(rows.shape[1]):
        left.append(right[0])
        right = [(1.0 - ratio) * p + ratio * q for p, q in zip(right[:-1], right[1:], strict=True)]
    return np.stack(left, axis=1)


def evaluate(control_points, weights, t):
    """Points of every segment at the parameters t: shape (segments, *t.shape, dim)."""
    control_points = np.asarray(control_points, dtype=float)
    # Relative to the first point, so that far from the origin only the last addition rounds at the size of the
    # coordinates.
    center = control_points[0, 0]
    rows = homogeneous(control_points - center, weights)
    basis = bernstein_basis(rows.shape[1] - 1, t)
    values = np.einsum("...i,kij->k...j", basis, rows)
    return center + values[..., :-1] / values[..., -1:]


def _derivative_rows(rows):
    """Control rows of the derivative of a polynomial curve; degree 0 has the derivative 0."""
    degree = rows.shape[-2] - 1
    return degree * np.diff(rows, axis=-2) if degree else np.zeros_like(rows)


def _at(rows, t):
    """Each curve of a batch (pairs, points, width) at its own parameters (pairs, samples)."""
    return np.einsum("pki,pij->pkj", bernstein_basis(rows.shape[1] - 1, t), rows)


def _colleague_roots(values):
    """Real parts in [0, 1] of all roots of polynomials given at Chebyshev points: (polynomials, degree), 0 where fewer.

    In the Chebyshev basis u T_k = (T_(k-1) + T_(k+1)) / 2; writing T_m through the lower ones by the polynomial itself
    turns multiplication by u into a matrix, whose eigenvalues are the roots. Real parts of complex roots are kept: a
    multiple real root splits into complex ones, and a candidate too many does no harm.
    """
    count, nodes = values.shape
    order = np.arange(nodes)
    cosines = np.cos(np.pi * np.outer(order, order + 0.5) / nodes)
    coefficients = (2.0 / nodes) * values @ cosines.T
    coefficients[:, 0] /= 2.0
    size = np.abs(coefficients).max(axis=1, keepdims=True)
    kept = np.abs(coefficients) > NEGLIGIBLE * size
    degrees = np.where(kept.any(axis=1), nodes - 1 - kept[:, ::-1].argmax(axis=1), 0)
    roots = np.zeros((count, nodes - 1))
    for degree in np.unique(degrees[degrees > 0]):
        rows = np.flatnonzero(degrees == degree)
        c = coefficients[rows, : degree + 1]
        matrix = np.zeros((len(rows), degree, degree))
        for k in range(degree):
            if k + 1 < degree:
                matrix[:, k, k + 1] = 0.5 if k else 1.0
            if k > 0:
                matrix[:, k, k - 1] = 0.5
        factor = 0.5 if degree > 1 else 1.0
        matrix[:, -1, :] -= factor * c[:, :-1] / c[:, -1:]
        roots[rows, :degree] = np.clip((np.linalg.eigvals(matrix).real + 1.0) / 2.0, 0.0, 1.0)
    return roots


def _stationary_candidates(offsets, weights, rational):
    """Roots of (r - P).r' for each pair, where r - P = X / W with the control rows `offsets` of X and `weights` of W.

    The numerator X.(X' W - X W') has degree 3n-2 (the highest power cancels), or 2n-1 where W = 1.
    """
    degree = offsets.shape[1] - 1
    if degree == 0:
        return np.zeros((len(offsets), 1))
    nodes = 3 * degree - 1 if rational else 2 * degree
    u = np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
    t = np.broadcast_to((u + 1.0) / 2.0, (len(offsets), nodes))
    x, dx = _at(offsets, t), _at(_derivative_rows(offsets), t)
    w, dw = _at(weights, t), _at(_derivative_rows(weights), t)
    return _colleague_roots(np.sum(x * (dx * w - x * dw), axis=-1))


def _distance_jet(offsets, weights, t):
    """D = |r - P|^2 / 2 with its first two derivatives at parameters (pairs, samples)."""
    x, w = _at(offsets, t), _at(weights, t)
    first, first_w = _derivative_rows(offsets), _derivative_rows(weights)
    dx, dw = _at(first, t), _at(first_w, t)
    ddx, ddw = (_at(_derivative_rows(rows), t) if rows.shape[1] > 1 else 0.0 for rows in (first, first_w))
    r = x / w
    dr = (dx - r * dw) / w
    ddr = (ddx - 2.0 * dr * dw - r * ddw) / w
    return 0.5 * np.sum(r * r, -1), np.sum(r * dr, -1), np.sum(dr * dr + r * ddr, -1)


def _descend(offsets, weights, t):
    """Local minima of the distance from the starts t: Newton in a trust interval, downhill, then one free step."""
    radius = np.full(t.shape, 1.0 / SAMPLES)
    value, slope, bend = _distance_jet(offsets, weights, t)
    for _ in range(DESCENT_STEPS):
        step = np.where(bend > 0.0, -slope / np.where(bend > 0.0, bend, 1.0), -np.sign(slope) * radius)
        new = np.clip(t + np.clip(step, -radius, radius), 0.0, 1.0)
        new_value, new_slope, new_bend = _distance_jet(offsets, weights, new)
        better = new_value < value
        moved = np.abs(new - t)
        t, value = np.where(better, new, t), np.where(better, new_value, value)
        slope, bend = np.where(better, new_slope, slope), np.where(better, new_bend, bend)
        radius = np.where(better, np.maximum(2.0 * moved, radius / 2.0), np.minimum(radius, moved) / 4.0)
        if not np.any(better & (moved > 1e-16)) and np.all(radius < 1e-9):
            break
    # The distance is flat to rounding within 1e-8 of its minimum; where that step is this small, Newton knows the
    # parameter better.
    step = np.where(bend > 0.0, -slope / np.where(bend > 0.0, bend, 1.0), 0.0)
    t = np.where(np.abs(step) < 1e-7, np.clip(t + step, 0.0, 1.0), t)
    final = np.linalg.norm(_at(offsets, t) / _at(weights, t), axis=-1)
    return t, final


class _Target:
    """What is computed once for a curve B: samples, enclosing balls and speeds."""

    def __init__(self, control_points, weights):
        self.control_points = np.asarray(control_points, dtype=float)
        self.rational = weights is not None
        shape = self.control_points.shape[:-1]
        self.weights = np.asarray(weights, dtype=float) if self.rational else np.ones(shape)
        self.center = self.control_points[0, 0]
        local = self.control_points - self.center
        self.grid = np.arange(SAMPLES + 1) / SAMPLES if shape[1] > 1 else np.zeros(1)
        self.samples = evaluate(local, weights, self.grid)
        self.middle = 0.5 * (local.min(axis=1) + local.max(axis=1))
        self.radius = np.linalg.norm(local - self.middle[:, None], axis=-1).max(axis=1)
        # |r'| <= n (w_max / w_min)^2 max |b_(i+1) - b_i|: The NURBS Book bounds it so; exact enough where weights are
        # equal.
        gaps = np.linalg.norm(np.diff(local, axis=1), axis=-1).max(axis=1, initial=0.0)
        ratio = self.weights.max(axis=1) / self.weights.min(axis=1)
        self.speed = (shape[1] - 1) * ratio**2 * gaps

    def pairs_that_matter(self, points):
        """Which (point, segment) can hold the nearest point: its lower bound is not above the best sample."""
        local = points - self.center
        sampled = np.linalg.norm(local[:, None, None] - self.samples, axis=-1)
        nearest = sampled.min(axis=-1)
        lower = nearest - self.speed / (2 * SAMPLES)
        lower = np.maximum(lower, np.linalg.norm(local[:, None] - self.middle, axis=-1) - self.radius)
        upper = nearest.min(axis=1, keepdims=True)
        point, segment = np.nonzero(lower <= upper * (1.0 + 1e-9) + 1e-12 * self.radius.max())
        return point, segment, sampled[point, segment]

    def minima(self, points):
        """Polished local minima on every segment that matters: point, segment; s and distance, (pairs, POLISHED)."""
        point, segment, sampled = self.pairs_that_matter(points)
        offsets = self.weights[segment][..., None] * (self.control_points[segment] - points[point][:, None])
        weights = self.weights[segment][..., None]
        padded = np.pad(sampled, ((0, 0), (1, 1)), constant_values=np.inf)
        is_minimum = (sampled <= padded[:, :-2]) & (sampled <= padded[:, 2:])
        roots = _stationary_candidates(offsets, weights, self.rational)
        at_roots = np.linalg.norm(_at(offsets, roots) / _at(weights, roots), axis=-1)
        candidates = np.concatenate([np.broadcast_to(self.grid, sampled.shape), roots], axis=1)
        values = np.concatenate([np.where(is_minimum, sampled, np.inf), at_roots], axis=1)
        order = np.argsort(values, axis=1, kind="stable")[:, :POLISHED]
        s, distance = _descend(offsets, weights, np.take_along_axis(candidates, order, axis=1))
        return point, segment, s, distance

    def nearest(self, points):
        """Distance, segment and s of the global nearest point for each of `points` (points, dim)."""
        points = np.asarray(points, dtype=float)
        size = max(1, CHUNK // self.samples.size)
        parts = [self._nearest(points[i : i + size]) for i in range(0, len(points), size)]
        return tuple(np.concatenate(column) for column in zip(*parts, strict=True))

    def _nearest(self, points):
        point, segment, s, distance = self.minima(points)
        best = distance.argmin(axis=1)
        rows = np.arange(len(best))
        s, distance = s[rows, best], distance[rows, best]
        order = np.lexsort((distance, point))
        _, first = np.unique(point[order], return_index=True)
        chosen = order[first]
        return distance[chosen], segment[chosen], s[chosen]


def project(point, control_points, weights=None):
    """The global nearest point: distance, segment and parameter s.

    The distance is good to about 1e-14 of the larger of distance and size of the curve. At a tie any of the feet comes
    back.
    """
    distance, segment, s = _Target(control_points, weights).nearest(np.asarray(point, dtype=float)[None])
    return float(distance[0]), int(segment[0]), float(s[0])


def distance_profile(points, control_points, weights=None):
    """Distances of many points (points, dim) to a curve, each a global minimum as in `project`."""
    return _Target(control_points, weights).nearest(points)[0]


def feet(point, control_points, weights=None, slack=0.0):
    """Every foot within `slack` of the smallest distance, the nearest first; feet at one place in space are one."""
    target = _Target(control_points, weights)
    point = np.asarray(point, dtype=float)
    _, segment, s, distance = target.minima(point[None])
    segment = np.broadcast_to(segment[:, None], s.shape).ravel()
    s, distance = s.ravel(), distance.ravel()
    found = []
    # Polished minima of one foot differ by the square root of the rounding error.
    apart = 1e-6 * max(np.ptp(target.control_points, axis=(0, 1)).max(), distance.min())
    for i in np.argsort(distance, kind="stable"):
        if distance[i] > distance.min() + slack:
            break
        place = evaluate(target.control_points[segment[i]][None] - point, target.weights[segment[i]][None], s[i])[0]
        if all(np.linalg.norm(place - foot.point) > apart for foot in found):
            found.append(Foot(float(distance[i]), int(segment[i]), float(s[i]), place))
    return [foot._replace(point=foot.point + point) for foot in found]


def diagonal(a, b):
    """Diagonal of the box of the control points of both curves: the unit of the accuracies here."""
    control_points = [np.reshape(shape[0], (-1, np.shape(shape[0])[-1])) for shape in (a, b)]
    return float(np.linalg.norm(np.ptp(np.concatenate(control_points), axis=0)))


class _Pair:
    """Both curves relative to a common center, with what the search over cells of A asks of them."""

    def __init__(self, a, b):
        (a_points, a_weights), (b_points, b_weights) = a, b
        # A difference of floats is exact to relative 1e-16, so recentering loses nothing at the size of the
        # configuration.
        center = np.asarray(b_points, dtype=float)[0, 0]
        self.rows_a = homogeneous(np.asarray(a_points, dtype=float) - center, a_weights)
        local_b = np.asarray(b_points, dtype=float) - center
        self.rows_b = homogeneous(local_b, b_weights)
        self.target = _Target(local_b, b_weights)

    def points(self, segment, t):
        values = _at(self.rows_a[segment], t[:, None])[:, 0]
        return values[:, :-1] / values[:, -1:]

    def feet(self, segment, t):
        """Distance, segment of B, s and foot for points of A."""
        distance, foot_segment, s = self.target.nearest(self.points(segment, t))
        values = _at(self.rows_b[foot_segment], s[:, None])[:, 0]
        return distance, foot_segment, s, values[:, :-1] / values[:, -1:]

    def crossing(self, cells):
        """The parameter of each cell where the feet of its two ends are equally far, by bisection.

        |A-p|^2 - |A-q|^2 = (q-p).(2A - p - q) is not positive at the end that p is nearest to, nor negative at the
        other.
        """
        low, high = cells["t0"].copy(), cells["t1"].copy()
        for _ in range(50):
            t = 0.5 * (low + high)
            sides = 2 * self.points(cells["segment"], t) - cells["q0"] - cells["q1"]
            first_nearer = np.sum((cells["q1"] - cells["q0"]) * sides, axis=-1) <= 0.0
            low, high = np.where(first_nearer, t, low), np.where(first_nearer, high, t)
        return 0.5 * (low + high)

    def bound(self, cells, tau):
        """Upper bound of d(A(t), B) over each cell: from the fixed feet of both ends, or from B running along with A.

        Fixed feet: left of tau the distance to the foot of the left end, right of it to that of the right end. Running
        along: with sigma the affine map of the cell onto the interval between both feet, |A(t) - B(sigma(t))|. All are
        square roots of quotients of polynomials with positive denominators, so the largest quotient of Bernstein
        coefficients bounds them.
        """
        rows = self.rows_a[cells["segment"]]
        left = _largest_distance(restrict(rows, cells["t0"], tau), _constant(cells["q0"]))
        right = _largest_distance(restrict(rows, tau, cells["t1"]), _constant(cells["q1"]))
        result = np.maximum(left, right)
        same = np.flatnonzero((cells["foot0"] == cells["foot1"]) & (cells["s0"] != cells["s1"]))
        if len(same):
            piece_a = restrict(rows[same], cells["t0"][same], cells["t1"][same])
            s0, s1 = cells["s0"][same], cells["s1"][same]
            piece_b = restrict(self.rows_b[cells["foot0"][same]], np.minimum(s0, s1), np.maximum(s0, s1))
            piece_b = np.where((s0 > s1)[:, None, None], piece_b[:, ::-1], piece_b)
            result[same] = np.minimum(result[same], _largest_distance(piece_a, piece_b))
        return result


def _constant(points):
    """Points as rational curves of degree 0, one a cell."""
    return np.concatenate([points, np.ones((len(points), 1))], axis=-1)[:, None]


def _largest_distance(a, b):
    """Bound of |a(u) - b(u)| over u in [0, 1] for batches of homogeneous control rows (cells, points, dim + 1)."""
    a, b = np.swapaxes(a, 1, 2), np.swapaxes(b, 1, 2)
    difference = bernstein_product(a[:, :-1], b[:, -1:]) - bernstein_product(b[:, :-1], a[:, -1:])
    weight = bernstein_product(a[:, -1], b[:, -1])
    numerator = bernstein_product(difference, difference).sum(axis=1)
    quotient = numerator / bernstein_product(weight, weight)
    return np.sqrt(np.maximum(quotient.max(axis=-1), 0.0))


def _zoom(pair, segment, t, radius):
    """The largest distance near t: seventeen samples, then the cells beside the best, until they are as fine as floats.

    No derivative and no unimodality over more than two cells is used, so kinks, flat tops and ends need no case of
    their own.
    """
    best = -1.0
    while radius > 1e-16:
        trial = np.clip(t + radius * np.linspace(-1.0, 1.0, 17), 0.0, 1.0)
        distance = pair.feet(np.full(17, segment), trial)[0]
        k = distance.argmax()
        if distance[k] > best:
            best, t = float(distance[k]), float(trial[k])
        radius /= 7.0
    return best, t


def _initial_cells(pair):
    """Uniform cells of every segment of A, with the feet of their ends."""
    count = len(pair.rows_a)
    pieces = 1 if pair.rows_a.shape[1] == 1 else max(4, 32 // count)
    grid = np.arange(pieces + 1) / pieces
    segment = np.repeat(np.arange(count), pieces + 1)
    columns = [c.reshape(count, pieces + 1, *c.shape[1:]) for c in pair.feet(segment, np.tile(grid, count))]
    cells = {"segment": np.repeat(np.arange(count), pieces)}
    cells |= {"t0": np.tile(grid[:-1], count), "t1": np.tile(grid[1:], count)}
    for name, column in zip(("d", "foot", "s", "q"), columns, strict=True):
        for end, part in (("0", column[:, :-1]), ("1", column[:, 1:])):
            cells[name + end] = part.reshape(count * pieces, *column.shape[2:])
    return cells


def _children(pair, cells, cut):
    """Both parts of every cell, cut at the parameters `cut`."""
    middle = dict(zip(("d", "foot", "s", "q"), pair.feet(cells["segment"], cut), strict=True)) | {"t": cut}
    left = {name: middle[name[:-1]] if name.endswith("1") else column for name, column in cells.items()}
    right = {name: middle[name[:-1]] if name.endswith("0") else column for name, column in cells.items()}
    return {name: np.concatenate([left[name], right[name]]) for name in cells}


def _best_sample(cells):
    """Value, segment and parameter of the farthest cell end."""
    at_end = cells["d1"].max() > cells["d0"].max()
    d, t = (cells["d1"], cells["t1"]) if at_end else (cells["d0"], cells["t0"])
    k = d.argmax()
    return float(d[k]), int(cells["segment"][k]), float(t[k])


def directed_hausdorff(a, b, accuracy=1e-12, budget=3000):
    """The directed Hausdorff distance: max over t of min over s of |A(t) - B(s)|.

    Cells of A are dropped when their upper bound does not pass the best value by more than `accuracy` times the
    diagonal. At a maximum with one foot the bound is too large by a multiple of the squared width of the cell, and at
    one with two feet too, because the cells are cut where the feet of both ends are equally far. The best value is then
    zoomed in on.

    Args:
        a, b: tuples (control_points, weights).
        accuracy: part of the diagonal that `upper - value` may have at the end.
        budget: largest number of cells to cut; `upper` stays true and is wider where it runs out.
    """
    pair = _Pair(a, b)
    tolerance = accuracy * max(diagonal(a, b), np.finfo(float).tiny)
    cells = _initial_cells(pair)
    best = _best_sample(cells)
    best = max(best, _zoomed(pair, best, float((cells["t1"] - cells["t0"]).max())))
    cut_cells = 0
    while True:
        tau = pair.crossing(cells)
        bound = pair.bound(cells, tau)
        open_cells = bound > best[0] + tolerance
        if not open_cells.any() or cut_cells > budget:
            break
        cells, tau = {name: column[open_cells] for name, column in cells.items()}, tau[open_cells]
        width = cells["t1"] - cells["t0"]
        # Where both feet are one, the crossing is noise; a cut that leaves a thousandth still ends.
        moving = np.linalg.norm(cells["q1"] - cells["q0"], axis=-1) > 1e-3 * cells["d0"]
        inside = np.clip(tau, cells["t0"] + 1e-3 * width, cells["t1"] - 1e-3 * width)
        cut = np.where(moving, inside, cells["t0"] + 0.5 * width)
        cut_cells += len(cut)
        cells = _children(pair, cells, cut)
        candidate = _best_sample(cells)
        if candidate[0] > best[0]:
            best = max(candidate, _zoomed(pair, candidate, float(width.max())))
    return Directed(*best, max(best[0], float(bound.max()) if open_cells.any() else best[0] + tolerance))


def _zoomed(pair, candidate, radius):
    _, segment, t = candidate
    value, t = _zoom(pair, segment, t, radius)
    return value, segment, t


def hausdorff(a, b, accuracy=1e-12, budget=3000):
    """The larger of both directed distances."""
    return max(directed_hausdorff(a, b, accuracy, budget).value, directed_hausdorff(b, a, accuracy, budget).value)


def distances_to_triangles(point, corners):
    """Distances of one point to triangles with area (triangles, 3, 3).

    By the plane where the foot is inside, else by the edges.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    ends = [(a, b), (b, c), (c, a)]
    shares = [np.clip(((point - x) * (y - x)).sum(1) / ((y - x) ** 2).sum(1), 0, 1) for x, y in ends]
    feet = [x + t[:, None] * (y - x) for (x, y), t in zip(ends, shares, strict=True)]
    found = np.min([np.linalg.norm(point - x, axis=1) for x in feet], axis=0)
    normal = np.cross(b - a, c - a)
    inside = np.all([(np.cross(y - x, point - x) * normal).sum(1) >= 0 for x, y in ends], axis=0)
    height = np.abs(((point - a) * normal).sum(1)) / np.linalg.norm(normal, axis=1)
    return np.where(inside, height, found)
