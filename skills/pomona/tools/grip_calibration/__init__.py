"""Friction and stiffness of a grip from pushes, recorded or guided at a cell."""
