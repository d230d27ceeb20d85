"""A paused run takes a changed tree file over."""
