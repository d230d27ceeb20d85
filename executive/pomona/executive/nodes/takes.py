"""Values that a word of the language can have: values, conditions, nodes, wires."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from pomona.executive.nodes.context import CheckContext, Entry
from pomona.executive.nodes.node_type import Field, NodeType, Reading, Schema, Stage, TreeNode
from pomona.executive.ports import TIME, Port
from pomona.executive.values.yaml_nodes import (
    ShapeCheck,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    shape_of,
)

Fields = Mapping[str, Field]
NAME = re.compile(r"[a-z][a-z0-9_]*")
NAME_SCHEMA = "^[a-z][a-z0-9_]*$"
_NODE: Schema = {"$ref": "#/$defs/node"}
_CONDITION: Schema = {"$ref": "#/$defs/condition"}


class Value(Field):
    """A literal, or an expression, of a port's type.

    `words` are also allowed, and no value: the type reads `given` for them. `known` values must be known before the
    run.
    """

    def __init__(
        self,
        port: Port,
        help: str = "",
        *,
        words: tuple[str, ...] = (),
        known: bool = False,
        required: bool = False,
    ) -> None:
        super().__init__(help, required=required)
        self.port = port
        self.words = words
        self.known = known

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        if isinstance(written, YamlScalar) and written.text in self.words:
            at.keep(slot, None, written)
        else:
            at.value(slot, written, self.port, known=self.known)

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        found = literal(self.port)
        return (
            {"anyOf": [*found.pop("anyOf", [found]), {"enum": list(self.words)}]}
            if self.words
            else found
        )


def duration(help: str = "", *, required: bool = False) -> Value:
    """Return a duration."""
    return Value(Port(TIME, min="0 s"), help, required=required)


def count(help: str = "", *, words: tuple[str, ...] = ()) -> Value:
    """Return a number of times, at least once."""
    return Value(Port(int, min=1), help, words=words)


class Single(Value):
    """A single value or a wire to one, no list and no mapping."""

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        if isinstance(written, YamlScalar) and not written.is_null:
            at.choice(slot, written)
        else:
            message = f"'{slot}' takes a single value, this is {shape_of(written)}"
            at.findings.error(written, "shape", message, f'wire it: {slot}: "{{name}}"')


class Condition(Field):
    """An expression that is true or false."""

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        at.condition(slot, written)

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return dict(_CONDITION)


class Elements(Field):
    """A list to go through."""

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        at.elements(slot, written)

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {}


class NewName(Field):
    """A name that the node writes, with an element of another slot's value."""

    def __init__(self, of: str, default: str, help: str = "") -> None:
        super().__init__(help)
        self.of = of
        self.default = default

    def declare(self, at: CheckContext, slot: str, stage: Stage) -> None:
        written = at.written(self.of)
        if stage is not Stage.COMPUTED or written is None:
            return
        name = at.written(slot)
        if name is None:
            key = next(key for key, value in at.node.modifiers.values() if value is written)
            target = YamlScalar(
                key.source, key.line, key.column, key.end_line, key.end_column, self.default, True
            )
        elif isinstance(name, YamlScalar) and NAME.fullmatch(name.text):
            target = name
        else:
            at.findings.error(
                name, "bad-name", f"'{slot}' takes a name without braces", f"{slot}: grasp"
            )
            return
        at.declare_output(self.of, target, written, True)

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"type": "string", "pattern": NAME_SCHEMA}


class Target(Field):
    """A name that the node writes with a text."""

    def declare(self, at: CheckContext, slot: str, stage: Stage) -> None:
        name = at.written(slot)
        if stage is not Stage.COMPUTED or name is None:
            return
        if isinstance(name, YamlScalar) and NAME.fullmatch(name.text):
            text = YamlScalar(
                name.source, name.line, name.column, name.end_line, name.end_column, "text", False
            )
            at.declare_output(slot, name, text, False)
        else:
            at.findings.error(
                name, "bad-name", f"'{slot}' takes a name without braces", f"{slot}: answer"
            )

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"type": "string", "pattern": NAME_SCHEMA}


class Words(Field):
    """A list of texts that are known before the run."""

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        items = written.items if isinstance(written, YamlList) else []
        if not items or not all(isinstance(item, YamlScalar) for item in items):
            reading.findings.error(
                written, "shape", f"'{slot}' is a list of texts", f"{slot}: [yes, no]"
            )

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        if isinstance(written, YamlList):
            at.keep(
                slot,
                tuple(item.text for item in written.items if isinstance(item, YamlScalar)),
                written,
            )

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"type": "array", "minItems": 1, "items": {"type": ["string", "number", "boolean"]}}


class Children(Field):
    """A list of nodes; `exactly` limits the number, and `leads` names the role of each."""

    nodes = True

    def __init__(self, help: str = "", *, leads: tuple[str, ...] = (), exactly: str = "") -> None:
        super().__init__(help)
        self.leads = leads
        self.exactly = exactly

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        if not isinstance(written, YamlList):
            message = f"'{slot}' takes a list of nodes, this is {shape_of(written)}"
            reading.findings.error(written, "shape", message, "start each child with '- '")
            return
        if not written.items:
            reading.findings.error(written, "shape", f"'{slot}' has no children")
        read = [reading.node(item) for item in written.items]
        node.children = [child for child in read if child is not None]
        node.leads = [*self.leads, *[""] * len(node.children)][: len(node.children)]
        if self.leads and len(written.items) != len(self.leads):
            words = {2: "two", 3: "three"}.get(len(self.leads), str(len(self.leads)))
            message = f"'{slot}' takes {words} nodes, here are {len(written.items)}"
            reading.findings.error(node.key, "shape", message, self.exactly)

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"$ref": "#/$defs/nodes"}


