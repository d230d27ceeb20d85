"""A file that holds one section and nothing else: a camera's intrinsics, how its depth errs, one device's settings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pomona.executive.cell.errors import CellFileError
from pomona.executive.values.documents import ValueFile, read_value_file
from pomona.executive.values.findings import Findings
from pomona.executive.values.reading import Refused

T = TypeVar("T")


def read_section_file(path: Path, what: str, read: Callable[[ValueFile], T]) -> T:
    """Read a file with `read`, which raises `Refused` if it cannot be used; `what` names the kind of file in messages.

    Raises CellFileError: it cannot be used; the exception has all errors with their places.
    """
    findings = Findings()
    written = read_value_file(path, findings, what)
    try:
        if written is not None:
            return read(written)
    except Refused:
        pass
    raise CellFileError(findings.sorted())
