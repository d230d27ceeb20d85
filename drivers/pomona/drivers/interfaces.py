"""Interfaces of a cell's devices, as Protocols, and the data that they exchange.

Everything is in SI units. Every stamp is read from the cell's one clock. No call of a Protocol blocks for longer than a
few milliseconds: motions are started and then watched. An impossible request raises a
`pomona.drivers.errors.DeviceError`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.depth_model import D4XX, DepthModel
from pomona.drivers.errors import DeviceFault
from pomona.executive.cell.device import paced, stamped
from pomona.executive.lease import command, motion
from pomona.executive.values.arrays import Float64
from pomona.executive.values.read_only import ReadOnly

# ---------------------------------------------------------------------------------------------------- camera


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """A pinhole camera after rectification; pixel centres lie at integer coordinates: u = fx x / z + cx."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @property
    def K(self) -> Float64:
        """The camera matrix, (3, 3) [px]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Frame(ReadOnly):
    """One RGB-D image: colour, depth registered to it, and where the camera was at the exposure.

    Attributes:
        stamp: time of exposure on the cell's clock [s].
        sequence: number of the frame, counted by the camera from 0.
        colour: RGB, shape (h, w, 3), uint8.
        depth: z-depth, shape (h, w), float32 [m]; 0 without a measurement. None for a colour-only camera.
        intrinsics: of both images.
        q: joints of the arm at the exposure, shape (dof,) [rad], for a camera mounted on the arm; else None.
        T_mount_camera: pose of the camera in its mount: in tool0 when `q` is given (hand-eye), else in the base frame.
        label: origin of the frame for the operator: a file's name, or the camera's.
        depth_model: error model of `depth`, from the camera's driver; its offset and scale are corrected already.
        placed: whether `q` and `T_mount_camera` give the camera's pose; if not, positions in two frames cannot be
            compared.

    Raises:
        DeviceFault: colour, depth and intrinsics are not of one size.
    """

    stamp: float
    sequence: int
    colour: NDArray[np.uint8]
    depth: NDArray[np.float32] | None
    intrinsics: Intrinsics
    q: Float64 | None
    T_mount_camera: Float64
    label: str = ""
    depth_model: DepthModel = D4XX
    placed: bool = True

    def __post_init__(self) -> None:
        ReadOnly.__post_init__(self)
        lens = self.intrinsics
        sizes = {"colour": self.colour.shape[1::-1], "intrinsics": (lens.width, lens.height)}
        if self.depth is not None:
            sizes["depth"] = self.depth.shape[::-1]
        if len(set(sizes.values())) > 1:
            words = ", ".join(f"{of} {' x '.join(map(str, size))} px" for of, size in sizes.items())
            remedy = "register depth to colour, and give the intrinsics of that size"
            raise DeviceFault(
                self.label or "camera", f"its images are not of one size: {words}; {remedy}"
            )


@runtime_checkable
class Camera(Protocol):
    """An RGB-D camera that keeps the newest frame at hand."""

    @stamped
    def latest(self) -> Frame | None:
        """Return the newest frame, or None before the first. Never waits; the caller judges the stamp's age."""


@runtime_checkable
class DepthCamera(Camera, Protocol):
    """A camera that can deliver depth alone, if colour has a cost.

    The watch of a motion uses it (`pomona.skills.shared.live_watch`); of any other camera it uses `Camera.latest`.
    """

    def latest_depth(self) -> Frame | None:
        """Return the newest frame, perhaps of fewer pixels, its colour black; as `Camera.latest` otherwise."""


@dataclass(frozen=True, slots=True)
class Cameras:
    """All cameras of a cell, in the cell file's order: those on the arm, and those that are fixed in the cell."""

    all: tuple[Camera, ...]


@runtime_checkable
class Carrier(Protocol):
    """Carries things into the cell, as a belt does; where the watch of a motion stops the arm, it stops as well."""

    def stop(self) -> bool:
        """Stop as in the safe state; False where no program can. Needs no owner. Raises StopFailed: it may run on."""


@runtime_checkable
class FrameSequence(Protocol):
    """A camera that shows recorded frames one after the other; `Camera.latest` gives the one that is shown."""

    @property
    def count(self) -> int:
        """How many frames there are."""

    def advance(self) -> bool:
        """Turn to the next frame; False at the last one, which stays."""


