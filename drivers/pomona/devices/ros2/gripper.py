"""A parallel gripper behind ros2_control as a `Gripper` (`driver: ros2-gripper`): a joint's state in, its position out.

The controller is a forward_command_controller for a position. Moves and streamed speeds become position set-points
that advance at the commanded speed, at most `ahead` of the measured opening: this bounds the fingers' force, and they
come to rest when no more set-points arrive. Implausible states, silence, and fingers that do not follow their
set-points are latched until acknowledged.

Over rosbridge an action of `control_msgs/GripperCommand` can take the controller's place: a goal for each set-point.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from pomona.devices.ros2.joints import JointFeed, JointSample, RosNode
from pomona.drivers import (
    ConnectContext,
    DeviceError,
    DeviceFault,
    DeviceLost,
    GripperLimits,
    GripperState,
    GripperSupervision,
    PositionGripper,
    Settings,
    Stop,
    Wanted,
    WidthOrder,
    driver,
)
from pomona.executive import (
    FORCE,
    LENGTH,
    SPEED,
    TIME,
    Clock,
    Measure,
    Number,
    Problem,
    Section,
    Span,
    Text,
    value,
)
from pomona.tools.ros2.peer import ADDRESS, DISTRIBUTIONS
from pomona.tools.ros2.rosbridge import SCHEMES, WAY, RosbridgePeer, open_peer
from pomona.tools.ros2.types import coder

COMMAND = "std_msgs/msg/Float64MultiArray"
ACTION = "control_msgs/action/GripperCommand"
PATIENCE = 0.004  # receive timeout [s]
SET_POINT_PERIOD = 0.01  # period of the set-points while anything moves [s]
ARRIVED = 1e-3  # position tolerance: fingers this close to their target have arrived [m]
# fingers at rest off their target for this long, beyond the allowed lag, are blocked [s]
BLOCKED = 0.2
GOAL_PERIOD = 0.05  # shortest time between goals of an action [s]: each ends the one before
FIRST_STATE = 3.0  # deadline for the first joint state [s]
# assumed acceleration of the set-point for the supervisor [m/s²]; real fingers are quicker
ACCELERATION = 1.0


@dataclass(frozen=True, slots=True)
class Ros2GripperOptions:
    """Options of the gripper in the cell file."""

    joint: str  # its name in ROS 2
    # scale, finger_offset: opening = finger_offset + scale · position; scale 2 where two fingers each move by it
    scale: float = 1.0
    finger_offset: float = 0.0
    # states, commands: topics of joint states and of position commands
    states: str = "/joint_states"
    commands: str = "/gripper_controller/commands"
    ahead: float = 0.01  # how far the set-point may lead the measured opening [m]
    watchdog: float = 0.1  # a streamed speed that is not renewed within this time becomes zero [s]
    silence: float = 0.1  # without a joint state for this long the gripper is lost [s]
    supervision: GripperSupervision = field(default_factory=GripperSupervision)
    # name of an action GripperCommand that takes the set-points instead of `commands`
    action: str = ""


class Ros2Gripper(PositionGripper[GripperState, float]):
    """The gripper. One thread owns the set-point; requests are posted to it."""

    outlives = True
    declared: ClassVar[Mapping[str, str]] = {
        "a_force_is_obeyed": (
            "std_msgs/Float64MultiArray holds a position alone, and its controller's own limit bounds the force: "
            "control.ros.org, forward_command_controller"
        )
    }

    def __init__(
        self,
        wire: RosNode,
        clock: Clock,
        limits: GripperLimits,
        options: Ros2GripperOptions,
        name: str = "gripper",
        host_time: Callable[[], float] = time.time,
    ) -> None:
        super().__init__(
            name,
            clock,
            limits,
            acceleration=ACCELERATION,
            watchdog=options.watchdog,
            supervision=options.supervision,
        )
        self.options = options
        self._wire = wire
        self._host_time = host_time
        self._feed = JointFeed(
            name, wire, options.states, (options.joint,), clock, options.silence, host_time
        )
        self._coder = coder(COMMAND)
        self._published_at = clock.now()
        self._published: float | None = None  # newest set-point that the controller has
        self._effort = limits.force_max  # of an action [N]

    def connect(self, deadline: float = FIRST_STATE) -> None:
        """Wait for the first state; nothing is sent. Raises DeviceLost: none came; DeviceFault: it is implausible."""
        end = self._clock.now() + deadline
        self._supervisor.rest(self._clock.now())
        self._reopen()
        while self._state is None:
            sample = self._feed.newest(PATIENCE)
            if sample is not None:
                self._believe(sample)
            elif self._clock.now() > end:
                self._feed.check()
                raise DeviceLost(
                    self.name, f"no joints on {self.options.states} within {deadline:g} s"
                )
        if self._problem is not None:
            raise self._problem

    def _serve(self) -> None:
        sample = self._feed.newest(PATIENCE)
        try:
            if sample is not None:
                self._believe(sample)
            self._feed.check()
        except DeviceLost as error:
            self._lose(error)

    def _believe(self, sample: JointSample) -> None:
        options = self.options
        width = options.finger_offset + options.scale * float(sample.q[0])
        rate = self._rate(sample.stamp, width)
        speed = rate if sample.qd is None else options.scale * float(sample.qd[0])
        self._measured(sample.stamp, width, speed)
        self._status = self._state

    def next_command(self, wanted: Wanted, status: GripperState) -> float | None:
        """Return the set-point, once it has changed and again some time later: one may be lost on the way."""
        if isinstance(wanted, Stop):
            self._set_point = self._published
        else:
            self._effort = wanted.force if isinstance(wanted, WidthOrder) else self.limits.force_max
        often, again = (GOAL_PERIOD, 0.5) if self.options.action else (SET_POINT_PERIOD, 0.1)
        waited = self._clock.now() - self._published_at
        new = self._set_point != self._published
        return self._set_point if waited >= (often if new else again) else None

    def _send(self, command: float) -> None:
        self._published, self._published_at = command, self._clock.now()
        position = (command - self.options.finger_offset) / self.options.scale
        if self.options.action and isinstance(self._wire, RosbridgePeer):
            goal = {"command": {"position": position, "max_effort": self._effort}}
            self._wire.send_goal(self.options.action, ACTION, goal, round(self._host_time() * 1e9))
            return
        coded = self._coder.coded({"data": [position]})
        self._wire.publish(self.options.commands, COMMAND, coded, round(self._host_time() * 1e9))

    def _ahead(self, speed: float) -> float:
        return self.options.ahead

    def _watch(self, state: GripperState) -> None:
        if self._set_point is not None:
            self._judge_move(
                state, self._set_point, ARRIVED, self.options.supervision.lag + BLOCKED
            )

    def _failed(self, error: BaseException) -> None:
        """As the base; the peer finds its way back by itself."""
        self._lose(DeviceFault(self.name, f"the driver failed: {error!r}"))

    def _leave(self) -> None:
        self._wire.close()


# ------------------------------------------------------------------------------------------------ cell file


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2GripperFile:
    """A parallel gripper behind a forward_command_controller of ros2_control."""

    address: str = value(WAY, ADDRESS, WAY.words)
    distribution: str = value(Text(*DISTRIBUTIONS), "jazzy", "version of ROS 2 behind the router")
    joint: str = value(Text(), help="name of the gripper's joint in ROS 2")
    scale: float = value(
        Number(-1e3, 1e3), 1.0, "metres of opening per unit of the joint; two fingers: 2"
    )
    finger_offset: float = value(
        Measure(LENGTH, "-200 mm", "500 mm"), "0 mm", "opening with the joint at zero"
    )
    opening: tuple[float, float] = value(
        Span(Measure(LENGTH, "0 mm", "500 mm")), help="least and largest opening"
    )
    speed_max: float = value(
        Measure(SPEED, "1 mm/s", "1 m/s"), "50 mm/s", "largest speed of the opening"
    )
    force_max: float = value(
        Measure(FORCE, "0.1 N", "500 N"), "20 N", "force of one finger, as set in its controller"
    )
    states: str = value(Text(), "/joint_states", "topic of sensor_msgs/JointState")
    commands: str = value(
        Text(), "/gripper_controller/commands", "topic of std_msgs/Float64MultiArray: a position"
    )
    action: str = value(
        Text(),
        "",
        "action of control_msgs/GripperCommand in the place of 'commands', over rosbridge",
    )
    ahead: float = value(
        Measure(LENGTH, "1 mm", "50 mm"),
        "10 mm",
        "how far the set-point may lead the measured opening",
    )
    watchdog: float = value(
        Measure(TIME, "30 ms", "1 s"),
        "100 ms",
        "a streamed speed that is not renewed within this time becomes zero",
    )
    silence: float = value(
        Measure(TIME, "20 ms", "1 s"),
        "100 ms",
        "without a joint state for this long the gripper is lost",
    )
    supervision: GripperSupervision = value(
        Section(GripperSupervision),
        GripperSupervision(),
        "how closely the gripper must follow its commands",
    )

    @property
    def limits(self) -> GripperLimits:
        """Limits of the gripper."""
        return GripperLimits(*self.opening, self.speed_max, self.force_max)

    def known(self) -> Iterator[object]:
        """Yield the limits, which a check of a tree needs."""
        yield self.limits

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address} {self.action or self.commands}",)

    def problems(self) -> Iterator[Problem]:
        if abs(self.scale) < 1e-6:
            yield Problem("scale", "it cannot be zero")
        if self.action and not self.address.startswith(SCHEMES):
            words = "an action is reached over rosbridge alone: address ws://HOST:9090"
            yield Problem(
                "action",
                words,
                "over rmw_zenoh, give the topic of a position controller as 'commands'",
            )
        if self.opening[0] >= self.opening[1]:
            yield Problem("opening", "it must be a range", "opening: [0 mm, 80 mm]")


@driver(Ros2Gripper, Ros2GripperFile)
def connect(settings: Settings[Ros2GripperFile], context: ConnectContext) -> Ros2Gripper:
    """Listen to the gripper that a cell file describes; nothing moves."""
    said = settings.values
    options = Ros2GripperOptions(
        said.joint,
        said.scale,
        said.finger_offset,
        said.states,
        said.commands,
        said.ahead,
        said.watchdog,
        said.silence,
        said.supervision,
        said.action,
    )
    wire = open_peer(said.address, "pomona_gripper", said.distribution)
    gripper = Ros2Gripper(wire, context.clock, said.limits, options)
    try:
        gripper.connect()
    except DeviceError as error:
        wire.close()
        hint = "is joint_state_broadcaster running on rmw_zenoh? `ros2 topic echo` shows the joints' names"
        raise settings.error(error.message, "states", hint) from error
    slow = 2e-3 / abs(said.scale)
    where = said.address, said.states, [said.joint], slow, said.distribution
    gripper.outside_stop = "pomona.devices.ros2.outside:see_rest", where
    gripper.start()
    return gripper
