"""A table with an apple, the shipped robot and mock devices, for the tests of moving skills."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from pomona.drivers.hold_watch import HandMemory, HandRecord, HoldWatch
from pomona.drivers.interfaces import (
    Arm,
    Box,
    ForceSensor,
    Frame,
    Gripper,
    Hand,
    Intrinsics,
    Pads,
    Workspace,
)
from pomona.skills.geometry import rot_z, transform
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.grasps.sample import sample_pre_grasps
from pomona.skills.motion.grasps.sphere import Sphere
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.arm_space import ArmSpace
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.tools.mock import MockArm, MockClock, MockForceSensor, MockGripper
from pomona.tools.mock.arm import ROBOT
from tests.skills.finger_pads import finger_pads

TABLE_Z = -0.12
OBSERVE = np.array([-1.36, -0.316, -0.264, -0.234, 0.065, -1.294, 0.048])
HOME = np.array([-1.36, -0.6, -0.264, 0.3, 0.065, -1.0, 0.048])
WORKSPACE = Workspace(
    table_z=TABLE_Z,
    lower=np.array([-0.6, -0.8, -0.14]),
    upper=np.array([0.6, 0.2, 0.7]),
    obstacles=(Box("pedestal", transform(None, [0.0, 0.0, -0.06]), (0.08, 0.08, 0.06)),),
    poses={"observe": OBSERVE, "observe_2": OBSERVE + 0.05, "home": HOME},
)
APPLES = {1: (89, 81, 89), 2: (91, 85, 91), 3: (93, 73, 93), 4: (73, 64, 73), 5: (62, 47, 62)}
"""The paper's apples: width, height, depth [mm]."""
PLACES = {
    1: (-0.12, -0.35),
    2: (0.08, -0.34),
    3: (-0.03, -0.52),
    4: (0.15, -0.48),
    5: (-0.20, -0.48),
}
"""The paper's places on the table [m]."""
ROBOT_MODEL = RobotModel.load(ROBOT)
_UPRIGHT = np.array(
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
)  # the fruit's y points down


@cache
def _apple() -> FruitModel:
    return load_fruit("apple")


def apple_at(number: int, place: int, yaw: float = 0.0, sigma: float = 1e-3) -> MeasuredFruit:
    """One of the paper's apples, standing at one of its places, measured with a standard deviation [m]."""
    dimensions = np.array(APPLES[number]) * 1e-3
    centre = [*PLACES[place], TABLE_Z + dimensions[1] / 2.0]
    frame = Frame(
        0.0,
        0,
        np.zeros((2, 2, 3), np.uint8),
        None,
        Intrinsics(1.0, 1.0, 0.5, 0.5, 2, 2),
        OBSERVE,
        np.eye(4),
    )
    return MeasuredFruit(
        fruit=_apple(),
        T_base_fruit=transform(rot_z(yaw) @ _UPRIGHT, centre),
        T_base_camera=np.eye(4),
        dimensions=dimensions,
        mu=1.0,
        sigma=0.0,
        covariance=np.eye(6) * sigma**2,
        inlier_ratio=1.0,
        residual=0.0,
        contour=np.empty((0, 2)),
        frame=frame,
        method="test",
    )


@cache
def a_grasp(number: int = 1, place: int = 3, theta: float = 0.0) -> Grasp:
    """A grasp that can be approached on an empty table."""
    from pomona.skills.motion.collision import CollisionWorld

    space = ArmSpace(CollisionWorld.build(ROBOT_MODEL, WORKSPACE), 0.1)
    sphere = Sphere(theta=(theta, theta), tilts=1, turns=8)
    grasps, _ = sample_pre_grasps(
        apple_at(number, place), ROBOT_MODEL, space, OBSERVE, TABLE_Z, sphere
    )
    return grasps[0]


@cache
def q_at_grasp() -> np.ndarray:
    """Where the arm stands when it grasps, (dof,) [rad]."""
    q: np.ndarray = straight_line(ROBOT_MODEL, a_grasp().q_pre_grasp[0], a_grasp().T_base_grasp).q[
        -1
    ]
    return q