# ------------------------------------------------------------------------------------------------------- arm


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory(ReadOnly):
    """Joint positions over time. The first sample is where the arm must stand when it is started, at time 0.

    Attributes:
        t: times, shape (n,), strictly increasing from 0 [s].
        q: joint positions, shape (n, dof) [rad].
        qd: joint velocities, shape (n, dof) [rad/s]; zero at both ends.
        qdd: joint accelerations, shape (n, dof) [rad/s²].
    """

    t: Float64
    q: Float64
    qd: Float64
    qdd: Float64

    @property
    def duration(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.t[-1])


class MotionState(Enum):
    """State of a motion that was started."""

    RUNNING = "running"
    PAUSED = "paused"
    DONE = "done"
    STOPPED = "stopped"
    FAILED = "failed"


@runtime_checkable
class Motion(Protocol):
    """A motion that was started: watch it until it is no longer RUNNING."""

    @property
    def state(self) -> MotionState:
        """Running, paused, stopped, failed or done."""

    @property
    def progress(self) -> float:
        """Share of the motion that is done, 0 to 1."""

    @property
    def settled(self) -> bool:
        """True once nothing moves any more: DONE, or STOPPED or FAILED and at rest."""

    @property
    def problem(self) -> str:
        """Why the motion FAILED, as a sentence; empty otherwise."""

    def stop(self) -> None:
        """Decelerate on the path within the device's limits and stay there. Harmless when the motion has ended."""


@dataclass(frozen=True, slots=True, eq=False)
class ArmLimits(ReadOnly):
    """Joint limits, each of shape (dof,): positions [rad], velocity [rad/s], acceleration [rad/s²], jerk [rad/s³].

    `reaction`: time from a commanded stop until the arm begins to brake [s].
    """

    lower: Float64
    upper: Float64
    velocity: Float64
    acceleration: Float64
    jerk: Float64
    reaction: float = field(default=0.0, kw_only=True)


@dataclass(frozen=True, slots=True, eq=False)
class ArmState(ReadOnly):
    """Measured joints at `stamp`: positions [rad] and velocities [rad/s], shape (dof,)."""

    stamp: float
    q: Float64
    qd: Float64
    moving: bool


@runtime_checkable
class Arm(Protocol):
    """A serial arm that follows joint trajectories, one at a time."""

    @property
    def description(self) -> Path:
        """The MJCF or URDF file of arm and gripper: the robot's only description."""

    @property
    def limits(self) -> ArmLimits:
        """Limits of the arm, by joint."""

    @stamped
    def state(self) -> ArmState:
        """Return the joints as last measured."""

    @motion
    @paced
    def follow(self, trajectory: Trajectory) -> Motion:
        """Start a trajectory.

        Raises:
            MotionRefused: it does not start where the arm stands, violates a limit, or the arm is moving or latched.
        """


@runtime_checkable
class SetPoints(Motion, Protocol):
    """A motion that follows streamed set-points; it ends when it is stopped, and fails when none arrive."""

    @property
    def speed(self) -> float:
        """Share of the joints' largest speeds that it uses now, above 0 to 1."""

    @property
    def delay(self) -> float:
        """Delay of the arm behind its set-points [s]: one with a time is followed best if it comes so early."""

    @command
    def aim(self, q: Float64, qd: Float64 | None = None, at: float = 0.0) -> None:
        """Go to these joints, shape (dof,) [rad], from now on, within the arm's limits.

        With `qd`, shape (dof,) [rad/s], the set-point moves on: the arm passes `q` at time `at` of the cell's clock [s]
        and keeps that velocity until the next one, or the watchdog. It falls behind a set-point that is too quick.

        Raises:
            BadTrajectory: they are not finite, or outside the limits; they are ignored.
        """


@runtime_checkable
class StreamedArm(Protocol):
    """An arm that also follows set-points streamed to it, for closed-loop control."""

    @motion
    def stream(self, watchdog: float) -> SetPoints:
        """Start from rest; without a set-point for `watchdog` [s] the arm comes to rest and the motion has failed.

        Raises:
            MotionRefused: the arm is moving or latched.
        """


# --------------------------------------------------------------------------------------------------- gripper


