"""Services for editors: completion fits the place, names are found and renamed; over a real protocol, too."""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from lsprotocol import types as lsp
from pygls.lsp.client import LanguageClient

from pomona.executive.files import find_cell
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Spot
from pomona.tools.editor import service as service_module
from pomona.tools.editor.renaming import RenameRefused
from pomona.tools.editor.service import TreeService
from tests.executive.loops import in_loop

TREE = """\
pomona: 1
tree: t
parameters:
  fruit: {type: text, default: apple}
root:
  sequence:
    - MoveTo: {pose: home}
      retry: 3
    - look: {kind: "{fruit}", found: "{seen}"}
    - fallback:
        - Refine: {detection: "{seen}", measured: "{m}"}
        - fail: {code: X}
          when: "failure.code == NO_DEPTH"
    - check: "{m.dimensions[0]} > 3 cm"
subtrees:
  look:
    in: {kind: text}
    out: {found: detection}
    root:
      Detect: {fruit: "{kind}", detection: "{found}"}
"""


@pytest.fixture(scope="module")
def skills() -> Registry:
    return Registry.installed()


@pytest.fixture
def service(skills: Registry, tmp_path: Path) -> TreeService:
    found = TreeService(tmp_path / "t.yaml", skills)
    assert [finding for finding in found.update(TREE) if finding.severity == "error"] == []
    return found


def cursor(text: str) -> tuple[str, int, int]:
    """A text without its `|`, and where that stood."""
    row = next(number for number, line in enumerate(text.split("\n")) if "|" in line)
    column = text.split("\n")[row].index("|")
    return text.replace("|", ""), row, column


def offered(service: TreeService, old: str, new: str) -> list[str]:
    """Return the offers at the `|` after this replacement."""
    text, row, column = cursor(TREE.replace(old, new, 1))
    service.update(text)
    return [offer.word for offer in service.complete(row, column)]


class TestCompletion:
    def test_beside_a_node_stand_modifiers_and_its_own_words_only(self, service):
        words = offered(service, "      retry: 3\n", "      retry: 3\n      |\n")
        assert {"timeout", "guard", "name", "retry_if"} <= set(words)
        assert not {"retry", "MoveTo", "Detect", "sequence", "look", "then", "success_on"} & set(
            words
        )

    def test_a_node_begins_with_a_type(self, service):
        words = offered(service, "    - check", "    - |\n    - check")
        assert {"Detect", "sequence", "look", "wait"} <= set(words)
        assert not {"timeout", "name", "retry", "pose"} & set(words)

    def test_ports_that_are_not_wired_yet(self, service):
        words = offered(service, "{pose: home}", "{pose: home, |}")
        assert "variation" in words
        assert not {"pose", "Detect", "retry"} & set(words)
        assert offered(service, '{kind: "{fruit}", found: "{seen}"}', '{kind: "{fruit}", |}') == [
            "found"
        ]

    def test_names_in_braces_and_the_fields_of_their_types(self, service):
        words = offered(service, '"{m.dimensions[0]} > 3 cm"', '"{|"')
        assert {"seen", "m", "fruit"} <= set(words)
        assert "kind" not in words
        assert "inlier_ratio" in offered(service, '"{m.dimensions[0]} > 3 cm"', '"{m.|}"')
        inside = offered(service, 'fruit: "{kind}"', 'fruit: "{|"')
        assert {"kind", "found", "fruit"} <= set(inside)
        assert "seen" not in inside

    def test_codes_after_failure_code(self, service):
        assert "NO_DEPTH" in offered(service, "== NO_DEPTH", "== |")

    def test_values_choices_types_and_top_words(self, service):
        assert "true" in offered(service, "      retry: 3\n", "      run_once: |\n")
        assert "nearest" in offered(service, 'fruit: "{kind}",', 'target: |, fruit: "{kind}",')
        assert "length" in offered(service, "{type: text, default", "{type: |, default")
        assert offered(service, "parameters:\n", "|\nparameters:\n") == [
            "description",
            "cell",
            "success",
            "skills",
            "constants",
            "in",
            "out",
        ]

    def test_poses_and_fruit_of_the_cell(self, tmp_path):
        found = TreeService(tmp_path / "t.yaml", Registry.installed())
        found.use_cell(find_cell("sim"))
        found.update(TREE)
        assert {"home", "observe"} <= set(offered(found, "{pose: home}", "{pose: |}"))
        assert "apple" in offered(found, 'fruit: "{kind}"', "fruit: |")
        found.update(TREE)
        assert found.definition_of(6, TREE.split("\n")[6].index("home")).source.path.endswith(
            "shared/workspace.yaml"
        )
        told = found.update(TREE.replace("pose: home", "pose: hoem"))
        assert ["the cell 'sim' has no pose 'hoem'" in finding.message for finding in told].count(
            True
        ) == 1


