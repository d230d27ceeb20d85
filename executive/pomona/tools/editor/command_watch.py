"""`pomona run --watch`: when the tree file is saved, check it, report the changes, and run it again."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path

from pomona.executive.errors import UsageError
from pomona.executive.language import Document
from pomona.executive.language.documents import read_document, refuse_errors
from pomona.executive.registry import Registry
from pomona.executive.terminal.screen import Screen
from pomona.tools.editor.compare import changes

LOOK_EVERY = 0.3  # seconds between two looks at the file


def run_on_save(
    path: Path,
    settings: Mapping[str, str],
    run: Callable[[], int],
    console: Screen,
    wait: Callable[[float], None] = time.sleep,
) -> int:
    """Run, then again after each save that changes the tree and leaves no error, until Ctrl-C.

    Args:
        path: the tree file.
        settings: for its parameters; those that it does not declare are the cell's.
        run: runs the tree once; returns the exit status.
        console: output of changes and errors.
        wait: between two looks at the file.

    Returns:
        the exit status of the newest run.
    """
    registry = Registry.installed()
    try:
        document, stamp, status = _first(path, settings, registry, console, wait), _stamp(path), 2
    except KeyboardInterrupt:
        return 2
    status = run()
    console.print(f"watching {path}: save it to run it again, Ctrl-C ends")
    try:
        while True:
            wait(LOOK_EVERY)
            if _stamp(path) == stamp:
                continue
            stamp = _stamp(path)
            changed = _reload(path, document, settings, registry, console)
            if changed is not None:
                document = changed
                status = run()
                console.print(f"watching {path}")
    except KeyboardInterrupt:
        return status


def _first(
    path: Path, settings: Mapping[str, str], registry: Registry, console: Screen, wait: Callable[[float], None]
) -> Document:
    """Return the first version that can run; until then, report the errors at each save."""
    while True:
        stamp = _stamp(path)
        try:
            return _good(path, settings, registry)
        except UsageError as error:
            console.print(str(error), style="red", soft_wrap=True)
        console.print(f"watching {path}: it runs as soon as it can, Ctrl-C ends")
        while _stamp(path) == stamp:
            wait(LOOK_EVERY)


def _good(path: Path, settings: Mapping[str, str], registry: Registry) -> Document:
    """Return the tree of a file that has no errors. Raises UsageError: with every finding."""
    document = read_document(path)
    declared = set(document.main.parameters)
    refuse_errors(document, registry, {k: v for k, v in settings.items() if k in declared}, None)
    return document


def _reload(
    path: Path, before: Document, settings: Mapping[str, str], registry: Registry, console: Screen
) -> Document | None:
    try:
        document = _good(path, settings, registry)
    except UsageError as error:
        console.print(str(error), style="red", soft_wrap=True)
        return None
    lines = changes(before, document)
    if not lines:
        console.print("saved, nothing that runs has changed")
        return None
    for line in lines:
        console.print(f"  {line}")
    return document


def _stamp(path: Path) -> tuple[int, int]:
    """Return a stamp that changes when a file is saved; editors replace files, so it may be missing for a moment."""
    try:
        status = path.stat()
    except OSError:
        return (0, 0)
    return status.st_mtime_ns, status.st_size
