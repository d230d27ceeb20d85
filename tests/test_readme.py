"""Each command of the README runs as it stands there, and its tree passes the check."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pomona.executive.cli import main
from pomona.executive.commands.command_line import command_names

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text("utf-8")
COMMANDS = [
    shlex.split(line, comments=True)
    for line in re.findall(r"^```sh\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)[0].splitlines()
]


def test_each_target_and_command_exists() -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    targets = re.findall(r"^    make (\w+)", README, re.MULTILINE)
    assert targets == ["run", "test"]
    assert all(f"\n{target}:" in makefile for target in targets)
    assert {command[1] for command in COMMANDS} <= set(command_names())
    assert {command[0] for command in COMMANDS} == {"pomona"}


def test_the_tree_passes_the_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (text,) = re.findall(r"^```yaml\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)
    Path("look_and_measure.yaml").write_text(text)
    assert main(["check", "look_and_measure.yaml"]) == 0


def test_the_skill_is_that_of_the_tutorial() -> None:
    (code,) = re.findall(r"^```python\n(class Weighed.*?)^```$", README, re.MULTILINE | re.DOTALL)
    compile(code, "README.md", "exec")
    tutorial = (ROOT / "docs" / "tutorials" / "own_skill.md").read_text("utf-8")
    assert "class Weigh(Skill)" in tutorial


def pomona(command: list[str], folder: Path) -> None:
    words = [sys.executable, "-m", "pomona.executive.cli", *command[1:]]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, f"{shlex.join(command)}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which `make run` has left its record."""
    folder = tmp_path_factory.mktemp("recorded")
    pomona(["pomona", "run", "pick_apple"], folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS, ids=shlex.join)
def test_a_command_runs_as_it_stands(
    command: list[str], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    needs_record = command[1] in ("explain", "runs")
    pomona(command, request.getfixturevalue("recorded") if needs_record else tmp_path)
