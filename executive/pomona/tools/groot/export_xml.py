"""Document → XML for Groot2 and BehaviorTree.CPP (version 4), with the model of every node.

Words that BehaviorTree.CPP lacks become nodes whose names begin with `Pomona`, so that Groot2 draws them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

from pomona.executive.language.expression import ExpressionSyntaxError, Reference, parse_expression
from pomona.executive.language.model import Definition, Document, TreeNode
from pomona.executive.nodes.check import CheckType
from pomona.executive.nodes.choosing import SwitchType
from pomona.executive.nodes.leaves import SKILL, SUBTREE
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.ports import TIME, Port, type_name
from pomona.executive.registry import Registry, default_text
from pomona.executive.values.findings import Findings, TreeFileError
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar
from pomona.tools.groot.elements import READERS
from pomona.tools.groot.names import COMPOSITES, LITERAL, NO_SKILLS, PREFIX, free_name
from pomona.tools.groot.yaml_text import Written, to_yaml

_TAGS = {word: tag for tag, word in reversed(COMPOSITES.items())}
_DURATIONS = {
    "wait": ("Sleep", "msec"),
    "delay": ("Delay", "delay_msec"),
    "timeout": ("Timeout", "msec"),
}


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
        self.document = document
        self.skills = skills
        self.findings = Findings()
        self.ids: dict[int, str] = {}
        self.own: dict[
            str, tuple[NodeType, set[str]]
        ] = {}  # Pomona's own words that are used, with attributes
        self.used: dict[str, TreeNode] = {}

    def text(self) -> str:
        main = self.document.main.main
        for definition in self.document.definitions():
            taken = set(self.ids.values())
            self.ids[id(definition)] = free_name(definition.name, taken.__contains__, "_")
        head = {"BTCPP_format": "4", "main_tree_to_execute": self.ids[id(main)]}
        root = Element("root", head)
        for definition in self.document.definitions():
            if definition.root is not None:
                tree = SubElement(root, "BehaviorTree", {"ID": self.ids[id(definition)]})
                tree.append(self.layer(definition.root, 0, definition))
        self.models(SubElement(root, "TreeNodesModel"))
        errors = self.findings.sorted()
        if errors:
            raise TreeFileError(errors)
        ElementTree.indent(root, "  ")
        text = ElementTree.tostring(root, encoding="unicode")
        return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'

    # ------------------------------------------------------------------------------------------- nodes

    def layer(self, node: TreeNode, index: int, definition: Definition) -> Element:
        """Return the element of a node without its outer modifiers."""
        layer = node.layers[index]
        at = LayerXml(node, layer)
        if not layer.needed(at) and layer.pauses(at) is None:
            return self.layer(node, index + 1, definition)
        if layer is SKILL:
            tag = self.skill(node)
            attributes = self.ports(node)
        elif layer is SUBTREE:
            called = definition.file.subtrees.get(node.key.text)
            name = node.key.text if called is None else self.ids[id(called)]
            tag = "SubTree"
            attributes = {"ID": name, **self.ports(node)}
        else:
            tag, attributes = at.native() or self.pomona(at)
        element = Element(tag, attributes)
        inner = node.children
        if layer is not node.type:
            element.append(self.layer(node, index + 1, definition))
            inner = [node.parts[slot] for slot in layer.fields if slot in node.parts]
        element.extend(self.layer(child, 0, definition) for child in inner)
        if layer is node.type:
            if node.name is not None:
                element.set("name", node.name.text)
            described = node.description or node.comment
            if described:
                element.set("_description", described)
        return element

    def skill(self, node: TreeNode) -> str:
        """Return the tag that calls the skill."""
        name = node.key.text
        if name in READERS or name in NO_SKILLS or name == "SubTree" or name.startswith(PREFIX):
            message = f"'{name}' means something else to BehaviorTree.CPP"
            hint = "a skill with this name cannot be exported"
            self.findings.error(node.key, "groot-name", message, hint)
        self.used.setdefault(name, node)
        return name

    def ports(self, node: TreeNode) -> dict[str, str]:
        for port, (key, _) in node.ports.items():
            if port in ("name", "ID") or port.startswith("_"):
                message = f"a port named '{port}' means something else to BehaviorTree.CPP"
                self.findings.error(key, "groot-name", message)
        return {port: _attribute(value) for port, (_, value) in node.ports.items()}

    def pomona(self, at: LayerXml) -> tuple[str, dict[str, str]]:
        """Return a node of Pomona's own, with its words as attributes; the file then holds its model."""
        words = {
            "value" if slot == at.layer.key else slot: at.text(slot)
            for slot, taken in at.layer.slots.items()
            if not (taken.nodes or taken.wires)
        }
        if at.layer.value.wires:
            words.update(self.ports(at.node))
        attributes = {name: text for name, text in words.items() if text}
        tag = PREFIX + "".join(part.capitalize() for part in at.layer.key.split("_"))
        self.own.setdefault(tag, (at.layer, set()))[1].update(attributes)
        return tag, attributes

    # ------------------------------------------------------------------------------------------- models

    def models(self, parent: Element) -> None:
        for name, node in sorted(self.used.items()):
            skill = self.skills.get(name)
            if skill is None:
                model = SubElement(parent, "Action", {"ID": name})
                for unknown in node.ports:
                    SubElement(model, "inout_port", {"name": unknown})
                continue
            is_condition = skill.__name__.startswith("Is")
            model = SubElement(parent, "Condition" if is_condition else "Action", {"ID": name})
            for port_name, port in skill.inputs.items():
                _port(model, "input_port", port_name, port)
            for port_name, port in skill.outputs.items():
                _port(model, "output_port", port_name, port)
        for tag, (layer, used) in sorted(self.own.items()):
            parts = any(taken.nodes for taken in layer.fields.values())
            category = "Decorator" if layer.role == "modifier" and not parts else "Control"
            if layer.role == "leaf":
                category = "Condition" if layer.ends else "Action"
            model = SubElement(parent, category, {"ID": tag})
            for port_name in sorted(used):
                SubElement(model, "input_port", {"name": port_name}).text = layer.summary


