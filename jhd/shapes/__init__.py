"""Shapes: what a user hands in."""

from jhd.shapes.curve import AbstractCurve, BezierSegments, circle, points, polyline
