"""Arithmetic with certified results: intervals that are rounded outward."""

from jhd._arithmetic.interval import Interval

__all__ = ["Interval"]
