"""Answers to an editor about one tree file, without any protocol."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum, EnumType
from pathlib import Path

from pomona.executive.cell.cell_file import CellFile, judge_cell_file
from pomona.executive.files import file_kind, kind_names
from pomona.executive.judging import judge
from pomona.executive.language.check import Analysis, analyse
from pomona.executive.language.expression import FUNCTIONS, SPECIAL
from pomona.executive.language.model import Definition, Document
from pomona.executive.language.read import read
from pomona.executive.language.scope import Named
from pomona.executive.language.value_types import ValueType, describe, element_type, fields_of
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.context import COUNTERS, LastFailure
from pomona.executive.nodes.takes import NAME, Value
from pomona.executive.ports import Port, type_name
from pomona.executive.registry import Registry, default_text
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Finding, Findings, Located, Source, Spot
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.plain_text import read_plain_text
from pomona.tools.editor.places import Place, place_at, word_at
from pomona.tools.editor.renaming import (
    RenameRefused,
    declared_in,
    key_of,
    nodes_of,
    order,
    spots_in_calls,
    spots_of_name,
    spots_of_subtree,
)

TOP = {
    "pomona": "version of the language",
    "tree": "the tree's name",
    "description": "purpose of the tree",
    "cell": "the cell that it is for",
    "success": "what the robot must have measured at the end",
    "parameters": "values that --set changes",
    "skills": "which package's skill to use where several offer it",
    "constants": "named values",
    "in": "inputs, for a tree that other trees call",
    "out": "outputs, for a tree that other trees call",
    "root": "the tree",
    "subtrees": "parts of the tree that are called by name",
}
DECLARED = {
    "type": "type of its values",
    "default": "value when none is given",
    "min": "smallest value allowed",
    "max": "largest value allowed",
    "choices": "the texts allowed",
    "help": "description in one line",
}
SUBTREE = {
    "in": "inputs",
    "out": "outputs",
    "root": "its nodes",
    "description": "description for readers",
    "file": "another file",
}
_PATH = re.compile(r"\s*([A-Za-z_]\w*)((?:\.\w+|\[[^\]]*\])*)\.\w*$")
_CODES = re.compile(r"failure\.codes?\s*(?:==|!=|in|not in)\s*\[?[^\]]*$")


@dataclass(frozen=True, slots=True)
class Offer:
    """One completion: the word, its kind, a line about it, and the text to insert."""

    word: str
    kind: str
    about: str = ""
    written: str = ""


@dataclass(slots=True)
class TreeService:
    """One open file: its current text, and the newest analysis whose nodes could be read."""

    path: Path
    skills: Registry  # installed skills, or their declarations
    cell: Path | None = None  # the cell file whose names are offered; None without one
    # texts of other open files, by path; they may not be saved yet
    others: Callable[[], Mapping[str, str]] = dict
    surely: bool = False  # the file is a tree, whatever its text is
    text: str = ""
    analysis: Analysis | None = None
    document: Document | None = None
    cell_file: CellFile | None = None
    findings: list[Finding] = field(default_factory=list)
    elsewhere: list[Finding] = field(
        default_factory=list
    )  # of the files that it calls, and of the cell

    def update(self, text: str) -> list[Finding]:
        """Take a new text; returns everything that is wrong with it."""
        self.text = text
        self.findings = []
        self.elsewhere = []
        if not self.surely and not is_tree(text):
            self.analysis = None
            return []
        document = read(text, str(self.path), tree_folders=[installed_trees()], texts=self.others())
        self.document = document if document.main.top is not None else self.document
        if self.cell is None:
            analysis = analyse(document, self.skills)
            findings = analysis.findings
        else:
            judged = judge(document, self.skills, {}, self.cell)
            findings = judged.findings.sorted()
            self.cell_file = judged.cell or self.cell_file
            analysis = judged.analysis
        if document.main.main is not None and document.main.main.root is not None:
            self.analysis = analysis
        for finding in findings:
            (self.findings if finding.path == str(self.path) else self.elsewhere).append(finding)
        return self.findings

    def mending(self, first: int, last: int) -> list[Finding]:
        """Return the findings of these rows (from 0) whose hints name the correction."""
        return [f for f in self.findings if f.edits and first <= f.line - 1 <= last]

    def outline(self) -> Iterator[Definition]:
        """Yield the file's trees, whose nodes an editor lists."""
        if self.analysis is not None:
            document = self.analysis.document
            yield from (
                d for d in document.definitions() if d.file is document.main and d.root is not None
            )

    def calls(self, path: Path) -> bool:
        """Return True if the tree was read together with another file."""
        document = None if self.analysis is None else self.analysis.document
        return document is not None and any(
            file.source.path == str(path) for file in document.files
        )

    def use_cell(self, cell: Path | None) -> None:
        """Offer the names of a cell from now on: its poses, and other names that skills look up in it."""
        self.cell = cell
        self.cell_file = None
        if cell is not None:
            self.cell_file = judge_cell_file(cell, Findings())

    @property
    def lines(self) -> list[str]:
        """The current text's lines."""
        return self.text.split("\n")

    @property
    def types(self) -> NodeTypes:
        """All words of the language."""
        return self.analysis.document.types if self.analysis is not None else NodeTypes.installed()

    # ------------------------------------------------------------------------------------------- completion

    def complete(self, row: int, column: int) -> list[Offer]:
        """Return the allowed completions at a position (row and column from 0)."""
        if self.text.strip() and not is_tree(self.text):
            return []
        place = place_at(self.lines, row, column)
        definition = self.definition_around(place)
        if place.braces is not None:
            return list(self.in_braces(place.braces, definition))
        if _CODES.search(place.before):
            return [Offer(code, "code", "failure code") for code in self.codes()]
        if place.key:
            return list(self.values(place))
        return [offer for offer in self.keys(place) if offer.word not in place.siblings]

    def keys(self, place: Place) -> Iterator[Offer]:
        """Yield keys that are allowed here."""
        parent = place.parent
        above = place.parents[1] if len(place.parents) > 1 else ""
        if not parent:
            yield from _words(TOP)
        elif above in ("parameters", "in", "out") and len(place.parents) in (2, 4):
            yield from _words(DECLARED)
        elif parent in self.skills and (place.flow or self.is_node(place.parents[1:])):
            skill = self.skills[parent]
            yield from _ports(skill.inputs, "input", parent)
            yield from _ports(skill.outputs, "output", parent)
        elif above == "subtrees" and len(place.parents) == 2:
            yield from _words(SUBTREE)
        elif (called := self.called(parent)) is not None and parent not in (
            "subtrees",
            "parameters",
        ):
            interface = self.analysis.interfaces[id(called)] if self.analysis is not None else None
            if interface is not None:
                yield from _ports(interface.inputs, "input", parent)
                yield from _ports(interface.outputs, "output", parent)
        elif self.is_node(place.parents):
            kind = next((word for word in place.siblings if self.is_kind(word)), None)
            yield from self.kinds() if kind is None else self.beside(kind)

    def is_node(self, parents: tuple[str, ...]) -> bool:
        """Return True if a node is expected below these keys."""
        if not parents:
            return False
        if parents[0] == "root":
            return True
        found = self.types.get(parents[0])
        if found is not None and found.value.nodes:
            return True
        return any(owner.fields[parents[0]].nodes for owner in self.types.owners(parents[0])) or (
            len(parents) > 1 and parents[1] == "cases"
        )

    def is_kind(self, word: str) -> bool:
        """Return True if a word names a node type, a skill or a subtree."""
        found = self.types.get(word)
        return (
            word in self.skills
            or self.called(word) is not None
            or (found is not None and found.role != "modifier")
        )

    def kinds(self) -> Iterator[Offer]:
        """Everything that a node can be."""
        for name, skill in sorted(self.skills.items()):
            needed = [port for port, facts in skill.inputs.items() if facts.required]
            yield Offer(
                name,
                "skill",
                first_line(skill),
                f"{name}: {{{', '.join(f'{port}: ' for port in needed)}}}",
            )
        for name, definition in self.subtrees().items():
            yield Offer(name, "subtree", definition.description, f"{name}: {{}}")
        for word, found in self.types.items():
            if found.role != "modifier" and not found.calls:
                yield Offer(word, "word", found.summary, f"{word}: ")

    def beside(self, kind: str) -> Iterator[Offer]:
        """Modifiers, and the keys that belong to a node's type."""
        found = self.types.get(kind)
        for word, taken in (found.fields if found is not None else {}).items():
            yield Offer(word, "word", taken.help, f"{word}: ")
        for modifier in self.types.modifiers:
            yield Offer(modifier.key, "modifier", modifier.summary, f"{modifier.key}: ")
            for word, taken in modifier.fields.items():
                yield Offer(word, "modifier", taken.help, f"{word}: ")
        yield Offer("name", "word", "display name", "name: ")
        yield Offer("description", "word", "a sentence for the operator", "description: ")

    def values(self, place: Place) -> Iterator[Offer]:
        """Yield words that are allowed as a key's value."""
        parent = place.parent
        if place.key == "type" and any(
            word in ("parameters", "in", "out") for word in place.parents[:2]
        ):
            yield from (Offer(name, "type", "a type") for name in sorted(self.skills.types))
            return
        skill = self.skills.get(parent)
        if skill is not None and place.key in skill.inputs:
            yield from (
                Offer(word, "value", "of the cell")
                for word in skill.offers(place.key, self.cell_file)
            )
            yield from (Offer(word, "value") for word in words_of(skill.inputs[place.key]))
            return
        for found in self.types.values():
            taken = found.slots.get(place.key)
            if isinstance(taken, Value):
                words = (*words_of(taken.port), *taken.words)
                yield from (Offer(word, "value") for word in words)
        if place.key == "success_on":
            yield from (Offer(word, "value") for word in ("all", "one"))

    def in_braces(self, written: str, definition: Definition | None) -> Iterator[Offer]:
        """Yield names in scope, or the fields of the value before a dot."""
        scope = self.scope(definition)
        path = _PATH.match(written)
        if path is not None:
            kind = self.type_of(path[1], path[2], scope)
            for name, field in (fields_of(kind) or {}).items() if kind is not None else ():
                yield Offer(name, "field", describe(field))
            return
        for name, named in scope.items():
            yield Offer(name, "name", _about(named))
        yield from (Offer(name, "word", "") for name in (*SPECIAL, *FUNCTIONS))

    def type_of(self, name: str, path: str, scope: Mapping[str, Named]) -> ValueType | None:
        """Return the type of a name with fields and elements behind it."""
        kind: ValueType | None = COUNTERS.get(name, LastFailure if name == "failure" else None)
        if name in scope:
            kind = scope[name].type
        for step in re.findall(r"\.\w+|\[", path):
            if kind is None:
                return None
            kind = element_type(kind) if step == "[" else (fields_of(kind) or {}).get(step[1:])
        return kind

    # ------------------------------------------------------------------------------------------- hover, definition

    def hover(self, row: int, column: int) -> str:
        """Help on the word at a position, as Markdown; empty when there is none."""
        word, start = word_at(self.lines[row] if row < len(self.lines) else "", column)
        place = place_at(self.lines, row, start)
        if not word:
            return ""
        if place.braces is not None:
            return self.hover_name(word, place)
        if word in self.skills and not place.key:
            return _skill_sheet(word, self.skills[word])
        skill = self.skills.get(place.parent)
        if skill is not None and not place.key:
            port = skill.inputs.get(word) or skill.outputs.get(word)
            if port is not None:
                direction = "input" if word in skill.inputs else "output"
                return f"**{place.parent}.{word}** ({direction})  \n{_port_text(port)}"
        called = self.called(word)
        if called is not None:
            return f"**{word}**, a subtree  \n{called.description}"
        found = self.types.get(word)
        if found is not None:
            return f"**{word}**  \n{found.summary}"
        for owner in self.types.owners(word):
            return f"**{word}**, of {owner.key}  \n{owner.fields[word].help}"
        return ""

    def hover_name(self, word: str, place: Place) -> str:
        """Help on a name or a field in braces."""
        scope = self.scope(self.definition_around(place))
        before = place.braces or ""
        path = _PATH.match(before + word)
        if path is not None:
            kind = self.type_of(path[1], path[2] + "." + word, scope)
            return "" if kind is None else f"**{before}{word}**  \n{describe(kind)}"
        return f"**{word}**  \n{_about(scope[word])}" if word in scope else ""

    def definition_of(self, row: int, column: int) -> Located | None:
        """Where the name, port, subtree, file or word of the cell at a position is declared or first written."""
        word, start = word_at(self.lines[row] if row < len(self.lines) else "", column)
        place = place_at(self.lines, row, start)
        scope = self.scope(self.definition_around(place))
        if place.braces is not None or place.key in ("as", "answer"):
            return scope[word].where if word in scope and "." not in (place.braces or "") else None
        around = self.called(place.parent)
        if around is not None and place.key == "file":
            return around.at
        if around is not None and not place.key:
            return declared_in(around, word)
        skill = self.skills.get(place.parent)
        if skill is not None and place.key:
            return (
                self.place_in_cell(word)
                if word in skill.offers(place.key, self.cell_file)
                else None
            )
        called = self.called(word)
        return None if called is None else key_of(called)

    def place_in_cell(self, word: str) -> Spot | None:
        """Where the cell's file, or one that it includes, has this key."""
        if self.cell is None or self.cell_file is None:
            return None
        for name, text in self.cell_file.files.items():
            for number, line in enumerate(text.splitlines(), start=1):
                found = re.search(rf"(?:^|[\s{{,])({re.escape(word)})\s*:", line.partition("#")[0])
                if found is not None:
                    return Spot(
                        Source(str(self.cell.parent / name), text),
                        number,
                        found.start(1) + 1,
                        len(word),
                    )
        return None

    # ------------------------------------------------------------------------------------------- renaming

    def rename(self, row: int, column: int, new: str) -> list[Spot]:
        """Return every place that a new name changes.

        Raises RenameRefused: there is nothing to rename, or the new name cannot be given.
        """
        if not NAME.fullmatch(new):
            raise RenameRefused(
                f"'{new}' is not a valid name: use lower-case letters, digits and _"
            )
        definition, spots = self.spots(row, column)
        taken = (
            new in self.subtrees() or self.is_kind(new) or new in self.types
            if definition is None
            else new in self.scope(definition) or new in SPECIAL
        )
        if taken:
            raise RenameRefused(f"'{new}' is taken")
        path = str(self.path) if definition is None else definition.file.source.path
        if path != str(self.path) and Path(path).resolve().is_relative_to(
            installed_trees().resolve()
        ):
            raise RenameRefused(
                f"this name is defined in {path}, which is installed and not to be changed"
            )
        return spots

    def spots(self, row: int, column: int) -> tuple[Definition | None, list[Spot]]:
        """Return every place of the wiring or port at a position, also in the files that are called or that call.

        Returns:
            the definition whose name it is, or None for a subtree's own name; and the places.

        Raises RenameRefused: no name of the file stands there.
        """
        word, start = word_at(self.lines[row] if row < len(self.lines) else "", column)
        place = place_at(self.lines, row, start)
        if self.analysis is None or self.analysis.document.text != self.text:
            raise RenameRefused("the file cannot be parsed: correct its errors first")
        definition = self.definition_around(place)
        around = self.called(place.parent)
        if (
            place.braces is None
            and around is not None
            and not place.key
            and declared_in(around, word) is not None
        ):
            definition = around
        elif place.braces is None and self.called(word) is not None:
            return None, sorted(spots_of_subtree(self.analysis.document, word), key=order)
        if definition is None or word not in self.scope(definition):
            raise RenameRefused(f"'{word}' is not a name that this file defines")
        path = definition.file.source.path
        spots = list(spots_of_name(self.analysis, definition, word))
        for caller in (
            self.callers(Path(path)) if definition.main and declared_in(definition, word) else ()
        ):
            spots += spots_in_calls(caller, path, word)
        return definition, sorted({order(spot): spot for spot in spots}.values(), key=order)

    def callers(self, path: Path) -> Iterator[Document]:
        """Other trees that call a file: those that are open, and those beside it."""
        texts = dict(self.others())
        # files in the folder of a renamed one that are searched for callers
        for beside in sorted(path.parent.glob("*.yaml"))[:200]:
            if str(beside) not in texts:
                texts[str(beside)] = _text_of(beside)
        for name, text in texts.items():
            if name not in (str(path), str(self.path)) and path.name in text and is_tree(text):
                yield read(text, name, tree_folders=[installed_trees()], texts=texts)

    # ------------------------------------------------------------------------------------------- what is known

    def subtrees(self) -> Mapping[str, Definition]:
        """Return the file's subtrees by name."""
        return self.analysis.document.main.subtrees if self.analysis is not None else {}

    def called(self, name: str) -> Definition | None:
        """Return the subtree of a name."""
        return self.subtrees().get(name)

    def definition_around(self, place: Place) -> Definition | None:
        """Return the definition in which a place stands."""
        if self.analysis is None:
            return None
        if len(place.parents) >= 2 and place.parents[-1] == "subtrees":
            return self.called(place.parents[-2])
        return self.analysis.document.main.main

    def scope(self, definition: Definition | None) -> Mapping[str, Named]:
        """Return the meaning of each name in a definition."""
        if (
            self.analysis is None
            or definition is None
            or id(definition) not in self.analysis.scopes
        ):
            return {}
        return self.analysis.scopes[id(definition)].names

    def codes(self) -> list[str]:
        """Failure codes of all skills in the file."""
        if self.analysis is None:
            return []
        nodes = nodes_of(self.analysis.document.definitions())
        used = {node.key.text for node in nodes}
        found = {code for name in used & self.skills.keys() for code in self.skills[name].failures}
        return sorted({*found, "TIMEOUT", "CONDITION_FALSE", "BAD_VALUE"})


