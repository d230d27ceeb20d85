"""YAML text → document. Reports every error of the file's shape; needs no skills."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pomona.executive.account import SUCCESSES
from pomona.executive.language.expression import SPECIAL
from pomona.executive.language.literals import type_word
from pomona.executive.language.model import Declared, Definition, Document, TreeFile
from pomona.executive.language.read_node import NodeReader, is_word
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.values.findings import Edit, Finding, Findings, Source, Spot, few_hints
from pomona.executive.values.plain_text import NotUtf8Error, read_plain_text
from pomona.executive.values.removed import report_removed
from pomona.executive.values.yaml_errors import moved
from pomona.executive.values.yaml_nodes import (
    ShapeCheck,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    read_yaml,
)

VERSION = "1"
MAX_FILES = 100
_TOP = (
    "pomona",
    "tree",
    "description",
    "cell",
    "success",
    "skills",
    "parameters",
    "constants",
    "in",
    "out",
    "root",
    "subtrees",
)
_NAME = re.compile(r"[a-z][a-z0-9_]*")


@few_hints()
def read(
    text: str,
    path: str | Path,
    *,
    tree_folders: Sequence[Path] = (),
    texts: Mapping[str, str] | None = None,
    types: NodeTypes | None = None,
) -> Document:
    """Read the document of a tree file's text. Raises nothing: the findings hold the errors.

    Args:
        path: where it stands; files that it calls are found beside it or below, or in `tree_folders`.
        texts: contents of called files, by the path that findings show, that are not to be read from the disk.
        types: the words of the language; all that are installed when it is left out.
    """
    return _Reader(tree_folders, texts or {}, types or NodeTypes.installed()).document(
        text, Path(path)
    )


def read_file(path: str | Path, *, tree_folders: Sequence[Path] = ()) -> Document:
    """Like `read`, for a file. A file that cannot be opened is a finding."""
    findings = Findings()
    text = _load(Path(path), str(path), findings)
    if text is None:
        source = Source(str(path), "")
        return Document(
            str(path), "", TreeFile(source), [], findings.sorted(), NodeTypes.installed()
        )
    return read(text, path, tree_folders=tree_folders)


def _load(path: Path, shown: str, findings: Findings, where: YamlNode | None = None) -> str | None:
    try:
        return read_plain_text(path)
    except NotUtf8Error as error:
        problem = f"no text file ({error})"
    except (OSError, ValueError) as error:
        problem = (getattr(error, "strerror", None) or str(error)).lower()
    message = f"{shown} cannot be read: {problem}"
    if where is None:
        findings.add(Finding(shown, 0, 0, "error", "file", message))
    else:
        findings.error(where, "file", message)
    return None


class _Reader:
    def __init__(
        self,
        tree_folders: Sequence[Path],
        texts: Mapping[str, str],
        types: NodeTypes,
    ) -> None:
        self.findings = Findings()
        self.texts = texts
        self.types = types
        self.folders = [folder.resolve() for folder in tree_folders]
        self.files: dict[Path, TreeFile] = {}

    def document(self, text: str, path: Path) -> Document:
        folder = path.parent.resolve()
        self.folders.insert(0, folder)
        main = self.file(text, str(path), folder / path.name)
        return Document(
            str(path), text, main, list(self.files.values()), self.findings.sorted(), self.types
        )

    def file(self, text: str, shown: str, resolved: Path) -> TreeFile:
        source = Source(shown, text)
        file = self.files[resolved] = TreeFile(source)
        if text.lstrip().startswith("<"):
            hint = f"'pomona import {Path(shown).name}' makes a tree file of it"
            self.findings.error(Spot(source, 1, 1), "xml", "this is XML, not a tree file", hint)
            return file
        root = read_yaml(source, self.findings, modifiers=self.types.beside)
        if root is None:
            return file
        shape = ShapeCheck(self.findings)
        top = shape.mapping(root, "a tree file")
        if top is None:
            return file
        file.top = top
        rootless = self.without_root(top)
        shape.known_keys(top, (*_TOP, *rootless), "a tree file")
        self.version(top)
        written_name = top.get("tree")
        nodes_as_name = isinstance(written_name, (YamlMapping, YamlList))
        name = None if nodes_as_name else shape.text(written_name)
        if nodes_as_name:
            message = (
                "'tree' is the tree's name: write 'tree: my_tree', and its nodes below 'root:'"
            )
            key = top.entries["tree"][0]
            edits = (
                [Edit(key.line, key.column, key.length, "tree: my_tree\nroot")]
                if "root" not in top.entries
                else ()
            )
            self.findings.error(key, "shape", message, edits=edits)
        elif "tree" not in top.entries:
            self.findings.error(
                _start(top), "missing-key", "the tree has no name", "write 'tree: my_tree'"
            )
        elif name is not None and not _NAME.fullmatch(name.text):
            hint = "use lower-case letters, digits and _, such as open_the_door"
            self.findings.error(
                name, "bad-name", f"'{name.text}' is not a valid name for a tree", hint
            )
        file.name = name.text if name is not None else resolved.stem
        described = shape.text(top.get("description"))
        file.description = described.text if described is not None else _header(source, top)
        file.cell = shape.text(top.get("cell"))
        file.success = shape.text(top.get("success"))
        if file.success is not None and file.success.text not in SUCCESSES:
            words = f"'{file.success.text}' is no success that is measured"
            hint = "; ".join(f"{word}: {what}" for word, what in SUCCESSES.items())
            self.findings.error(file.success, "bad-value", words, hint)
        for key, value in shape.entries(top.get("skills"), "skills", "'Skill: package' for each"):
            if isinstance(value, YamlMapping):
                shape.known_keys(value, ("in", "out"), "a declared skill")
                file.declared_skills[key.text] = (
                    self.names(value.get("in")),
                    self.names(value.get("out")),
                )
                continue
            package = shape.text(value)
            if package is not None:
                file.skills[key.text] = package
        file.parameters = self.declarations(shape, top.get("parameters"), "a parameter")
        file.constants = self.constants(shape, top.get("constants"))
        main = file.main = Definition(file.name, top, file, main=True, description=file.description)
        self.interface(shape, top, main)
        self.read_subtrees(shape, top, file, resolved.parent)
        root_node = top.get("root")
        if root_node is None and not nodes_as_name and not rootless:
            self.findings.error(
                _start(top),
                "missing-key",
                "the file has no 'root'",
                "write 'root:' and the first node under it",
            )
        elif root_node is not None:
            main.root = self.nodes(file).node(root_node)
        for subtree in file.subtrees.values():
            if subtree.file is file and isinstance(subtree.at, YamlMapping):
                written = subtree.at.get("root")
                if written is not None:
                    subtree.root = self.nodes(file).node(written)
        return file

    def without_root(self, top: YamlMapping) -> list[str]:
        """Return keys of a node that stands at the top of the file, which is reported; empty if there is none."""
        keys = [key for key, _ in top.entries.values() if key.text not in _TOP]
        types = [
            key
            for key in keys
            if key.text[:1].isupper() or key.text in (*self.types.composites, *self.types.leaves)
        ]
        if "root" in top.entries or len(types) != 1:
            return []
        found = [key for key in keys if key is types[0] or key.text in self.types.beside]
        edits = [edit for key in found for edit in moved(key.source, key.line, 2)]
        first = min(found, key=lambda key: key.line)
        edits = [
            e._replace(text="root:\n  ") if (e.line, e.column) == (first.line, 1) else e
            for e in edits
        ]
        hint = "write 'root:' above it, and the node two columns further right"
        self.findings.error(
            types[0], "missing-key", f"'{types[0].text}' is not below 'root'", hint, edits
        )
        return [key.text for key in found]

    def nodes(self, file: TreeFile) -> NodeReader:
        return NodeReader(self.findings, file, self.types)

    def version(self, top: YamlMapping) -> None:
        version = top.get("pomona")
        if version is None:
            hint = f"begin the file with 'pomona: {VERSION}'"
            self.findings.error(_start(top), "missing-key", "the file has no version", hint)
        elif not isinstance(version, YamlScalar) or version.text != VERSION:
            self.findings.error(
                version,
                "version",
                f"this Pomona reads version {VERSION} of tree files",
                f"write 'pomona: {VERSION}'",
            )

    def declarations(
        self, shape: ShapeCheck, node: YamlNode | None, what: str
    ) -> dict[str, Declared]:
        found: dict[str, Declared] = {}
        for key, value in shape.entries(node, f"{what}s", "'name: {type: …}' for each"):
            if not self.good_name(key, what):
                continue
            if isinstance(value, YamlScalar):
                found[key.text] = Declared(key, type=value)
                continue
            fields = shape.mapping(value, what)
            if fields is None:
                continue
            shape.known_keys(fields, ("type", "default", "min", "max", "choices", "help"), what)
            declared = Declared(key, type=shape.text(fields.get("type")))
            declared.default, declared.min, declared.max = (
                fields.get("default"),
                fields.get("min"),
                fields.get("max"),
            )
            if "type" not in fields.entries:
                hint = f"write '{key.text}: {{type: {type_word(declared.default) or '…'}, …}}'"
                self.findings.error(key, "missing-key", f"{what} needs a type", hint)
            choices = fields.get("choices")
            if isinstance(choices, YamlList):
                declared.choices = [
                    c for item in choices.items if (c := shape.text(item)) is not None
                ]
            elif choices is not None:
                self.findings.error(choices, "shape", "choices are a list: [one, another]")
            help_text = shape.text(fields.get("help"))
            declared.help = (
                help_text.text if help_text is not None else key.source.comments.get(key.line, "")
            )
            found[key.text] = declared
        return found

    def names(self, node: YamlNode | None) -> tuple[str, ...]:
        items = node.items if isinstance(node, YamlList) else []
        if node is not None and not (items and all(isinstance(item, YamlScalar) for item in items)):
            self.findings.error(
                node,
                "shape",
                "the ports of a declared skill are a list of names",
                "write in: [goal]",
            )
        return tuple(item.text for item in items if isinstance(item, YamlScalar))

    def constants(self, shape: ShapeCheck, node: YamlNode | None) -> dict[str, Declared]:
        entries = shape.entries(node, "constants", "'name: value' for each")
        return {
            key.text: Declared(key, default=value)
            for key, value in entries
            if self.good_name(key, "a constant")
        }

    def good_name(self, key: YamlScalar, what: str) -> bool:
        if key.text in SPECIAL or key.text in ("true", "false", "none", "and", "or", "not", "in"):
            self.findings.error(
                key, "bad-name", f"'{key.text}' means something else in expressions"
            )
            return False
        if not _NAME.fullmatch(key.text):
            hint = "use lower-case letters, digits and _"
            self.findings.error(
                key, "bad-name", f"'{key.text}' is not a valid name for {what}", hint
            )
            return False
        return True

    def interface(self, shape: ShapeCheck, at: YamlMapping, definition: Definition) -> None:
        definition.inputs = self.declarations(shape, at.get("in"), "an input")
        definition.outputs = self.declarations(shape, at.get("out"), "an output")
        for name, declared in definition.outputs.items():
            if name in definition.inputs:
                hint = "give the output a name of its own"
                self.findings.error(
                    declared.key, "duplicate-name", f"'{name}' is an input already", hint
                )

    def read_subtrees(
        self, shape: ShapeCheck, top: YamlMapping, file: TreeFile, folder: Path
    ) -> None:
        for key, value in shape.entries(
            top.get("subtrees"), "subtrees", "'name: {in: …, out: …, root: …}' for each"
        ):
            if not self.good_name(key, "a subtree"):
                continue
            if is_word(self.types, key.text):
                message = f"'{key.text}' is a word of the language and names no subtree"
                self.findings.error(key, "bad-name", message, "give the subtree another name")
                continue
            at = shape.mapping(value, "a subtree")
            if at is None:
                continue
            if "file" in at.entries:
                shape.known_keys(at, ("file",), "a subtree in another file")
                written = shape.text(at.get("file"))
                called = self.other_file(written, folder, file)
                if called is not None:
                    file.subtrees[key.text] = called
                elif written is not None:
                    file.unread.add(key.text)
                continue
            shape.known_keys(at, ("description", "in", "out", "root"), "a subtree")
            described = shape.text(at.get("description"))
            definition = Definition(key.text, at, file)
            definition.description = described.text if described is not None else _comment(key)
            self.interface(shape, at, definition)
            if "root" not in at.entries:
                self.findings.error(key, "missing-key", f"subtree '{key.text}' has no 'root'")
            file.subtrees[key.text] = definition

    def other_file(
        self, written: YamlScalar | None, folder: Path, caller: TreeFile
    ) -> Definition | None:
        if written is None:
            return None
        if len(self.files) >= MAX_FILES:
            self.findings.error(written, "too-large", f"a tree calls at most {MAX_FILES} files")
            return None
        shown = str(Path(caller.source.path).parent / written.text)
        if shown in self.texts:
            known = self.files.get(Path(shown))
            return self.main_of(known or self.file(self.texts[shown], shown, Path(shown)), written)
        path = self.find(written, folder)
        if path is None:
            return None
        file = self.files.get(path)
        if file is None:
            text = _load(path, shown, self.findings, written)
            if text is None:
                return None
            file = self.file(text, shown, path)
        return self.main_of(file, written)

    def main_of(self, file: TreeFile, written: YamlScalar) -> Definition | None:
        """Return the tree of a file that is called; reports where it is called that there is none."""
        if file.main is None:
            self.findings.error(
                written, "file", f"{file.source.path} holds no tree that can be read"
            )
        return file.main

    def find(self, written: YamlScalar, folder: Path) -> Path | None:
        """Return the called file, if it lies in the tree's folder or among the installed trees."""
        asked = written.text
        outside = False
        try:
            for base in (folder, *self.folders):
                path = (base / asked).resolve()
                if not any(path.is_relative_to(allowed) for allowed in self.folders):
                    outside = True
                elif path.is_file():
                    return path
        except (OSError, ValueError, RuntimeError):
            outside = False
        if outside:
            message = f"'{asked}' lies outside the tree's folder"
            hint = "subtrees come from the tree's own folder or from installed trees"
            self.findings.error(written, "file", message, hint)
        elif not report_removed(self.findings, written, "tree", Path(asked).stem):
            message = f"there is no file '{asked}' beside this tree or among installed trees"
            self.findings.error(written, "file", message)
        return None


def _start(top: YamlMapping) -> YamlScalar:
    empty = YamlScalar(top.source, top.line, top.column, top.line, top.column + 1, "", True)
    return next((key for key, _ in top.entries.values()), empty)


def _comment(key: YamlScalar) -> str:
    return key.source.comments.get(key.line, "")


def _header(source: Source, top: YamlMapping) -> str:
    """The comment at the head of the file describes the tree."""
    lines = []
    for number in range(1, _start(top).line):
        if number not in source.comment_lines:
            break
        lines.append(source.comments[number])
    return " ".join(lines).strip()
