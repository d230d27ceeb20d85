"""`pomona test`: scenario files, which test a tree's logic with mocks and without any cell."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rich.markup import escape

from pomona.executive.errors import UsageError
from pomona.executive.files import read_text
from pomona.executive.registry import Registry
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.words import say, seconds
from pomona.executive.values.installation import installed_trees
from pomona.tools.scenarios.run_scenario import ScenarioResult, run_scenario
from pomona.tools.scenarios.scenario import is_scenario, read_scenario


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "test",
        help="run scenario files: a tree's logic with mocks; report nodes that were never reached",
    )
    parser.add_argument("paths", nargs="+", type=Path, help="scenario files, or folders of them")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Run them.

    Returns:
        0 when every case went as expected, else 1.
    """
    console = Screen()
    registry = Registry.installed()
    results: dict[Path, ScenarioResult] = {}
    for path in _scenarios(options.paths):
        scenario = read_scenario(read_text(path), path, registry, tree_folders=[installed_trees()])
        result = run_scenario(scenario, registry)
        results[path] = result
        _print(console, path, result)
    cases = [case for result in results.values() for case in result.cases]
    failed = sum(not case.passed for case in cases)
    console.print(f"{len(cases) - failed} passed, {failed} failed")
    return 1 if failed else 0


def _scenarios(paths: list[Path]) -> list[Path]:
    found = []
    for path in paths:
        if path.is_dir():
            found += [p for p in sorted(path.rglob("*.yaml")) if is_scenario(read_text(p))]
        else:
            found.append(path)
    if not found:
        raise UsageError(f"no scenario files in {', '.join(map(str, paths))}")
    return found


def _print(console: Screen, path: Path, result: ScenarioResult) -> None:
    console.print(str(path), style="bold")
    for case in result.cases:
        sign = "[green]✓[/]" if case.passed else "[red]✗[/]"
        console.print(
            f"  {sign} {escape(case.case.name)}  {case.status}, {seconds(case.time)}", markup=True
        )
        for problem in case.problems:
            console.print(f"      {problem}", style="red")
        if not case.passed and case.reason is not None:
            console.print(f"      it failed because: {say(case.reason)}")
    coverage = result.coverage
    console.print(f"  {coverage.share():.0%} of the nodes were reached")
    for node in coverage.unreached():
        console.print(f"    never reached: {node.path} (line {node.line})", style="yellow")
    for node, end in coverage.ends_never_seen():
        console.print(f"    never ended in {end}: {node.path}", style="yellow")
