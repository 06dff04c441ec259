"""Statistics of the distances along a shape: the largest, a mean, a quantile, with derivatives if they are known.

Distances and their slopes at points of a shape (`pointwise`) are integrated by rules (`quadrature`,
`surface_quadrature`). The cells of the rules are cut where feet jump (`breakpoints`, `cut_cells`) or the distance
crosses a level (`level_cuts`, `quantiles`). A derivative on which two refinements do not agree is refused
(`error_control`).
"""
