"""Results of functions: solutions, result codes and events, errors, and their printed forms."""
