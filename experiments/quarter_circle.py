"""Which Bezier curves are best for a quarter of the unit circle in the Hausdorff distance, and are they found?

Four fits: the cubic (1, 0), (1, c), (c, 1), (0, 1) of one parameter, from three starts; the cubic with fixed ends; the
cubic with free ends; the quintic with fixed ends. The radial error |B(t)| - 1 of each fit is computed in rational
arithmetic from its control points, by (|B|^2 - 1) / (|B| + 1), so that no digits are lost when it is 1e-10. The
parameter c after k steps comes from a run with at most k steps, which takes identical steps.

Claims: c comes within 1e-16 of 0.551915024493510570743562722793 in 8, 5 and 9 steps from 0.3, 0.5 and 0.8, faster than
linearly (6.6e-5, 3.0e-9, 2.7e-17 from 0.5); the errors, certified to 1e-12, are the known 1.960764699e-4, 6.84399e-5,
5.50781e-5 and 7.7034e-10; all four fits are stationary to 5e-16, with 3, 5, 7 and 9 maxima equal to 5e-16.

Feeds: figure "quarter circle" and the table of fits.
Takes: 2 minutes, one of them once compiled.
"""

import math
from fractions import Fraction
from typing import Any

import jax.numpy as jnp
import numpy as np
from common import Run, bounds_text, markdown

import jhd
from jhd._results.solution import to_plain

QUARTER = jhd.BezierCurve([(1, 0), (1, 1), (0, 1)], [1, math.sqrt(0.5), 1])
# The optimum of the one-parameter cubic to 30 digits, and the known errors.
BEST = Fraction("0.551915024493510570743562722793")
KNOWN = {
    "parameter": 1.96076469876878174e-4,
    "fixed": 6.84399e-5,
    "free": 5.50781e-5,
    "quintic": 7.7034e-10,
}
STARTS = (0.3, 0.5, 0.8)
# Required accuracy of c.
WITHIN = 1e-12
# The gap of the certified errors: the least that closes when the curves are 7.7e-10 apart.
PROOF = jhd.BranchAndBound(atol=1e-12)
# Maxima are equal within this fraction of the largest, or within the rounding of coordinates of size one.
EQUAL, ROUNDING = 1e-8, 4e-16


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    runs = [_history(start) for start in (STARTS[1:2] if run.smoke else STARTS)]
    solutions = {
        "parameter": _one_parameter(STARTS[1]),
        "fixed": jhd.fit_curve(QUARTER, degree=3, method=PROOF),
        "free": jhd.fit_curve(QUARTER, degree=3, ends="free", method=PROOF),
    }
    if not run.smoke:  # of higher degree than the others: compiled functions of its own
        solutions["quintic"] = jhd.fit_curve(QUARTER, degree=5, method=PROOF)
    samples = 101 if run.smoke else 1001
    fits = {name: _described(name, solution, samples) for name, solution in solutions.items()}
    numbers = {"best": str(BEST), "within": WITHIN, "runs": runs, "fits": fits}
    run.save(numbers, _fit_table(fits) + "\n\n" + _run_table(runs))


def build(c: Any) -> jhd.BezierCurve:
    """Return the cubic of one parameter, symmetric and tangent to the circle at both ends."""
    one, zero = jnp.ones(()), jnp.zeros(())
    return jhd.BezierCurve(jnp.array([[one, zero], [one, c], [c, one], [zero, one]]))


def _one_parameter(start: float, **options: Any) -> jhd.FitSolution:
    return jhd.minimize_hausdorff(build, jnp.asarray(start), QUARTER, method=PROOF, **options)


def _history(start: float) -> dict[str, Any]:
    """Return the parameter, the distance and the optimality at the start and after each step."""
    reports: list[Any] = []
    solution = _one_parameter(start, progress=reports.append)
    steps = int(solution.stats["steps"])
    c = [float(_one_parameter(start, max_steps=k).parameters) for k in range(steps)] + [float(solution.parameters)]
    off = [float(abs(Fraction(x) - BEST)) for x in c]
    return {
        "start": start,
        "c": c,
        "off": off,
        "distance": solution.history,
        "optimality": [report.details["optimality"] for report in reports],
        "steps_within": next((k for k, x in enumerate(off) if x <= WITHIN), None),
        "result": to_plain(solution.result),
        "stats": solution.stats,
    }


def _described(name: str, solution: jhd.FitSolution, samples: int) -> dict[str, Any]:
    """Return all numbers of a fit, its error curve and its critical pairs."""
    points = np.asarray(solution.shape.control_points).reshape(-1, 2)
    valid = np.asarray(solution.pairs.valid)
    value, witness = np.asarray(solution.pairs.value)[valid], to_plain(solution.pairs.witness)
    # The parameter of each pair on the fit, which is the second curve.
    turned = np.array(witness["direction"])[valid] == "b_to_a"
    t = np.where(turned, np.array(witness["t"])[valid], np.array(witness["feet_params"])[valid, 0])
    active = value >= value[0] - max(EQUAL * value[0], ROUNDING)
    fractions = [Fraction(k, samples - 1) for k in range(samples)]
    return {
        "degree": len(points) - 1,
        "known": KNOWN[name],
        "control_points": points,
        "error": solution.error,
        "optimality": solution.optimality,
        "result": to_plain(solution.result),
        "stats": solution.stats,
        "history": solution.history,
        "pairs": {
            "value": value,
            "t": t,
            "sign": [math.copysign(1.0, radial_error(points, Fraction(x))) for x in t],
            "active": active,
            "multiplier": np.asarray(solution.multipliers)[valid],
            "event": np.array(witness["event"])[valid].tolist(),
            "direction": np.array(witness["direction"])[valid].tolist(),
        },
        "active": int(np.sum(active)),
        "spread": float(np.ptp(value[active])),
        "curve": {"t": [float(u) for u in fractions], "error": [radial_error(points, u) for u in fractions]},
    }


def radial_error(control_points: np.ndarray, t: Fraction) -> float:
    """Return |B(t)| - 1 of the stored control points, to the rounding of the result."""
    rows = [[Fraction(x) for x in row] for row in control_points.tolist()]
    while len(rows) > 1:
        rows = [[(1 - t) * x + t * y for x, y in zip(p, q, strict=True)] for p, q in zip(rows, rows[1:], strict=False)]
    squared = sum(x * x for x in rows[0])
    return float(squared - 1) / (math.sqrt(squared) + 1)


def _fit_table(fits: dict[str, Any]) -> str:
    header = ["fit", "lower", "value", "upper", "known", "optimality", "equal maxima", "within", "steps", "result"]
    rows = []
    for name, fit in fits.items():
        error = fit["error"]
        lower, upper = bounds_text(error.lower, error.upper, 10)
        found = [name, lower, f"{float(error.value):.9e}", upper, f"{fit['known']:.9e}"]
        ends = f"{float(fit['optimality']):.1e}", fit["active"], f"{fit['spread']:.1e}"
        rows.append([*found, *ends, int(fit["stats"]["steps"]), fit["result"]])
    return markdown(header, rows)


def _run_table(runs: list[dict[str, Any]]) -> str:
    """Format the errors of c, a row for each step."""
    header = ["step", *(f"c - c* from {run['start']}" for run in runs)]
    count = max(len(run["off"]) for run in runs)
    rows = [[k, *(f"{run['off'][k]:.1e}" if k < len(run["off"]) else "" for run in runs)] for k in range(count)]
    return markdown(header, rows)


if __name__ == "__main__":
    main()
