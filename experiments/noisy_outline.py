"""How near do 20 cubics come to noisy outlines of 100 to 10 000 vertices, compared with the usual methods?

The outline is a closed curve with five bulges. Its vertices are displaced at random by 0.01 (normal, in both
coordinates) and joined by straight lines. It is fitted by a closed chain of 20 cubics, 60 free points. jhd.fit_curve
begins with least squares and lowers the largest distance. Adam starts from these least squares too, with a cosine
schedule and the best of three rates. It minimizes three distances of samples of both curves: Chamfer, soft Hausdorff
(log sum exp at a tenth of the distance) and hard Hausdorff. The last method is SciPy's periodic smoothing spline,
smoothed until it has at most as many knots. jhd.hausdorff proves the errors of all. Each method runs once before it is
timed, in CPU seconds.

Claims: the fit is certified to be nearer than its start and than every other method, for all numbers of vertices; its
time grows more slowly than the number of vertices.

Feeds: figure "cubics to noisy outlines" and its table.
Takes: 10 minutes.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from common import Run, markdown
from scipy.interpolate import splprep

import jhd

COUNTS = (100, 300, 1000, 3000, 10_000)
SEGMENTS, NOISE = 20, 0.01
STEPS, RATES = 600, (3e-4, 1e-3, 3e-3)
# Samples of the target and of each cubic in the losses of samples.
TARGET_SAMPLES, EACH = 2000, 16
LOSSES = ("Chamfer", "soft Hausdorff", "hard Hausdorff")


class _Sizes(NamedTuple):
    """Cubics, steps of the fit, steps of Adam, and its rates."""

    segments: int
    fit_steps: int
    steps: int
    rates: tuple[float, ...]


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    sizes = _Sizes(8, 2, 30, RATES[1:2]) if run.smoke else _Sizes(SEGMENTS, 60, STEPS, RATES)
    cases = [_case(run, count, sizes) for count in ((140,) if run.smoke else COUNTS)]
    header = ["vertices", "method", "certified distance", "seconds", "ratio to the fit"]
    rows = [
        [case["vertices"], name, f"{found['upper']:.6f}", f"{found['seconds']:.2f}", f"{found['ratio']:.2f}"]
        for case in cases
        for name, found in case["methods"].items()
    ]
    run.save({"cases": cases, "segments": sizes.segments, "noise": NOISE}, markdown(header, rows))


def outline(count: int, random: np.random.Generator) -> np.ndarray:
    """Return the vertices of a noisy outline."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    radius = 1 + 0.25 * np.cos(3 * angle) + 0.12 * np.sin(5 * angle)
    exact = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return exact + NOISE * random.normal(size=exact.shape)


