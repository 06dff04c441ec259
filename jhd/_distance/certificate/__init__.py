"""Certificates: bounds of a distance that integers can check."""
