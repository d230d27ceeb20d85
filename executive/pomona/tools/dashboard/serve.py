"""The page's own process, started by `PageProcess`: python -m pomona.tools.dashboard.serve FD PERMIT_FD"""

from __future__ import annotations

import itertools
import signal
import sys
import threading
import time
from concurrent.futures import Future
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from pomona.executive.errors import PomonaError
from pomona.executive.running.starting import Permit
from pomona.tools.dashboard.choices import Choices
from pomona.tools.dashboard.control_lock import CANCELLED, ControlStatus, RefusedError
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard

CALL_PATIENCE = 30.0  # time that the run's process may take to answer a call [s]


class RemoteControl:
    """The run's `ControlLock`, in another process."""

    def __init__(self, line: Connection, permit: Permit) -> None:
        self._permit = permit
        self._line, self._sending = line, threading.Lock()
        self._standing, self._heard = ControlStatus(), time.monotonic()
        self._numbers = itertools.count(1)
        self._open: dict[int, Future[Any]] = {}

    @property
    def standing(self) -> ControlStatus:
        """How things stood when the run's process was heard last."""
        return self._standing

    @property
    def silent(self) -> float:
        """Time since then [s]."""
        return time.monotonic() - self._heard

    def hear(self, standing: ControlStatus) -> bool:
        """Take the status; return True if pages must be informed."""
        before, self._standing, self._heard = self._standing, standing, time.monotonic()
        told = (before.holder, before.start, before.known_faults)
        return told != (standing.holder, standing.start, standing.known_faults)

    def answered(self, number: int, value: Any, refusal: str) -> None:
        """Take the answer of a call."""
        call = self._open.pop(number, None)
        if call is not None and refusal:
            call.set_exception(RefusedError(refusal))
        elif call is not None:
            call.set_result(value)

    def say(self, *message: Any) -> None:
        """Send a message to the run's process."""
        with self._sending:
            self._line.send(message)

    def call(self, name: str, *arguments: Any) -> Any:
        """Let the run's process carry something out, and wait for its answer.

        Raises RefusedError: it is not carried out, or not answered in time.
        """
        number = next(self._numbers)
        answer = self._open[number] = Future()
        try:
            self.say("call", number, name, arguments, time.monotonic())
            return answer.result(CALL_PATIENCE)
        except TimeoutError:
            raise RefusedError(
                f"the run's process has not answered for {CALL_PATIENCE:.0f} s"
            ) from None
        except OSError:
            raise RefusedError("the run's process has ended") from None

    def safe_stop(self, who: str) -> str:
        """See `ControlLock`. A run that is being prepared needs no answer of its process: it has lost its permit.

        Raises RefusedError: the run's process has ended, or does not answer.
        """
        if not self._permit.take():
            return str(self.call("safe_stop", who))
        try:
            self.say("call", next(self._numbers), "safe_stop", (who,), time.monotonic())
        except OSError:
            raise RefusedError("the run's process has ended") from None
        return CANCELLED


class ServedDashboard(Dashboard):
    """A dashboard that counts its viewers for the run's process."""

    def __init__(self, access: Access, records: Path, remote: RemoteControl) -> None:
        self._remote = remote
        self._told = 0
        super().__init__(access, records, remote)

    def announce(self) -> None:
        """Announce as a dashboard does, and report the number of viewers to the run's process."""
        super().announce()
        if self.hub.viewers != self._told:
            self._told = self.hub.viewers
            self._remote.say("viewers", self._told)


def main(line: Connection, permit: Permit) -> None:
    """Serve until the run's process asks for the end, or has ended."""
    access, records, choices, starts = line.recv()
    remote = RemoteControl(line, permit)
    dashboard = _serve(access, records, choices, starts, remote)
    if dashboard is None:
        return
    try:
        while True:
            kind, *rest = line.recv()
            if kind == "close":
                break
            if kind == "words":
                dashboard.hub.take(*rest)
                continue
            if kind == "pictures":
                for picture in rest[0]:
                    dashboard.hub.tell("Picture", **picture)
                continue
            *answer, standing = rest
            changed = remote.hear(standing)
            if answer:
                remote.answered(*answer)
            if changed:
                dashboard.announce()
    except (EOFError, OSError):
        pass  # the run's process has ended: there is nothing to show any more
    finally:
        dashboard.close()


def _serve(
    access: Access, records: Path, choices: Choices, starts: bool, remote: RemoteControl
) -> ServedDashboard | None:
    """Return a dashboard that serves; None after the reason was reported to the run's process."""
    dashboard = ServedDashboard(access, records, remote)
    if starts:
        dashboard.allow_starts(
            lambda form: str(remote.call("start", form)),
            choices,
            lambda form: dict(remote.call("judge", form)),
        )
    try:
        dashboard.start()
    except PomonaError as error:
        remote.say("refused", str(error))
        return None
    remote.say("ready")
    return dashboard


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    main(Connection(int(sys.argv[1])), Permit(int(sys.argv[2])))
