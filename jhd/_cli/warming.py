"""The calls of `jhd precompile`: for each kind of shape, small examples that compile the functions needed later.

Compiled functions are kept by the kind of shape, the dimension and the degree. One function serves all curves of up to
some dozens of segments (jhd._distance.normalization.curves), so a call on an example compiles the function for users'
shapes.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

import jhd

# The kinds by name, with their meaning.
KINDS = {
    "plane": "curves in the plane",
    "space": "curves in space",
    "rational": "rational curves in the plane",
    "surfaces": "implicit surfaces",
    "meshes": "triangle meshes",
}


class Preparation(NamedTuple):
    """One call, and its name."""

    name: str
    run: Callable[[], Any]


def preparations(kinds: Sequence[str], degree: int | None = None) -> list[Preparation]:
    """The calls for these kinds.

    Args:
        kinds: names in KINDS.
        degree: degree of curves, and of implicit surfaces in each variable; by default 3 and 2.
    """
    return [Preparation(f"{KINDS[kind]}: {name}", run) for kind in kinds for name, run in _calls(kind, degree)]


def _calls(kind: str, degree: int | None) -> Iterator[tuple[str, Callable[[], Any]]]:
    if kind == "meshes":
        a, b = _mesh(0.0), _mesh(0.5)
    elif kind == "surfaces":
        n = 2 if degree is None else degree
        a, b = (jhd.ImplicitSurface.parse(f"x**{n} + y**{n} + z**{n} - {size}", -2.0, 2.0) for size in (1, 2))
    else:
        n = 3 if degree is None else degree
        a, b = (_curve(n, 3 if kind == "space" else 2, kind == "rational", move) for move in (0.0, 0.5))
    yield "Hausdorff distance", partial(jhd.hausdorff, a, b, throw=False)
    yield "decision", partial(jhd.hausdorff_at_most, a, b, 1.0)
    yield "minimum distance", partial(jhd.minimum_distance, a, b, throw=False)
    yield (
        "nearest points",
        partial(jhd.project, np.zeros((1, 2 if kind in ("plane", "rational") else 3)), b, throw=False),
    )
    if isinstance(a, jhd.BezierCurve):
        yield "derivative", partial(_derivative, a, b)


def _curve(degree: int, dim: int, rational: bool, move: float) -> jhd.BezierCurve:
    t = np.linspace(0.0, 1.0, degree + 1)
    points = np.stack([t, t * (1 - t) + move, t**2 + move][:dim], axis=1)
    return jhd.BezierCurve(points, 1.0 + t if rational else None)


def _mesh(move: float) -> jhd.TriangleMesh:
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return jhd.TriangleMesh(corners + [move, 0.0, 0.0], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def _derivative(a: jhd.BezierCurve, b: Any) -> Any:
    def value(points: jax.Array) -> jax.Array:
        return jhd.hausdorff(jhd.BezierCurve(points, a.weights), b, throw=False).value

    return jax.value_and_grad(value)(a.control_points)
