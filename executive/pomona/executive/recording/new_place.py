"""A file or folder that is there whole or not at all, and takes the place of nothing."""

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
    """Where to write what shall stand at `place`: beside it, with its name, until the block has ended well.

    Half a file looks like a whole one to whoever finds it, and would be in the way of the next try.

    Raises:
        UsageError: something is there already, or it cannot be written.
    """
    refuse_taken(place)
    beside = None
    try:
        beside = Path(tempfile.mkdtemp(prefix=f".{place.name}.", dir=place.parent))
        yield beside / place.name
        refuse_taken(place)  # by somebody else, meanwhile
        (beside / place.name).rename(place)
    except OSError as error:
        raise UsageError(f"{place}: {error.strerror or error}") from error
    finally:
        if beside is not None:
            shutil.rmtree(beside, ignore_errors=True)


def refuse_taken(place: Path) -> None:
    """
    Raises:
        UsageError: something is there already, be it a link that leads nowhere.
    """
    if os.path.lexists(place):
        raise UsageError(f"{place} is there already, and nothing is overwritten: name another place, or move it away")
