"""The skill FindCrate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Annotated, Any

import numpy as np

from pomona.applications.crates.crate_place import (
    SeenCrate,
    crate_named,
    crates,
    find_crate,
    rim_points,
    share_in_view,
)
from pomona.drivers import Camera, Workspace
from pomona.executive import (
    ANGLE,
    LENGTH,
    Angle,
    CellFacts,
    Length,
    Port,
    Problem,
    Work,
    choose,
)
from pomona.skills import LookingSkill
from pomona.skills.perception import AllDetections

IN_VIEW = 0.5
"""Share of a crate's upper edge that must be in the picture before a look is judged [1]."""
SOURCE = "source"
"""Name of the crate that is compared where none is named, and the cell has it."""


class FindCrate(LookingSkill):
    """Compare the place of a crate in the depth image with the cell file, by the upper edges of its walls.

    A crate elsewhere ends the run before the hand goes near it. Without a name, a cell without `source` passes.
    """

    devices = (Camera, Workspace)
    failures = ("NO_FRAME", "STALE_FRAME", "CRATE_UNSEEN", "CRATE_MISSING", "CRATE_MOVED")

    @classmethod
    def judge(cls, known: Mapping[str, Any], cell: CellFacts | None) -> Iterator[Problem]:
        """Check that the cell has the crate that is named."""
        workspace = None if cell is None else cell.known(Workspace)
        name = known.get("name")
        if (
            cell is None
            or workspace is None
            or crate_named(name or SOURCE, workspace.obstacles) is not None
        ):
            return
        there = sorted({box.name for box in workspace.obstacles})
        if name is not None or SOURCE in there:
            message = (
                f"the cell '{cell.name}' has no crate '{name or SOURCE}', an obstacle with `wall`"
            )
            hint = f"write `wall` for it: {name or SOURCE}" if (name or SOURCE) in there else ""
            yield Problem(
                "name", message, hint or choose(name or SOURCE, crates(workspace.obstacles))
            )
        elif meant := get_close_matches(SOURCE, there, 1):
            message = (
                f"the cell '{cell.name}' has no crate '{SOURCE}', so the place of none is compared"
            )
            yield Problem("name", message, f"did you mean '{meant[0]}'?", warning=True)

    @classmethod
    def offers(cls, port: str, cell: CellFacts | None) -> tuple[str, ...]:
        """Return the cell's crates."""
        workspace = None if cell is None or port != "name" else cell.known(Workspace)
        return () if workspace is None else crates(workspace.obstacles)

    def run(
        self,
        detections: Annotated[
            AllDetections | None,
            Port(help="a look at the crate; without it the camera's newest frame"),
        ] = None,
        name: Annotated[
            str | None,
            Port(
                help=f"of the crate, an obstacle with `wall`; without it '{SOURCE}', if there is one"
            ),
        ] = None,
        most: Annotated[Length, Port(min="1 mm", max="20 mm", help="shift that is none")] = LENGTH(
            "5 mm"
        ),
        turn: Annotated[Angle, Port(min="0.2 deg", max="5 deg", help="turn that is none")] = ANGLE(
            "1.5 deg"
        ),
    ) -> Work[None]:
        obstacles = self.device(Workspace).obstacles
        crate = crate_named(name or SOURCE, obstacles)
        if crate is None and name is None:
            return
        if crate is None:
            known = ", ".join(crates(obstacles)) or "none"
            raise self.failure(
                "CRATE_MISSING",
                f"the cell file has no crate '{name}', an obstacle with `wall`: {known}",
            )
        words = f"the crate '{name or SOURCE}' ({' × '.join(f'{2e3 * half:.0f}' for half in crate.half)} mm)"
        frame = self.newest_frame() if detections is None else detections.frame
        T_base_camera = self.camera_pose(frame) if detections is None else detections.T_base_camera
        if frame.depth is None:
            raise self.failure(
                "CRATE_UNSEEN", f"the picture has no depth, so the place of {words} is not known"
            )
        share = share_in_view(frame.intrinsics, T_base_camera, crate)
        if share < IN_VIEW:
            z = f"{1e3 * crate.T_base_crate[2, 3]:.0f} mm"
            words = f"{words} is not in view: {100.0 * share:.0f} % of its upper edge at the height {z} is in the picture"
            raise self.failure(
                "CRATE_UNSEEN", f"{words}, {100.0 * IN_VIEW:.0f} % are needed", share=share
            )
        depth = frame.depth.astype(np.float64)

        def look() -> SeenCrate | None:
            return find_crate(rim_points(depth, frame.intrinsics, T_base_camera, crate), crate)

        found = yield from self.compute(look)
        if found is None:
            raise self.failure(
                "CRATE_MISSING",
                f"no walls of {words} are at their height near its place in the cell file",
            )
        if found.farthest > most or abs(found.turn) > turn:
            words = f"{found.sentence}: put it back, or change the cell file"
            raise self.failure(
                "CRATE_MOVED", words, shift_m=found.shift.tolist(), turn_rad=found.turn
            )
        yield found.sentence
        return
