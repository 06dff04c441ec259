"""Witnesses: events, the systems of equations that hold there, critical pairs, and derivatives."""
