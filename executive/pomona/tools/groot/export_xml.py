"""Document → XML for Groot2 and BehaviorTree.CPP (version 4), with the model of every node."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from pomona.executive.language.expression import ExpressionSyntaxError, Reference, parse_expression
from pomona.executive.language.model import Declared, Definition, Document, TreeNode
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.ports import TIME, Port, type_name
from pomona.executive.registry import Registry, default_text
from pomona.executive.values.findings import Finding, Findings, TreeFileError
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar
from pomona.tools.groot.forms import form_of
from pomona.tools.groot.names import BUILTIN, LITERAL, PREFIX
from pomona.tools.groot.yaml_text import flow


def export_groot(document: Document, skills: Registry) -> str:
    """XML text.

    Raises TreeFileError: a name in the tree means something else to BehaviorTree.CPP, or the document has errors of
    shape.
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
        self.own: dict[str, tuple[NodeType, set[str]]] = {}
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
        return (
            '<?xml version="1.0" encoding="UTF-8"?>\n'
            + ElementTree.tostring(root, encoding="unicode")
            + "\n"
        )

    def unique(self, name: str) -> str:
        taken = set(self.ids.values())
        found, number = name, 1
        while found in taken:
            number += 1
            found = f"{name}_{number}"
        return found

    # ------------------------------------------------------------------------------------------- nodes

    def node(self, node: TreeNode, definition: Definition) -> Element:
        return self.layer(node, 0, definition)

    def layer(self, node: TreeNode, index: int, definition: Definition) -> Element:
        """Return the element of a node without its outer modifiers."""
        layer = node.layers[index]
        at = LayerXml(self, node, index, layer, definition)
        if not layer.needed(at) and layer.pauses(at) is None:
            return self.layer(node, index + 1, definition)
        element = form_of(layer).to_xml(at)
        if layer is node.type:
            if node.name is not None:
                element.set("name", node.name.text)
            described = node.description or node.comment
            if described:
                element.set("_description", described)
        return element

    def ports(self, node: TreeNode) -> dict[str, str]:
        found = {}
        for port, (key, value) in node.ports.items():
            if port in ("name", "ID") or port.startswith("_"):
                message = f"a port named '{port}' means something else to BehaviorTree.CPP"
                self.findings.error(key, "groot-name", message)
            found[port] = _attribute(value)
        return found

    # ------------------------------------------------------------------------------------------- models

    def models(self, parent: Element, definitions: list[Definition]) -> None:
        for name in sorted(self.used):
            skill = self.skills.get(name)
            if skill is None:
                model = SubElement(parent, "Action", {"ID": name})
                for unknown in self.used[name].ports:
                    SubElement(model, "inout_port", {"name": unknown})
                continue
            model = SubElement(
                parent, "Condition" if skill.__name__.startswith("Is") else "Action", {"ID": name}
            )
            for direction, ports in (("input_port", skill.inputs), ("output_port", skill.outputs)):
                for port_name, port in ports.items():
                    self.port(model, direction, port_name, port)
        for tag, (found, used) in sorted(self.own.items()):
            parts = any(taken.nodes for taken in found.fields.values())
            category = "Decorator" if found.role == "modifier" and not parts else "Control"
            model = SubElement(
                parent,
                category if found.role != "leaf" else "Condition" if found.ends else "Action",
                {"ID": tag},
            )
            for port_name in sorted(used):
                SubElement(model, "input_port", {"name": port_name}).text = found.summary
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
                    attributes["default"] = (
                        f"{{_{name}}}"  # BehaviorTree.CPP wants every port wired
                    )
                SubElement(model, direction, attributes).text = port.help
        metadata: dict[str, object] = (
            {"description": definition.description} if definition.description else {}
        )
        for key, declared in (
            ("parameters", parameters),
            ("constants", file.constants if definition.main else {}),
            ("in", definition.inputs),
            ("out", definition.outputs),
        ):
            if declared:
                metadata[key] = {name: _declaration(port) for name, port in declared.items()}
        fields = SubElement(model, "MetadataFields")
        SubElement(fields, "Metadata", {"pomona": json.dumps(metadata, ensure_ascii=False)})


