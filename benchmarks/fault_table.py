"""The rows of the fault matrix: fault, phase, required end, and verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from pomona.executive.values.units import TIME

TABLE = Path(__file__).with_name("fault_matrix.yaml")
OWN_PHASES = {"conveyor": "belt", "sim_crate": "crate"}
"""Cells with a tree of their own, and the table of its phases."""
ENDS = ("safe", "failure", "success", "harmless", "recovered", "refused")


@dataclass(frozen=True, slots=True)
class FaultPhase:
    """Start of a fault in the run of a tree: a delay after a node's start, and the operator's actions before it."""

    name: str
    node: str
    after: float
    operator: str = ""
    tree: str = "fault_pick.yaml"


@dataclass(frozen=True, slots=True)
class Case:
    """One fault in one phase, and how the run must end.

    Attributes:
        switch, kind: as the cell names them.
        ends: one of `ENDS`.
        within: seconds of the run's clock from when the fault can show.
        shows: a device that must move, or a node that must have begun, before the fault can show; empty when it shows
            at once.
        lasts: seconds until the fault goes by itself; infinite for good.
        spoils: the fruit may fall, or be pressed: no program can stop what this fault does.
        says: a word that the reason must contain.
        notices: seconds from there within which a skill gives up what it does, or the safe state begins; its failure
            may come later, once the hand has risen. None: whenever.
    """

    switch: str
    kind: str
    phase: FaultPhase
    ends: str
    within: float
    shows: str = ""
    lasts: float = np.inf
    spoils: bool = False
    says: str = ""
    notices: float | None = None

    @property
    def device(self) -> str:
        return self.switch.split(".")[0].removeprefix("modbus-")

    @property
    def name(self) -> str:
        lasting = f" {1e3 * self.lasts:.0f} ms" if np.isfinite(self.lasts) else ""
        return f"{self.switch}.{self.kind}{lasting}"


@dataclass(slots=True)
class CaseVerdict:
    """The verdict on a case; `wrong` is empty when every check passed.

    Attributes:
        noticed: from when the fault can show to the safe state, or to the failure of a skill [s]; NaN without either.
        gave_up: the same to a skill that gives up what it does, where the row says when it must [s].
        rested: from the safe state to an arm that stands [s].
        peak: the largest force of both pads together [N].
        contact: the largest force between the robot and the table, a fruit or a fixed thing [N], and its name.
        true: whether the fruit was where the nodes reported it; None without a report.
    """

    case: Case
    outcome: str = ""
    reason: str = ""
    noticed: float = np.nan
    gave_up: float = np.nan
    rested: float = np.nan
    peak: float = 0.0
    contact: tuple[float, str] = (0.0, "")
    true: bool | None = None
    wrong: list[str] = field(default_factory=list)


def read_table(cell: str, path: Path = TABLE) -> list[Case]:
    """The cases of a cell.

    Raises:
        ValueError: a row names no phase, or no way to end.
    """
    table = yaml.safe_load(path.read_text())
    own = table[OWN_PHASES.get(cell, "phases")]
    phases = {
        name: FaultPhase(
            name,
            said["node"],
            TIME(said["after"]),
            **{key: said[key] for key in ("operator", "tree") if key in said},
        )
        for name, said in {**own, **({} if cell in OWN_PHASES else table["moments"])}.items()
    }
    cases = []
    for row in table[cell]:
        switch, kind = row["fault"].rsplit(".", 1)
        names = list(own) if row["phases"] == "all" else row["phases"]
        if unknown := [name for name in names if name not in phases]:
            raise ValueError(f"{row['fault']}: there is no phase {', '.join(unknown)}")
        if row["ends"] not in ENDS:
            raise ValueError(f"{row['fault']}: a run ends {', '.join(ENDS)}, not {row['ends']}")
        within = TIME(row["within"]) if "within" in row else np.inf
        lasts = TIME(row["lasts"]) if "lasts" in row else np.inf
        notices = TIME(row["notices"]) if "notices" in row else None
        said = (
            row["ends"],
            within,
            row.get("shows", ""),
            lasts,
            row.get("spoils", False),
            row.get("says", ""),
            notices,
        )
        cases += [Case(switch, kind, phases[name], *said) for name in names]
    return cases


def report(verdicts: Sequence[CaseVerdict]) -> str:
    """Case by case, then each row of the table with its deadline, the median and the worst, then the sums."""
    lines = [
        f"{'fault':26}{'phase':13}{'ended':9}{'noticed':>9}{'gave up':>9}{'rest':>9}{'peak N':>8}{'contact N':>11}  "
    ]
    for v in verdicts:
        said = "WRONG " + "; ".join(v.wrong) + " – " if v.wrong else ""
        lines.append(
            f"{v.case.name:26}{v.case.phase.name:13}{v.outcome:9}{_ms(v.noticed):>9}{_ms(v.gave_up):>9}{_ms(v.rested):>9}"
            f"{v.peak:8.1f}{v.contact[0]:11.1f}  {said}{v.reason}"[:240]
        )
    rows: dict[tuple[str, str, float], list[CaseVerdict]] = {}
    for v in verdicts:
        rows.setdefault((v.case.name, v.case.ends, v.case.within), []).append(v)
    lines += ["", f"{'fault':26}{'ends':9}{'cases':>6}{'deadline':>10}{'median':>9}{'worst':>9}"]
    for (name, ends, within), row in rows.items():
        noticed = [v.noticed for v in row if np.isfinite(v.noticed) and ends != "success"] or [
            np.nan
        ]
        median, worst = float(np.median(noticed)), max(noticed)
        lines.append(
            f"{name:26}{ends:9}{len(row):6d}{_ms(within):>10}{_ms(median):>9}{_ms(worst):>9}"
        )
    rests = [v.rested for v in verdicts if np.isfinite(v.rested)] or [np.nan]
    median, worst = float(np.median(rests)), max(rests)
    lines += ["", f"arm at rest {_ms(median)} (median), {_ms(worst)} (worst) after the safe stop"]
    bad = sum(bool(v.wrong) for v in verdicts)
    lines.append(
        f"{len(verdicts)} cases: {len(verdicts) - bad} as they must be, {bad} wrong, "
        f"{sum(v.true is False for v in verdicts)} false successes, "
        f"pads at most {max((v.peak for v in verdicts if not v.case.spoils), default=0.0):.1f} N, "
        f"contact at most {max((v.contact[0] for v in verdicts if not v.case.spoils), default=0.0):.1f} N"
    )
    return "\n".join(lines)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms" if np.isfinite(seconds) else "–"
