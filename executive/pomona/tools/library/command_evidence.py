"""`pomona evidence`: hazards, the nodes that guard against them, their limits, the largest that was measured."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

from pomona.executive.commands.command_line import add_records_folder
from pomona.executive.errors import UsageError
from pomona.executive.files import default_name
from pomona.executive.recording.folder import find_record, records_in
from pomona.executive.terminal.output import json_text
from pomona.executive.terminal.screen import Screen
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.sentences import ReportLine
from pomona.tools.library.campaign.document import Bullets, Heading, Paragraph, ReportPage, Table
from pomona.tools.library.evidence import Evidence, Hazard, Measured, gather, read_hazards

NO_CLAIM = (
    "a run measures only the situations that it met: a maximum over runs is no bound",
    "forces and positions are measured by the devices; truth is the simulated world's, and counts where it is larger",
    "checksums find accidents; a forged record can only be detected with a digest kept elsewhere: those below",
    "the safe state is no hardware emergency stop, and this is no certificate",
)


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "evidence", help="hazards, limits and measured maxima of a campaign or of runs"
    )
    parser.epilog = (
        "Exit status: 0 no limit was passed, 1 a limit was passed or a check failed, 2 no evidence."
    )
    add_argument = parser.add_argument
    what = "a folder of a campaign, a folder of records, a record, or its name below --record"
    add_argument("runs", nargs="+", metavar="CAMPAIGN_OR_RUN", help=what)
    add_records_folder(parser)
    add_argument("--hazards", type=Path, help="a file of hazards (default: the installed one)")
    add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="also write evidence.md, .html and .json into this folder",
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Print hazards with limits and largest values; write evidence.md, evidence.html and evidence.json with `--out`.

    Returns:
        0; 1 when a limit was passed, or a check of all runs together failed.
    """
    hazards = read_hazards(
        options.hazards or installed_trees() / "hazards" / f"{default_name('hazards')}.yaml"
    )
    records = [record for name in options.runs for record in _records(name, options.record)]
    evidence = gather(list(dict.fromkeys(records)), hazards)
    if not evidence.runs:
        why = "; ".join(f"{run}: {reason}" for run, reason in list(evidence.left_out.items())[:3])
        raise UsageError(f"no record can serve as evidence ({why or 'there is none'})")
    console = Screen()
    for hazard, measured in _beyond_first(evidence):
        mark, style = (
            ("✗", "red") if measured.beyond else ("✓", "") if measured.runs else ("–", "dim")
        )
        limit = _limit(measured, hazard.unit)
        largest = _largest(measured, hazard.unit)
        count = (
            f", beyond in {_number(measured.beyond, 'run')} of {measured.runs}"
            if measured.beyond
            else ""
        )
        console.print(
            f"{mark} {hazard.name}: limit {limit}, largest {largest}{count}",
            style=style,
            soft_wrap=True,
        )
    for check in evidence.checks:
        console.print(_check(check), style="" if check.ok else "red", soft_wrap=True)
    beyond = sum(measured.beyond > 0 for measured in evidence.measured)
    beyond += sum(not check.ok for check in evidence.checks)
    left_out = (
        f", {_number(len(evidence.left_out), 'record')} left out" if evidence.left_out else ""
    )
    verdict = (
        f"{_number(beyond, 'limit')} passed (exit status 1)" if beyond else "no limit was passed"
    )
    console.print(f"{_number(len(evidence.runs), 'run')}{left_out}: {verdict}")
    if options.out is not None:
        markdown, page = document(evidence).write(options.out, "evidence")
        (options.out / "evidence.json").write_text(
            json_text(evidence.as_json(), indent=1) + "\n", encoding="utf-8"
        )
        console.print(f"{markdown} {page}", soft_wrap=True)
    return 1 if beyond else 0


def _check(check: ReportLine) -> str:
    return f"{'✓' if check.ok else '✗'} {check.name}: {check.found}"


def _beyond_first(evidence: Evidence) -> list[tuple[Hazard, Measured]]:
    """Hazards whose limit was passed, then the others."""
    rows = zip(evidence.hazards, evidence.measured, strict=True)
    return sorted(rows, key=lambda row: not row[1].beyond)


def _number(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _records(name: str, root: Path) -> list[Path]:
    for folder in (Path(name) / "records", Path(name), root / name):
        if found := sorted(path.parent for path in records_in(folder)):
            return found
    try:
        return [find_record(name, root)]
    except UsageError as unknown:
        if not Path(name).is_dir():
            raise
        words = "no records are in this folder, and evidence comes from records alone"
        raise UsageError(f"{name}: {words}: `pomona campaign … --record` keeps them") from unknown


def document(evidence: Evidence) -> ReportPage:
    """Return the evidence as a report."""
    runs = evidence.runs
    outcomes = Counter(str(run["outcome"]) for run in runs)
    cells = Counter(f"{run['cell']} ({run['cell_kind']})" for run in runs)
    commits = Counter(str(run["git"] or "unknown") for run in runs)
    report = ReportPage(
        "Evidence", f"{_number(len(runs), 'run')}: {_counted(outcomes)}; cells: {_counted(cells)}"
    )
    report.add(
        Paragraph(
            f"Runs by commit: {', '.join(f'{commit} ({n})' for commit, n in commits.most_common())}."
        )
    )
    rows = [
        (
            f"✗ {hazard.name}" if measured.beyond else hazard.name,
            hazard.node,
            _limit(measured, hazard.unit),
            _largest(measured, hazard.unit),
            _where(measured),
            f"{measured.beyond} of {measured.runs}",
            hazard.meaning,
        )
        for hazard, measured in _beyond_first(evidence)
    ]
    header = (
        "hazard",
        "node",
        "limit",
        "measured maximum",
        "where",
        "runs beyond",
        "measured quantity",
    )
    report.add(Heading("Hazards"), Table(header, tuple(rows), words=True))
    if evidence.checks:
        report.add(
            Heading("Checks of all runs together"), Bullets(tuple(map(_check, evidence.checks)))
        )
    report.add(Heading("Limits of this evidence"), Bullets(NO_CLAIM))
    acted = [run for run in runs if run["interventions"]]
    report.add(Heading("Interventions of operators"))
    log = [(str(run["run"]), str(run["interventions"])) for run in acted]
    report.add(Table(("run", "number"), tuple(log), words=True) if log else Paragraph("None."))
    report.add(Heading("Records"))
    listed = [(str(run["run"]), str(run["outcome"]), str(run["sha256"])) for run in runs]
    report.add(Table(("run", "outcome", "SHA-256 of its file"), tuple(listed), words=True))
    if evidence.left_out:
        report.add(
            Heading("Left out"),
            Table(("record", "why"), tuple(evidence.left_out.items()), words=True),
        )
    return report


def _counted(counter: Counter[str]) -> str:
    return ", ".join(f"{number} {name}" for name, number in counter.most_common())


def _limit(measured: Measured, unit: str) -> str:
    return "not known" if measured.limit is None else f"{measured.limit:.4g} {unit}".strip()


def _largest(measured: Measured, unit: str) -> str:
    return "not measured" if measured.value is None else f"{measured.value:.4g} {unit}".strip()


def _where(measured: Measured) -> str:
    if measured.value is None:
        return "–"
    return f"{measured.run}, {measured.t:.2f} s {measured.quantity}".strip()
