"""Declarations of foreign nodes in a tree file, so that it can be checked, drawn, run dry and exported."""

from __future__ import annotations

import re
from collections.abc import Mapping

from pomona.executive.language.read import read
from pomona.executive.nodes.leaves import SKILL, SetType
from pomona.executive.skill import Skill
from pomona.executive.values.yaml_nodes import YamlScalar
from pomona.tools.groot.untranslated import UntranslatedType
from pomona.tools.groot.yaml_text import flow

_WIRE = re.compile(r"\{(\w+)\}")
_IS_DECLARED = re.compile(r"(?!BehaviorTree$)[A-Za-z]\w*", re.ASCII)
"""Elements that a dry run passes through: names that a skill can have. A tree without a single root has no meaning
even there."""


def with_stubs(
    text: str,
    skills: Mapping[str, type[Skill]],
    directions: Mapping[str, Mapping[str, str]] | None = None,
) -> str:
    """Return the text of a tree with `skills:` for those that are not installed.

    `directions` are those of the models: `input`, `output` or `inout` by skill and port. Without one, a port that is
    wired to a name which nothing before it writes is an output, and every other is an input.
    Elements without translation are declared, too: a dry run goes through their children.
    """
    document = read(text, "imported.yaml")
    ports: dict[str, dict[str, bool]] = {}
    for definition in document.definitions():
        written = {*definition.inputs, *definition.file.parameters, *definition.file.constants}
        nodes = [*definition.root.walk()] if definition.root is not None else []
        written.update(
            name for node in nodes if isinstance(node.type, SetType) for name in node.ports
        )
        for node in nodes:
            if isinstance(node.type, UntranslatedType) and _IS_DECLARED.fullmatch(
                node.type.element(node)
            ):
                ports.setdefault(node.type.element(node), {})
            if node.type is not SKILL:
                continue
            known = skills.get(node.key.text)
            found = ports.setdefault(node.key.text, {}) if known is None else {}
            sides = (directions or {}).get(node.key.text, {})
            for port, (_, value) in node.ports.items():
                wire = _WIRE.fullmatch(value.text) if isinstance(value, YamlScalar) else None
                is_output = known is not None and port in known.outputs
                if known is None:
                    unwritten = wire is not None and wire[1] not in written
                    side = sides.get(port, "inout")
                    is_output = found.setdefault(
                        port, unwritten if side == "inout" else side == "output"
                    )
                if wire is not None and is_output:
                    written.add(wire[1])
    if not ports:
        return text
    lines = ["skills:                           # not installed here; their behaviour is unknown"]
    for name, found in sorted(ports.items()):
        named = {
            side: [p for p, out in found.items() if out == (side == "out")]
            for side in ("in", "out")
        }
        lines.append(f"  {name}: {flow({side: names for side, names in named.items() if names})}")
    head, tree, rest = text.partition("\nroot:")
    return f"{head}\n{chr(10).join(lines)}{tree}{rest}"