@dataclass
class PickingScene:
    """Mock devices on one clock."""

    q: np.ndarray = field(default_factory=OBSERVE.copy)
    width: float = 0.10
    workspace: Workspace = WORKSPACE
    clock: MockClock = field(default_factory=MockClock)

    def __post_init__(self) -> None:
        self.arm = MockArm(self.clock, self.q)
        self.gripper = MockGripper(self.clock, self.width)
        self.fingers = MockForceSensor(self.clock)
        self.pads = finger_pads()

    @property
    def devices(self) -> dict[type, object]:
        return {
            Arm: self.arm,
            Gripper: self.gripper,
            ForceSensor: self.fingers,
            Pads: self.pads,
            Workspace: self.workspace,
        }

    @property
    def tcp(self) -> np.ndarray:
        return ROBOT_MODEL.tcp(self.arm.q)

    @property
    def without_sensor(self) -> dict[type, object]:
        """The devices of a cell without force sensor, in which the state of the hand is followed."""
        hand = HoldWatch(None, None, self.gripper, HandMemory(None, HandRecord()))
        return {
            **{kind: device for kind, device in self.devices.items() if kind is not ForceSensor},
            Hand: hand,
        }

    def grip_plainly(self, motor_force: float | None = 5.0) -> None:
        """Let the fingers be stopped by something that is as wide as the present opening, without force sensor."""
        self.gripper.blocked_at, self.gripper.motor_force = self.gripper.width, motor_force
        self.gripper.move(self.gripper.limits.width_min, 0.05)
        self.clock.advance(0.02)

    def drop_plainly(self) -> None:
        """Let what plain fingers hold fall out: the motor presses on nothing."""
        self.gripper.motor_force = 0.0
        self.gripper.blocked_at = 0.0

    def hold_fruit(self, force: float = 2.0) -> None:
        """Let both fingers press something that is as wide as the present opening."""
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -force
        self.fingers.feel = lambda _now: wrenches
        self.clock.advance(0.01)

    def arm_trouble(self, code: str) -> Callable[[int], None]:
        """Return a function for `drive(each_tick=…)` that provokes a failure code of `MOTION_FAILURES`."""
        if code == "REFUSED":
            self.arm.refuse_next("servo off")
        elif code == "MOTION_FAILED":
            self.arm.fail_at(0.5, "following error at joint 3")

        def stop(_tick: int) -> None:
            if code == "STOPPED" and self.arm.followed and not self.arm.settled():
                self.arm.safe_stop("somebody pressed stop")

        return stop


class RealTimeClock(MockClock):
    """A clock on which waiting for a computation takes time, as on a real cell."""

    simulated = False


def seen_map(stamp: float = 0.0, blocked: tuple[np.ndarray, ...] = ()) -> OccupancyMap:
    """A map of the whole workspace that saw nothing but a lump of 8 cm around each of some points."""
    empty = OccupancyMap.empty(WORKSPACE.lower, WORKSPACE.upper, 0.02)
    states = np.ones_like(empty.states)
    for point in blocked:
        i, j, k = empty.cell_of(point)
        states[i - 2 : i + 2, j - 2 : j + 2, k - 2 : k + 2] = 2
    return replace(empty, states=states, last_look=np.zeros_like(empty.last_look), stamps=(stamp,))


ASIDE = OBSERVE + 2.2 * np.eye(7)[0]
"""The observe pose, turned about the arm's base."""
CELLS = (
    Box("wall", transform(rot_z(-np.pi / 3.0), [0.47, -0.814, 0.6]), (0.82, 0.02, 0.8)),
    Box("wall", transform(rot_z(5.0 * np.pi / 6.0), [-0.814, 0.47, 0.6]), (0.82, 0.02, 0.8)),
    Box("ceiling", transform(None, [0.0, 0.0, 0.82]), (1.5, 1.5, 0.02)),
)
"""Two walls from beside the base outwards, and a ceiling: OBSERVE and ASIDE are in different cells."""


def scene_with_pose(code: str, **scene: Any) -> tuple[PickingScene, dict[str, object]]:
    """A bench on which going to the pose "there" fails with a code, and the inputs and settings of `drive` for it."""
    poses = dict(WORKSPACE.poses) | {"there": HOME}
    obstacles, inputs, settings = WORKSPACE.obstacles, {}, {}
    if code == "GOAL_UNREACHABLE":
        poses["there"] = HOME + 7.0
    elif code == "GOAL_IN_COLLISION":
        lamp = Box("lamp", transform(None, ROBOT_MODEL.tcp(HOME)[:3, 3]), (0.06, 0.06, 0.06))
        obstacles = (*obstacles, lamp)
    elif code == "START_IN_COLLISION":
        inputs["map"] = seen_map(blocked=(ROBOT_MODEL.tcp(OBSERVE)[:3, 3],))
    elif code == "MAP_STALE":
        inputs["map"] = seen_map(stamp=-1000.0)
    elif code == "NO_PATH":
        poses["there"] = ASIDE
        obstacles = (*obstacles, *CELLS)
    elif code == "TIMEOUT":
        settings = {"computing": 10**9}
    elif code == "UNKNOWN_POSE":
        del poses["there"]
    workspace = replace(WORKSPACE, poses=poses, obstacles=obstacles)
    made = PickingScene(
        workspace=workspace, clock=RealTimeClock() if code == "TIMEOUT" else MockClock(), **scene
    )
    return made, {"inputs": inputs, "settings": settings}
