"""A campaign survives its own death."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
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


def lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / RESULTS).read_text().splitlines()]


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
