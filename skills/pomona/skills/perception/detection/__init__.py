"""Detect: fruit in a picture, as nine keypoints and a pose.

The networks bring torch along; modules that only know a `Detection` do not import it.
"""
