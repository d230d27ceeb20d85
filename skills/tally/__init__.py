"""Tally: what became of every fruit of a task."""
