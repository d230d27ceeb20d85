"""`pomona why`: the smallest single change with which a failed run succeeds, found in simulation."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.table import Table

from pomona.executive.account import disagreement
from pomona.executive.commands.command_line import RUN, add_records_folder
from pomona.executive.encode import plain
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder
from pomona.executive.files import default_name, find_cell
from pomona.executive.judging import split_settings
from pomona.executive.recording.digest import trusted
from pomona.executive.recording.folder import find_record
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import RunStarted
from pomona.executive.terminal.output import write_json
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.words import seconds
from pomona.executive.values.kinds import Measure, Whole
from pomona.executive.values.units import TIME
from pomona.tools.library.cures.candidates import CureCandidate, candidates
from pomona.tools.library.cures.evidence import RunEvidence, gather
from pomona.tools.library.cures.knobs import Knobs
from pomona.tools.library.cures.repetition import REPEATABLE, first_error, judged_order, order_of
from pomona.tools.library.cures.search import CureAnswer, CureSearch, TriedChange
from pomona.tools.library.cures.trials import Trial, TrialPool, force_of

SIMULATION = "This is a simulation of a run on a real cell: only changes of the tree and its ports are tried."


@dataclass(frozen=True, slots=True)
class FailedRun:
    """A failed run, ready for the search.

    Attributes:
        evidence: of its record.
        order: the run again, on a cell that cannot move anything real.
        candidates: the most likely first.
        simulated: the run was on another cell than the search.
    """

    evidence: RunEvidence
    order: RunOrder
    candidates: Sequence[CureCandidate]
    simulated: bool


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "why",
        help="find the smallest single change with which a failed run succeeds, by repeating it in simulation",
        description="Repeats a failed run from its record in simulation, with one change at a time: a port, a "
        "parameter, a number of tries, a timeout, an option of the cell. A change that succeeds "
        "is repeated with other seeds. Nothing real is connected, and no file is changed. "
        "Exit status: 0 a cure was found, 1 none within the budget, 2 unusable input.",
    )
    parser.add_argument("run", help=RUN)
    parser.add_argument(
        "--budget",
        type=Measure(TIME, low="0.1 s").option,
        default=60.0,
        metavar="TIME",
        help="real time to spend (default: 60 s)",
    )
    parser.add_argument(
        "--jobs", type=Whole(1).option, help="processes at once (default: one per core)"
    )
    parser.add_argument(
        "--seeds",
        type=Whole(0).option,
        default=5,
        help="other seeds that a cure must pass (default: 5)",
    )
    parser.add_argument(
        "--cures", type=Whole(1).option, default=1, help="end after so many cures (default: 1)"
    )
    parser.add_argument(
        "--cell",
        help="for a run on a real cell: the cell to simulate it on (default: the usual one)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the last line"
    )
    add_records_folder(parser)
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Search, and print the answer."""
    console = Screen(stderr=options.json)
    record = find_record(options.run, options.record)
    case = read_case(record, options.cell)
    if case.simulated:
        console.print(SIMULATION, soft_wrap=True)
    console.print(
        f"{len(case.candidates)} single changes may cure it; budget {seconds(options.budget)}"
    )
    with contextlib.closing(TrialPool(options.jobs)) as pool:
        search = CureSearch(
            case.order,
            case.candidates,
            usable,
            options.seeds,
            options.cures,
            options.budget,
            _progress(console),
        )
        answer = search.run(pool)
    _print(console, answer, case)
    if options.json:
        write_json(as_json(record, answer, case))
    return 0 if answer.cures() else 1


def read_case(record: Path, cell: str | None = None) -> FailedRun:
    """Return a failed run with its candidates.

    Args:
        cell: for a run on a real cell, the name or file of the cell to simulate it on; None for the usual one.

    Raises UsageError: the record is damaged, its run did not fail, or its tree cannot be rebuilt.
    """
    trusted(record)
    evidence = gather(read_events(record))
    started = evidence.started
    ended = evidence.ended
    if started is None:
        raise UsageError(f"{record}: the record does not hold the start of the run")
    if ended is None:
        raise UsageError(
            f"{record}: the run has no end, so it did not fail; `pomona explain` shows how far it came"
        )
    if ended.outcome == "stopped":
        raise UsageError(
            f"{record}: the run was stopped from outside: no change of the tree cures that"
        )
    simulated = started.cell_kind not in REPEATABLE
    order = _simulated(started, cell) if simulated else _own(started, evidence, cell)
    judged = judged_order(order)
    if wrong := first_error(judged):
        raise UsageError(f"{record}: its tree cannot be rebuilt here: {wrong}")
    if ended.outcome == "success" and (
        simulated or not disagreement("success", plain(ended.account), plain(ended.truth))
    ):
        raise UsageError(f"{record}: the run succeeded: there is nothing to cure")
    options = () if simulated or judged.cell is None else judged.cell.options
    text = order.texts.get(str(order.cell), "")
    knobs = Knobs(judged.analysis, order.settings, options, str(order.cell), text)
    return FailedRun(evidence, order, candidates(knobs, evidence), simulated)


def _own(started: RunStarted, evidence: RunEvidence, cell: str | None) -> RunOrder:
    if cell is not None:
        raise UsageError(
            f"--cell is for runs on a real cell: this one is repeated on its own cell, {started.cell}"
        )
    return order_of(started, evidence.acts, None)


