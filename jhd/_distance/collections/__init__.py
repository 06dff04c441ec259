"""Distances of many pairs of shapes: blocks of pairs, executors, certified bounds of all pairs, and stores."""
