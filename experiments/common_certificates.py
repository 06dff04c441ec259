"""Random shapes of every kind that has certificates, and points on them as certificates name them, in NumPy."""

from itertools import product
from math import comb
from typing import Any, NamedTuple

import numpy as np

import jhd

# Sampled parameters along each axis of a piece, and nodes along an edge of a surface's box.
_SAMPLES, _NODES = 17, 13
# Halvings of an edge between nodes if a polynomial changes its sign on it.
_HALVINGS = 20
# Weights of rational shapes.
_WEIGHTS = 0.5, 2.0


class Places(NamedTuple):
    """Locations on a shape as a certificate names them, and their points (locations, dim)."""

    names: list[dict[str, Any]]
    points: np.ndarray


def drawn(kind: str, random: np.random.Generator, height: float, rational: bool) -> Any:
    """Draw a shape over the unit square (in the plane: in it), about a height; with weights if it is rational."""
    plane = kind.startswith("plane")
    sizes = {"points": (5,), "curve": (4,), "patch": (3, 3), "mesh": (3, 3)}
    if kind == "surface":
        return _surface(random, height)
    shape = sizes[kind.removeprefix("plane ")]
    weights = random.uniform(*_WEIGHTS, shape) if rational else None
    if len(shape) == 1:
        points = random.uniform(size=(*shape, 3)) * [1, 1, 0.25] + [0, 0, height]
        points = points[:, :2] if plane else points
        return jhd.point_set(points) if kind.endswith("points") else jhd.BezierCurve(points, weights)
    x = np.linspace(0.0, 1.0, 3)
    net = np.stack([*np.meshgrid(x, x, indexing="ij"), height + 0.2 * random.normal(size=shape)], axis=-1)
    if kind == "patch":
        return jhd.BezierPatch(net, weights)
    corners = [3 * i + j for i in range(2) for j in range(2)]
    halves = [([k, k + 3, k + 1], [k + 1, k + 3, k + 4]) for k in corners]
    return jhd.TriangleMesh(net.reshape(-1, 3), [triangle for pair in halves for triangle in pair])


def _surface(random: np.random.Generator, height: float) -> jhd.ImplicitSurface:
    """Draw the graph of a quadratic over the square."""
    rows = np.zeros((3, 3, 2))
    rows[0, 0] = -height, 1.0
    for i, j in ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2)):
        rows[i, j, 0] = 0.1 * random.normal()
    return jhd.ImplicitSurface(rows, [0.0, 0.0, height - 0.6], [1.0, 1.0, height + 0.6])


# ---- locations -----------------------------------------------------------------------------------


def places(plain: dict[str, Any]) -> Places:
    """Sample a shape at even parameters of every piece; if implicit, at sign changes along the edges of a grid."""
    if plain["kind"] == "surface":
        return _zeros(plain)
    t = np.linspace(0.0, 1.0, _SAMPLES)
    if plain["kind"] == "mesh":
        ats = [(x, y) for x, y in product(t, t) if x + y <= 1]
        corners = np.array(plain["vertices"])[np.array(plain["triangles"])]
        shares = np.array([(1 - x - y, x, y) for x, y in ats])
        points = np.einsum("ki,nid->nkd", shares, corners)
    else:
        count = np.array(plain["control_points"]).ndim - 2
        is_points = np.array(plain["control_points"]).shape[1] == 1
        t = t[:1] if is_points else t
        ats = [()] if is_points else list(product(t, repeat=count))
        points = _values(plain, t)
    names = [{"piece": k, "at": [float(x) for x in at]} for k in range(len(points)) for at in ats]
    return Places(names, points.reshape(-1, points.shape[-1]))


def _values(plain: dict[str, Any], t: np.ndarray) -> np.ndarray:
    """Evaluate curves or patches at parameters t along each axis, (pieces, points of a piece, dim)."""
    rows = np.array(plain["control_points"], dtype=float)
    weights = np.ones(rows.shape[:-1]) if plain["weights"] is None else np.array(plain["weights"], dtype=float)
    rows = np.concatenate([rows * weights[..., None], weights[..., None]], axis=-1)
    for axis in range(1, rows.ndim - 1):
        n = rows.shape[axis] - 1
        basis = np.stack([comb(n, i) * t**i * (1 - t) ** (n - i) for i in range(n + 1)], axis=1)
        rows = np.moveaxis(np.tensordot(basis, rows, (1, axis)), 0, axis)
    rows = rows.reshape(len(rows), -1, rows.shape[-1])
    return rows[..., :-1] / rows[..., -1:]


def _zeros(plain: dict[str, Any]) -> Places:
    axes = [np.linspace(x, y, _NODES) for x, y in zip(plain["lower"], plain["upper"], strict=True)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    ends = []
    for axis in range(3):
        along = np.moveaxis(nodes, axis, 0)
        first, last = along[:-1], along[1:]
        crossed = value(plain, first) * value(plain, last) < 0
        ends.append(changes(plain, first[crossed], last[crossed]))
    first, last = (np.concatenate(x) for x in zip(*ends, strict=True))
    at, way = (first + last) / 2, (last - first) / 2
    return Places([{"at": p.tolist(), "way": w.tolist()} for p, w in zip(at, way, strict=True)], at)


def changes(plain: dict[str, Any], first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shorten segments on which a polynomial changes its sign, and return the ends of the short ones."""
    for _ in range(_HALVINGS):
        middle = (first + last) / 2
        same = (value(plain, first) * value(plain, middle) > 0)[:, None]
        first, last = np.where(same, middle, first), np.where(same, last, middle)
    return first, last


def value(plain: dict[str, Any], points: np.ndarray) -> np.ndarray:
    """Evaluate the polynomial of an implicit surface at points (..., 3)."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.polynomial.polynomial.polyval3d(x, y, z, np.array(plain["coefficients"], float))


def sampled(a: Places, b: Places) -> dict[str, float]:
    """Compute every distance that a claim may concern, from the sampled points alone."""
    gaps = np.linalg.norm(a.points[:, None] - b.points, axis=-1)
    there, back = float(gaps.min(axis=1).max()), float(gaps.min(axis=0).max())
    return {"a_to_b": there, "b_to_a": back, "two_sided": max(there, back), "minimum": float(gaps.min())}
