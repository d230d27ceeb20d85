"""Document → findings: everything that is wrong, found before anything moves, in one pass."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.files import default_name, find_cell, read_text
from pomona.executive.language.check_node import NodeChecker
from pomona.executive.language.flow import Flow, Outcomes, Truth
from pomona.executive.language.interface import InterfaceReader, PortDeclared, parameter_values
from pomona.executive.language.model import Definition, Document, TreeNode
from pomona.executive.language.read import read
from pomona.executive.language.scope import Named, Origin, Read, Resolved, Scope
from pomona.executive.language.value_types import can_flow, describe
from pomona.executive.language.values import static_type
from pomona.executive.nodes.facts import Names
from pomona.executive.nodes.leaves import SUBTREE
from pomona.executive.ports import Port
from pomona.executive.registry import Registry
from pomona.executive.values.findings import (
    Finding,
    Findings,
    TreeFileError,
    did_you_mean,
    few_hints,
    format_findings,
)
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.plain_text import is_file
from pomona.executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar

MAX_BUILT_NODES = 10_000
MAX_BUILT_DEPTH = 150


@dataclass(slots=True, eq=False)
class Analysis:
    """Results of the check of a document: its findings, and every resolved name."""

    document: Document
    findings: list[Finding] = field(default_factory=list)  # in reading order
    # by id of the node and word of the layer: its type's, or a modifier's
    resolved: dict[tuple[int, str], Resolved] = field(default_factory=dict)
    scopes: dict[int, Scope] = field(default_factory=dict)  # by id of the definition
    interfaces: dict[int, PortDeclared] = field(
        default_factory=dict
    )  # ports of each definition, by id
    parameters: dict[str, Any] = field(
        default_factory=dict
    )  # values of the main tree's parameters, overrides applied
    finite: bool = True  # whether the tree with its subtrees written out has an end, and not more nodes than can run
    outcomes: Outcomes | None = None
    skills: Registry | None = None
    devices: tuple[type, ...] | None = None

    @property
    def errors(self) -> list[Finding]:
        """The findings that keep the tree from running."""
        return [finding for finding in self.findings if finding.severity == "error"]


def check(
    document: Document,
    skills: Registry,
    *,
    overrides: Mapping[str, str] | Sequence[str] = (),
    interfaces: tuple[type, ...] | None = None,
) -> list[Finding]:
    """Return everything that is wrong with a document, errors and warnings, in reading order.

    `overrides` are values for parameters, as a mapping or as texts `name=value`; `interfaces` are those of the cell's
    devices, None if unknown.
    """
    return analyse(document, skills, overrides=overrides, interfaces=interfaces).findings


@few_hints()
def analyse(
    document: Document,
    skills: Registry,
    *,
    overrides: Mapping[str, str] | Sequence[str] = (),
    interfaces: tuple[type, ...] | None = None,
) -> Analysis:
    """Check a document and return everything that the check learned; `build` works from it."""
    return _Checker(document, skills, interfaces).run(overrides)


class _Checker:
    def __init__(
        self, document: Document, skills: Registry, devices: tuple[type, ...] | None
    ) -> None:
        self.document = document
        self.devices = devices
        self.findings = Findings()
        self.findings.extend(document.findings)
        packages = document.main.skills
        chosen = skills.choosing({name: package.text for name, package in packages.items()})
        self.skills = skills = chosen.declaring(document.main.declared_skills)
        for name, package in packages.items():
            if name in skills.problems:
                self.findings.error(
                    package, "broken-skill", f"{name} cannot be used: {skills.problems[name]}"
                )
        self.analysis = Analysis(document, skills=skills, devices=devices)
        self.called: dict[int, Definition] = {}
        self.outcomes = self.analysis.outcomes = Outcomes(skills, self.called)
        self.readers: dict[int, InterfaceReader] = {}
        self.recursive = False

    def run(self, overrides: Mapping[str, str] | Sequence[str]) -> Analysis:
        definitions = list(self.document.definitions())
        for definition in definitions:
            for node in definition.root.walk() if definition.root is not None else ():
                if node.type is SUBTREE and node.key.text in definition.file.subtrees:
                    self.called[id(node)] = definition.file.subtrees[node.key.text]
                self.skills.get(node.key.text)  # loaded: types of ports are looked up in it first
        for definition in definitions:
            reader = self.readers.setdefault(
                id(definition.file), InterfaceReader(self.findings, self.skills)
            )
            self.analysis.interfaces[id(definition)] = reader.interface(definition)
        main_reader = self.readers.setdefault(
            id(self.document.main), InterfaceReader(self.findings, self.skills)
        )
        self.analysis.parameters = parameter_values(
            self.document.main, overrides, main_reader, self.findings
        )
        order = self.callees_first(definitions)
        for definition in order:
            self.outcomes.of_definition(definition)
        for definition in definitions:
            self.definition(definition)
        self.lacking_devices()
        self.analysis.finite = not self.recursive and self.size(order)
        if not self.findings.errors:  # a mistyped name would be reported twice
            self.never_read(definitions)
        self.analysis.findings = self.findings.sorted()
        return self.analysis

    # ------------------------------------------------------------------------------------------- definitions

    def definition(self, definition: Definition) -> None:
        scope = self.analysis.scopes[id(definition)] = Scope(definition, skills=self.skills)
        self.declared_names(definition, scope)
        checker = NodeChecker(
            self.findings,
            self.skills,
            scope,
            self.document.types,
            self.called,
            self.outcomes,
            self.analysis.interfaces,
            self.analysis.resolved,
        )
        if definition.root is None:
            return
        checker.definition(definition.root)
        self.follow(definition, scope)
        if scope.looks and not self.findings.errors:  # facts need a document without errors
            Truth(self.findings, scope, self.analysis.resolved, self.outcomes).definition()
        for name, named in scope.written():
            if not named.read and name not in definition.outputs:
                message = f"no node reads '{name}', which {named.by} writes"
                self.findings.warning(named.where, "unread", message)

    def declared_names(self, definition: Definition, scope: Scope) -> None:
        file = definition.file
        reader = self.readers[id(file)]
        for name, constant in file.constants.items():
            value, value_type = reader.constant(constant)
            scope.names[name] = Named(value_type, "constant", constant.key, "a constant", value)
        run_here = file is self.document.main
        for name, parameter in file.parameters.items():
            port = reader.port(parameter, "parameter") or Port(object)
            value = self.analysis.parameters.get(name) if run_here else None
            origin: Origin = "parameter" if run_here else "input"
            scope.names[name] = Named(
                static_type(port), origin, parameter.key, f"parameter '{name}'", value
            )
        for name, declared in definition.inputs.items():
            port = reader.port(declared, "input") or Port(object)
            optional = not port.required and port.default is None
            named = Named(
                static_type(port), "input", declared.key, f"input '{name}'", may_be_none=optional
            )
            scope.names[name] = named

    def follow(self, definition: Definition, scope: Scope) -> None:
        assert definition.root is not None
        known = frozenset(name for name, named in scope.names.items() if named.origin != "written")

        def unset(node: TreeNode, read: Read) -> None:
            named = scope.names[read.name]
            self.findings.error(
                read.where,
                "unset",
                f"{node.label} reads '{read.name}', which may not be written yet"
                f" ({named.by} writes it, line {named.where.line})",
                "it must be written on every path that leads here",
            )

        ends = Flow(self.analysis.resolved, self.outcomes, unset).node(
            definition.root, Names(known)
        )
        interface = self.analysis.interfaces[id(definition)]
        for name, declared in definition.outputs.items():
            written = scope.names.get(name)
            port = interface.outputs.get(name)
            if written is None or written.origin != "written":
                hint = did_you_mean(name, [n for n, _ in scope.written()])
                message = f"nothing in '{definition.name}' writes the output '{name}'"
                self.findings.error(declared.key, "unwritten", message, hint)
                continue
            if port is not None and not can_flow(written.type, port.type):
                self.findings.error(
                    declared.key,
                    "port-type",
                    f"output '{name}' is declared as {describe(port.type)}, {written.by} writes"
                    f" {describe(written.type)} (line {written.where.line})",
                )
            if name not in ends.success:
                message = (
                    f"'{definition.name}' may succeed without having written its output '{name}'"
                )
                self.findings.error(
                    declared.key,
                    "unset",
                    message,
                    f"{written.by} writes it in line {written.where.line}",
                )

    # ------------------------------------------------------------------------------------------- whole document

    def lacking_devices(self) -> None:
        """Report each device that the cell lacks once in a file, at the first node that needs it."""
        needing: dict[tuple[str, str], list[YamlScalar]] = {}
        for found in self.analysis.resolved.values() if self.devices is not None else ():
            for interface in found.skill.devices if found.skill is not None else ():
                if not any(interface in has.__mro__ for has in self.devices or ()):
                    needing.setdefault((found.node.key.source.path, interface.__name__), []).append(
                        found.node.key
                    )
        for (_, device), keys in needing.items():
            keys.sort(key=lambda key: (key.line, key.column))
            lines = ", ".join(dict.fromkeys(str(key.line) for key in keys[:3]))
            places = (
                f" ({len(keys)} nodes need it, the first in lines {lines})" if len(keys) > 1 else ""
            )
            message = f"the cell has no {device}, which {keys[0].text} needs{places}"
            self.findings.error(keys[0], "no-device", message)

    def never_read(self, definitions: Sequence[Definition]) -> None:
        """Warn of parameters, inputs and subtrees that nothing uses."""
        for definition in definitions:
            if definition.root is None:
                continue
            scope = self.analysis.scopes[id(definition)]
            for name, declared in definition.inputs.items():
                if not scope.names[name].read:
                    message = f"nothing in '{definition.name}' reads the input '{name}'"
                    self.findings.warning(declared.key, "unread", message)
            if not definition.main:
                continue
            own = [self.analysis.scopes[id(d)] for d in definitions if d.file is definition.file]
            for what, table in (
                ("parameter", definition.file.parameters),
                ("constant", definition.file.constants),
            ):
                for name, declared in table.items():
                    if not any(
                        s.names[name].where is declared.key and s.names[name].read for s in own
                    ):
                        self.findings.warning(
                            declared.key, "unread", f"nothing reads the {what} '{name}'"
                        )
        called = {id(definition) for definition in self.called.values()}
        for name, definition in self.document.main.subtrees.items():
            if id(definition) not in called and definition.file is self.document.main:
                self.findings.warning(
                    _key_of(definition), "unused", f"nothing calls the subtree '{name}'"
                )

    def calls(self, definition: Definition) -> list[tuple[TreeNode, Definition]]:
        if definition.root is None:
            return []
        return [(n, self.called[id(n)]) for n in definition.root.walk() if id(n) in self.called]

    def callees_first(self, definitions: Sequence[Definition]) -> list[Definition]:
        """Return all definitions, each after those that it calls. Reports subtrees that call themselves."""
        order: list[Definition] = []
        done: set[int] = set()
        for start in definitions:
            stack = [] if id(start) in done else [(start, self.calls(start))]
            while stack:
                definition, open_calls = stack[-1]
                if not open_calls:
                    done.add(id(definition))
                    order.append(definition)
                    stack.pop()
                    continue
                node, called = open_calls.pop(0)
                on_the_way = [d for d, _ in stack]
                if called in on_the_way:
                    cycle = [d.name for d in on_the_way[on_the_way.index(called) :]]
                    message = f"a subtree that calls itself never ends: {' → '.join([*cycle, called.name])}"
                    self.findings.error(node.key, "recursion", message)
                    self.recursive = True
                elif id(called) not in done:
                    stack.append((called, self.calls(called)))
        return order

    def measure(self, node: TreeNode, sizes: Mapping[int, tuple[int, int]]) -> tuple[int, int]:
        """How many nodes there are from a node on, and how deep; `sizes` are those of the subtrees that it calls."""
        own = len(node.layers)
        below = (
            [self.measure(child, sizes) for child in node.below()]
            if node.children or node.parts
            else []
        )
        if id(node) in self.called:
            below.append(sizes[id(self.called[id(node)])])
        return own + sum(nodes for nodes, _ in below), own + max(
            (depth for _, depth in below), default=0
        )

    def size(self, order: Sequence[Definition]) -> bool:
        """Refuse a tree that is too large with its subtrees written out; whether it is not."""
        main = self.document.main.main
        sizes: dict[int, tuple[int, int]] = {}
        for definition in order:
            sizes[id(definition)] = (
                self.measure(definition.root, sizes) if definition.root is not None else (0, 0)
            )
        if main is None or main.root is None:
            return True
        count, depth = sizes[id(main)]
        if count > MAX_BUILT_NODES:
            shown = count if count < 1_000_000_000 else "more than a billion"
            message = f"the tree has {shown} nodes with its subtrees written out; {MAX_BUILT_NODES} can run"
            self.findings.error(main.root.key, "too-large", message)
        elif depth > MAX_BUILT_DEPTH:
            message = f"the tree is {depth} nodes deep with its subtrees written out; {MAX_BUILT_DEPTH} can run"
            self.findings.error(main.root.key, "too-deep", message)
        return count <= MAX_BUILT_NODES and depth <= MAX_BUILT_DEPTH


def _key_of(definition: Definition) -> YamlNode:
    """Where a subtree is written, as near to its name as it is known."""
    at = definition.at
    return next((key for key, _ in at.entries.values()), at) if isinstance(at, YamlMapping) else at


def read_document(path: Path, texts: Mapping[str, str] | None = None) -> Document:
    """Read a tree file, and the files that it calls; those in `texts` are not read from the disk.

    Raises UsageError: it cannot be read at all.
    """
    known = texts or {}
    text = known[str(path)] if str(path) in known else read_text(path)
    return read(text, path, tree_folders=[installed_trees()], texts=known)


def usual_cell(document: Document) -> Path:
    """Return the cell that a tree names, beside it, by path or by name; the default of the installation without one.

    Raises TreeFileError: no file describes the named cell.
    """
    named = document.main.cell
    if named is None:
        return find_cell(default_name("cell"))
    beside = Path(document.path).parent / named.text
    try:
        return beside if is_file(beside) else find_cell(named.text)
    except UsageError as error:
        findings = Findings()
        findings.error(named, "no-cell", str(error))
        raise TreeFileError(findings.sorted()) from None


def refuse_errors(
    document: Document,
    registry: Registry,
    settings: Mapping[str, str],
    interfaces: tuple[type, ...] | None,
) -> None:
    """Check a document. Raises UsageError: with every finding, when one of them is an error."""
    findings = check(document, registry, overrides=settings, interfaces=interfaces)
    if any(finding.severity == "error" for finding in findings):
        raise UsageError(f"{format_findings(findings)} Nothing was run.")
