"""Published methods, for comparison: faithful to their sources, and certified only if their documentation says so."""
