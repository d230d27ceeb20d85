"""The dummy skills of the language's tests, and their tree."""

from tests.executive.language.conftest import pick_apple, skills

__all__ = ["pick_apple", "skills"]
