"""Output in the terminal: the live tree, and the summary at the end."""
