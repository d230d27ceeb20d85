"""Campaigns: many runs from one file, results that survive a kill, a report."""
