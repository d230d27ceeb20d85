"""Status 0 of `pomona run` means that the run reported a success, however its process ends."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import is_being_written
from pomona.executive.running import launcher
from pomona.executive.running.launcher import LEFT
from pomona.executive.values.processes import WORDS

ENDS = """
import ctypes, os, resource, signal, sys, threading
from pomona.executive import cli

def work(_words):
    match way:
        case "execv":
            os.execv("/bin/true", ["true"])
        case "os._exit":
            os._exit(0)
        case "os._exit in a thread":
            threading.Thread(target=os._exit, args=(0,)).start()
            threading.Event().wait()
        case "exit in compiled code":
            ctypes.CDLL(None).exit(0)
        case "_exit in compiled code":
            ctypes.CDLL(None)._exit(0)
        case "abort":
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            os.abort()
        case "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        case "help":
            return run(["run", "--help"])
        case "raised":
            raise RuntimeError("of its own making")
        case "a thread that ends it with 0 behind a failure":
            threading.Thread(target=lambda: (threading.Event().wait(0.2), os._exit(0))).start()
            return 1
    return int(way)

way, run, cli._run = sys.argv.pop(), cli._run, work
sys.exit(cli.main())
"""


def ended(way: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", ENDS, "run", way]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize(
    "way",
    [
        "execv",
        "os._exit",
        "os._exit in a thread",
        "exit in compiled code",
        "_exit in compiled code",
    ],
)
def test_a_run_that_ends_with_0_and_reports_nothing_is_no_success(way: str) -> None:
    done = ended(way)
    assert done.returncode == LEFT
    assert done.stderr.startswith("the process of the run ended with status 0 before the run did")


@pytest.mark.parametrize(
    ("way", "status"),
    [
        ("0", 0), ("1", 1), ("3", 3), ("130", 130), ("help", 0), ("raised", 1), ("abort", -signal.SIGABRT),
        ("killed", -signal.SIGKILL), ("a thread that ends it with 0 behind a failure", 1),
    ],
)  # fmt: skip
def test_every_other_status_is_the_runs_own(way: str, status: int) -> None:
    done = ended(way)
    assert done.returncode == status
    assert "ended with status 0" not in done.stderr


WAITS = """
import os, signal, sys, threading
from pomona.executive import cli
from pomona.executive.running import launcher

launcher.HEARD, launcher.ECHO = 1.0, 5.0  # of a busy machine

def work(_words):
    try:
        print(os.getpid(), flush=True)
        threading.Event().wait(30.0)
    except KeyboardInterrupt:
        print("once", flush=True)
        try:
            threading.Event().wait(0.5)
        except KeyboardInterrupt:
            print("twice", flush=True)
        raise
    return 0

for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
cli._run = work
sys.exit(cli.main())
"""


def to_the_process(process: subprocess.Popen[str], number: int) -> None:
    process.send_signal(number)


def to_the_group(process: subprocess.Popen[str], number: int) -> None:
    os.killpg(process.pid, number)


def as_timeout_does(process: subprocess.Popen[str], number: int) -> None:
    process.send_signal(number)
    os.killpg(process.pid, number)


@pytest.mark.parametrize("send", [to_the_process, to_the_group, as_timeout_does])
@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_reaches_the_run_once_in_whichever_process_it_arrives(
    send: Callable[[subprocess.Popen[str], int], None], number: int, status: int
) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", WAITS, "run"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    ) as process:  # fmt: skip
        assert process.stdout is not None
        assert int(process.stdout.readline()) != process.pid
        send(process, number)
        said, complaint = process.communicate(timeout=60)
    assert (process.returncode, said, complaint) == (
        status,
        "once\n",
        f"{WORDS[signal.Signals(number)]}\n",
    )


def is_alive(pid: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def test_the_run_dies_with_the_process_that_was_started() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", WAITS, "run"], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        run = int(process.stdout.readline())
        process.kill()
    deadline = time.monotonic() + 60.0  # of a busy machine
    while is_alive(run):
        assert time.monotonic() < deadline
        os.sched_yield()


SKILLS = """
import ctypes, os, sys
from pomona.executive import registry
from pomona.executive.cli import main
from pomona.executive.skill import Skill, Work

class Leave(Skill):
    'Replaces the process.'

    def run(self) -> Work[None]:
        yield None
        os.execv("/bin/true", ["true"])

installed = registry.Registry.installed
registry.Registry.installed = classmethod(lambda cls: cls({"Leave": Leave}))
sys.exit(main())
"""


def test_a_skill_that_replaces_the_process_ends_the_run_without_success_and_cuts_its_record(
    tmp_path: Path,
) -> None:
    tree, cell, runs = tmp_path / "t.yaml", tmp_path / "bench.yaml", tmp_path / "runs"
    tree.write_text("pomona: 1\ntree: t\nroot: {sequence: [{wait: 1 s}, {Leave: {}}]}\n")
    cell.write_text("name: bench\nkind: mock\nclock: manual\ndevices: {}\n")
    command = [
        sys.executable,
        "-c",
        SKILLS,
        "run",
        str(tree),
        "--cell",
        str(cell),
        "--record",
        str(runs),
        "--json",
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == LEFT
    assert done.stdout == ""  # no line that tells of a success
    assert "the process of the run ended with status 0" in done.stderr
    (record,) = runs.iterdir()
    assert not is_being_written(record / "run.mcap")
    assert digest(record).state == "cut off"


def test_a_launcher_that_is_stopped_is_noticed_and_one_that_is_stopped_for_a_moment_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    monkeypatch.setattr(launcher.time, "monotonic", lambda: now[0])
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)

    def states(looks: int) -> list[str]:
        found = []
        for _ in range(looks):
            now[0] += 2.0 * launcher.APART
            found.append(watch.state())
        return found

    def stop(number: int) -> None:
        process.send_signal(number)
        os.waitid(os.P_PID, process.pid, os.WSTOPPED if number == signal.SIGSTOP else os.WCONTINUED)

    try:
        watch = launcher.LauncherWatch(process.pid)
        assert states(10) == ["ok"] * 10
        stop(signal.SIGSTOP)
        assert states(launcher.LOOKS - 1) == ["ok"] * (launcher.LOOKS - 1)
        stop(signal.SIGCONT)
        assert states(1) == ["ok"]
        stop(signal.SIGSTOP)
        assert states(launcher.LOOKS)[-1] == (
            f"the process {process.pid} that started the run is stopped; a signal to it would not stop the robot"
        )
    finally:
        process.kill()
        process.communicate()


def test_a_process_without_a_launcher_misses_none() -> None:
    assert launcher.LauncherWatch().state() == "ok"
