"""How a file's values are read: every mistake becomes a finding at its place, and reading goes on to the next."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from pomona.executive.values.findings import Findings, Located, did_you_mean
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar

_REFERENCE = re.compile(r"\{([^{}]*)\}")


class Refused(Exception):
    """A value that cannot be read; its finding has been made."""


class Unfit(ValueError):
    """A text that is no value of its kind, with the problem and the correction."""

    def __init__(self, message: str, hint: str = "", code: str = "value") -> None:
        self.message, self.hint, self.code = message, hint, code
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Reader:
    """Context that a kind needs to read a node."""

    findings: Findings  # receives every error and warning
    title: str = ""  # of the value, for messages: `devices.arm.lead`
    options: Mapping[str, YamlScalar] | None = None  # values of `{name}`, or None in files without options

    def inside(self, key: str) -> Reader:
        """Return the reader of a value in this one."""
        return replace(self, title=f"{self.title}.{key}" if self.title else key)

    def refuse(self, where: Located, message: str, hint: str = "", code: str = "value") -> Refused:
        """Report the finding; the caller raises the returned error."""
        self.findings.error(where, code, message, hint)
        return Refused(message)

    def filled(self, node: YamlNode) -> YamlNode:
        """Return the node with options filled in. A text that is only one option gets the place of the option's value.

        Raises Refused: it names an option that does not exist.
        """
        options = self.options
        if options is None or not isinstance(node, YamlScalar) or "{" not in node.text:
            return node
        for name in _REFERENCE.findall(node.text):
            if name not in options:
                hint = did_you_mean(name, options) or f"options: {', '.join(options) or 'none'}"
                raise self.refuse(node, f"there is no option '{name}'", hint, "unknown-option")
        whole = _REFERENCE.fullmatch(node.text.strip())
        if whole is not None:
            return options[whole[1]]
        return replace(node, text=_REFERENCE.sub(lambda match: options[match[1]].text, node.text))
