"""XML of Groot2 and BehaviorTree.CPP (version 4) → the text of a tree file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pomona.executive.language.expression import SPECIAL
from pomona.executive.nodes.calls import SKILL
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.context import Words
from pomona.executive.ports import TIME
from pomona.executive.values.findings import Finding, Findings
from pomona.tools.groot.asked import Asked
from pomona.tools.groot.files import Forest
from pomona.tools.groot.keys import NAME, GivenText, KeyNames, ScriptError, small
from pomona.tools.groot.names import BUILTIN, LITERAL, NEEDED, node_name, tree_names
from pomona.tools.groot.scripts import assignments_of, condition_of, statements_of
from pomona.tools.groot.xml_nodes import XmlElement
from pomona.tools.groot.yaml_text import YamlText, block, flow

_ATTRIBUTES = ("name", "ID", "_description", "_autoremap", "_fullpath", "_uid")
_PRECONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
"""In the order in which BehaviorTree.CPP evaluates them."""
_AFTERWARDS = ("_onSuccess", "_onFailure", "_post")
_KEY = re.compile(r"\{\w+\}")
_SAME_FAILURE: Words = {"fail": {"code": "{failure.code}", "message": "{failure.message}"}}
"""Fails with the code and message of the last failure."""


def import_groot(
    text: str,
    path: str | Path,
    *,
    beside: Sequence[tuple[str, str | Path]] = (),
    nodes: Sequence[tuple[str, str | Path]] = (),
    main: str = "",
) -> tuple[str, list[Finding]]:
    """Return the text of a tree file, empty if nothing can be translated, and the parts without translation.

    `beside` are further files (texts and paths) whose trees are called, `nodes` files with models of nodes
    (`<TreeNodesModel>`), `main` the ID of the tree to run. Raises nothing. Foreign nodes may not be installed as
    skills: check the text before a run.
    """
    findings = Findings()
    forest = Forest(findings)
    for models, where in nodes:
        forest.read_models(models, where)
    forest.read([(text, path), *beside], main)
    if not forest.main:
        return "", findings.sorted()
    return _Importer(forest, NodeTypes.installed()).file(), findings.sorted()


class _Importer:
    def __init__(self, forest: Forest, types: NodeTypes) -> None:
        self.forest, self.findings, self.types = forest, forest.findings, types
        self.names = tree_names(forest.trees, self.types)
        self.keys = KeyNames(set())
        self.labels: set[str] = set()  # names of nodes that are taken in the tree being read
        self.inside: list[str] = []
        self.inlined: set[str] = set()
        self.calls: set[str] = set()
        self.asked = Asked(forest, self.types)
        self.count = 0  # number of nodes in inlined subtrees

    def file(self) -> str:
        forest, main = self.forest, self.forest.main
        top: Words = {"pomona": YamlText("1"), "tree": self.names[main]}
        top.update(self.interface(forest.models.get(main)))
        top["root"] = self.tree(main)
        subtrees = {
            tree_id: {**self.interface(forest.models.get(tree_id)), "root": self.tree(tree_id)}
            for tree_id in forest.trees
            if tree_id != main
        }
        subtrees = {self.names[i]: found for i, found in subtrees.items() if i in self.calls or i not in self.inlined}
        if subtrees:
            top["subtrees"] = subtrees
        return "\n".join(block(top)) + "\n"

    def interface(self, model: XmlElement | None) -> Words:
        """Parameters, constants and ports, from our own metadata."""
        if model is None:
            return {}
        metadata = _own(model)
        return {} if metadata is None else self.declared(metadata)

    def declared(self, metadata: XmlElement) -> Words:
        try:
            said = json.loads(metadata.get("pomona"))
        except (ValueError, RecursionError):
            said = None
        if not isinstance(said, dict):
            self.findings.error(metadata, "xml", "the tree's metadata cannot be read")
            return {}
        found: Words = {}
        if isinstance(said.get("description"), str):
            found["description"] = said["description"]
        for key in ("parameters", "constants", "in", "out"):
            ports = said.get(key)
            if isinstance(ports, dict):
                found[key] = {str(name): _declared(port) for name, port in ports.items()}
        return found

    def tree(self, tree_id: str) -> Words:
        tree = self.forest.trees[tree_id]
        if len(tree.children) != 1:
            self.findings.error(tree, "xml", f"a <BehaviorTree> must have one child, this one has {len(tree.children)}")
            return {"succeed": {}}
        words = {word for text in self.forest.texts for word in re.findall(r"\w+", text)}
        self.keys, self.labels, self.inside = KeyNames({*words, *SPECIAL}), set(), [tree_id]
        return self.node(tree.children[0])

    # ------------------------------------------------------------------------------------------- nodes

    def node(self, element: XmlElement) -> Words:
        """Return a node of a tree file; a placeholder when there is no equivalent."""
        tag = element.get("ID") if element.tag in ("Action", "Condition", "Control", "Decorator") else element.tag
        self.count += len(self.inside) > 1
        reading = ElementIn(self, element, tag)
        found = self.bare(reading)
        if element.get("name") and "name" not in found and not reading.wrapped:
            found["name"] = self.label(element.get("name"))
        if element.get("_description") and "description" not in found:
            found["description"] = element.get("_description")
        return self.conditions(element, found)

    def label(self, name: str) -> str:
        start = found = node_name(name)
        number = 1
        while found in self.labels:
            number += 1
            found = f"{start} {number}"
        self.labels.add(found)
        return found

    def bare(self, element: ElementIn) -> Words:
        tag = element.tag
        found = self.types.of_tag(tag)
        needed = NEEDED.get(tag)
        if needed is not None and not element.get(needed):
            return element.untranslated(f"has no '{needed}'")
        why = self.asked.why_not(tag, element.found)
        if why:
            return element.untranslated(why)
        if found is not None:
            if found.role == "modifier":
                parts = 0 if tag in found.xml_tags else sum(taken.nodes for taken in found.fields.values())
                if not 1 <= len(element.found.children) <= 1 + parts:
                    return element.untranslated(f"has {len(element.found.children)} children")
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
        if tag in ("LoopInt", "LoopDouble", "LoopBool", "LoopString"):
            return self.loop(element)
        if tag in BUILTIN or not re.fullmatch(r"[A-Z][A-Za-z0-9_]*", tag):
            return element.untranslated("has no counterpart in tree files")
        return self.skill(element, self.forest.nodes.get(tag))

    def skill(self, element: ElementIn, model: XmlElement | None) -> Words:
        """Return a custom node; its model has the defaults of ports that are not wired."""
        found = SKILL.from_xml(element)
        if model is None or element.tag not in found:
            return found
        if model.tag not in ("Action", "Condition"):
            return element.untranslated(f"is a custom {model.tag} node")
        ports = {port.get("name"): port for port in model.children if port.tag.endswith("_port")}
        unknown = [name for name in found[element.tag] if name not in ports]
        if unknown:
            return element.untranslated(f"has no port '{unknown[0]}', its model has {', '.join(ports) or 'none'}")
        defaults = {name: port.get("default") for name, port in ports.items() if port.get("default")}
        wired = {name: f"{{{name}}}" if text == "{=}" else text for name, text in defaults.items()}
        return {element.tag: {**{n: _value(self.keys.wired(text)) for n, text in wired.items()}, **found[element.tag]}}

    def subtree(self, element: ElementIn) -> Words:
        """Return a call; inlined when the subtree uses blackboard keys that it does not declare."""
        called = element.get("ID")
        tree, model = self.forest.trees.get(called), self.forest.models.get(called)
        if tree is None:
            return element.untranslated(f"calls '{called}', which none of the files defines")
        if called in self.inside or self.count > 10_000:  # most nodes in inlined subtrees; as many as can run
            return element.untranslated("calls itself" if called in self.inside else "is too large to be inlined")
        wires = {n: t for n, t in element.attributes.items() if n not in _ATTRIBUTES and not n.startswith("_")}
        declared = model is not None and _own(model) is not None
        if declared or not (wires or model or self.uses_keys(tree)) or len(tree.children) != 1:
            self.calls.add(called)
            return {self.names[called]: {name: _value(self.keys.wired(text)) for name, text in wires.items()}}
        shares = element.get("_autoremap") in ("1", "true")
        for port in () if model is None or shares else (p for p in model.children if p.tag.endswith("_port")):
            if port.get("name") not in wires and not port.get("default"):
                return element.untranslated(f"does not wire the port '{port.get('name')}'")
            wires.setdefault(port.get("name"), port.get("default"))
        outer, known = self.keys, {n: n if t == "{=}" else t[1:-1] for n, t in wires.items() if _KEY.fullmatch(t)}
        known |= {name: name for name, text in wires.items() if text == "{=}"}
        given: dict[str, str | GivenText] = {n: known.get(n) or GivenText(t) for n, t in wires.items()}
        self.keys = KeyNames(outer.taken, outer, given, shares, f"{small(self.names[called])}_")
        self.inside.append(called)
        self.inlined.add(called)
        found = self.node(tree.children[0])
        self.inside.pop()
        self.keys = outer
        named = {} if element.get("name") else {"name": self.label(called)}
        return {"sequence": [found], **named}

    def uses_keys(self, tree: XmlElement) -> bool:
        """Return True if anything in a tree reads or writes a blackboard key."""
        for name, text in tree.attributes.items():
            script = name in ("code", "if") or (name.startswith("_") and name not in _ATTRIBUTES)
            if "{" in text or script or name == "output_key":
                return True
        below = self.forest.trees.get(tree.get("ID")) if tree.tag == "SubTree" else None
        return below is not None or any(map(self.uses_keys, tree.children))

    def script(self, element: ElementIn) -> Words:
        try:
            code, steps = element.get("code"), []
            if element.tag == "ScriptCondition":
                *before, last = statements_of(code) or [""]
                steps = self.assigned(";".join(before)) if before else []
                steps.append({"check": condition_of(last, self.keys)})
            else:
                steps = self.assigned(code)
        except ScriptError as error:
            return element.untranslated(str(error))
        return steps[0] if len(steps) == 1 else {"sequence": steps}

    def assigned(self, script: str) -> list[Words]:
        return [{"set": YamlText(flow({name: value}))} for name, value in assignments_of(script, self.keys)]

    def assignment(self, element: ElementIn) -> Words:
        """`SetBlackboard` copies a text or a wire to a key."""
        try:
            key = self.keys.target(element.get("output_key").strip("{}"))
        except ScriptError as error:
            return element.untranslated(str(error))
        if not element.get("output_key") or "value" not in element.attributes:
            return element.untranslated("names no key, or no value")
        return {"set": YamlText(flow({key: element.value("value")}))}

    def attempt(self, element: ElementIn) -> Words:
        """`TryCatch`: a sequence; when it fails, the last child runs, and the node still fails."""
        *tried, caught = element.children() or [{}]
        if not tried or element.get("catch_on_halt") in ("true", "1"):
            return element.untranslated("also catches an interruption" if tried else "has too few children")
        caught = self.modified(caught, "force", "success", {})
        return _ended({"sequence": tried}, [], [caught])

    def loop(self, element: ElementIn) -> Words:
        """`LoopInt` and the like over a literal list; a queue on the blackboard would be emptied by its readers."""
        children, queue, at_the_end = element.children(), str(element.value("queue")), element.get("if_empty")
        try:
            key = self.keys.target(element.get("value").strip("{}"))
        except ScriptError as error:
            return element.untranslated(str(error))
        if len(children) != 1 or not NAME.fullmatch(key):
            return element.untranslated("has no single child, or no key for its value")
        if "{" in queue or not re.fullmatch(r"[\w.;+ -]*", queue):
            return element.untranslated("empties a queue that other nodes can see")
        items = [item.strip() for item in queue.split(";") if item.strip()]
        if at_the_end not in ("", "SUCCESS"):
            if items or at_the_end not in ("FAILURE", "SKIPPED"):
                return element.untranslated(f"ends as {at_the_end} when it is empty")
            return {"fail": {}} if at_the_end == "FAILURE" else {"succeed": {}, "disabled": True}
        return element.wrap(children[0], "for_each", YamlText(f"[{', '.join(items)}]"), {"as": key})

    def precondition(self, element: ElementIn) -> Words:
        """`Precondition`: evaluated once, at its start."""
        otherwise: dict[str, Words] = {"FAILURE": {"fail": {}}, "SUCCESS": {"succeed": {}}, "SKIPPED": {}}
        children, status = element.children(), element.get("else") or "FAILURE"
        if len(children) != 1 or status not in otherwise:
            return element.untranslated(f"has {len(children)} children and ends as {status}")
        try:
            condition = condition_of(element.get("if"), self.keys)
        except ScriptError as error:
            return element.untranslated(str(error))
        found: Words = {"if": condition, "then": children[0]}
        return {**found, "else": otherwise[status]} if otherwise[status] else found

    def conditions(self, element: XmlElement, found: Words) -> Words:
        """Put the pre- and postconditions of BehaviorTree.CPP around a node."""
        others = [name for name in element.attributes if name.startswith("_") and name not in _ATTRIBUTES]
        for name in ("_onHalted", *reversed(_PRECONDITIONS)):  # BehaviorTree.CPP reads no others that begin with _
            if name not in element.attributes:
                continue
            if name == "_onHalted":
                why = "follows an interruption"
                found = self.untranslated(element, name, {"code": element.get(name)}, [found], why)
                continue
            try:
                found = _guarded(found, name, condition_of(element.get(name), self.keys))
            except ScriptError as error:
                found = self.untranslated(element, name, {"code": element.get(name)}, [found], str(error))
        return self.afterwards(element, found) if set(others) & set(_AFTERWARDS) else found

    def afterwards(self, element: XmlElement, found: Words) -> Words:
        """Scripts that follow a node's end in the same tick; none when it is skipped or interrupted."""
        scripts = {name: element.get(name) for name in _AFTERWARDS}
        try:
            steps = {name: self.assigned(script) if script else [] for name, script in scripts.items()}
        except ScriptError as error:
            given = {name: script for name, script in scripts.items() if script}
            return self.untranslated(element, next(iter(given)), given, [found], str(error))
        return _ended(found, steps["_onSuccess"] + steps["_post"], steps["_onFailure"] + steps["_post"])

    def untranslated(self, element: XmlElement, name: str, attributes: Words, children: list[Words], why: str) -> Words:
        """Return a placeholder that `check` refuses."""
        self.findings.error(element, "not-translated", f"<{name}> {why}", "write it with other nodes")
        found: Words = {"untranslated": children, "element": name}
        return {**found, "attributes": attributes} if attributes else found

    def modified(self, child: Words, name: str, value: object, more: Words) -> Words:
        """Return the child with one more modifier; a sequence around it keeps the order of modifiers."""
        order = [modifier.key for modifier in self.types.modifiers]
        inside = [order.index(other) for other in order if other in child]
        if inside and max(inside) >= order.index(name):
            child = {"sequence": [child]}
        return {**child, name: value, **more}


