"""The skill KeepTally."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.inventory.tally import DONE, TalliedFruit, Tally
from pomona.executive import Float64, Outputs, Port, Skill, TableView
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
        detection: Annotated[Detection | None, Port(help="detected fruit")] = None,
        measured: Annotated[
            MeasuredFruit | None,
            Port(help="measurement of the same fruit; one of another look is ignored"),
        ] = None,
        outcome: Annotated[str, Port(help=f"{DONE}, or another outcome")] = DONE,
        why: Annotated[str, Port(help="the reason, for the operator")] = "",
        hold: Annotated[
            Hold | None, Port(help="grip of this fruit: the width that the pads felt is noted")
        ] = None,
        number: Annotated[
            int | None,
            Port(
                help="of the fruit, where fruit moves; without it, one at the place of one left is the same"
            ),
        ] = None,
        so_far: Annotated[Tally | None, Port(help="the tally so far")] = None,
    ) -> Kept:
        p_base: Float64 | None = None
        size: Float64 | None = None
        if measured is not None and (detection is None or measured.frame is detection.frame):
            p_base = measured.T_base_fruit[:3, 3]
            size = measured.dimensions
        elif detection is not None:
            p_base = (detection.T_base_camera @ detection.T_camera_object)[:3, 3]
        touches = () if hold is None or outcome != DONE else hold.first_touches
        widths = [touch.width for touch in touches if touch is not None]
        felt = min(widths) if len(widths) == len(touches) > 0 else None
        entry = TalliedFruit(p_base, size, outcome, why, number=number, felt=felt)
        tally = (so_far or Tally()).with_entry(entry, 0 if detection is None else detection.found)
        before = () if so_far is None else so_far.entries
        for k, kept in enumerate(tally.entries):
            if k >= len(before) or kept is not before[k]:
                why = "" if kept.outcome == DONE else f"{kept.outcome} at {kept.place}: {kept.why}"
                self.account(f"fruit {k + 1}", why)
        rows = tuple(
            (
                str(number + 1),
                entry.place,
                entry.dimensions,
                entry.width,
                str(entry.tries),
                entry.outcome,
                entry.why,
            )
            for number, entry in enumerate(tally.entries)
        )
        self.publish("tally", TableView(COLUMNS, rows, tally.sentence))
        return Kept(tally)
