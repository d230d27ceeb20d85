"""`pomona skills`: the installed skills, with ports, units and failure codes."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from typing import Any

from rich.markup import escape
from rich.table import Table

from pomona.executive.errors import UsageError
from pomona.executive.reasons import failure_codes
from pomona.executive.registry import Registry, SkillListing
from pomona.executive.terminal.output import write_json
from pomona.executive.terminal.screen import Screen
from pomona.executive.values.findings import did_you_mean

NONE = "No skill is installed here: `pomona new skill NAME` begins a package with one."


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "skills", help="list the installed skills with their ports and failure codes"
    )
    parser.add_argument("name", nargs="?", help="show this skill in full")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """List the skills."""
    registry = Registry.installed()
    if not registry and not registry.problems and not options.json:
        if options.name:
            raise UsageError(NONE)
        Screen().print(NONE)
        return 0
    listing = [skill for skill in registry.listing() if options.name in (None, skill.name)]
    if options.name and not listing:
        hint = did_you_mean(options.name, registry) or f"there are {', '.join(sorted(registry))}"
        raise UsageError(f"no skill '{options.name}'; {hint}")
    if options.json:
        write_json([dataclasses.asdict(skill) for skill in listing])
        return 0
    console = Screen()
    if options.name:
        _print_one(console, listing[0])
    else:
        for skill in listing:
            _print_short(console, skill)
        console.print("`pomona skills NAME` shows one with ranges and help.")
    for name, problem in registry.problems.items():
        console.print(f"{name}: {problem}", style="red")
    return 0


def _print_short(console: Screen, skill: SkillListing) -> None:
    console.print(f"[bold]{escape(skill.name)}[/]  {escape(skill.summary)}", markup=True)
    rows = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    rows.add_column(min_width=11, no_wrap=True, style="dim")
    rows.add_column()
    for title, words in (
        ("  inputs", [_port(port) for port in skill.inputs]),
        ("  outputs", [_port(port) for port in skill.outputs]),
        ("  devices", skill.devices),
        ("  optional", skill.optional_devices),
        ("  failures", skill.failures),
    ):
        if words:
            rows.add_row(title, ", ".join(words))
    console.print(rows)


def _port(port: Mapping[str, Any]) -> str:
    """`inlier_band: length = 4 mm`."""
    default = port.get("default")
    return f"{port['name']}: {port['type']}" + ("" if default in (None, "") else f" = {default}")


def _print_one(console: Screen, skill: SkillListing) -> None:
    console.print(f"[bold]{escape(skill.name)}[/]  {escape(skill.summary)}", markup=True)
    for title, ports in (("inputs", skill.inputs), ("outputs", skill.outputs)):
        if not ports:
            continue
        table = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
        for column in ("port", "type", "default", "range", "help"):
            table.add_column(column)
        for port in ports:
            default = "required" if port.get("required") else str(port.get("default", "not wired"))
            table.add_row(
                str(port["name"]),
                str(port["type"]),
                "" if title == "outputs" else default,
                _range(port),
                str(port.get("help", "")),
            )
        console.print(table)
    console.print(f"devices: {', '.join(skill.devices) or 'none'}")
    if skill.optional_devices:
        console.print(f"optional devices: {', '.join(skill.optional_devices)}")
    codes = Table(
        title="failure codes",
        title_justify="left",
        box=None,
        padding=(0, 2, 0, 0),
        show_header=False,
    )
    for code in skill.failures:
        about = failure_codes().get(code)
        codes.add_row(code, about.meaning if about is not None else "")
    console.print(codes if skill.failures else "failure codes: none")


def _range(port: Mapping[str, Any]) -> str:
    if port.get("choices"):
        return " | ".join(port["choices"])
    low = port.get("min")
    high = port.get("max")
    if low is None and high is None:
        return ""
    return f"{'' if low is None else low} … {'' if high is None else high}"