@dataclass(frozen=True, slots=True)
class GripperLimits:
    """Opening between the pads' faces [m], speed of the opening [m/s], force of one finger [N].

    `force_min`: with which fingers that meet something press at least [N]; `step`: of the opening that they can be
    moved by [m]; 0 for none.
    """

    width_min: float
    width_max: float
    speed_max: float
    force_max: float
    force_min: float = 0.0
    step: float = 0.0


@dataclass(frozen=True, slots=True)
class GripperState:
    """Measurements of a gripper at `stamp`.

    Attributes:
        width: opening between the pads' faces [m]; speed: its rate, negative closes [m/s].
        moving: a move or a speed is under way.
        motor_force: estimated from the motor's current, both fingers together, negative pushes outwards [N]; rough.
            None where the gripper does not report it. A cross-check for force sensors that read nothing.
        referenced: False while the gripper has not found its reference, and `width` means nothing.
        aim: opening of the newest move [m]; None before one, and after a streamed speed. Fingers that rest wider than
            that were stopped, perhaps by something between them.
    """

    stamp: float
    width: float
    speed: float
    moving: bool
    motor_force: float | None = None
    referenced: bool = True
    aim: float | None = None


@runtime_checkable
class Gripper(Protocol):
    """A parallel gripper; both fingers move alike."""

    @property
    def limits(self) -> GripperLimits:
        """Limits of the gripper."""

    @stamped
    def state(self) -> GripperState:
        """Opening and speed as last measured."""

    @motion
    def move(self, width: float, speed: float, force: float | None = None) -> Motion:
        """Start moving to an opening [m] with a speed [m/s]; ends an earlier move or speed.

        Args:
            force: with which one finger presses at most on what it meets [N]; None: the largest.

        Raises:
            MotionRefused: outside the limits, or the gripper is latched.
        """

    @motion
    def set_speed(self, speed: float) -> None:
        """Stream a rate of the opening [m/s]; negative closes. Ends an earlier move.

        Without a new value within the watchdog's time (100 ms) the driver commands zero.
        """


# -------------------------------------------------------------------------------------------- force/tactile


@dataclass(frozen=True, slots=True, eq=False)
class WrenchSample(ReadOnly):
    """Contact wrenches of both fingers, or the wrench on the flange that a load sensor measures.

    Attributes:
        stamp: time of the measurement [s].
        sequence: number of the sample, counted by the sensor; a gap means lost samples.
        wrenches: shape (2, 6): per finger force [N] and torque [N·m] that the fruit exerts on the pad, in the pad's
            frame: origin in the centre of the pad's face, z out of the face into the fruit (pressing gives a negative
            force z), x along the tool's approach axis, y = z x x. Torque about the origin. Of a load sensor: shape
            (1, 6), that hand and fruit exert on the flange, in tool0; its zero is unknown.
        saturated: per finger, whether any channel is at the end of its range.
    """

    stamp: float
    sequence: int
    wrenches: Float64
    saturated: tuple[bool, bool] = (False, False)


class Subscription(Protocol):
    """An open subscription to a stream."""

    def close(self) -> None:
        """No further call of the listener after this returns. Harmless when closed already."""


@runtime_checkable
class WrenchSensor(Protocol):
    """A sensor that streams wrenches at a fixed rate: see `ForceSensor`, `PressSensor` and `LoadSensor`."""

    @property
    def rate(self) -> float:
        """Samples per second."""

    @stamped
    def latest(self) -> WrenchSample | None:
        """Return the newest sample, or None before the first."""

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        """Call `listener` with every sample, in order, from the sensor's own loop; it returns within a millisecond."""

    def distrust(self, reason: str) -> None:
        """Mark the sensor's values as implausible: until `acknowledge` the cell's check ends a run with this reason.

        For code that compares the samples with other signals. The first reason stays. May be called from any thread.
        """


@runtime_checkable
class ForceSensor(WrenchSensor, Protocol):
    """Two force/tactile fingers."""


@runtime_checkable
class PressSensor(WrenchSensor, Protocol):
    """Two fingertips that measure contact and pressing force alone: as `ForceSensor`, all but each force z is 0."""


@runtime_checkable
class LoadSensor(WrenchSensor, Protocol):
    """One force/torque sensor between flange and hand: contact and weight, never the grip force."""

    @property
    def mass(self) -> float:
        """Mass that it carries, hand and fruit [kg]: it measures the inertia of this mass as well."""

    @property
    def least(self) -> float:
        """Smallest lasting change of force that is no error of the sensor [N]."""


