"""The page, the terminal and the language server report the same findings of a tree."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from lsprotocol import types as lsp
from pygls.uris import from_fs_path, to_fs_path

from pomona.executive.cli import main as pomona
from pomona.executive.registry import Registry
from pomona.tools.editor.server import TreeServer
from pomona.tools.tree_editor.server import default_cell
from pomona.tools.tree_editor.workbench import Workbench

HEAD = "pomona: 1\ntree: t\nroot:\n"
BAD = {
    "no skill of this name": HEAD + "  Deetct: {fruit: apple}\n",
    "a port without a value": HEAD + "  MoveTo: {}\n",
    "a port that is none": HEAD + "  MoveTo: {pose: home, sped: 1}\n",
    "a wrong unit": HEAD + "  wait: 3 mm\n",
    "a wire without a source": HEAD + '  check: "{found.score} > 0.5"\n',
    "a wire of another type": HEAD
    + '  sequence:\n    - Detect: {fruit: apple, detection: "{found}"}\n    - MoveTo: {pose: "{found}"}\n',
    "two types in one node": HEAD + "  wait: 1 s\n  succeed: {}\n",
    "a word without its owner": HEAD + '  wait: 1 s\n  retry_if: "failure.code == NO_PATH"\n',
    "a value out of its range": HEAD + "  MoveTo: {pose: home, budget: -1 s}\n",
    "a pose that the cell lacks": HEAD + "  MoveTo: {pose: nowhere}\n",
    "a failure code that is none": HEAD
    + '  wait: 1 s\n  retry: 2\n  retry_if: "failure.code == NO_SUCH"\n',
    "no YAML": HEAD + "  sequence:\n    - wait: [1 s\n",
    "a tab": HEAD + "\twait: 1 s\n",
    "a key twice": HEAD + "  wait: 1 s\n  wait: 2 s\n",
    "a list in place of a node": HEAD + "  - wait: 1 s\n",
    "no root": "pomona: 1\ntree: t\n",
    "a later version": "pomona: 99\ntree: t\nroot:\n  wait: 1 s\n",
    "a subtree that nothing calls, with a fault": HEAD
    + "  wait: 1 s\nsubtrees:\n  s:\n    root: {Beeep: {}}\n",
    "characters outside the first plane": HEAD + "  sequence:\n    - {name: 🍎🍎 é, Beeep: {}}\n",
    "lines that end as in Windows": (
        HEAD + "  sequence:\n    - wait: 3 mm\n    - Beeep: {}\n"
    ).replace("\n", "\r\n"),
}
NO_TREES = {"another program's": "hello: world\n", "a list": "- 1\n- 2\n", "an empty file": ""}


@pytest.fixture(scope="module")
def installed() -> Registry:
    return Registry.installed()


Found = tuple[
    str, int, str, str, str, str
]  # file, line, characters that are meant, severity, code, message and hint


def meant(path: Path, line: int, start: int, end: int, bits: int = 32) -> str:
    """Return the characters of a place in a file; columns from 0 in units of so many bits."""
    lines = path.read_text("utf-8").split("\n")
    units = (lines[line - 1] if 0 < line <= len(lines) else "").encode(f"utf-{bits}-le")
    return units[start * bits // 8 : end * bits // 8].decode(f"utf-{bits}-le")


def in_the_terminal(path: Path, capsys: Any) -> list[Found]:
    pomona(["check", str(path), "--json", "--cell", str(default_cell())])
    found = []
    for f in json.loads(capsys.readouterr().out):
        file, line, start = Path(f["path"]), f["line"], f["column"] - 1
        words = f"{f['message']}\n{f['hint']}".strip()
        chars = meant(file, line, start, start + f["length"])
        found.append((file.name, line, chars, f["severity"], f["code"], words))
    return found


def on_the_page(path: Path, skills: Registry) -> list[Found]:
    found = []
    for f in Workbench(path, skills, default_cell()).state(path.read_text("utf-8"))["findings"]:
        file, line, message = path, f["line"], f["message"]
        if not line:  # of another file: its place stands in the message
            other, at, _, message = message.split(":", 3)
            file, line = Path(other), int(at)
        chars = meant(file, line, f["column"] - 1, f["column"] - 1 + f["length"])
        words = f"{message.strip()}\n{f['hint']}".strip()
        found.append((file.name, line, chars, f["severity"], f["code"], words))
    return found


def in_an_editor(path: Path, skills: Registry) -> list[Found]:
    server, published = TreeServer(default_cell()), list[lsp.PublishDiagnosticsParams]()
    server.skills = skills
    server.text_document_publish_diagnostics = published.append  # type: ignore[method-assign]
    server.judge(str(from_fs_path(str(path))), path.read_bytes().decode())
    found = []
    for params in published:
        file = Path(to_fs_path(params.uri) or "")
        for d in params.diagnostics:
            line, (start, end) = (
                d.range.start.line + 1,
                (d.range.start.character, d.range.end.character),
            )
            severity = ("error", "warning", "note")[int(d.severity or 0) - 1]
            found.append(
                (
                    file.name,
                    line,
                    meant(file, line, start, end, 16),
                    severity,
                    str(d.code),
                    d.message,
                )
            )
    return found


@pytest.mark.parametrize("name", BAD)
def test_a_bad_tree_has_the_same_findings_everywhere(name, tmp_path, capsys, installed):
    path = tmp_path / "t.yaml"
    path.write_bytes(BAD[name].encode())
    terminal = in_the_terminal(path, capsys)
    assert terminal
    assert on_the_page(path, installed) == terminal
    assert in_an_editor(path, installed) == terminal


@pytest.mark.parametrize("name", NO_TREES)
def test_a_file_that_is_no_tree_is_left_alone_by_an_editor_alone(name, tmp_path, capsys, installed):
    path = tmp_path / "t.yaml"
    path.write_text(NO_TREES[name])
    terminal = in_the_terminal(path, capsys)
    assert terminal
    assert on_the_page(path, installed) == terminal
    assert (
        in_an_editor(path, installed) == []
    )  # an editor opens YAML files of other programs as well


def test_a_fault_of_a_called_file_is_found_everywhere_until_it_is_mended(
    tmp_path, capsys, installed
):
    path, called = tmp_path / "t.yaml", tmp_path / "look.yaml"
    path.write_text(HEAD + "  look: {}\nsubtrees:\n  look: {file: look.yaml}\n")
    called.write_text("pomona: 1\ntree: look\nroot:\n  Beeep: {}\n")
    terminal = in_the_terminal(path, capsys)
    assert terminal[0][:2] == ("look.yaml", 4)
    assert [kind for _, _, _, kind, *_ in terminal] == ["error", "note"]
    assert on_the_page(path, installed) == terminal
    assert in_an_editor(path, installed) == terminal


def test_an_editor_takes_back_the_findings_of_a_called_file(tmp_path, installed):
    path, called = tmp_path / "t.yaml", tmp_path / "look.yaml"
    called.write_text("pomona: 1\ntree: look\nroot:\n  Beeep: {}\n")
    server, published = TreeServer(), dict[str, int]()
    server.skills = installed
    server.text_document_publish_diagnostics = lambda params: published.update(
        {params.uri: len(params.diagnostics)}
    )  # type: ignore[method-assign]
    uri, other = str(from_fs_path(str(path))), str(from_fs_path(str(called)))
    text = HEAD + "  look: {}\nsubtrees:\n  look: {file: look.yaml}\n"
    server.judge(uri, text)
    assert published == {uri: 0, other: 1}
    called.write_text("pomona: 1\ntree: look\nroot:\n  wait: 1 s\n")
    server.judge(uri, text)
    assert published == {uri: 0, other: 0}
