"""A JSON Schema of tree files, made from the installed skills, so that an editor completes and checks them."""

from __future__ import annotations

from enum import Enum
from typing import Any

from pomona.executive.account import SUCCESSES
from pomona.executive.language.value_types import fields_of, is_array
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.ports import Port, Quantity, type_name
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values.kinds import bounds_schema, quantity_schema

_NAME = "^[a-z][a-z0-9_]*$"
WIRE = r"\{"  # any text with a brace is an expression; the check reads it

Schema = dict[str, Any]


def schema(skills: Registry, types: NodeTypes | None = None) -> Schema:
    """Return the schema (draft 2020-12)."""
    definitions: Schema = {
        "node": _node(skills, types or NodeTypes.installed()),
        "nodes": {"type": "array", "minItems": 1, "items": {"$ref": "#/$defs/node"}},
        "condition": {
            "type": ["string", "boolean"],
            "description": 'an expression such as "{measured.mu} > 0.6"',
        },
        "wires": {"type": ["object", "null"], "description": "ports of a subtree"},
        "port": _declared(skills),
        "subtree": _subtree(),
        **{f"skill.{name}": _skill(name, skill) for name, skill in sorted(skills.items())},
    }
    ports = _by_name("port")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Pomona tree file",
        "type": "object",
        "required": ["pomona", "tree", "root"],
        "additionalProperties": False,
        "properties": {
            "pomona": {"const": 1, "description": "version of the language"},
            "tree": {"type": "string", "pattern": _NAME, "description": "the tree's name"},
            "description": {"type": "string"},
            "cell": {
                "type": "string",
                "description": "the cell that it is for, where none is given",
            },
            "success": {"enum": [*SUCCESSES], "description": "what the robot must have measured"},
            "parameters": {**ports, "description": "values that --set changes"},
            "skills": {"type": ["object", "null"], "additionalProperties": {"type": "string"}},
            "constants": {"type": ["object", "null"], "propertyNames": {"pattern": _NAME}},
            "in": {**ports, "description": "inputs, for a tree that other trees call"},
            "out": {**ports, "description": "outputs, for a tree that other trees call"},
            "root": _ref("node"),
            "subtrees": _by_name("subtree"),
        },
        "$defs": definitions,
    }


def _by_name(kind: str) -> Schema:
    """Return a mapping whose keys are names in small letters."""
    return {
        "type": ["object", "null"],
        "propertyNames": {"pattern": _NAME},
        "additionalProperties": _ref(kind),
    }


def _ref(name: str) -> Schema:
    return {"$ref": f"#/$defs/{name}"}


def _or_wire(*kinds: Schema) -> Schema:
    return {"anyOf": [*kinds, {"type": "string", "pattern": WIRE}]}


def _node(skills: Registry, types: NodeTypes) -> Schema:
    own = {word: found for word, found in types.items() if found.role != "modifier"}
    words: Schema = {word: {**_described(found, word)} for word, found in own.items()}
    called: Schema = {name: _ref(f"skill.{name}") for name in sorted(skills)}
    beside: Schema = {
        "name": {"type": "string", "maxLength": 80},
        "description": {"type": "string"},
    }
    beside.update(
        {modifier.key: _described(modifier, modifier.key) for modifier in types.modifiers}
    )
    beside.update({word: _described(types.owners(word)[0], word) for word in types.fields})
    kinds = [{"required": [name]} for name in (*words, *called)]
    subtree = {"not": {"anyOf": [*kinds, {"propertyNames": {"enum": list(beside)}}]}}
    single = {
        word: types.owners(word)[0].key for word in types.fields if len(types.owners(word)) == 1
    }
    needed = [
        {"if": {"required": [word]}, "then": {"required": required}}
        for word, found in types.items()
        if (required := [slot for slot, taken in found.fields.items() if taken.required])
    ]
    return {
        "type": "object",
        "properties": {**words, **called, **beside},
        "patternProperties": {_subtree_names([*words, *beside]): _ref("wires")},
        "additionalProperties": False,
        "oneOf": [*kinds, subtree],
        "dependentRequired": {word: [key] for word, key in single.items()},
        "allOf": needed,
    }


def _described(found: NodeType, word: str) -> Schema:
    return {"description": found.summary, **found.slots[word].described(_port_value)}


def _port_value(port: Port) -> Schema:
    return _or_wire(_literal(port)) if _literal(port) else {}


def _subtree_names(words: list[str]) -> str:
    """Small words that are no word of the language call a subtree."""
    return f"^(?!(?:{'|'.join(words)})$)[a-z][a-z0-9_]*$"


def _skill(name: str, skill: type[Skill]) -> Schema:
    inputs = {port_name: _port(port) for port_name, port in skill.inputs.items()}
    outputs: Schema = {
        port_name: {
            "type": "string",
            "pattern": r"^\s*\{\s*[A-Za-z_][A-Za-z0-9_]*\s*\}\s*$",
            "description": f"output, {type_name(port.type)}"
            + (f": {port.help}" if port.help else ""),
        }
        for port_name, port in skill.outputs.items()
    }
    required = [port_name for port_name, port in skill.inputs.items() if port.required]
    failures = f" Fails with {', '.join(skill.failures)}." if skill.failures else " Cannot fail."
    found: Schema = {
        "description": (skill.__doc__ or name).strip().split("\n")[0] + failures,
        "type": "object" if required else ["object", "null"],
        "properties": {**inputs, **outputs},
        "additionalProperties": False,
    }
    return {**found, "required": required} if required else found


def _port(port: Port) -> Schema:
    kind = _literal(port)
    found = _or_wire(kind, *([] if port.required else [{"type": "null"}])) if kind else {}
    words = type_name(port.type) + (f": {port.help}" if port.help else "")
    found["description"] = words
    if not port.required and isinstance(port.default, (bool, int, float, str)):
        found["default"] = port.default
    return found


def _literal(port: Port) -> Schema:
    port_type = port.type
    if isinstance(port_type, Quantity):
        return quantity_schema(port_type)
    if port_type is bool:
        return {"type": "boolean"}
    if port_type in (int, float):
        return {"type": "integer" if port_type is int else "number", **bounds_schema(*port.bounds)}
    if port_type is str:
        return (
            {"enum": list(port.choices)}
            if port.choices
            else {"type": ["string", "number", "boolean"]}
        )
    if issubclass(port_type, Enum):
        return {"enum": sorted({word for m in port_type for word in (m.name, str(m.value))})}
    if port_type is object:
        return {}
    if fields_of(port_type) and not is_array(port_type):
        return {"type": "object"}
    return {"type": ["array", "object"]}


def _declared(skills: Registry) -> Schema:
    known: Schema = {"enum": sorted(skills.types)}
    return {
        "anyOf": [
            known,
            {
                "type": "object",
                "required": ["type"],
                "additionalProperties": False,
                "properties": {
                    "type": known,
                    "default": {},
                    "min": {},
                    "max": {},
                    "choices": {
                        "type": "array",
                        "items": {"type": ["string", "number", "boolean"]},
                    },
                    "help": {"type": "string"},
                },
            },
        ]
    }


def _subtree() -> Schema:
    ports = _by_name("port")
    return {
        "oneOf": [
            {
                "type": "object",
                "required": ["file"],
                "additionalProperties": False,
                "properties": {
                    "file": {"type": "string", "description": "another tree file, beside this one"}
                },
            },
            {
                "type": "object",
                "required": ["root"],
                "additionalProperties": False,
                "properties": {
                    "description": {"type": "string"},
                    "in": ports,
                    "out": ports,
                    "root": _ref("node"),
                },
            },
        ]
    }
