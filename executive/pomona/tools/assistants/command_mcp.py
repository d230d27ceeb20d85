"""`pomona mcp`: a door for assistants, over standard input and output."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pomona.executive.commands.command_line import add_records_folder
from pomona.executive.errors import UsageError
from pomona.executive.ports import TIME
from pomona.executive.terminal.screen import Screen
from pomona.executive.values.installation import need
from pomona.executive.values.kinds import Measure, Whole
from pomona.tools.assistants.work_folder import WorkFolder
from pomona.tools.dashboard.approvals import PLACE, Approvals, described, dismiss, read_request


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "mcp", help="a door for assistants (Model Context Protocol); started by them"
    )
    parser.description = (
        "Serves one folder to an assistant: it reads and writes tree files, checks them, runs them on simulated cells "
        "and reads records. It cannot start a real cell: it writes a request, which --requests shows to the operator."
    )
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER",
        help="the only folder that the assistant reads and writes",
    )
    parser.add_argument(
        "--most-runs",
        type=Whole(0).option,
        default=50,
        metavar="N",
        help="simulated runs (default: 50)",
    )
    about = "time of one run (default: 600 s)"
    parser.add_argument(
        "--limit", type=Measure(TIME, "1 s").option, default=600.0, metavar="TIME", help=about
    )
    parser.add_argument(
        "--requests", action="store_true", help="show the requests to the operator, and end"
    )
    parser.add_argument("--dismiss", metavar="REQUEST", help="remove a request, and end")
    add_records_folder(parser)
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Serve until the assistant ends the session, or show the requests."""
    folder = WorkFolder(options.folder, options.record)
    if options.dismiss is not None:
        return _dismiss(folder, options.dismiss)
    if options.requests:
        return _print_requests(folder)
    if sys.platform == "win32":
        raise UsageError(
            "pomona mcp needs Linux or macOS: its commands are bounded by means of these systems"
        )
    need("mcp", "mcp", "pomona mcp")
    from pomona.tools.assistants.bounded import BoundedCommands
    from pomona.tools.assistants.call_log import CallLog
    from pomona.tools.assistants.door import Door
    from pomona.tools.assistants.server import DoorServer

    commands = BoundedCommands(folder.root, folder.records)
    door = Door(folder, commands, most_runs=options.most_runs, limit=options.limit)
    server = DoorServer(door, CallLog(folder.records))
    if sys.stdin.isatty():
        Screen(stderr=True).print(
            "an assistant starts this command and writes to its standard input; Ctrl-C ends it"
        )
    server.run()
    return 0


def _print_requests(folder: WorkFolder) -> int:
    console = Screen()
    requests = Approvals(folder.root, folder.records).open()
    for request in requests:
        for paragraph in described(read_request(request), folder.records):
            console.print(paragraph, soft_wrap=True)
        console.print(
            f"to remove it: pomona mcp {folder.root} --dismiss {request.name}\n", soft_wrap=True
        )
    if not requests:
        console.print("no requests")
    return 0


def _dismiss(folder: WorkFolder, name: str) -> int:
    request = next(
        (path for path in Approvals(folder.root, folder.records).open() if path.name == name), None
    )
    if request is None:
        raise UsageError(
            f"there is no request '{name}' in {folder.records / PLACE}: --requests lists them"
        )
    dismiss(request)
    return 0
