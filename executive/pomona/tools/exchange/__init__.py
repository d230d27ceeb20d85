"""Runs in other formats: one HTML page, LeRobot. Imported only on request."""
