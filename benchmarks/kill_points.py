"""Ends real runs at random points with every signal, and checks the remains.

    python -m benchmarks.kill_points --points 1000 --seed 0

Each point is a process of its own that runs a tree on the simulated cell in real time: from before its handlers are
there until its record is closed. One skill moves the arm, another computes in a worker process. Asserted for each: the
record can be read and ends as it should, the exit status is right, there is no traceback, no process is left. A killed
process may lose the last events that a witness in shared memory saw, but not more than `LOST`. Where other programs
keep the processor busy, `--slack` multiplies the bounds.
"""

from __future__ import annotations

import argparse
import contextlib
import mmap
import multiprocessing
import os
import random
import signal
import statistics
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LOST = 0.25
"""Seconds of a run that a kill may cost."""

SPAN = 7.0
"""Seconds within which the signal comes: a run takes some 5 s, and 1 s to begin."""

WENT_ON = 0.5
"""Seconds for which a run may go on to its end after the signal, where its end was near [s of the run]."""

GONE = 8.0
"""Seconds after which no process of the run may be left."""

WAYS = (
    "SIGINT",
    "SIGTERM",
    "SIGHUP",
    "SIGKILL",
    "SIGINT twice",
    "SIGTERM then SIGINT",
    "reader gone",
    "to all",
)
"""How a run is ended. `to all`: SIGTERM to every process of its session, as a service manager does it."""

TREE = """
pomona: 1
tree: to_and_fro
root:
  sequence:
    - Sway: {}
    - Compute: {}
    - {Sway: {}, repeat: 2}
"""


@dataclass(frozen=True)
class Point:
    """One end: how, how long after the start, and the pause before a second signal [s]."""

    number: int
    way: str
    after: float
    pause: float


@dataclass(frozen=True)
class Left:
    """Remains of one run: `lost` seconds of its record, the phase in which it ended, and the problem."""

    point: Point
    phase: str
    status: int | None
    lost: float
    problems: tuple[str, ...]


# ------------------------------------------------------------------------------------------------- the run


def run_one(folder: str, witness: str, stdout: Any, cell: str) -> None:
    """The process that is ended: the command line as it is, with a witness and two skills more."""
    os.setsid()
    for number in (
        signal.SIGINT,
        signal.SIGTERM,
        signal.SIGHUP,
    ):  # the parent process may ignore them
        signal.signal(
            number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
        )
    os.dup2(stdout.fileno(), 1)
    os.dup2(os.open(f"{folder}/stderr", os.O_WRONLY | os.O_CREAT), 2)
    sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
    _add_skills()
    _add_witness(witness)
    from pomona.executive.cli import main

    sys.argv = [
        "pomona",
        "run",
        f"{folder}/tree.yaml",
        "--cell",
        cell,
        "--pace",
        "real",
        "--record",
        f"{folder}/runs",
    ]
    Path(folder, "listening").touch()  # earlier code is this file's, not the command's
    sys.exit(main())


def _add_skills() -> None:
    from benchmarks.kill_points_skills import Compute, Sway
    from pomona.executive.registry import Registry

    Registry.installed = classmethod(lambda cls: Registry({"Sway": Sway, "Compute": Compute}))  # type: ignore


def _add_witness(path: str) -> None:
    """Note the time of every event in shared memory, which a killed process cannot lose."""
    from pomona.executive.running.tick import EventStream

    with open(path, "r+b") as stream:
        memory = mmap.mmap(stream.fileno(), 16)
    emit = EventStream.emit

    def noted(self: EventStream, event: Any, *, feedback: bool = False) -> None:
        emit(self, event, feedback=feedback)
        memory[:16] = struct.pack("dd", event.t, 1.0)

    EventStream.emit = noted  # type: ignore[method-assign]


# -------------------------------------------------------------------------------------------------- the end


def end_one(point: Point, cell: str, context: Any, slack: float = 1.0) -> Left:
    """Start a run, end it, and check the remains against the bounds, each multiplied by `slack`."""
    with tempfile.TemporaryDirectory(prefix="pomona-kill-") as name:
        folder = Path(name)
        (folder / "tree.yaml").write_text(TREE)
        witness = folder / "witness"
        witness.write_bytes(bytes(16))
        reader, writer = context.Pipe(duplex=False)
        process = context.Process(target=run_one, args=(name, str(witness), writer, cell))
        process.start()
        writer.close()
        drain = threading.Thread(target=_drain, args=(reader,), daemon=True)
        if point.way != "reader gone":
            drain.start()
        while not (
            folder / "listening"
        ).exists():  # a session of its own, and no signal ignored: so does a shell start it
            time.sleep(0.001)
        time.sleep(point.after)
        phase = _phase(folder, witness, process)
        seen = struct.unpack("dd", witness.read_bytes())[0]
        _end(point, process, reader)
        process.join(60.0)
        status = process.exitcode
        if status is None:
            _signal_session(process.pid, signal.SIGKILL)
        problems, lost = _judge(point, phase, status, folder, witness, seen, slack)
        if left := _left(process.pid, slack):
            problems.append(f"left behind: {left}")
            _signal_session(process.pid, signal.SIGKILL)
        with contextlib.suppress(OSError):
            reader.close()
        return Left(point, phase, status, lost, tuple(problems))


def _drain(reader: Any) -> None:
    with contextlib.suppress(OSError, EOFError):
        while os.read(reader.fileno(), 65536):
            pass


def _phase(folder: Path, witness: Path, process: Any) -> str:
    if process.exitcode is not None:
        return "ended"
    if not (folder / "runs").is_dir():
        return "starting"
    return "running" if struct.unpack("dd", witness.read_bytes())[1] else "starting"


