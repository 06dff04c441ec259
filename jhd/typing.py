"""Types to annotate code that uses jhd.

`Shape` is a shape of jhd; `ShapeLike` is any object that is accepted as a shape, and `Numbers` any accepted as
numbers: arrays, tracers, and nested lists of numbers. `Result` is a member of `jhd.RESULTS`.

>>> import jhd
>>> def gap(a: jhd.typing.ShapeLike, b: jhd.typing.ShapeLike) -> float:
...     found = jhd.hausdorff(a, b)
...     return float(found.upper - found.lower)
>>> gap([(0, 3)], [(0, 0), (4, 0)]) < 1e-9
True
"""

from jhd._distance.normalization.method import AbstractHausdorffMethod as Method
from jhd._distance.project_methods import AbstractProjectionMethod as ProjectionMethod
from jhd._distance.statistics.statistics import AbstractStatistic as Statistic
from jhd._results.batches import AbstractSolution as Solution
from jhd._results.outcomes import RESULTS as Result
from jhd._shapes.as_shape import Shape, ShapeLike
from jhd._shapes.checks import Numbers
from jhd._shapes.curve import AbstractCurve as Curve
from jhd._shapes.patch import AbstractPatch as Surface

__all__ = [
    "Curve",
    "Method",
    "Numbers",
    "ProjectionMethod",
    "Result",
    "Shape",
    "ShapeLike",
    "Solution",
    "Statistic",
    "Surface",
]
