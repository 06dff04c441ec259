"""Pictures: shapes, the witness of a distance, distances along a curve or as colours, and the cells of a surface.

Every function takes axes and returns them; without axes it makes a figure 85 mm wide (one column of a journal) with
pyplot, which is imported only then. Nothing global is changed. Lengths on the axes carry the unit of the input
coordinates. The colours are those of Okabe & Ito, and line styles and markers tell the same things apart in grey. Every
artist has a gid (`witness`, `feet`, ...), by which it can be found and restyled, also in an SVG.

A picture is no proof: curves, surfaces and profiles are drawn from samples.
"""

from jhd.plot.axes import BLUE, GREY, ORANGE, VERMILLION
from jhd.plot.curves import curve, profile
from jhd.plot.deviations import deviation, distances, histogram
from jhd.plot.implicit import section, surface, surfaces, voxels
from jhd.plot.meshes import mesh, meshes
from jhd.plot.neighbours import neighbours
from jhd.plot.pages import page
from jhd.plot.solutions import solution, witness

__all__ = [
    "BLUE",
    "GREY",
    "ORANGE",
    "VERMILLION",
    "curve",
    "deviation",
    "distances",
    "histogram",
    "mesh",
    "meshes",
    "neighbours",
    "page",
    "profile",
    "section",
    "solution",
    "surface",
    "surfaces",
    "voxels",
    "witness",
]
