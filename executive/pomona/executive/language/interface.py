"""Declarations in a file → ports, and the values that they get from outside: `--set`, or a change during the run."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.language.literals import LiteralError, literal, scalar_type, type_word
from pomona.executive.language.model import Declared, Definition, TreeFile
from pomona.executive.language.value_types import ANY, ValueType
from pomona.executive.language.values import out_of_range
from pomona.executive.ports import REQUIRED, Port, PortType
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Finding, Findings, Instead, Source, did_you_mean
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar, read_yaml

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
        self.findings = findings
        self.skills = skills
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
            if isinstance(declared.default, YamlScalar) and declared.default.text in (
                "none",
                "null",
                "",
            ):
                default = None
            else:
                default = self._literal(declared.default, port_type, choices)
            self.defaults[id(declared)] = default
        bounds = [
            None if node is None else self._literal(node, port_type, ())
            for node in (declared.min, declared.max)
        ]
        port = Port(port_type, default, declared.help, bounds[0], bounds[1], choices)
        if declared.default is not None and default is not None:
            problem = out_of_range(default, port, getattr(declared.default, "text", ""))
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
        found = self.skills.type_named(name.text)
        if found is None:
            there = sorted(self.skills.types)
            meant = _TYPES_ELSEWHERE.get(name.text.lower(), "")
            hint = (
                Instead(f"write '{meant}'", name.text, meant)
                if meant
                else did_you_mean(name.text, there)
            )
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
                self.findings.error(
                    node, "value", message, "compute it where it is read, or with 'set'"
                )
            value = None if node is None else self._literal(node, object, ())
            value_type = (
                scalar_type(node)
                if isinstance(node, YamlScalar)
                else (ANY if value is None else type(value))
            )
            self.constants[id(declared)] = value, value_type
        return self.constants[id(declared)]


_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def parameter_values(
    file: TreeFile,
    overrides: Mapping[str, str] | Sequence[str],
    reader: InterfaceReader,
    findings: Findings,
) -> dict[str, Any]:
    """Return every parameter's value; a wrong override is a finding, and its value is None."""
    given = _named(overrides, file.parameters, findings)
    values: dict[str, Any] = {}
    for name, parameter in file.parameters.items():
        port = reader.port(parameter, "parameter")
        if port is None:
            continue
        if name in given:
            values[name] = read_override(name, given[name], port, findings)
        elif parameter.default is not None:
            values[name] = reader.defaults.get(id(parameter))
        else:
            message = f"parameter '{name}' has no default and was not given"
            findings.error(
                parameter.key, "no-value", message, f"add a default, or run with --set {name}=…"
            )
            values[name] = None
    return values


def _named(
    overrides: Mapping[str, str] | Sequence[str],
    declared: Mapping[str, Declared],
    findings: Findings,
) -> dict[str, str]:
    texts = (
        [f"{k}={v}" for k, v in overrides.items()]
        if isinstance(overrides, Mapping)
        else list(overrides)
    )
    given: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        name = name.strip()
        if not equals or not _NAME.fullmatch(name):
            _error(findings, text, "write --set name=value")
        elif name not in declared:
            hint = did_you_mean(name, declared) or "parameters: " + (", ".join(declared) or "none")
            _error(findings, text, f"the tree has no parameter '{name}'", hint)
        else:
            given[name] = value.strip()
    return given


def read_override(name: str, text: str, port: Port, findings: Findings) -> Any:
    """Return a parameter's value as written after `--set name=`; a wrong one is a finding, and the value is None."""
    written = f"{name}={text}"
    value, problem, hint = value_of(Source(f"--set {written}", text), port)
    if problem:
        _error(findings, written, problem.format(name), hint)
    return value


def value_of(source: Source, port: Port) -> tuple[Any, str, str]:
    """Return the value that a text means for a port, what is wrong with it, and a hint; {} stands for the port."""
    text = source.text
    node: YamlNode | None = YamlScalar(source, 1, 1, 1, len(text) + 1, text, True)
    if text[:1] in ("[", "{"):
        node = read_yaml(source, Findings())
    if node is None:
        return None, "this is not YAML", ""
    try:
        value = literal(node, port.type, port.choices)
    except LiteralError as error:
        return None, error.message.replace("{", "{{").replace("}", "}}"), error.hint
    problem = out_of_range(value, port, text)
    return value, problem and "{} " + problem, ""


def _error(findings: Findings, text: str, message: str, hint: str = "") -> None:
    findings.add(Finding(f"--set {text}", 0, 0, "error", "set", message, hint))


def parse_settings(given: Sequence[str]) -> dict[str, str]:
    """`["attempts=20"]` -> `{"attempts": "20"}`; the last one wins. Raises UsageError: a text without '='."""
    settings = {}
    for text in given:
        key, equals, value = text.partition("=")
        if not equals or not key.strip():
            raise UsageError(f"--set {text}: write key=value")
        settings[key.strip()] = value.strip()
    return settings
