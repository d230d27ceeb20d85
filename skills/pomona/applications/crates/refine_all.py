"""The skill RefineAll."""

from __future__ import annotations

from typing import Annotated

from pomona.applications.crates.fruit_scene import FruitScene, measure_all
from pomona.drivers import Workspace
from pomona.executive import Outputs, Port, Skill, Work
from pomona.skills import require_true_look
from pomona.skills.perception import MISMATCHES, AllDetections


class AllRefined(Outputs):
    """Outputs of RefineAll."""

    scene: Annotated[
        FruitScene, Port(help="every fruit of the look, measured where that was possible")
    ]


class RefineAll(Skill):
    """Measure position and size of every detected fruit of one look.

    The table in the depth image is compared with the cell file's first, and depth with colour.
    """

    devices = (Workspace,)
    moves = ()
    failures = (*MISMATCHES, "NOTHING_MEASURED")

    def run(
        self, detections: Annotated[AllDetections, Port(help="every fruit that one look detected")]
    ) -> Work[AllRefined]:
        workspace = self.device(Workspace)
        yield from require_true_look(self, detections.frame, detections.T_base_camera, workspace)
        scene = yield from self.compute(
            measure_all, detections.detections, workspace.table_z, workspace.obstacles
        )
        if not scene.measured:
            raise self.failure("NOTHING_MEASURED", scene.sentence, found=len(scene.fruit))
        yield scene.sentence
        return AllRefined(scene)
