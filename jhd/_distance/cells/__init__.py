"""Proven bounds of the distance over a cell of one shape, and over a pair of cells."""
