"""What runs the package: compiled programs and their cache, memory, processes, files, arrays in traces."""
