"""An apple at a wall of a crate, and a ball that rolls where a finger draws it."""

from dataclasses import replace
from functools import cache

import numpy as np

from pomona.applications.crates.hooks import Beside, hook_candidates
from pomona.drivers.interfaces import Box, Workspace
from pomona.skills.geometry import transform
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.perception.measured_fruit import MeasuredFruit
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL, WORKSPACE, PickingScene, apple_at

WALL = Box("source", transform(None, [-0.03, -0.571, -0.06]), (0.3, 0.004, 0.06))
"""Its inner face is 47 mm behind the apple's middle, 2 mm behind the apple."""
AT_WALL = replace(WORKSPACE, obstacles=(*WORKSPACE.obstacles, WALL))


def apple(*beside: tuple[float, float]) -> MeasuredFruit:
    """An apple of 89 mm at the wall, with others at places relative to it [m]."""
    made, others = apple_at(1, 3), []
    for x, y in beside:
        T_base_fruit = made.T_base_fruit.copy()
        T_base_fruit[:2, 3] += [x, y]
        others.append(replace(made, T_base_fruit=T_base_fruit))
    return replace(made, beside=tuple(others))


def hooks_at(fruit: MeasuredFruit, workspace: Workspace = AT_WALL):
    """Hooks of a fruit for the shipped robot."""
    scene = PickingScene(workspace=workspace)
    space = arm_space(scene.arm, workspace, None, ROBOT_MODEL.width_max, 4e-3)
    return hook_candidates(Beside.of(fruit, workspace), space, OBSERVE, 0.045)


@cache
def a_hook() -> Grasp:
    return hooks_at(apple()).grasps[0]


TIPS = float(-gripper_shape(ROBOT_MODEL).points[:, 2].max())
"""Height of the fingers' tips over the TCP when the hand points down [m]; negative."""


FRICTION = 0.8


class RollingBall:
    """A ball on the table that rolls without sliding; a finger sticks to its skin, which gives by 7 N/mm.

    The part of the finger's motion that no rolling follows deforms the skin. The contact ends where it would pull.
    """

    def __init__(self, scene: PickingScene, radius: float, blocked_at: float = 1.0) -> None:
        self._scene, self._radius, self._blocked_at = scene, radius, blocked_at
        middle = a_hook().fruit.T_base_fruit[:3, 3]
        self._begin = self._at = float(middle[1])
        self._height = -0.12 + radius
        self._deformed: np.ndarray | None = None  # (along the pull, up) [m]
        self._last = np.zeros(2)
        self.most = 0.0  # largest force [N]
        scene.fingers.feel = self._feel

    @property
    def rolled(self) -> float:
        """Way of the ball's middle [m]."""
        return self._at - self._begin

    def _feel(self, _now: float) -> np.ndarray:
        tcp = self._scene.tcp[:3, 3]
        tip = np.array(
            [tcp[1] - a_hook().width / 2.0, tcp[2] + TIPS]
        )  # of the finger behind, pulled along +y
        from_middle = tip - [self._at, self._height]
        moved, self._last = tip - self._last, tip
        distance = float(np.linalg.norm(from_middle))
        inward = -from_middle / distance
        if self._deformed is None:
            if distance >= self._radius:
                return np.full((2, 6), 0.02)
            self._deformed = (self._radius - distance) * inward
        else:
            self._deformed = self._deformed + moved - self._roll(from_middle, moved)
        pressed = float(self._deformed @ inward)
        aside = self._deformed - pressed * inward
        self._deformed -= (
            max(1.0 - FRICTION * pressed / max(float(np.linalg.norm(aside)), 1e-9), 0.0) * aside
        )
        if pressed <= 0.0:
            self._deformed = None
            return np.full((2, 6), 0.02)
        wrenches = np.full((2, 6), 0.02)
        wrenches[0, [2, 0]] += 7e3 * self._deformed
        self.most = max(self.most, 7e3 * float(np.linalg.norm(self._deformed)))
        return wrenches

    def _roll(self, from_middle: np.ndarray, moved: np.ndarray) -> np.ndarray:
        """Motion of the touched point (along, up) [m] by the turn that follows the finger best."""
        per_turn = np.array([self._radius + from_middle[1], -from_middle[0]])
        turn = float(moved @ per_turn / (per_turn @ per_turn))
        turn = min(turn, (self._blocked_at - self.rolled) / self._radius)
        self._at += self._radius * turn
        return turn * per_turn
