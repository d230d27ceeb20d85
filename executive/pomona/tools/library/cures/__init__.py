"""The smallest change that makes a failed run succeed, found by repeating the run in simulation."""