class TestHover:
    @pytest.mark.parametrize(
        ("at", "said"),
        [("Mo|veTo", "Move to a named pose"), ("po|se: home", "MoveTo.pose"), ("ret|ry: 3", "limits the number"),
         ("{se|en}", "a detection"), ("m.dimen|sions", "an array"), ("lo|ok: {kind", "a subtree")],
    )  # fmt: skip
    def test_hover_shows_the_word_below_the_cursor(self, service, at, said):
        _, row, column = cursor(TREE.replace(at.replace("|", ""), at, 1))
        assert said in service.hover(row, column)


class TestNames:
    def at(self, service: TreeService, at: str) -> tuple[int, int]:
        _, row, column = cursor(TREE.replace(at.replace("|", ""), at, 1))
        return row, column

    @pytest.mark.parametrize(
        ("at", "line"),
        [('detection: "{se|en}"', 9), ('"{fru|it}"', 4), ("lo|ok: {kind", 16), ('"{ki|nd}"', 17)],
    )
    def test_go_to_where_it_is_given(self, service, at, line):
        assert service.definition_of(*self.at(service, at)).line == line

    @pytest.mark.parametrize(
        ("at", "new", "changed"),
        [
            ("{se|en}", "sight", TREE.replace("{seen}", "{sight}")),
            (
                "{fru|it}",
                "kinds",
                TREE.replace("fruit: {type", "kinds: {type").replace('"{fruit}"', '"{kinds}"'),
            ),
            (
                "{ki|nd}",
                "sort",
                TREE.replace('{kind: "{fruit}"', '{sort: "{fruit}"')
                .replace("in: {kind", "in: {sort")
                .replace('"{kind}"', '"{sort}"'),
            ),
            ("lo|ok: {kind", "search", TREE.replace("look:", "search:")),
        ],
    )
    def test_rename(self, service, at, new, changed):
        assert applied(TREE, service.rename(*self.at(service, at), new), new) == changed

    @pytest.mark.parametrize(
        ("at", "new"),
        [("{se|en}", "m"), ("{se|en}", "Not a name"), ("{se|en}", "failure"), ("Mo|veTo", "x")],
    )
    def test_names_that_cannot_be(self, service, at, new):
        with pytest.raises(RenameRefused):
            service.rename(*self.at(service, at), new)


def applied(text: str, spots: list[Spot], new: str) -> str:
    lines = text.split("\n")
    for spot in sorted(spots, key=lambda spot: (spot.line, spot.column), reverse=True):
        line = lines[spot.line - 1]
        lines[spot.line - 1] = line[: spot.column - 1] + new + line[spot.column - 1 + spot.length :]
    return "\n".join(lines)


def test_whatever_is_typed_is_answered(service):
    for end in range(0, len(TREE), 7):
        text = TREE[:end]
        service.update(text)
        row, column = text.count("\n"), len(text.rpartition("\n")[2])
        service.complete(row, column)
        service.hover(row, column)
        service.definition_of(row, column)


