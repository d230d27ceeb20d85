"""`pomona export` and `pomona import`: XML of Groot2 and BehaviorTree.CPP, out and in."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.files import find_tree, read_text, write_text
from pomona.executive.language.declared_skills import declared_skills
from pomona.executive.language.documents import read_document, refuse_errors, with_declarations
from pomona.executive.language.read import read
from pomona.executive.nodes.calls import SKILL
from pomona.executive.nodes.leaves import SetType
from pomona.executive.registry import Registry
from pomona.executive.values.findings import format_findings
from pomona.executive.values.yaml_nodes import YamlScalar
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.groot.import_xml import import_groot
from pomona.tools.groot.untranslated import UntranslatedType
from pomona.tools.groot.yaml_text import flow


def add_export(subparsers: Any) -> None:
    """Register `pomona export`."""
    out = subparsers.add_parser("export", help="write a tree as XML for Groot2 and BehaviorTree.CPP")
    out.add_argument("tree", help="a tree file, or the name of an installed tree")
    out.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: standard output)")
    out.set_defaults(main=export)


def add_import(subparsers: Any) -> None:
    """Register `pomona import`."""
    into = subparsers.add_parser("import", help="read XML of Groot2 or BehaviorTree.CPP and print a tree file")
    into.add_argument("xml", type=Path, help="the file with the main tree; included files are read, too")
    into.add_argument("beside", type=Path, nargs="*", metavar="xml", help="further files with called trees")
    into.add_argument("--nodes", type=Path, action="append", default=[], metavar="FILE", help="models of the nodes")
    about = "declare the skills that are not installed in the tree: it can be checked, drawn, run dry and exported"
    into.add_argument("--stubs", action="store_true", help=about)
    into.add_argument("--main", dest="tree", default="", metavar="ID", help="main tree, if the file names none")
    into.add_argument("--out", type=Path, metavar="FILE", help="file to write (default: standard output)")
    into.set_defaults(main=import_)


def export(options: argparse.Namespace) -> int:
    """Write the XML."""
    write_text(with_declarations(lambda registry: _xml(options, registry)), options.out)
    return 0


def _xml(options: argparse.Namespace, registry: Registry) -> str:
    document = read_document(find_tree(options.tree))
    refuse_errors(document, registry, {}, None)
    return export_groot(document, registry.declaring(document.main.declared_skills))


def import_(options: argparse.Namespace) -> int:
    """Write the tree file; report parts without translation on standard error.

    Returns:
        0 when everything was carried over, else 1.
    """
    beside, nodes = ([(read_text(path), path) for path in given] for given in (options.beside, options.nodes))
    text, findings = import_groot(read_text(options.xml), options.xml, beside=beside, nodes=nodes, main=options.tree)
    if not text:
        raise UsageError(format_findings(findings))
    if findings:
        sys.stderr.write(format_findings(findings) + "\n")
    if options.stubs:
        text = with_stubs(text)
    write_text(text, options.out)
    sys.stderr.write(_what_next(text, options.out) + "\n")
    return 1 if findings else 0


def _what_next(text: str, out: Path | None) -> str:
    """Return the size of the tree, its skills that are not installed, and the next step for them."""
    document, file = read(text, out or "imported.yaml"), out or "FILE"
    nodes = [
        node
        for definition in document.definitions()
        for node in (definition.root.walk() if definition.root is not None else ())
    ]
    skills = declared_skills()
    unknown = sorted({node.key.text for node in nodes if node.type is SKILL} - skills.keys())
    declared = sorted(document.main.declared_skills)
    if declared and set(unknown) <= set(declared):
        return f"{len(nodes)} nodes; {len(declared)} skills are declared in the tree: try `pomona run {file} --dry`"
    if not unknown:
        return f"{len(nodes)} nodes, all skills are installed: check it with `pomona check {file}`"
    return (
        f"{len(nodes)} nodes; {len(unknown)} skills are not installed here: {', '.join(unknown)}. Write each with "
        "`pomona new skill NAME`, or install the package that has it"
    )


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
