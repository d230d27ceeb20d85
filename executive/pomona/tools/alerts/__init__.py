"""Alerts when the success rate of runs is too low."""
