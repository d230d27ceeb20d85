"""A campaign survives its own death, and that of a worker on a Ray cluster."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pomona.tools.library.campaign.run import RESULTS

pytestmark = pytest.mark.slow

LOOK = """
pomona: 1
tree: look
root:
  sequence:
    - MoveTo: {pose: observe}
    - UpdateMap: {map: "{map}"}
"""
"""Two steps that need no network, whose loading would cost each process more than all its runs."""

LOOKS = """
pomona: 1
campaign: looks
tree: look.yaml
seeds: 2
vary: {fruit: [apple_1, apple_3]}
set: {distractors: 0}
score: {success: []}
"""

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def looks(tmp_path: Path) -> Path:
    """A campaign file of four short runs, its tree beside it."""
    (tmp_path / "look.yaml").write_text(LOOK)
    path = tmp_path / "looks.yaml"
    path.write_text(LOOKS)
    return path


@pytest.fixture
def start() -> Iterator[Start]:
    """Start `pomona campaign` as a process whose output can be read line by line; it is ended with the test."""
    started = []

    def begin(*arguments: object) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "pomona.executive.cli", "campaign", *map(str, arguments)]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def read_until(process: subprocess.Popen[str], part: str) -> str:
    """Return the process's output up to the line that holds `part`."""
    said = ""
    assert process.stdout is not None
    for line in process.stdout:
        said += line
        if part in line:
            return said
    raise AssertionError(f"the process never said '{part}':\n{said}")


PASSING = ("crc32", "wall_s", "compute_s", "record", "commit")
"""Parts of a result that depend on the machine."""


def lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / RESULTS).read_text().splitlines()]


def lasting(folder: Path) -> dict[str, dict[str, Any]]:
    results = {line["name"]: line for line in lines(folder)}
    return {
        name: {k: v for k, v in results[name].items() if k not in PASSING}
        for name in sorted(results)
    }


@pytest.mark.long
def test_of_two_campaigns_on_one_folder_one_runs_and_the_other_is_refused(
    looks: Path, tmp_path: Path, start: Start
) -> None:
    first = start(looks, "--out", tmp_path / "out", "--workers", 1)
    read_until(first, "[1/4]")
    second = start(looks, "--out", tmp_path / "out", "--workers", 1)
    refused, _ = second.communicate(timeout=300)
    assert second.returncode == 2
    assert "another campaign is writing there" in refused
    assert "Traceback" not in refused
    read_until(first, "written to")
    assert first.wait(30) == 0
    after = lines(tmp_path / "out")
    assert len({result["name"] for result in after}) == len(after) == 4
    assert {result["outcome"] for result in after} == {"success"}


@pytest.mark.long
def test_a_killed_campaign_goes_on_without_repeating_or_losing_a_run(
    looks: Path, tmp_path: Path, start: Start
) -> None:
    first = start(looks, "--out", tmp_path / "out", "--workers", 2)
    read_until(first, "[2/4]")
    os.kill(first.pid, signal.SIGKILL)
    assert first.wait(30) == -signal.SIGKILL
    done = lines(tmp_path / "out")
    assert 2 <= len(done) < 4
    with (tmp_path / "out" / RESULTS).open("a") as stream:
        stream.write('{"name": "all/fruit=apple_3/pl')  # a line that the kill cut off
    second = start(looks, "--out", tmp_path / "out", "--workers", 2)
    said = read_until(second, "written to")
    assert second.wait(30) == 0
    assert f"[{len(done) + 1}/4]" in said
    assert "4 of 4 runs" in said
    after = lines(tmp_path / "out")
    assert after[: len(done)] == done
    assert len({result["name"] for result in after}) == len(after) == 4
    assert {result["outcome"] for result in after} == {"success"}


@pytest.mark.long
def test_ray_gives_the_same_results_run_for_run_though_a_worker_is_killed(
    looks: Path, tmp_path: Path, start: Start
) -> None:
    here = start(looks, "--out", tmp_path / "here", "--workers", 1)
    read_until(here, "written to")
    there = start(looks, "--out", tmp_path / "there", "--workers", 2, "--engine", "ray")
    read_until(there, "[1/4]")
    os.kill(busy_ray_worker(there.pid), signal.SIGKILL)
    read_until(there, "written to")
    assert there.wait(60) == 0
    assert lasting(tmp_path / "there") == lasting(tmp_path / "here")
    assert len(lines(tmp_path / "there")) == 4


def busy_ray_worker(ancestor: int) -> int:
    """A Ray process below `ancestor` that is computing an order."""
    end = time.monotonic() + 60.0
    while time.monotonic() < end:
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                title = (folder / "cmdline").read_bytes().split(b"\0")[0].decode()
                if title == "ray::run_order" and ancestor in ancestors(int(folder.name)):
                    return int(folder.name)
            except OSError:  # it has just ended
                continue
    raise AssertionError("no Ray worker was busy within a minute")


def ancestors(pid: int) -> set[int]:
    found: set[int] = set()
    while pid > 1:
        pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
        found.add(pid)
    return found
