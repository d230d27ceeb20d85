"""Devices that a skill uses where the cell has them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from pomona.executive.skill import Skill

T = TypeVar("T")


def found_device(skill: Skill, interface: Callable[..., T]) -> T | None:
    """The cell's device of an interface that the skill can do without; None where the cell has none."""
    try:
        return skill.context.device(cast(type[T], interface), skill)
    except KeyError:
        return None
