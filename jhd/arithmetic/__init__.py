"""Numbers and polynomials that carry a proof."""
