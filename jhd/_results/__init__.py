"""What functions return: solutions, results and events, errors, and how they are printed."""
