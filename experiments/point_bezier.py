"""How often do local point projections miss the nearest point of a cubic, and what does never missing it cost?

Three parts. (1) A point slides to the right past a cubic and the foot follows, with jumps (the animation of
PointBezier): steps and errors of each method. (2) The fraction of wrong feet on 10 000 random cubics; control points
and queries are normal in the plane, the query also half and twice as far out. (3) One cubic against 10 000 points: time
and error compared with SciPy's k-d tree on 1e3 to 1e5 samples, in one process on one core.

Claims: the certified methods, BestFirstProjection and ProjectedPolyhedronProjection, are never wrong. The local
methods, interval halving, Newton's method and their hybrid, are wrong on 3 to 16 % of the queries. 10 000 certified
projections take less than half a second, and less than half the time of the k-d tree of 1e5 samples, which errs by more
than 1e-6.

Feeds: animation, strip, figure and tables "point to curve".
Takes: 1 minute, half a minute once compiled.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from common import Run, markdown, seconds
from common_curves import basis, evaluate
from scipy.spatial import KDTree

import jhd

METHODS = (
    jhd.IntervalHalvingProjection(),
    jhd.NewtonProjection(),
    jhd.HybridProjection(),
    jhd.ProjectedPolyhedronProjection(),
    jhd.BestFirstProjection(),
)
CUBIC = np.array([[0.0, 0.5], [0.8, 7.0], [3.0, -5.0], [4.0, 2.2]])
HEIGHT, START, STOP = 1.2, -0.4, 4.4
# A foot is wrong if its distance is too large by this fraction: local methods stop at steps of 1e-8 and less.
WRONG = 1e-6
# Divides the coordinates for the kernels, which need order one; a power of two changes no digit.
SCALE = 16.0

Solver = Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, one_core=True)
    solvers = {_name(method): _solver(method, run.options) for method in METHODS}
    numbers = {"wrong": WRONG, "path": _path(run, solvers), "random": _random(run, solvers), "speed": _speed(run)}
    run.save(numbers, "\n\n".join([_path_table(numbers), _random_table(numbers), _speed_table(numbers)]))


def _solver(method: Any, options: dict[str, Any] | None) -> Solver:
    """Project points (count, 2), each to its own cubic (count, 4, 2), by the kernel under vmap and one jit."""

    def one(point: jax.Array, cubic: jax.Array) -> dict[str, jax.Array]:
        curve = jhd.BezierSegments(cubic[None], None, jnp.array([-1]))
        found, _ = method._one(point, curve, jnp.zeros(1, bool))
        return {"distance": found.distance, "lower": found.lower, "t": found.t, "steps": found.steps}

    @partial(jax.jit, compiler_options=options)
    def many(points: jax.Array, cubics: jax.Array) -> dict[str, jax.Array]:
        return jax.lax.map(lambda pair: jax.vmap(one)(*pair), (points, cubics))

    def solve(points: np.ndarray, cubics: np.ndarray) -> dict[str, np.ndarray]:
        # Blocks of one size, so that all parts of the experiment run one compiled function.
        count, block = len(points), 100
        rows = np.minimum(np.arange(-(-count // block) * block), count - 1).reshape(-1, block)
        found = [many(points[r][None] / SCALE, cubics[r][None] / SCALE) for r in rows]
        joined = {key: np.concatenate([np.asarray(part[key])[0] for part in found])[:count] for key in found[0]}
        return {**joined, "distance": SCALE * joined["distance"], "lower": SCALE * joined["lower"]}

    return solve


def exact(points: np.ndarray, cubics: np.ndarray) -> np.ndarray:
    """Compute distances by NumPy alone: all roots of (P - B).B' as eigenvalues, polished, and both ends."""
    offsets = cubics - points[:, None]
    powers = np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]])
    c = np.einsum("ij,kjd->kid", powers, offsets)
    d = c[:, 1:] * np.array([1, 2, 3])[:, None]
    f = np.zeros((len(points), 6))
    for i in range(4):
        for j in range(3):
            f[:, i + j] += np.sum(c[:, i] * d[:, j], axis=-1)
    companion = np.zeros((len(points), 5, 5))
    companion[:, 1:, :-1] = np.eye(4)
    companion[:, :, -1] = -f[:, :5] / f[:, 5:]
    s = np.clip(np.real(np.linalg.eigvals(companion)), 0.0, 1.0)
    derivative = f[:, 1:] * np.arange(1, 6)
    for _ in range(4):
        value = np.einsum("ki,kri->kr", f, s[..., None] ** np.arange(6))
        slope = np.einsum("ki,kri->kr", derivative, s[..., None] ** np.arange(5))
        s = np.clip(s - value / np.where(slope > 0, slope, np.inf), 0.0, 1.0)
    s = np.concatenate([s, np.zeros((len(s), 1)), np.ones((len(s), 1))], axis=1)
    return np.min(np.linalg.norm(np.einsum("kri,kid->krd", basis(3, s), offsets), axis=-1), axis=1)


