"""A run ends in the process that began it, once."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pomona.executive import skill
from pomona.executive.execute import RunOrder, execute
from pomona.executive.running.starting import Starting

RUN = """
import os, sys
from fake_runs import Turn, make
from pomona.executive.skill import run_in_progress
from pomona.executive.registry import Registry
from pomona.executive.skill import Interrupted, Skill, Work

way = sys.argv[1]

class Odd(Skill):
    'Forks.'

    def run(self) -> Work:
        try:
            for _ in range(3):
                yield None
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
print("child", os.waitstatus_to_exitcode(os.wait()[1]))
"""


def a_run(way: str) -> subprocess.CompletedProcess[str]:
    here = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    return subprocess.run(
        [sys.executable, "-c", RUN, way], capture_output=True, text=True, timeout=60, env=here
    )


@pytest.mark.parametrize("way", ["exit", "go on", "exit while letting go"])
def test_a_child_that_comes_back_into_the_run_leaves_and_does_nothing(way: str) -> None:
    done = a_run(way)
    end, child = done.stdout.splitlines()
    assert end.startswith("failure" if way == "exit while letting go" else "success")
    assert child == "child 3"
    assert done.stderr.count("was forked in the run came back into it") == 1


def test_every_run_is_one_in_progress_until_its_cell_is_closed(tmp_path: Path) -> None:
    tree = tmp_path / "tree.yaml"
    within: list[int | None] = []
    tree.write_text("pomona: 1\ntree: t\nroot: {wait: 40 ms}\n")
    (tmp_path / "cell.yaml").write_text("name: bench\nkind: mock\nclock: manual\ndevices: {}\n")
    for dry in (True, False):
        order = RunOrder(tree, tmp_path / "cell.yaml", dry=dry)
        execute(order, on_ready=lambda _runner: within.append(skill._process))
    assert within == [os.getpid()] * 2
    assert skill._process is None


def test_no_full_collection_holds_up_the_drivers_while_a_cell_is_prepared(tmp_path: Path) -> None:
    """Measured: 0.12 to 0.15 s in a pick's process, and the watchdog of a UR's script is 0.1 s."""
    (tmp_path / "tree.yaml").write_text("pomona: 1\ntree: t\nroot: {wait: 40 ms}\n")
    (tmp_path / "cell.yaml").write_text("name: bench\nkind: mock\nclock: manual\ndevices: {}\n")
    collects: dict[str, bool] = {}
    frozen: list[int] = []

    def note(stage: str) -> None:
        collects[stage.split()[0]] = gc.isenabled()

    def begin(_runner: object) -> None:
        note("running")
        frozen.append(gc.get_freeze_count())

    class Noted(Starting):
        def reach(self, what: str, done: int = 0, of: int = 0) -> None:
            note(what)
            super().reach(what, done, of)

    execute(
        RunOrder(tmp_path / "tree.yaml", tmp_path / "cell.yaml"), on_ready=begin, starting=Noted()
    )
    assert collects == {"reading": True, "connecting": False, "running": True}
    assert frozen[0] > 10_000 > gc.get_freeze_count()
    assert gc.isenabled()
