"""Every figure of the README, a report or a model card has the command that measures it and the commit at which it was
measured, and the README's are those of the report that they name."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from pomona.executive.commands.command_line import command_names

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text("utf-8")
REPORTS = sorted(
    [*(ROOT / "docs" / "reports").glob("*/*.md"), *(ROOT / "docs" / "model_cards").glob("*.md")]
)
COMMAND = re.compile(r"`((?:make|pomona|python -m) [^`]+)`")
COMMIT = re.compile(r"(?<![\w#])`([0-9a-f]{7,12})\+?`")
NUMBER = re.compile(r"(?<![\w.])\d{1,3}(?: \d{3})+(?![\d.])|(?<![\w.])\d+(?:\.\d+)?")
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))


def rows() -> list[str]:
    """The rows of the README's table of figures."""
    section = README.partition("\n## Measured results\n")[2].partition("\n## ")[0]
    return [line for line in section.splitlines() if line.startswith("| ")][1:]


def is_there(command: str) -> bool:
    """Whether a command can be typed: its target, its subcommand, its module, and the file it names."""
    words = [word for word in shlex.split(command) if "=" not in word]
    files = all((ROOT / word).is_file() for word in words if word.endswith((".yaml", ".yml")))
    if words[0] == "make":
        return words[1] in TARGETS
    if words[0] == "pomona":
        return words[1] in command_names() and files
    return (ROOT / (words[2].replace(".", "/") + ".py")).is_file()


def git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        ["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False
    )


def numbers(text: str) -> Iterator[str]:
    """Every number of a text, thousands without their space."""
    return (found.replace(" ", "") for found in NUMBER.findall(text))


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.split("|")[1].strip()[:40])
def test_a_row_of_the_readme_has_its_command_its_commit_and_figures_that_its_report_has(
    row: str,
) -> None:
    _, _what, figures, source, _ = (
        row.split(" | ") if row.count(" | ") > 2 else ("", *row.strip("| ").split(" | "), "")
    )
    (command,) = COMMAND.findall(source)
    assert is_there(command), command
    assert COMMIT.search(source), "at which commit?"
    (link,) = re.findall(r"\]\((docs/[^)]+)\)", source)
    report = (ROOT / link).read_text("utf-8")
    assert COMMIT.search(source)[1] in report, f"{link} is of another commit"  # type: ignore[index]
    had = [float(number) for number in numbers(report)]
    had += [100.0 * value for value in had]  # a share as a percentage
    for number in numbers(figures):
        digits = len(number.partition(".")[2])
        assert any(round(value, digits) == float(number) for value in had), (
            f"{link} says no {number}"
        )


@pytest.mark.parametrize("report", REPORTS, ids=lambda page: page.stem)
def test_a_report_names_its_command_and_its_commit(report: Path) -> None:
    text = report.read_text("utf-8")
    commands = COMMAND.findall(text)
    assert commands
    assert [command for command in commands if not is_there(command)] == []
    assert COMMIT.search(text)


def test_every_commit_that_is_named_is_one_of_this_repository() -> None:
    if git("rev-parse", "--is-shallow-repository").stdout.strip() != "false":
        pytest.skip("no history here")
    named = {
        commit
        for page in (ROOT / "README.md", *REPORTS)
        for commit in COMMIT.findall(page.read_text("utf-8"))
    }
    assert len(named) > 3
    assert [
        commit
        for commit in sorted(named)
        if git("merge-base", "--is-ancestor", commit, "HEAD").returncode
    ] == []
