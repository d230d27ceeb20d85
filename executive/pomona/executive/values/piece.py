"""A piece that `pomona new` writes: its files as templates, and how it is found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Piece:
    """The files that `pomona new WORD name` writes.

    Attributes:
        about: description in one line.
        files: texts by path; `$name` is the name in small letters, `$Name` with capitals, `$module` the package.
        data: files that are made, by path.
        entry: group, name and object of its entry point; empty for data.
        check: a file of it for `pomona check`.
    """

    about: str
    files: Mapping[str, str]
    data: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    entry: tuple[str, str, str] | None = None
    check: str = ""
