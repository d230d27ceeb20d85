"""The Language Server Protocol around `service`: one process for an editor, over standard input and output."""

from __future__ import annotations

import gc
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from lsprotocol import types as lsp
from pygls.lsp.server import LanguageServer
from pygls.uris import from_fs_path, to_fs_path

from pomona.executive.errors import PomonaError
from pomona.executive.files import find_cell
from pomona.executive.nodes.node_type import TreeNode
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Finding, Located, said
from pomona.executive.values.installation import installed_version
from pomona.tools.editor.format import FormatError, formatted
from pomona.tools.editor.renaming import RenameRefused
from pomona.tools.editor.service import Offer, TreeService

KINDS = {
    "skill": lsp.CompletionItemKind.Function,
    "subtree": lsp.CompletionItemKind.Module,
    "modifier": lsp.CompletionItemKind.Property,
    "input": lsp.CompletionItemKind.Field,
    "output": lsp.CompletionItemKind.Variable,
    "name": lsp.CompletionItemKind.Variable,
    "field": lsp.CompletionItemKind.Field,
    "value": lsp.CompletionItemKind.Value,
    "code": lsp.CompletionItemKind.EnumMember,
    "type": lsp.CompletionItemKind.TypeParameter,
}


class TreeServer(LanguageServer):
    """Knows the open files and the installed skills."""

    def __init__(self, cell: Path | None = None) -> None:
        super().__init__(
            "pomona", installed_version(), text_document_sync_kind=lsp.TextDocumentSyncKind.Full
        )
        self.skills = Registry.installed()
        gc.collect()
        gc.freeze()  # a keystroke must not wait for a scan of the imported modules
        self.cell = cell
        self.open: dict[str, TreeService] = {}
        self.elsewhere: set[str] = (
            set()
        )  # files that are not open, with findings that were published

    def service(self, uri: str) -> TreeService:
        """Return the service of a file."""
        if uri not in self.open:
            self.open[uri] = TreeService(
                Path(to_fs_path(uri) or uri), self.skills, others=self.texts
            )
            self.open[uri].use_cell(self.cell)
        return self.open[uri]

    def texts(self) -> dict[str, str]:
        """Return the contents of the editor, saved or not, by path."""
        return {str(service.path): service.text for service in self.open.values()}

    def judge(self, uri: str, text: str) -> None:
        """Take a text, and publish the findings of it and of the open trees that call it."""
        changed = self.service(uri)
        with _undisturbed():
            self.publish(uri, changed.update(text))
            for other, service in list(self.open.items()):
                if service is not changed and service.calls(changed.path):
                    self.publish(other, service.update(service.text))
        self.publish_elsewhere()

    def publish_elsewhere(self) -> None:
        """Publish the findings of files that are not open and that open trees call."""
        found: dict[str, dict[Finding, None]] = {uri: {} for uri in self.elsewhere}
        opened = set(self.texts())
        for finding in (each for service in self.open.values() for each in service.elsewhere):
            if finding.path not in opened:
                uri = from_fs_path(str(Path(finding.path).resolve())) or finding.path
                found.setdefault(uri, {})[finding] = None
        for uri, findings in found.items():
            if uri not in self.open:
                self.publish(uri, findings)
        self.elsewhere = {uri for uri, findings in found.items() if findings}

    def publish(self, uri: str, found: Iterable[Finding]) -> None:
        """Publish the findings of a file."""
        diagnostics = [_diagnostic(finding) for finding in found]
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, diagnostics))


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Leave garbage alone meanwhile: a text's analysis makes none, and looking for it takes half as long again."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def serve(cell: Path | None = None) -> TreeServer:
    """Create a server that is ready to start.

    Args:
        cell: the cell file with the names to offer; an editor may name another one.
    """
    server = TreeServer(cell)

    @server.feature(lsp.INITIALIZE)
    def _(params: lsp.InitializeParams) -> None:
        wanted = params.initialization_options
        name = wanted.get("cell") if isinstance(wanted, dict) else getattr(wanted, "cell", None)
        if isinstance(name, str) and name:
            try:
                server.cell = find_cell(name)
            except PomonaError as error:
                server.window_show_message(
                    lsp.ShowMessageParams(lsp.MessageType.Warning, str(error))
                )

    @server.feature(lsp.TEXT_DOCUMENT_DID_OPEN)
    def _(params: lsp.DidOpenTextDocumentParams) -> None:
        server.judge(params.text_document.uri, params.text_document.text)

    @server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
    def _(params: lsp.DidChangeTextDocumentParams) -> None:
        uri = params.text_document.uri
        server.judge(uri, server.workspace.get_text_document(uri).source)

    @server.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
    def _(params: lsp.DidCloseTextDocumentParams) -> None:
        server.open.pop(params.text_document.uri, None)
        server.publish(params.text_document.uri, ())
        server.publish_elsewhere()

    @server.feature(
        lsp.TEXT_DOCUMENT_COMPLETION,
        lsp.CompletionOptions(trigger_characters=["{", ".", " ", "-", ":"]),
    )
    def _(params: lsp.CompletionParams) -> list[lsp.CompletionItem]:
        at = params.position
        service = server.service(params.text_document.uri)
        return [_item(offer) for offer in service.complete(at.line, _column(service, at))]

    @server.feature(lsp.TEXT_DOCUMENT_HOVER)
    def _(params: lsp.HoverParams) -> lsp.Hover | None:
        service = server.service(params.text_document.uri)
        said = service.hover(params.position.line, _column(service, params.position))
        return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, said)) if said else None

    @server.feature(lsp.TEXT_DOCUMENT_DEFINITION)
    def _(params: lsp.DefinitionParams) -> lsp.Location | None:
        service = server.service(params.text_document.uri)
        where = service.definition_of(params.position.line, _column(service, params.position))
        return (
            None
            if where is None
            else lsp.Location(_uri(where, params.text_document.uri, service), _range(where))
        )

    @server.feature(lsp.TEXT_DOCUMENT_RENAME)
    def _(params: lsp.RenameParams) -> lsp.WorkspaceEdit | None:
        service = server.service(params.text_document.uri)
        uri = params.text_document.uri
        try:
            spots = service.rename(
                params.position.line, _column(service, params.position), params.new_name
            )
        except RenameRefused as refused:
            server.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Warning, str(refused)))
            return None
        changes: dict[str, list[lsp.TextEdit]] = {}
        for spot in spots:
            changes.setdefault(_uri(spot, uri, service), []).append(
                lsp.TextEdit(_range(spot), params.new_name)
            )
        return lsp.WorkspaceEdit(changes=changes)

    @server.feature(lsp.TEXT_DOCUMENT_REFERENCES)
    def _(params: lsp.ReferenceParams) -> list[lsp.Location]:
        service = server.service(params.text_document.uri)
        uri = params.text_document.uri
        try:
            _, spots = service.spots(params.position.line, _column(service, params.position))
        except RenameRefused:
            return []
        return [lsp.Location(_uri(spot, uri, service), _range(spot)) for spot in spots]

    @server.feature(
        lsp.TEXT_DOCUMENT_CODE_ACTION,
        lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix]),
    )
    def _(params: lsp.CodeActionParams) -> list[lsp.CodeAction]:
        uri = params.text_document.uri
        rows = params.range
        service = server.service(uri)
        return [
            _mending(finding, uri, service.text)
            for finding in service.mending(rows.start.line, rows.end.line)
        ]

    @server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def _(params: lsp.DocumentSymbolParams) -> list[lsp.DocumentSymbol]:
        outline = server.service(params.text_document.uri).outline()
        return [
            _symbol(definition.root, definition.name)
            for definition in outline
            if definition.root is not None
        ]

    @server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
    def _(params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit]:
        text = server.workspace.get_text_document(params.text_document.uri).source
        try:
            found = formatted(text)
        except FormatError:
            return []
        end = lsp.Position(len(text.split("\n")), 0)
        return [] if found == text else [lsp.TextEdit(lsp.Range(lsp.Position(0, 0), end), found)]

    return server


