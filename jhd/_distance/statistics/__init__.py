"""What of the distances along a shape counts: the largest, a mean, a quantile, with derivatives where they are known.

Distances and their slopes as seen from places of a shape (`sight`) are summed by rules (`quadrature`,
`surface_quadrature`) over cells that are cut where feet jump (`kinks`, `cut_cells`) or the distance passes a level
(`level_cuts`, `level_sets`, `levels`); what two refinements do not agree on is refused (`confirmed`).
"""
