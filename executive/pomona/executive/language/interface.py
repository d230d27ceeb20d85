"""Declarations in a file → ports: parameters, inputs and outputs of subtrees, constants."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pomona.executive.language.literals import LiteralError, literal, scalar_type, type_word
from pomona.executive.language.model import Declared, Definition
from pomona.executive.language.value_types import ANY, ValueType
from pomona.executive.language.values import out_of_range
from pomona.executive.ports import REQUIRED, Port, PortType
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Findings, Instead, did_you_mean
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar

_TYPES_ELSEWHERE = {
    "str": "text",
    "string": "text",
    "float": "number",
    "double": "number",
    "boolean": "bool",
    "integer": "int",
    "duration": "time",
    "distance": "length",
}
"""Names of types in other languages, and the names here."""


@dataclass(slots=True, eq=False)
class PortDeclared:
    """Ports of one definition, as a skill's ports would be. Parameters are inputs with a default."""

    inputs: dict[str, Port] = field(default_factory=dict)
    outputs: dict[str, Port] = field(default_factory=dict)
    declared: dict[str, Declared] = field(default_factory=dict)


class InterfaceReader:
    """Reads the declarations of one file; each once."""

    def __init__(self, findings: Findings, skills: Registry) -> None:
        self.findings, self.skills = findings, skills
        self.ports: dict[int, Port | None] = {}
        self.defaults: dict[int, Any] = {}
        self.constants: dict[int, tuple[Any, ValueType]] = {}

    def interface(self, definition: Definition) -> PortDeclared:
        """Return the ports that a definition declares, with their types and defaults."""
        found = PortDeclared()
        for what, target, declarations in (
            ("input", found.inputs, definition.inputs),
            ("output", found.outputs, definition.outputs),
            ("parameter", found.inputs, definition.file.parameters if definition.main else {}),
        ):
            for name, declared in declarations.items():
                port = self.port(declared, what)
                target.setdefault(name, port if port is not None else Port(object))
                found.declared.setdefault(name, declared)
        return found

    def port(self, declared: Declared, what: str) -> Port | None:
        """Return the port that is declared; None when its type is unknown."""
        if id(declared) not in self.ports:
            self.ports[id(declared)] = self._read(declared, what)
        return self.ports[id(declared)]

    def _read(self, declared: Declared, what: str) -> Port | None:
        if declared.type is None:
            return None
        port_type = self.type_named(declared.type)
        if port_type is None:
            return None
        choices = tuple(choice.text for choice in declared.choices)
        default: Any = REQUIRED
        if declared.default is not None:
            if isinstance(declared.default, YamlScalar) and declared.default.text in ("none", "null", ""):
                default = None
            else:
                default = self._literal(declared.default, port_type, choices)
            self.defaults[id(declared)] = default
        bounds = [None if node is None else self._literal(node, port_type, ()) for node in (declared.min, declared.max)]
        port = Port(port_type, default, declared.help, bounds[0], bounds[1], choices)
        if declared.default is not None and default is not None:
            problem = out_of_range(default, port)
            if problem:
                message = f"the default of {what} '{declared.key.text}' {problem}"
                self.findings.error(declared.default, "range", message)
        return port

    def _literal(self, node: YamlNode, port_type: PortType, choices: tuple[str, ...]) -> Any:
        try:
            return literal(node, port_type, choices)
        except LiteralError as error:
            self.findings.error(error.where, "value", error.message, error.hint)
            return None

    def type_named(self, name: YamlScalar) -> PortType | None:
        """Return the type of this name; an unknown one is reported."""
        found = self.skills.types.get(name.text)
        if found is None:
            there, meant = sorted(self.skills.types), _TYPES_ELSEWHERE.get(name.text.lower(), "")
            hint = Instead(f"write '{meant}'", name.text, meant) if meant else did_you_mean(name.text, there)
            word = type_word(name)
            if not hint and word in there:
                also = f"; types: {', '.join(there)}" if word == "text" else ""
                hint = f"if it is the value, write {{type: {word}, default: {name.text}}}{also}"
            self.findings.error(name, "unknown-type", f"no type named '{name.text}'", hint)
        return found

    def constant(self, declared: Declared) -> tuple[Any, ValueType]:
        """Return a declared constant's value and type."""
        if id(declared) not in self.constants:
            node = declared.default
            if isinstance(node, YamlScalar) and "{" in node.text:
                message = f"the constant '{declared.key.text}' is known before the run: no name can be read in it"
                self.findings.error(node, "value", message, "compute it where it is read, or with 'set'")
            value = None if node is None else self._literal(node, object, ())
            value_type = scalar_type(node) if isinstance(node, YamlScalar) else (ANY if value is None else type(value))
            self.constants[id(declared)] = value, value_type
        return self.constants[id(declared)]
