"""Graphical editor of tree files: the drawn tree beside its text, in the browser."""
