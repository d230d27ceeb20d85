"""How a cell file's options become the simulated world and its devices: the entry points of this package."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.drivers.camera_options import LARGEST, IntrinsicsSection
from pomona.drivers.errors import UnusableRobotFile
from pomona.drivers.gripper_supervisor import GripperSupervision
from pomona.drivers.motion_supervisor import Supervision
from pomona.drivers.services import ConnectContext
from pomona.drivers.streams import Belief
from pomona.executive.cell.registration import Settings, Surroundings, driver
from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import Counts, Measure, PathTo, Row, Span
from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.rotations import is_rigid
from pomona.executive.values.sections import Problem, Section, value
from pomona.executive.values.units import FORCE, LENGTH, PIXELS, RATE, SPEED, TIME
from pomona.tools.simulation.arm import SimArm
from pomona.tools.simulation.camera import SimCamera
from pomona.tools.simulation.exposure import Timing
from pomona.tools.simulation.fingers import SimFingers
from pomona.tools.simulation.gripper import SimGripper
from pomona.tools.simulation.hands import SimHands
from pomona.tools.simulation.layout import WorldOptions, draw_layout
from pomona.tools.simulation.scene import OFFSCREEN, build_scene
from pomona.tools.simulation.stereo_depth import Stereo
from pomona.tools.simulation.world import PhysicsWorld, SimWorld

NO_WAY = 1e-6  # two points no further apart give no direction [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class InWorld:
    """A device that lives in the simulated world."""

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        if not around.has(PhysicsWorld):
            yield Problem(
                "driver",
                "a simulated device needs the simulated world above it",
                "world: {driver: mujoco, …}",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class OnTable(InWorld):
    """A device that deals with the table's fruit."""

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        if not around.has(SimWorld):
            yield Problem(
                "driver", "it needs the simulated table above it", "world: {driver: mujoco, …}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmOptions(InWorld):
    """The simulated arm."""

    supervision: Supervision = value(
        Section(Supervision), Supervision(), "how closely the arm must follow its commands"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperOptions(InWorld):
    """The simulated gripper."""

    speed_max: float = value(
        Measure(SPEED, "1 mm/s", "1 m/s"), "200 mm/s", "fastest that the fingers move"
    )
    force_max: float = value(Measure(FORCE, "1 N", "50 N"), "20 N", "largest force of its drive")
    watchdog: float = value(
        Measure(TIME, "20 ms", "1 s"),
        "100 ms",
        "a streamed speed that is not renewed within this time becomes zero",
    )
    supervision: GripperSupervision = value(
        Section(GripperSupervision),
        GripperSupervision(),
        "how closely the gripper must follow its commands",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FingersOptions(InWorld):
    """The simulated force fingers."""

    noise: float = value(Measure(FORCE, "0 N", "1 N"), "0.04 N", "white, per sample")
    bias: float = value(
        Measure(FORCE, "0 N", "2 N"), "0.08 N", "largest of an axis, drawn for each run"
    )
    range: float = value(Measure(FORCE, "0.5 N", "100 N"), "8 N", "an axis saturates there")
    belief: Belief = value(Section(Belief), Belief(), "limits beyond which samples are not trusted")


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedSection:
    """A camera that is fixed in the cell, its image upright."""

    position: tuple[float, ...] = value(
        Row(Measure(LENGTH, "-10 m", "10 m"), 3), help="in the base frame"
    )
    looks_at: tuple[float, ...] = value(
        Row(Measure(LENGTH, "-10 m", "10 m"), 3),
        help="a point on its optical axis, in the base frame",
    )

    def problems(self) -> Iterator[Problem]:
        ahead = np.subtract(self.looks_at, self.position)
        if np.linalg.norm(ahead) < NO_WAY:
            yield Problem(
                "looks_at", "it is where the camera itself is", "a point that it looks at"
            )

    def pose(self) -> Float64:
        """T_base_camera, shape (4, 4): z along the optical axis, y down, or towards +y where it looks straight down."""
        p = np.array(self.position)
        ahead = np.subtract(self.looks_at, self.position)
        z = ahead / np.linalg.norm(ahead)
        x = np.cross(z, [0.0, 0.0, 1.0])
        x = np.array([-1.0, 0.0, 0.0]) if np.linalg.norm(x) < NO_WAY else x / np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), p
        return T


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraOptions(InWorld):
    """The simulated RGB-D camera, on the gripper or fixed in the cell: a stereo camera."""

    size: tuple[int, ...] | None = value(
        Counts(2, 1, LARGEST),
        None,
        "width and height of the images; the intrinsics are scaled to it",
    )
    intrinsics: IntrinsicsSection = value(
        Section(IntrinsicsSection), help="of the camera, for the size in them"
    )
    baseline: float = value(
        Measure(LENGTH, "1 mm", "500 mm"), "50 mm", "distance of the two imagers"
    )
    disparity_noise: float = value(
        Measure(PIXELS, "0 px", "2 px"),
        "0.08 px",
        "depth errs by z² · disparity_noise / (f · baseline)",
    )
    nearest: float = value(
        Measure(LENGTH, "0 mm", "1 m"), "180 mm", "distance below which there is no depth"
    )
    rate: float = value(Measure(RATE, "1 Hz", "1 kHz"), "30 Hz", "frames per second")
    latency: tuple[float, float] = value(
        Span(Measure(TIME, "0 s", "500 ms")),
        "0 ms..0 ms",
        "time from an exposure to the delivery of its frame",
    )
    exposure: float = value(
        Measure(TIME, "0 s", "50 ms"),
        "0 ms",
        "of the colour picture: what moves meanwhile is blurred",
    )
    depth_after: float = value(
        Measure(TIME, "-50 ms", "50 ms"),
        "0 ms",
        "from the middle of the colour's exposure to that of the depth",
    )
    fixed: FixedSection | None = value(
        Section(FixedSection),
        None,
        "where it is fixed in the cell; without it, it rides on the gripper",
    )

    hand_eye: Path | None = value(
        PathTo("file"),
        None,
        "file with the pose that its frames state, right or wrong; without it, the true pose",
    )

    def problems(self) -> Iterator[Problem]:
        try:
            self.stated()
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            yield Problem("hand_eye", f"it holds no pose 'T_mount_camera': {error}")
        width, height = self.size or (self.intrinsics.width, self.intrinsics.height)
        if width > OFFSCREEN[0] or height > OFFSCREEN[1]:
            yield Problem(
                "size" if self.size else "intrinsics",
                f"it is {width} x {height}; the simulator draws at most {OFFSCREEN[0]} x {OFFSCREEN[1]} pixels",
            )

    def stated(self) -> Float64 | None:
        """Return the pose in `hand_eye`, shape (4, 4); None without one. Raises ValueError or OSError: it has none."""
        if self.hand_eye is None:
            return None
        T = np.array(json.loads(read_plain_text(self.hand_eye))["T_mount_camera"], np.float64)
        if not is_rigid(T):
            raise ValueError("it is no rigid 4 x 4 transform")
        return T


@driver(SimWorld, WorldOptions)
def connect_world(settings: Settings[WorldOptions], context: ConnectContext) -> SimWorld:
    """`driver: mujoco`"""
    said = settings.values
    layout = draw_layout(
        said, context.seed, context.workspace.obstacles if context.workspace else ()
    )
    assert context.workspace is not None, "judged when the cell file was read"
    try:
        scene = build_scene(layout, context.seed)
    except UnusableRobotFile as error:
        raise settings.error(str(error), "robot") from error
    return SimWorld(scene, layout.robot, context.workspace.poses[said.start], context.seed)


@driver(SimArm, ArmOptions)
def connect_arm(settings: Settings[ArmOptions], context: ConnectContext) -> SimArm:
    """`driver: sim-arm`"""
    world = _world(context)
    return SimArm(world, world.description, settings.values.supervision)


@driver(SimGripper, GripperOptions)
def connect_gripper(settings: Settings[GripperOptions], context: ConnectContext) -> SimGripper:
    """`driver: sim-gripper`"""
    said = settings.values
    limits = {"speed_max": said.speed_max, "force_max": said.force_max}
    return SimGripper(
        _world(context), **limits, watchdog=said.watchdog, supervision=said.supervision
    )


@driver(SimFingers, FingersOptions)
def connect_fingers(settings: Settings[FingersOptions], context: ConnectContext) -> SimFingers:
    """`driver: sim-fingers`"""
    said = settings.values
    return SimFingers(
        _world(context),
        noise=said.noise,
        bias=said.bias,
        force_range=said.range,
        belief=said.belief,
    )


@driver(SimHands, OnTable)
def connect_hands(settings: Settings[OnTable], context: ConnectContext) -> SimHands:
    """`driver: sim-hands`"""
    world = context.find(SimWorld)
    assert world is not None, "judged when the cell file was read"
    return SimHands(world)


@driver(SimCamera, CameraOptions)
def connect_camera(settings: Settings[CameraOptions], context: ConnectContext) -> SimCamera:
    """`driver: sim-camera`"""
    said = settings.values
    intrinsics = said.intrinsics.intrinsics(said.size)
    stereo = Stereo(intrinsics.fx, said.baseline, said.disparity_noise, said.nearest)
    pose = None if said.fixed is None else said.fixed.pose()
    timing = Timing(said.latency, said.exposure, said.depth_after)
    return SimCamera(_world(context), intrinsics, stereo, said.rate, pose, timing, said.stated())


def _world(context: ConnectContext) -> PhysicsWorld:
    world = context.find(PhysicsWorld)
    assert world is not None, "judged when the cell file was read"
    return world
