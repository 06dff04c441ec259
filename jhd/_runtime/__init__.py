"""Runtime support: compiled functions and their cache, memory, processes, files, and arrays in traced code."""
