"""XML of Groot2 and BehaviorTree.CPP (version 4) → the text of a tree file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from executive.language.expression import SPECIAL
from executive.language.groot_names import BUILTIN, LITERAL
from executive.language.groot_scripts import ScriptError, assignments_of, condition_of
from executive.language.xml_nodes import XmlElement, read_xml
from executive.nodes.asking import Words
from executive.nodes.calls import SKILL
from executive.nodes.catalogue import NodeTypes
from executive.ports import TIME
from executive.values.findings import Finding, Findings, Source
from executive.values.yaml_text import Flow, block

_ATTRIBUTES = ("name", "ID", "_description", "_autoremap", "_fullpath", "_uid")
_LOOPS = ("LoopInt", "LoopDouble", "LoopBool", "LoopString")
_PRECONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
"""In the order in which BehaviorTree.CPP looks at them."""
_NAME = re.compile(r"[a-z][a-z0-9_]*")
_KEYS = re.compile(r"(?:\{|output_key=[\"']\{?)(\w+)")
_ASSIGNED = re.compile(r"\b([A-Za-z_]\w*)\s*(?::=|[-+*/]=)")
"""A plain `=` gives a value only to what has been written elsewhere; attributes have it, too."""


def import_groot(text: str, path: str | Path, types: NodeTypes | None = None) -> tuple[str, list[Finding]]:
    """The text of a tree file, and what could not be translated. The text is empty when there is nothing to translate.

    Raises nothing. Check the text before you run it: other people's nodes may not be installed as skills here.
    """
    findings = Findings()
    root = read_xml(Source(str(path), text), findings)
    if root is None:
        return "", findings.sorted()
    if root.tag != "root":
        findings.error(root, "xml", "the file is not BehaviorTree.CPP's: its first element is not <root>")
        return "", findings.sorted()
    if root.get("BTCPP_format") != "4":
        findings.error(root, "version", 'only version 4 of the format is read: <root BTCPP_format="4">')
        return "", findings.sorted()
    return _Importer(findings, types or NodeTypes.installed()).file(root), findings.sorted()


class _Importer:
    def __init__(self, findings: Findings, types: NodeTypes) -> None:
        self.findings, self.types = findings, types
        self.names: dict[str, str] = {}
        self.ports: dict[str, str] = {}
        """Blackboard keys that no name here can be, by what they are called here."""
        self.taken: set[str] = set()
        self.keys: set[str] = set()
        self.trees: dict[str, XmlElement] = {}
        self.wires: dict[str, str] = {}
        """In a subtree that shares its caller's names: what its explicit wires stand for."""
        self.inside: list[str] = []
        self.written_out: set[str] = set()
        self.calls: set[str] = set()

    def called(self, name: str) -> str:
        """What a blackboard key is called here: names have small letters, and no two become one."""
        if name in self.wires:
            return self.wires[name]
        if _NAME.fullmatch(name) or name not in self.keys:  # what nobody writes or wires may be an enum's member
            return name
        if name not in self.ports:
            small = re.sub(r"[^a-z0-9_]", "_", name.lower()).lstrip("_0123456789") or "port"
            number, found = 1, small
            while found in self.taken:
                number += 1
                found = f"{small}_{number}"
            self.taken.add(found)
            self.ports[name] = found
        return self.ports[name]

    def wired(self, text: str) -> str:
        """A text with blackboard keys as they are called here."""
        if text.startswith(LITERAL):
            return text
        return re.sub(r"\{(\w+)\}", lambda found: f"{{{self.called(found[1])}}}", text)

    def file(self, root: XmlElement) -> str:
        trees = {tree.get("ID") or f"tree_{i}": tree for i, tree in enumerate(root.all("BehaviorTree"), start=1)}
        if not trees:
            self.findings.error(root, "xml", "the file holds no <BehaviorTree>")
            return ""
        self.trees = trees
        main = root.get("main_tree_to_execute") or next(iter(trees))
        if main not in trees:
            self.findings.error(root, "xml", f"the main tree '{main}' is not in the file")
            return ""
        self.names = {tree_id: _tree_name(tree_id) for tree_id in trees}
        self.keys = set(_KEYS.findall(root.source.text)) | set(_ASSIGNED.findall(root.source.text))
        self.taken = {*re.findall(r"\w+", root.source.text), *SPECIAL}
        models = {m.get("ID"): m for group in root.all("TreeNodesModel") for m in group.all("SubTree")}
        top: Words = {"pomona": Flow("1"), "tree": self.names[main]}
        top.update(self.interface(models.get(main)))
        top["root"] = self.tree(trees[main])
        subtrees = {}
        for tree_id, tree in trees.items():
            if tree_id != main:
                found = {**self.interface(models.get(tree_id)), "root": self.tree(tree)}
                subtrees[tree_id] = found
        subtrees = {
            self.names[i]: found for i, found in subtrees.items() if i in self.calls or i not in self.written_out
        }
        if subtrees:
            top["subtrees"] = subtrees
        if root.all("include"):
            self.findings.error(root.all("include")[0], "xml", "<include> is not followed", "import that file as well")
        return "\n".join(block(top)) + "\n"

    def interface(self, model: XmlElement | None) -> Words:
        """Parameters, constants and ports: from our own metadata, or from the model's ports."""
        if model is None:
            return {}
        for fields in model.all("MetadataFields"):
            for metadata in fields.all("Metadata"):
                if metadata.get("pomona"):
                    return self.told(metadata)
        found: Words = {}
        for tag, key in (("input_port", "in"), ("output_port", "out")):
            ports = {p.get("name"): _foreign_port(p) for p in model.all(tag) if _NAME.fullmatch(p.get("name"))}
            if ports:
                found[key] = ports
        return found

    def told(self, metadata: XmlElement) -> Words:
        try:
            told = json.loads(metadata.get("pomona"))
        except (ValueError, RecursionError):
            told = None
        if not isinstance(told, dict):
            self.findings.error(metadata, "xml", "the tree's metadata cannot be read")
            return {}
        found: Words = {}
        if isinstance(told.get("description"), str):
            found["description"] = told["description"]
        for key in ("parameters", "constants", "in", "out"):
            ports = told.get(key)
            if isinstance(ports, dict):
                found[key] = {str(name): _declared(port) for name, port in ports.items()}
        return found

    def tree(self, tree: XmlElement) -> Words:
        if len(tree.children) != 1:
            self.findings.error(tree, "xml", f"a <BehaviorTree> has one child, this one {len(tree.children)}")
            return {"succeed": {}}
        return self.node(tree.children[0])

    # ------------------------------------------------------------------------------------------- nodes

    def node(self, element: XmlElement) -> Words:
        """A node of a tree file; a placeholder when nothing means the same."""
        tag = element.get("ID") if element.tag in ("Action", "Condition", "Control", "Decorator") else element.tag
        reading = ElementIn(self, element, tag)
        found = self.bare(reading)
        if element.get("name") and "name" not in found and not reading.wrapped:
            found["name"] = _node_name(element.get("name"))
        if element.get("_description") and "description" not in found:
            found["description"] = element.get("_description")
        return self.conditions(element, found)

    def bare(self, element: ElementIn) -> Words:
        tag = element.tag
        found = self.types.of_tag(tag)
        if found is not None:
            if found.role == "modifier" and tag in found.xml_tags and len(element.found.children) != 1:
                return element.refuse(f"has {len(element.found.children)} children")
            return found.from_xml(element)
        if tag == "SubTree":
            return self.subtree(element)
        if tag in ("Script", "ScriptCondition"):
            return self.script(element)
        if tag == "SetBlackboard":
            return self.assignment(element)
        if tag == "TryCatch":
            return self.attempt(element)
        if tag == "Precondition":
            return self.precondition(element)
        if tag in _LOOPS:
            return self.loop(element)
        if tag in BUILTIN or not re.fullmatch(r"[A-Z][A-Za-z0-9_]*", tag):
            return element.refuse("has no counterpart in tree files")
        return SKILL.from_xml(element)

    def subtree(self, element: ElementIn) -> Words:
        called = element.get("ID")
        if called not in self.names:
            self.findings.error(element.found, "xml", f"the subtree '{called}' is not in the file")
        if element.get("_autoremap") in ("1", "true"):
            shared = self.shared(element, called)
            if shared is not None:
                return shared
            message = f"'_autoremap' of subtree '{called}' is left out"
            self.findings.warning(element.found, "not-translated", message, "wire its ports by name")
        self.calls.add(called)
        return {self.names.get(called, _tree_name(called)): {self.called(n): v for n, v in element.ports().items()}}

    def shared(self, element: ElementIn, called: str) -> Words | None:
        """A subtree that shares its caller's names, written out where it is called; None when that cannot be."""
        tree = self.trees.get(called)
        wires = {n: t for n, t in element.attributes.items() if n not in _ATTRIBUTES and not n.startswith("_")}
        plain = all(re.fullmatch(r"\{(\w+|=)\}", text) for text in wires.values())
        if tree is None or called in self.inside or len(tree.children) != 1 or not plain or _has_private(tree):
            return None
        outer, again = self.wires, called in self.written_out
        names = {name: name if text == "{=}" else text[1:-1] for name, text in wires.items()}
        self.written_out.add(called)
        self.wires = {**outer, **{inner: self.called(name) for inner, name in names.items()}}
        self.inside.append(called)
        found = self.node(tree.children[0])
        self.inside.pop()
        self.wires = outer
        return {"sequence": [_without_names(found) if again else found]}

    def script(self, element: ElementIn) -> Words:
        try:
            if element.tag == "ScriptCondition":
                return {"check": condition_of(element.get("code"), self.called)}
            given = assignments_of(element.get("code"), self.called)
            steps: list[Words] = [{"set": {name: value}} for name, value in given]
        except ScriptError as error:
            return element.refuse(str(error))
        return steps[0] if len(steps) == 1 else {"sequence": steps}

    def assignment(self, element: ElementIn) -> Words:
        """`SetBlackboard` copies a text or a wire to a key."""
        key = self.called(element.get("output_key").strip("{}"))
        if not _NAME.fullmatch(key) or "value" not in element.attributes:
            return element.refuse("names no key, or no value")
        return {"set": {key: element.value("value")}}

    def attempt(self, element: ElementIn) -> Words:
        """`TryCatch`: a sequence; when it fails the last child runs, and it has failed all the same."""
        *tried, caught = element.children() or [{}]
        if not tried or element.get("catch_on_halt") in ("true", "1"):
            return element.refuse("also catches an interruption" if tried else "has too few children")
        return {"sequence": tried, "retry": Flow("1"), "on_failure": caught}

    def loop(self, element: ElementIn) -> Words:
        """`LoopInt` and its like over a list that is written out; another queue is emptied by who reads it."""
        children, queue = element.children(), element.get("queue")
        key = self.called(element.get("value").strip("{}"))
        if len(children) != 1 or not _NAME.fullmatch(key) or element.get("if_empty") not in ("", "SUCCESS"):
            return element.refuse("has no single child, no key for its value, or does not succeed when it is empty")
        if "{" in queue or not re.fullmatch(r"[\w.;+ -]+", queue):
            return element.refuse("empties a queue that others see")
        items = [item.strip() for item in queue.split(";") if item.strip()]
        return element.wrap(children[0], "for_each", Flow(f"[{', '.join(items)}]"), {"as": key})

    def precondition(self, element: ElementIn) -> Words:
        """`Precondition`: looks once at its start."""
        otherwise: dict[str, Words] = {"FAILURE": {"fail": {}}, "SUCCESS": {"succeed": {}}, "SKIPPED": {}}
        children, status = element.children(), element.get("else") or "FAILURE"
        if len(children) != 1 or status not in otherwise:
            return element.refuse(f"has {len(children)} children and ends as {status}")
        try:
            condition = condition_of(element.get("if"), self.called)
        except ScriptError as error:
            return element.refuse(str(error))
        found: Words = {"if": condition, "then": children[0]}
        return {**found, "else": otherwise[status]} if otherwise[status] else found

    def conditions(self, element: XmlElement, found: Words) -> Words:
        """Put the pre- and postconditions of BehaviorTree.CPP around a node."""
        others = [name for name in element.attributes if name.startswith("_") and name not in _ATTRIBUTES]
        for name in (*reversed(_PRECONDITIONS), *(name for name in others if name not in _PRECONDITIONS)):
            if name not in element.attributes:
                continue
            if name not in _PRECONDITIONS:
                found = self.untranslated(element, name, {"code": element.get(name)}, [found], "is a script")
                continue
            try:
                found = _guarded(found, name, condition_of(element.get(name), self.called))
            except ScriptError as error:
                found = self.untranslated(element, name, {"code": element.get(name)}, [found], str(error))
        return found

    def untranslated(self, element: XmlElement, name: str, attributes: Words, children: list[Words], why: str) -> Words:
        """A placeholder that `check` refuses."""
        self.findings.error(element, "not-translated", f"<{name}> {why}", "write it with other nodes")
        found: Words = {"untranslated": children, "element": name}
        return {**found, "attributes": attributes} if attributes else found

    def modified(self, child: Words, name: str, value: object, more: Words) -> Words:
        """The child with one more modifier around it; in a sequence of its own when the order would be another."""
        order = [modifier.key for modifier in self.types.modifiers]
        inside = [order.index(other) for other in order if other in child]
        if inside and max(inside) >= order.index(name):
            child = {"sequence": [child]}
        return {**child, name: value, **more}


