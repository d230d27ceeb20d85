"""Detect: fruit in a picture, as nine keypoints and a pose."""
