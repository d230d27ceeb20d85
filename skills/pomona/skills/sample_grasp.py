"""The skill SampleGrasp."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from pomona.drivers.interfaces import Arm, Workspace
from pomona.executive.ports import ANGLE, LENGTH, Angle, Length, Outputs, Port, Ratio
from pomona.executive.skill import Skill, Work
from pomona.executive.views import Points3, SceneView
from pomona.skills.compiled_code import wait_for_first
from pomona.skills.motion.grasp import Grasp, GraspCandidates, RuledOut, Tried, direction
from pomona.skills.motion.grasps.sample import GraspRules, sample_pre_grasps, support_below, warm_up
from pomona.skills.motion.grasps.sphere import Sphere, pre_grasp_position
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.shared.grasp_view import fruit_mesh, summary
from pomona.skills.shared.planning import OtherObstacles, Spacing, space_around

FINER = 2  # how often the sphere is sampled at half the spacing when nothing is left to try


class Sampled(Outputs):
    """Outputs of SampleGrasp."""

    candidates: Annotated[
        GraspCandidates, Port(help="reachable grasps, best first; rejected ones with a reason")
    ]


class SampleGrasp(Skill):
    """Sample pre-grasps on a sphere around a fruit: all that are left to try, best first, the others with a reason.

    Every start is one attempt at the fruit. A candidate counts as tried when it comes back through `tried`, or when it
    was the only one that was given (`check: false`). A fruit at another place starts afresh. When nothing is left to
    try, the sphere is sampled more finely.
    """

    devices = (Arm, Workspace)
    moves = ()
    failures = ("NO_CANDIDATE", "ALL_TRIED", "MAP_STALE")

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self._tried = Tried()

    def prepare(self) -> None:
        wait_for_first()
        warm_up(RobotModel.load(self.device(Arm).description))

    def run(
        self,
        around: Annotated[MeasuredFruit, Port(help="the refined fruit")],
        map: OtherObstacles = None,
        tried: Annotated[Grasp | None, Port(help="the candidate of the previous attempt")] = None,
        radius: Annotated[Length, Port(min="20 mm", max="1 m", help="the paper's r_o")] = LENGTH(
            "120 mm"
        ),
        theta_max: Annotated[Angle, Port(min="0 deg", max="90 deg", help="largest tilt")] = ANGLE(
            "45 deg"
        ),
        thetas: Annotated[int, Port(min=1, help="number of tilts")] = 4,
        alphas: Annotated[int, Port(min=1, help="number of azimuths")] = 12,
        clearance: Spacing = LENGTH("10 mm"),
        sigmas: Annotated[
            Ratio,
            Port(min=0.0, max=10.0, help="clearance in standard deviations of the measurement"),
        ] = 2.0,
        air: Annotated[
            Length,
            Port(min="2 mm", max="30 mm", help="between each pad and the fruit on the approach"),
        ] = LENGTH("6 mm"),
        check: Annotated[
            bool,
            Port(help="exclude grasps without a free approach; no, as in the paper: one at a time"),
        ] = True,
    ) -> Work[Sampled]:
        arm = self.device(Arm)
        workspace = self.device(Workspace)
        self._tried.begin(around)
        if tried is not None:
            self._tried.add(tried)
        robot = RobotModel.load(arm.description)
        space = space_around(self, map, clearance, robot.width_max, around)
        sphere = Sphere(radius, (0.0, theta_max), tilts=thetas, turns=alphas)
        rules = GraspRules(side=(air, GraspRules().side[1]), sigmas=sigmas, check=check)
        support = support_below(workspace, around.T_base_fruit[:3, 3])
        tried_before = self._tried.directions
        for level in range(1 + FINER):
            grasps, ruled_out = yield from self.compute(
                sample_pre_grasps, around, robot, space, arm.state().q, support, sphere, rules
            )
            left = tuple(grasp for grasp in grasps if direction(grasp) not in tried_before)
            if left or level == FINER:
                break
            sphere = sphere.finer()
        self._show(around, radius, left, grasps, ruled_out)
        if not grasps:
            raise self.failure(
                "NO_CANDIDATE",
                f"all {len(ruled_out)} pre-grasps are ruled out: {summary(ruled_out)}",
                ruled_out=[f"{out.index}: {out.code}: {out.reason}" for out in ruled_out],
            )
        if not left:
            raise self.failure(
                "ALL_TRIED",
                f"all {len(grasps)} candidates have been tried",
                attempts=self._tried.attempt - 1,
            )
        if not check:
            left = left[:1]
            self._tried.add(left[0])
        return Sampled(GraspCandidates(left, ruled_out, self._tried.attempt))

    def _show(
        self,
        fruit: MeasuredFruit,
        radius: float,
        left: Sequence[Grasp],
        grasps: Sequence[Grasp],
        ruled_out: Sequence[RuledOut],
    ) -> None:
        """Show the sphere: remaining, tried and excluded grasps."""
        p_fruit = fruit.T_base_fruit[:3, 3]
        tried = [grasp for grasp in grasps if direction(grasp) in self._tried.directions]
        groups = (
            ("left to try", "free", [grasp.T_base_pre_grasp[:3, 3] for grasp in left]),
            ("tried", "tried", [grasp.T_base_pre_grasp[:3, 3] for grasp in tried]),
            (
                "ruled out",
                "ruled_out",
                [pre_grasp_position(p_fruit, radius, o.theta, o.alpha) for o in ruled_out],
            ),
        )
        points = tuple(Points3(np.array(p), label, style) for label, style, p in groups if p)
        caption = f"{len(left)} of {len(grasps) + len(ruled_out)} pre-grasps left"
        self.publish(
            "candidates", SceneView(points=points, meshes=(fruit_mesh(fruit),), caption=caption)
        )
