"""`pomona edit`: a tree file drawn beside its text, edited in the browser."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path
from typing import Any

from pomona.executive.commands.command_line import add_records_folder
from pomona.executive.errors import UsageError
from pomona.executive.files import find_cell, find_tree
from pomona.tools.dashboard.options import add_address, make_access

PORT = 8430  # default port of the editor; the operator's page has another one


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "edit", help="edit a tree file in the browser: drawing and text side by side"
    )
    parser.add_argument(
        "tree", help="a tree file, the name of an installed tree, or a new file that ends in .yaml"
    )
    parser.add_argument(
        "--cell", help="the simulated cell whose names are offered, and on which runs start"
    )
    add_records_folder(parser)
    add_address(parser, PORT)
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    from pomona.executive.registry import Registry
    from pomona.executive.terminal.screen import Screen, in_browser
    from pomona.tools.editor.service import is_tree
    from pomona.tools.tree_editor.server import TreeEditor, default_cell, refuse_real
    from pomona.tools.tree_editor.tree_file import EditedFile

    file = EditedFile(_path_of(options.tree))
    text = file.read().text
    if text.strip() and not is_tree(text):
        raise UsageError(f"{options.tree}:1:1: not a tree file: there is no 'root'")
    cell = find_cell(options.cell) if options.cell else default_cell()
    refuse_real(cell)
    console = Screen()
    editor = TreeEditor(file, make_access(options), Registry.installed(), cell, options.record)
    editor.start()
    try:
        console.print(f"editor: {editor.access.link}   (Ctrl-C ends it)", soft_wrap=True)
        with in_browser(console, editor.access.link):
            threading.Event().wait()
    except KeyboardInterrupt:
        pass
    finally:
        editor.close()
    return 0


def _path_of(name: str) -> Path:
    """Return the file to edit; a new one where a name ends in .yaml. Raises UsageError: there is none."""
    path = Path(name)
    if path.suffix in (".yaml", ".yml") and not path.exists():
        return path
    return path if path.is_dir() else find_tree(name)
