"""Branch and bound: for the farthest point of one shape from another, and for the closest points of two shapes."""
