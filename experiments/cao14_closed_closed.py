"""What do dense samples cost, and how accurate are they, compared with the two-step method on closed curves?

A and B are closed uniform cubic B-splines of 90 control points. A is sampled 90 times (once a segment), as in the
source. The picture shows sample 51, counted from one, with its ten stationary points. All methods run in one process on
one core. The time of sampling itself is not charged to the peers.

Claims: both directed distances agree with a reference in NumPy to 1e-10 mm. The three largest samples lead to events of
both kinds, antipodal and one-to-two. Samples (SciPy's k-d tree and its directed_hausdorff, up to 400 a segment) err by
more than 1e-7 mm at the antipodal maximum of h(A,B) and by more than 1e-4 mm at the one-to-two maximum of h(B,A), while
their times range from less than a tenth to more than ten times the method's.

Feeds: figure and tables "two closed curves" (example 2 and figure 5 of Cao et al. 2014, with data of our own).
Takes: 2 minutes, half a minute once compiled.
"""

from collections.abc import Callable

import numpy as np
from common import Run, markdown, seconds
from common_cao14 import Example, ring, table
from common_curves import sample, sampled_directed
from scipy.spatial import distance as scipy_distance

import jhd
from jhd._shapes.curve import AbstractCurve


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, one_core=True, pair=AbstractCurve)
    own = (ring(name, 24 if run.smoke else 90) for name in ("example_2_a", "example_2_b"))
    a, b = (curve.segments() for curve in run.shapes or own)
    example = Example(a, b, samples=1, method=jhd.published.TwoStep(samples=1))
    record = example.record(shown=22 if run.smoke else 51, candidates=3, unit="" if run.shapes else "mm")
    speeds = _speeds(run, example, [record["directions"][name]["reference"] for name in ("a_to_b", "b_to_a")])
    header = ["method", "samples a segment", "time of h(A,B) (ms)", "ratio", "error of h(A,B) (mm)", "of h(B,A) (mm)"]
    rows = [
        [s["name"], s["samples"], f"{1e3 * s['seconds']:.2f}", f"{s['ratio']:.2f}", *(f"{e:.1e}" for e in s["errors"])]
        for s in speeds
    ]
    run.save({**record, "speeds": speeds}, table(record) + "\n\n" + markdown(header, rows))


def _speeds(run: Run, example: Example, references: list[float]) -> list[dict]:
    """Measure warm times of the two-step method and of sampled answers, with their errors."""
    curves = example.a, example.b
    found = []
    # By default, the method takes six samples a segment on curves of 90 segments.
    more = [] if run.smoke else [(2, jhd.published.TwoStep(samples=2)), (6, jhd.published.TwoStep())]
    for count, method in [(1, example.method), *more]:
        solve = lambda x, y, method=method: jhd.directed_hausdorff(x, y, method)  # noqa: E731
        found.append(_measured("TwoStep", count, solve, curves, references, 5 if run.smoke else 51))
    # SciPy's own function compares pairs until each row is settled, in an order drawn from its own seed.
    pairs: Callable[..., float] = lambda x, y: scipy_distance.directed_hausdorff(x, y)[0]  # noqa: E731
    for name, function in (("k-d tree", sampled_directed), ("directed_hausdorff", pairs)):
        for count in (50,) if run.smoke else (25, 100, 400):
            rows = tuple(sample(np.asarray(curve.control_points), count) for curve in curves)
            found.append(_measured(f"SciPy {name}", count, function, rows, references, 2 if run.smoke else 9))
    return [{**entry, "ratio": entry["seconds"] / found[0]["seconds"]} for entry in found]


def _measured(
    name: str, samples: int, solve: Callable[..., object], pair: tuple, references: list[float], repeats: int
) -> dict:
    took = seconds(lambda: solve(*pair), repeats)
    values = [float(solve(*pair)), float(solve(*pair[::-1]))]  # pyright: ignore[reportArgumentType]
    errors = [abs(value - exact) for value, exact in zip(values, references, strict=True)]
    return {"name": name, "samples": samples, "seconds": took, "values": values, "errors": errors}


if __name__ == "__main__":
    main()