class TestALongFile:
    NODE = '    - Detect: {fruit: apple, detection: "{seen}"}\n      retry: 2\n'
    TEXT = (
        "pomona: 1\ntree: t\nroot:\n  sequence:\n"
        + NODE * 299
        + '    - check: "{seen.score} > 0.5"\n'
    )

    @pytest.fixture
    def opened(self, skills, tmp_path):
        found = TreeService(tmp_path / "t.yaml", skills)
        assert found.update(self.TEXT) == []
        return found

    def test_questions_are_answered_from_known_values(self, opened, monkeypatch):
        monkeypatch.setattr(service_module, "read", None)
        monkeypatch.setattr(service_module, "analyse", None)
        lines = self.TEXT.split("\n")
        at = lines[-2].index("seen.")
        assert "score" in [offer.word for offer in opened.complete(len(lines) - 2, at + 5)]
        assert "a detection" in opened.hover(len(lines) - 2, at)


class Editor(LanguageClient):
    """A client that keeps its messages."""

    def __init__(self) -> None:
        super().__init__("test", "1")
        self.told: dict[str, Any] = {}
        self.changed = asyncio.Event()

        @self.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def _(params: lsp.PublishDiagnosticsParams) -> None:
            self.told[params.uri] = params.diagnostics
            self.changed.set()

    async def findings(self, uri: str) -> list[Any]:
        await asyncio.wait_for(self.changed.wait(), 100.0)
        self.changed.clear()
        found: list[Any] = self.told[uri]
        return found

    async def until(self, uri: str, *codes: str) -> None:
        """Wait until a file has findings with these codes."""
        while sorted(found.code for found in self.told.get(uri, [])) != list(codes):
            await asyncio.wait_for(self.changed.wait(), 100.0)
            self.changed.clear()

    def change(self, uri: str, version: int, text: str) -> None:
        """Type a whole text."""
        whole = lsp.TextDocumentContentChangeWholeDocument(text)
        self.text_document_did_change(
            lsp.DidChangeTextDocumentParams(
                lsp.VersionedTextDocumentIdentifier(version, uri), [whole]
            )
        )


CALLED = """\
pomona: 1
tree: look
in: {kind: text}
out: {found: detection}
root:
  Detect: {fruit: "{kind}", detection: "{found}"}
"""
CALLER = TREE[: TREE.index("  look:\n")] + "  look: {file: look.yaml}\n"


