"""Fruit that touches, in a heap or a crate: measure all of it, and take the freest first."""
