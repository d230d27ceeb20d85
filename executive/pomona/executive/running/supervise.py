"""The supervisor process: receives the run's heartbeat, and stops the devices when it fails.

A run that a signal has stopped is continued: it detects its stall, and ends in the safe state with a whole record.

Standard input brings one line of JSON, then one byte at a time: `.` alive, and the next is due within the deadline; `r`
at rest, only the process's end counts; `q` orderly end. An end of input without `q` is a run that died. Standard output
reports `ready`, then answers each message with one byte, so that the run detects a dead supervisor.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from pomona.executive.running.launcher import is_stopped
from pomona.executive.values.processes import WORDS, within, write_if_read

STOPPING = 3.0  # seconds for which each device is tried again: its old connection may have to be noticed as gone first
# file in the record's folder: actions of the supervisor and their reasons
REPORT = "supervisor.json"

LOOKS = 20  # polls within the deadline; a late poll counts once, so a stalled computer misses no heartbeat
CONTINUED = 0.6  # of the deadline, after which a stopped run is continued: late enough for it to detect its stall
PRIORITY = -10  # requested niceness: stopping devices has priority over computations


@dataclass(frozen=True)
class Orders:
    """Orders of the run: `stops` has for each device the function `module:name` and its arguments."""

    pid: int
    deadline: float
    stops: dict[str, tuple[str, list[Any]]]
    record: str


def main() -> int:
    """Supervise one run.

    Returns:
        0 when it ended by itself, 1 when its devices had to be stopped.
    """
    for number in WORDS:
        signal.signal(
            number, signal.SIG_IGN
        )  # a signal that ends the run must not end its supervisor first
    with contextlib.suppress(OSError):  # not everybody may
        os.setpriority(os.PRIO_PROCESS, 0, PRIORITY)
    orders = Orders(**json.loads(sys.stdin.buffer.readline()))
    stops = {
        device: (_load(function), arguments)
        for device, (function, arguments) in orders.stops.items()
    }
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    os.set_blocking(sys.stdout.fileno(), False)
    reason = _listen(sys.stdin.fileno(), orders.deadline, orders.pid)
    if not reason:
        return 0
    began = time.monotonic()
    _end(orders.pid)
    outcomes = _stop_all(stops)
    _report(orders, reason, outcomes, time.monotonic() - began)
    return 1


def _listen(heartbeat: int, deadline: float, run: int) -> str:
    """Why the devices must be stopped; empty when all ended well."""
    watched = False
    looks = 0
    while True:
        ready, _, _ = select.select([heartbeat], [], [], deadline / LOOKS if watched else None)
        if not ready:
            looks += 1
            if looks == round(CONTINUED * LOOKS) and is_stopped(run):
                os.kill(run, signal.SIGCONT)
            if looks < LOOKS:
                continue
            return f"the run's process did not answer for {deadline:g} s"
        looks = 0
        chunk = os.read(heartbeat, 65536)
        if not chunk:
            return "the run's process died"
        if b"q" in chunk:
            return ""
        with contextlib.suppress(
            OSError
        ):  # the run does not read, or is gone: both show on the other pipe
            os.write(sys.stdout.fileno(), b".")
        watched = chunk.endswith(b".")


def _end(pid: int) -> None:
    """Kill the process: if it hangs, it must not move again, and devices that accept one client must be released."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def _stop_all(stops: dict[str, tuple[Callable[..., None], list[Any]]]) -> dict[str, str]:
    outcomes = dict.fromkeys(stops, "")

    def stop(device: str, function: Callable[..., None], arguments: list[Any]) -> None:
        end = time.monotonic() + STOPPING
        while True:
            try:
                function(*arguments)
            except Exception as error:
                outcomes[device] = f"could not be stopped: {error}"
            else:
                outcomes[device] = "stopped"
                return
            if time.monotonic() > end:
                return
            time.sleep(0.05)  # seconds between two tries

    threads = [threading.Thread(target=stop, args=(device, *how)) for device, how in stops.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return outcomes


def _report(orders: Orders, reason: str, outcomes: dict[str, str], took: float) -> None:
    devices = "; ".join(f"{device} {what}" for device, what in outcomes.items())
    words = f"supervisor: {reason}. {devices}.\n"
    if orders.record:
        text = json.dumps(
            {
                "reason": reason,
                "devices": outcomes,
                "took_s": round(took, 3),
                "wall_time": time.time(),
            }
        )
        path = Path(orders.record, REPORT)
        try:
            within(STOPPING, lambda: path.write_text(text + "\n", encoding="utf-8"))
        except OSError as error:  # the folder is gone, the disk is full or dead: the devices are stopped all the same
            words += f"supervisor: {path}: {error.strerror or error}\n"
    write_if_read(2, words.encode(errors="replace")[:4096])


def _load(name: str) -> Callable[..., None]:
    module, _, function = name.partition(":")
    loaded: Callable[..., None] = getattr(import_module(module), function)
    return loaded


if __name__ == "__main__":
    sys.exit(main())
