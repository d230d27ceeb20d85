"""Errors of planning.

PlanningError
├── PlanningFailed    there is no path to give; carries a code of the skill Plan, a sentence and data
└── BadRequest        an invalid request: NaN, a wrong number of joints, no such planner
"""

from __future__ import annotations

from collections.abc import Mapping


class PlanningError(Exception):
    """Root of this package's errors."""


class PlanningFailed(PlanningError):
    """No path; `code` is one of the failure codes of the skill Plan."""

    def __init__(self, code: str, message: str, data: Mapping[str, object] | None = None) -> None:
        self.code, self.message, self.data = code, message, dict(data or {})
        super().__init__(code, message, self.data)  # all arguments: it travels between processes by pickle

    def __str__(self) -> str:
        return f"{self.code}: {self.message}"


class BadRequest(PlanningError):
    """A request that cannot be planned in any scene."""
