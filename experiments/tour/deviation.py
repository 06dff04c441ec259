# pyright: strict
"""Deviations: the distribution of the distance over a shape, each statistic with certified bounds."""

import numpy as np

import jhd

# A wave, compared with a straight line.
x = np.linspace(0, 2 * np.pi, 25)
wave = jhd.BSplineCurve.clamped(np.stack([x, 0.1 * np.sin(3 * x)], axis=1), degree=3)
line = jhd.polyline([(0, 0), (2 * np.pi, 0)])

found = jhd.deviation(wave, line)
for name, bounds in {"mean": found.mean, "rms": found.rms, "90 % within": found.quantile(0.9)}.items():
    print(f"{name:<12} {bounds.lower:.6f} to {bounds.upper:.6f}")
    assert bounds.lower <= bounds.upper <= found.maximum.upper
fraction = found.fraction_within(0.05)
print(f"{fraction.lower:.1%} to {fraction.upper:.1%} of its length is within 0.05")
assert 0 < fraction.lower <= fraction.upper < 1