def _column(service: TreeService, at: lsp.Position) -> int:
    """Return the character of a position, whose unit is UTF-16."""
    lines = service.lines
    line = lines[at.line] if at.line < len(lines) else ""
    return len(line.encode("utf-16-le")[: 2 * at.character].decode("utf-16-le", errors="ignore"))


def _units(line: str, column: int) -> int:
    return len(line[:column].encode("utf-16-le")) // 2


def _span(text: str, line: int, column: int, length: int) -> lsp.Range:
    """Return the range of characters of a line, given its text; line and column count from 1."""
    start, end = (_units(text, at) for at in (column - 1, column - 1 + length))
    row = max(line - 1, 0)
    return lsp.Range(lsp.Position(row, start), lsp.Position(row, end))


def _range(where: Located) -> lsp.Range:
    return _span(where.source.excerpt(where.line), where.line, where.column, where.length)


def _uri(where: Located, asked: str, service: TreeService) -> str:
    path = where.source.path
    return asked if path == str(service.path) else from_fs_path(str(Path(path).resolve())) or asked


def _diagnostic(finding: Finding) -> lsp.Diagnostic:
    where = _span(finding.excerpt, finding.line, finding.column, finding.length)
    severity = lsp.DiagnosticSeverity(("error", "warning", "note").index(finding.severity) + 1)
    message = f"{finding.message}\n{finding.hint}" if finding.hint else finding.message
    return lsp.Diagnostic(where, message, severity, finding.code, source="pomona")


def _mending(finding: Finding, uri: str, text: str) -> lsp.CodeAction:
    """Return the quick fix that applies a finding's edits."""
    lines = text.split("\n")
    edits = [
        lsp.TextEdit(_span(lines[line - 1], line, column, length), new)
        for line, column, length, new in finding.edits
    ]
    return lsp.CodeAction(
        said(finding),
        lsp.CodeActionKind.QuickFix,
        [_diagnostic(finding)],
        edit=lsp.WorkspaceEdit({uri: edits}),
    )


def _symbol(node: TreeNode, name: str) -> lsp.DocumentSymbol:
    """Return a node with all below, for an editor's outline."""
    at = node.at
    key = node.key
    whole = lsp.Range(lsp.Position(at.line - 1, 0), lsp.Position(at.end_line - 1, at.end_column))
    children = [_symbol(below, below.label) for below in node.below()]
    kind = lsp.SymbolKind.Function if node.type.calls else lsp.SymbolKind.Object
    detail = " ".join(node.decorators)
    return lsp.DocumentSymbol(name, kind, whole, _range(key), detail, children=children)


def _item(offer: Offer) -> lsp.CompletionItem:
    kind = KINDS.get(offer.kind, lsp.CompletionItemKind.Keyword)
    return lsp.CompletionItem(
        offer.word, kind=kind, detail=offer.about, insert_text=offer.written or offer.word
    )
