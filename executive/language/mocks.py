"""Mocks: skills whose results are written in a file, to test a tree's logic without any cell.

mocks:
  Plan: [NO_PATH, success]                      # by call; the last one stays
  Look again: {status: failure, code: NO_FRUIT, after: 2 s, calls: 3}
  Refine: {outputs: {measured: {inlier_ratio: 0.7}}}
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from itertools import count
from typing import Any

from executive.language.literals import LiteralError, literal
from executive.language.value_types import ANY, ListOf, ValueType, describe, fields_of
from executive.ports import TIME, Port, Ports, Quantity, type_name
from executive.reasons import NoValue
from executive.registry import Registry
from executive.skill import Skill, Work
from executive.values.findings import Findings, did_you_mean
from executive.values.shape import ShapeCheck
from executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar

STATUSES = ("success", "failure", "running")
_KEYS = ("status", "after", "outputs", "code", "message", "calls")


class Placeholder:
    """Stands for a value that only the real skill could make; it has the fields that the mock was given."""

    is_placeholder = True

    def __init__(self, of: str, fields: Mapping[str, Any] | None = None) -> None:
        self._of, self._fields = of, dict(fields or {})

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._fields:
            raise NoValue(f"the mock gives a {self._of} without '{name}': add it to the mock's outputs")
        return self._fields[name]

    def __repr__(self) -> str:
        return f"<{self._of}>"


@dataclass(frozen=True, slots=True)
class MockResult:
    """How one call of a mock ends, after a duration on the run's clock."""

    status: str = "success"
    after: float = 0.0
    outputs: Mapping[str, Any] = field(default_factory=dict)
    code: str = ""
    message: str = ""


class MockSkill(Skill):
    """Stands in for a skill, with its ports, and ends as it was told."""

    results: tuple[MockResult, ...] = (MockResult(),)
    replaced: type[Skill] = Skill
    calls: Iterator[int]

    def run(self, **inputs: Any) -> Work[Mapping[str, object]]:
        result = self.results[min(next(self.calls), len(self.results)) - 1]
        if result.after > 0.0:
            yield from self.wait(result.after)
        while result.status == "running":
            yield "runs until it is interrupted"
        if result.status == "failure":
            raise self.failure(result.code, result.message or f"the mock of {self.replaced.__name__} fails")
        return {name: result.outputs.get(name, placeholder(self.replaced.outputs[name])) for name in self.outputs}


def mock_class(
    skill: type[Skill], results: Iterable[MockResult] = (), calls: Iterator[int] | None = None
) -> type[MockSkill]:
    """A class of mocks for a skill; `calls` numbers its calls from 1, those of mocks that share results, too."""
    body = {
        "inputs": skill.inputs,
        "outputs": Ports(**{name: Port(object) for name in skill.outputs}),
        "failures": (*skill.failures, "MOCKED"),
        "results": tuple(results) or (MockResult(),),
        "replaced": skill,
        "calls": calls or count(1),
        "__doc__": skill.__doc__,
    }
    return type(f"Mock{skill.__name__}", (MockSkill,), body)


def placeholder(port: Port) -> Any:
    """What a mock gives when it is not told: zero, an empty text, the first choice, or a placeholder."""
    port_type = port.type
    if isinstance(port_type, Quantity) or port_type is float:
        return 0.0
    if port_type in (bool, int):
        return port_type(0)
    if port_type is str:
        return port.choices[0] if port.choices else ""
    if issubclass(port_type, Enum):
        return next(iter(port_type))
    return Placeholder(type_name(port_type))


@dataclass(slots=True, eq=False)
class MockPlan:
    """Which skill is replaced by what; every skill that is not named succeeds at once.

    Attributes:
        results: by node path, node name or skill name; the most particular one counts.
        keep: names of skills that stay real.
        calls: numbers of the calls by what results are named after: nodes that share results share them.
    """

    results: Mapping[str, tuple[MockResult, ...]] = field(default_factory=dict)
    keep: frozenset[str] = frozenset()
    calls: dict[str, Iterator[int]] = field(default_factory=dict)

    def replace(self, skill: type[Skill], skill_name: str, label: str, path: str) -> Skill | None:
        """See `executive.language.build.Mocks`."""
        if skill_name in self.keep:
            return None
        below_root = path.partition("/")[2]
        for name in (path, below_root, label, skill_name):
            if name in self.results:
                calls = self.calls.setdefault(name, count(1))
                return mock_class(skill, self.results[name], calls)(label)
        return mock_class(skill)(label)


