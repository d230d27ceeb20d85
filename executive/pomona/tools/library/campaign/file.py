"""Schema of campaign files.

pomona: 1
campaign: paper
tree: pick_apple
cell: sim
seeds: 3                          # a count: each combination has its own seeds, equal for all arms; or a list of seeds
vary:                             # every combination; keys as for --set: parameters of the tree, options of the cell
  fruit: [apple_1, apple_2]
  place: [1, 2, 3]
set: {others: 0}                  # the same for every run
arms:                             # variants to compare
  refined:   {}
  unrefined: {set: {refine: none}, seeds: 1, only: {fruit: [apple_2]}}
  the paper: {tree: pick_apple_paper}
score:                            # in addition to the cell's own score
  success: [lifted]               # ground truth that a success also needs
  figures: [slip_mm]              # of the ground truth, first in the report
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

from pomona.executive.cell.services import Score
from pomona.executive.values.kinds import (
    AsWritten,
    Kind,
    ListOf,
    MappingOf,
    Schema,
    Text,
    Whole,
)
from pomona.executive.values.sections import Section, value
from pomona.executive.values.yaml_nodes import (
    Reader,
    Unfit,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
)

# largest number of seeds of a combination, and distance of two combinations' first seeds
MAX_SEEDS = 1000

T = TypeVar("T")
Values = Mapping[str, YamlScalar]
Variations = Mapping[str, tuple[YamlScalar, ...]]


class OneOrMore(ListOf[T]):
    """A list of single values, each once, at least one."""

    def __init__(self, of: Kind[T]) -> None:
        super().__init__(of)
        self.words = "a list of values"

    def read(self, node: YamlNode, reader: Reader) -> tuple[T, ...]:
        values = super().read(node, reader)
        if not values:
            raise reader.refuse(node, f"{reader.title} is an empty list", "write [a, b]", "empty")
        seen = set[str]()
        for item in node.items if isinstance(node, YamlList) else ():
            text = item.text if isinstance(item, YamlScalar) else ""
            if text in seen:
                raise reader.refuse(item, f"'{text}' is given twice", code="duplicate")
            seen.add(text)
        return values

    def schema(self, options: bool = False) -> Schema:
        return {**super().schema(options), "minItems": 1, "uniqueItems": True}


class Seeds(Kind[int | tuple[int, ...]]):
    """A count of seeds, or a list of them."""

    words = f"a count from 1 to {MAX_SEEDS}, or a list of seeds"
    count = Whole(1, MAX_SEEDS)
    listed = OneOrMore(Whole(0, 999_999_999))

    def read(self, node: YamlNode, reader: Reader) -> int | tuple[int, ...]:
        if isinstance(node, YamlList):
            return self.listed.read(node, reader)
        try:
            return self.count.parse(node.text if isinstance(node, YamlScalar) else "")
        except Unfit:
            hint = "write 'seeds: 3' or 'seeds: [3, 7, 11]'"
            raise reader.refuse(node, f"'{reader.title}' is {self.words}", hint) from None

    def schema(self, options: bool = False) -> Schema:
        return {"anyOf": [self.count.schema(), self.listed.schema()]}


class OrNothing(Section["ArmSection"]):
    """An arm may be left empty."""

    def read(self, node: YamlNode, reader: Reader) -> ArmSection:
        if isinstance(node, YamlScalar) and node.is_null:
            return ArmSection()
        return super().read(node, reader)

    def schema(self, options: bool = False) -> Schema:
        return {**super().schema(options), "type": ["object", "null"]}


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmSection:
    """Settings of one arm."""

    tree: YamlScalar | None = value(
        AsWritten(), None, "a tree: a file, or the name of an installed one"
    )
    cell: YamlScalar | None = value(
        AsWritten(), None, "a cell: a file, or the name of an installed one"
    )
    set: Values = value(MappingOf(AsWritten()), {}, "settings of this arm's runs")
    seeds: int | tuple[int, ...] | None = value(Seeds(), None, "how many seeds, or which")
    only: Variations = value(
        MappingOf(OneOrMore(AsWritten())), {}, "values of the variables for this arm"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignSection:
    """A campaign: values to vary, arms to compare, the score."""

    pomona: str = value(Text("1"), "1", "version of the language")
    campaign: str = value(Text(), help="the campaign's name")
    description: str = value(Text(), "", "for the report")
    tree: YamlScalar = value(AsWritten(), help="a tree: a file, or the name of an installed one")
    cell: YamlScalar | None = value(
        AsWritten(), None, "a cell: a file or an installed one's name; sim without it"
    )
    seeds: int | tuple[int, ...] = value(
        Seeds(), 1, "how many seeds of every combination, or which"
    )
    vary: Variations = value(
        MappingOf(OneOrMore(AsWritten())),
        {},
        "parameters of the tree and options of the cell, with values",
    )
    set: Values = value(MappingOf(AsWritten()), {}, "settings of every run")
    arms: Mapping[str, ArmSection] = value(
        MappingOf(OrNothing(ArmSection)), {}, "alternatives to compare"
    )
    score: Score = value(Section(Score), Score(), "additional scores beside the cell's")


CAMPAIGN = Section(CampaignSection)


def keys_of(section: YamlMapping, name: str) -> Mapping[str, YamlScalar]:
    """Return the keys of a mapping in a section, with their places."""
    node = section.get(name)
    return {k: key for k, (key, _) in node.entries.items()} if isinstance(node, YamlMapping) else {}
