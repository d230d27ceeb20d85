"""Kinds of values in scenario files: mocks of skills, names of nodes, answers; each is judged by the tree under test.

mocks:
  Plan: [NO_PATH, success]                      # by call; the last one stays
  Look again: {status: failure, code: NO_FRUIT, after: 2 s, calls: 3}
  Refine: {outputs: {measured: {inlier_ratio: 0.7}}}
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from pomona.executive.language.interface import InterfaceReader
from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.mocks import MockResult, Placeholder
from pomona.executive.language.model import Document
from pomona.executive.language.names_of_nodes import skills_by_node
from pomona.executive.language.overrides import read_override
from pomona.executive.language.value_types import ANY, ListType, ValueType, describe, fields_of
from pomona.executive.ports import TIME, Port
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values.findings import Findings, did_you_mean
from pomona.executive.values.kinds import AsWritten, Kind, MappingOf, Measure, Schema, Text, Whole, read_each
from pomona.executive.values.reading import Reader, Refused
from pomona.executive.values.sections import Placed, Section, value
from pomona.executive.values.shape import shape_of
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar

T = TypeVar("T")
ENDS = ("success", "failure")
STATUSES = (*ENDS, "running")


@dataclass(frozen=True, slots=True, kw_only=True)
class Tested:
    """Names of the tested tree that a scenario may use."""

    registry: Registry
    skills: Mapping[str, str]  # the skill that a mock of a node replaces, by every name of the node
    names: Collection[str]  # of all nodes
    questions: Mapping[str, tuple[str, ...]]  # by the name of a node that asks, the answers that it takes
    parameters: Mapping[str, Port | None]  # of the tree; None for one of unknown type

    @classmethod
    def of(cls, document: Document, registry: Registry) -> Tested:
        """Return all that is in a document."""
        skills = skills_by_node(document)
        nodes = [node for definition in document.definitions() if definition.root for node in definition.root.walk()]
        questions: dict[str, tuple[str, ...]] = {}
        for node in nodes:
            for layer in node.layers:
                if choices := layer.choices(node):
                    questions[node.label] = (*questions.get(node.label, ()), *choices)
        names = {node.label for node in nodes} | set(skills)
        declared = InterfaceReader(Findings(), registry)
        parameters = {name: declared.port(found, "parameter") for name, found in document.main.parameters.items()}
        return cls(registry=registry, skills=skills, names=names, questions=questions, parameters=parameters)


@dataclass(frozen=True, slots=True)
class ScenarioReader(Reader):
    """A reader that knows the tree; None when there is none, and no name can be judged."""

    tree: Tested | None = None


def tree_of(reader: Reader) -> Tested | None:
    """Return the tree that a scenario's reader knows."""
    return reader.tree if isinstance(reader, ScenarioReader) else None


class NodeName(Kind[str]):
    """A node of the tree: its name, its type, its path or the end of that."""

    words = "the name or the path of a node"

    def read(self, node: YamlNode, reader: Reader) -> str:
        name = AsWritten().read(node, reader)
        tree = tree_of(reader)
        if tree is not None and name.text not in tree.names and last_name(name.text) not in tree.names:
            hint = did_you_mean(name.text, tree.names)
            raise reader.refuse(name, f"the tree has no node '{name.text}'", hint, "unknown-node")
        return name.text

    def schema(self, options: bool = False) -> Schema:
        return {"type": "string"}


def last_name(path: str) -> str:
    """Return the name in the end of a path, without its number and without a modifier."""
    return path.rsplit("/", 1)[-1].partition("#")[0].partition(":")[0]


class OneOrSeveral(Kind[tuple[T, ...]]):
    """A value, or a list of them."""

    def __init__(self, of: Kind[T]) -> None:
        self.of, self.words = of, f"{of.words}, or a list of them"

    def read(self, node: YamlNode, reader: Reader) -> tuple[T, ...]:
        items = node.items if isinstance(node, YamlList) else [node]
        return tuple(read_each(self.of, [(item, reader) for item in items]))

    def schema(self, options: bool = False) -> Schema:
        one = self.of.schema()
        return {"anyOf": [one, {"type": "array", "items": one}]}


class ByNode(MappingOf[T]):
    """A mapping whose keys are nodes of the tree."""

    def read(self, node: YamlNode, reader: Reader) -> Mapping[str, T]:
        refused = None
        for key, _ in node.entries.values() if isinstance(node, YamlMapping) else ():
            try:
                NodeName().read(key, reader)
            except Refused as error:
                refused = error
        found = super().read(node, reader)
        if refused is not None:
            raise refused
        return found


class ParameterValues(MappingOf[YamlScalar]):
    """Values of the tree's parameters."""

    def __init__(self) -> None:
        super().__init__(AsWritten())

    def read(self, node: YamlNode, reader: Reader) -> Mapping[str, YamlScalar]:
        found, tree, refused = super().read(node, reader), tree_of(reader), None
        if tree is not None and isinstance(node, YamlMapping):
            for key, _ in node.entries.values():
                port = tree.parameters.get(key.text)
                if key.text not in tree.parameters:
                    hint = did_you_mean(key.text, tree.parameters) or f"known: {', '.join(tree.parameters) or 'none'}"
                    refused = reader.refuse(key, f"the tree has no parameter '{key.text}'", hint, "unknown-setting")
                elif port is not None and key.text in found:
                    wrong = Findings()
                    read_override(key.text, found[key.text].text, port, wrong)
                    for problem in wrong.sorted():
                        refused = reader.refuse(found[key.text], problem.message, problem.hint, "value")
        if refused is not None:
            raise refused
        return found


