"""`pomona export` and `pomona import`: XML of Groot2 and BehaviorTree.CPP, out and in."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.files import find_tree, read_text, write_text
from pomona.executive.language.check import read_document, refuse_errors
from pomona.executive.language.read import read
from pomona.executive.nodes.leaves import SKILL
from pomona.executive.recording.plain_file import refuse_taken
from pomona.executive.registry import Registry
from pomona.executive.values.findings import format_findings
from pomona.executive.values.plain_text import is_file
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.groot.import_xml import import_groot
from pomona.tools.groot.untranslated import UntranslatedType
from pomona.tools.listings.declared_skills import declared_skills, with_declarations


def add_export(subparsers: Any) -> None:
    """Register `pomona export`."""
    out = subparsers.add_parser(
        "export", help="write a tree as XML for Groot2 and BehaviorTree.CPP"
    )
    out.add_argument("tree", help="a tree file, or the name of an installed tree")
    out.add_argument(
        "--out", type=Path, metavar="FILE", help="file to write (default: standard output)"
    )
    out.set_defaults(main=export)


def add_import(subparsers: Any) -> None:
    """Register `pomona import`."""
    into = subparsers.add_parser(
        "import", help="read XML of Groot2 or BehaviorTree.CPP and print a tree file"
    )
    into.add_argument(
        "xml", type=Path, help="the file with the main tree; included files are read, too"
    )
    into.add_argument(
        "beside", type=Path, nargs="*", metavar="xml", help="further files with called trees"
    )
    into.add_argument(
        "--nodes",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="models of the nodes",
    )
    about = "declare the skills that are not installed in the tree: it can be checked, drawn, run dry and exported"
    into.add_argument("--stubs", action="store_true", help=about)
    into.add_argument(
        "--main", dest="tree", default="", metavar="ID", help="main tree, if the file names none"
    )
    into.add_argument(
        "--out", type=Path, metavar="FILE", help="file to write (default: standard output)"
    )
    into.set_defaults(main=import_)


def export(options: argparse.Namespace) -> int:
    """Write the XML."""
    write_text(
        with_declarations(lambda registry: _xml(options, registry)), options.out, replaces="<?xml"
    )
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
    beside, nodes = (
        [(read_text(path), path) for path in given] for given in (options.beside, options.nodes)
    )
    if options.out is not None and is_file(options.out):
        refuse_taken(options.out)
    skills = declared_skills()
    text, findings = import_groot(
        read_text(options.xml),
        options.xml,
        beside=beside,
        nodes=nodes,
        main=options.tree,
        skills=skills,
        stubs=options.stubs,
    )
    if not text:
        raise UsageError(format_findings(findings))
    if findings:
        sys.stderr.write(format_findings(findings) + "\n")
    write_text(text, options.out)
    sys.stderr.write(_what_next(text, options.out, skills) + "\n")
    return 1 if findings else 0


def _what_next(text: str, out: Path | None, skills: Registry) -> str:
    """Return the size of the tree, its parts that cannot run, and the next step for them."""
    document, file = read(text, out or "imported.yaml"), out or "FILE"
    nodes = [
        node
        for definition in document.definitions()
        for node in (definition.root.walk() if definition.root is not None else ())
    ]
    left = sum(isinstance(node.type, UntranslatedType) for node in nodes)
    unknown = sorted({node.key.text for node in nodes if node.type is SKILL} - skills.keys())
    declared = sorted(document.main.declared_skills)
    if declared and set(unknown) <= set(declared):
        return f"{len(nodes)} nodes; {len(declared)} skills are declared in the tree: try `pomona run {file} --dry`"
    if left:
        skills_too = (
            f", {len(unknown)} skills are not installed here: {', '.join(unknown)}"
            if unknown
            else ""
        )
        return f"{len(nodes)} nodes, {left} without translation{skills_too}: `pomona check {file}` lists them"
    if not unknown:
        return f"{len(nodes)} nodes, all skills are installed: check it with `pomona check {file}`"
    return (
        f"{len(nodes)} nodes; {len(unknown)} skills are not installed here: {', '.join(unknown)}. Write each with "
        "`pomona new skill NAME`, or install the package that has it"
    )
