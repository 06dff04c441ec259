"""Certificates made by hand, exact to the last digit, and what is done to them in tests."""

import copy
import math
from typing import Any

import numpy as np

# Corners of the unit square, which a patch and two triangles have in common.
SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


def cell(piece, where, foot, rows, weights=None, bound=1.0):
    """A cell with one foot."""
    feet = [{"piece": foot, "map": rows, "weights": weights}]
    return {"piece": piece, "cell": where, "feet": feet, "multipliers": None, "bound": bound}


def curve(control_points, weights=None):
    """A curve as certificates have it."""
    return {"kind": "curve", "control_points": control_points, "weights": weights}


def content(kind, bounds, shapes, cells, witness):
    """A certificate of these parts."""
    claim = {"kind": kind, "lower": bounds[0], "upper": bounds[1]}
    head = {"format": "jhd-certificate", "version": 2, "claim": claim, "a": shapes[0], "b": shapes[1]}
    return {**head, "orders": None, "cells": cells, "witness": witness}


def arch():
    """The arch over its chord, whose Hausdorff distance is its height 3/4, without any slack on either side."""
    halves = [([0.0, 0.5], [0.0, 0.125, 0.3125, 0.5]), ([0.5, 1.0], [0.5, 0.6875, 0.875, 1.0])]
    there = [cell(0, t, 0, [[s] for s in sigma], bound=0.75) for t, sigma in halves]
    back = cell(0, [0, 1], 0, [[0], [1]], bound=0.75)
    shapes = curve([[[-1.0, 0.0], [-0.5, 1.0], [0.5, 1.0], [1.0, 0.0]]]), curve([[[-1.0, 0.0], [1.0, 0.0]]])
    witness = {"direction": "a_to_b", "piece": 0, "at": [0.5], "cuts": None}
    return content("two_sided", (0.75, 0.75), shapes, {"a_to_b": there, "b_to_a": [back]}, witness)


def circles():
    """Concentric circles in quarters of weights 1, 1, 2: the distance of any point of the inner one is exactly 1."""
    corners = np.array([(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)], dtype=float)
    quarters = np.stack([corners[i : i + 3] for i in (0, 2, 4, 6)])
    cells = [cell(k, [0, 1], k, [[0], [1]], w) for k, w in enumerate([None, [1, 1], None, [1.0, 1.0]])]
    shapes = [curve((r * quarters).tolist(), [[1.0, 1.0, 2.0]] * 4) for r in (1, 2)]
    witness = {"direction": "a_to_b", "piece": 0, "at": [0.0], "cuts": None}
    return content("directed", (1.0, 1.0), shapes, {"a_to_b": cells}, witness)


def square():
    """A patch at height 0 and two triangles at height 1; the lower left half of the patch is cut once more."""
    net = [[[x, y, 0.0] for y in (0.0, 1.0)] for x in (0.0, 1.0)]
    patch = {"kind": "patches", "control_points": [net], "weights": None}
    mesh = {"kind": "mesh", "vertices": [[*p, 1.0] for p in SQUARE], "triangles": [[0, 1, 2], [0, 2, 3]]}
    there = [
        cell(0, "0c", 0, [[0, 0], [1, 0], [0, 0.5]]),
        cell(0, "0d", 0, [[0, 0.5], [1, 0], [0, 1]]),
        cell(0, "1", 1, [[0, 0], [0, 1], [1, 0]]),
    ]
    back = [cell(0, "", 0, [[0, 0], [1, 0], [1, 1]]), cell(1, "", 0, [[0, 0], [1, 1], [0, 1]])]
    witness = {"direction": "a_to_b", "piece": 0, "at": [0.25, 0.5], "cuts": None}
    return content("two_sided", (1.0, 1.0), (patch, mesh), {"a_to_b": there, "b_to_a": back}, witness)


def facing():
    """The same patch and triangles, whose least distance is 1 too: one pair for each triangle."""
    made = square()
    cells = {"apart": [{"pair": letter, "plane": [0.0, 0.0, 2.0]} for letter in "XY"]}
    witness = {"a": {"piece": 0, "at": [0.25, 0.5]}, "b": {"piece": 1, "at": [0.25, 0.25]}}
    claim = {"kind": "minimum", "lower": 1.0, "upper": 1.0}
    return {**made, "claim": claim, "orders": {"a": None, "b": [1, 0]}, "cells": cells, "witness": witness}


