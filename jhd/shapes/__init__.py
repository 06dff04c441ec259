"""Shapes: what a user hands in."""

from jhd.shapes.bezier import BezierCurve
from jhd.shapes.bspline import BSplineCurve
from jhd.shapes.curve import AbstractCurve, BezierSegments, circle, points, polyline