def _name(method: Any) -> str:
    return type(method).__name__


def _certified(method: Any) -> bool:
    return isinstance(method, jhd.ProjectedPolyhedronProjection | jhd.BestFirstProjection)


def _path(run: Run, solvers: dict[str, Solver]) -> dict[str, Any]:
    """Run every method on every frame."""
    count = 24 if run.smoke else 121
    points = np.stack([np.linspace(START, STOP, count), np.full(count, HEIGHT)], axis=-1)
    cubics = np.broadcast_to(CUBIC, (count, 4, 2))
    distance = exact(points, cubics)
    found = {name: solve(points, cubics) for name, solve in solvers.items()}
    errors = {name: entry["distance"] - distance for name, entry in found.items()}
    return {"control_points": CUBIC, "points": points, "distance": distance, "methods": found, "errors": errors}


def _path_table(numbers: dict[str, Any]) -> str:
    path = numbers["path"]
    rows = []
    for name, found in path["methods"].items():
        error = path["errors"][name]
        right = error <= WRONG * path["distance"]
        steps = f"{np.mean(found['steps']):.1f}", int(np.max(found["steps"]))
        rows.append([name, *steps, f"{np.max(np.abs(error[right])):.1e}", int(np.sum(~right)), f"{np.max(error):.2g}"])
    header = ["sliding point", "steps (mean)", "steps (most)", "error where right", "wrong frames", "largest error"]
    return markdown(header, rows)


def _random(run: Run, solvers: dict[str, Solver]) -> dict[str, Any]:
    """Return fractions of wrong feet, and the worst error of the certified methods and of their lower bounds."""
    count = 500 if run.smoke else 10_000
    cubics, queries = run.random.standard_normal((count, 4, 2)), run.random.standard_normal((count, 2))
    spreads = (1.0,) if run.smoke else (0.5, 1.0, 2.0)
    found = {}
    for method in METHODS:
        entries = []
        for spread in spreads:
            points = spread * queries
            distance, answer = exact(points, cubics), solvers[_name(method)](points, cubics)
            excess = answer["distance"] - distance
            entries.append(
                {
                    "spread": spread,
                    "wrong": np.mean(excess > WRONG * distance),
                    "largest_excess": excess.max(),
                    "largest_error": np.abs(excess).max() if _certified(method) else None,
                    "lower_above": (answer["lower"] - distance).max(),
                    "steps": np.mean(answer["steps"]),
                }
            )
        found[_name(method)] = entries
    return {"count": count, "methods": found}


def _random_table(numbers: dict[str, Any]) -> str:
    methods = numbers["random"]["methods"]
    spreads = [entry["spread"] for entry in methods["BestFirstProjection"]]
    header = [
        f"{numbers['random']['count']} random cubics",
        *(f"wrong, query x {s:g}" for s in spreads),
        "largest error",
    ]
    return markdown(
        header,
        [
            [name, *(f"{100 * e['wrong']:.2f} %" for e in entries), f"{max(e['largest_excess'] for e in entries):.1e}"]
            for name, entries in methods.items()
        ],
    )


def _speed(run: Run) -> dict[str, Any]:
    """Time 10 000 points against one cubic: jhd.project and the k-d tree of samples."""
    count, repeats = (1000, 2) if run.smoke else (10_000, 9)
    points = CUBIC.mean(axis=0) + 1.5 * run.random.standard_normal((count, 2))
    distance = exact(points, np.broadcast_to(CUBIC, (count, 4, 2)))
    curve = jhd.BezierCurve(CUBIC)
    base = seconds(lambda: jhd.project(points, curve), repeats)
    error = np.max(np.abs(np.asarray(jhd.project(points, curve).distance) - distance))
    entries = [{"name": "jhd.project", "samples": None, "seconds": base, "error": error, "ratio": 1.0}]
    for samples in (1000,) if run.smoke else (1000, 10_000, 100_000):
        rows = evaluate(CUBIC[None], np.linspace(0.0, 1.0, samples))
        query = partial(_sampled, rows, points)
        took, worst = seconds(query, repeats), np.max(query() - distance)
        entries.append(
            {"name": "SciPy k-d tree", "samples": samples, "seconds": took, "error": worst, "ratio": took / base}
        )
    return {"count": count, "entries": entries}


def _sampled(rows: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return distances of points to the nearest row, with a new tree."""
    return KDTree(rows).query(points)[0]


def _speed_table(numbers: dict[str, Any]) -> str:
    speed = numbers["speed"]
    header = [f"{speed['count']} points, one cubic", "samples", "time (ms)", "ratio", "largest error"]
    return markdown(
        header,
        [
            [e["name"], e["samples"] or "", f"{1e3 * e['seconds']:.1f}", f"{e['ratio']:.2f}", f"{e['error']:.1e}"]
            for e in speed["entries"]
        ],
    )


if __name__ == "__main__":
    main()
