"""The nodes of one definition: skills, ports, modifiers, one by one. Each layer of a node is checked by its type."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain

from pomona.executive.language.flow import LayerAt, Outcomes
from pomona.executive.language.interface import PortDeclared
from pomona.executive.language.literals import scalar_type
from pomona.executive.language.model import Definition, TreeNode
from pomona.executive.language.scope import ComputedValue, Given, Named, Resolved, Scope
from pomona.executive.language.value_types import ANY, ValueType, can_flow, describe, element_type
from pomona.executive.language.values import ValueReader, static_type
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.context import COUNTERS, Around
from pomona.executive.nodes.node_type import Stage
from pomona.executive.nodes.takes import NAME
from pomona.executive.ports import Port, Ports, Quantity
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Edit, Findings, Instead, did_you_mean
from pomona.executive.values.removed import report_removed
from pomona.executive.values.yaml_errors import moved
from pomona.executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar, shape_of, written

_WIRE = re.compile(r"\s*\{\s*([A-Za-z_][A-Za-z0-9_]*)\s*\}\s*")
_SIMPLE = (bool, int, float, str, object)
_EVERYTHING = Around(frozenset(COUNTERS), frozenset())


@dataclass(slots=True, eq=False)
class NodeChecker:
    """Resolves every name in one definition's nodes; fills `scope` with the written names, and `resolved`."""

    findings: Findings
    skills: Registry
    scope: Scope
    words: NodeTypes
    called: Mapping[int, Definition]
    outcomes: Outcomes
    interfaces: Mapping[int, PortDeclared]
    resolved: dict[tuple[int, str], Resolved]
    named: dict[str, YamlScalar] = field(default_factory=dict)

    def definition(self, root: TreeNode) -> None:
        """Check all nodes of a definition."""
        nodes = list(root.walk())
        for node in nodes:
            if node.name is not None:
                self.unique_name(node.name)
        declaring = [
            self.layer(node, index, _EVERYTHING)
            for node in nodes
            for index, layer in enumerate(node.layers)
            if layer.declares
        ]
        for stage in Stage:
            for at in declaring:
                at.layer.declare(at, stage)
        self.node(root, Around())

    def node(self, node: TreeNode, around: Around) -> None:
        """Check a node and everything inside it."""
        self.layer(node, 0, around).check()

    def layer(self, node: TreeNode, index: int, around: Around) -> LayerCheck:
        """Return a layer of a node, from the outside to the inside."""
        layer = node.layers[index]
        found = self.resolved.get(key := (id(node), layer.key))
        if found is None:
            found = self.resolved[key] = Resolved(node)
        return LayerCheck(self, node, index, layer, found, around)

    def unique_name(self, name: YamlScalar) -> None:
        """Report a name that another node has already."""
        first = self.named.setdefault(name.text, name)
        if first is not name:
            self.findings.error(
                name,
                "duplicate-name",
                f"'{name.text}' is the name of another node already (line {first.line})",
            )

    # --------------------------------------------------------------------------------------- who writes what

    def known_types(self) -> Iterator[str]:
        """Yield words that can stand for a node here: composites, leaves and the file's subtrees."""
        yield from (word for word, found in self.words.items() if found.role != "modifier")
        yield from self.scope.definition.file.subtrees

    def skill(self, node: TreeNode) -> type[Skill] | None:
        """Return the skill of that name; reports when there is none."""
        name = node.key.text
        skill = self.skills.get(name)
        if skill is None:
            if name in self.skills.problems:
                self.findings.error(
                    node.key, "broken-skill", f"skill '{name}': {self.skills.problems[name]}"
                )
            elif not report_removed(self.findings, node.key, "skill", name):
                hint = self.hint_for(node) or "'pomona skills' lists the installed skills"
                self.findings.error(node.key, "unknown-skill", f"no skill named '{name}'", hint)
        return skill

    def hint_for(self, node: TreeNode) -> str:
        """Return the change for a name that nothing here has; an empty text if none is known."""
        name = node.key.text
        foreign = self.words.known_elsewhere(node.key.text)
        if foreign is not None:
            return f"other libraries' {name} is the {foreign.role} '{foreign.key}' here"
        of = node.ports.get("ID")
        if name in ("Action", "Condition", "Control", "Decorator", "SubTree") and of is not None:
            return f"write the node's own name instead: '{written(of[1])}: {{…}}'"
        return did_you_mean(name, chain(self.skills, self.known_types()))

    def output(self, value: YamlNode, who: str) -> YamlScalar | None:
        """Return the name to which an output is wired, as a scalar at its place."""
        match = _WIRE.fullmatch(value.text) if isinstance(value, YamlScalar) else None
        if match is None or not isinstance(value, YamlScalar):
            self.findings.error(
                value, "output", f"{who} is an output", 'wire it to a name: "{name}"'
            )
            return None
        return YamlScalar(
            value.source,
            value.line,
            value.column,
            value.end_line,
            value.end_column,
            match[1],
            value.plain,
        )

    def writes(self, target: YamlScalar, value_type: ValueType, by: str, who: str) -> None:
        """Add a name that a node writes to the scope; report one that it cannot write."""
        name = target.text
        known = self.scope.names.get(name)
        if known is None:
            if not NAME.fullmatch(name):
                self.findings.error(
                    target,
                    "bad-name",
                    f"'{name}' is not a valid name for a port",
                    "use lower-case letters, digits and _",
                )
            self.scope.names[name] = Named(value_type, "written", target, by)
        elif known.origin != "written":
            message = f"{who} cannot write '{name}': it is {known.by} (line {known.where.line})"
            self.findings.error(target, "read-only", message, "give the output a name of its own")
        elif not can_flow(value_type, known.type):
            message = (
                f"{who} writes {describe(value_type)} to '{name}', which is {describe(known.type)}"
            )
            self.findings.error(
                target, "port-type", f"{message} (written by {known.by}, line {known.where.line})"
            )

    def devices(self, node: TreeNode) -> dict[str, str]:
        """Return devices that a node and all below it move, each with the first node that does."""
        found: dict[str, str] = {}
        stack = [node]
        seen = set()
        while stack:
            below = stack.pop()
            skill = self.skills.get(below.key.text)
            called = self.called.get(id(below))
            if called is not None and called.root is not None and id(called) not in seen:
                seen.add(id(called))
                stack.append(called.root)
            elif skill is not None and below.type.calls:
                for interface in skill.claims():
                    found.setdefault(interface.__name__, below.label)
            stack.extend(reversed(below.below()))
        return found


