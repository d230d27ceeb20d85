"""One run of a tree: the runner, what it offers to skills, the events it gives."""
