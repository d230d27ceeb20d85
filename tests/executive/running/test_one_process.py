"""A run ends in the process that began it, once, and never with the status of a success that it was not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pomona.executive.execute import RunOrder, execute

RUN = """
import os, sys, threading
from fake_runs import Turn, make
from pomona.executive.one_process import run_in_progress
from pomona.executive.registry import Registry
from pomona.executive.skill import Interrupted, Skill, Work

way = sys.argv[1]

class Odd(Skill):
    'Forks, or ends the process.'

    def run(self) -> Work:
        try:
            for _ in range(3):
                yield None
            if way == "_exit":
                os._exit(0)
            if way == "_exit in a thread":
                threading.Thread(target=os._exit, args=(0,)).start()
                threading.Event().wait()
            if way in ("exit", "go on") and os.fork() == 0 and way == "exit":
                sys.exit(0)
            for _ in range(20):
                yield None
        except Interrupted:
            if way == "exit while letting go" and os.fork() == 0:
                sys.exit(0)
            raise

class Fail(Skill):
    'Fails later.'

    failures = ("LATE",)

    def run(self) -> Work:
        for _ in range(8):
            yield None
        raise self.failure("LATE", "late")

tree = "pomona: 1\\ntree: t\\nroot:\\n  parallel:\\n    - Odd: {}\\n    - Turn: {duration: 100 ms}\\n"
if way == "exit while letting go":
    tree += "    - Fail: {}\\n"
with run_in_progress():
    runner, cell, _events = make(tree, Registry({"Odd": Odd, "Turn": Turn, "Fail": Fail}))
    result = runner.run()
    print(result.outcome, cell.wheel.log, result.reason, flush=True)
if "_exit" not in way:
    print("child", os.waitstatus_to_exitcode(os.wait()[1]))
"""


def a_run(way: str) -> subprocess.CompletedProcess[str]:
    here = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    return subprocess.run([sys.executable, "-c", RUN, way], capture_output=True, text=True, timeout=60, env=here)


@pytest.mark.parametrize("way", ["exit", "go on", "exit while letting go"])
def test_a_child_that_comes_back_into_the_run_leaves_and_does_nothing(way: str) -> None:
    done = a_run(way)
    end, child = done.stdout.splitlines()
    assert end.startswith("failure" if way == "exit while letting go" else "success")
    assert child == "child 3"
    assert done.stderr.count("was forked in the run came back into it") == 1


def test_a_skill_that_ends_the_process_ends_the_run_in_the_safe_state() -> None:
    done = a_run("_exit")
    assert done.stdout.startswith("error ['start', 'stop'")
    assert "os._exit(0) was called during the run" in done.stdout


def test_a_thread_that_ends_the_process_ends_it_with_no_success() -> None:
    assert a_run("_exit in a thread").returncode == 3


def test_every_run_is_one_in_progress_until_its_cell_is_closed(tmp_path: Path) -> None:
    tree, before = tmp_path / "tree.yaml", os._exit
    within: list[object] = []
    tree.write_text("pomona: 1\ntree: t\nroot: {wait: 40 ms}\n")
    (tmp_path / "cell.yaml").write_text("name: bench\nkind: mock\nclock: manual\ndevices: {}\n")
    for dry in (True, False):
        execute(RunOrder(tree, tmp_path / "cell.yaml", dry=dry), on_ready=lambda _runner: within.append(os._exit))
    assert len(within) == 2
    assert before not in within
    assert os._exit is before
