"""UpdateMap: fuse the newest look into the occupancy map, with the fruit to be picked left out."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from pomona.drivers.interfaces import Arm, Camera, Frame, Gripper, Workspace
from pomona.executive.ports import LENGTH, Length, Outputs, Port
from pomona.executive.skill import Skill, Work
from pomona.executive.values.arrays import Float64
from pomona.executive.views import Points3, SceneView
from pomona.skills.compiled_code import wait_for_first
from pomona.skills.motion.collision import Convex, RobotShape
from pomona.skills.motion.occupancy.integrate import (
    check_camera_pose,
    integrate,
    pose_of_camera,
    warm_up,
)
from pomona.skills.motion.occupancy.occupancy_map import (
    HIDDEN,
    OCCUPIED,
    CameraPoseMismatch,
    NothingMeasured,
    OccupancyMap,
)
from pomona.skills.motion.robot import BadJoints, RobotModel
from pomona.skills.perception.detection.detection import Detection
from pomona.skills.perception.frame_check import MISMATCHES
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.frame_trust import require_true_look
from pomona.skills.shared.looking import require_fresh

NEIGHBOUR = "neighbour"  # name of fruit measured beside the target, among the obstacles


OLDEST = 5.0  # a look that is older is refused [s]


class Mapped(Outputs):
    """Outputs of UpdateMap."""

    map: OccupancyMap


class UpdateMap(Skill):
    """Fuse a look into the occupancy map.

    The look is the measured fruit's, else the detection's, else the camera's newest. The measured fruit is kept out of
    the map: planning knows it by its refined shape. Fruit measured beside it and fixed obstacles of the cell file are
    obstacles by their shapes, without cells and shadows, so that gaps between them stay open.
    """

    devices = (Camera, Arm, Gripper, Workspace)
    moves = ()
    failures = (*MISMATCHES, "NO_FRAME", "NO_DEPTH", "STALE_FRAME")

    def prepare(self) -> None:
        wait_for_first()
        warm_up()

    def run(
        self,
        measured: Annotated[
            MeasuredFruit | None,
            Port(help="fruit to pick; its look is fused, its shape stays free"),
        ] = None,
        detection: Annotated[
            Detection | None, Port(help="detection whose look is fused if nothing was measured")
        ] = None,
        previous: Annotated[
            OccupancyMap | None, Port(help="earlier map to extend; without it the map starts empty")
        ] = None,
        resolution: Annotated[
            Length, Port(min="5 mm", max="50 mm", help="edge of a cell")
        ] = LENGTH("10 mm"),
    ) -> Work[Mapped]:
        arm = self.device(Arm)
        workspace = self.device(Workspace)
        model = RobotModel.load(arm.description)
        look = measured or detection
        frame = require_fresh(
            self, look.frame if look is not None else self.device(Camera).latest(), OLDEST
        )
        state = arm.state()
        try:
            T_base_camera = look.T_base_camera if look is not None else pose_of_camera(frame, model)
            check_camera_pose(frame, T_base_camera, model, state)
            if measured is None:  # Refine has compared the look already
                yield from require_true_look(self, frame, T_base_camera, workspace)
            q = state.q if frame.q is None else frame.q
            robot = RobotShape.of(model).spheres(q, self.device(Gripper).state().width)
            lower = workspace.lower
            upper = workspace.upper
            grid = OccupancyMap.empty(lower, upper, resolution) if previous is None else previous
            fused = yield from self.compute(
                _fuse, grid, frame, T_base_camera, workspace, robot, measured
            )
        except NothingMeasured as error:
            raise self.failure(
                "NO_DEPTH", str(error), valid=error.valid, inside=error.inside
            ) from error
        except (CameraPoseMismatch, BadJoints) as error:
            raise self.failure("POSE_MISMATCH", str(error)) from error
        self.publish("map", view_of(fused))
        return Mapped(fused)


def view_of(map: OccupancyMap) -> SceneView:
    """Return a view of the blocked cells."""
    occupied = map.centres(OCCUPIED)
    hidden = map.centres(HIDDEN)
    return SceneView(
        points=(
            Points3(occupied, "occupied", "occupied", map.resolution),
            Points3(hidden, "hidden behind obstacles", "muted", map.resolution),
        ),
        caption=f"{len(occupied)} occupied and {len(hidden)} hidden cells of {1e3 * map.resolution:.0f} mm, "
        f"{len(map.stamps)} look{'s' if len(map.stamps) != 1 else ''}",
    )


def _fuse(
    grid: OccupancyMap,
    frame: Frame,
    T_base_camera: Float64,
    workspace: Workspace,
    robot: Float64,
    measured: MeasuredFruit | None,
) -> OccupancyMap:
    """Integrate, and compute the distance field where it does not keep the tick waiting."""
    target = None if measured is None else Convex.of_fruit(measured)
    if measured is not None:
        grid = replace(
            grid, shapes=tuple(Convex.of_fruit(other, NEIGHBOUR) for other in measured.beside)
        )
    fused = integrate(grid, frame, T_base_camera, workspace, robot=robot, target=target)
    _ = fused.field
    return fused
