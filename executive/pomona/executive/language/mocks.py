"""Mocks: skills that end as a file states, to test a tree's logic without any cell; the file is judged by that tree.

mocks:
  Plan: [NO_PATH, success]                      # by call; the last one stays
  Look again: {status: failure, code: NO_FRUIT, after: 2 s, calls: 3}
  Refine: {outputs: {measured: {inlier_ratio: 0.7}}}
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from itertools import count
from pathlib import Path
from typing import Any, TypeVar

from pomona.executive.language.built import skills_by_node
from pomona.executive.language.interface import InterfaceReader
from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.model import Document
from pomona.executive.language.value_types import ANY, ListType, ValueType, describe, fields_of
from pomona.executive.ports import TIME, Port, Ports, Quantity, type_name
from pomona.executive.reasons import NoValue
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill, Work
from pomona.executive.values.findings import (
    Finding,
    Findings,
    Instead,
    Source,
    did_you_mean,
    few_hints,
)
from pomona.executive.values.kinds import Kind, MappingOf, Measure, Schema, Text, Whole, read_each
from pomona.executive.values.removed import report_removed
from pomona.executive.values.sections import Placed, Section, value
from pomona.executive.values.yaml_nodes import (
    Reader,
    Refused,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    read_yaml,
    shape_of,
)


class Placeholder:
    """Stands for a value that only the real skill could make; it has the fields that the mock was given."""

    is_placeholder = True

    def __init__(self, of: str, fields: Mapping[str, Any] | None = None) -> None:
        self._of, self._fields = of, dict(fields or {})

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._fields:
            raise NoValue(
                f"the mock gives a {self._of} without '{name}': add it to the mock's outputs"
            )
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
    """Replaces a skill, with its ports, and ends with the given result."""

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
            raise self.failure(
                result.code, result.message or f"the mock of {self.replaced.__name__} fails"
            )
        return {
            name: result.outputs.get(name, placeholder(self.replaced.outputs[name]))
            for name in self.outputs
        }


def mock_class(
    skill: type[Skill], results: Iterable[MockResult] = (), calls: Iterator[int] | None = None
) -> type[MockSkill]:
    """Return a class of mocks for a skill; `calls` numbers its calls from 1, those of mocks that share results, too."""
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
    """Return an output that a mock has no value for: zero, an empty text, the first choice, or a placeholder."""
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
    """The mocks of a run; a skill without a result succeeds at once."""

    # by node path, node name or skill name; the most specific one applies
    results: Mapping[str, tuple[MockResult, ...]] = field(default_factory=dict)
    keep: frozenset[str] = frozenset()  # names of skills that stay real
    # number of calls by the key of `results`: nodes that share results share the number
    calls: dict[str, Iterator[int]] = field(default_factory=dict)

    def replace(self, skill: type[Skill], skill_name: str, label: str, path: str) -> Skill | None:
        """See `pomona.executive.language.build.Mocks`."""
        if skill_name in self.keep:
            return None
        below_root = path.partition("/")[2]
        for name in (path, below_root, label, skill_name):
            if name in self.results:
                calls = self.calls.setdefault(name, count(1))
                return mock_class(skill, self.results[name], calls)(label)
        return mock_class(skill)(label)


T = TypeVar("T")
ENDS = ("success", "failure")
STATUSES = (*ENDS, "running")
Results = Mapping[str, tuple[MockResult, ...]]
MOCKS_KEYS = ("pomona", "mocks")


@dataclass(frozen=True, slots=True, kw_only=True)
class Tested:
    """Names of the tested tree that a scenario may use."""

    registry: Registry
    skills: Mapping[str, str]  # the skill that a mock of a node replaces, by every name of the node
    names: Collection[str]  # of all nodes
    questions: Mapping[
        str, tuple[str, ...]
    ]  # by the name of a node that asks, the answers that it takes
    parameters: Mapping[str, Port | None]  # of the tree; None for one of unknown type

    @classmethod
    def of(cls, document: Document, registry: Registry) -> Tested:
        """Return all that is in a document, with the skills that it declares."""
        registry = registry.declaring(document.main.declared_skills)
        skills = skills_by_node(document)
        nodes = [
            node
            for definition in document.definitions()
            if definition.root
            for node in definition.root.walk()
        ]
        questions: dict[str, tuple[str, ...]] = {}
        for node in nodes:
            for layer in node.layers:
                if choices := layer.choices(node):
                    questions[node.label] = (*questions.get(node.label, ()), *choices)
        names = {node.label for node in nodes} | set(skills)
        declared = InterfaceReader(Findings(), registry)
        parameters = {
            name: declared.port(found, "parameter")
            for name, found in document.main.parameters.items()
        }
        return cls(
            registry=registry,
            skills=skills,
            names=names,
            questions=questions,
            parameters=parameters,
        )


@dataclass(frozen=True, slots=True)
class MocksReader(Reader):
    """A reader that knows the tree; None when there is none, and no name can be judged."""

    tree: Tested | None = None


def tree_of(reader: Reader) -> Tested | None:
    """Return the tree that a scenario's reader knows."""
    return reader.tree if isinstance(reader, MocksReader) else None


