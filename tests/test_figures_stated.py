"""Every figure of docs/results.json has a command and a commit; the README, model cards and links agree with it."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from pomona.executive.commands.command_line import command_names
from scripts.results import PAGE, page, read_rows

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text("utf-8")
CARDS = sorted((ROOT / "docs" / "model_cards").glob("*.md"))
ROWS = {row["id"]: row for row in read_rows()}
NEEDED = {"id", "subject", "claim", "figure", "command"}
KNOWN = NEEDED | {"commit", "recorded", "interval", "cases", "seeds", "measured", "judge", "note"}
COMMAND = re.compile(r"`((?:make|pomona|python -m) [^`]+)`")
COMMIT = re.compile(r"(?<![\w#])`([0-9a-f]{7,12})\+?`")
NUMBER = re.compile(r"(?<![\w.])\d{1,3}(?: \d{3})+(?![\d.])|(?<![\w.])\d+(?:\.\d+)?")
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))


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


def numbers(text: str) -> set[float]:
    """Every number of a text."""
    return {float(found.replace(" ", "")) for found in NUMBER.findall(text)}


def test_the_page_of_results_is_what_its_script_writes() -> None:
    assert PAGE.read_text("utf-8") == page(read_rows()), "run `make results`"


def test_a_row_is_whole() -> None:
    assert len(ROWS) == len(read_rows()), "two rows have one id"
    for row in ROWS.values():
        assert row.keys() >= NEEDED, row["id"]
        assert row.keys() <= KNOWN, row["id"]
        assert ("commit" in row) != ("recorded" in row), row["id"]
        assert numbers(row["figure"]), row["id"]


def test_the_commands_of_results_and_model_cards_are_there() -> None:
    named = {row["command"] for row in ROWS.values()}
    for card in CARDS:
        named |= set(COMMAND.findall(card.read_text("utf-8")))
    assert [command for command in sorted(named) if not is_there(command)] == []


def test_every_commit_that_is_named_is_one_of_this_repository() -> None:
    if git("rev-parse", "--is-shallow-repository").stdout.strip() != "false":
        pytest.skip("no history here")
    named = {row.get("commit") or row["recorded"] for row in ROWS.values()}
    for document in (ROOT / "README.md", PAGE, *CARDS):
        named |= set(COMMIT.findall(document.read_text("utf-8")))
    history = git("rev-list", "HEAD").stdout.split()
    assert [one for one in sorted(named) if not any(each.startswith(one) for each in history)] == []


def test_the_figures_of_the_readme_are_those_of_the_rows_that_it_names() -> None:
    section = README.partition("\n## Measured results\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if "results.md#" in line]
    assert lines
    for line in lines:
        _task, figure, source = line.strip("| ").split(" | ")
        row = ROWS[re.findall(r"docs/results\.md#([\w.-]+)", source)[0]]
        stated = numbers(" ".join([row["figure"], row.get("interval", ""), row.get("note", "")]))
        assert numbers(figure) - stated == set(), f"{row['id']} says otherwise"


def test_every_place_in_decisions_and_results_that_is_linked_exists() -> None:
    text = {
        name: (ROOT / "docs" / name).read_text("utf-8") for name in ("decisions.md", "results.md")
    }
    places = {
        "decisions.md": {
            slug(title) for title in re.findall(r"^#+ (.+)$", text["decisions.md"], re.M)
        },
        "results.md": {slug(title) for title in re.findall(r"^#+ (.+)$", text["results.md"], re.M)}
        | ROWS.keys(),
    }
    missing = []
    for name in git("ls-files", "*.md", "*.py", "*.yaml", "*.toml", "*.json").stdout.split():
        file = ROOT / name
        linked = (
            re.findall(r"\b(decisions|results)\.md#([\w.-]+\w)", file.read_text("utf-8"))
            if file.is_file()
            else ()
        )
        missing += [
            f"{name}: {page}.md#{at}" for page, at in linked if at not in places[f"{page}.md"]
        ]
    assert missing == []


def slug(title: str) -> str:
    """Return the anchor that a heading gets in the repository and on the site."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