@dataclass(slots=True, eq=False)
class LayerCheck(LayerAt[NodeChecker]):
    """One layer of a node being checked by its type (a `CheckContext`)."""

    around: Around

    @property
    def findings(self) -> Findings:
        """Where findings are reported."""
        return self.whole.findings

    @property
    def reader(self) -> ValueReader:
        """Reads values in the layer's scope."""
        return ValueReader(self.whole.findings, self.whole.scope, self.found)

    def check(self) -> None:
        """Let the layer's type check it."""
        self.layer.check_layer(self)

    # --------------------------------------------------------------------------------------- values

    def condition(self, slot: str, written: YamlNode, around: Around | None = None) -> None:
        value = self.reader.condition(slot, written, around or self.around)
        self.whole.scope.looks = True
        if value is not None:
            self.found.settings[slot] = value

    def value(
        self, slot: str, written: YamlNode, port: Port, who: str = "", *, known: bool = False
    ) -> None:
        value = self.reader.value(slot, written, port, self.around, who or slot)
        if known and isinstance(value, ComputedValue):
            self.findings.error(written, "value", f"'{slot}' must be known before the run")
        elif value is not None:
            self.found.settings[slot] = value

    def elements(self, slot: str, written: YamlNode) -> None:
        value = self.reader.value(slot, written, Port(object), self.around, slot)
        if isinstance(value, ComputedValue) and element_type(value.type) is None:
            self.findings.error(
                written,
                "port-type",
                f"{slot} takes a list, '{value.text}' is {describe(value.type)}",
            )
        elif isinstance(value, Given) and not isinstance(value.value, (list, tuple)):
            self.findings.error(
                written, "value", f"{slot} takes a list", 'wire one: "{candidates.grasps}"'
            )
        if value is not None:
            self.found.settings[slot] = value

    def choice(self, slot: str, written: YamlNode) -> None:
        value = self.reader.value(slot, written, Port(object), self.around, slot)
        found = value.type if isinstance(value, ComputedValue) else None
        if isinstance(value, Given) and isinstance(written, YamlScalar):
            wire = _WIRE.fullmatch(written.text)
            found = (
                self.whole.scope.names[wire[1]].type if wire is not None else scalar_type(written)
            )
        if isinstance(found, Quantity):
            message = f"'{slot}' compares words, and this is {describe(found)}: a case has no unit"
            hint = 'compare it: {if: "{width} > 20 mm", then: …}'
            self.findings.error(written, "port-type", message, hint)
        if value is not None:
            self.found.settings[slot] = value

    def keep(self, slot: str, value: object, written: YamlNode) -> None:
        self.found.settings[slot] = Given(value, written)

    def check_ports(self, inputs: Mapping[str, Port], outputs: Mapping[str, Port]) -> None:
        node = self.node
        who = self.node.key.text
        reader = self.reader
        ports = dict(inputs.items())
        meant: set[str] = set()
        for name, (key, value) in node.ports.items():
            port = ports.get(name)
            if port is not None:
                read = reader.value(name, value, port, self.around, f"{who}.{name}")
                if read is not None:
                    self.found.inputs[name] = read
            elif name not in outputs:
                meant.add(self.unknown_port(key, value, inputs, outputs))
        if not (
            isinstance(node.value, YamlMapping)
            or (isinstance(node.value, YamlScalar) and node.value.is_null)
        ):
            message = f"{who} takes its ports as a mapping, this is {shape_of(node.value)}"
            self.findings.error(node.value, "shape", message, f"write '{who}: {{port: value}}'")
            return
        needed = (
            inputs.needed
            if isinstance(inputs, Ports)
            else [n for n, port in inputs.items() if port.required]
        )
        for name in needed:
            if name in node.ports or name in meant:
                continue
            of = inputs[name].type
            known = {name: named.type for name, named in self.whole.scope.names.items()}
            there = [f'"{{{name}}}"' for name in known if known[name] == of]
            writers = (
                self.whole.skills.giving(of, known.values())
                if isinstance(of, type) and of not in _SIMPLE
                else []
            )
            givers = list(dict.fromkeys(skill for skill, _ in writers[:2]))
            gives = (
                f": {' and '.join(givers)} {'writes' if len(givers) == 1 else 'write'} one"
                if givers
                else ""
            )
            message = f"{who} needs '{name}', {describe(static_type(inputs[name]))}{gives}"
            example = there[0] if there else f'"{{{writers[0][1]}}}"' if writers else "…"
            self.findings.error(node.key, "missing-port", message, f"write {name}: {example}")

    def unknown_port(
        self,
        key: YamlScalar,
        value: YamlNode,
        inputs: Mapping[str, Port],
        outputs: Mapping[str, Port],
    ) -> str:
        """Report a port that the node does not have; return the one that is meant, or an empty text."""
        node = self.node
        name = key.text
        who = self.node.key.text
        known = [*inputs, *outputs]
        modifier = self.whole.words.get(name)
        if modifier is not None and modifier.role == "modifier":
            self.findings.error(
                key,
                "unknown-port",
                f"'{name}' is a modifier: write it beside {who}, at column {node.key.column}, and not in it",
                edits=_moved_out(node, key, value),
            )
            return ""
        if report_removed(self.findings, key, "port", f"{who}.{name}"):
            return ""
        for new in [new for new, port in inputs.items() if port.was == name]:
            self.renamed_port(key, value, new)
            return new
        hint = did_you_mean(name, known)
        said = hint or f"ports of {who}: {', '.join(known) or 'none'}"
        self.findings.error(key, "unknown-port", f"{who} has no port '{name}'", said)
        return hint.right if isinstance(hint, Instead) else ""

    def renamed_port(self, key: YamlScalar, value: YamlNode, new: str) -> None:
        """Report a port with its former name; which of two values holds is the user's choice."""
        hint: str = Instead(f"it is called '{new}' now", key.text, new)
        if new in self.node.ports:
            other = self.node.ports[new][1]
            hint = f"keep {written(value)}, or {written(other)} of '{new}' in line {other.line}"
        self.findings.error(key, "removed", f"{self.node.key.text} has no port '{key.text}'", hint)

    # --------------------------------------------------------------------------------------- names

    def declare_output(
        self, slot: str, target: YamlScalar, written: YamlNode, element: bool
    ) -> None:
        quiet = ValueReader(Findings(), self.whole.scope, Resolved(self.node))
        value = quiet.value(slot, written, Port(object), self.around, slot)
        value_type: ValueType = value.type if isinstance(value, ComputedValue) else ANY
        if element:
            value_type = (
                element_type(value_type) if isinstance(value, ComputedValue) else None
            ) or ANY
        elif (
            isinstance(value, Given) and isinstance(written, YamlScalar) and "{" not in written.text
        ):
            value_type = scalar_type(written)
        self.found.outputs[slot] = target.text
        by = (
            f"{self.layer.key} of {self.node.label}"
            if self.layer.role == "modifier"
            else self.node.label
        )
        self.whole.writes(target, value_type, by, self.layer.key)

    def item(self) -> str:
        return next(iter(self.found.outputs.values()), "")

    def look_up_skill(self) -> None:
        skill = self.found.skill = self.whole.skill(self.node)
        if skill is not None:
            self.wired_outputs(skill.outputs)

    def look_up_subtree(self) -> None:
        """Find the subtree that the node calls, or report that there is none."""
        called = self.found.subtree = self.whole.called.get(id(self.node))
        if called is not None:
            self.wired_outputs(self.whole.interfaces[id(called)].outputs)
            return
        name = self.node.key.text
        if name in self.whole.scope.definition.file.unread:
            return
        if report_removed(self.findings, self.node.key, "node", name):
            return
        hint = self.whole.hint_for(self.node)
        hint = (
            hint
            or f"declare the subtree: 'subtrees: {{{name}: {{root: …}}}}', or with 'file: other.yaml' for a tree"
        )
        self.findings.error(
            self.node.key, "unknown-type-of-node", f"nothing is named '{name}'", hint
        )

    def wired_outputs(self, outputs: Mapping[str, Port]) -> None:
        """Read the wiring of the node's outputs."""
        known = dict(outputs.items())
        for name, (_, value) in self.node.ports.items():
            port = known.get(name)
            if port is not None:
                who = f"{self.node.key.text}.{name}"
                target = self.whole.output(value, who)
                if target is not None:
                    self.found.outputs[name] = target.text
                    self.whole.writes(target, static_type(port), self.node.label, who)

    def mark_outputs_unknown(self) -> None:
        found = self.found
        called = (
            self.whole.interfaces[id(found.subtree)] if found.subtree is not None else found.skill
        )
        known = {*called.inputs, *called.outputs} if called is not None else ()
        for name, (_, value) in self.node.ports.items():
            if name in known:
                continue
            match = _WIRE.fullmatch(value.text) if isinstance(value, YamlScalar) else None
            if match is not None:
                self.found.outputs[name] = match[1]
                named = self.whole.scope.names.setdefault(
                    match[1], Named(ANY, "written", value, self.node.label)
                )
                named.read = True

    def check_call(self) -> None:
        if self.found.skill is not None:
            self.check_ports(self.found.skill.inputs, self.found.skill.outputs)
            return
        if self.found.subtree is not None:
            interface = self.whole.interfaces[id(self.found.subtree)]
            self.check_ports(interface.inputs, interface.outputs)

    # --------------------------------------------------------------------------------------- what is inside

    def inside(self, around: Around) -> None:
        self.whole.layer(self.node, self.index + 1, around).check()

    def child(self, index: int, around: Around) -> None:
        """Check one child in its context."""
        self.whole.node(self.node.children[index], around)

    def part(self, slot: str, around: Around) -> None:
        self.whole.node(self.node.parts[slot], around)

    def devices(self, index: int) -> Mapping[str, str]:
        return self.whole.devices(self.node.children[index])


def _moved_out(node: TreeNode, key: YamlScalar, value: YamlNode) -> list[Edit]:
    """Return the edits that make a node's last port a modifier; none if more than that is necessary."""
    ports = node.value
    source = key.source
    if (
        not isinstance(ports, YamlMapping)
        or [*ports.entries][-1] != key.text
        or node.key.line != node.at.line
    ):
        return []
    if source.excerpt(ports.line)[ports.column - 1] != "{":
        return [*moved(source, key.line, node.key.column - key.column)]
    line = source.excerpt(key.line)
    if (
        ports.line != ports.end_line
        or line[ports.end_column - 1 :].strip()
        or source.excerpt(node.at.line)[node.at.column - 1] == "{"
    ):
        return []
    before = [entry[1].end_column for name, entry in ports.entries.items() if name != key.text]
    start = before[-1] if before else ports.column + 1
    beside = f"}}\n{' ' * (node.key.column - 1)}{line[key.column - 1 : ports.end_column - 2]}"
    return [Edit(key.line, start, ports.end_column - start, beside)]
