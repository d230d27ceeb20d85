"""Declarations of skills that a tree uses and that are not installed here, guessed from how their ports are wired."""

from __future__ import annotations

import re

from pomona.executive.language.declared_skills import declared_skills
from pomona.executive.language.read import read
from pomona.executive.nodes.calls import SKILL
from pomona.executive.nodes.leaves import SetType
from pomona.executive.nodes.untranslated import UntranslatedType
from pomona.executive.values.yaml_nodes import YamlScalar
from pomona.executive.values.yaml_text import flow

_WIRE = re.compile(r"\{(\w+)\}")


def with_stubs(text: str) -> str:
    """Return the text of a tree with `skills:` for those that are not installed.

    A port that is wired to a name which nothing before it writes is an output; every other is an input.
    Elements without translation are declared, too: a dry run goes through their children.
    """
    document, skills = read(text, "imported.yaml"), declared_skills()
    ports: dict[str, dict[str, bool]] = {}
    for definition in document.definitions():
        written = {*definition.inputs, *definition.file.parameters, *definition.file.constants}
        nodes = [*definition.root.walk()] if definition.root is not None else []
        written.update(name for node in nodes if isinstance(node.type, SetType) for name in node.ports)
        for node in nodes:
            if isinstance(node.type, UntranslatedType) and re.fullmatch(r"[A-Za-z]\w*", node.type.element(node)):
                ports.setdefault(node.type.element(node), {})
            if node.type is not SKILL:
                continue
            known = skills.get(node.key.text)
            found = ports.setdefault(node.key.text, {}) if known is None else {}
            for port, (_, value) in node.ports.items():
                wire = _WIRE.fullmatch(value.text) if isinstance(value, YamlScalar) else None
                is_output = known is not None and port in known.outputs
                if known is None:
                    is_output = found.setdefault(port, wire is not None and wire[1] not in written)
                if wire is not None and is_output:
                    written.add(wire[1])
    if not ports:
        return text
    lines = ["skills:                           # not installed here; their behaviour is unknown"]
    for name, found in sorted(ports.items()):
        sides = {side: [p for p, out in found.items() if out == (side == "out")] for side in ("in", "out")}
        lines.append(f"  {name}: {flow({side: names for side, names in sides.items() if names})}")
    head, tree, rest = text.partition("\nroot:")
    return f"{head}\n{chr(10).join(lines)}{tree}{rest}"
