"""Minimax fitting: expansion of critical pairs, the step of the model, the iteration, and first guesses."""
