"""Pictures of shapes, of witnesses, of distances (as profiles of curves or as colors), and of the cells of a surface.

Every function takes axes and returns them. Without axes it creates a figure 85 mm wide (one column of a journal) with
pyplot, which is imported only then. Global settings stay unchanged. Lengths on the axes are in the unit of the input
coordinates. The colors are from Okabe & Ito; line styles and markers distinguish the shapes in print without color.
Every artist has a gid (`witness`, `feet`, ...); use it to find and restyle the artist, also in an SVG file.

A picture is no proof: curves, surfaces and profiles are drawn from samples.
"""

from jhd._plot.axes import BLUE, GRAY, ORANGE, VERMILLION
from jhd._plot.curves import curve, distance_profile
from jhd._plot.deviations import deviation, distances, histogram
from jhd._plot.implicit import section, surface, surfaces, voxels
from jhd._plot.mesh_pictures import mesh, meshes
from jhd._plot.neighbor_pictures import neighbors
from jhd._plot.pages import page
from jhd._plot.solutions import solution, witness

__all__ = [
    "BLUE",
    "GRAY",
    "ORANGE",
    "VERMILLION",
    "curve",
    "deviation",
    "distances",
    "histogram",
    "mesh",
    "meshes",
    "neighbors",
    "page",
    "distance_profile",
    "section",
    "solution",
    "surface",
    "surfaces",
    "voxels",
    "witness",
]