@dataclass(frozen=True, slots=True)
class LayerXml:
    """One layer of a node being written."""

    node: TreeNode
    layer: NodeType

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

    def native(self) -> tuple[str, dict[str, str]] | None:
        """Return the element of BehaviorTree.CPP that means the same, with its attributes; None without one."""
        word = self.layer.key
        node = self.node
        text = self.text(word)
        if word in _TAGS:
            return _TAGS[word], {}
        if word in _DURATIONS:
            tag, attribute = _DURATIONS[word]
            milliseconds = _milliseconds(text)
            return (tag, {attribute: milliseconds}) if milliseconds else None
        match word:
            case "succeed":
                return "AlwaysSuccess", {}
            case "set" if len(node.ports) == 1:
                ((name, (_, value)),) = node.ports.items()
                if isinstance(value, YamlScalar) and (
                    _is_simple(value.text) or "{" not in value.text
                ):
                    return "SetBlackboard", {"output_key": name, "value": value.text}
            case "fail" if not node.ports:
                return "AlwaysFailure", {}
            case "invert":
                return "Inverter", {}
            case "run_once":
                return "RunOnce", {}
            case "force" if text in ("success", "failure"):
                return f"Force{text.capitalize()}", {}
            case "repeat" if text == "forever" or _is_simple(text):
                return "Repeat", {"num_cycles": "-1" if text == "forever" else text}
            case "retry" if (
                _is_simple(text) and not self.layer.fields.keys() & node.modifiers.keys()
            ):
                return "RetryUntilSuccessful", {"num_attempts": text}
            case "if" if len(node.children) == 3:
                return "IfThenElse", {}
            case "reactive_if" if len(node.children) == 3 and _asks_at_once(node.children[0]):
                return "WhileDoElse", {}
            case "parallel":
                success_on = self.text("success_on") or "all"
                count = {"all": "-1", "one": "1"}.get(success_on, success_on)
                if count.removeprefix("-").isdecimal():
                    return "Parallel", {"success_count": count, "failure_count": "1"}
        if isinstance(self.layer, SwitchType):
            words = self.layer.words(self)
            if 2 <= len(words) <= 6 and self.layer.has_default(self) and _is_simple(text):
                cases = {f"case_{number}": case for number, case in enumerate(words, start=1)}
                return f"Switch{len(words)}", {"variable": text, **cases}
        return None


def _asks_at_once(asked: TreeNode) -> bool:
    return asked.kind == CheckType.key and not asked.modifiers


def _port(model: Element, direction: str, name: str, port: Port) -> None:
    attributes = {"name": name, "type": type_name(port.type)}
    if not port.required and port.default is not None:
        attributes["default"] = default_text(port)
    SubElement(model, direction, attributes).text = port.help


def _plain(node: YamlNode) -> object:
    """Return a YAML node as plain values, every scalar as its text."""
    if isinstance(node, YamlScalar):
        return None if node.is_null else Written(node.text)
    if isinstance(node, YamlList):
        return [_plain(item) for item in node.items]
    assert isinstance(node, YamlMapping)
    return {key.text: _plain(value) for key, value in node.entries.values()}


def _attribute(node: YamlNode) -> str:
    if isinstance(node, YamlScalar):
        return node.text
    return LITERAL + to_yaml(_plain(node), flow=True).strip()


def _is_simple(text: str) -> bool:
    """Return True if BehaviorTree.CPP reads it as a number or a blackboard key."""
    if text.isdigit():
        return True
    try:
        found = parse_expression(text) if text.startswith("{") else None
    except ExpressionSyntaxError:
        return False
    return isinstance(found, Reference)


def _milliseconds(text: str) -> str:
    """Return a literal duration of whole milliseconds; an empty text for anything else."""
    try:
        milliseconds = TIME.parse(text) * 1e3
    except ValueError:
        return ""
    is_whole = 0 < milliseconds < 1e9 and abs(milliseconds - round(milliseconds)) < 1e-6
    return f"{milliseconds:.0f}" if is_whole else ""