def _case(run: Run, count: int, sizes: _Sizes) -> dict[str, Any]:
    """Fit one outline by all methods."""
    segments = sizes.segments
    points = outline(count, run.random)
    target = jhd.polyline(points, closed=True)
    history: list[list[float]] = []

    def fitted(max_steps: int = sizes.fit_steps) -> jhd.BezierSegments:
        began = time.process_time()
        history.clear()
        note = lambda news: history.append([time.process_time() - began, news.details["value"]])  # noqa: E731
        return jhd.fit_curve(target, degree=3, segments=segments, max_steps=max_steps, progress=note).shape

    start = fitted(0)
    methods = {"least squares": (start, 0.0), "minimax fit": _timed(run, fitted, lambda: fitted(1))}
    steps_taken = list(history)
    free = jnp.asarray(start.control_points)[:, :-1]
    samples = jnp.asarray(points[:: max(1, count // TARGET_SAMPLES)])
    for loss in LOSSES:
        runs = [_timed(run, partial(_adam, free, samples, loss, rate, sizes.steps)) for rate in sizes.rates]
        shapes = [(_loop(found), seconds) for found, seconds in runs]
        nearest = min(shapes, key=lambda found: float(jhd.hausdorff(target, found[0], throw=False).upper))
        methods[f"Adam, {loss}"] = (nearest[0], sum(seconds for _, seconds in shapes))
    methods["smoothing spline"] = _timed(run, lambda: _smoothed(points, segments))
    found = {name: _measured(target, *entry) for name, entry in methods.items()}
    for entry in found.values():
        entry["ratio"] = entry["upper"] / found["minimax fit"]["upper"]
    return {
        "vertices": count,
        "points": points if count <= 1000 else None,
        "methods": found,
        "history": steps_taken,
        "shape": np.asarray(methods["minimax fit"][0].control_points),
        "start": np.asarray(start.control_points),
    }


def _timed(run: Run, function: Callable[[], Any], before: Callable[[], Any] | None = None) -> tuple[Any, float]:
    """Return the result of a function, and its CPU seconds once its compiled functions exist."""
    run.warm(function if before is None else before)
    began = time.process_time()
    return jax.block_until_ready(function()), time.process_time() - began


def _measured(target: jhd.BezierSegments, shape: Any, seconds: float) -> dict[str, float]:
    error = jhd.hausdorff(target, shape, throw=False)
    return {"lower": float(error.lower), "upper": float(error.upper), "seconds": seconds}


def _loop(free: Any) -> jhd.BezierSegments:
    """Return the closed chain with the points (segments, 3, 2); the last point of a segment belongs to the next one."""
    points = np.concatenate([free, np.roll(free, -1, axis=0)[:, :1]], axis=1)
    return jhd.BezierSegments(points, None, np.roll(np.arange(len(points)), -1))


@partial(jax.jit, static_argnames=("loss", "steps"))
def _adam(free: Any, samples: Any, loss: str, rate: Any, steps: int) -> Any:
    """Return the free points after `steps` steps of Adam on a loss of samples."""
    t = jnp.linspace(0.0, 1.0, EACH, endpoint=False)[:, None]
    basis = jnp.concatenate([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)

    def value(free: Any) -> Any:
        whole = jnp.concatenate([free, jnp.roll(free, -1, axis=0)[:, :1]], axis=1)
        places = jnp.einsum("tp,spd->std", basis, whole).reshape(-1, 2)
        squares = jnp.sum((places[:, None] - samples) ** 2, axis=-1)
        off = jnp.concatenate([jnp.min(squares, axis=0), jnp.min(squares, axis=1)])
        if loss == "Chamfer":
            return jnp.mean(jnp.min(squares, axis=0)) + jnp.mean(jnp.min(squares, axis=1))
        off = jnp.sqrt(off + 1e-24)
        heat = 0.1 * jax.lax.stop_gradient(jnp.max(off))
        return jnp.max(off) if loss == "hard Hausdorff" else heat * jax.nn.logsumexp(off / heat)

    def step(k: Any, state: Any) -> Any:
        free, mean, square = state
        slope = jax.grad(value)(free)
        mean, square = 0.9 * mean + 0.1 * slope, 0.999 * square + 0.001 * slope**2
        length = rate * 0.5 * (1 + jnp.cos(jnp.pi * k / steps))
        root = jnp.sqrt(square / (1 - 0.999 ** (k + 1.0))) + 1e-12
        return free - length * mean / (1 - 0.9 ** (k + 1.0)) / root, mean, square

    return jax.lax.fori_loop(0, steps, step, (free, jnp.zeros_like(free), jnp.zeros_like(free)))[0]


def _smoothed(points: np.ndarray, segments: int) -> Any:
    """Return SciPy's periodic smoothing spline of at most `segments` spans, by halving its smoothing factor."""
    closed = np.vstack([points, points[:1]])
    low, high = 0.0, 100 * NOISE**2 * len(points)
    for _ in range(30):
        smoothing = 0.5 * (low + high)
        (knots, coefficients, degree), _ = _spline(closed, smoothing)
        few = len(np.unique(knots)) - 1 - 2 * degree <= segments
        low, high = (low, smoothing) if few else (smoothing, high)
    (knots, coefficients, degree), _ = _spline(closed, high)
    return jhd.BSplineCurve(np.array(coefficients).T, knots)


def _spline(closed: np.ndarray, smoothing: float) -> Any:
    return splprep(closed.T, s=smoothing, per=True)


if __name__ == "__main__":
    main()
