"""How many arcs does a plane curve need for a tolerance, and what fraction of the certified deviation is attained?

Biarcs replace five curves: a convex cubic, a cubic that inflects, a cubic with a cusp, an ellipse of rational
quadratics, and a closed cubic spline of 24 control points. Tolerances go from 1e-1 to 1e-8 of the diagonal of the box.
The number of arcs is compared with theory. With curvature k and arc length s, a biarc of length L errs by |dk/ds| L^3 /
324. If all biarcs of a curve err by one tolerance e, the curve has 2 int |dk/ds|^(1/3) ds / (324 e)^(1/3) arcs. Halving
can miss that number by a factor of two. Certified deviations are compared with the distances of samples of each piece
from its arc, and with the Hausdorff distance of curve and arcs, certified by branch and bound.

Claims: from a tolerance of 1e-4 on the number grows with its power -0.31 to -0.34, and is 1.3 to 2.0 times the number
by theory; no sample lies beyond the deviation certified for its arc; the farthest sample and the Hausdorff distance,
certified to a hundredth, both reach 0.84 to 0.955 of the largest deviation and agree to a hundredth.

Feeds: figure "number of biarcs" and its table.
Takes: 5 minutes, half a minute once compiled.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from common import Run, markdown
from common_cao14 import ring

import jhd
from jhd._results.solution import name_of

# The cusp's parameter; if it were dyadic, halving would meet it.
CUSP = 0.4
SMOOTH = ((0, 0), (1, 2), (3, 2.5), (4, 0))
INFLECTING = ((0, 0), (1, 2), (3, -2), (4, 1))
# Tolerances below this fraction of the diagonal count for the slope.
ASYMPTOTIC = 1e-4
# Samples of a piece, and of a segment for the integral of the theory.
SAMPLES, NODES = 65, 20_000
# The figure shows the arcs of this tolerance.
DRAWN = 1e-3
# Gap of the distance, as a fraction of the certified deviation; curves this close need more steps than the default.
GAP, STEPS = 0.01, 50_000


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__)
    chosen = curves()
    powers = range(1, 9)
    if run.smoke:
        chosen, powers = {name: chosen[name] for name in ("inflecting", "cusped")}, range(1, 4)
    found = {name: _measured(curve.segments(), [10.0**-k for k in powers]) for name, curve in chosen.items()}
    run.save({"asymptotic": ASYMPTOTIC, "drawn": DRAWN, "curves": found}, _table(found))


def curves() -> dict[str, jhd.BezierCurve | jhd.BezierSegments | jhd.BSplineCurve]:
    """Return the curves by name; lengths have no unit."""
    return {
        "smooth": jhd.BezierCurve(SMOOTH),
        "inflecting": jhd.BezierCurve(INFLECTING),
        "cusped": jhd.BezierCurve(_cusped()),
        "rational": jhd.circle([0, 0], 1).transform(np.diag([3.0, 1.0])),
        "spline": ring("example_1_b", 24),
    }


def _cusped() -> np.ndarray:
    """Return a cubic whose velocity is (t - CUSP) times a vector that runs from p to q."""
    p, q = np.array([1.0, 2.0]), np.array([3.0, -2.0])
    before, after = -CUSP, 1 - CUSP
    steps = [before * p, 0.5 * (before * q + after * p), after * q]
    return np.cumsum([np.zeros(2), *steps], axis=0)


def _measured(curve: jhd.BezierSegments, shares: list[float]) -> dict[str, Any]:
    """Measure one curve at all tolerances."""
    low, high = curve.bounds
    diagonal = float(jnp.linalg.norm(high - low))
    rows = [_at(curve, share, diagonal) for share in shares]
    theory = _theory(curve)
    for row in rows:
        row["theory"] = theory / (324 * row["tolerance"]) ** (1 / 3)
    used = [row for row in rows if row["share"] <= ASYMPTOTIC * 1.01]
    slope = None
    if len(used) > 2:
        x, y = (np.log([row[key] for row in used]) for key in ("share", "arcs"))
        slope = float(np.polyfit(x, y, 1)[0])
    arcs = jhd.biarcs(curve, DRAWN * diagonal)
    drawn = {"control_points": arcs.segments().control_points, "weights": arcs.segments().weights}
    return {"diagonal": diagonal, "slope": slope, "rows": rows, "drawn": drawn}


def _at(curve: jhd.BezierSegments, share: float, diagonal: float) -> dict[str, Any]:
    """Return the arcs for one tolerance, their certified and sampled deviations, and their distance from the curve."""
    arcs = jhd.biarcs(curve, share * diagonal)
    certified, sampled = np.asarray(arcs.deviation), _sampled(curve, arcs)
    most = float(certified.max())
    # The last term is the rounding error of the distance from a point to an arc.
    if not (np.all(sampled <= certified + 1e-14 * diagonal) and most <= share * diagonal):
        raise AssertionError(f"a deviation exceeds its certified bound at {share:g} of the diagonal")
    method = jhd.BranchAndBound(atol=GAP * most, max_steps=STEPS)
    distance = jhd.hausdorff(curve, arcs.segments(), method)
    if float(distance.lower) > most:
        raise AssertionError(f"the arcs are farther than {most:g} from the curve: {distance}")
    curved = np.asarray(arcs.bulge) != 0
    return {
        "share": share,
        "tolerance": share * diagonal,
        "arcs": arcs.count,
        "lines": int(np.sum(~curved)),
        "deviation": most,
        "sampled": float(sampled.max()),
        "used": np.percentile((sampled / certified)[curved], [0, 50, 100]),
        "lower": distance.lower,
        "upper": distance.upper,
        "result": name_of(distance.result),
    }


def _sampled(curve: jhd.BezierSegments, arcs: jhd.BiarcCurve) -> np.ndarray:
    """Compute for each arc the largest distance of samples of its piece from it, in NumPy."""
    share = np.linspace(0, 1, SAMPLES)
    t0, t1 = (np.asarray(t)[:, None] for t in (arcs.t0, arcs.t1))
    x = np.asarray(curve.point(jnp.broadcast_to(arcs.segment[:, None], (arcs.count, SAMPLES)), t0 + (t1 - t0) * share))
    return np.max(_distance(x, *(np.asarray(y)[:, None] for y in (arcs.start, arcs.end, arcs.bulge))), axis=1)


def _distance(x: np.ndarray, start: np.ndarray, end: np.ndarray, bulge: np.ndarray) -> np.ndarray:
    """Compute distances of points to arcs, whose centers are o = start + n / (4 b), n = chord (2 b + (1 - b^2) i).

    Complex numbers; with d = x - start, |x - o|^2 - r^2 = |d|^2 - Re(d conj(n)) / (2 b). So no radius is subtracted,
    and lines need no case of their own.
    """
    d, chord = (y[..., 0] + 1j * y[..., 1] for y in (x - start, end - start))
    n = chord * (2 * bulge + 1j * (1 - bulge**2))
    power = 2 * bulge * np.abs(d) ** 2 - np.real(d * n.conj())
    # 2 b (x - o) and 2 |b| r, both without a division by b.
    off, radius = np.abs(2 * bulge * d - 0.5 * n), 0.5 * np.abs(chord) * (1 + bulge**2)
    radial = np.abs(power) / (off + radius)
    ends = np.minimum(np.abs(d), np.abs(d - chord))
    # The tangents at the ends bound the wedge.
    inside = np.real(d * (chord * (1 - 1j * bulge) ** 2).conj()) >= 0
    inside &= np.real((d - chord) * (chord * (1 + 1j * bulge) ** 2).conj()) <= 0
    return np.where(inside, radial, ends)


def _theory(curve: jhd.BezierSegments) -> float:
    """Integrate 2 |dk/ds|^(1/3) ds = 2 |dk/dt|^(1/3) |x'|^(2/3) dt, by midpoints of equal steps of all segments."""
    jets: list[Any] = [curve]
    for _ in range(3):
        jets.append(jax.jacfwd(jets[-1]))
    t = (np.arange(NODES) + 0.5) / NODES * curve.count
    first, second, third = (np.asarray(jax.jit(jax.vmap(f))(t)) for f in jets[1:])
    speed = np.hypot(*first.T)
    bend = _cross(first, third) / speed**3
    bend -= 3 * _cross(first, second) * np.sum(first * second, axis=1) / speed**5
    return float(2 * np.mean(np.cbrt(np.abs(bend)) * np.cbrt(speed) ** 2) * curve.count)


def _cross(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]


def _table(found: dict[str, Any]) -> str:
    header = ["curve", "tolerance / diagonal", "arcs", "of them lines", "arcs / theory", "certified / tolerance"]
    header += ["sampled / certified", "distance / certified: lower", "upper"]
    rows = [
        [
            name,
            f"{row['share']:.0e}",
            row["arcs"],
            row["lines"],
            f"{row['arcs'] / row['theory']:.2f}",
            f"{row['deviation'] / row['tolerance']:.3f}",
            f"{row['sampled'] / row['deviation']:.3f}",
            *(f"{float(row[key]) / row['deviation']:.3f}" for key in ("lower", "upper")),
        ]
        for name, entry in found.items()
        for row in entry["rows"]
    ]
    slopes = [[name, "" if entry["slope"] is None else f"{entry['slope']:.3f}"] for name, entry in found.items()]
    power = f"power of the tolerance, from {ASYMPTOTIC:.0e} on"
    return markdown(header, rows) + "\n\n" + markdown(["curve", power], slopes)


if __name__ == "__main__":
    main()