@dataclass(slots=True)
class ElementIn:
    """An element being read by a node type (an `XmlIn`). Its children are read when they are first asked for."""

    importer: _Importer
    found: XmlElement
    tag: str
    wrapped: bool = False
    read: list[Words] | None = None

    @property
    def attributes(self) -> Mapping[str, str]:
        """All attributes of the XML element."""
        return self.found.attributes

    def get(self, name: str) -> str:
        """An attribute's text; empty when it is missing."""
        return self.found.get(name)

    def value(self, name: str) -> object:
        return _value(self.importer.wired(self.found.get(name)))

    def duration(self, name: str) -> str:
        return _duration(self.importer.wired(self.found.get(name)))

    def children(self) -> list[Words]:
        """The element's children, translated."""
        if self.read is None:
            self.read = [self.importer.node(child) for child in self.found.children]
        return self.read

    def ports(self) -> Words:
        given = self.found.attributes.items()
        return {
            name: _value(self.importer.wired(text))
            for name, text in given
            if name not in _ATTRIBUTES and not name.startswith("_")
        }

    def refuse(self, message: str) -> Words:
        kept = {n: v for n, v in self.found.attributes.items() if n != "name" and not n.startswith("_")}
        if kept.get("ID") == self.tag:
            del kept["ID"]
        return self.importer.untranslated(
            self.found, self.tag, kept, self.children(), message or "is not as it should be"
        )

    def wrap(self, child: Words, word: str, value: object, more: Words | None = None) -> Words:
        self.wrapped = True
        return self.importer.modified(child, word, value, more or {})


