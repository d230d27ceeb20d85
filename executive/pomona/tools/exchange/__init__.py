"""Runs in other formats: one HTML page, LeRobot, Foxglove. Imported only on request."""
