"""Fruit of recorded frames measured and compared with calipers, and the account of a task with many fruits."""