def test_a_real_editor_speaks_with_the_command(tmp_path):
    path = tmp_path / "t.yaml"
    uri = path.as_uri()

    async def session() -> None:
        editor = Editor()
        await editor.start_io(
            sys.executable, "-c", "from pomona.executive.cli import main; main(['lsp'])"
        )
        await editor.initialize_async(
            lsp.InitializeParams(capabilities=lsp.ClientCapabilities(), process_id=None)
        )
        broken = TREE.replace("MoveTo", "MoveTwo")
        editor.text_document_did_open(
            lsp.DidOpenTextDocumentParams(lsp.TextDocumentItem(uri, "pomona", 1, broken)),
        )
        (wrong,) = await editor.findings(uri)
        assert (wrong.code, wrong.range.start.line, wrong.range.start.character) == (
            "unknown-skill",
            6,
            6,
        )
        assert "did you mean 'MoveTo'?" in wrong.message
        editor.change(uri, 2, TREE)
        assert list(await editor.findings(uri)) == []
        document = lsp.TextDocumentIdentifier(uri)
        at = lsp.Position(7, 6)
        items = await editor.text_document_completion_async(lsp.CompletionParams(document, at))
        assert {"timeout", "name"} <= {item.label for item in items}
        edit = await editor.text_document_rename_async(
            lsp.RenameParams(
                document, lsp.Position(10, TREE.split("\n")[10].index("seen")), "sight"
            )
        )
        assert len(edit.changes[uri]) == 2
        called, elsewhere = tmp_path / "look.yaml", (tmp_path / "look.yaml").as_uri()
        called.write_text(CALLED)
        editor.change(uri, 3, CALLER)
        await editor.until(uri)
        line = CALLER.split("\n")[8]
        found = await editor.text_document_definition_async(
            lsp.DefinitionParams(document, lsp.Position(8, line.index("kind")))
        )
        assert (found.uri, found.range.start) == (elsewhere, lsp.Position(2, 5))
        unsaved = CALLED.replace("kind", "sort")
        editor.text_document_did_open(
            lsp.DidOpenTextDocumentParams(lsp.TextDocumentItem(elsewhere, "yaml", 1, unsaved))
        )
        await editor.until(uri, "missing-port", "unknown-port")
        editor.change(elsewhere, 2, "pomona: 1\nroot: [")
        await editor.until(uri, "file")
        items = await editor.text_document_completion_async(lsp.CompletionParams(document, at))
        assert {"timeout", "name"} <= {item.label for item in items}
        editor.change(elsewhere, 3, CALLED)
        await editor.until(uri)
        for asked, position in (
            (uri, lsp.Position(8, line.index("kind"))),
            (elsewhere, lsp.Position(2, 5)),
        ):
            edit = await editor.text_document_rename_async(
                lsp.RenameParams(lsp.TextDocumentIdentifier(asked), position, "sort")
            )
            assert {place: len(changes) for place, changes in edit.changes.items()} == {
                uri: 1,
                elsewhere: 2,
            }
        hover = await editor.text_document_hover_async(
            lsp.HoverParams(document, lsp.Position(6, 8))
        )
        assert "Move to a named pose" in hover.contents.value
        editor.change(uri, 4, TREE.replace("retry: 3", "retries: 3"))
        await editor.until(uri, "unknown-key")
        (action,) = await editor.text_document_code_action_async(
            lsp.CodeActionParams(document, lsp.Range(at, at), lsp.CodeActionContext([]))
        )
        assert action.title == "no modifier named 'retries'; did you mean 'retry'?"
        (change,) = action.edit.changes[uri]
        assert (change.range.start, change.range.end, change.new_text) == (
            at,
            lsp.Position(7, 13),
            "retry",
        )
        editor.change(uri, 5, TREE)
        await editor.until(uri)
        places = await editor.text_document_references_async(
            lsp.ReferenceParams(
                lsp.ReferenceContext(include_declaration=True),
                document,
                lsp.Position(10, TREE.split("\n")[10].index("seen")),
            )
        )
        assert [place.range.start.line for place in places] == [8, 10]
        outline = await editor.text_document_document_symbol_async(
            lsp.DocumentSymbolParams(document)
        )
        assert [tree.name for tree in outline] == ["t", "look"]
        assert [node.name for node in outline[0].children] == [
            "MoveTo",
            "look",
            "fallback",
            "check",
        ]
        await editor.shutdown_async(None)
        editor.exit(None)
        await editor.stop()

    in_loop(session())


@pytest.mark.parametrize(
    ("text", "tree"),
    [("pomona: 1\ntree: t\n", True), ("pomona: 1\ntree: t.yaml\ncases: []\n", False), ("services: {}\n", False),
     ((Path(__file__).parents[4] / "trees" / "cells" / "sim.yaml").read_text(), False)],
)  # fmt: skip
def test_only_trees_are_looked_at(service, text, tree):
    assert bool(service.update(text + "nonsense: 1\n")) is tree


def test_the_extension_starts_the_language_server():
    folder = Path(__file__).parents[4] / "scripts" / "vscode"
    told = json.loads((folder / "package.json").read_text())
    source = (folder / told["main"]).read_text()
    assert 'args: ["lsp"]' in source
    settings = {
        name.removeprefix("pomona.") for name in told["contributes"]["configuration"]["properties"]
    }
    assert settings == set(re.findall(r'settings\.get\("(\w+)"', source))
    node = shutil.which("node")
    assert (
        node is None
        or subprocess.run([node, "--check", folder / told["main"]], check=False).returncode == 0
    )
