"""Common coordinates for every kind of shape, jets in them, and the stopping criteria of searches."""
