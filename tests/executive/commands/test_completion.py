"""Completion and the manual page agree with the parsers; every example is accepted by its parser."""

from __future__ import annotations

import argparse
import shlex
import shutil
import subprocess

import pytest

from pomona.executive.commands.command_line import children, make_parser
from pomona.executive.commands.completion import WRITERS
from pomona.executive.commands.examples import examples

SOME = ("run", "check", "completion", "runs")


@pytest.fixture(scope="module")
def parser() -> argparse.ArgumentParser:
    return make_parser(SOME)


@pytest.mark.parametrize("name", SOME)
def test_every_example_is_taken_and_stands_below_the_help(parser: argparse.ArgumentParser, name: str) -> None:
    child = next(child for known, _about, child in children(parser) if known == name)
    for line, about in examples(name):
        words = shlex.split(line.partition(">")[0])
        assert words[:2] == ["pomona", name]
        parser.parse_args(words[1:])
        assert line in child.format_help()
        assert about in child.format_help()
        assert all(len(row) <= 80 for row in child.format_help().splitlines())


def complete(script: str, *words: str) -> set[str]:
    line = " ".join(shlex.quote(word) for word in words)
    asked = (
        f'cd /nowhere 2>/dev/null; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _pomona; echo "${{COMPREPLY[@]}}"'
    )
    told = subprocess.run(["bash", "-c", f"{script}\n{asked}"], capture_output=True, text=True, check=True)
    assert told.stderr == ""
    return set(told.stdout.split())


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash here")
def test_bash_completes_commands_options_and_values(parser: argparse.ArgumentParser) -> None:
    script = WRITERS["bash"](parser)
    assert complete(script, "pomona", "ru") >= {"run", "runs"}
    assert complete(script, "pomona", "run", "--das") == {"--dashboard"}
    assert complete(script, "pomona", "run", "pick_apple", "--pace", "") == {"fast", "real"}
    assert "pick_apple" in complete(script, "pomona", "run", "pick")
    assert complete(script, "pomona", "runs", "comp") == {"compare"}


def test_all_three_shells_and_the_manual_name_every_option(parser: argparse.ArgumentParser) -> None:
    run = next(child for known, _about, child in children(parser) if known == "run")
    options = [name for action in run._actions for name in action.option_strings if name.startswith("--")]
    assert len(options) > 15
    texts = {what: write(parser) for what, write in WRITERS.items()}
    for name in options:
        assert f" {name} " in texts["bash"]
        assert f" {name} " in texts["zsh"]
        assert f" -l {name[2:]} " in texts["fish"]
        assert name.replace("-", "\\-") in texts["man"]


@pytest.mark.skipif(shutil.which("groff") is None, reason="there is no groff here")
def test_the_manual_is_clean_roff(parser: argparse.ArgumentParser) -> None:
    page = subprocess.run(
        ["groff", "-man", "-Tutf8", "-ww"], input=WRITERS["man"](parser), capture_output=True, text=True, check=True
    )
    assert page.stderr == ""
    assert "pomona run pick_apple" in page.stdout.replace("‐", "-")
