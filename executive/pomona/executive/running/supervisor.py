"""The run's side of its supervisor: another process, which stops the devices when this one hangs or dies.

The tick sends a heartbeat through a pipe. The supervisor reaches the devices over connections of its own, by functions
that their drivers name (`Cell.outside_stops`). It is no safety device: it runs on the same computer.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pomona.executive.cell.cell import Cell
from pomona.executive.errors import UsageError
from pomona.executive.running.launcher import LauncherWatch
from pomona.executive.running.runner import Runner
from pomona.executive.running.supervise import PRIORITY

LATE = 0.5
"""Of the deadline: a tick that is later was held up too long to go on. Two were 0.43 s apart at most on a computer that
was far too busy, 0.10 s with the priority that a run asks for."""


class NoSupervisorError(UsageError):
    """The process could not be started; nothing has moved."""


class Supervisor:
    """One process that watches one run."""

    def __init__(
        self,
        stops: Mapping[str, tuple[str, Sequence[Any]]],
        deadline: float,
        record: Path | None = None,
    ) -> None:
        """
        Args:
            stops: for each device the function `module:name` that stops it from another process, and its arguments.
            deadline: seconds without a heartbeat after which this process is ended and the devices are stopped.
            record: folder for the report of its actions.

        Raises:
            NoSupervisorError: it does not start.
        """
        self._lost = ""
        command = [sys.executable, "-m", "pomona.executive.running.supervise"]
        # A session of its own: a signal of the terminal to the run must not end its supervisor first.
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        orders = {
            "pid": os.getpid(),
            "deadline": deadline,
            "stops": {name: list(how) for name, how in stops.items()},
            "record": str(record.resolve()) if record is not None else "",
        }
        with contextlib.suppress(OSError):
            self._process.stdin.write(json.dumps(orders).encode() + b"\n")
        # seconds that the process may take to be ready
        ready, _, _ = select.select([self._process.stdout], [], [], 60.0)
        if not ready or self._process.stdout.readline() != b"ready\n":
            self._process.kill()
            self.close()
            raise NoSupervisorError("the supervisor process did not start; nothing was moved")
        os.set_blocking(self._process.stdin.fileno(), False)
        os.set_blocking(self._process.stdout.fileno(), False)
        self._deadline = deadline
        self._silent_since = 0.0
        self._unanswered = 0

    def beat(self) -> None:
        """The tick is alive."""
        self._say(b".")
        self._hear()

    def rest(self) -> None:
        """Nothing moves and no tick comes for a while; only this process's end matters."""
        self._say(b"r")

    def state(self) -> str:
        """'ok', or the reason why the supervisor is lost."""
        return self._lost or "ok"

    def close(self) -> None:
        """All went well; harmless when closed already."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._say(b"q")
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5.0)  # seconds that it may take to end
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()

    def _hear(self) -> None:
        """Read answers; they are required, since a hanging supervisor accepts heartbeats for minutes."""
        assert self._process.stdout is not None
        now = time.monotonic()
        if not self._unanswered:
            self._silent_since = now
        self._unanswered += 1
        with contextlib.suppress(OSError, ValueError):
            if os.read(self._process.stdout.fileno(), 65536):
                self._unanswered = 0
        silent = now - self._silent_since
        # unanswered heartbeats from which the supervisor counts as lost; fewer may be a stall of the computer
        if self._unanswered > 10 and silent > self._deadline:
            self._lost = self._lost or f"the supervisor process has not answered for {silent:.1f} s"

    def _say(self, sign: bytes) -> None:
        assert self._process.stdin is not None
        try:
            os.write(self._process.stdin.fileno(), sign)
        except BlockingIOError:
            self._lost = "the supervisor process receives nothing any more"
        except (OSError, ValueError):
            self._lost = "the supervisor process is gone"


class RunSupervision:
    """A supervisor for a cell that needs one, and nothing for any other.

    A tick later than `LATE` of the deadline, but before it, ends the run in the safe state from within. The devices
    were unmonitored meanwhile, and arms that have run out of points must not start by themselves.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._supervisor: Supervisor | None = None
        self._beaten_at: float | None = None
        self._stood_still = ""
        self._launcher = LauncherWatch()

    def begin(self, runner: Runner, record: Path | None) -> None:
        """Start the supervisor before anything moves, in the thread of the tick, which requests priority.

        The loss of the supervisor ends the run in the safe state.

        Raises NoSupervisorError: as `Supervisor`.
        """
        stops = self._cell.outside_stops()
        if stops and not self._cell.clock.simulated:
            self._supervisor = Supervisor(stops, self._cell.heartbeat_deadline, record)
            runner.look_after("supervisor", self.state, required=True)
            with contextlib.suppress(
                OSError
            ):  # not everybody may: then a very busy computer is nearer to the deadline
                os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), PRIORITY)

    def beat(self) -> None:
        """See `Supervisor.beat`."""
        if self._supervisor is None:
            return
        now = self._cell.clock.now()
        if (
            self._beaten_at is not None
            and now - self._beaten_at > LATE * self._cell.heartbeat_deadline
        ):
            still = f"the run stalled for {now - self._beaten_at:.2f} s, during which nothing monitored the cell"
            self._stood_still = self._stood_still or still
        self._beaten_at = now
        self._supervisor.beat()

    def state(self) -> str:
        """'ok', or why the run must end in the safe state."""
        assert self._supervisor is not None
        launcher = self._launcher.state()
        return self._stood_still or (launcher if launcher != "ok" else self._supervisor.state())

    def rest(self) -> None:
        """See `Supervisor.rest`."""
        self._beaten_at = None
        if self._supervisor is not None:
            self._supervisor.rest()

    def close(self) -> None:
        """See `Supervisor.close`."""
        if self._supervisor is not None:
            self._supervisor.close()
