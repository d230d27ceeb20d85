"""Follow: let the arm carry out a planned path."""
