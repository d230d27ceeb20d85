"""A recorded run as an order that repeats it: the tree, the cell, the settings and the seed of its record."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder
from pomona.executive.judging import Judged, judge
from pomona.executive.language.check import read_document
from pomona.executive.registry import Registry
from pomona.executive.running.events import OperatorActed, RunStarted
from pomona.executive.speed import SpeedRefusedError, checked_speed, speed_of
from pomona.executive.values.findings import place_of, said
from pomona.executive.values.installation import installed_trees

REPEATABLE = ("simulated", "frames", "mock")  # kinds of cells on which a run can be repeated


def order_of(started: RunStarted, acts: Sequence[OperatorActed], folder: Path | None) -> RunOrder:
    """Return the order of the recorded run, with the file contents of that time.

    Args:
        acts: of the operator; changes of the arm's speed are repeated.
        folder: of the repetition's record; None for one that is not compared with the run.

    Raises UsageError: the record names an impossible speed, or a folder that does not exist here; the operator changed
    what ran, and nothing would show the difference.
    """
    speeds = tuple(act for act in acts if act.action == "speed")
    for act in acts:
        if folder is None and act.action in ("change", "reload"):
            words = f"{act.who} did {act.action} at {act.t:.2f} s, which is not repeated"
            raise UsageError(f"{words}: run the tree as it is now, and repeat that run")
    try:
        speed = checked_speed(started.speed)
        for act in speeds:
            speed_of(act.detail)
    except SpeedRefusedError as error:
        raise UsageError(f"the record is none of a run: {error}") from None
    dry = started.cell == "dry" and started.cell_kind == "mock"
    cell = Path(started.cell_path)
    if (
        not dry and not cell.parent.is_dir()
    ):  # recorded on another machine: its files are found beside the cell
        cell = installed_trees() / "cells" / cell.name
        if not cell.parent.is_dir():
            raise UsageError(
                f"{started.cell_path}: its folder holds files that it names, and does not exist here"
            )
    texts = {
        started.tree_path: started.tree_text,
        str(cell): started.cell_text,
        **started.tree_files,
    }
    texts |= {str(cell.parent / name): text for name, text in started.cell_files.items()}
    return RunOrder(
        tree=Path(started.tree_path),
        cell=cell,
        seed=started.seed,
        speed=speed,
        speeds=speeds,
        settings=dict(started.settings),
        record=folder,
        dry=dry,
        mocks=cell if dry and started.cell_path else None,
        texts=texts,
    )


def judged_order(order: RunOrder) -> Judged:
    """Return the check of an order's tree and cell; nothing is connected.

    Raises UsageError: the tree cannot be read, or the cell is of a kind on which no run is repeated.
    """
    document = read_document(order.tree, order.texts)
    judged = judge(
        document,
        Registry.installed(),
        order.settings,
        None if order.dry else order.cell,
        order.texts,
    )
    if judged.cell is not None and judged.cell.kind not in REPEATABLE:
        raise UsageError(
            f"the cell in the record is of kind {judged.cell.kind}, the record's header names another kind"
        )
    return judged


def first_error(judged: Judged) -> str:
    """Return the first error of a check in one line with its place; empty without one."""
    errors = [finding for finding in judged.findings.sorted() if finding.severity == "error"]
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return f"{place_of(errors[0])}: {said(errors[0])}{more}" if errors else ""
