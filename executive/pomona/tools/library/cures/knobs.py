"""Places of a tree and a cell that hold one value, each with its type and the change that sets another value."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from pomona.executive.language.check import Analysis
from pomona.executive.language.model import Declared, Definition, TreeNode
from pomona.executive.language.scope import Resolved
from pomona.executive.nodes import takes
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.ports import Port
from pomona.executive.values.documents import Option
from pomona.executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar
from pomona.tools.library.cures.change import SingleChange, TextPiece, offset
from pomona.tools.library.cures.other_values import text_of

_PLAIN = re.compile(
    r"[A-Za-z0-9_.°%/²+-][A-Za-z0-9_.°%/²+ -]*"
)  # texts that need no quotes in YAML, also in braces


@dataclass(frozen=True, slots=True, eq=False)
class Knob:
    """A place that holds one value.

    Attributes:
        kind: port, parameter, word or option.
        name: for people: `Detect.score`, `attempts`, `Attempt.retry`.
        slot: the port's or word's own name, which remedies name.
        path, line: where the value is written, or the node whose default it is.
        text: the present value, as written.
        port: its type.
        default: the value without which nothing was written; None without one.
        setting: the parameter or option that holds it; empty for a place in a file.
        start, end, lead, trail: the characters of the file that the value replaces, and the texts around it.
        given: the run was started with this value (`--set`).
        unwritten: it is a default.
    """

    kind: str
    name: str
    slot: str
    path: str
    line: int
    text: str
    port: Port
    default: str | None = None
    setting: str = ""
    start: int = 0
    end: int = 0
    lead: str = ""
    trail: str = ""
    given: bool = False
    unwritten: bool = False

    def changed(self, text: str, size: float) -> SingleChange:
        """Return the change to another value."""
        about = self.kind, self.name, self.path, self.line, self.text, text, size
        if self.setting:
            return SingleChange(*about, settings={self.setting: text})
        piece = TextPiece(self.start, self.end, f"{self.lead}{quoted(text)}{self.trail}")
        return SingleChange(*about, piece=piece)


def quoted(text: str) -> str:
    """Return a text as YAML reads it again, with quotes where it needs them."""
    return (
        text
        if _PLAIN.fullmatch(text)
        else '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
    )


@dataclass(slots=True, eq=False)
class Knobs:
    """The places of a checked tree, and of the cell that it ran on."""

    analysis: Analysis
    settings: Mapping[str, str]
    options: tuple[Option, ...] = ()
    cell_path: str = ""
    cell_text: str = ""
    owner: dict[int, Definition] = field(init=False)  # of each node, by its id

    def __post_init__(self) -> None:
        self.owner = {
            id(node): definition
            for definition in self.analysis.document.definitions()
            for node in (definition.root.walk() if definition.root is not None else ())
        }

    def nodes(self) -> Iterator[TreeNode]:
        """Yield every node once, in the order of the files."""
        for definition in self.analysis.document.definitions():
            if definition.root is not None:
                yield from definition.root.walk()

    def layers(self, node: TreeNode) -> Iterator[tuple[NodeType, Resolved]]:
        """Yield the layers of a node that the check has resolved, from the outside to the inside."""
        for layer in node.layers:
            found = self.analysis.resolved.get((id(node), layer.key))
            if found is not None:
                yield layer, found

    def slots(self, layer: NodeType, found: Resolved) -> Mapping[str, Port]:
        """Return the inputs of a layer: the ports of a skill or a subtree, or the words of another type."""
        if found.skill is not None:
            return found.skill.inputs
        if found.subtree is not None:
            return self.analysis.interfaces[id(found.subtree)].inputs
        words = {
            slot: taken.port
            for slot, taken in layer.slots.items()
            if isinstance(taken, takes.Value)
        }
        wires = any(taken.wires for taken in layer.slots.values())
        return {**words, **(dict.fromkeys(found.node.ports, Port(object)) if wires else {})}

    def slot(self, node: TreeNode, layer: NodeType, found: Resolved, slot: str) -> Knob | None:
        """Return the place of a port or a word; None if it is wired, or holds no single value."""
        port = self.slots(layer, found)[slot]
        calls = found.skill is not None or found.subtree is not None
        wired = calls or (layer is node.type and slot in node.ports)
        entry = node.ports.get(slot) if wired else node.entry(layer, slot)
        kind = "port" if wired else "word"
        name = f"{node.label}.{slot}"
        default = None if port.required else text_of(port.default, port)
        if entry is not None:
            return _written(kind, name, slot, entry[1], port, default)
        if not calls or default is None:
            return None
        return self._unwritten(name, slot, node, port, default)

    def parameter(self, name: str) -> Knob | None:
        """Return a parameter of the main tree."""
        main = self.analysis.document.main
        declared = main.parameters.get(name)
        if declared is None or main.main is None:
            return None
        port = self.analysis.interfaces[id(main.main)].inputs.get(name, Port(object))
        default = declared.default.text if isinstance(declared.default, YamlScalar) else None
        text = self.settings.get(name, default)
        if text is None:
            return None
        place = declared.key
        return Knob(
            "parameter", name, name, place.source.path, place.line, text, port, default, name,
            given=name in self.settings,
        )  # fmt: skip

    def declared(self, declared: Declared, port: Port) -> Knob | None:
        """Return the value of a constant, or the default of a subtree's input."""
        name = declared.key.text
        return (
            None
            if declared.default is None
            else _written("port", name, name, declared.default, port, None)
        )

    def option(self, name: str) -> Knob | None:
        """Return an option of the cell."""
        option = next((one for one in self.options if one.name == name), None)
        if option is None:
            return None
        lines = self.cell_text.splitlines()
        line = next(
            (n for n, text in enumerate(lines, 1) if re.match(rf"\s+{re.escape(name)}\s*:", text)),
            1,
        )
        text = self.settings.get(name, option.default)
        return Knob(
            "option", name, name, self.cell_path, line, text, Port(object), option.default, name,
            given=name in self.settings,
        )  # fmt: skip

    def _unwritten(
        self, name: str, slot: str, node: TreeNode, port: Port, default: str
    ) -> Knob | None:
        """Return the place where a port would be written that has its default."""
        value = node.value
        text = node.key.source.text
        about = (node.key.source.path, node.key.line, default, port, default)
        if (
            isinstance(value, YamlMapping)
            and text[(at := offset(text, value.line, value.column)) : at + 1] == "{"
        ):
            lead = f"{slot}: "
            trail = ", " if value.entries else ""
            return Knob("port", name, slot, *about, "", at + 1, at + 1, lead, trail, unwritten=True)
        if isinstance(value, YamlMapping) and value.entries:
            at = offset(text, value.line, value.column)
            indent = " " * (value.column - 1)
            return Knob(
                "port", name, slot, *about, "", at, at, f"{slot}: ", f"\n{indent}", unwritten=True
            )
        return None


def _written(
    kind: str, name: str, slot: str, value: YamlNode, port: Port, default: str | None
) -> Knob | None:
    """Return the place of a value as it is written; None for a wire, a list or a text of several lines."""
    if (
        not isinstance(value, YamlScalar)
        or "{" in value.text
        or value.line != value.end_line
        or value.is_null
    ):
        return None
    text = value.source.text
    start = offset(text, value.line, value.column)
    end = offset(text, value.end_line, value.end_column)
    return Knob(
        kind, name, slot, value.source.path, value.line, value.text, port, default, "", start, end
    )
