"""Answers about a text that is being edited: its nodes, its findings, edits of it, and values that fit a port."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.judging import judge
from pomona.executive.language.check import read_document
from pomona.executive.language.interface import parse_settings
from pomona.executive.language.model import Declared, Definition
from pomona.executive.language.value_types import ValueType, can_flow, describe, fields_of
from pomona.executive.nodes.context import COUNTERS
from pomona.executive.nodes.takes import Value
from pomona.executive.ports import Port, Quantity
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Finding, mended, place_of, said
from pomona.tools.dashboard.choices import declared_facts
from pomona.tools.editor.edits import EditError, apply, edit_of, nodes
from pomona.tools.editor.service import TreeService
from pomona.tools.tree_editor.catalogue import catalogue, port_of

MOST_WIRES = 60  # values that are offered for one port
NEW = "pomona: 1\ntree: {name}\n\nroot:\n"  # above the first node of a new file

Facts = dict[str, Any]


class Workbench:
    """One file's language service, for requests of several threads."""

    def __init__(self, path: Path, skills: Registry, cell: Path | None = None) -> None:
        """
        Args:
            path: the file; subtrees of other files are found beside it.
            skills: those that are installed.
            cell: the cell whose names are offered and checked, or None.
        """
        self._service = TreeService(path, skills, surely=True)
        self._service.use_cell(cell)
        self._skills, self._path, self._lock = skills, path, threading.Lock()

    def catalogue(self) -> Facts:
        """Return everything that a node can be."""
        return catalogue(self._skills, self._service.types, self._service.cell_file)

    def state(self, text: str) -> Facts:
        """Return the nodes, definitions and findings of a text."""
        with self._lock:
            return self._state(text)

    def edit(self, text: str, said: Mapping[str, Any]) -> Facts:
        """Return the text after an edit, and its state. Raises EditError: the edit cannot be made."""
        if not text.strip() and said.get("do") == "insert":
            after = self._first_node(said)
        else:
            after = apply(text, edit_of(said))
        with self._lock:
            return {"text": after, **self._state(after)}

    def mend(self, text: str, number: int) -> Facts:
        """Return the text after the hint of one of its findings was followed. Raises EditError: it has none."""
        with self._lock:
            findings = self._service.update(text)
            found = findings[number] if 0 <= number < len(findings) else None
            if found is None or not found.edits:
                raise EditError("this finding has no correction that can be applied")
            after = mended(text, [found])[0]
            return {"text": after, **self._state(after)}

    def refuse(self, text: str, settings: Mapping[str, str], cell: Path) -> None:
        """Raise UsageError: a value of a run, or the text with these values, cannot be used on the cell."""
        with self._lock:
            document = read_document(self._path, {str(self._path): text})
            for found in judge(document, self._skills, settings, cell).findings.sorted():
                if found.severity == "error":
                    raise UsageError(f"{place_of(found)}: {said(found)}")

    def offers(self, text: str, definition: str, kind: str) -> dict[str, list[dict[str, str]]]:
        """Return the values that fit each port and field of a node: names in scope and their fields, by type.

        Args:
            text: the whole file.
            definition: name of the subtree that the node stands in; empty for the main tree.
            kind: the node's skill, subtree or word.
        """
        with self._lock:
            if text != self._service.text:
                self._service.update(text)
            analysis = self._service.analysis
            if analysis is None:
                return {}
            inside = self._service.called(definition) if definition else analysis.document.main.main
            wires = list(self._wires(inside))
            return {
                name: [
                    {"word": word, "about": describe(it)}
                    for word, it in wires
                    if can_flow(it, port.type)
                ][:MOST_WIRES]
                for name, port in self._ports(kind).items()
            }

    # ------------------------------------------------------------------------------------------- a text's facts

    def _state(self, text: str) -> Facts:
        findings = self._service.update(text)
        drawn = nodes(text)
        problem = next((node["error"] for node in drawn if not node["id"]), "")
        main = self._service.analysis
        return {
            "nodes": [node for node in drawn if node["id"]],
            "problem": problem,
            "findings": [
                *(_finding(number, finding) for number, finding in enumerate(findings)),
                *(_finding(-1, _as_words(finding)) for finding in self._service.elsewhere),
            ],
            "definitions": []
            if main is None
            else [self._definition(d) for d in self._service.outline()],
            "parameters": [] if main is None else self._declared(main.document.main.parameters),
        }

    def _definition(self, definition: Definition) -> Facts:
        return {
            "name": "" if definition.main else definition.name,
            "description": definition.description,
            "inputs": self._declared(definition.inputs),
            "outputs": self._declared(definition.outputs),
            "ports": [] if definition.main else self._called_ports(definition),
        }

    def _declared(self, table: Mapping[str, Declared]) -> list[Facts]:
        return [
            {
                **declared_facts(name, declared),
                "units": self._units(declared),
                "line": declared.key.line,
            }
            for name, declared in table.items()
        ]

    def _units(self, declared: Declared) -> list[str]:
        kind = self._skills.type_named(declared.type.text) if declared.type is not None else None
        return list(kind.units) if isinstance(kind, Quantity) else []

    def _called_ports(self, definition: Definition) -> list[Facts]:
        analysis = self._service.analysis
        interface = None if analysis is None else analysis.interfaces.get(id(definition))
        if interface is None:
            return []
        inputs = [
            port_of(name, port) | {"direction": "input"} for name, port in interface.inputs.items()
        ]
        return inputs + [
            port_of(name, port) | {"direction": "output"}
            for name, port in interface.outputs.items()
        ]

    def _ports(self, kind: str) -> dict[str, Port]:
        """Every typed port and field of a node, by name."""
        service = self._service
        found = dict[str, Port]()
        for modifier in service.types.modifiers:
            found |= {
                slot: taken.port
                for slot, taken in modifier.slots.items()
                if isinstance(taken, Value)
            }
        if kind in service.types:
            slots = service.types[kind].slots
            found |= {slot: taken.port for slot, taken in slots.items() if isinstance(taken, Value)}
        called = service.called(kind)
        interface = (
            service.analysis.interfaces.get(id(called))
            if called is not None and service.analysis
            else None
        )
        owner = self._skills.get(kind) or interface
        if owner is not None:
            found |= {**owner.inputs, **owner.outputs}
        return found

    def _wires(self, definition: Definition | None) -> Iterator[tuple[str, ValueType]]:
        """Every name in scope, then the fields of each."""
        scope = self._service.scope(definition)
        yield from ((f"{{{name}}}", named.type) for name, named in scope.items())
        for name, named in scope.items():
            for field, it in (fields_of(named.type) or {}).items():
                yield f"{{{name}.{field}}}", it
        yield from (("{" + f"{name}.{field}" + "}", it) for name, kind in COUNTERS.items()
                    for field, it in (fields_of(kind) or {}).items())  # fmt: skip

    def _first_node(self, said: Mapping[str, Any]) -> str:
        """Return a new tree around its first node."""
        node = str(said.get("node", "")).strip()
        name = re.sub(r"\W+", "_", self._path.stem.lower()).strip("_") or "task"
        head = NEW.format(name=name if name[0].isalpha() else f"tree_{name}")
        return head + "".join(f"  {line}\n" for line in node.split("\n"))


def settings_of(said: object) -> dict[str, str]:
    """Return parameters of a run from the page. Raises PomonaError: they are no texts by name."""
    if not isinstance(said, dict) or not all(isinstance(value, str) for value in said.values()):
        raise PomonaError("settings are texts by name")
    return parse_settings([f"{name}={value}" for name, value in said.items()])


def _as_words(finding: Finding) -> Finding:
    """Return a finding of another file as one without a place in this file, which its message names."""
    return replace(finding, line=0, message=f"{place_of(finding)}: {finding.message}", edits=())


def _finding(number: int, finding: Finding) -> Facts:
    return {**asdict(finding), "number": number, "mends": bool(finding.edits)}
