"""Arithmetic with certified results: intervals, Bernstein forms, sums and roots of polynomials."""