def _guarded(found: Words, name: str, condition: str) -> Words:
    """What BehaviorTree.CPP does before a node that has a precondition."""
    if name == "_skipIf":
        inner = {"sequence": [found]} if "when" in found else found
        return {**inner, "when": f"not ({condition})"}
    if name == "_while":
        return {"reactive_if": condition, "then": found}
    return {"if": condition, "then": {"succeed": {}} if name == "_successIf" else {"fail": {}}, "else": found}


def _value(text: str) -> object:
    return Flow(text.removeprefix(LITERAL)) if text.startswith(LITERAL) else text


def _duration(milliseconds: str) -> str:
    if milliseconds.startswith("{"):
        return f"{milliseconds} * 1 ms"
    try:
        return TIME.format(float(milliseconds) * 1e-3)
    except (ValueError, OverflowError):
        return milliseconds


def _tree_name(tree_id: str) -> str:
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", tree_id)
    name = re.sub(r"[^a-z0-9_]", "_", words.lower()).strip("_")
    return name if _NAME.fullmatch(name) else f"tree_{name}".rstrip("_")


def _node_name(name: str) -> str:
    return re.sub(r"[/:#{}\x00-\x1f]", " ", name).strip()[:80] or "node"


def _declared(port: object) -> object:
    if isinstance(port, str):
        return Flow(port or "null")
    if not isinstance(port, dict):
        return Flow("null")
    found: Words = {}
    for key, value in port.items():
        found[str(key)] = Flow(value) if key in ("default", "min", "max") and isinstance(value, str) else value
    return found["type"] if list(found) == ["type"] else found


def _foreign_port(port: XmlElement) -> Words:
    found: Words = {"type": port.get("type") if _NAME.fullmatch(port.get("type")) else "text"}
    if "default" in port.attributes and port.tag == "input_port":
        found["default"] = port.get("default")
    if port.text.strip():
        found["help"] = port.text.strip()
    return found


def _has_private(tree: XmlElement) -> bool:
    """Whether a tree has keys of its own: BehaviorTree.CPP shares none that begins with an underscore."""
    own = any(re.search(r"\{_\w+\}|(?<!\w)_\w+\s*(?::=|=)", text) for text in tree.attributes.values())
    return own or any(map(_has_private, tree.children))


def _without_names(found: object) -> Any:
    """A node as plain values without what people call it: a name can be taken only once."""
    if isinstance(found, dict):
        return {key: _without_names(value) for key, value in found.items() if key != "name"}
    return [_without_names(value) for value in found] if isinstance(found, list) else found
