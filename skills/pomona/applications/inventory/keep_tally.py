"""The skill KeepTally."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.inventory.tally import DONE, TalliedFruit, Tally
from pomona.executive import Outputs, Port, Skill, TableView
from pomona.skills.grip import Hold
from pomona.skills.perception import Detection, MeasuredFruit

COLUMNS = ("fruit", "seen at", "size", "felt", "tries", "outcome", "why")


class Kept(Outputs):
    """Outputs of KeepTally."""

    tally: Annotated[Tally, Port(help="outcomes of all fruit so far")]


class KeepTally(Skill):
    """Note the outcome for a fruit, in one table for the whole run."""

    def run(
        self,
        detection: Annotated[Detection, Port(help="detected fruit")],
        measured: Annotated[
            MeasuredFruit | None, Port(help="measurement of the same fruit; one of another look is ignored")
        ] = None,
        outcome: Annotated[str, Port(help=f"{DONE}, or another outcome")] = DONE,
        why: Annotated[str, Port(help="the reason, for the operator")] = "",
        hold: Annotated[Hold | None, Port(help="grip of this fruit: the width that the pads felt is noted")] = None,
        so_far: Annotated[Tally | None, Port(help="the tally so far")] = None,
    ) -> Kept:
        if measured is None or measured.frame is not detection.frame:
            p_base, size = (detection.T_base_camera @ detection.T_camera_object)[:3, 3], None
        else:
            p_base, size = measured.T_base_fruit[:3, 3], measured.dimensions
        touches = () if hold is None or outcome != DONE else hold.first_touches
        widths = [touch.width for touch in touches if touch is not None]
        felt = min(widths) if len(widths) == len(touches) > 0 else None
        tally = (so_far or Tally()).with_entry(TalliedFruit(p_base, size, outcome, why, felt=felt), detection.found)
        rows = tuple(
            (str(number + 1), entry.place, entry.dimensions, entry.width, str(entry.tries), entry.outcome, entry.why)
            for number, entry in enumerate(tally.entries)
        )
        self.publish("tally", TableView(COLUMNS, rows, tally.sentence))
        return Kept(tally)
