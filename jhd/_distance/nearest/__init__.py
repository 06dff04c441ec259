"""Proven nearest points of one shape: of a curve, an implicit surface or a mesh."""
