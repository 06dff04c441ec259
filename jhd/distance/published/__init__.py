"""The methods of the sources, for comparison: faithful to them, and proven only where they say so."""
