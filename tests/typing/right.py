"""Calls as a user writes them, which a strict type checker accepts; test_calls.py runs them."""
# pyright: strict, reportUnnecessaryTypeIgnoreComment=true

from collections.abc import Callable
from pathlib import Path
from typing import cast

import jax
import numpy as np
from jaxtyping import Array
from matplotlib.figure import Figure

import jhd
from jhd.typing import Curve, Method, Numbers, Result, Shape, ShapeLike, Statistic, Surface

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def gradient(loss: Callable[[Array], Array], at: float | Array) -> Array:
    return cast(Array, jax.grad(loss)(at))  # pyright: ignore[reportUnknownMemberType]


def height(shift: Array) -> Array:
    return jhd.directed_hausdorff(jhd.polyline(shift + SQUARE), jhd.circle((0, 0), 2)).value


def two_curves_and_a_gradient() -> Array:
    found: jhd.HausdorffSolution = jhd.hausdorff([(0, 0), (1, 2)], SQUARE, atol=1e-6, throw=False)
    place: Array = found.witness.point
    event: str = jhd.EVENTS[found.event]
    ended: Result = found.result
    assert found.ok and ended == jhd.RESULTS.successful and event and place.shape == (2,)
    return gradient(height, place)


def a_mesh_and_a_spline_surface() -> tuple[float, float]:
    net = [[[x, y, 0.1 * x * y] for y in range(4)] for x in range(4)]
    surface: Surface = jhd.BSplineSurface.clamped(net, (3, 3))
    mesh = jhd.TriangleMesh([(0, 0, 0), (3, 0, 0), (0, 3, 0)], [(0, 1, 2)])
    found = jhd.hausdorff(mesh, surface, rtol=1e-2)
    return float(found.lower), float(found)


def nearest() -> list[int]:
    queries: list[ShapeLike] = [SQUARE, jhd.circle((0, 0), 1), [(0, 0), (1, 1)]]
    found = jhd.nearest_shapes(queries, [jhd.circle((0.1, 0), 1), SQUARE], k=1)
    table: jhd.Pairwise = jhd.pairwise(queries)
    return [int(k) for k in found.index[:, 0]] + [int(n) for n in table.value.shape]


def build(half: Array) -> jhd.BezierSegments:
    return jhd.polyline([(-half, half), (half, half)])


def a_loop() -> int:
    target = jhd.polyline([(-1, 1), (1, 1)])
    parameters = gradient(lambda half: jhd.hausdorff(build(half), target).value, 0.5)
    for _ in range(2):
        parameters = parameters - 0.1 * gradient(lambda half: jhd.hausdorff(build(half), target).value, parameters)
    fit = jhd.minimize_hausdorff(build, parameters, target, statistic=jhd.MaxDistance(), max_steps=3)
    return fit.shape.count + int(fit.stats["steps"])


def points_and_means(curve: Curve, statistic: Statistic, method: Method, weights: Numbers) -> float:
    found = jhd.deviation(SQUARE, curve, weights=weights, rtol=1e-2)
    feet = jhd.project((0.5, 0.25), curve)
    decided = jhd.hausdorff_at_most(SQUARE, curve, 3, method)
    return float(found.quantile(0.5)) + float(feet.distance) + float(statistic(SQUARE, curve)) + float(bool(decided))


def files(folder: Path) -> Shape:
    jhd.io.save_svg(folder / "square.svg", jhd.polyline(SQUARE, closed=True))
    found = jhd.hausdorff(SQUARE, jhd.io.load_svg(folder / "square.svg"))
    jhd.io.save_result(folder / "found.json", found, seed=7)
    kind: object = jhd.io.load_result(folder / "found.json")["type"]
    assert kind == "HausdorffSolution" and found.to_json(indent=2)
    return jhd.io.load_shape(folder / "square.svg")


def a_picture() -> str:
    a, b = jhd.polyline(SQUARE), jhd.circle((0, 0), 1)
    ax = jhd.plot.solution(a, b, jhd.hausdorff(a, b), Figure().add_subplot())
    return ax.get_xlabel()
