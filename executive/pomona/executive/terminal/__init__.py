"""What a person sees in the terminal: the live tree, and what happened at the end."""
