"""Write a file or folder completely or not at all, without overwriting."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pomona.executive.errors import UsageError


@contextmanager
def made_whole(place: Path) -> Iterator[Path]:
    """Yield a temporary path beside `place` for its content; it is moved to `place` when the block succeeds.

    An incomplete file would look complete and block the next attempt.

    Raises UsageError: `place` exists, or cannot be written.
    """
    refuse_taken(place)
    beside = None
    try:
        beside = Path(tempfile.mkdtemp(prefix=f".{place.name}.", dir=place.parent))
        yield beside / place.name
        refuse_taken(place)  # another process may have made it
        (beside / place.name).rename(place)
    except OSError as error:
        raise UsageError(f"{place}: {error.strerror or error}") from error
    finally:
        if beside is not None:
            shutil.rmtree(beside, ignore_errors=True)


def refuse_taken(place: Path) -> None:
    """Raises UsageError: the path exists, also as a broken link."""
    if os.path.lexists(place):
        raise UsageError(f"{place} exists, and nothing is overwritten: name another place, or move it away")
