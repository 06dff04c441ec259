# pyright: strict
"""Fits: the best cubic for a quarter of a circle, with a certified error."""

import math

import jhd

quarter = jhd.BezierCurve([(1, 0), (1, 1), (0, 1)], [1, math.sqrt(0.5), 1])
fit = jhd.fit_curve(quarter, degree=3, ends="free")
print(fit)

# The largest error is attained at seven points, and no step lowers all of them: the fit is optimal.
count = sum(float(value) > (1 - 1e-6) * float(fit.error.value) for value in fit.pairs.value)
print(f"{count} equal maxima of {float(fit.error.value):.6g}")
assert count == 7 and fit.error.upper < 5.5079e-5
