"""Plain values → YAML text in the style of tree files: nodes in blocks, ports in one line."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

_PLAIN = re.compile(r"[A-Za-z0-9_.°%+/²·^-]+( [A-Za-z0-9_.°%+/²·^-]+)*")
_WIDTH = 110


class YamlText(str):
    """Text that is YAML already."""

    __slots__ = ()


def scalar(value: object) -> str:
    """One scalar, quoted if it must be."""
    if isinstance(value, YamlText):
        return str(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    text = str(value)
    if (
        _PLAIN.fullmatch(text)
        and text not in ("", "null", "none", "~", "-")
        and not text.startswith(("- ", "%"))
    ):
        return text
    return json.dumps(text, ensure_ascii=not text.isprintable())


def flow(value: object) -> str:
    """Return a value on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{scalar(k)}: {flow(v)}" for k, v in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(flow(v) for v in value) + "]"
    return "null" if value is None else scalar(value)


def block(value: Mapping[str, Any], indent: int = 0) -> Iterator[str]:
    """Yield lines of a mapping; short mappings and all that holds no list of mappings stay on one line."""
    pad = " " * indent
    for key, inner in value.items():
        if (
            isinstance(inner, Mapping)
            and (_holds_nodes(inner) or len(flow(inner)) + indent > _WIDTH)
            and inner
        ):
            yield f"{pad}{scalar(key)}:"
            yield from block(inner, indent + 2)
        elif isinstance(inner, list) and inner and all(isinstance(item, Mapping) for item in inner):
            yield f"{pad}{scalar(key)}:"
            for item in inner:
                lines = list(block(item, indent + 4))
                yield f"{pad}  - {lines[0].lstrip()}" if lines else f"{pad}  - {{}}"
                yield from lines[1:]
        else:
            yield f"{pad}{scalar(key)}: {flow(inner)}"


def _holds_nodes(value: object) -> bool:
    if isinstance(value, Mapping):
        return any(_holds_nodes(inner) or isinstance(inner, Mapping) for inner in value.values())
    return isinstance(value, list) and any(isinstance(item, Mapping) for item in value)