def between():
    """A segment between two points: in its middle both are 5/4 away, and multipliers must grow with their slacks."""
    shapes = curve([[[-1.0, 0.75], [1.0, 0.75]]]), curve([[[-1.0, 0.0]], [[1.0, 0.0]]])
    feet = [{"piece": k, "map": [[]], "weights": None} for k in (0, 1)]
    one = {"piece": 0, "cell": [0.0, 1.0], "feet": feet, "multipliers": [[3.0, 1.0], [1.0, 3.0]], "bound": 1.25}
    witness = {"direction": "a_to_b", "piece": 0, "at": [0.5], "cuts": None}
    return content("directed", (1.25, 1.25), shapes, {"a_to_b": [one]}, witness)


def near_zero(kind, bounds, height=-0.125):
    """A claim about a narrow piece of the plane z = 0 and a point above it, shown by a point this high.

    The plane crosses the way of length 1/4 up and down from the point, and is exactly 1 below the other shape.
    """
    narrow = 2.0**-20
    plane = {
        "kind": "surface",
        "coefficients": [[[0.0, 1.0]]],
        "lower": [0.0, 0.0, -1.0],
        "upper": [narrow, narrow, 1.0],
    }
    place, point = {"at": [0.0, 0.0, height], "way": [0.0, 0.0, 0.25]}, curve([[[0.0, 0.0, 1.0]]])
    witness = {"direction": "a_to_b", **place, "cuts": None}
    if kind == "minimum":
        witness = {"a": place, "b": {"piece": 0, "at": []}}
    made = content(kind, bounds, (plane, point), None, witness)
    return {**made, "orders": {"a": None, "b": None}} if kind == "minimum" else made


def changed(made, path, value):
    """A copy with one entry replaced; a value of `...` takes it away."""
    made = copy.deepcopy(made)
    *parents, last = path
    place = made
    for key in parents:
        place = place[key]
    if value is ...:
        del place[last]
    else:
        place[last] = value
    return made


def numbers(value, path=()):
    """The paths of all numbers."""
    if isinstance(value, bool | str) or value is None:
        return []
    if isinstance(value, int | float):
        return [path]
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return [found for key, item in items for found in numbers(item, (*path, key))]


def at(made, path) -> Any:
    """The entry at a path."""
    for key in path:
        made = made[key]
    return made


def sampled(shape, count):
    """Points of a shape: about so many parameters each way on each of its pieces."""
    t = np.linspace(0.0, 1.0, count)
    if shape["kind"] == "mesh":
        corners = np.array(shape["vertices"])[np.array(shape["triangles"])]
        shares = np.array([(1 - x - y, x, y) for x in t for y in t if x + y <= 1 + 1e-12])
        return np.einsum("ki,nid->nkd", shares, corners).reshape(-1, 3)
    rows = np.array(shape["control_points"], dtype=float)
    weights = np.ones(rows.shape[:-1]) if shape["weights"] is None else np.array(shape["weights"], dtype=float)
    rows = np.concatenate([rows * weights[..., None], weights[..., None]], axis=-1)
    for axis in range(1, rows.ndim - 1):
        n = rows.shape[axis] - 1
        basis = np.stack([math.comb(n, i) * t**i * (1 - t) ** (n - i) for i in range(n + 1)], axis=1)
        rows = np.moveaxis(np.tensordot(basis, rows, (1, axis)), 0, axis)
    rows = rows.reshape(-1, rows.shape[-1])
    return rows[:, :-1] / rows[:, -1:]


def sampled_distance(made, counts=(129, 2049)):
    """The distance that the claim is about, of samples."""
    if made["claim"]["kind"] == "minimum":
        p, q = (sampled(made[name], counts[1]) for name in "ab")
        return min(np.sqrt(((x - q) ** 2).sum(-1).min()) for x in p)
    pairs = ("ab", "ba") if made["claim"]["kind"] == "two_sided" else ("ab",)
    sets = [(sampled(made[x], counts[0]), sampled(made[y], counts[1])) for x, y in pairs]
    return max(np.sqrt(((p[:, None] - q) ** 2).sum(-1).min(1).max()) for p, q in sets)
