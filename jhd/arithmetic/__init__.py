"""Arithmetic with certified results: intervals that are rounded outward."""

from jhd.arithmetic.interval import Interval

__all__ = ["Interval"]
