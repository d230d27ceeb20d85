"""`pomona run`: a tree file on a cell, watched, recorded and summed up."""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import logging
import platform
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, entry_points, version
from pathlib import Path
from typing import Any

from rich.console import Console

from executive.cell import Cell
from executive.commands.files import find_cell, find_tree, read_text
from executive.commands.settings import split_settings
from executive.errors import UsageError
from executive.events import EventStream, RunStarted
from executive.recording.picture import Picture
from executive.recording.recorder import Recorder, new_record_folder
from executive.registry import Registry
from executive.runner import Runner, RunResult
from executive.terminal.live import LiveTree
from executive.terminal.summary import Summary
from executive.tree_file import Document, build, check, format_finding, read

EXIT = {"success": 0, "failure": 1, "stopped": 3, "error": 3}


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("run", help="run a tree file on a cell")
    parser.add_argument("tree", help="a tree file, or the name of an installed tree")
    parser.add_argument("--cell", default="sim", help="a cell file, or the name of an installed cell (default: sim)")
    parser.add_argument("--seed", type=int, default=0, help="every random choice comes from it (default: 0)")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a parameter of the tree, or an option of the cell",
    )
    parser.add_argument(
        "--pace",
        choices=("fast", "real"),
        default="fast",
        help="speed of a simulated cell: as fast as possible, or real",
    )
    parser.add_argument(
        "--record", type=Path, default=Path("runs"), metavar="DIR", help="where records go (default: runs)"
    )
    parser.add_argument("--no-record", action="store_true", help="leave no record")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Run it.

    Returns:
        the exit status.
    """
    console = Console(stderr=options.json, quiet=options.quiet)
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    registry = Registry.installed()
    document = read_document(find_tree(options.tree))
    tree_settings, cell_settings = split_settings(options.set, document)
    refuse_errors(document, registry, tree_settings, None)
    cell_path = find_cell(options.cell)
    cell = load_cell(cell_path, options.seed, cell_settings)
    try:
        refuse_errors(document, registry, tree_settings, cell.interfaces())
        return _run(options, console, registry, document, tree_settings, cell, cell_path, cell_settings)
    finally:
        cell.close()


def _run(
    options: argparse.Namespace,
    console: Console,
    registry: Registry,
    document: Document,
    tree_settings: Mapping[str, str],
    cell: Cell,
    cell_path: Path,
    cell_settings: Mapping[str, str],
) -> int:
    events, summary, picture, live = EventStream(), Summary(), Picture(), LiveTree(console)
    runner = Runner(
        lambda context: build(document, registry, overrides=tree_settings, context=context),
        cell,
        events,
        seed=options.seed,
        real_time=options.pace == "real",
    )
    folder = None if options.no_record else new_record_folder(options.record, document.name)
    recorder = None if folder is None else Recorder(folder)
    if recorder is not None:
        events.subscribe(recorder.hear)
    for listener in (summary.hear, picture.hear, live.hear):
        events.subscribe(listener)
    try:
        with console.status("preparing the skills …"):
            runner.prepare()
        events.emit(
            started(runner, document, cell, cell_path, options.seed, tree_settings, cell_settings, folder)
        )  # fmt: skip
        with _terminate_safely(runner):
            result = runner.run()
        if folder is not None and not picture.empty:
            picture.save(folder / "picture.png", f"{document.name}: {result.outcome}, seed {options.seed}")
    finally:
        live.close()
        if recorder is not None:
            recorder.close()
    summary.print(console, folder)
    if recorder is not None and recorder.problem:
        console.print(f"[red]{recorder.problem}[/]")
    if options.json:
        sys.stdout.write(json.dumps(summary.as_json(folder), ensure_ascii=False) + "\n")
    return exit_status(result)


def exit_status(result: RunResult) -> int:
    """The process's exit status for a run's result."""
    return 130 if result.interrupted else EXIT[result.outcome]


def read_document(path: Path) -> Document:
    """Read a tree file.

    Raises:
        UsageError: it cannot be read at all.
    """
    return read(read_text(path), path)


def refuse_errors(
    document: Document, registry: Registry, settings: Mapping[str, str], interfaces: tuple[type, ...] | None
) -> None:
    """Check a document.

    Raises:
        UsageError: with every error found; warnings alone pass.
    """
    findings = check(document, registry, overrides=settings, interfaces=interfaces)
    errors = [finding for finding in findings if finding.severity == "error"]
    if errors:
        count = f"{len(errors)} error{'s' if len(errors) > 1 else ''}"
        raise UsageError("\n".join(map(format_finding, findings)) + f"\n{count}. Nothing was run.")


def load_cell(path: Path, seed: int, settings: Mapping[str, str]) -> Cell:
    """Connect a cell.

    Raises:
        UsageError: the cell file is wrong or a device cannot be reached.
    """
    loader = next(iter(entry_points(group="pomona.cells", name="file"))).load()
    try:
        cell: Cell = loader(path, seed=seed, overrides=settings)
    except Exception as error:
        raise UsageError(str(error) or type(error).__name__) from error
    return cell


def started(
    runner: Runner,
    document: Document,
    cell: Cell,
    cell_path: Path,
    seed: int,
    tree_settings: Mapping[str, str],
    cell_settings: Mapping[str, str],
    folder: Path | None,
) -> RunStarted:
    """The first event of a run: everything that is needed to repeat it."""
    return RunStarted(
        0.0,
        0,
        run=folder.name if folder is not None else f"{document.name}-{seed}",
        tree=document.name,
        tree_path=str(document.path),
        tree_text=document.text,
        tree_hash=hashlib.sha256(document.text.encode()).hexdigest()[:16],
        cell=cell.name,
        cell_kind=cell.kind,
        cell_path=str(cell_path),
        cell_text=read_text(cell_path),
        seed=seed,
        parameters=runner.tree.parameters,
        nodes=tuple(node.as_mapping() for node in runner.tree.nodes),
        versions=_versions(),
        wall_time=time.time(),
        period=0.02,
        settings={**tree_settings, **cell_settings},
    )


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "platform": platform.platform(terse=True)}
    for package in ("pomona", "py-trees", "numpy", "torch", "ompl", "mujoco-core"):
        with contextlib.suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


@contextlib.contextmanager
def _terminate_safely(runner: Runner) -> Iterator[None]:
    """SIGTERM ends a run in the safe state, with its record closed."""
    before = signal.signal(signal.SIGTERM, lambda _signal, _frame: runner.safe_stop("the process was terminated"))
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
