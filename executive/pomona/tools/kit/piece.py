"""A piece that `pomona new` writes: its files as templates, and how it is found."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Piece:
    """The files that `pomona new WORD name` writes."""

    about: str  # description in one line
    # texts by path; `$name` is the name in small letters, `$Name` with capitals, `$module` the package
    files: Mapping[str, str]
    data: Mapping[str, Callable[[], bytes]] = field(
        default_factory=dict
    )  # files that are made, by path
    entry: tuple[str, str, str] | None = (
        None  # group, name and object of its entry point; empty for data
    )
    check: str = ""  # a file of it for `pomona check`
