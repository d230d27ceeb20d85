"""Bases of drivers: the part that every device of a kind has."""