def _simulated(started: RunStarted, cell: str | None) -> RunOrder:
    """Return the order of a real run on a simulated cell, with the settings of its tree alone."""
    usual = find_cell(cell or default_name("cell"))
    texts = {started.tree_path: started.tree_text, **started.tree_files}
    order = RunOrder(
        Path(started.tree_path), usual, started.seed, dict(started.settings), texts=texts
    )
    judged = judged_order(replace(order, settings={}))
    for_tree, _ = split_settings(judged.analysis.document, order.settings)
    return replace(order, settings=for_tree)


def usable(order: RunOrder) -> bool:
    """Return whether a changed run passes the check, on a cell that moves nothing real."""
    try:
        return not first_error(judged_order(order))
    except UsageError:
        return False


# ------------------------------------------------------------------------------------------------ the answer


def _progress(console: Screen) -> Any:
    count = 0

    def show(what: str, candidate: CureCandidate | None, seed: int, trial: Trial) -> None:
        nonlocal count
        sign = "✓" if trial.succeeded else "✗"
        if what.startswith("original"):
            which = "without a change" if what == "original" else f"without a change, seed {seed}"
        elif what == "seed":
            which = f"{candidate.change.sentence if candidate else ''}, seed {seed}"
        else:
            count += 1
            which = f"{count}. {candidate.change.sentence if candidate else ''}"
        console.print(f"{sign} {which}   {_end(trial)}", soft_wrap=True)

    return show


def _end(trial: Trial) -> str:
    if trial.succeeded:
        return f"succeeded after {seconds(trial.time)}"
    return (
        f"{trial.code or trial.outcome} after {seconds(trial.time)}"
        if trial.time
        else trial.code or trial.outcome
    )


def _print(console: Screen, answer: CureAnswer, case: FailedRun) -> None:
    if answer.original is not None and answer.original.succeeded:
        where = "on the simulated cell" if case.simulated else "with the present versions"
        console.print(
            f"the failure does not repeat {where}: without a change the run succeeds",
            soft_wrap=True,
        )
        return
    shown = [*answer.cures(), *answer.lucky()]
    if shown:
        console.print(_table(shown, answer, case))
    spent = answer.sentence()
    if not answer.cures():
        console.print(spent, soft_wrap=True)
        return
    best = answer.cures()[0].candidate
    console.print(f"the cure: {best.change.sentence}", soft_wrap=True)
    console.print(f"  {best.why}; {spent}", soft_wrap=True)
    if answer.others and all(trial.succeeded for trial in answer.others.values()):
        rare = "without a change the run succeeds with all other seeds: chance alone may be the cure of this one"
        console.print(f"  {rare}", soft_wrap=True)


def _table(shown: Sequence[TriedChange], answer: CureAnswer, case: FailedRun) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for title in ("change", "succeeds", "time", "force"):
        table.add_column(title, justify="left" if title == "change" else "right", overflow="fold")
    ended = case.evidence.ended
    assert ended is not None
    force = force_of(plain(ended.truth))
    known = 1 + len(answer.others)
    own = sum(trial.succeeded for trial in answer.others.values())
    table.add_row(
        "none", f"{own} of {known}", seconds(ended.time), "–" if force is None else f"{force:.1f} N"
    )
    for tried in shown:
        trial = tried.trial
        table.add_row(
            tried.candidate.change.sentence,
            f"{tried.successes()} of {1 + len(tried.others)}",
            f"{trial.time - ended.time:+.1f} s",
            "–" if trial.force is None or force is None else f"{trial.force - force:+.1f} N",
        )
    return table


def as_json(record: Path, answer: CureAnswer, case: FailedRun) -> dict[str, Any]:
    """Return the answer as JSON; times in s, forces in N."""
    ended = case.evidence.ended
    assert ended is not None
    original = answer.original
    return {
        "run": record.name,
        "simulation_of_a_real_run": case.simulated,
        "original": {
            "outcome": ended.outcome,
            "code": case.evidence.failed()[0].code if case.evidence.failed() else "",
            "time_s": ended.time,
            "force_n": force_of(plain(ended.truth)),
            "repeats": None
            if original is None or original.outcome == "lost"
            else not original.succeeded,
            "successes_of_other_seeds": sum(trial.succeeded for trial in answer.others.values()),
            "other_seeds": len(answer.others),
        },
        "cures": [_tried_json(tried) for tried in answer.cures()],
        "lucky": [_tried_json(tried) for tried in answer.lucky()],
        "failed": [_tried_json(tried) for tried in answer.tried if not tried.trial.succeeded],
        "untried": answer.untried,
        "sentence": answer.sentence(),
        "spent_s": round(answer.spent, 3),
    }


def _tried_json(tried: TriedChange) -> dict[str, Any]:
    trial = tried.trial
    return {
        **tried.candidate.change.as_json(),
        "sentence": tried.candidate.change.sentence,
        "why": tried.candidate.why,
        "successes": tried.successes(),
        "seeds": 1 + len(tried.others),
        "outcome": trial.outcome,
        "code": trial.code,
        "time_s": trial.time,
        "force_n": trial.force,
    }
