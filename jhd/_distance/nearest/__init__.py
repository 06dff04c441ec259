"""The proven nearest point of one shape: of a curve, a polynomial surface, a mesh."""
