"""Tabulate: a growing table and picture of measured fruit."""
