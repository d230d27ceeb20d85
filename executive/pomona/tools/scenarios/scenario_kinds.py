"""Kinds of values in scenario files: names of nodes, answers, ends; each is judged by the tree under test."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pomona.executive.language.interface import read_override
from pomona.executive.language.mocks import ENDS, OneOrSeveral, T, tree_of
from pomona.executive.values.findings import Findings, did_you_mean
from pomona.executive.values.kinds import AsWritten, Kind, MappingOf, Schema, Text
from pomona.executive.values.sections import Section, value
from pomona.executive.values.yaml_nodes import Reader, Refused, YamlMapping, YamlNode, YamlScalar


class NodeName(Kind[str]):
    """A node of the tree: its name, its type, its path or the end of that."""

    words = "the name or the path of a node"

    def read(self, node: YamlNode, reader: Reader) -> str:
        name = AsWritten().read(node, reader)
        tree = tree_of(reader)
        if (
            tree is not None
            and name.text not in tree.names
            and last_name(name.text) not in tree.names
        ):
            hint = did_you_mean(name.text, tree.names)
            raise reader.refuse(name, f"the tree has no node '{name.text}'", hint, "unknown-node")
        return name.text

    def schema(self, options: bool = False) -> Schema:
        return {"type": "string"}


def last_name(path: str) -> str:
    """Return the name in the end of a path, without its number and without a modifier."""
    return path.rsplit("/", 1)[-1].partition("#")[0].partition(":")[0]


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
        found = super().read(node, reader)
        tree = tree_of(reader)
        refused = None
        if tree is not None and isinstance(node, YamlMapping):
            for key, _ in node.entries.values():
                port = tree.parameters.get(key.text)
                if key.text not in tree.parameters:
                    hint = (
                        did_you_mean(key.text, tree.parameters)
                        or f"known: {', '.join(tree.parameters) or 'none'}"
                    )
                    refused = reader.refuse(
                        key, f"the tree has no parameter '{key.text}'", hint, "unknown-setting"
                    )
                elif port is not None and key.text in found:
                    wrong = Findings()
                    read_override(key.text, found[key.text].text, port, wrong)
                    for problem in wrong.sorted():
                        refused = reader.refuse(
                            found[key.text], problem.message, problem.hint, "value"
                        )
        if refused is not None:
            raise refused
        return found


class Answers(Kind[Mapping[str, tuple[str, ...]]]):
    """Answers by question: one word, or one for each time that it is asked; the last one stays."""

    words = "a mapping from questions to answers"

    def read(self, node: YamlNode, reader: Reader) -> Mapping[str, tuple[str, ...]]:
        found = MappingOf(OneOrSeveral(AsWritten())).read(node, reader)
        tree = tree_of(reader)
        refused = None
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
            hint = (
                did_you_mean(key.text, questions)
                or f"nodes that ask: {', '.join(questions) or 'none'}"
            )
            raise reader.refuse(key, f"no node '{key.text}' asks anything", hint, "unknown-node")
        if not answers:
            raise reader.refuse(
                written, f"'{key.text}' has no answer", "leave it out for no answer", "empty"
            )
        for answer in answers:
            if answer.text not in choices:
                hint = did_you_mean(answer.text, choices) or f"answers: {', '.join(choices)}"
                raise reader.refuse(answer, f"'{answer.text}' is no answer to '{key.text}'", hint)

    def schema(self, options: bool = False) -> Schema:
        return MappingOf(OneOrSeveral(AsWritten())).schema()


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
