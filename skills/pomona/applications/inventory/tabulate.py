"""The Tabulate skill."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.inventory.sighting import FrameSightings, sighting_of
from pomona.executive import Outputs, Port, Skill
from pomona.skills.perception import Detection, MeasuredFruit


class Tabulated(Outputs):
    """Outputs of Tabulate."""

    finds: FrameSightings


class Tabulate(Skill):
    """Note one fruit of a frame, as it was measured or why it was not; CountFruit makes the table of them."""

    def run(
        self,
        detection: Annotated[Detection, Port(help="detected fruit")],
        measured: Annotated[MeasuredFruit | None, Port(help="measurement of the fruit")] = None,
        why: Annotated[str, Port(help="why it was not measured; then `measured` is ignored")] = "",
        so_far: Annotated[
            FrameSightings | None,
            Port(help="earlier rows of this frame; rows of another frame are ignored"),
        ] = None,
    ) -> Tabulated:
        before = so_far.sightings if so_far is not None and so_far.frame is detection.frame else ()
        new = sighting_of(detection, measured, why, len(before) + 1)
        return Tabulated(FrameSightings(detection.frame, (*before, new)))
