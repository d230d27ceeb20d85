"""Files of arrays (.npz) that a person names: data only, of a bounded size, and every mistake in them in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.values.archives import open_archive

MOST_BYTES = 1 << 30  # of all arrays of one file, unpacked: an hour of two fingers at 500 Hz is 0.4 of it


class UnreadableArraysError(ValueError):
    """The file holds no arrays, or none that can be read."""


def read_plain_arrays(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Return the arrays of a .npz file by their names.

    Raises UnreadableArraysError: it is no such file, is damaged, too large, or holds objects.
    """
    if path.exists() and not path.is_file():
        raise UnreadableArraysError("it is not a file")
    try:
        with path.open("rb") as stream:
            open_archive(path, MOST_BYTES).close()
            with np.load(stream, allow_pickle=False) as loaded:
                return {name: np.asarray(loaded[name]) for name in loaded.files}
    # Errors of zlib, tokenize and zipfile have no common base, and a size in a header may ask for all memory there is.
    except Exception as error:
        raise UnreadableArraysError(str(error) or type(error).__name__) from error