def _end(point: Point, process: Any, reader: Any) -> None:
    with contextlib.suppress(ProcessLookupError, OSError):
        match point.way:
            case "reader gone":
                reader.close()
            case "to all":
                _signal_session(process.pid, signal.SIGTERM)
            case "SIGINT twice" | "SIGTERM then SIGINT":
                os.kill(process.pid, signal.SIGTERM if "TERM" in point.way else signal.SIGINT)
                time.sleep(point.pause)
                if process.exitcode is None:
                    os.kill(process.pid, signal.SIGINT)
            case name:
                os.kill(process.pid, getattr(signal, name))


ALLOWED = {
    "SIGINT": {0, 130, -2},
    "SIGTERM": {0, 3, 143, -15},
    "SIGHUP": {0, 3, 129, -1},
    "SIGKILL": {0, -9},
    "SIGINT twice": {0, 130, -2},
    "SIGTERM then SIGINT": {0, 3, 130, 143, -15, -2},
    "reader gone": {0, 3},
    "to all": {0, 3, 143, -15},
}
"""Exit statuses: 0 where the run had ended, 128 + n or -n before it began, 3 (130 for Ctrl-C) in its safe state."""


def _judge(
    point: Point,
    phase: str,
    status: int | None,
    folder: Path,
    witness: Path,
    seen: float,
    slack: float,
) -> tuple[list[str], float]:
    from pomona.executive.recording.read import read_events
    from pomona.executive.running.events import RunEnded, SafeStopped

    problems, lost = [], 0.0
    unread = status == 1 and point.way == "reader gone" and phase == "starting"  # nothing has begun
    if status not in ALLOWED[point.way] and not unread:
        problems.append(f"exit status {status}")
    if status == 0 and phase == "starting" and point.way != "reader gone":
        problems.append("the run began and went on to its end")
    stderr = (folder / "stderr").read_text() if (folder / "stderr").is_file() else ""
    if "Traceback" in stderr or "Exception ignored" in stderr:
        problems.append(stderr[-3000:])
    records = sorted((folder / "runs").iterdir()) if (folder / "runs").is_dir() else []
    for record in records:
        try:
            events = list(read_events(record)) if (record / "run.mcap").is_file() else []
        except Exception as error:
            problems.append(f"the record cannot be read: {type(error).__name__}: {error}")
            continue
        last, there = struct.unpack("dd", witness.read_bytes())
        if there:
            lost = max(0.0, last - (events[-1].t if events else 0.0))
        if status == 0 and phase == "running" and last - seen > WENT_ON * slack:
            problems.append(f"went on for {last - seen:.2f} s")
        if status is not None and status < 0:  # killed: no report was possible
            if lost > LOST * slack:
                problems.append(f"{lost:.3f} s of the record are lost")
        elif not events or not isinstance(events[-1], RunEnded):
            problems.append(f"the record has no end, exit status {status}")
        elif status != 0 and not any(isinstance(event, SafeStopped) for event in events):
            problems.append(f"no safe stop, exit status {status}, outcome {events[-1].outcome}")
        elif status in (3, 130) and events[-1].outcome not in ("stopped", "error"):
            problems.append(f"exit status {status}, outcome {events[-1].outcome}")
    return problems, lost


def _left(session: int, slack: float) -> list[str]:
    """Processes of the run's session that do not go away."""
    end = time.monotonic() + GONE * slack
    while found := _session(session):
        if time.monotonic() > end:
            return [_command(pid) for pid in found]
        time.sleep(0.05)
    return []


def _session(session: int) -> list[int]:
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError, IndexError):
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
                if int(fields[3]) == session and fields[0] != "Z":
                    found.append(int(entry.name))
    return found


def _signal_session(session: int, number: int) -> None:
    for pid in _session(session):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def _command(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()[:200]
    return str(pid)


def points(number: int, seed: int, ways: Sequence[str] = WAYS) -> list[Point]:
    """Random points; every way comes in turn."""
    rng = random.Random(seed)
    return [
        Point(n, ways[n % len(ways)], rng.uniform(0.0, SPAN), rng.uniform(0.0, 0.4))
        for n in range(number)
    ]


def main() -> int:
    """Returns 0 when nothing was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--points", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cell", default="sim")
    parser.add_argument(
        "--way", action="append", choices=WAYS, help="only these (default: all, in turn)"
    )
    parser.add_argument(
        "--slack", type=float, default=1.0, help="factor of the bounds on a busy processor"
    )
    options = parser.parse_args()
    context = multiprocessing.get_context("forkserver")
    # Loaded once, forked for each point: the test covers the run, not Python's imports.
    context.set_forkserver_preload(
        [
            "benchmarks.kill_points_skills",
            "pomona.executive.commands.run",
            "pomona.tools.simulation.connect",
        ]
    )
    found = []
    for point in points(options.points, options.seed, options.way or WAYS):
        left = end_one(point, options.cell, context, options.slack)
        found.append(left)
        mark = "✗" if left.problems else "✓"
        print(f"{mark} {point.number:4d} {point.way:20s} after {point.after:5.2f} s ({left.phase}): "
              f"exit {left.status}, lost {left.lost:.3f} s", *left.problems, sep="\n      " if left.problems else "",
              flush=True)  # fmt: skip
    killed = [left.lost for left in found if left.status == -9 and left.phase == "running"]
    bad = [left for left in found if left.problems]
    running = sum(left.phase == "running" for left in found)
    print(
        f"{len(found)} points, {running} of them while the run was going on, {len(bad)} with something wrong"
    )
    if killed:
        print(
            f"lost by {len(killed)} kills: median {statistics.median(killed):.3f} s, worst {max(killed):.3f} s"
        )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