class OneOrSeveral(Kind[tuple[T, ...]]):
    """A value, or a list of them."""

    def __init__(self, of: Kind[T]) -> None:
        self.of = of
        self.words = f"{of.words}, or a list of them"

    def read(self, node: YamlNode, reader: Reader) -> tuple[T, ...]:
        items = node.items if isinstance(node, YamlList) else [node]
        return tuple(read_each(self.of, [(item, reader) for item in items]))

    def schema(self, options: bool = False) -> Schema:
        one = self.of.schema()
        return {"anyOf": [one, {"type": "array", "items": one}]}


class AnyValue(Kind[YamlNode]):
    """A value whose type is that of the skill's port."""

    words = "a value"

    def read(self, node: YamlNode, reader: Reader) -> YamlNode:
        return node

    def schema(self, options: bool = False) -> Schema:
        return {}


@dataclass(frozen=True, slots=True, kw_only=True)
class MockSection:
    """How a mock ends."""

    status: str | None = value(
        Text(*STATUSES), None, "how it ends; with a code failure, else success"
    )
    after: float = value(Measure(TIME, "0 s"), "0 s", "how long it takes")
    outputs: Mapping[str, YamlNode] = value(
        MappingOf(AnyValue()), {}, "outputs by port; the others get placeholders"
    )
    code: str | None = value(Text(), None, "the code with which it fails")
    message: str = value(Text(), "", "the sentence with which it fails")
    calls: int = value(Whole(1, 10_000), 1, "number of calls")


_SECTION = Section(MockSection)


class MockedSkills(Kind[Mapping[str, tuple[MockResult, ...]]]):
    """Results by skill, node or path: one for all calls, or a list by call."""

    words = "a mapping from skills to results"

    def read(self, node: YamlNode, reader: Reader) -> Mapping[str, tuple[MockResult, ...]]:
        tree = tree_of(reader)
        written = MappingOf(OneOrSeveral(AnyValue())).read(node, reader)
        found: dict[str, tuple[MockResult, ...]] = {}
        if tree is None or not isinstance(node, YamlMapping):
            return found
        refused = None
        for key, _ in node.entries.values():
            try:
                call = _Call(self.replaced(key, reader, tree))
                results = read_each(
                    call, [(item, reader.inside(key.text)) for item in written[key.text]]
                )
                found[key.text] = tuple(result for several in results for result in several)
            except Refused as error:
                refused = error
        if refused is not None:
            raise refused
        return found

    def replaced(self, key: YamlScalar, reader: Reader, tree: Tested) -> type[Skill]:
        """Return the skill that a mock stands in for. Raises Refused: there is none, with a finding."""
        skill = tree.registry.get(tree.skills.get(key.text, ""))
        if skill is None:
            if report_removed(reader.findings, key, "skill", key.text):
                raise Refused(key.text)
            hint = did_you_mean(key.text, tree.skills) or "name a skill or a node of the tree"
            raise reader.refuse(
                key, f"the tree has no skill or node '{key.text}'", hint, "unknown-node"
            )
        return skill

    def schema(self, options: bool = False) -> Schema:
        word: Schema = {
            "type": "string",
            "description": "success, failure, running, or the code of a failure",
        }
        result: Schema = {"anyOf": [word, _SECTION.schema()]}
        one_or_several: Schema = {"anyOf": [*result["anyOf"], {"type": "array", "items": result}]}
        return {"type": ["object", "null"], "additionalProperties": one_or_several}


