"""The nodes of one definition: skills, ports, modifiers, one by one."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from executive.language.failures import Failures
from executive.language.interface import PortDeclared
from executive.language.literals import scalar_type
from executive.language.model import BRANCHES, LEAVES, Definition, TreeNode
from executive.language.scope import Computed, Given, Named, Resolved, Scope
from executive.language.value_types import ANY, ValueType, can_flow, describe, element_type
from executive.language.values import Around, ValueReader, static_type
from executive.ports import TIME, Port
from executive.registry import Registry
from executive.skill import Skill
from executive.values.findings import Findings, did_you_mean
from executive.values.yaml_nodes import YamlList, YamlNode, YamlScalar

_WIRE = re.compile(r"\s*\{\s*([A-Za-z_][A-Za-z0-9_]*)\s*\}\s*")
_NAME = re.compile(r"[a-z][a-z0-9_]*")
_DURATION = Port(TIME, min="0 s")
_COUNT = Port(int, min=1)


@dataclass(slots=True, eq=False)
class NodeChecker:
    """Looks up every name in one definition's nodes; fills `scope` with what they write and `resolved`."""

    findings: Findings
    skills: Registry
    scope: Scope
    called: Mapping[int, Definition]
    failures: Failures
    interfaces: Mapping[int, PortDeclared]
    resolved: dict[int, Resolved]
    devices: tuple[type, ...] | None
    named: dict[str, YamlScalar] = field(default_factory=dict)

    def definition(self, root: TreeNode) -> None:
        nodes = list(root.walk())
        for node in nodes:
            self.resolved[id(node)] = Resolved(node)
            self.lookup(node)
        for node in nodes:
            self.later_writers(node)
        for node in nodes:
            self.perhaps_writes(node)
        self.visit(root, Around(), "")

    # --------------------------------------------------------------------------------------- who writes what

    def lookup(self, node: TreeNode) -> None:
        """Find the skill or subtree, and note the outputs that are wired."""
        found = self.resolved[id(node)]
        if node.name is not None:
            first = self.named.setdefault(node.name.text, node.name)
            if first is not node.name:
                message = f"'{node.name.text}' is the name of another node already (line {first.line})"
                self.findings.error(node.name, "duplicate-name", message)
        outputs: Mapping[str, Port] = {}
        if node.kind == "skill":
            found.skill = self.skill(node)
            outputs = found.skill.outputs if found.skill is not None else {}
        elif node.kind == "subtree":
            found.subtree = self.called.get(id(node))
            if found.subtree is None:
                hint = did_you_mean(node.key.text, [*self.known_types(), *self.skills])
                self.findings.error(node.key, "unknown-type-of-node", f"nothing is named '{node.key.text}'", hint)
            else:
                outputs = self.interfaces[id(found.subtree)].outputs
        for name, (_, value) in node.ports.items():
            if name in outputs:
                target = self.output(value, f"{node.key.text}.{name}")
                if target is not None:
                    found.outputs[name] = target.text
                    self.writes(target, static_type(outputs[name]), node.label, f"{node.key.text}.{name}")

    def known_types(self) -> tuple[str, ...]:
        return (*BRANCHES, *LEAVES, *self.scope.definition.file.subtrees)

    def skill(self, node: TreeNode) -> type[Skill] | None:
        name = node.key.text
        skill = self.skills.get(name)
        if skill is None:
            if name in self.skills.problems:
                self.findings.error(node.key, "broken-skill", f"skill '{name}': {self.skills.problems[name]}")
            else:
                hint = did_you_mean(name, [*self.skills, *self.known_types()])
                hint = hint or "'pomona skills' lists what is installed"
                self.findings.error(node.key, "unknown-skill", f"no skill named '{name}'", hint)
            return None
        if self.devices is not None:
            for interface in skill.devices:
                if not any(interface in has.__mro__ for has in self.devices):
                    message = f"{name} needs a {interface.__name__}, which the cell does not have"
                    self.findings.error(node.key, "no-device", message)
        return skill

    def output(self, value: YamlNode, who: str) -> YamlScalar | None:
        """The name to which an output is wired, as a scalar at its place."""
        match = _WIRE.fullmatch(value.text) if isinstance(value, YamlScalar) else None
        if match is None or not isinstance(value, YamlScalar):
            self.findings.error(value, "output", f"{who} is an output", 'wire it to a name: "{name}"')
            return None
        return YamlScalar(
            value.source, value.line, value.column, value.end_line, value.end_column, match[1], value.plain
        )

    def writes(self, target: YamlScalar, value_type: ValueType, by: str, who: str) -> None:
        name = target.text
        known = self.scope.names.get(name)
        if known is None:
            if not _NAME.fullmatch(name):
                self.findings.error(
                    target, "bad-name", f"'{name}' is no name for a port", "use small letters, digits and _"
                )
            self.scope.names[name] = Named(value_type, "written", target, by)
        elif known.origin != "written":
            message = f"{who} cannot write '{name}': it is {known.by} (line {known.where.line})"
            self.findings.error(target, "read-only", message, "give the output a name of its own")
        elif not can_flow(value_type, known.type):
            message = f"{who} writes {describe(value_type)} to '{name}', which is {describe(known.type)}"
            self.findings.error(target, "port-type", f"{message} (written by {known.by}, line {known.where.line})")

    def later_writers(self, node: TreeNode) -> None:
        """`for_each` and `set` write what an expression gives: their types follow from the skills' outputs."""
        found = self.resolved[id(node)]
        quiet = ValueReader(Findings(), self.scope, Resolved(node))
        everything = Around(True, True, True, frozenset())
        if "for_each" in node.modifiers:
            value = quiet.value("for_each", node.modifiers["for_each"][1], Port(object), everything, "for_each")
            item_type = element_type(value.type) if isinstance(value, Computed) else ANY
            name = self.item_name(node)
            if name is not None:
                found.outputs["for_each"] = name.text
                self.writes(name, item_type or ANY, f"for_each of {node.label}", "for_each")
        if node.kind == "set":
            for key, written in node.ports.values():
                value = quiet.value(key.text, written, Port(object), everything, key.text)
                value_type: ValueType = value.type if isinstance(value, Computed) else ANY
                if isinstance(value, Given) and isinstance(written, YamlScalar) and "{" not in written.text:
                    value_type = scalar_type(written)
                found.outputs[key.text] = key.text
                self.writes(key, value_type, node.label, "set")

    def perhaps_writes(self, node: TreeNode) -> None:
        """A skill that cannot be looked up may write whatever is wired to it: one mistake, one finding."""
        found = self.resolved[id(node)]
        if node.kind not in ("skill", "subtree") or found.skill is not None or found.subtree is not None:
            return
        for name, (_, value) in node.ports.items():
            match = _WIRE.fullmatch(value.text) if isinstance(value, YamlScalar) else None
            if match is not None:
                found.outputs[name] = match[1]
                named = self.scope.names.setdefault(match[1], Named(ANY, "written", value, node.label))
                named.read = True

    def item_name(self, node: TreeNode) -> YamlScalar | None:
        if "as" not in node.modifiers:
            key = node.modifiers["for_each"][0]
            return YamlScalar(key.source, key.line, key.column, key.end_line, key.end_column, "item", True)
        name = node.modifiers["as"][1]
        if isinstance(name, YamlScalar) and _NAME.fullmatch(name.text):
            return name
        self.findings.error(name, "bad-name", "'as' takes a name without braces", "as: grasp")
        return None

    # --------------------------------------------------------------------------------------- node by node

    def visit(self, node: TreeNode, around: Around, parent: str) -> None:
        found = self.resolved[id(node)]
        reader = ValueReader(self.findings, self.scope, found)
        inside = self.modifiers(node, found, reader, around)
        self.ports(node, found, reader, inside)
        sight = inside.failure
        for index, child in enumerate(node.children):
            if node.kind in ("fallback", "reactive_fallback") and index > 0:
                before = node.children[index - 1]
                codes = self.failures.of(before, "")
                sight = codes | (sight or frozenset()) if "when" in before.modifiers else codes
                if not self.failures.of(before, node.kind):
                    message = f"{child.label} is never reached: {before.label} cannot fail"
                    self.findings.warning(child.key, "unreachable", message)
            if node.kind == "recovery":
                failure = self.failures.of(node.children[0]) if index == 1 else inside.failure
                self.visit(child, replace(inside, retry=True, failure=failure), node.kind)
            else:
                self.visit(child, replace(inside, failure=sight), node.kind)

    def modifiers(self, node: TreeNode, found: Resolved, reader: ValueReader, around: Around) -> Around:
        """Read all modifiers from the outside to the inside; what is around the node itself."""
        given = {name: value for name, (_, value) in node.modifiers.items()}
        for name in ("when", "guard"):
            if name in given:
                self.keep(found, name, reader.condition(name, given[name], around))
        if "for_each" in given:
            self.for_each(found, reader, given["for_each"], around)
            item = found.outputs.get("for_each", "")
            if item in around.items:
                message = f"the for_each around this one has an '{item}' as well"
                key = node.modifiers.get("as", node.modifiers["for_each"])[0]
                self.findings.error(key, "duplicate-name", message, "name this one: 'as: other'")
            around = replace(around, for_each=True, items=around.items | {item})
        if "repeat" in given:
            repeat = given["repeat"]
            if isinstance(repeat, YamlScalar) and repeat.text == "forever":
                found.settings["repeat"] = Given(None, repeat)
            else:
                self.keep(found, "repeat", reader.value("repeat", repeat, _COUNT, around, "repeat"))
            around = replace(around, repeat=True)
        if "retry" in given:
            around = self.retry(node, found, reader, around)
        if "timeout" in given:
            self.keep(found, "timeout", reader.value("timeout", given["timeout"], _DURATION, around, "timeout"))
        if "invert" in given:
            self.keep(found, "invert", reader.value("invert", given["invert"], Port(bool), around, "invert"))
        if "force" in given:
            port = Port(str, choices=("success", "failure"))
            self.keep(found, "force", reader.value("force", given["force"], port, around, "force"))
        return around

    @staticmethod
    def keep(found: Resolved, name: str, value: Given | Computed | None) -> None:
        if value is not None:
            found.settings[name] = value

    def for_each(self, found: Resolved, reader: ValueReader, written: YamlNode, around: Around) -> None:
        value = reader.value("for_each", written, Port(object), around, "for_each")
        if isinstance(value, Computed) and element_type(value.type) is None:
            message = f"for_each takes a list, '{value.text}' is {describe(value.type)}"
            self.findings.error(written, "port-type", message)
        elif isinstance(value, Given) and not isinstance(value.value, (list, tuple)):
            self.findings.error(written, "value", "for_each takes a list", 'wire one: "{candidates.grasps}"')
        self.keep(found, "for_each", value)

    def retry(self, node: TreeNode, found: Resolved, reader: ValueReader, around: Around) -> Around:
        key, written = node.modifiers["retry"]
        self.keep(found, "retry", reader.value("retry", written, _COUNT, around, "retry"))
        codes = self.failures.before_retry(node)
        if not codes:
            message = f"'retry' around {node.label}, which cannot fail"
            self.findings.warning(key, "cannot-fail", message, "leave the retry out")
        inside = replace(around, retry=True)
        after = replace(inside, failure=codes)
        if "retry_if" in node.modifiers:
            self.keep(found, "retry_if", reader.condition("retry_if", node.modifiers["retry_if"][1], after))
        if node.on_failure is not None:
            self.visit(node.on_failure, after, "retry")
        return inside

    def ports(self, node: TreeNode, found: Resolved, reader: ValueReader, around: Around) -> None:
        match node.kind:
            case "skill" if found.skill is not None:
                self.inputs(node, found, reader, around, found.skill.inputs, found.skill.outputs)
            case "subtree" if found.subtree is not None:
                interface = self.interfaces[id(found.subtree)]
                self.inputs(node, found, reader, around, interface.inputs, interface.outputs)
            case "set":
                if not node.ports:
                    self.findings.error(node.key, "shape", "'set' sets nothing", "write 'set: {name: value}'")
                for key, value in node.ports.values():
                    read = reader.value(key.text, value, Port(object), around, f"set.{key.text}")
                    if read is not None:
                        found.inputs[key.text] = read
            case "check" | "wait_until":
                self.keep(found, node.kind, reader.condition(node.kind, node.value, around))
            case "wait":
                self.keep(found, "wait", reader.value("wait", node.value, _DURATION, around, "wait"))
            case "fail":
                ports = {"code": Port(str, default="FAILED"), "message": Port(str, default="")}
                self.inputs(node, found, reader, around, ports, {})
            case "parallel":
                self.parallel(node, found)
            case "recovery" if "attempts" in node.modifiers:
                attempts = node.modifiers["attempts"][1]
                self.keep(found, "attempts", reader.value("attempts", attempts, _COUNT, around, "attempts"))

    def inputs(
        self,
        node: TreeNode,
        found: Resolved,
        reader: ValueReader,
        around: Around,
        inputs: Mapping[str, Port],
        outputs: Mapping[str, Port],
    ) -> None:
        who = node.key.text
        for name, (key, value) in node.ports.items():
            if name in inputs:
                read = reader.value(name, value, inputs[name], around, f"{who}.{name}")
                if read is not None:
                    found.inputs[name] = read
            elif name not in outputs:
                known = [*inputs, *outputs]
                renamed = [f"it is called '{new}' now" for new, port in inputs.items() if port.was == name]
                hint = "".join(renamed) or did_you_mean(name, known) or f"ports of {who}: {', '.join(known) or 'none'}"
                self.findings.error(key, "unknown-port", f"{who} has no port '{name}'", hint)
        missing = [name for name, port in inputs.items() if port.required and name not in node.ports]
        for name in missing:
            message = f"{who} needs '{name}', {describe(static_type(inputs[name]))}"
            self.findings.error(node.key, "missing-port", message, f'wire it: {name}: "{{…}}"')

    def parallel(self, node: TreeNode, found: Resolved) -> None:
        if "success_on" not in node.modifiers:
            return
        for child in node.children:
            if "when" in child.modifiers:
                message = "a child that is skipped counts as succeeded, which would end this parallel at once"
                hint = "put it into a sequence behind a 'check', or let the parallel succeed on all"
                self.findings.warning(child.modifiers["when"][0], "skipped-success", message, hint)
        written = node.modifiers["success_on"][1]
        labels = [child.label for child in node.children]
        if isinstance(written, YamlScalar) and written.text in ("all", "one"):
            found.settings["success_on"] = Given(written.text, written)
        elif isinstance(written, YamlList) and written.items:
            for item in written.items:
                if not isinstance(item, YamlScalar) or item.text not in labels:
                    hint = "children: " + ", ".join(labels)
                    self.findings.error(item, "value", "success_on names children of this parallel", hint)
            names = tuple(item.text for item in written.items if isinstance(item, YamlScalar))
            found.settings["success_on"] = Given(names, written)
        else:
            self.findings.error(written, "value", "success_on is 'all', 'one', or a list of children")
