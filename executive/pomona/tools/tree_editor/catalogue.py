"""Everything that a node can be, and everything that may stand beside it, with help: for the palette and the fields."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from pomona.executive.cell.cell_file import CellFile
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.leaves import SUBTREE
from pomona.executive.nodes.node_type import Field
from pomona.executive.nodes.takes import Value
from pomona.executive.ports import Port, Ports
from pomona.executive.reasons import failure_codes
from pomona.executive.registry import Registry, port_facts
from pomona.executive.skill import Skill
from pomona.tools.editor.service import first_line, words_of

Facts = dict[str, Any]


def catalogue(skills: Registry, types: NodeTypes, cell: CellFile | None) -> Facts:
    """Return plain values: `skills` and `words` by name, and the codes that the language itself gives."""
    return {
        "skills": {name: _skill(name, skill, cell) for name, skill in sorted(skills.items())},
        "words": {word: _word(word, types) for word in types if not types[word].calls},
        "subtree": {"symbol": SUBTREE.symbol, "colour": SUBTREE.colour},
        "types": sorted(skills.types),
    }


def _skill(name: str, skill: type[Skill], cell: CellFile | None) -> Facts:
    return {
        "name": name,
        "role": "skill",
        "summary": first_line(skill),
        "symbol": "●",
        "colour": "#0b6e4f",
        "inputs": [
            port_of(port, it, skill.offers(port, cell)) for port, it in skill.inputs.items()
        ],
        "outputs": [port_of(port, it) for port, it in skill.outputs.items()],
        "failures": [_code(code) for code in skill.failures],
        "devices": [interface.__name__ for interface in skill.devices],
    }


def _word(word: str, types: NodeTypes) -> Facts:
    found = types[word]
    return {
        "name": word,
        "role": found.role,
        "summary": _plain(found.summary),
        "symbol": found.symbol,
        "colour": found.colour,
        "value": _field(word, found.value),
        "fields": [_field(slot, taken) for slot, taken in found.fields.items()],
    }


def _field(name: str, taken: Field) -> Facts:
    port = taken.port if isinstance(taken, Value) else None
    facts: Facts = (
        {"name": name, "type": _KINDS.get(type(taken).__name__, "text")} if port is None else {}
    )
    if port is not None:
        facts = port_of(name, port, taken.words if isinstance(taken, Value) else ())
    facts |= {
        "help": _plain(taken.help or facts.get("help", "")),
        "required": taken.required,
        "nodes": taken.nodes,
    }
    if isinstance(inputs := getattr(taken, "inputs", None), Mapping):
        facts["inputs"] = [port_of(port_name, it) for port_name, it in Ports(**inputs).items()]
    return facts


_KINDS: Mapping[str, str] = {
    "Condition": "condition", "ChildOrCondition": "condition", "Elements": "list", "Words": "list of texts",
    "NewName": "name", "Target": "name", "Assignments": "assignments", "Nothing": "nothing", "Children": "nodes",
    "Part": "node", "Child": "node", "Cases": "nodes by word", "Wires": "ports",
}  # fmt: skip
"""What the value of each kind of field is, for readers."""


def port_of(name: str, port: Port, offered: Iterable[str] = ()) -> Facts:
    """Return a port as plain values; `choices` also holds members of an enum, truth values and offered words."""
    facts = dict(port_facts(name, port))
    words = words_of(port)
    words += [word for word in offered if word not in words]
    for limit in ("min", "max", "default"):
        if limit in facts:
            facts[limit] = (
                str(facts[limit]).lower() if isinstance(facts[limit], bool) else str(facts[limit])
            )
    return {**facts, "choices": words} if words else facts


def _code(code: str) -> Facts:
    about = failure_codes().get(code)
    return {
        "code": code,
        "meaning": about.meaning if about else "",
        "remedy": about.remedy if about else "",
    }


def _plain(words: str) -> str:
    """Return words without the marks of the documentation."""
    return words.replace("**", "").replace("`", "")