class Answers(Kind[Mapping[str, tuple[str, ...]]]):
    """Answers by question: one word, or one for each time that it is asked; the last one stays."""

    words = "a mapping from questions to answers"

    def read(self, node: YamlNode, reader: Reader) -> Mapping[str, tuple[str, ...]]:
        found = MappingOf(OneOrSeveral(AsWritten())).read(node, reader)
        tree, refused = tree_of(reader), None
        if tree is not None and isinstance(node, YamlMapping):
            for key, written in node.entries.values():
                try:
                    self.judge(key, written, found[key.text], reader, tree.questions)
                except Refused as error:
                    refused = error
        if refused is not None:
            raise refused
        return {name: tuple(answer.text for answer in answers) for name, answers in found.items()}

    def judge(
        self,
        key: YamlScalar,
        written: YamlNode,
        answers: tuple[YamlScalar, ...],
        reader: Reader,
        questions: Mapping[str, tuple[str, ...]],
    ) -> None:
        """Refuse a key that is no question of the tree, and a value that is no answer to it."""
        choices = questions.get(key.text) or questions.get(last_name(key.text))
        if not choices:
            hint = did_you_mean(key.text, questions) or f"nodes that ask: {', '.join(questions) or 'none'}"
            raise reader.refuse(key, f"no node '{key.text}' asks anything", hint, "unknown-node")
        if not answers:
            raise reader.refuse(written, f"'{key.text}' has no answer", "leave it out for no answer", "empty")
        for answer in answers:
            if answer.text not in choices:
                hint = did_you_mean(answer.text, choices) or f"answers: {', '.join(choices)}"
                raise reader.refuse(answer, f"'{answer.text}' is no answer to '{key.text}'", hint)

    def schema(self, options: bool = False) -> Schema:
        return MappingOf(OneOrSeveral(AsWritten())).schema()


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

    status: str | None = value(Text(*STATUSES), None, "how it ends; with a code failure, else success")
    after: float = value(Measure(TIME, "0 s"), "0 s", "how long it takes")
    outputs: Mapping[str, YamlNode] = value(MappingOf(AnyValue()), {}, "outputs by port; the others get placeholders")
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
                results = read_each(call, [(item, reader.inside(key.text)) for item in written[key.text]])
                found[key.text] = tuple(result for several in results for result in several)
            except Refused as error:
                refused = error
        if refused is not None:
            raise refused
        return found

    def replaced(self, key: YamlScalar, reader: Reader, tree: Tested) -> type[Skill]:
        """Return the skill that a mock stands in for."""
        skill = tree.registry.get(tree.skills.get(key.text, ""))
        if skill is None:
            hint = did_you_mean(key.text, tree.skills) or "name a skill or a node of the tree"
            raise reader.refuse(key, f"the tree has no skill or node '{key.text}'", hint, "unknown-node")
        return skill

    def schema(self, options: bool = False) -> Schema:
        word: Schema = {"type": "string", "description": "success, failure, running, or the code of a failure"}
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
            raise reader.refuse(node, f"{reader.title} must be {self.words}, not {shape_of(node)}", code="shape")
        placed = _SECTION.read_placed(node, reader)
        said = placed.values
        if said.code is not None:
            self.known_code(placed.place("code"), reader)
        outputs = self.outputs(placed, reader)
        status = said.status or ("failure" if said.code is not None else "success")
        return (MockResult(status, said.after, outputs, said.code or "MOCKED", said.message),) * said.calls

    def schema(self, options: bool = False) -> Schema:
        return _SECTION.schema()

    def known_code(self, code: YamlNode, reader: Reader) -> None:
        """Refuse a code with which the skill never fails."""
        text = code.text if isinstance(code, YamlScalar) else ""
        if text not in self.skill.failures:
            new, known = self.skill.renamed_failures.get(text), self.skill.failures
            renamed = f"it is called '{new}' now" if new else ""
            hint = renamed or did_you_mean(text, (*known, *STATUSES)) or f"codes: {', '.join(known)}"
            raise reader.refuse(code, f"{self.skill.__name__} never fails with {text}", hint, "unknown-code")

    def outputs(self, placed: Placed[MockSection], reader: Reader) -> dict[str, Any]:
        written, found = placed.node.get("outputs"), dict[str, Any]()
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
                findings.error(key, "unknown-field", f"{describe(value_type)} has no field '{key.text}'", hint)
                continue
            given[key.text] = stand_in(value, fields[key.text], findings)
        return Placeholder(describe(value_type).split(" ", 1)[-1], given)
    return literal(node, ANY if value_type is object else value_type)


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """How a run ends."""

    status: str | None = value(Text(*ENDS), None, "how the tree ends; failure if omitted")
    code: str = value(Text(), "", "a code of the failure, or of one of its causes")
    node: str = value(NodeName(), "", "the node that failed")


class End(Section[Expected]):
    """A word, or a mapping with more details of a failure."""

    def __init__(self) -> None:
        super().__init__(Expected)

    def read(self, node: YamlNode, reader: Reader) -> Expected:
        if isinstance(node, YamlScalar):
            return Expected(status=Text(*ENDS).read(node, reader))
        return super().read(node, reader)

    def schema(self, options: bool = False) -> Schema:
        return {"anyOf": [Text(*ENDS).schema(), super().schema()]}
