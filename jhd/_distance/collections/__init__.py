"""Many pairs of shapes: blocks of them in one program, executors, proven bounds of all pairs, and what is kept."""
