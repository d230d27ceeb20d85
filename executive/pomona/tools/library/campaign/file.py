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

from pomona.executive.cell.services import Score
from pomona.executive.values.kinds import (
    AsWritten,
    Kind,
    ListOf,
    MappingOf,
    Schema,
    Text,
    read_each,
)
from pomona.executive.values.sections import Section, value
from pomona.executive.values.yaml_nodes import (
    Reader,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    shape_of,
)

# largest number of seeds of a combination, and distance of two combinations' first seeds
MAX_SEEDS = 1000

Values = Mapping[str, YamlScalar]
Variations = Mapping[str, tuple[YamlScalar, ...]]


class Seeds(Kind[int | tuple[int, ...]]):
    """A count of seeds, or a list of them."""

    words = f"a count from 1 to {MAX_SEEDS}, or a list of seeds"

    def read(self, node: YamlNode, reader: Reader) -> int | tuple[int, ...]:
        if isinstance(node, YamlList) and node.items:
            seeds = tuple(read_each(_Seed(), [(item, reader) for item in node.items]))
            return _each_once(seeds, node, reader)
        text = node.text if isinstance(node, YamlScalar) else ""
        if text.isascii() and text.isdigit() and 1 <= int(text[:9]) <= MAX_SEEDS and len(text) < 9:
            return int(text)
        raise reader.refuse(
            node, f"'{reader.title}' is {self.words}", "write 'seeds: 3' or 'seeds: [3, 7, 11]'"
        )

    def schema(self, options: bool = False) -> Schema:
        count = {"type": "integer", "minimum": 1, "maximum": MAX_SEEDS}
        return {
            "anyOf": [
                count,
                {"type": "array", "items": _Seed().schema(), "minItems": 1, "uniqueItems": True},
            ]
        }


class _Seed(Kind[int]):
    words = "a whole number of at least 0"

    def read(self, node: YamlNode, reader: Reader) -> int:
        text = node.text if isinstance(node, YamlScalar) else shape_of(node)
        if not (text.isascii() and text.isdigit() and len(text) < 10):
            raise reader.refuse(node, f"a seed is {self.words}, not '{text}'")
        return int(text)

    def schema(self, options: bool = False) -> Schema:
        return {"type": "integer", "minimum": 0}


class OneOrMore(ListOf[YamlScalar]):
    """A list of single values, each once, at least one."""

    def __init__(self) -> None:
        super().__init__(AsWritten())
        self.words = "a list of values"

    def read(self, node: YamlNode, reader: Reader) -> tuple[YamlScalar, ...]:
        values = super().read(node, reader)
        if not values:
            raise reader.refuse(node, f"{reader.title} is an empty list", "write [a, b]", "empty")
        seen = set[str]()
        for found in values:
            if found.text in seen:
                raise reader.refuse(found, f"'{found.text}' is given twice", code="duplicate")
            seen.add(found.text)
        return values

    def schema(self, options: bool = False) -> Schema:
        return {**super().schema(options), "minItems": 1, "uniqueItems": True}


def _each_once(seeds: tuple[int, ...], node: YamlList, reader: Reader) -> tuple[int, ...]:
    before = set[int]()
    for item, seed in zip(node.items, seeds, strict=True):
        if seed in before:
            raise reader.refuse(item, f"'{seed}' is given twice", code="duplicate")
        before.add(seed)
    return seeds


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
    only: Variations = value(MappingOf(OneOrMore()), {}, "values of the variables for this arm")


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
        MappingOf(OneOrMore()), {}, "parameters of the tree and options of the cell, with values"
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