class _Call(Kind[tuple[MockResult, ...]]):
    """A word, or a mapping that applies to a number of calls."""

    words = "success, failure, running, a code, or a mapping"

    def __init__(self, skill: type[Skill]) -> None:
        self.skill = skill

    def read(self, node: YamlNode, reader: Reader) -> tuple[MockResult, ...]:
        if isinstance(node, YamlScalar):
            if node.text in STATUSES:
                return (MockResult(node.text, code="MOCKED"),)
            self.known_code(node, reader)
            return (MockResult("failure", code=node.text),)
        if not isinstance(node, YamlMapping):
            raise reader.refuse(
                node, f"{reader.title} must be {self.words}, not {shape_of(node)}", code="shape"
            )
        placed = _SECTION.read_placed(node, reader)
        said = placed.values
        if said.code is not None:
            self.known_code(placed.place("code"), reader)
        outputs = self.outputs(placed, reader)
        status = said.status or ("failure" if said.code is not None else "success")
        return (
            MockResult(status, said.after, outputs, said.code or "MOCKED", said.message),
        ) * said.calls

    def schema(self, options: bool = False) -> Schema:
        return _SECTION.schema()

    def known_code(self, code: YamlNode, reader: Reader) -> None:
        """Refuse a code with which the skill never fails."""
        text = code.text if isinstance(code, YamlScalar) else ""
        if text not in self.skill.failures:
            message = f"{self.skill.__name__} never fails with {text}"
            new = self.skill.renamed_failures.get(text)
            if new is not None:
                renamed = Instead(f"it is called '{new}' now", text, new)
                raise reader.refuse(code, message, renamed, "removed")
            known = self.skill.failures
            hint = did_you_mean(text, (*known, *STATUSES)) or f"codes: {', '.join(known)}"
            raise reader.refuse(code, message, hint, "unknown-code")

    def outputs(self, placed: Placed[MockSection], reader: Reader) -> dict[str, Any]:
        written = placed.node.get("outputs")
        found = dict[str, Any]()
        refused = None
        for key, node in written.entries.values() if isinstance(written, YamlMapping) else ():
            port = self.skill.outputs.get(key.text)
            if port is None:
                known = self.skill.outputs
                hint = did_you_mean(key.text, known) or f"outputs: {', '.join(known) or 'none'}"
                message = f"{self.skill.__name__} has no output '{key.text}'"
                refused = reader.refuse(key, message, hint, "unknown-port")
                continue
            try:
                found[key.text] = stand_in(node, port.type, reader.findings)
            except LiteralError as error:
                refused = reader.refuse(error.where, error.message, error.hint)
        if refused is not None:
            raise refused
        return found


def stand_in(node: YamlNode, value_type: ValueType, findings: Findings) -> Any:
    """Return a literal; a mapping for a class becomes a placeholder with some of the class's fields.

    Raises LiteralError: it is no value of the type.
    """
    if isinstance(node, YamlList) and isinstance(value_type, ListType):
        return tuple(stand_in(item, value_type.element, findings) for item in node.items)
    fields = fields_of(value_type)
    if isinstance(node, YamlMapping) and fields:
        given: dict[str, Any] = {}
        for key, value in node.entries.values():
            if key.text not in fields:
                hint = did_you_mean(key.text, fields) or "fields: " + ", ".join(fields)
                findings.error(
                    key, "unknown-field", f"{describe(value_type)} has no field '{key.text}'", hint
                )
                continue
            given[key.text] = stand_in(value, fields[key.text], findings)
        return Placeholder(describe(value_type).split(" ", 1)[-1], given)
    return literal(node, ANY if value_type is object else value_type)


@dataclass(frozen=True, slots=True, kw_only=True)
class MocksSection:
    """MockedSkills alone, for a dry run."""

    pomona: str = value(Text("1"), "1", "version of the language")
    mocks: Results = value(
        MockedSkills(), {}, "how skills end; a skill that is not named succeeds at once"
    )


@few_hints()
def read_mocks(
    text: str, path: str | Path, document: Document, skills: Registry
) -> tuple[MockPlan, list[Finding]]:
    """Return the `mocks` of a file for a dry run of `document`: a mapping `mocks:`, or a scenario's common ones."""
    findings = Findings()
    root = root_of(text, path, findings, "a file of mocks")
    results: Results = {}
    if root is not None:
        others = (
            tuple(name for name in root.entries if name not in MOCKS_KEYS)
            if "cases" in root.entries
            else ()
        )
        if "mocks" not in root.entries and not others:
            findings.error(
                root, "missing-key", "the file holds no mocks", "write 'mocks: {Skill: result}'"
            )
        try:
            reader = MocksReader(findings, tree=Tested.of(document, skills))
            results = Section(MocksSection, ignore=others).read(root, reader).mocks
        except Refused:
            pass
    return MockPlan(results), findings.sorted()


def root_of(text: str, path: str | Path, findings: Findings, what: str) -> YamlMapping | None:
    """Return the mapping of a text; None, with a finding, when it is none. The last argument names the file's kind."""
    root = read_yaml(Source(str(path), text), findings, what)
    if root is None or isinstance(root, YamlMapping):
        return root
    findings.error(root, "shape", f"{what} is a mapping ('key: value'), this is {shape_of(root)}")
    return None
