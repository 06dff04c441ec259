# pyright: strict, reportUnknownMemberType=false
"""Figures and files: font outlines, SVG path data, curve files, and pictures of distances."""

from matplotlib import pyplot

import jhd
import jhd.io

a = jhd.io.load_glyph("DejaVu Sans", "a")
b = jhd.io.parse_path("M 0 0 C 100 900 900 900 1000 0 A 500 200 0 0 1 0 0 Z")
jhd.io.save_curve("b.json", b)
jhd.io.save_iges("b.igs", b)
c = jhd.io.load_shape("b.json")  # a file, "font:DejaVu Serif:g", or SVG path data
solution = jhd.hausdorff(a, c)
print(a, c, solution, sep="\n")

jhd.plot.solution(a, c, solution)
pyplot.savefig("a.png")

jhd.plot.distance_profile(a, c, solution=solution, unit="font units")
pyplot.savefig("profile.png")
