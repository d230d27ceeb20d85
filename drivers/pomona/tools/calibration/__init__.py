"""Calibration of cameras, depth and fingers, and `pomona doctor`."""
