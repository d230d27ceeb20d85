"""Run a tree of plain py_trees behaviours: recorded, explained and shown on the page like a tree file.

    run_behaviour(py_trees.composites.Sequence("fetch", memory=True, children=[…]), dashboard=True)

The behaviours need no change. They get no devices of a cell and no static check; a tree file has both.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import py_trees
from py_trees.behaviour import Behaviour

from pomona.executive.board import Board
from pomona.executive.cell.cell import dry_cell
from pomona.executive.execute import Executed, versions
from pomona.executive.language import BuiltTree
from pomona.executive.language.built import NodeInfo, UniquePaths
from pomona.executive.recording.session import RecordingSession
from pomona.executive.run_views import RunViews
from pomona.executive.running.events import Listener, RunStarted
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.summary import Summary

PERIOD = 0.05  # default tick period [s]: 20 Hz, between the 10 Hz of py_trees_ros and the 50 Hz of tree files
PORT = 8420  # default port of the page, as of `pomona run --dashboard`
RECORDS = Path("runs")  # default folder of records

_KINDS = (
    (py_trees.composites.Sequence, "sequence"),
    (py_trees.composites.Selector, "fallback"),
    (py_trees.composites.Parallel, "parallel"),
    (py_trees.decorators.Decorator, "modifier"),
)


def run_behaviour(
    root: Behaviour,
    *,
    dashboard: bool = False,
    port: int = PORT,
    record: Path | None = RECORDS,
    period: float = PERIOD,
    listeners: Sequence[Listener] = (),
    on_ready: Callable[[Runner], None] | None = None,
) -> Executed:
    """Tick a py_trees tree until its root succeeds or fails. An exception in a behaviour ends the run as an error.

    Args:
        root: the tree; each of its behaviours gets an attribute `path`.
        dashboard: serve the operator's page on this machine and print its link. Started in a terminal, the page stays
            after the run until Ctrl-C.
        record: folder of records; None: no record.
        period: tick period [s of the wall clock].
        listeners: receive each event of the run.
        on_ready: receives the runner before the first tick, to pause, step or stop it from another thread.

    Raises UsageError: the record cannot be opened or the page's address is in use; nothing was ticked.
    """
    views = RunViews.installed()
    console = Screen()
    parser = argparse.ArgumentParser()
    views.add(parser)
    options = parser.parse_args(["--dashboard", "--port", str(port)] if dashboard else [])
    with views.open(options, console, record or RECORDS):
        with views.run(_shown(root)) as starting:

            def ready(runner: Runner) -> None:
                views.on_ready(runner)
                if on_ready is not None:
                    on_ready(runner)
                if starting is not None:
                    starting.attach(runner)
                    starting.begin()

            executed = _run(root, record, period, [*listeners, *views.listeners], ready)
        if sys.stdin.isatty():
            views.stay()
    return executed


def _run(
    root: Behaviour,
    record: Path | None,
    period: float,
    listeners: Sequence[Listener],
    on_ready: Callable[[Runner], None] | None,
) -> Executed:
    cell = dry_cell()
    events = EventStream()
    summary = Summary()
    session = RecordingSession(record, cell)
    runner = Runner(
        lambda _context, board: as_built(root, board),
        cell,
        events,
        period=period,
        real_time=True,
        watchers=[session],
    )
    events.subscribe(summary.on_event, feedback=False)
    for listener in listeners:
        events.subscribe(listener)
    problem = ""
    try:
        session.begin(runner, events)
        events.emit(_started(runner, session.folder, period))
        if on_ready is not None:
            on_ready(runner)
        result = runner.run()
    finally:
        runner.close()
        problem = session.close()
    return Executed(result, summary, session.folder, problem)


def as_built(root: Behaviour, board: Board) -> BuiltTree:
    """Return a py_trees tree in the form in which the runner ticks and the page draws it."""
    paths = UniquePaths()
    infos = list[NodeInfo]()
    behaviours = dict[str, Behaviour]()
    for behaviour, parent in _walk(root, None):
        above = "" if parent is None else f"{parent.path}/"  # type: ignore[attr-defined]
        name = _shown(behaviour)
        of = type(behaviour).__name__
        path = paths.take(above + name.replace("/", "∕"))
        behaviour.path = path  # type: ignore[attr-defined]
        kind = next((kind for base, kind in _KINDS if isinstance(behaviour, base)), "skill")
        infos.append(
            NodeInfo(
                path, above[:-1] or None, kind, name, of, description=type(behaviour).__doc__ or ""
            )
        )
        behaviours[path] = behaviour
    return BuiltTree(_shown(root), root, tuple(infos), behaviours, {}, board)


def _shown(behaviour: Behaviour) -> str:
    """Return the name of a behaviour; one without a name is shown under its class."""
    return behaviour.name.strip() or type(behaviour).__name__


def _walk(
    behaviour: Behaviour, parent: Behaviour | None
) -> Iterator[tuple[Behaviour, Behaviour | None]]:
    yield behaviour, parent
    for child in behaviour.children:
        yield from _walk(child, behaviour)


def _started(runner: Runner, folder: Path | None, period: float) -> RunStarted:
    tree = runner.tree
    return RunStarted(
        0.0,
        0,
        run=folder.name if folder is not None else tree.name,
        tree=tree.name,
        tree_path="",
        tree_text="",
        tree_hash="",
        cell="none",
        cell_kind="mock",
        cell_path="",
        cell_text="",
        seed=0,
        parameters={},
        nodes=tuple(info.facts() for info in tree.nodes),
        versions=versions(),
        wall_time=time.time(),
        period=period,
    )
