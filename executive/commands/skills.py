"""`pomona skills`: what is installed, with ports, units and failure codes."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from executive.errors import UsageError
from executive.registry import Registry, SkillListing


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("skills", help="list the installed skills with their ports and failure codes")
    parser.add_argument("name", nargs="?", help="show this skill in full")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """List them.

    Returns:
        the exit status.
    """
    registry = Registry.installed()
    listing = [skill for skill in registry.listing() if options.name in (None, skill.name)]
    if options.name and not listing:
        raise UsageError(f"no skill '{options.name}'; there are {', '.join(sorted(registry))}")
    if options.json:
        sys.stdout.write(json.dumps([dataclasses.asdict(skill) for skill in listing], ensure_ascii=False) + "\n")
        return 0
    console = Console()
    if options.name:
        _print_one(console, listing[0])
    else:
        table = Table(box=None, padding=(0, 2, 0, 0))
        for column in ("skill", "what it does", "devices"):
            table.add_column(column)
        for skill in listing:
            table.add_row(skill.name, skill.summary, ", ".join(skill.devices))
        console.print(table)
    for name, problem in registry.problems.items():
        console.print(f"{name}: {problem}", style="red", markup=False)
    return 0


def _print_one(console: Console, skill: SkillListing) -> None:
    console.print(f"[bold]{skill.name}[/]  {skill.summary}", highlight=False)
    for title, ports in (("inputs", skill.inputs), ("outputs", skill.outputs)):
        if not ports:
            continue
        table = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
        for column in ("port", "type", "default", "range", "help"):
            table.add_column(column)
        for port in ports:
            default = "required" if port.get("required") else str(port.get("default", "not wired"))
            table.add_row(
                str(port["name"]), str(port["type"]), "" if title == "outputs" else default, _range(port),
                str(port.get("help", "")),
            )  # fmt: skip
        console.print(table)
    console.print(f"devices: {', '.join(skill.devices) or 'none'}", highlight=False)
    console.print(f"failure codes: {', '.join(skill.failures) or 'none'}", highlight=False)


def _range(port: Mapping[str, Any]) -> str:
    if port.get("choices"):
        return " | ".join(port["choices"])
    low, high = port.get("min"), port.get("max")
    if low is None and high is None:
        return ""
    return f"{'' if low is None else low} … {'' if high is None else high}"
