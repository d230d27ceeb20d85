"""Where compiled loops are kept between runs.

numba keeps the code of a function beside its source and renews it when that file changes, but not when a function from
another file does that was compiled into it. After an update a checker of collisions could go on with yesterday's
geometry. So the code is kept in a folder named by what all compiled sources say: a change anywhere compiles afresh.

What is compiled copies rows element by element: for `a[i] = b[j]` between arrays numba compiles how it would word an
error, too, which is several seconds of the first start.
"""

from __future__ import annotations

import hashlib
import logging
import os
import sys
from functools import cache
from pathlib import Path

PLACE = "NUMBA_CACHE_DIR"
"""numba's setting; who has set it already is not overruled."""
FIRST = "the first start of a version compiles its loops, once: a minute or two of the processor"


def digest(sources: Path) -> str:
    """Of the contents of all Python files below a folder that have to do with numba, 12 characters."""
    found = hashlib.sha256()
    for path in sorted(sources.rglob("*.py")):
        content = path.read_bytes()
        if b"numba" in content:
            found.update(path.name.encode() + b"\0" + content)
    return found.hexdigest()[:12]


def keep_apart(sources: Path) -> None:
    """Keep the compiled code of these sources apart from that of other versions, beside them or in the user's cache."""
    if PLACE in os.environ:
        return
    beside = sources / "__pycache__"
    if not os.access(beside if beside.is_dir() else sources, os.W_OK):  # installed by somebody else, for all
        beside = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "pomona")
    os.environ[PLACE] = str(beside / f"compiled-{digest(sources)}")
    if "numba" in sys.modules:  # it has read its settings already
        sys.modules["numba"].core.config.reload_config()


@cache
def tell_the_first() -> None:
    """Warn, once, where nothing was compiled before: what follows takes so much longer than the next time."""
    place = os.environ.get(PLACE)
    if place and not any(Path(place).rglob("*.nbi")):
        logging.getLogger("pomona").warning(FIRST)
