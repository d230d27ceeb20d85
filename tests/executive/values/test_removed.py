"""The table of removed words is true: the old ones are gone, the new ones are there, and docs/stability.md lists them."""

from __future__ import annotations

import argparse
import json
import re
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from pomona.executive.cell.services import Score
from pomona.executive.cli import main
from pomona.executive.commands.command_line import children, command_names, make_parser
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.registry import Registry
from pomona.executive.values.installation import entry_points, installed_trees
from pomona.executive.values.removed import (
    Removal,
    import_problem,
    removal,
    removals,
    removed,
)
from pomona.executive.values.sections import declared

ROOT = Path(__file__).resolve().parents[3]
PARTS = ("executive", "skills", "drivers")
MOST = 50  # rows on one screen of a desk
BEFORE = json.loads(Path(__file__).with_name("words_before_0_2.json").read_text("utf-8"))
WORDS = [(row, word) for row in removals() for word in row.old]


def words_of(parser: argparse.ArgumentParser) -> set[str]:
    found = {word for action in parser._actions for word in action.option_strings}
    for action in parser._actions:
        found.update(() if action.option_strings else map(str, action.choices or ()))
    return found.union(*(words_of(child) for _, _, child in children(parser)))


def is_there(kind: str, word: str) -> bool:
    if kind in ("skill", "driver"):
        return bool(entry_points(group=f"pomona.{kind}s", name=word))
    if kind == "port":
        skill, port = word.split(".")
        found = Registry({}).choosing({}, (skill,))[skill]
        former = {declared.was for declared in found.inputs.values()}
        return port in {*found.inputs, *found.outputs, *former}
    if kind == "node":
        return word in NodeTypes.installed() or word in NodeTypes.installed().fields
    if kind in ("tree", "cell"):
        folders = ("cells",) if kind == "cell" else ("", "experimental")
        return any((installed_trees() / folder / f"{word}.yaml").is_file() for folder in folders)
    if kind == "module":
        try:
            return find_spec(word) is not None
        except ModuleNotFoundError:  # of its package
            return False
    if kind == "command":
        command, _, word = word.partition(" ")
        if command not in command_names() or not word:
            return command in command_names()
        parser = next(p for name, _, p in children(make_parser([command])) if name == command)
        return word in words_of(parser)
    if kind == "setting":
        section, name = word.split(".")
        return name in {entry.name for entry in declared({"score": Score}[section])}
    if kind == "group":
        sources = [path for part in PARTS for path in (ROOT / part / "pomona").rglob("*.py")]
        return any(f'"{word}"' in path.read_text("utf-8") for path in sources)
    assert kind == "extra"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    return word in project["optional-dependencies"]


@pytest.mark.parametrize(("row", "word"), WORDS, ids=lambda it: it if isinstance(it, str) else "")
def test_an_old_word_is_gone_and_its_new_ones_are_there(
    row: Removal, word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not is_there(row.kind, word)
    if row.kind == "command":
        with pytest.raises(SystemExit) as ended:
            main([*word.split(), "nothing"])
        assert ended.value.code == 2
        assert removed("command", word) in " ".join(capsys.readouterr().err.split())
    for new in row.instead_of(word):
        assert is_there(row.kind, new)
        found = NodeTypes.installed().get(new) if row.kind == "node" else None
        # beside a node that has it already, a new modifier would be there twice
        assert found is None or found.role != "modifier"


@pytest.mark.parametrize("kind", BEFORE)
def test_a_word_of_0_1_is_there_or_in_the_table(kind: str) -> None:
    words = BEFORE[kind]
    if kind == "port":
        words = [word for word in words if removal("skill", word.split(".")[0]) is None]
    lacking = [word for word in words if not (removal(kind, word) or is_there(kind, word))]
    assert lacking == [], "a row of removed.toml tells its users what to do instead"


def test_a_word_stands_in_one_row() -> None:
    words = [(row.kind, word) for row, word in WORDS]
    assert len(words) == len(set(words))


def test_a_reason_is_the_end_of_a_sentence() -> None:
    for row in removals():
        assert not row.why.endswith("."), row
        assert len(row.why.split()) <= 15, row


def test_the_page_of_breaks_is_the_table_and_fits_one_screen() -> None:
    page = (ROOT / "docs" / "stability.md").read_text("utf-8")
    rows = [
        f"| {row.kind} | {', '.join(f'`{word}`' for word in row.old)} | "
        f"{' or '.join(f'`{new}`' for new in row.new) or '–'} | {row.why} |"
        for row in removals()
    ]
    assert re.findall(r"^\| (?!what|---).*(?:\|.*){3}\|$", page, re.MULTILINE) == rows, "\n".join(
        rows
    )
    assert len(rows) <= MOST


def test_a_package_that_imports_a_moved_module_is_told_the_new_one() -> None:
    with pytest.raises(ImportError) as caught:
        __import__("pomona.drivers.sim.world")
    assert import_problem(caught.value) == (
        "ModuleNotFoundError: No module named 'pomona.drivers.sim'; the module 'pomona.drivers.sim' "
        "became 'pomona.tools.simulation' in 0.2: a simulated cell is a tool"
    )
    assert import_problem(ValueError("no")) == "ValueError: no"
