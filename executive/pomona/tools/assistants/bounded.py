"""`pomona` commands for an assistant: each in a process of its own, of bounded time and output, in one folder."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

MOST_OUTPUT = 4 * 1024**2  # of a command [bytes]; the rest is dropped
# status of a command that was stopped at its limit, as `timeout` of coreutils returns it
STOPPED = 124
GRACE = 10.0  # time for a run to reach its safe state and close its record after its limit [s]

_EXCERPT = re.compile(r"\s*\d* \| ")


@dataclass(frozen=True, slots=True)
class Answer:
    """The end of a command.

    Attributes:
        status: its exit status, or `STOPPED`.
        out, err: its output, at most `MOST_OUTPUT` bytes of each.
    """

    status: int
    out: str
    err: str = ""

    @property
    def problem(self) -> str:
        """The reason of a status above 0, on one line, without excerpts of files."""
        lines = (self.err or self.out).splitlines()
        return " ".join(" ".join(line for line in lines if not _EXCERPT.match(line)).split())


Commands = Callable[[Sequence[str], float], Answer]
"""Carries out a `pomona` command, given its words without `pomona` and the limit of its time [s]."""


class BoundedCommands:
    """Commands in processes without a shell, a terminal or a network."""

    def __init__(self, folder: Path, records: Path) -> None:
        """
        Args:
            folder: where they run and what they read.
            records: where they write.
        """
        self._folder = folder
        self._records = records

    def __call__(self, words: Sequence[str], limit: float) -> Answer:
        """Carry out a command; after its limit [s] it is stopped."""
        self._records.mkdir(parents=True, exist_ok=True)
        command = [
            sys.executable,
            "-m",
            "pomona.tools.assistants.confined",
            str(self._folder),
            str(self._records),
        ]
        with (
            tempfile.TemporaryDirectory(prefix="pomona-mcp-") as place,
            open(Path(place, "out"), "w+b") as out,
            open(Path(place, "err"), "w+b") as err,
        ):
            process = subprocess.Popen(
                [*command, *words],
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                env={**os.environ, **_environment(place)},
                start_new_session=True,
            )
            try:
                status = process.wait(limit)
                problem = ""
            except subprocess.TimeoutExpired:
                status = STOPPED
                problem = f"stopped after its limit of {limit:g} s"
            finally:
                _end(process)
            return Answer(status, _text(out), problem or _text(err))


def _environment(place: str) -> dict[str, str]:
    """Return the variables of a command. Its compiled code is its own, so it writes none that another process loads."""
    cache = Path(
        os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "pomona", "assistants"
    )
    cache.mkdir(parents=True, exist_ok=True)
    own = {
        "TMPDIR": place,
        "XDG_CACHE_HOME": str(cache),
        "NUMBA_CACHE_DIR": str(cache / "compiled"),
    }
    return {**own, "COLUMNS": "120", "NO_COLOR": "1"}


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process and those that it started: first with the request that lets a run close its record."""
    with contextlib.suppress(ProcessLookupError, subprocess.TimeoutExpired):
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(GRACE)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _text(stream: IO[bytes]) -> str:
    stream.seek(0)
    return stream.read(MOST_OUTPUT).decode("utf-8", errors="replace")
