"""Completion agrees with the parsers; every example is accepted by its parser."""

from __future__ import annotations

import argparse
import shlex
import shutil
import subprocess

import pytest

from pomona.executive.commands.command_line import children, examples, make_parser
from pomona.tools.listings.command_completion import SHELLS, script

SOME = ("run", "check", "completion", "runs", "rerun", "why", "edit", "mcp")


@pytest.fixture(scope="module")
def parser() -> argparse.ArgumentParser:
    return make_parser(SOME)


@pytest.mark.parametrize("name", SOME)
def test_every_example_is_taken_and_stands_below_the_help(
    parser: argparse.ArgumentParser, name: str
) -> None:
    child = next(child for known, _about, child in children(parser) if known == name)
    for line, about in examples(name):
        words = shlex.split(line.partition(">")[0])
        assert words[:2] == ["pomona", name]
        parser.parse_args(words[1:])
        assert line in child.format_help()
        assert about in child.format_help()
        assert all(len(row) <= 80 for row in child.format_help().splitlines())


def complete(text: str, *words: str) -> set[str]:
    line = " ".join(shlex.quote(word) for word in words)
    asked = (
        f"COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; "
        f"_shtab_pomona pomona {shlex.quote(words[-1])} {shlex.quote(words[-2])}; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    told = subprocess.run(
        ["bash", "-c", f"{text}\n{asked}"], capture_output=True, text=True, check=True, cwd="/"
    )
    assert told.stderr == ""
    return set(told.stdout.split())


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash here")
def test_bash_completes_commands_options_and_values(parser: argparse.ArgumentParser) -> None:
    text = script(parser, "bash")
    assert complete(text, "pomona", "ru") >= {"run", "runs"}
    assert complete(text, "pomona", "run", "--das") == {"--dashboard"}
    assert complete(text, "pomona", "run", "pick_apple", "--pace", "") == {"fast", "real"}
    assert "pick_apple" in complete(text, "pomona", "run", "pick")
    assert "tmp" in complete(text, "pomona", "run", "tm"), "a tree may be a file"
    assert "emulated" in complete(text, "pomona", "run", "pick_apple", "--cell", "emu")
    assert complete(text, "pomona", "runs", "comp") == {"compare"}


@pytest.mark.parametrize("shell", SHELLS)
def test_each_shell_has_every_option_and_the_installed_trees(
    parser: argparse.ArgumentParser, shell: str
) -> None:
    run = next(child for known, _about, child in children(parser) if known == "run")
    options = [
        name for action in run._actions for name in action.option_strings if name.startswith("--")
    ]
    assert len(options) > 15
    text = script(parser, shell)
    for name in options:
        assert (f"-l {name[2:]}" if shell == "fish" else name) in text
    assert "pick_apple" in text
