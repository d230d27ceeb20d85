"""Files written whole or not at all, also with the edits of findings."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pomona.executive.recording.plain_file import replace_file
from pomona.executive.values.findings import Finding, mended


def write_edits(path: Path, found: Iterable[Finding]) -> list[Finding]:
    """Write a file with the edits of findings in it; return those that were applied, the first of each line.

    A finding whose line has changed since is left out.
    """
    written = path.read_bytes().decode()
    body = written.removeprefix("\ufeff")
    lines = body.splitlines()
    here = [
        one for one in found if (one.path, [one.excerpt]) == (str(path), lines[one.line - 1 :][:1])
    ]
    text, applied = mended(body, here)
    if applied:
        replace_file(path.resolve(), (written.removesuffix(body) + text).encode())
    return applied
