"""XML of BehaviorTree.CPP (version 4) and Groot2 → the text of a tree file: the whole tree, or no text."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pomona.executive.language.expression import SPECIAL
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Finding, Findings
from pomona.tools.groot.element_in import (
    AFTERWARDS,
    KNOWN,
    PRECONDITIONS,
    ElementIn,
    Words,
    is_port,
)
from pomona.tools.groot.elements import INSTANT, READERS, Wrapped, ended, guarded
from pomona.tools.groot.files import Forest, ports_of
from pomona.tools.groot.keys import GivenText, KeyNames, NoEquivalentError, key_in
from pomona.tools.groot.names import (
    GENERIC,
    NO_SKILLS,
    PREFIX,
    free_name,
    node_name,
    skill_name,
    tree_names,
)
from pomona.tools.groot.scripts import assignments_of, condition_of
from pomona.tools.groot.xml_nodes import XmlElement
from pomona.tools.groot.yaml_text import Written, to_yaml

MOST_INLINED = 10_000  # nodes of subtrees that are written out; as many as can run


def import_groot(
    text: str,
    path: str | Path,
    *,
    beside: Sequence[tuple[str, str | Path]] = (),
    main: str = "",
    skills: Mapping[str, type[Skill]] | None = None,
    stubs: bool = False,
) -> tuple[str, list[Finding]]:
    """Return the text of a tree file and the findings; an error in them leaves the text empty.

    `beside` are further files (texts and paths) with called trees or models, `main` the ID of the tree to run. `skills`
    are the installed ones. With `stubs`, the skills that are not installed are declared in the tree. Raises nothing.
    """
    findings = Findings()
    forest = Forest(findings)
    forest.read([(text, path), *beside], main)
    written = _Importer(forest, skills or {}, stubs).file() if forest.main else {}
    found = findings.sorted()
    refused = any(finding.severity == "error" for finding in found)
    return "" if refused or not written else to_yaml(written), found


class _Importer:
    def __init__(self, forest: Forest, skills: Mapping[str, type[Skill]], stubs: bool) -> None:
        self.forest = forest
        self.findings = forest.findings
        self.installed = skills
        self.stubs = stubs
        self.types = NodeTypes.installed()
        # names that no key gets which is renamed
        self.taken = {word for text in forest.texts for word in re.findall(r"\w+", text)}
        self.taken.update(SPECIAL)
        self.names = tree_names(forest.trees, self.types)
        self.keys = KeyNames(set())
        self.labels: set[str] = set()  # names of nodes that are taken in the tree being read
        self.inside: list[str] = []
        self.inlined: set[str] = set()
        self.calls: set[str] = set()
        self.count = 0  # number of nodes in inlined subtrees
        self.refusals: set[tuple[str, str]] = set()
        self.declared: dict[str, dict[str, list[str]]] = {}  # skills that are not installed
        self.written: set[str] = set()  # names that something before writes

    def file(self) -> Words:
        for tree_id, tree in self.forest.trees.items():
            if not tree_id.isascii():
                message = f"the tree '{tree_id}' is called '{self.names[tree_id]}' here"
                hint = "names of trees have the letters a-z, digits and _"
                self.findings.warning(tree, "renamed", message, hint)
        main = self.forest.main
        root = self.tree(main)
        others = {
            tree_id: {"root": self.tree(tree_id)}
            for tree_id in self.forest.trees
            if tree_id != main
        }
        subtrees = {
            self.names[tree_id]: found
            for tree_id, found in others.items()
            if tree_id in self.calls or tree_id not in self.inlined
        }
        top: Words = {"pomona": 1, "tree": self.names[main]}
        if self.stubs and self.declared:
            top["skills"] = dict(sorted(self.declared.items()))
        top["root"] = root
        return {**top, "subtrees": subtrees} if subtrees else top

    def tree(self, tree_id: str) -> Words:
        tree = self.forest.trees[tree_id]
        self.keys, self.labels, self.inside = KeyNames(self.taken), set(), [tree_id]
        self.written = set()
        if len(tree.children) != 1:
            self.refuse(tree, NoEquivalentError(f"has {len(tree.children)} children instead of 1"))
        nodes = [self.node(child) for child in tree.children]
        return nodes[0] if nodes else {}

    def refuse(self, element: XmlElement, refused: NoEquivalentError) -> None:
        """Report what is refused, once for each place."""
        name = element.get("ID") if element.tag in GENERIC else element.tag
        message = f"<{name or element.tag}> {refused}"
        if (element.place, message) not in self.refusals:
            self.refusals.add((element.place, message))
            self.findings.error(element, "not-translated", message, refused.hint)

    # ------------------------------------------------------------------------------------------- nodes

    def node(self, element: XmlElement) -> Words:
        """Return a node of a tree file. One that is refused is reported, and its children are still read."""
        self.count += len(self.inside) > 1
        reading = ElementIn(element, self.keys, self.node)
        try:
            bare = self.bare(reading)
            reading.require_no_more()
            found = self.modified(bare) if isinstance(bare, Wrapped) else self.named(element, bare)
            return self.conditions(element, found)
        except NoEquivalentError as refused:
            self.refuse(element, refused)
            if reading.read is None:
                reading.read = [self.node(child) for child in element.children]
            return {}

    def bare(self, element: ElementIn) -> Words | Wrapped:
        tag = element.tag
        if not tag:
            raise NoEquivalentError("has no ID", "give it one")
        if tag == "SubTree":
            return self.subtree(element)
        reader = READERS.get(tag)
        if reader is None:
            return self.skill(element)
        if element.found.tag in ("Action", "Condition"):
            raise NoEquivalentError(
                "has the name of a node of BehaviorTree.CPP", "rename the skill"
            )
        if tag == "WhileDoElse" and not all(map(self.is_instant, element.found.children[:1])):
            why = "asks a node that may take time, while the running branch would go on unattended"
            raise NoEquivalentError(why, "ask a <Condition>")
        return reader(element)

    def is_instant(self, element: XmlElement) -> bool:
        """Return True if an element ends in the tick in which it starts."""
        model = self.forest.models.get(element.get("ID") or element.tag)
        if "Condition" in (element.tag, "" if model is None else model.tag):
            return True
        return element.tag in INSTANT and all(map(self.is_instant, element.children))

    def named(self, element: XmlElement, found: Words) -> Words:
        """Add name and description; those of a decorator have no place in a tree file."""
        if element.get("name") and "name" not in found:
            found = {**found, "name": self.label(element.get("name"))}
        if element.get("_description") and "description" not in found:
            found = {**found, "description": element.get("_description")}
        return found

    def label(self, name: str) -> str:
        found = free_name(node_name(name), self.labels.__contains__, " ")
        self.labels.add(found)
        return found

    def modified(self, wrapped: Wrapped) -> Words:
        """Return the child with one more modifier; a sequence around it keeps the order of modifiers."""
        child, word, value = wrapped
        order = [modifier.key for modifier in self.types.modifiers]
        inside = [order.index(other) for other in order if other in child]
        if inside and max(inside) >= order.index(word):
            child = {"sequence": [child]}
        return {**child, word: value}

    def conditions(self, element: XmlElement, found: Words) -> Words:
        """Put the pre- and postconditions of BehaviorTree.CPP around a node.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        for name in element.attributes:
            if name.startswith("_") and name not in KNOWN:
                message = f"'{name}' of <{element.tag}> is not read by BehaviorTree.CPP 4"
                self.findings.warning(element, "ignored", message, f"it reads {', '.join(KNOWN)}")
        if "_onHalted" in element.attributes:
            raise NoEquivalentError("follows an interruption with a script (_onHalted)")
        for name in reversed(PRECONDITIONS):
            if name in element.attributes:
                found = guarded(found, name, condition_of(element.get(name), self.keys))
        if not set(AFTERWARDS) & element.attributes.keys():
            return found
        success, failure, post = (self.steps(element.get(name)) for name in AFTERWARDS)
        return ended(found, success + post, failure + post)

    def steps(self, script: str) -> list[Words]:
        return [
            {"set": {name: value}}
            for name, value in (assignments_of(script, self.keys) if script else ())
        ]

    # ------------------------------------------------------------------------------------------- skills

    def skill(self, element: ElementIn) -> Words:
        """Return a foreign node, which tree files call by its name.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        name = element.tag
        model = self.forest.models.get(element.tag)
        if name.startswith(PREFIX) or name in NO_SKILLS:
            raise NoEquivalentError("has no counterpart that can be imported")
        if (
            element.found.children
            or element.found.tag in ("Control", "Decorator")
            or (model is not None and model.tag in ("Control", "Decorator"))
        ):
            raise NoEquivalentError("is a control node or decorator that tree files do not have")
        if name in self.forest.trees and model is None:
            hint = f'call it with <SubTree ID="{name}"/>'
            raise NoEquivalentError("has the name of a tree", hint)
        if not re.fullmatch(r"[A-Z][A-Za-z0-9_]*", name):
            why = "has a name that no skill can have: a capital letter, then A-Z, a-z, 0-9 and _"
            raise NoEquivalentError(why, f"call it {skill_name(name)}")
        ports = element.ports()
        directions = self.forest.directions(name)
        for port in ports:
            if model is not None and port not in directions:
                message = f"<{name}> has no port '{port}' in its <TreeNodesModel>"
                known = ", ".join(directions) or "none"
                self.findings.warning(element.found, "unknown-port", message, f"it has {known}")
        skill = self.installed.get(name)
        if skill is None:
            for made in () if model is None else ports_of(model):
                key = made.get("name")
                text = made.get("default")
                if text and key not in ports:
                    ports[key] = Written(self.keys.wired(text, key))
            self.declare(name, ports, directions)
        elif skill.__module__.startswith("pomona.") and directions.keys() != {
            *skill.inputs,
            *skill.outputs,
        }:
            hint = "rename it, or let a <TreeNodesModel> give it the ports of that skill"
            raise NoEquivalentError("has the name of a skill of Pomona, not its ports", hint)
        return {name: ports}

    def declare(self, name: str, ports: Words, directions: Mapping[str, str]) -> None:
        """Declare a skill. Without a model, a port that is wired to a name not yet written is an output."""
        found = self.declared.setdefault(name, {})
        for port, text in ports.items():
            wire = text[1:-1] if text.startswith("{") else ""
            side = directions.get(port, "inout")
            is_new = bool(wire) and wire not in self.written
            is_output = side == "output" or (side == "inout" and is_new)
            known = [*found.get("in", ()), *found.get("out", ())]
            if port not in known:
                found.setdefault("out" if is_output else "in", []).append(port)
            if port in found.get("out", ()) and wire:
                self.written.add(wire)

    # ------------------------------------------------------------------------------------------ subtrees

    def subtree(self, element: ElementIn) -> Words:
        """Return a call; the subtree is written out when it uses blackboard keys.

        Raises NoEquivalentError: it has no equivalent in a tree file.
        """
        called = element.get("ID")
        tree = self.forest.trees.get(called)
        model = self.forest.subtrees.get(called)
        if tree is None:
            raise NoEquivalentError(
                f"calls '{called}', which none of the files defines", "give its file"
            )
        if called in self.inside:
            raise NoEquivalentError(f"'{called}' calls itself")
        if self.count > MOST_INLINED:
            raise NoEquivalentError("is too large to be written out")
        if element.found.children:
            raise NoEquivalentError("has children", "give the keys as attributes")
        shares = element.flag("_autoremap")
        wires = {n: element.get(n) for n in element.found.attributes if is_port(n) and n != "ID"}
        if len(tree.children) != 1 or not (wires or model or self.uses_keys(tree)):
            self.calls.add(called)
            named = (
                {}
                if called.isascii() or element.found.get("name")
                else {"name": self.label(called)}
            )
            return {self.names[called]: {}, **named}
        for port in () if model is None or shares else ports_of(model):
            if port.get("name") not in wires and not port.get("default"):
                raise NoEquivalentError(f"does not wire the port '{port.get('name')}'", "wire it")
            wires.setdefault(port.get("name"), port.get("default"))
        given: dict[str, str | GivenText] = {}
        for name, text in wires.items():
            key = key_in(text, name)
            given[name] = GivenText(text) if key is None else key
        outer = self.keys
        self.keys = KeyNames(outer.taken, outer, given, shares, f"{self.names[called]}_")
        self.inside.append(called)
        self.inlined.add(called)
        inlined = self.node(tree.children[0])
        self.inside.pop()
        self.keys = outer
        named = {} if element.found.get("name") else {"name": self.label(called)}
        return {"sequence": [inlined], **named}

    def uses_keys(self, tree: XmlElement) -> bool:
        """Return True if anything in a tree reads or writes a blackboard key."""
        scripts = {"code", "if", "output_key", *PRECONDITIONS, *AFTERWARDS}
        if scripts & tree.attributes.keys() or any("{" in t for t in tree.attributes.values()):
            return True
        below = self.forest.trees.get(tree.get("ID")) if tree.tag == "SubTree" else None
        return below is not None or any(map(self.uses_keys, tree.children))