@dataclass(slots=True)
class ElementIn:
    """An element being read by a node type (an `XmlImport`). Its children are read when they are first asked for."""

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
        """Return an attribute's text; empty when it is missing."""
        return self.found.get(name)

    def value(self, name: str) -> object:
        return _value(self.importer.keys.wired(self.found.get(name)))

    def duration(self, name: str) -> str:
        return _duration(self.importer.keys.wired(self.found.get(name)))

    def children(self) -> list[Words]:
        """Return the element's children, translated."""
        if self.read is None:
            self.read = [self.importer.node(child) for child in self.found.children]
        return self.read

    def ports(self) -> Words:
        given = self.found.attributes.items()
        return {
            name: _value(self.importer.keys.wired(text))
            for name, text in given
            if name not in _ATTRIBUTES and not name.startswith("_")
        }

    def untranslated(self, message: str) -> Words:
        kept = {n: v for n, v in self.found.attributes.items() if n != "name" and not n.startswith("_")}
        if kept.get("ID") == self.tag:
            del kept["ID"]
        return self.importer.untranslated(self.found, self.tag, kept, self.children(), message or "is not valid")

    def wrap(self, child: Words, word: str, value: object, more: Words | None = None) -> Words:
        self.wrapped = True
        return self.importer.modified(child, word, value, more or {})


