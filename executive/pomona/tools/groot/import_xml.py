"""XML of Groot2 and BehaviorTree.CPP (version 4) → the text of a tree file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pomona.executive.language.expression import SPECIAL
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.leaves import SKILL
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Finding, Findings
from pomona.tools.groot.asked import Asked
from pomona.tools.groot.element_in import (
    AFTERWARDS,
    ATTRIBUTES,
    PRECONDITIONS,
    ElementIn,
    Words,
    is_port,
    meant,
    value_of,
)
from pomona.tools.groot.files import Forest, own_metadata, ports_of
from pomona.tools.groot.forms import Forms, form_of
from pomona.tools.groot.keys import NAME, GivenText, KeyNames, ScriptError, key_in, small
from pomona.tools.groot.names import BUILTIN, NEEDED, node_name, skill_name, tree_names
from pomona.tools.groot.scripts import assignments_of, condition_of, statements_of
from pomona.tools.groot.stubs import with_stubs
from pomona.tools.groot.version_3 import KEY
from pomona.tools.groot.xml_nodes import XmlElement
from pomona.tools.groot.yaml_text import YamlText, block, flow

_GENERIC = ("Action", "Condition", "Control", "Decorator")
_OTHER = "write it with other nodes"
SHARING = (
    "__shared_blackboard",
    "__autoremap",
    "_autoremap",
)  # attributes of a call that are true or false
TRUE, FALSE = ("true", "TRUE", "True", "1"), ("false", "FALSE", "False", "0")
_SAME_FAILURE: Words = {"fail": {"code": "{failure.code}", "message": "{failure.message}"}}
"""Fails with the code and message of the last failure."""


def import_groot(
    text: str,
    path: str | Path,
    *,
    beside: Sequence[tuple[str, str | Path]] = (),
    nodes: Sequence[tuple[str, str | Path]] = (),
    main: str = "",
    skills: Mapping[str, type[Skill]] | None = None,
    stubs: bool = False,
) -> tuple[str, list[Finding]]:
    """Return the text of a tree file, empty if nothing can be translated, and the parts without translation.

    `beside` are further files (texts and paths) whose trees are called, `nodes` files with models of nodes
    (`<TreeNodesModel>`), `main` the ID of the tree to run. `skills` are the installed ones: a foreign node with the
    name of one of Pomona's gets another name. With `stubs`, the skills that are not installed are declared in the
    tree. Raises nothing. Foreign nodes may not be installed as skills: check the text before a run.
    """
    findings = Findings()
    forest = Forest(findings)
    for models, where in nodes:
        forest.read_models(models, where)
    forest.read([(text, path), *beside], main)
    if not forest.main:
        return "", findings.sorted()
    importer = _Importer(forest, NodeTypes.installed(), skills or {})
    written = importer.file()
    if stubs:
        directions = {name: forest.directions(node) for node, name in importer.skills_of.items()}
        written = with_stubs(written, skills or {}, directions)
    return written, findings.sorted()


class _Importer:
    def __init__(self, forest: Forest, types: NodeTypes, skills: Mapping[str, type[Skill]]) -> None:
        self.forest, self.findings, self.types, self.installed = (
            forest,
            forest.findings,
            types,
            skills,
        )
        self.words = {word for text in forest.texts for word in re.findall(r"\w+", text)}
        self.skills_of: dict[str, str] = {}  # names of skills, by the ID of the foreign node
        self.names = tree_names(forest.trees, self.types)
        for tree_id, tree in forest.trees.items():
            if not tree_id.isascii():
                message = f"the tree '{tree_id}' is called '{self.names[tree_id]}' here"
                self.findings.warning(
                    tree, "renamed", message, "names of trees have the letters a-z, digits and _"
                )
        self.keys = KeyNames(set())
        self.labels: set[str] = set()  # names of nodes that are taken in the tree being read
        self.inside: list[str] = []
        self.inlined: set[str] = set()
        self.calls: set[str] = set()
        self.forms = Forms(types)
        self.asked = Asked(forest, self.forms)
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
        subtrees = {
            self.names[i]: found
            for i, found in subtrees.items()
            if i in self.calls or i not in self.inlined
        }
        if subtrees:
            top["subtrees"] = subtrees
        return "\n".join(block(top)) + "\n"

    def interface(self, model: XmlElement | None) -> Words:
        """Parameters, constants and ports, from our own metadata."""
        if model is None:
            return {}
        metadata = own_metadata(model)
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
            self.findings.error(
                tree,
                "xml",
                f"a <BehaviorTree> must have one child, this one has {len(tree.children)}",
            )
        self.keys, self.labels, self.inside = KeyNames({*self.words, *SPECIAL}), set(), [tree_id]
        found = [self.node(child) for child in tree.children]
        return found[0] if len(found) == 1 else {"untranslated": found, "element": tree.tag}

    # ------------------------------------------------------------------------------------------- nodes

    def node(self, element: XmlElement) -> Words:
        """Return a node of a tree file; a placeholder when there is no equivalent."""
        tag = element.get("ID") if element.tag in _GENERIC else element.tag
        self.count += len(self.inside) > 1
        reading = ElementIn(self, element, tag)
        try:
            found = self.bare(reading)
        except ScriptError as error:
            found = reading.untranslated(str(error))
        if reading.unread:
            found = reading.untranslated(
                _unknown_ports(reading), "remove it, or write its right name"
            )
        else:
            self.look_alikes(reading)
        if element.get("name") and "name" not in found and not reading.wrapped:
            found["name"] = self.label(element.get("name"))
        if element.get("_description") and "description" not in found:
            found["description"] = element.get("_description")
        return self.conditions(element, found)

    def look_alikes(self, reading: ElementIn) -> None:
        """Report attributes of every node that are written in another way: BehaviorTree.CPP does not read them."""
        element = reading.found
        for name in element.attributes:
            old = (
                name in ("__shared_blackboard", "__autoremap")
                and self.forest.version(element) == "3"
            )
            hint = "_autoremap" if name == "__shared_blackboard" else meant(name)
            if hint and not old:
                message = f"'{name}' of <{reading.tag}> is not read by BehaviorTree.CPP 4"
                self.findings.warning(element, "ignored", message, f"did you mean '{hint}'?")
        if "ID" in element.attributes and element.tag not in (*_GENERIC, "SubTree", "SubTreePlus"):
            message = f"'ID' of <{reading.tag}> is not read; BehaviorTree.CPP 4 refuses it"
            self.findings.warning(
                element, "ignored", message, "write 'name' for the name of a node"
            )

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
        form = self.forms.of_tag(tag)
        if not tag:
            return element.untranslated("has no ID")
        needed = NEEDED.get(tag)
        if needed is not None and not element.get(needed):
            return element.untranslated(f"has no '{needed}'")
        why = self.asked.why_not(tag, element.found)
        if why:
            return element.untranslated(why)
        if form is not None:
            word = form.word
            if word.role == "modifier":
                parts = (
                    0
                    if tag in word.other_names
                    else sum(taken.nodes for taken in word.fields.values())
                )
                if not 1 <= len(element.found.children) <= 1 + parts:
                    return element.untranslated(f"has {len(element.found.children)} children")
            return form.from_xml(element)
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
        if tag in BUILTIN:
            return element.untranslated("has no counterpart in tree files")
        if tag in self.forest.trees and tag not in self.forest.nodes:
            return element.untranslated(
                f'has the name of a tree: call it with <SubTree ID="{tag}"/>'
            )
        if not re.fullmatch(r"[A-Z][A-Za-z0-9_]*", tag):
            return element.untranslated(
                "has a name that no skill can have: a capital letter, then A-Z, a-z, 0-9 and _; "
                f"call it {skill_name(tag)}"
            )
        return self.skill(element, self.forest.nodes.get(tag))

    def skill(self, element: ElementIn, model: XmlElement | None) -> Words:
        """Return a custom node; a model that was given beside the tree has the defaults of ports that are not wired."""
        found = form_of(SKILL).from_xml(element)
        if element.tag not in found:
            return found
        ports = found[element.tag]
        name = self.skills_of[element.tag] = self.skills_of.get(element.tag) or self.name_of_skill(
            element
        )
        if model is None:
            self.ports_of_file(element, ports)
            return {name: ports}
        if model.tag not in ("Action", "Condition"):
            return element.untranslated(f"is a custom {model.tag} node")
        known = {port.get("name"): port for port in ports_of(model)}
        unknown = [port for port in ports if port not in known]
        if unknown:
            return element.untranslated(
                f"has no port '{unknown[0]}', its model has {', '.join(known) or 'none'}"
            )
        defaults = {
            port: made.get("default") for port, made in known.items() if made.get("default")
        }
        keys = {port: key_in(text, port) for port, text in defaults.items()}
        wired = {
            p: text if (key := keys[p]) is None else self.keys.wired_key(key)
            for p, text in defaults.items()
        }
        return {name: {**{port: value_of(text) for port, text in wired.items()}, **ports}}

    def ports_of_file(self, element: ElementIn, ports: Words) -> None:
        """Report ports that the model in the tree's own file does not have; BehaviorTree.CPP does not read that."""
        model = self.forest.described.get(element.tag)
        if model is None or self.forest.is_exported(element.found):
            return
        known = [port.get("name") for port in ports_of(model)]
        for port in ports:
            if port not in known:
                message = f"<{element.tag}> has no port '{port}' in the file's <TreeNodesModel>"
                self.findings.warning(
                    element.found, "unknown-port", message, f"it has {', '.join(known) or 'none'}"
                )

    def name_of_skill(self, element: ElementIn) -> str:
        """Return the name of a foreign node: another one, if it has the name of a skill of Pomona by chance."""
        name = element.tag
        skill = self.installed.get(name)
        if (
            skill is None
            or not skill.__module__.startswith("pomona.")
            or self.forest.is_exported(element.found)
        ):
            return name
        if self.forest.directions(name).keys() == {*skill.inputs, *skill.outputs}:
            return name
        found, number = f"Foreign{name}", 1
        while found in self.words or found in self.installed:
            number += 1
            found = f"Foreign{name}{number}"
        message = f"<{name}> has the name of a skill of Pomona, and is called {found} here"
        hint = f"write {name} in the tree if it is that skill; a model with its ports (--nodes) says so, too"
        self.findings.warning(element.found, "renamed", message, hint)
        return found

    def subtree(self, element: ElementIn) -> Words:
        """Return a call; inlined when the subtree uses blackboard keys that it does not declare."""
        called = element.get("ID")
        tree, model = self.forest.trees.get(called), self.forest.models.get(called)
        if tree is None:
            return element.untranslated(f"calls '{called}', which none of the files defines")
        if (
            called in self.inside or self.count > 10_000
        ):  # most nodes in inlined subtrees; as many as can run
            return element.untranslated(
                "calls itself" if called in self.inside else "is too large to be inlined"
            )
        if element.found.children:
            return element.untranslated("has children: give the keys as attributes")
        version = self.forest.version(element.found)
        wires = {name: element.get(name) for name in element.attributes if is_port(name)}
        for word in SHARING:
            if element.get(word) not in ("", *TRUE, *FALSE):
                return element.untranslated(
                    f'has {word}="{element.get(word)}", which is neither true nor false'
                )
        shared = version == "3" and element.get("__shared_blackboard") in TRUE
        bare = [
            n
            for n, t in wires.items()
            if not version and KEY.fullmatch(t) and t not in ("true", "false")
        ]
        if bare:
            return element.untranslated(
                f'has {bare[0]}="{wires[bare[0]]}", a key in version 3 and a text in version 4: write '
                f'"{{{wires[bare[0]]}}}", or BTCPP_format="4" in <root>'
            )
        if shared and wires:
            return element.untranslated(
                "shares its caller's blackboard and has ports, which version 3 does not read"
            )
        declared = model is not None and own_metadata(model) is not None
        if declared or not (wires or model or self.uses_keys(tree)) or len(tree.children) != 1:
            self.calls.add(called)
            found: Words = {self.names[called]: {name: element.value(name) for name in wires}}
            return (
                found
                if called.isascii() or element.get("name")
                else {**found, "name": self.label(called)}
            )
        shares = element.get("_autoremap") in TRUE or (
            version == "3" and element.get("__autoremap") in TRUE
        )
        for port in () if model is None or shares or shared else ports_of(model):
            if port.get("name") not in wires and not port.get("default"):
                return element.untranslated(f"does not wire the port '{port.get('name')}'")
            wires.setdefault(port.get("name"), port.get("default"))
        outer, given = self.keys, {}
        for name, text in wires.items():
            key = key_in(text, name)
            given[name] = GivenText(text) if key is None else key
        if not shared:
            private = "__autoremap" not in element.attributes
            prefix = f"{small(self.names[called])}_"
            self.keys = KeyNames(outer.taken, outer, given, shares, private, prefix)
        self.inside.append(called)
        self.inlined.add(called)
        inlined = self.node(tree.children[0])
        self.inside.pop()
        self.keys = outer
        named = {} if element.get("name") else {"name": self.label(called)}
        return {"sequence": [inlined], **named}

    def uses_keys(self, tree: XmlElement) -> bool:
        """Return True if anything in a tree reads or writes a blackboard key."""
        for name, text in tree.attributes.items():
            script = name in ("code", "if") or (name.startswith("_") and name not in ATTRIBUTES)
            if "{" in text or script or name == "output_key":
                return True
        below = self.forest.trees.get(tree.get("ID")) if tree.tag == "SubTree" else None
        return below is not None or any(map(self.uses_keys, tree.children))

    def script(self, element: ElementIn) -> Words:
        code, steps = element.get("code"), []
        if element.tag == "ScriptCondition":
            *before, last = statements_of(code) or [""]
            steps = self.assigned(";".join(before)) if before else []
            steps.append({"check": condition_of(last, self.keys)})
        else:
            steps = self.assigned(code)
        return steps[0] if len(steps) == 1 else {"sequence": steps}

    def assigned(self, script: str) -> list[Words]:
        return [
            {"set": YamlText(flow({name: value}))}
            for name, value in assignments_of(script, self.keys)
        ]

    def assignment(self, element: ElementIn) -> Words:
        """`SetBlackboard` copies a text or a wire to a key."""
        written = element.get("output_key")
        if not written or "value" not in element.attributes:
            return element.untranslated("names no key, or no value")
        if key_in(written, "") is not None:
            return element.untranslated(f"writes to the key whose name {written} holds")
        return {"set": YamlText(flow({self.keys.target(written): element.value("value")}))}

    def attempt(self, element: ElementIn) -> Words:
        """`TryCatch`: a sequence; when it fails, the last child runs, and the node still fails."""
        *tried, caught = element.children() or [{}]
        if not tried or element.get("catch_on_halt") in ("true", "1"):
            return element.untranslated(
                "also catches an interruption" if tried else "has too few children"
            )
        caught = self.modified(caught, "force", "success", {})
        return _ended({"sequence": tried}, [], [caught])

    def loop(self, element: ElementIn) -> Words:
        """`LoopInt` and the like over a literal list; a queue on the blackboard would be emptied by its readers."""
        children, queue, at_the_end = (
            element.children(),
            str(element.value("queue")),
            element.get("if_empty"),
        )
        key = self.keys.target(key_in(element.get("value"), "value") or "")
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
        otherwise: dict[str, Words] = {
            "FAILURE": {"fail": {}},
            "SUCCESS": {"succeed": {}},
            "SKIPPED": {},
        }
        children, status = element.children(), element.get("else") or "FAILURE"
        if len(children) != 1 or status not in otherwise:
            return element.untranslated(f"has {len(children)} children and ends as {status}")
        found: Words = {"if": condition_of(element.get("if"), self.keys), "then": children[0]}
        return {**found, "else": otherwise[status]} if otherwise[status] else found

    def conditions(self, element: XmlElement, found: Words) -> Words:
        """Put the pre- and postconditions of BehaviorTree.CPP around a node."""
        others = [
            name for name in element.attributes if name.startswith("_") and name not in ATTRIBUTES
        ]
        for name in (
            "_onHalted",
            *reversed(PRECONDITIONS),
        ):  # BehaviorTree.CPP reads no others that begin with _
            if name not in element.attributes:
                continue
            if name == "_onHalted":
                why = "follows an interruption"
                found = self.untranslated(element, name, {"code": element.get(name)}, [found], why)
                continue
            try:
                found = _guarded(found, name, condition_of(element.get(name), self.keys))
            except ScriptError as error:
                found = self.untranslated(
                    element, name, {"code": element.get(name)}, [found], str(error)
                )
        return self.afterwards(element, found) if set(others) & set(AFTERWARDS) else found

    def afterwards(self, element: XmlElement, found: Words) -> Words:
        """Scripts that follow a node's end in the same tick; none when it is skipped or interrupted."""
        scripts = {name: element.get(name) for name in AFTERWARDS}
        try:
            steps = {
                name: self.assigned(script) if script else [] for name, script in scripts.items()
            }
        except ScriptError as error:
            given = {name: script for name, script in scripts.items() if script}
            return self.untranslated(element, next(iter(given)), given, [found], str(error))
        return _ended(
            found, steps["_onSuccess"] + steps["_post"], steps["_onFailure"] + steps["_post"]
        )

    def untranslated(
        self,
        element: XmlElement,
        name: str,
        attributes: Words,
        children: list[Words],
        why: str,
        hint: str = _OTHER,
    ) -> Words:
        """Return a placeholder that `check` refuses."""
        self.findings.error(element, "not-translated", f"<{name}> {why}", hint)
        found: Words = {"untranslated": children, "element": name}
        return {**found, "attributes": attributes} if attributes else found

    def modified(self, child: Words, name: str, value: object, more: Words) -> Words:
        """Return the child with one more modifier; a sequence around it keeps the order of modifiers."""
        order = [modifier.key for modifier in self.types.modifiers]
        inside = [order.index(other) for other in order if other in child]
        if inside and max(inside) >= order.index(name):
            child = {"sequence": [child]}
        return {**child, name: value, **more}


def _guarded(found: Words, name: str, condition: str) -> Words:
    """Return the steps of BehaviorTree.CPP before a node that has a precondition."""
    if name == "_skipIf":
        inner = {"sequence": [found]} if "when" in found else found
        return {**inner, "when": f"not ({condition})"}
    if name == "_while":
        return {"reactive_if": condition, "then": found}
    return {
        "if": condition,
        "then": {"succeed": {}} if name == "_successIf" else {"fail": {}},
        "else": found,
    }


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


def _unknown_ports(element: ElementIn) -> str:
    unknown = " and ".join(f"'{name}'" for name in element.unread)
    known = sorted(name for name in element.asked if is_port(name))
    return f"has no port {unknown}; " + (
        f"it takes {', '.join(known)}" if known else "it takes none"
    )


def _declared(port: object) -> object:
    if isinstance(port, str):
        return YamlText(port or "null")
    if not isinstance(port, dict):
        return YamlText("null")
    found: Words = {}
    for key, value in port.items():
        found[str(key)] = (
            YamlText(value)
            if key in ("default", "min", "max") and isinstance(value, str)
            else value
        )
    return found["type"] if list(found) == ["type"] else found
