"""Document → XML for Groot2 and BehaviorTree.CPP (version 4), with the model of every node."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from xml.etree.ElementTree import Element, SubElement

from executive.language.expression import Reference
from executive.language.expression_parser import ExpressionSyntaxError, parse_expression
from executive.language.groot_names import BRANCH_TO_XML, BUILTIN, LITERAL, MODELS, PREFIX
from executive.language.model import Declared, Definition, Document, TreeNode
from executive.ports import TIME, Port, type_name
from executive.registry import Registry, default_text
from executive.values.findings import Finding, Findings, TreeFileError
from executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar
from executive.values.yaml_text import flow


def export_groot(document: Document, skills: Registry) -> str:
    """XML text.

    Raises:
        TreeFileError: a name in the tree means something else to BehaviorTree.CPP, or the document has errors of shape.
    """
    errors = [finding for finding in document.findings if finding.severity == "error"]
    if errors or document.main.main is None:
        raise TreeFileError(errors)
    return _Exporter(document, skills).text()


class _Exporter:
    def __init__(self, document: Document, skills: Registry) -> None:
        self.document, self.skills = document, skills
        self.findings = Findings()
        self.ids: dict[int, str] = {}
        self.own: set[str] = set()
        self.used: dict[str, TreeNode] = {}

    def text(self) -> str:
        main = self.document.main.main
        assert main is not None
        definitions = [d for d in self.document.definitions() if d.root is not None]
        for definition in definitions:
            self.ids[id(definition)] = self.unique(definition.name)
        root = Element("root", {"BTCPP_format": "4", "main_tree_to_execute": self.ids[id(main)]})
        for definition in definitions:
            assert definition.root is not None
            tree = SubElement(root, "BehaviorTree", {"ID": self.ids[id(definition)]})
            tree.append(self.node(definition.root, definition))
        self.models(SubElement(root, "TreeNodesModel"), definitions)
        errors: list[Finding] = self.findings.sorted()
        if errors:
            raise TreeFileError(errors)
        ElementTree.indent(root, "  ")
        return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"

    def unique(self, name: str) -> str:
        taken = set(self.ids.values())
        found, number = name, 1
        while found in taken:
            number += 1
            found = f"{name}_{number}"
        return found

    # ------------------------------------------------------------------------------------------- nodes

    def node(self, node: TreeNode, definition: Definition) -> Element:
        element = self.bare(node, definition)
        if node.name is not None:
            element.set("name", node.name.text)
        described = node.description or node.comment
        if described:
            element.set("_description", described)
        for name in node.decorators:
            element = self.wrapped(node, name, element, definition)
        return element

    def ours(self, tag: str, **attributes: str) -> Element:
        self.own.add(PREFIX + tag)
        return Element(PREFIX + tag, {name: value for name, value in attributes.items() if value})

    def wrapped(self, node: TreeNode, name: str, inner: Element, definition: Definition) -> Element:
        value = node.modifiers[name][1]
        text = _attribute(value)
        match name:
            case "timeout":
                duration = _milliseconds(value)
                outer = Element("Timeout", {"msec": duration}) if duration else self.ours("Timeout", duration=text)
            case "invert":
                if text == "false":
                    return inner
                outer = Element("Inverter")
            case "force":
                outer = Element("ForceFailure" if text == "failure" else "ForceSuccess")
            case "repeat":
                if text == "forever":
                    outer = Element("Repeat", {"num_cycles": "-1"})
                else:
                    simple = _is_simple(value)
                    outer = Element("Repeat", {"num_cycles": text}) if simple else self.ours("Repeat", rounds=text)
            case "retry":
                outer = self.retry(node, text)
            case "for_each":
                item = _attribute(node.modifiers["as"][1]) if "as" in node.modifiers else "item"
                outer = self.ours("ForEach", items=text, item=f"{{{item}}}")
            case _:
                outer = self.ours(name.capitalize(), condition=text)
        outer.append(inner)
        if name == "retry" and node.on_failure is not None:
            outer.append(self.node(node.on_failure, definition))
        return outer

    def retry(self, node: TreeNode, text: str) -> Element:
        more = "retry_if" in node.modifiers or node.on_failure is not None
        if more or not _is_simple(node.modifiers["retry"][1]):
            retry_if = _attribute(node.modifiers["retry_if"][1]) if "retry_if" in node.modifiers else ""
            return self.ours("Retry", attempts=text, retry_if=retry_if)
        return Element("RetryUntilSuccessful", {"num_attempts": text})

    def bare(self, node: TreeNode, definition: Definition) -> Element:
        kind = node.kind
        if kind in BRANCH_TO_XML:
            element = Element(BRANCH_TO_XML[kind])
        elif kind == "parallel":
            element = self.parallel(node)
        elif kind == "recovery":
            attempts = _attribute(node.modifiers["attempts"][1]) if "attempts" in node.modifiers else "2"
            element = self.ours("Recovery", attempts=attempts)
        elif kind == "subtree":
            called = definition.file.subtrees.get(node.key.text)
            called_id = node.key.text if called is None else self.ids.get(id(called), node.key.text)
            element = Element("SubTree", {"ID": called_id, **self.ports(node)})
        elif kind == "skill":
            element = self.skill(node)
        else:
            element = self.leaf(node)
        element.extend(self.node(child, definition) for child in node.children)
        return element

    def parallel(self, node: TreeNode) -> Element:
        success_on = _attribute(node.modifiers["success_on"][1]) if "success_on" in node.modifiers else "all"
        if success_on not in ("all", "one"):
            return self.ours("Parallel", success_on=success_on)
        return Element("Parallel", {"success_count": "-1" if success_on == "all" else "1", "failure_count": "1"})

    def skill(self, node: TreeNode) -> Element:
        name = node.key.text
        if name in BUILTIN or name.startswith(PREFIX):
            message = f"'{name}' means something else to BehaviorTree.CPP"
            self.findings.error(node.key, "groot-name", message, "a skill with this name cannot be exported")
        self.used.setdefault(name, node)
        return Element(name, self.ports(node))

    def ports(self, node: TreeNode) -> dict[str, str]:
        found = {}
        for port, (key, value) in node.ports.items():
            if port in ("name", "ID") or port.startswith("_"):
                message = f"a port named '{port}' means something else to BehaviorTree.CPP"
                self.findings.error(key, "groot-name", message)
            found[port] = _attribute(value)
        return found

    def leaf(self, node: TreeNode) -> Element:
        match node.kind:
            case "check":
                return self.ours("Check", condition=_attribute(node.value))
            case "wait_until":
                return self.ours("WaitUntil", condition=_attribute(node.value))
            case "wait":
                duration = _milliseconds(node.value)
                text = _attribute(node.value)
                return Element("Sleep", {"msec": duration}) if duration else self.ours("Wait", duration=text)
            case "set":
                return self.ours("Set", values=LITERAL + flow(_plain(node.value)))
            case "fail":
                if not node.ports:
                    return Element("AlwaysFailure")
                return self.ours("Fail", **self.ports(node))
            case _:
                return Element("AlwaysSuccess")

    # ------------------------------------------------------------------------------------------- models

    def models(self, parent: Element, definitions: list[Definition]) -> None:
        for name in sorted(self.used):
            skill = self.skills.get(name)
            if skill is None:
                model = SubElement(parent, "Action", {"ID": name})
                for unknown in self.used[name].ports:
                    SubElement(model, "inout_port", {"name": unknown})
                continue
            model = SubElement(parent, "Condition" if skill.__name__.startswith("Is") else "Action", {"ID": name})
            for direction, ports in (("input_port", skill.inputs), ("output_port", skill.outputs)):
                for port_name, port in ports.items():
                    self.port(model, direction, port_name, port)
        for name in sorted(self.own):
            category, inputs, description = MODELS[name]
            model = SubElement(parent, category, {"ID": name})
            for port_name in inputs:
                SubElement(model, "input_port", {"name": port_name}).text = description
        for definition in definitions:
            self.subtree_model(parent, definition)

    @staticmethod
    def port(model: Element, direction: str, name: str, port: Port) -> None:
        attributes = {"name": name, "type": type_name(port.type)}
        if not port.required and port.default is not None:
            attributes["default"] = default_text(port)
        SubElement(model, direction, attributes).text = port.help

    def subtree_model(self, parent: Element, definition: Definition) -> None:
        model = SubElement(parent, "SubTree", {"ID": self.ids[id(definition)]})
        file = definition.file
        parameters = file.parameters if definition.main else {}
        for direction, declared in (
            ("input_port", {**parameters, **definition.inputs}),
            ("output_port", definition.outputs),
        ):
            for name, port in declared.items():
                attributes = {"name": name, "type": port.type.text if port.type is not None else ""}
                if port.default is not None:
                    attributes["default"] = _attribute(port.default) or "none"
                elif direction == "output_port":
                    attributes["default"] = f"{{_{name}}}"  # BehaviorTree.CPP wants every port wired
                SubElement(model, direction, attributes).text = port.help
        told: dict[str, object] = {"description": definition.description} if definition.description else {}
        for key, declared in (
            ("parameters", parameters),
            ("constants", file.constants if definition.main else {}),
            ("in", definition.inputs),
            ("out", definition.outputs),
        ):
            if declared:
                told[key] = {name: _declaration(port) for name, port in declared.items()}
        fields = SubElement(model, "MetadataFields")
        SubElement(fields, "Metadata", {"pomona": json.dumps(told, ensure_ascii=False)})


def _declaration(declared: Declared) -> object:
    if declared.type is None:
        return "" if declared.default is None else flow(_plain(declared.default))
    found: dict[str, object] = {"type": declared.type.text}
    nodes: Mapping[str, YamlNode | None] = {"default": declared.default, "min": declared.min, "max": declared.max}
    found.update({key: flow(_plain(node)) for key, node in nodes.items() if node is not None})
    if declared.choices:
        found["choices"] = [choice.text for choice in declared.choices]
    if declared.help:
        found["help"] = declared.help
    return found


def _plain(node: YamlNode) -> object:
    """A YAML node as plain values, every scalar as its text."""
    if isinstance(node, YamlScalar):
        return None if node.is_null else node.text
    if isinstance(node, YamlList):
        return [_plain(item) for item in node.items]
    assert isinstance(node, YamlMapping)
    return {key.text: _plain(value) for key, value in node.entries.values()}


def _attribute(node: YamlNode) -> str:
    return node.text if isinstance(node, YamlScalar) else LITERAL + flow(_plain(node))


def _is_simple(node: YamlNode) -> bool:
    """Whether BehaviorTree.CPP reads it as a number or a blackboard key."""
    text = _attribute(node).strip()
    if text.isdigit():
        return True
    try:
        found = parse_expression(text) if text.startswith("{") else None
    except ExpressionSyntaxError:
        return False
    return isinstance(found, Reference)


def _milliseconds(node: YamlNode) -> str:
    """A literal duration of whole milliseconds; an empty text for anything else."""
    try:
        milliseconds = TIME.parse(_attribute(node)) * 1e3
    except ValueError:
        return ""
    return f"{milliseconds:.0f}" if 0 < milliseconds < 1e9 and abs(milliseconds - round(milliseconds)) < 1e-6 else ""
