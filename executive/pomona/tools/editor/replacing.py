"""Files written whole or not at all, also with the edits of findings."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path

from pomona.executive.values.findings import Finding, mended


def replace_file(path: Path, data: bytes) -> None:
    """Write a file whole or not at all; mode and owner of the one that it replaces stay. Raises OSError: it cannot be."""
    number, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".saving")
    try:
        with os.fdopen(number, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        about = path.stat() if path.exists() else None
        os.chmod(name, 0o644 & ~_umask() if about is None else about.st_mode & 0o7777)
        if about is not None:
            with contextlib.suppress(PermissionError):  # of another owner: the content counts more
                os.chown(name, about.st_uid, about.st_gid)
        os.replace(name, path)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


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
