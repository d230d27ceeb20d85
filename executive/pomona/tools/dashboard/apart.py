"""The page in a process of its own: a busy run delays neither a viewer nor a stop there. Messages go to that process
encoded; its pages' requests come back as calls of the run's `ControlLock`.
"""

from __future__ import annotations

import contextlib
import itertools
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.running.events import Event
from pomona.executive.running.starting import Permit
from pomona.tools.dashboard.choices import Choices, JudgeForm, StartRun
from pomona.tools.dashboard.control_lock import ControlLock
from pomona.tools.dashboard.hub import Encoder, Word
from pomona.tools.dashboard.presses import PATIENCE, TooLateError
from pomona.tools.dashboard.security import Access

READY = 60.0
"""Time that the page's process may take to serve [s]; two cores at load 12 needed 9 s."""

GOODBYE = 5.0
"""Time that it may take to end [s]."""

HUNG = 10.0
"""Time for which the page's process may take no message before it counts as lost [s]; the socket holds some seconds."""

HEARTBEAT = 0.25
"""Period of the run's status messages to the page's process [s]."""

PICTURES = 2
"""Heartbeats from one picture of a camera to the next."""

NEVER_LATE = frozenset({"require", "release", "safe_stop", "judge"})
"""Calls that set nothing in motion."""


class PageLostError(PomonaError):
    """The page's process ended or hung during a run: the run cannot be stopped there any more."""

    def __init__(self) -> None:
        super().__init__(
            "the process that serves the page has ended or hangs: the run can be neither seen nor stopped there"
        )


class PageProcess:
    """Starts the page's process, sends it events, and carries out the requests of its pages."""

    def __init__(self, access: Access, records: Path) -> None:
        self.access = access
        self.records = records
        self.viewers = 0
        """Pages that are open."""
        self._permit = Permit.create()
        self.control = ControlLock(lambda: self._news.set(), self._permit)
        self._news = threading.Event()
        self._start_run: StartRun | None = None
        self._judge_form: JudgeForm = lambda _form: {}
        self._choices = Choices({}, {})
        self._encoder = Encoder(self._deliver)
        self._line: Connection | None = None
        self._sending = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._threads: list[threading.Thread] = []
        self._closing = self._lost = False

    def allow_starts(
        self, start_run: StartRun, choices: Choices, judge_form: JudgeForm = lambda _form: {}
    ) -> None:
        """Let the page start runs of these trees on these cells. Before `start`."""
        self._start_run = start_run
        self._choices = choices
        self._judge_form = judge_form

    def on_event(self, event: Event) -> None:
        """Take one event of a run; returns at once.

        Raises PageLostError: the page's process has ended by itself, or hangs. The run then ends in the safe state.
        """
        if self._lost:
            raise PageLostError
        self._encoder.on_event(event)

    def start(self) -> None:
        """Start the process and wait until it serves. Raises UsageError: the address cannot be used."""
        here, there = socket.socketpair()
        here.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("ll", int(HUNG), 0))
        with there:
            inherited = [there.fileno(), self._permit.read_fd]
            command = [sys.executable, "-m", "pomona.tools.dashboard.serve", *map(str, inherited)]
            # A session of its own: Ctrl-C in the terminal ends the run first, and the page shows how.
            self._process = subprocess.Popen(command, pass_fds=inherited, start_new_session=True)
        self._line = line = Connection(here.detach())
        line.send((self.access, self.records.resolve(), self._choices, self._start_run is not None))
        refusal = self._refusal(line)
        if refusal:
            self.close()
            raise UsageError(refusal)
        for work in (self._listen, self._beat):
            self._threads.append(
                threading.Thread(target=work, args=(line,), name="pomona-page", daemon=True)
            )
            self._threads[-1].start()

    def _refusal(self, line: Connection) -> str:
        """Why the process does not serve; empty once it does."""
        with contextlib.suppress(EOFError, OSError):
            while line.poll(READY):
                kind, *rest = line.recv()
                if kind == "viewers":
                    (self.viewers,) = rest
                else:
                    return "" if kind == "ready" else str(rest[0])
            return f"the page's process did not start within {READY:.0f} s"
        return "the page's process did not start"

    def close(self) -> None:
        """End the process once its viewers have received everything. Harmless when it was not started."""
        self._encoder.close()
        self._closing = True
        self._news.set()
        if self._process is not None and self._line is not None:
            self._end(self._process, self._line)
        self._permit.close()

    def _end(self, process: subprocess.Popen[bytes], line: Connection) -> None:
        self._send(("close",))
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(GOODBYE)
        process.kill()
        process.wait()
        for thread in self._threads:
            thread.join(GOODBYE)
        line.close()

    def _deliver(self, words: Sequence[Word]) -> None:
        self._send(("words", list(words)))

    def _send(self, message: tuple[Any, ...]) -> None:
        if self._line is None or self._lost:
            return
        try:
            with self._sending:
                self._line.send(message)
        except OSError:
            self._lost = not self._closing

    def _beat(self, _line: Connection) -> None:
        for turn in itertools.count():
            if self._closing or self._lost:
                return
            self._send(("standing", self.control.standing))
            if self.viewers and turn % PICTURES == 0:
                self._send(("pictures", self.control.pictures()))
            self._news.wait(HEARTBEAT)
            self._news.clear()

    def _listen(self, line: Connection) -> None:
        while True:
            try:
                kind, *rest = line.recv()
            except (EOFError, OSError):
                self._lost = not self._closing
                return
            if kind == "viewers":
                (self.viewers,) = rest
            else:
                threading.Thread(
                    target=self._carry_out, args=rest, name="pomona-page-call", daemon=True
                ).start()

    def _carry_out(self, number: int, name: str, arguments: Sequence[Any], asked: float) -> None:
        value = None
        refusal = ""
        try:
            value = self._call(name, arguments, time.monotonic() - asked)
        except PomonaError as error:
            refusal = str(error)
        except Exception as error:  # after any error the page gets an answer
            refusal = f"{type(error).__name__}: {error}"
        self._send(("answer", number, value, refusal, self.control.standing))

    def _call(self, name: str, arguments: Sequence[Any], ago: float) -> Any:
        if ago > PATIENCE and name not in NEVER_LATE:
            raise TooLateError(f"the request is {ago:.1f} s old, too old to be executed")
        if name == "start" and self._start_run is not None:
            return self._start_run(*arguments)
        if name == "judge":
            return self._judge_form(*arguments)
        return self.control.call(name, *arguments)
