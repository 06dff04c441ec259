"""Common coordinates for every kind of shape, jets there, and what is asked of a search."""