def is_tree(text: str) -> bool:
    """Return True if a YAML file is a tree, and not a cell, a scenario or another program's file."""
    keys = re.findall(r"^(\w+)\s*:(?=\s|$)", text, re.MULTILINE)
    if "root" in keys:
        return True
    others = any(file_kind(name).recognises(keys) for name in kind_names())
    return "pomona" in keys and not others


def _text_of(path: Path) -> str:
    try:
        return read_plain_text(path)
    except (OSError, ValueError):
        return ""


def _words(table: Mapping[str, str]) -> Iterator[Offer]:
    yield from (Offer(word, "word", about, f"{word}: ") for word, about in table.items())


def _ports(ports: Mapping[str, Port], direction: str, owner: str) -> Iterator[Offer]:
    for name, port in ports.items():
        written = f'{name}: "{{{name}}}"' if direction == "output" else f"{name}: "
        needed = ", needed" if direction == "input" and port.required else ""
        yield Offer(name, direction, f"{direction} of {owner}{needed}: {_port_text(port)}", written)


def words_of(port: Port) -> list[str]:
    """Return the words that a port takes: its choices, truth values, members of an enum; empty for other types."""
    kind: object = port.type
    if port.choices:
        return list(port.choices)
    if kind is bool:
        return ["true", "false"]
    if isinstance(kind, EnumType):
        return [m.value if isinstance(m.value, str) else m.name for m in list[Enum](kind)]
    return []


def _port_text(port: Port) -> str:
    said = [type_name(port.type)]
    if not port.required and port.default is not None:
        said.append(f"default {default_text(port)}")
    if port.min is not None:
        said.append(f"at least {port.min}")
    if port.max is not None:
        said.append(f"at most {port.max}")
    if port.choices:
        said.append("one of " + ", ".join(port.choices))
    return ", ".join(said) + (f": {port.help}" if port.help else "")


def _skill_sheet(name: str, skill: type[Skill]) -> str:
    lines = [f"**{name}**  ", first_line(skill), ""]
    for title, ports in (("in", skill.inputs), ("out", skill.outputs)):
        lines += [f"- {title} `{port}`: {_port_text(facts)}" for port, facts in ports.items()]
    if skill.failures:
        lines.append(f"\nfails with {', '.join(skill.failures)}")
    return "\n".join(lines)


def first_line(skill: type[Skill]) -> str:
    """Return the first line of a skill's description."""
    return (skill.__doc__ or "").strip().split("\n")[0]


def _about(named: Named) -> str:
    where = (
        f"{named.origin}, line {named.where.line}"
        if named.origin != "written"
        else f"written by {named.by}"
    )
    return f"{describe(named.type)} ({where})"
