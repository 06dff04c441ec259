"""Arithmetic with certified results: intervals, Bernstein forms, sums and polynomial systems."""
