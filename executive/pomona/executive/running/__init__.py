"""One run of a tree: the runner, its services for skills, its events."""
