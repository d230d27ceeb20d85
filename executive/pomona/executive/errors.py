"""Errors of the executive.

PomonaError
├── UsageError          unusable input: a message for the user, exit status 2
│   └── TreeFileError   findings in a tree file, each with line and column
└── SkillError          a skill broke its own contract: a bug in the skill, ends the run in the safe state
    └── NotOwnerError   a skill commanded a device that it does not own; the device was not called
"""

from __future__ import annotations


class PomonaError(Exception):
    """Root of everything that the executive raises on purpose."""


class UsageError(PomonaError):
    """Input that cannot be used; nothing has moved."""


class SkillError(PomonaError):
    """A skill broke its contract, for instance an undeclared failure code or an output of the wrong type."""

    def __init__(self, skill: str, message: str) -> None:
        self.skill = skill
        self.message = message
        super().__init__(f"{skill}: {message}")


class NotOwnerError(SkillError):
    """A command to a device from code that does not own it; the device was not called."""

    def __init__(self, skill: str, device: str, command: str, why: str) -> None:
        self.device = device
        self.command = command
        self.why = why
        super().__init__(
            skill, f"refused to command '{command}' of the {device}: {why}; nothing has moved"
        )
