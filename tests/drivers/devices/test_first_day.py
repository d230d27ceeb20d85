"""The page of a first day on hardware: its trees are right for a cell, and its commands exist with their options."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from pomona.executive.cli import main
from pomona.executive.commands.command_line import make_parser

PAGE = (Path(__file__).parents[3] / "docs" / "hardware.md").read_text("utf-8")
TREES = dict(re.findall(r'^```yaml title="(\w+\.yaml)"\n(.*?)^```', PAGE, re.MULTILINE | re.DOTALL))
COMMANDS = sorted(set(re.findall(r"`(pomona \w+ [^`]+)`", PAGE)))


def test_the_page_has_trees_and_commands() -> None:
    assert set(TREES) == {"there_and_back.yaml", "hold_still.yaml", "close_in_steps.yaml"}
    assert len(COMMANDS) >= 8
    assert {word for words in COMMANDS for word in words.split() if word.endswith(".yaml")} >= set(
        TREES
    )


@pytest.mark.parametrize("name", sorted(TREES))
def test_a_tree_of_the_page_fits_a_cell(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text(TREES[name])
    main(["check", str(tmp_path / name), "--cell", "sim_plain"])
    assert "error" not in capsys.readouterr().out


@pytest.mark.parametrize("words", COMMANDS)
def test_a_command_of_the_page_has_its_options(words: str) -> None:
    given = shlex.split(words)[1:]
    make_parser(given[:1]).parse_args(given)
