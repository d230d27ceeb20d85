"""Values of a tree's parameters: defaults, or the values of `--set name=value`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.language.interface import InterfaceReader
from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.model import Declared, TreeFile
from pomona.executive.language.values import out_of_range
from pomona.executive.ports import Port
from pomona.executive.values.findings import Finding, Findings, Source, did_you_mean
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar, read_yaml

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def parameter_values(
    file: TreeFile, overrides: Mapping[str, str] | Sequence[str], reader: InterfaceReader, findings: Findings
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
            findings.error(parameter.key, "no-value", message, f"add a default, or run with --set {name}=…")
            values[name] = None
    return values


def _named(
    overrides: Mapping[str, str] | Sequence[str], declared: Mapping[str, Declared], findings: Findings
) -> dict[str, str]:
    texts = [f"{k}={v}" for k, v in overrides.items()] if isinstance(overrides, Mapping) else list(overrides)
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
    source = Source(f"--set {written}", text)
    node: YamlNode | None = YamlScalar(source, 1, 1, 1, len(text) + 1, text, True)
    if text[:1] in ("[", "{"):
        node = read_yaml(source, Findings())
    if node is None:
        _error(findings, written, "this is not YAML")
        return None
    try:
        value = literal(node, port.type, port.choices)
    except LiteralError as error:
        _error(findings, written, error.message, error.hint)
        return None
    problem = out_of_range(value, port)
    if problem:
        _error(findings, written, f"{name} {problem}")
    return value


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