@dataclass(frozen=True, slots=True)
class LayerXml:
    """One layer of a node being written."""

    exporter: _Exporter
    node: TreeNode
    index: int
    layer: NodeType
    definition: Definition

    def written(self, slot: str) -> YamlNode | None:
        entry = self.node.entry(self.layer, slot)
        return None if entry is None else entry[1]

    def literal(self, slot: str) -> object:
        text = self.text(slot)
        return {"true": True, "false": False}.get(text, text or None)

    def text(self, slot: str) -> str:
        """Return the text behind a word as an attribute; empty without one."""
        written = self.written(slot)
        return "" if written is None else _attribute(written)

    def plain(self, slot: str) -> bool:
        """Return True for a number or a wire, which BehaviorTree.CPP can read."""
        written = self.written(slot)
        return written is not None and _is_simple(written)

    def milliseconds(self, slot: str) -> str:
        """Return a literal duration in whole milliseconds, else an empty text."""
        written = self.written(slot)
        return "" if written is None else _milliseconds(written)

    def ports(self) -> dict[str, str]:
        """Return the ports as attributes."""
        return self.exporter.ports(self.node)

    def element(self, tag: str, attributes: Mapping[str, str] | None = None) -> Element:
        """Return an element of BehaviorTree.CPP that contains the inner nodes."""
        element = Element(tag, dict(attributes or {}))
        node, exporter = self.node, self.exporter
        if self.layer is node.type:
            element.extend(exporter.node(child, self.definition) for child in node.children)
            return element
        element.append(exporter.layer(node, self.index + 1, self.definition))
        parts = [node.parts[slot] for slot in self.layer.fields if slot in node.parts]
        element.extend(exporter.node(part, self.definition) for part in parts)
        return element

    def own(self, attributes: Mapping[str, str]) -> Element:
        """Return an element of Pomona; the file then holds its model."""
        given = {name: value for name, value in attributes.items() if value}
        tag = form_of(self.layer).own_tag
        _, ports = self.exporter.own.setdefault(tag, (self.layer, set()))
        ports.update(given)
        return self.element(tag, given)

    def skill(self) -> Element:
        """Return the element that calls the skill."""
        name = self.node.key.text
        if name in BUILTIN or name.startswith(PREFIX):
            message = f"'{name}' means something else to BehaviorTree.CPP"
            self.exporter.findings.error(
                self.node.key, "groot-name", message, "a skill with this name cannot be exported"
            )
        self.exporter.used.setdefault(name, self.node)
        return Element(name, self.ports())

    def subtree(self) -> Element:
        """Return the element that calls the subtree."""
        name = self.node.key.text
        called = self.definition.file.subtrees.get(name)
        called_id = name if called is None else self.exporter.ids.get(id(called), name)
        return Element("SubTree", {"ID": called_id, **self.ports()})


def _declaration(declared: Declared) -> object:
    if declared.type is None:
        return "" if declared.default is None else flow(_plain(declared.default))
    found: dict[str, object] = {"type": declared.type.text}
    nodes: Mapping[str, YamlNode | None] = {
        "default": declared.default,
        "min": declared.min,
        "max": declared.max,
    }
    found.update({key: flow(_plain(node)) for key, node in nodes.items() if node is not None})
    if declared.choices:
        found["choices"] = [choice.text for choice in declared.choices]
    if declared.help:
        found["help"] = declared.help
    return found


def _plain(node: YamlNode) -> object:
    """Return a YAML node as plain values, every scalar as its text."""
    if isinstance(node, YamlScalar):
        return None if node.is_null else node.text
    if isinstance(node, YamlList):
        return [_plain(item) for item in node.items]
    assert isinstance(node, YamlMapping)
    return {key.text: _plain(value) for key, value in node.entries.values()}


def _attribute(node: YamlNode) -> str:
    return node.text if isinstance(node, YamlScalar) else LITERAL + flow(_plain(node))


def _is_simple(node: YamlNode) -> bool:
    """Return True if BehaviorTree.CPP reads it as a number or a blackboard key."""
    text = _attribute(node).strip()
    if text.isdigit():
        return True
    try:
        found = parse_expression(text) if text.startswith("{") else None
    except ExpressionSyntaxError:
        return False
    return isinstance(found, Reference)


def _milliseconds(node: YamlNode) -> str:
    """Return a literal duration of whole milliseconds; an empty text for anything else."""
    try:
        milliseconds = TIME.parse(_attribute(node)) * 1e3
    except ValueError:
        return ""
    return (
        f"{milliseconds:.0f}"
        if 0 < milliseconds < 1e9 and abs(milliseconds - round(milliseconds)) < 1e-6
        else ""
    )
