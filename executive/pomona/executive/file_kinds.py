"""Kinds of files that `pomona check` and `pomona schema` know, found by the entry points `pomona.files`."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Protocol

from pomona.executive.values.findings import Findings


class FileKind(Protocol):
    """Files of one kind."""

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one."""

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file."""

    def schema(self) -> Mapping[str, Any]:
        """Return the JSON Schema of such files."""


def kind_names() -> tuple[str, ...]:
    """Return the installed kinds."""
    return tuple(sorted(point.name for point in entry_points(group="pomona.files")))


@cache
def file_kind(name: str) -> FileKind:
    """Return an installed kind by its name. Raises KeyError: there is none."""
    for point in entry_points(group="pomona.files", name=name):
        kind: FileKind = point.load()
        return kind
    raise KeyError(name)