# ------------------------------------------------------------------------------------------------------ hand


@runtime_checkable
class Hand(Protocol):
    """State of the hand, which a cell with a gripper or fingers follows from its connection on."""

    def in_hand(self) -> str | None:
        """Describe an object that may be between the fingers: an empty text for none, None in a cell without a hand."""


# ----------------------------------------------------------------------------------------------------- hands


class HandTask(Enum):
    """Tasks for the operator at a cell, with a fruit."""

    LEAVE = "leave"
    HOLD = "hold"
    PULL = "pull"
    TWIST = "twist"


@runtime_checkable
class Hands(Protocol):
    """Simulated hands that carry out the operator's tasks."""

    def do(self, task: HandTask) -> None:
        """Begin a task; it continues while time passes.

        LEAVE: release nothing, move nothing. HOLD: hold the fruit between the fingers. PULL: pull it along the pads
        until it slides. TWIST: the same while turning it about the line between the pads.
        """


# ------------------------------------------------------------------------------------------------- workspace


@dataclass(frozen=True, slots=True, eq=False)
class Box(ReadOnly):
    """A fixed obstacle: a box with its half-extents [m], posed in the base frame."""

    name: str
    T_base_box: Float64
    half_extents: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Hull(ReadOnly):
    """A fixed obstacle: the convex hull of points.

    Attributes:
        points: shape (n, 3) [m].
        normals: directions of its faces, shape (k, 3), unit length; they define the hull.
    """

    name: str
    points: Float64
    normals: Float64


@dataclass(frozen=True, slots=True)
class PathWatchSettings:
    """Settings of the watch of a path while the arm follows it.

    Attributes:
        speed: expected approach speed of moving objects [m/s]; a hand's in ISO 13855.
        near: distance to unmapped standing objects, from the middle of their cell of 20 mm [m].
        padding: around the robot's shape; nearer points count as the robot itself [m].
        delay: from the exposure of a frame to the moment at which the arm begins to brake [s].
        passing: volumes in which a line carries its goods, which are no obstacles.
    """

    speed: float = 1.6
    near: float = 0.03
    padding: float = 0.03
    delay: float = 0.05
    passing: tuple[Box, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Workspace(ReadOnly):
    """Known surroundings of the arm, from the cell file, in the base frame.

    Attributes:
        table_z: height of the support plane [m], or None where there is none.
        lower, upper: corners of the volume that is mapped and moved in, shape (3,) [m].
        obstacles: fixed geometry, independent of cameras.
        poses: named joint configurations, shape (dof,) [rad] each: home, observe, observe_2, place …
        watch: settings of the watch of paths; None: no watch.
        zones: forbidden volumes for the robot and a held fruit, although empty; named 'zone NAME'.
        hulls: fixed geometry that is no box: parts of meshes, in the base frame.
    """

    table_z: float | None
    lower: Float64
    upper: Float64
    obstacles: tuple[Box, ...] = ()
    poses: Mapping[str, Float64] = field(default_factory=dict)
    watch: PathWatchSettings | None = None
    zones: tuple[Box, ...] = ()
    hulls: tuple[Hull, ...] = ()


# ------------------------------------------------------------------------------------------------------ pads


@dataclass(frozen=True, slots=True)
class PadContact:
    """Contact of the fingers' pads with one kind of fruit.

    Attributes:
        mu: friction coefficient.
        uncertainty: of mu, relative; covered by more force.
        delta: radius of a pad's contact at 1 N [m].
        gamma: exponent of that radius over the force.
        stiffness: rise of the grip force over the closing of the fingers, two pads in series [N/m].
    """

    mu: float
    uncertainty: float
    delta: float
    gamma: float
    stiffness: float


OTHER_FRUIT = "any"  # the kind that stands for all that pads do not name


@runtime_checkable
class Pads(Protocol):
    """The pads of the fingers."""

    def on(self, kind: str) -> PadContact:
        """Return their contact with a kind of fruit, by its name in the catalogue."""


# ----------------------------------------------------------------------------------------------------- facts


@dataclass(frozen=True, slots=True)
class SampleRate:
    """Sample rate of a force sensor [Hz], from the cell file, before any connection."""

    hz: float


@dataclass(frozen=True, slots=True)
class FruitKinds:
    """Which kinds of fruit lie on a simulated table: names of the catalogue."""

    names: tuple[str, ...]