class MockReader:
    """Reads the `mocks` of a file. `nodes` maps what a mock may be named after to the skill that it replaces."""

    def __init__(self, findings: Findings, skills: Registry, nodes: Mapping[str, str]) -> None:
        self.findings, self.skills, self.nodes = findings, skills, nodes
        self.shape = ShapeCheck(findings)

    def read(self, node: YamlNode | None) -> dict[str, tuple[MockResult, ...]]:
        """Results by skill or node name, as the file says them."""
        found: dict[str, tuple[MockResult, ...]] = {}
        for key, value in self.shape.entries(node, "mocks", "'Skill: result' for each"):
            skill = self.skills.get(self.nodes.get(key.text, ""))
            if skill is None:
                hint = did_you_mean(key.text, self.nodes) or "name a skill or a node of the tree"
                self.findings.error(key, "unknown-node", f"the tree has no skill or node '{key.text}'", hint)
                continue
            calls = value.items if isinstance(value, YamlList) else [value]
            results = [result for call in calls for result in self.call(call, skill)]
            found[key.text] = tuple(results)
        return found

    def call(self, node: YamlNode, skill: type[Skill]) -> list[MockResult]:
        """One entry: a word, or a mapping that counts for so many calls."""
        if isinstance(node, YamlScalar):
            if node.text in STATUSES:
                return [MockResult(node.text, code="MOCKED")]
            self.code(node, skill)
            return [MockResult("failure", code=node.text)]
        at = self.shape.mapping(node, "a mock's result")
        if at is None:
            return []
        self.shape.known_keys(at, _KEYS, "a mock's result")
        code, message = self.shape.text(at.get("code")), self.shape.text(at.get("message"))
        if code is not None:
            self.code(code, skill)
        status = "failure" if code is not None else "success"
        written = self.shape.text(at.get("status"))
        if written is not None:
            status = written.text
            if status not in STATUSES:
                self.findings.error(written, "value", f"a mock's status is one of {', '.join(STATUSES)}")
        result = MockResult(
            status,
            self.value(at.get("after"), TIME, 0.0),
            self.outputs(at.get("outputs"), skill),
            code.text if code is not None else "MOCKED",
            message.text if message is not None else "",
        )
        return [result] * max(1, min(self.value(at.get("calls"), int, 1), 10_000))

    def code(self, code: YamlScalar, skill: type[Skill]) -> None:
        """Report a code with which the skill never fails."""
        if code.text not in skill.failures:
            hint = did_you_mean(code.text, (*skill.failures, *STATUSES)) or "codes: " + ", ".join(skill.failures)
            message = f"{skill.__name__} never fails with {code.text}"
            self.findings.error(code, "unknown-code", message, hint)

    def value(self, node: YamlNode | None, value_type: ValueType, default: Any) -> Any:
        if node is None:
            return default
        try:
            return literal(node, value_type)
        except LiteralError as error:
            self.findings.error(error.where, "value", error.message, error.hint)
            return default

    def outputs(self, node: YamlNode | None, skill: type[Skill]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in self.shape.entries(node, "outputs", "'port: value' for each"):
            port = skill.outputs.get(key.text)
            if port is None:
                hint = did_you_mean(key.text, skill.outputs) or "outputs: " + (", ".join(skill.outputs) or "none")
                message = f"{skill.__name__} has no output '{key.text}'"
                self.findings.error(key, "unknown-port", message, hint)
                continue
            found[key.text] = self.stand_in(value, port.type)
        return found

    def stand_in(self, node: YamlNode, value_type: ValueType) -> Any:
        """A literal; a mapping for a class becomes a placeholder with some of the class's fields."""
        if isinstance(node, YamlList) and isinstance(value_type, ListOf):
            return tuple(self.stand_in(item, value_type.element) for item in node.items)
        fields = fields_of(value_type)
        if isinstance(node, YamlMapping) and fields:
            given: dict[str, Any] = {}
            for key, value in node.entries.values():
                if key.text not in fields:
                    hint = did_you_mean(key.text, fields) or "fields: " + ", ".join(fields)
                    message = f"{describe(value_type)} has no field '{key.text}'"
                    self.findings.error(key, "unknown-field", message, hint)
                    continue
                given[key.text] = self.stand_in(value, fields[key.text])
            return Placeholder(describe(value_type).split(" ", 1)[-1], given)
        return self.value(node, ANY if value_type is object else value_type, None)
