"""The process that a shell waits for while its child carries out the command.

Its exit status is 0 only if the command came to its own end and reported 0. A run that was replaced by another program
(`os.exec*`), or ended by `exit(0)` in compiled code or `os._exit(0)`, has reported nothing and counts as failed.

The child belongs to the same process group, so a signal from the terminal reaches both. A signal that was sent to this
process alone is passed on. The child is killed when this process dies.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import select
import signal
import sys
import time
from collections.abc import Callable

from pomona.executive.running.signals import REPORT, report_end, report_to
from pomona.executive.values.processes import WORDS, write_if_read

LEFT = 3  # exit status of a command whose process ended with 0 before the command did

HEARD = 0.05  # time for the child to take a signal of the whole group [s]; then it is passed on
ECHO = 0.5  # time within which the same signal is one request [s]: `timeout` sends it to a process and to its group

_LEFT_WORDS = b"""the process of the run ended with status 0 before the run did: no success.
It was replaced (os.exec), or a skill or a library ended it. The record, if any, is cut off there.
"""

_FOLLOWED = frozenset({*WORDS, getattr(signal, "SIGCHLD", signal.SIGTERM)})
_END = 0


LOOKS = 5
APART = 0.1
"""Number of successive checks, with their distance [s], that must show a stopped launcher: one that a shell stops and
continues together with its run is stopped for a moment longer than the run."""

_launcher: int | None = None  # process id of the launcher of this process


class LauncherWatch:
    """Looks whether the launcher of this process is stopped: signals to it then do not reach the run."""

    def __init__(self, launcher: int | None = None) -> None:
        """
        Args:
            launcher: its process id; by default of this process, which may have none.
        """
        self._launcher = _launcher if launcher is None else launcher
        self._looked_at = -1.0
        self._stopped = 0

    def state(self) -> str:
        """Return 'ok', or the problem."""
        now = time.monotonic()
        if self._launcher is not None and now - self._looked_at > APART:
            self._looked_at = now
            self._stopped = self._stopped + 1 if is_stopped(self._launcher) else 0
        if self._stopped < LOOKS:
            return "ok"
        return f"the process {self._launcher} that started the run is stopped; a signal to it would not stop the robot"


def is_stopped(process: int) -> bool:
    """Return True if a signal has stopped the process (SIGSTOP, Ctrl-Z); never known outside Linux."""
    try:
        with open(f"/proc/{process}/stat", encoding="utf-8", errors="replace") as stat:
            return stat.read().rpartition(")")[2].split()[0] == "T"
    except (OSError, IndexError):
        return False


def in_child(work: Callable[[], int]) -> int:
    """Carry a command out in a child process, where this returns; in the parent it returns when the child has ended."""
    if sys.platform != "linux":
        return work()
    reading, writing = os.pipe()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _FOLLOWED)
    parent = os.getpid()
    child = os.fork()
    if child:
        os.close(writing)
        return _Follower(child, reading).status()
    os.close(reading)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG of Linux' prctl
    if os.getppid() != parent:
        os._exit(LEFT)
    global _launcher
    _launcher = parent
    report_to(writing)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
    try:
        status = work()
    except SystemExit as ended:
        report_end(ended.code if isinstance(ended.code, int) else int(ended.code is not None))
        raise
    report_end(status)
    return status


class _Follower:
    """The parent's side."""

    def __init__(self, child: int, reading: int) -> None:
        self._child = child
        self._reading = reading
        self._end: int | None = None
        self._heard: dict[int, float] = {}
        os.set_blocking(reading, False)

    def status(self) -> int:
        if (
            signal.getsignal(signal.SIGCHLD) is signal.SIG_IGN
        ):  # then there would be no status to wait for
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        ended = 0
        while not ended:
            told = signal.sigwaitinfo(_FOLLOWED)
            if told.si_signo == signal.SIGCHLD:
                ended, how = os.waitpid(self._child, os.WNOHANG)
            elif told.si_code <= 0 and not self._has_heard(
                told.si_signo
            ):  # sent by a process, not by the terminal
                with contextlib.suppress(ProcessLookupError):
                    os.kill(self._child, told.si_signo)
        self._read()
        code = os.waitstatus_to_exitcode(how)
        if code < 0:
            _die_by(-code)
        if code == 0 and self._end is None:
            write_if_read(2, _LEFT_WORDS)
            return LEFT
        return code or self._end or 0

    def _has_heard(self, number: int) -> bool:
        """Return True when the child has taken this signal by itself just now."""
        since = time.monotonic() - ECHO
        until = time.monotonic() + HEARD
        while True:
            self._read()
            if self._heard.get(number, 0.0) >= since:
                return True
            left = until - time.monotonic()
            if left <= 0.0:
                return False
            select.select([self._reading], [], [], left)
            if self._end is not None:
                return True

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while message := os.read(self._reading, REPORT.size):
                number, value = REPORT.unpack(message)
                if number == _END:
                    self._end = int(value)
                else:
                    self._heard[number] = value


def _die_by(number: int) -> None:
    """End by the child's signal, so that the shell reports a crash. The child has left its core, if any."""
    import resource  # Windows has none, and no launcher

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if number != signal.SIGKILL:
        signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {number})
    os.kill(os.getpid(), number)
