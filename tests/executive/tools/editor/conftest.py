"""Fixtures of the tests of the tree language."""

from tests.executive.language.conftest import built, findings_of, pick_apple, skills

__all__ = ["built", "findings_of", "pick_apple", "skills"]