class Part(Field):
    """One node, which belongs to a modifier."""

    nodes = True

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        part = reading.node(written)
        if part is not None:
            part.comment = part.comment or reading.comment(node.modifiers[slot][0].line)
            node.parts[slot] = part

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return dict(_NODE)


class Child(Field):
    """One node, which is the next child of its type."""

    nodes = True

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        child = reading.node(written)
        if child is not None:
            node.children.append(child)
            node.leads.append(f"{slot}: ")

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return dict(_NODE)


class ChildOrCondition(Child):
    """The first child: a node, or an expression, which stands for a node of a type that looks at one."""

    def __init__(self, looks: NodeType, help: str = "") -> None:
        super().__init__(help)
        self.looks = looks

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        if isinstance(written, YamlMapping):
            super().take(reading, node, owner, slot, written)
            return
        w = written
        key = YamlScalar(w.source, w.line, w.column, w.end_line, w.end_column, self.looks.key, True)
        found = {self.looks.key: (key, written)}
        at = YamlMapping(w.source, w.line, w.column, w.end_line, w.end_column, found)
        node.children.append(TreeNode(self.looks, key, written, at))
        node.leads.append(f"{slot}: ")

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"anyOf": [dict(_CONDITION), dict(_NODE)]}


class Cases(Field):
    """Nodes by word."""

    nodes = True

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        entries = ShapeCheck(reading.findings).entries(written, slot, "'word: node' for each")
        if not entries:
            reading.findings.error(
                written, "shape", f"'{slot}' has no nodes", f"{slot}: {{word: node}}"
            )
        for key, value in entries:
            child = reading.node(value)
            if child is not None:
                child.comment = child.comment or reading.comment(key.line)
                node.children.append(child)
                node.leads.append(f"{key.text}: ")

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"type": "object", "minProperties": 1, "additionalProperties": dict(_NODE)}


class Ports(Field):
    """Wires to the ports of a called skill or subtree; the language looks them up."""

    wires = True

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        node.ports = ports_in(written)

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"$ref": "#/$defs/wires"}


class Wires(Ports):
    """Values by port."""

    def __init__(self, inputs: Mapping[str, Port]) -> None:
        super().__init__()
        self.inputs = inputs

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        at.check_ports(self.inputs, {})

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        ports = {name: literal(port) for name, port in self.inputs.items()}
        return {"type": ["object", "null"], "properties": ports, "additionalProperties": False}


class Assignments(Ports):
    """Values by the name to which they are written."""

    def declare(self, at: CheckContext, slot: str, stage: Stage) -> None:
        if stage is Stage.COMPUTED:
            for key, value in at.node.ports.values():
                at.declare_output(key.text, key, value, False)

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        is_null = isinstance(written, YamlScalar) and written.is_null
        if not at.node.ports and (is_null or isinstance(written, YamlMapping)):
            at.findings.error(
                at.node.key, "shape", f"'{slot}' sets nothing", f"write '{slot}: {{name: value}}'"
            )
        at.check_ports({name: Port(object) for name in at.node.ports}, {})

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"type": "object", "minProperties": 1, "propertyNames": {"pattern": NAME_SCHEMA}}


class Nothing(Field):
    """Nothing: `succeed: {}`."""

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        empty = not written.entries if isinstance(written, YamlMapping) else False
        if not (empty or (isinstance(written, YamlScalar) and written.is_null)):
            reading.findings.error(
                written, "shape", f"'{slot}' takes nothing", f"write '{slot}: {{}}'"
            )

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"type": ["object", "null"], "maxProperties": 0}


class ChildNames(Field):
    """`all`, `one`, a number of children, or a list of them by their labels."""

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        labels = [child.label for child in at.node.children]
        if isinstance(written, YamlScalar) and written.text in ("all", "one"):
            at.keep(slot, written.text, written)
        elif isinstance(written, YamlScalar) and written.text.isdecimal():
            if not 1 <= int(written.text) <= len(labels):
                message = f"{slot} is at least 1 and at most {len(labels)}, the number of children"
                at.findings.error(written, "range", message)
            at.keep(slot, int(written.text), written)
        elif isinstance(written, YamlList) and written.items:
            for item in written.items:
                if not isinstance(item, YamlScalar) or item.text not in labels:
                    hint = "children: " + ", ".join(labels)
                    at.findings.error(
                        item, "value", f"{slot} names children of this {at.node.kind}", hint
                    )
            names = tuple(item.text for item in written.items if isinstance(item, YamlScalar))
            at.keep(slot, names, written)
        else:
            at.findings.error(
                written, "value", f"{slot} is 'all', 'one', a number, or a list of children"
            )

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        number = {"type": "integer", "minimum": 1}
        names = {"type": "array", "items": {"type": "string"}}
        return {"anyOf": [{"enum": ["all", "one"]}, number, names]}


def ports_in(written: YamlNode) -> dict[str, Entry]:
    """Return the mapping behind a node that has ports; the check reports anything else, if the node is known."""
    return dict(written.entries) if isinstance(written, YamlMapping) else {}
