"""Emulators of the arms and grippers that most laboratories have: Universal Robots, Robotiq."""
