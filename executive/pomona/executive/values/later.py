"""Modules that take long to import, and that most commands do not use."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_names: dict[str, None] = {}


class Later:
    """A module that is imported when one of its names is used first, or before a run."""

    def __init__(self, name: str) -> None:
        self._name = name
        _names[name] = None

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._name), name)


def import_all() -> None:
    """Import all of them, before a cell is connected: no tick and no driver may wait for one."""
    for name in _names:
        import_module(name)
