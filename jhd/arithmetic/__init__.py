"""Numbers and polynomials that carry a proof."""

from jhd.arithmetic.interval import Interval
