"""The shipped trees, cells, robots and fruit: files, found by name from anywhere."""
