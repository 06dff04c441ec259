"""Drawing of shapes, distances and results."""
