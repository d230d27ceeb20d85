"""`pomona export` and `pomona import`: XML of Groot2 and BehaviorTree.CPP, out and in."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pomona.executive.files import find_tree, read_text, write_text
from pomona.executive.language.check import read_document, refuse_errors
from pomona.executive.recording.plain_file import refuse_taken
from pomona.executive.registry import Registry
from pomona.executive.values.findings import format_findings
from pomona.executive.values.plain_text import is_file
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.groot.import_xml import import_groot

_OUT = "file to write (default: standard output)"


def add_export(subparsers: Any) -> None:
    """Register `pomona export`."""
    about = "write a tree as XML for Groot2 and BehaviorTree.CPP"
    out = subparsers.add_parser("export", help=about)
    out.add_argument("tree", help="a tree file, or the name of an installed tree")
    out.add_argument("--out", type=Path, metavar="FILE", help=_OUT)
    out.set_defaults(main=export)


def add_import(subparsers: Any) -> None:
    """Register `pomona import`."""
    about = "read XML of Groot2 or BehaviorTree.CPP 4 and print a tree file"
    into = subparsers.add_parser("import", help=about)
    main = "the file with the main tree; included files are read, too"
    into.add_argument("xml", type=Path, help=main)
    beside = "further files with called trees, or with models of the nodes"
    into.add_argument("beside", type=Path, nargs="*", metavar="xml", help=beside)
    stubs = "declare the skills that are not installed in the tree: it can be checked, drawn, run dry and exported"
    into.add_argument("--stubs", action="store_true", help=stubs)
    tree = "main tree, if the file names none"
    into.add_argument("--main", dest="tree", default="", metavar="ID", help=tree)
    into.add_argument("--out", type=Path, metavar="FILE", help=_OUT)
    into.set_defaults(main=import_)


def export(options: argparse.Namespace) -> int:
    """Write the XML."""
    document = read_document(find_tree(options.tree))
    registry = Registry.installed()
    refuse_errors(document, registry, {}, None)
    xml = export_groot(document, registry.declaring(document.main.declared_skills))
    write_text(xml, options.out, replaces="<?xml")
    return 0


def import_(options: argparse.Namespace) -> int:
    """Write the tree file, or nothing when a part of it cannot be translated; findings go to standard error.

    Returns:
        0 when everything was carried over without a warning, else 1.
    """
    if options.out is not None and is_file(options.out):
        refuse_taken(options.out)
    text, findings = import_groot(
        read_text(options.xml),
        options.xml,
        beside=[(read_text(path), path) for path in options.beside],
        main=options.tree,
        skills=Registry.installed(),
        stubs=options.stubs,
    )
    if findings:
        sys.stderr.write(format_findings(findings) + "\n")
    if not text:
        sys.stderr.write(
            "Nothing was written: a tree is translated as a whole. Change these places.\n"
        )
        return 1
    write_text(text, options.out)
    sys.stderr.write(f"check it with `pomona check {options.out or 'FILE'}`\n")
    return 1 if findings else 0
