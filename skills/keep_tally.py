"""The skill KeepTally."""

from __future__ import annotations

from collections.abc import Mapping

from executive.ports import Port, Ports, optional
from executive.skill import Skill
from executive.views import TableView
from skills.perception.detection.detection import Detection
from skills.perception.measured_fruit import MeasuredFruit
from skills.shared.tally import DONE, Entry, Tally

COLUMNS = ("fruit", "seen at", "size", "tries", "outcome", "why")


class KeepTally(Skill):
    """Note what became of a fruit, in one table for the whole run."""

    inputs = Ports(
        detection=Port(Detection, help="the fruit as it was found"),
        measured=optional(MeasuredFruit, "the same fruit measured; another look's measurement is not used"),
        outcome=Port(str, default=DONE, help=f"{DONE}, or what else became of it"),
        why=Port(str, default="", help="the reason, for people"),
        so_far=optional(Tally, "the account to go on with"),
    )
    outputs = Ports(tally=Tally)

    def run(  # type: ignore[override]
        self, detection: Detection, measured: MeasuredFruit | None, outcome: str, why: str, so_far: Tally | None
    ) -> Mapping[str, object]:
        if measured is None or measured.frame is not detection.frame:
            p_base, size = (detection.T_base_camera @ detection.T_camera_object)[:3, 3], None
        else:
            p_base, size = measured.T_base_fruit[:3, 3], measured.dimensions
        tally = (so_far or Tally()).with_entry(Entry(p_base, size, outcome, why))
        rows = tuple(
            (str(number + 1), entry.place, entry.dimensions, str(entry.tries), entry.outcome, entry.why)
            for number, entry in enumerate(tally.entries)
        )
        self.publish("tally", TableView(COLUMNS, rows, tally.sentence))
        return {"tally": tally}
