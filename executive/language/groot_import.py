"""XML of Groot2 and BehaviorTree.CPP (version 4) → the text of a tree file."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from executive.language.groot_names import BUILTIN, LITERAL, XML_TO_BRANCH
from executive.language.model import DECORATORS
from executive.language.xml_nodes import XmlElement, read_xml
from executive.ports import TIME
from executive.values.findings import Finding, Findings, Source
from executive.values.yaml_text import Flow, block

Node = dict[str, Any]

_ATTRIBUTES = ("name", "ID", "_description", "_autoremap", "_fullpath", "_uid")
_NAME = re.compile(r"[a-z][a-z0-9_]*")


def import_groot(text: str, path: str | Path) -> tuple[str, list[Finding]]:
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
    return _Importer(findings).file(root), findings.sorted()


class _Importer:
    def __init__(self, findings: Findings) -> None:
        self.findings = findings
        self.decorators: Mapping[str, Callable[[XmlElement], tuple[str, object] | None]] = {
            "RetryUntilSuccessful": lambda e: ("retry", e.get("num_attempts")),
            "Repeat": lambda e: ("repeat", "forever" if e.get("num_cycles") == "-1" else e.get("num_cycles")),
            "PomonaRepeat": lambda e: ("repeat", e.get("rounds")),
            "Timeout": lambda e: ("timeout", _duration(e.get("msec"))),
            "PomonaTimeout": lambda e: ("timeout", e.get("duration")),
            "Inverter": lambda _: ("invert", Flow("true")),
            "ForceSuccess": lambda _: ("force", "success"),
            "ForceFailure": lambda _: ("force", "failure"),
            "PomonaGuard": lambda e: ("guard", e.get("condition")),
            "PomonaWhen": lambda e: ("when", e.get("condition")),
            "PomonaForEach": lambda e: ("for_each", e.get("items")),
            "KeepRunningUntilFailure": lambda _: ("repeat", "forever"),
        }

    def file(self, root: XmlElement) -> str:
        trees = {tree.get("ID") or f"tree_{i}": tree for i, tree in enumerate(root.all("BehaviorTree"), start=1)}
        if not trees:
            self.findings.error(root, "xml", "the file holds no <BehaviorTree>")
            return ""
        main = root.get("main_tree_to_execute") or next(iter(trees))
        if main not in trees:
            self.findings.error(root, "xml", f"the main tree '{main}' is not in the file")
            return ""
        self.names = {tree_id: _tree_name(tree_id) for tree_id in trees}
        models = {m.get("ID"): m for group in root.all("TreeNodesModel") for m in group.all("SubTree")}
        top: Node = {"pomona": Flow("1"), "tree": self.names[main]}
        top.update(self.interface(models.get(main)))
        top["root"] = self.tree(trees[main])
        subtrees = {}
        for tree_id, tree in trees.items():
            if tree_id != main:
                subtrees[self.names[tree_id]] = {**self.interface(models.get(tree_id)), "root": self.tree(tree)}
        if subtrees:
            top["subtrees"] = subtrees
        if root.all("include"):
            self.findings.error(root.all("include")[0], "xml", "<include> is not followed", "import that file as well")
        return "\n".join(block(top)) + "\n"

    def interface(self, model: XmlElement | None) -> Node:
        """Parameters, constants and ports: from our own metadata, or from the model's ports."""
        if model is None:
            return {}
        for fields in model.all("MetadataFields"):
            for metadata in fields.all("Metadata"):
                if metadata.get("pomona"):
                    return self.told(metadata)
        found: Node = {}
        for tag, key in (("input_port", "in"), ("output_port", "out")):
            ports = {p.get("name"): _foreign_port(p) for p in model.all(tag) if _NAME.fullmatch(p.get("name"))}
            if ports:
                found[key] = ports
        return found

    def told(self, metadata: XmlElement) -> Node:
        try:
            told = json.loads(metadata.get("pomona"))
        except (ValueError, RecursionError):
            told = None
        if not isinstance(told, dict):
            self.findings.error(metadata, "xml", "the tree's metadata cannot be read")
            return {}
        found: Node = {}
        if isinstance(told.get("description"), str):
            found["description"] = told["description"]
        for key in ("parameters", "constants", "in", "out"):
            ports = told.get(key)
            if isinstance(ports, dict):
                found[key] = {str(name): _declared(port) for name, port in ports.items()}
        return found

    def tree(self, tree: XmlElement) -> Node:
        if len(tree.children) != 1:
            self.findings.error(tree, "xml", f"a <BehaviorTree> has one child, this one {len(tree.children)}")
            return {"succeed": {}}
        return self.node(tree.children[0])

    # ------------------------------------------------------------------------------------------- nodes

    def node(self, element: XmlElement) -> Node:
        tag = element.tag
        if tag in ("Action", "Condition", "Control", "Decorator"):
            tag = element.get("ID")
        self.conditions(element)
        if tag in self.decorators:
            return self.decorator(element, tag)
        if tag == "PomonaRetry":
            return self.retry(element)
        found = self.bare(element, tag)
        if element.get("name"):
            found["name"] = _node_name(element.get("name"))
        if element.get("_description"):
            found["description"] = element.get("_description")
        return found

    def conditions(self, element: XmlElement) -> None:
        for name in element.attributes:
            if name.startswith("_") and name not in _ATTRIBUTES:
                message = f"'{name}' of <{element.tag}> is BehaviorTree.CPP's own script language and is left out"
                self.findings.warning(element, "not-translated", message, "write a 'when', 'guard' or 'check' instead")

    def decorator(self, element: XmlElement, tag: str) -> Node:
        if len(element.children) != 1:
            self.findings.error(element, "xml", f"<{tag}> has one child, this one {len(element.children)}")
            return {"succeed": {}}
        child = self.node(element.children[0])
        modifier = self.decorators[tag](element)
        assert modifier is not None
        name, value = modifier
        more = {"as": element.get("item").strip("{}")} if tag == "PomonaForEach" else {}
        return _modified(child, name, _value(value), more)

    def retry(self, element: XmlElement) -> Node:
        if not 1 <= len(element.children) <= 2:
            self.findings.error(element, "xml", "<PomonaRetry> has one or two children")
            return {"succeed": {}}
        more: Node = {"retry_if": element.get("retry_if")} if element.get("retry_if") else {}
        if len(element.children) == 2:
            more["on_failure"] = self.node(element.children[1])
        return _modified(self.node(element.children[0]), "retry", element.get("attempts"), more)

    def bare(self, element: XmlElement, tag: str) -> Node:
        ports = {n: _value(v) for n, v in element.attributes.items() if n not in _ATTRIBUTES and not n.startswith("_")}
        children = [self.node(child) for child in element.children]
        if tag in XML_TO_BRANCH:
            return {XML_TO_BRANCH[tag]: children}
        match tag:
            case "Parallel" | "ParallelAll":
                return self.parallel(element, children)
            case "PomonaParallel":
                return {"parallel": children, "success_on": ports.get("success_on", "all")}
            case "PomonaRecovery":
                return {"recovery": children, "attempts": ports.get("attempts", "2")}
            case "PomonaCheck":
                return {"check": element.get("condition")}
            case "PomonaWaitUntil":
                return {"wait_until": element.get("condition")}
            case "PomonaWait":
                return {"wait": element.get("duration")}
            case "Sleep":
                return {"wait": _duration(element.get("msec"))}
            case "PomonaSet":
                return {"set": ports.get("values", {})}
            case "PomonaFail":
                return {"fail": ports}
            case "AlwaysFailure":
                return {"fail": {}}
            case "AlwaysSuccess":
                return {"succeed": {}}
            case "SubTree":
                return self.subtree(element, ports)
        if tag in BUILTIN or not re.fullmatch(r"[A-Z][A-Za-z0-9_]*", tag):
            message = f"<{tag or element.tag}> has no counterpart in tree files"
            self.findings.error(element, "not-translated", message, "write it with other nodes")
            return {"sequence": children} if children else {"succeed": {}}
        if children:
            self.findings.error(element, "not-translated", f"<{tag}> has children, which a skill cannot have")
        return {tag: ports}

    def subtree(self, element: XmlElement, ports: Node) -> Node:
        called = element.get("ID")
        if called not in self.names:
            self.findings.error(element, "xml", f"the subtree '{called}' is not in the file")
        if element.get("_autoremap") in ("1", "true"):
            message = f"'_autoremap' of subtree '{called}' is left out"
            self.findings.warning(element, "not-translated", message, "wire its ports by name")
        return {self.names.get(called, _tree_name(called)): ports}

    def parallel(self, element: XmlElement, children: list[Node]) -> Node:
        success, failure = element.get("success_count") or "-1", element.get("failure_count") or "1"
        if element.tag == "ParallelAll":
            success, failure = "-1", element.get("max_failures") or "1"
        everything = success in ("-1", str(len(children)))
        if failure != "1" or not (everything or success == "1"):
            message = f"a parallel that succeeds on {success} and fails on {failure} has no counterpart in tree files"
            self.findings.error(element, "not-translated", message)
        return {"parallel": children} if everything else {"parallel": children, "success_on": "one"}


def _modified(child: Node, name: str, value: object, more: Node) -> Node:
    """The child with one more modifier around it; in a sequence of its own when the order would be another."""
    inside = [other for other in DECORATORS if other in child]
    if inside and DECORATORS.index(inside[-1]) >= DECORATORS.index(name):
        child = {"sequence": [child]}
    return {**child, name: value, **more}


def _value(text: object) -> object:
    return Flow(text.removeprefix(LITERAL)) if isinstance(text, str) and text.startswith(LITERAL) else text


def _duration(milliseconds: str) -> str:
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
    found: Node = {}
    for key, value in port.items():
        found[str(key)] = Flow(value) if key in ("default", "min", "max") and isinstance(value, str) else value
    return found["type"] if list(found) == ["type"] else found


def _foreign_port(port: XmlElement) -> Node:
    found: Node = {"type": port.get("type") if _NAME.fullmatch(port.get("type")) else "text"}
    if "default" in port.attributes and port.tag == "input_port":
        found["default"] = port.get("default")
    if port.text.strip():
        found["help"] = port.text.strip()
    return found
