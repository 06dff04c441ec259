"""Does the two-step method find the directed distances of an open and a closed curve to 1e-10?

An open Bezier curve A of degree six is sampled in ten steps; B is a closed uniform cubic B-spline of 90 control points.
Claims: both directed distances agree with a reference in NumPy to 1e-10 mm, the two samples that are larger than their
neighbors lead to one antipodal and one one-to-two event, and the larger of the two is h(A, B).

Feeds: figure and table "open and closed curve" (example 1 and figure 4 of Cao et al. 2014, with data of our own).
Takes: 1 minute, 5 seconds once compiled.
"""

from common import Run
from common_cao14 import Example, open_curve, ring, table

import jhd
from jhd._shapes.curve import AbstractCurve


def main() -> None:
    """Compute, save and print."""
    run = Run(__file__, __doc__, pair=AbstractCurve)
    own = open_curve(), ring("example_1_b", 24 if run.smoke else 90)
    a, b = (curve.segments() for curve in run.shapes or own)
    example = Example(a, b, samples=10, method=jhd.published.TwoStep(samples=10))
    record = example.record(shown=2, candidates=2, unit="" if run.shapes else "mm")
    ends = {"ends": example.distance[[0, -1]]}
    run.save({**record, **ends}, table(record))


if __name__ == "__main__":
    main()
