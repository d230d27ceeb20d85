"""Plain values → YAML text in the style of tree files: nodes in blocks, ports in one line."""

from __future__ import annotations

import re
from typing import Any

import yaml

_PLAIN = re.compile(r"-?\d+(\.\d+)?([eE][-+]?\d+)?|true|false")
_TEXT = "tag:yaml.org,2002:str"


class Written(str):
    """A text as a tree file has it: its type is the one that its letters show, as for `3` or `{width} > 1`."""

    __slots__ = ()


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]
    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _written(dumper: yaml.SafeDumper, text: Written) -> yaml.Node:
    tag = dumper.resolve(yaml.ScalarNode, text, (True, False)) if _PLAIN.fullmatch(text) else _TEXT
    return dumper.represent_scalar(tag, text)


_Dumper.add_representer(Written, _written)


def to_yaml(value: object, flow: bool | None = None) -> str:
    """Return YAML text; with `flow` on one line."""
    width = 1 << 30 if flow else 110
    text: str = yaml.dump(
        value,
        Dumper=_Dumper,
        sort_keys=False,
        default_flow_style=flow,
        width=width,
        allow_unicode=True,
    )
    return text
