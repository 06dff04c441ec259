"""The step of a minimax problem: an interior point method for its quadratic model, and multipliers.

Source: the predictor and corrector are Mehrotra's, SIAM J. Optim. 2 (1992), with quadratic constraints linearized at
each step; the multipliers are least squares with non-negative unknowns.
"""

from typing import Any

import numpy as np

from jhd._arithmetic.least_squares import non_negative

FloatArray = Any


def model_step(
    value: FloatArray,
    gradient: FloatArray,
    roots: FloatArray,
    radius: FloatArray,
    lazy: float = 0.0,
    accuracy: float = 0.0,
) -> FloatArray:
    """The d with |d_m| <= radius_m that minimizes the largest of value_i + gradient_i d + |roots_i d|^2 / 2.

    Args:
        value: (pairs,), the largest is positive.
        gradient: (pairs, parameters).
        roots: (pairs, rank, parameters), or (1, rank, parameters) for all pairs.
        radius: (parameters,) positive.
        lazy: twice the cost of moving a parameter by its radius, in the unit of the values.
        accuracy: accuracy of the minimum as a fraction of the largest value, but not below rounding.
    """
    # Least tolerance in units of order one.
    scale, tolerance = np.max(value), max(1e-13, accuracy)
    # In units of the radius and of the largest value: x = (d / radius, (level - scale) / scale).
    g, e, lazy = gradient * radius / scale, value / scale - 1, lazy / scale
    flat = (roots * radius / np.sqrt(scale)).reshape(-1, len(radius))
    count, k, own = len(radius), len(value), len(roots) == len(value)
    x = np.zeros(count + 1)
    slack, y = np.ones(k + 2 * count), np.full(k + 2 * count, 1 / (k + 2 * count))
    objective = np.append(np.zeros(count), 1.0)
    # Steps of the interior point method, of which 8 to 20 are needed.
    for _ in range(60):
        along = flat @ x[:-1]
        curved = np.add.reduce((along[:, None] * flat).reshape(len(roots), -1, count), axis=1) + lazy * x[:-1]
        rows = _Constraints(np.hstack([g + curved, -np.ones((k, 1))]))
        within = e + g @ x[:-1] + 0.5 * curved @ x[:-1] - x[-1]
        excess = np.concatenate([within, x[:-1] - 1, -x[:-1] - 1]) + slack
        dual, gap = objective + rows.back(y), slack @ y / len(y)
        if max(np.max(np.abs(dual)), np.max(np.abs(excess)), gap) < tolerance:
            break
        matrix, total = rows.squared(y / slack), np.sum(y[:k])
        of_rows = np.repeat(y[:k] if own else [total], len(flat) // len(roots))
        matrix[:-1, :-1] += flat.T @ (of_rows[:, None] * flat)
        matrix[np.diag_indices(count)] += lazy * total
        matrix[np.diag_indices(count + 1)] += 1e-15 * np.trace(matrix) / (count + 1)
        direction = _Direction(matrix, rows, slack, y, excess, dual)
        predicted = direction.towards(slack * y)
        if predicted is None:
            break
        ahead = [v + _longest(v, dv) * dv for v, dv in zip((slack, y), predicted[1:], strict=True)]
        centering = (ahead[0] @ ahead[1] / len(y) / gap) ** 3
        step = direction.towards(slack * y + predicted[1] * predicted[2] - centering * gap)
        if step is None:
            break
        # One length for all: the constraints are curved.
        # Fraction of the way to the boundary that a step takes.
        length = 0.995 * min(_longest(slack, step[1]), _longest(y, step[2]))
        x, slack, y = x + length * step[0], slack + length * step[1], y + length * step[2]
    return np.clip(x[:-1], -1.0, 1.0) * radius


class _Constraints:
    """The linearized constraints: one for each pair (pairs, parameters + 1), and both bounds of each parameter."""

    def __init__(self, pairs: FloatArray):
        self.pairs, self._few, self._count = pairs, len(pairs), pairs.shape[1] - 1

    def times(self, x: FloatArray) -> FloatArray:
        """All rows times x."""
        return np.concatenate([self.pairs @ x, x[:-1], -x[:-1]])

    def back(self, y: FloatArray) -> FloatArray:
        """The sum of all rows times y."""
        found = y[: self._few] @ self.pairs
        found[:-1] += y[self._few : -self._count] - y[-self._count :]
        return found

    def squared(self, weight: FloatArray) -> FloatArray:
        """The sum of weight row row^T."""
        found = self.pairs.T @ (weight[: self._few, None] * self.pairs)
        found[np.diag_indices(self._count)] += weight[self._few : -self._count] + weight[-self._count :]
        return found


class _Direction:
    """Newton's direction of the optimality conditions, for any complementarity residual."""

    def __init__(
        self,
        matrix: FloatArray,
        rows: _Constraints,
        slack: FloatArray,
        y: FloatArray,
        excess: FloatArray,
        dual: FloatArray,
    ):
        self.matrix, self.rows, self.slack, self.y, self.excess, self.dual = matrix, rows, slack, y, excess, dual

    def towards(self, product: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Changes of the unknowns, the slacks and the multipliers; None if the matrix is singular."""
        right = -self.dual - self.rows.back((self.y * self.excess - product) / self.slack)
        try:
            dx = np.linalg.solve(self.matrix, right)
        except np.linalg.LinAlgError:
            return None
        slack = -self.excess - self.rows.times(dx)
        found = dx, slack, (-product - self.y * slack) / self.slack
        return found if all(np.all(np.isfinite(part)) for part in found) else None


def _longest(v: FloatArray, dv: FloatArray) -> float:
    """The longest step up to one that keeps v non-negative."""
    falling = dv < 0
    return min(1.0, float(np.min(-v[falling] / dv[falling]))) if np.any(falling) else 1.0


def multipliers(gradient: FloatArray, price: FloatArray) -> FloatArray:
    """The mu >= 0 with sum one that minimize |sum mu_j g_j|^2 + sum (price_j mu_j)^2; a basic solution.

    Args:
        gradient: (pairs, parameters).
        price: (pairs,) at least 0, for pairs below the largest.
    """
    size = np.sqrt(np.max(np.sum(gradient**2, axis=1))) or 1.0
    rows = np.vstack([gradient.T / size, np.diag(price), np.ones((1, len(gradient)))])
    mu = non_negative(rows, np.append(np.zeros(len(rows) - 1), 1.0))
    total = np.sum(mu)
    return mu / total if total > 0 else np.eye(len(mu))[0]
