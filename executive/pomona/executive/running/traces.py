"""Traces of skills: the origin of an exception, for operator and record, and the lines that skills log."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import sysconfig
import traceback
from collections import Counter, deque
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import py_trees

from pomona.executive.running.events import Logged
from pomona.executive.skill import POLLED
from pomona.executive.values.sentences import sentence_of, shortened

LONGEST = 16_000  # characters of a traceback that are kept: of an endless recursion the beginning and the end

_HERE = str(Path(__file__).parents[1]) + os.sep
_PY_TREES = str(Path(py_trees.__file__).parent) + os.sep
_PYTHON = tuple({sysconfig.get_path(name) + os.sep for name in ("stdlib", "platstdlib")})
_PACKAGES = tuple({sysconfig.get_path(name) + os.sep for name in ("purelib", "platlib")})


def place_of(error: BaseException) -> str:
    """Return `skills/lift.py:42, in run`: the innermost place outside libraries; empty when unknown."""
    noted = (
        vars(error).get("place") if hasattr(error, "__dict__") else None
    )  # of another process, as `keep_place` noted it there
    if isinstance(noted, str) and noted:
        return noted
    chain = list(_chain(error))
    home = next(
        (package for frames in chain for frame, _ in frames if (package := _package(_file(frame)))),
        "",
    )
    for frames in chain:
        mine = [(frame, line) for frame, line in frames if _is_own(_file(frame), home)]
        if mine:
            return _place(*mine[-1])
    return _place(*chain[0][-1]) if chain and chain[0] else ""


def place_here() -> str:
    """Return the innermost place outside Pomona and its libraries on the current stack; empty when unknown."""
    frames = list(traceback.walk_stack(None))
    home = next((package for frame, _ in frames if (package := _package(_file(frame)))), "")
    return next((_place(frame, line) for frame, line in frames if _is_own(_file(frame), home)), "")


def keep_place(error: BaseException, place: str) -> None:
    """Let an exception that goes to another process, where its frames are unknown, remember its place."""
    error.place = place  # type: ignore[attr-defined]


def traceback_of(error: BaseException) -> str:
    """Return the traceback with causes and notes, of limited length."""
    try:
        text = "".join(traceback.format_exception(error))
    except BaseException as second:  # its own __str__ may be what fails
        text = f"{type(error).__name__}, which cannot be shown: {type(second).__name__}\n"
    if len(text) <= LONGEST:
        return text
    half = LONGEST // 2
    return f"{text[:half]}\n… {len(text) - LONGEST} characters left out …\n{text[-half:]}"


def _chain(error: BaseException) -> Iterator[list[tuple[FrameType, int]]]:
    """Yield the frames of an exception, then those of its cause."""
    found: BaseException | None = error
    for _ in range(10):
        if found is None:
            return
        yield list(traceback.walk_tb(found.__traceback__))
        found = found.__cause__


def _place(frame: FrameType, line: int) -> str:
    return f"{_short(_file(frame))}:{line}, in {frame.f_code.co_name}"


def _file(frame: FrameType) -> str:
    return frame.f_code.co_filename


def _package(file: str) -> str:
    """Return the folder below site-packages of a third-party package other than py_trees; empty elsewhere."""
    for root in _PACKAGES:
        if file.startswith(root) and not file.startswith((_HERE, _PY_TREES)):
            return root + file[len(root) :].split(os.sep)[0]
    return ""


def _is_own(file: str, home: str) -> bool:
    """Neither the executive nor a library: `home` is the package that the executive called, wherever it stands."""
    if file.startswith((_HERE, _PY_TREES, "<")):
        return False
    package = _package(file)
    return package == home if package else not file.startswith(_PYTHON)


def _short(file: str) -> str:
    """Return a path relative to the folder from which Python imports."""
    roots = [root for root in sys.path if root and file.startswith(root.rstrip(os.sep) + os.sep)]
    return os.path.relpath(file, max(roots, key=len)) if roots else file


def _set_level(root: logging.Logger, level: int) -> None:
    """As `setLevel`, without the lock of `logging`: a thread that keeps it must not hold up the end of a run."""
    root.level = level
    for each in (root, *list(root.manager.loggerDict.values())):
        if isinstance(each, logging.Logger):
            each._cache.clear()  # type: ignore[attr-defined]


MOST_LOGGED = 20  # lines of a node in a second of the run; the others are counted, so that no record is flooded


class SkillLogs(logging.Handler):
    """Collects the lines that skills log with Python's `logging`, INFO and above."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._lines = deque[tuple[str, str, str]]()
        self._counts = Counter[str]()
        self._until = 0.0

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Take INFO lines in here. Warnings go on to the error stream, as without this handler."""
        root = logging.getLogger()
        level = root.level
        handlers = [self] if root.handlers else [self, logging.lastResort]
        root.handlers += [handler for handler in handlers if handler is not None]
        _set_level(root, min(level, logging.INFO))
        try:
            yield
        finally:
            _set_level(root, level)
            root.handlers = [handler for handler in root.handlers if handler not in handlers]

    def handle(self, record: logging.LogRecord) -> bool:
        """Keep a line of a skill; never raises. No lock: a thread that hangs as it logs must not hold up the tick."""
        node = POLLED.get()
        self._counts[node] += bool(node)
        if node and self._counts[node] <= MOST_LOGGED:
            try:
                text = record.getMessage()
                text += (
                    f": {sentence_of(record.exc_info[1])}"
                    if record.exc_info and record.exc_info[1]
                    else ""
                )
            except Exception as error:  # of the caller's arguments: a log must not end a run
                text = f"{record.msg!r:.60} cannot be shown: {sentence_of(error)}"
            self._lines.append((node, record.levelname, shortened(text)))
        return True

    def take(self, t: float, tick: int, last: bool = False) -> Iterator[Logged]:
        """Yield the lines since the last call; once a second, and at last, also how many were left out."""
        while self._lines:
            yield Logged(t, tick, *self._lines.popleft())
        if t >= self._until or last:
            counts = self._counts
            self._counts = Counter()
            self._until = t + 1.0
            for node, count in list(counts.items()):
                if count > MOST_LOGGED:
                    yield Logged(
                        t, tick, node, "WARNING", f"{count - MOST_LOGGED} more lines were left out"
                    )
