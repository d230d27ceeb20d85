"""Fixtures of the tests of the tree language."""

from tests.executive.language.conftest import pick_apple, skills

__all__ = ["pick_apple", "skills"]
