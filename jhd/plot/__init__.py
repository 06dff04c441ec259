"""Pictures: shapes, the witness of a distance, distances along a curve or as colours, and the cells of a surface.

Every function takes axes and returns them; without axes it makes a figure 85 mm wide (one column of a journal) with
pyplot, which is imported only then. Nothing global is changed. Lengths on the axes carry the unit of the input
coordinates. The colours are those of Okabe & Ito, and line styles and markers tell the same things apart in grey. Every
artist has a gid (`witness`, `feet`, ...), by which it can be found and restyled, also in an SVG.

A picture is no proof: curves, surfaces and profiles are drawn from samples.
"""

from jhd.plot.axes import BLUE as BLUE
from jhd.plot.axes import GREY as GREY
from jhd.plot.axes import ORANGE as ORANGE
from jhd.plot.axes import VERMILLION as VERMILLION
from jhd.plot.curves import curve as curve
from jhd.plot.curves import profile as profile
from jhd.plot.deviations import deviation as deviation
from jhd.plot.deviations import distances as distances
from jhd.plot.deviations import histogram as histogram
from jhd.plot.implicit import section as section
from jhd.plot.implicit import surface as surface
from jhd.plot.implicit import surfaces as surfaces
from jhd.plot.implicit import voxels as voxels
from jhd.plot.meshes import mesh as mesh
from jhd.plot.meshes import meshes as meshes
from jhd.plot.neighbours import neighbours as neighbours
from jhd.plot.pages import page as page
from jhd.plot.solutions import solution as solution
from jhd.plot.solutions import witness as witness
