"""Runs in other formats: one HTML page, LeRobot, Foxglove, Rerun. Imported only on request."""
