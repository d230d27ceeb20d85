"""The skills of a picking task: each a pure algorithm beside a thin py_trees behaviour."""
