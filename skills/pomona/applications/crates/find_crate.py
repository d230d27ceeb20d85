"""The skill FindCrate."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from pomona.applications.crates.crate_place import SeenCrate, crate_named, find_crate, rim_points, share_in_view
from pomona.drivers import Workspace
from pomona.executive import ANGLE, LENGTH, Angle, Length, Port, Skill, Work
from pomona.skills.perception import AllDetections

IN_VIEW = 0.5
"""Share of a crate's upper edge that must be in the picture before a look is judged [1]."""


class FindCrate(Skill):
    """Compare the place of a crate in the depth image with the cell file, by the upper edges of its walls.

    A crate elsewhere ends the run before the hand goes near it. A cell without this crate, or a look past it, passes.
    """

    devices = (Workspace,)
    moves = ()
    failures = ("CRATE_MISSING", "CRATE_MOVED")

    def run(
        self,
        detections: Annotated[AllDetections, Port(help="a look at the crate")],
        name: Annotated[str, Port(help="of the crate among the cell file's obstacles")] = "source",
        most: Annotated[Length, Port(min="1 mm", max="20 mm", help="shift that is none")] = LENGTH("5 mm"),
        turn: Annotated[Angle, Port(min="0.2 deg", max="5 deg", help="turn that is none")] = ANGLE("1.5 deg"),
    ) -> Work[None]:
        crate, frame = crate_named(name, self.device(Workspace).obstacles), detections.frame
        if crate is None or frame.depth is None:
            return
        depth = frame.depth.astype(np.float64)
        if share_in_view(frame.intrinsics, detections.T_base_camera, crate) < IN_VIEW:
            yield "the crate is not in view"
            return

        def look() -> SeenCrate | None:
            return find_crate(rim_points(depth, frame.intrinsics, detections.T_base_camera, crate), crate)

        found = yield from self.compute(look)
        if found is None:
            size = " × ".join(f"{2e3 * half:.0f}" for half in crate.half)
            words = f"no walls of the crate '{name}' ({size} mm) are at their height near its place in the cell file"
            raise self.failure("CRATE_MISSING", words)
        if found.farthest > most or abs(found.turn) > turn:
            words = f"{found.sentence}: put it back, or change the cell file"
            raise self.failure("CRATE_MOVED", words, shift_m=found.shift.tolist(), turn_rad=found.turn)
        yield found.sentence
        return