def _guarded(found: Words, name: str, condition: str) -> Words:
    """Return the steps of BehaviorTree.CPP before a node that has a precondition."""
    if name == "_skipIf":
        inner = {"sequence": [found]} if "when" in found else found
        return {**inner, "when": f"not ({condition})"}
    if name == "_while":
        return {"reactive_if": condition, "then": found}
    return {"if": condition, "then": {"succeed": {}} if name == "_successIf" else {"fail": {}}, "else": found}


def _ended(found: Words, after_success: list[Words], after_failure: list[Words]) -> Words:
    """Return a node and the steps after its success and its failure in the same tick; the end is the node's own."""
    then: Words = {"sequence": after_success} if len(after_success) > 1 else {"succeed": {}}
    if len(after_success) == 1:
        then = after_success[0]
    return {
        "if": found,
        "then": then,
        "else": {"sequence": [*after_failure, _SAME_FAILURE]} if after_failure else _SAME_FAILURE,
    }


def _own(model: XmlElement) -> XmlElement | None:
    """Return the metadata that our own export has written into a model."""
    said = (found for fields in model.all("MetadataFields") for found in fields.all("Metadata"))
    return next((found for found in said if found.get("pomona")), None)


def _value(text: str) -> object:
    return YamlText(text.removeprefix(LITERAL)) if text.startswith(LITERAL) else text


def _duration(milliseconds: str) -> str:
    if milliseconds.startswith("{"):
        return f"{milliseconds} * 1 ms"
    try:
        return TIME.format(float(milliseconds) * 1e-3)
    except (ValueError, OverflowError):
        return milliseconds


def _declared(port: object) -> object:
    if isinstance(port, str):
        return YamlText(port or "null")
    if not isinstance(port, dict):
        return YamlText("null")
    found: Words = {}
    for key, value in port.items():
        found[str(key)] = YamlText(value) if key in ("default", "min", "max") and isinstance(value, str) else value
    return found["type"] if list(found) == ["type"] else found
