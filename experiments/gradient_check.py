"""Is the derivative of a Hausdorff distance right if the nearest point jumps, and how wrong is naive autodiff?

Two parts. (1) An arc rises inside a parabola and then turns on its side. So the directed distance passes from one foot
(antipodal) to two feet (one-to-two), and to an end of the arc. Along this path three derivatives are compared: the rule
of jhd; automatic differentiation through max and min, which differentiates the one pair of points that they pick; and
central differences of the certified value. (2) Random pairs of every kind of curve, along random directions in all
control points, weights and knots: the largest relative error of the rule, and of second derivatives, for each kind of
event.

Claims: first and second derivatives agree with differences to 1e-6 for all events; naive differentiation is wrong
whenever two feet are active, on this path by up to 1.2 when the derivative is 2.1.

Feeds: figure "gradient check" and the table of errors.
Takes: 3 minutes, two once compiled.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from common import Run, markdown

import jhd
from jhd._results.solution import name_of

# As a cubic, so that it needs no other compiled functions than two random cubics.
PARABOLA = jnp.array([[-2.0, 4.0], [-2 / 3, -4 / 3], [2 / 3, -4 / 3], [2.0, 4.0]])
ARC = jnp.array([[-0.35, -0.05], [-0.12, 0.1], [0.12, 0.1], [0.35, -0.05]])
# The arc turns from this parameter of the path on, by TURN radians times the cube of the parameter beyond it.
TURN_FROM, TURN = 0.45, 11.0
# Step of the differences of values and of gradients.
STEP = 1e-5
KINDS = (
    ("bezier", "bezier"),
    ("rational", "bezier"),
    ("space", "space"),
    ("polyline", "bezier"),
    ("closed", "closed"),
    ("spline", "bezier"),
    ("nurbs", "closed"),
    ("bezier", "polyline"),
)


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    path = _path(np.linspace(0.0, 1.0, 9 if run.smoke else 161))
    pairs = _pairs(run, KINDS[:1] if run.smoke else KINDS, 2 if run.smoke else 12)
    header = ["event", "pairs", "largest error, first derivative", "second"]
    rows = [[event, len(e["first"]), *(f"{max(e[k]):.1e}" for k in ("first", "second"))] for event, e in pairs.items()]
    wrong = max(abs(x - y) for x, y in zip(path["naive"], path["difference"], strict=True))
    right = max(abs(x - y) for x, y in zip(path["rule"], path["difference"], strict=True))
    text = f"Along the path: the rule is off by at most {right:.1e}, naive differentiation by up to {wrong:.2f}."
    run.save({"path": path, "pairs": pairs, "step": STEP}, markdown(header, rows) + "\n\n" + text)


def arc(u: Any) -> jhd.BezierCurve:
    """Return the arc at a parameter of the path."""
    angle = -TURN * jnp.maximum(u - TURN_FROM, 0.0) ** 3
    turned = jnp.array([[jnp.cos(angle), -jnp.sin(angle)], [jnp.sin(angle), jnp.cos(angle)]])
    return jhd.BezierCurve(ARC @ turned.T + jnp.array([0.03 + 0.1 * u, 0.2 + u]))


def _distance(u: Any) -> jhd.HausdorffSolution:
    return jhd.directed_hausdorff(arc(u), jhd.BezierCurve(PARABOLA))


def _path(places: np.ndarray) -> dict[str, Any]:
    """Compute distance and derivatives along the path; no differences if the event changes within their step."""
    rule = jax.value_and_grad(lambda u: _distance(u).value)
    numbers: dict[str, Any] = {key: [] for key in ("u", "value", "event", "rule", "naive", "difference")}
    for u in places:
        here, *near = (_distance(x) for x in (u, u + STEP, u - STEP))
        if len({name_of(s.event) for s in (here, *near)}) > 1:
            continue
        value, slope = rule(u)
        difference = (float(near[0].value) - float(near[1].value)) / (2 * STEP)
        for key, number in zip(
            numbers, (u, value, name_of(here.event), slope, _naive(u, here), difference), strict=True
        ):
            numbers[key].append(number if isinstance(number, str) else float(number))
    return {**numbers, "parabola": np.asarray(PARABOLA), "arcs": [np.asarray(arc(u).control_points) for u in places]}


def _naive(u: float, solution: jhd.HausdorffSolution) -> jax.Array:
    """Return the derivative of the distance of the one pair that max and min pick, as autodiff through them does."""
    t, s = solution.witness.t, solution.witness.feet_params[0]
    foot = jhd.BezierCurve(PARABOLA)(s)
    return jax.grad(lambda u: jnp.linalg.norm(arc(u)(t) - foot))(u)


def _pairs(run: Run, kinds: tuple, count: int) -> dict[str, dict[str, list[float]]]:
    """Return relative errors of first and second derivatives, by event."""
    errors: dict[str, dict[str, list[float]]] = {}
    for first, second in kinds:
        for _ in range(count):
            shapes = curve(first, run.random), curve(second, run.random, 1.3)
            found = _errors(shapes, jax.tree_util.tree_map(lambda x: _move(run, x), shapes))
            if found is not None:
                entry = errors.setdefault(found[0], {"first": [], "second": []})
                entry["first"].append(found[1])
                entry["second"].append(found[2])
    return dict(sorted(errors.items()))


def _move(run: Run, x: Any) -> Any:
    """Return a random direction, small enough to keep the order of knots."""
    return jnp.asarray(0.02 * run.random.normal(size=x.shape)) if eqx.is_inexact_array(x) else None


def _errors(shapes: Any, move: Any) -> tuple[str, float, float] | None:
    """Return the event and both errors; None if the event changes within the step of the differences."""

    def moved(h: Any) -> Any:
        return jax.tree_util.tree_map(lambda x, v: x if v is None else x + h * v, shapes, move, is_leaf=_is_none)

    def value(h: Any) -> jax.Array:
        return jhd.directed_hausdorff(*moved(h)).value

    slope = jax.grad(value)
    here, *near = (jhd.directed_hausdorff(*moved(h)) for h in (0.0, STEP, -STEP))
    if len({name_of(s.event) for s in (here, *near)}) > 1:
        return None
    if max(float(jnp.max(jnp.abs(s.witness.point - here.witness.point))) for s in near) > 0.01:
        return None
    first = (float(near[0].value) - float(near[1].value)) / (2 * STEP)
    second = (float(slope(STEP)) - float(slope(-STEP))) / (2 * STEP)
    # If a derivative happens to vanish, errors are relative to the size of the move, 0.02, or to its square.
    off = abs(float(slope(0.0)) - first) / max(abs(first), 0.02)
    return name_of(here.event), off, abs(float(jax.grad(slope)(0.0)) - second) / max(abs(second), 4e-4)


def _is_none(x: Any) -> bool:
    return x is None


def curve(kind: str, random: np.random.Generator, spread: float = 1.0) -> jhd.BezierCurve | jhd.BSplineCurve:
    """Return a random curve of a kind."""
    if kind in ("closed", "nurbs"):
        angle = 2 * np.pi * np.arange(7) / 7
        rows = spread * np.stack([np.cos(angle), np.sin(angle)], axis=1) + 0.2 * random.normal(size=(7, 2))
        weights = np.exp(0.3 * random.normal(size=7)) if kind == "nurbs" else None
        return jhd.BSplineCurve.uniform(rows, periodic=True, weights=weights)
    if kind == "spline":
        knots = np.concatenate([np.zeros(4), np.sort(random.uniform(0.1, 0.9, 3)), np.ones(4)])
        return jhd.BSplineCurve(spread * random.normal(size=(7, 2)), knots)
    if kind == "polyline":
        return jhd.BSplineCurve.clamped(spread * random.normal(size=(4, 2)), degree=1)
    weights = np.exp(0.5 * random.normal(size=4)) if kind == "rational" else None
    return jhd.BezierCurve(spread * random.normal(size=(4, 3 if kind == "space" else 2)), weights)


if __name__ == "__main__":
    main()
