"""Where compiled loops are kept between runs, and the first start of a version, which compiles them.

numba keeps the code of a function beside its source and renews it when that file changes, but not when an inlined
function of another file does. After an update a collision checker could thus use the old geometry. So the code is kept
in a folder whose name is a hash of all compiled sources: any change compiles everything again.

Compiled functions copy rows element by element: for `a[i] = b[j]` between arrays numba also compiles the text of an
error, which costs several seconds of the first start.
"""

from __future__ import annotations

import hashlib
import logging
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

from pomona.executive.values.sentences import ReportLine

# numba's setting; a folder that is set gets one of its own for each version
PLACE = "NUMBA_CACHE_DIR"
KEEP = f"set {PLACE} to a folder that is writable and stays"
TEMPORARY = Path(tempfile.gettempdir(), "pomona")
# duration of the first compilation on two cores and on one (Intel Xeon, 2026-11-25) [s]
FIRST_TWO = 30
FIRST_ONE = 45
# index of the loop compiled last; without it the first start goes on
LAST = "lines.track_poses-*.nbi"
HELPER = "pomona.skills.shared.compile_beside"  # module that compiles one half of the loops in a process of its own

_beside: subprocess.Popen[bytes] | None = None


def digest(sources: Path) -> str:
    """Of the contents of all Python files below a folder that have to do with numba, 12 characters."""
    found = hashlib.sha256()
    for path in sorted(sources.rglob("*.py")):
        content = path.read_bytes()
        if b"numba" in content:
            found.update(path.name.encode() + b"\0" + content)
    return found.hexdigest()[:12]


def keep_apart(sources: Path) -> None:
    """Keep the compiled code of these sources apart from that of other versions, in the first folder that is writable.

    In a folder that is set, else beside the sources, else in the user's cache, else in a temporary folder, which does
    not outlast a restart.
    """
    name = f"compiled-{digest(sources)}"
    given = os.environ.get(PLACE, "")
    if Path(given).name != name:
        places = (sources / "__pycache__", _users_cache())
        place = (
            Path(given)
            if given
            else next((folder for folder in places if is_writable(folder)), TEMPORARY)
        )
        os.environ[PLACE] = str(place / name)
    if "numba" in sys.modules:  # it has read its settings already
        sys.modules["numba"].core.config.reload_config()


def _users_cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "pomona")


def is_writable(folder: Path) -> bool:
    """Return True if a folder is writable, or can be made."""
    there = next((place for place in (folder, *folder.parents) if place.exists()), folder)
    return there.is_dir() and os.access(there, os.W_OK)


def is_compiled() -> bool:
    """Return True if an earlier start has compiled the loops of this version."""
    return any(Path(os.environ[PLACE]).rglob(LAST))


def first_sentence() -> str:
    """Return the announcement of the compilation: its duration, and the folder where it is an unusual one."""
    place = Path(os.environ[PLACE])
    seconds = FIRST_ONE if _cores() < 2 else FIRST_TWO
    once = f"compiling the motion kernels, once, about {seconds} s"
    if place.is_relative_to(TEMPORARY) or not is_writable(place):
        return f"compiling the motion kernels, about {seconds} s, again and again: {place} does not last; {KEEP}"
    if place.parent == _users_cache():
        return f"{once}; kept in {place}, since the installation is read-only; {PLACE} names another folder"
    return once


def examine(records: Sequence[Path] = (), cell: str = "") -> Iterator[ReportLine]:
    """Report for `pomona doctor` where the compiled code is kept, and whether it is there."""
    place = Path(os.environ[PLACE])
    if records:
        return
    if is_compiled():
        yield ReportLine("compiled code", True, f"kept in {place}")
        return
    is_kept = is_writable(place) and not place.is_relative_to(TEMPORARY)
    yield ReportLine(
        "compiled code", is_kept, f"none yet in {place}; the first run: {first_sentence()}", KEEP
    )


def begin_first(description: Path) -> None:
    """At the first start of a version: announce the compilation, and compile one half in a process of its own."""
    global _beside
    if not _announced() or _beside is not None or _cores() < 2:
        return
    words = [sys.executable, "-m", HELPER, str(description)]
    _beside = subprocess.Popen(
        words, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    )


def wait_for_first() -> None:
    """Wait for that process before its half is loaded."""
    if _beside is not None:
        _beside.wait()


@cache
def _announced() -> bool:
    """Announce the compilation, once; return False if there is nothing to compile."""
    if is_compiled():
        return False
    logging.getLogger("pomona").warning(first_sentence())
    return True


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
