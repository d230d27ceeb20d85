"""An arm behind ros2_control as an `Arm` (`driver: ros2-arm`): joint states in, trajectories for its controller out.

The controller is a joint_trajectory_controller, by its topic. It gives no answers, so the joints alone show its motion.
Silence, implausible feedback, an arm that does not follow and missing set-points fail the motion and stay latched until
an operator acknowledges it; nothing resumes by itself.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pomona.devices.ros2.joints import JointFeed, RosNode, stamped
from pomona.drivers import (
    AT_REST,
    POINT_PERIOD,
    ArmFile,
    ArmLimits,
    ArmState,
    ConnectContext,
    DeviceError,
    DeviceFault,
    DeviceLost,
    OutOfSetPointsError,
    PathArm,
    PathMotion,
    RollingPath,
    SetPoint,
    Settings,
    driver,
    words,
)
from pomona.executive import TIME, Clock, Float64, Measure, Text, Words, value
from pomona.tools.ros2.peer import ADDRESS, DISTRIBUTIONS
from pomona.tools.ros2.rosbridge import WAY, open_peer
from pomona.tools.ros2.types import coder

TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
PAGE = "control.ros.org, joint_trajectory_controller"
PATIENCE = 0.004  # the wire is waited for no longer than this at a time [s]
REJOIN = 0.05  # time after its arrival at which a stop's first set-point is due [s]: ten times a network's delay
STEPPED = 0.02  # change between the host's clock and the cell's that counts as a step [s]
FIRST = 3.0  # deadline of the first joint state [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2ArmFile(ArmFile):
    """An arm behind a joint_trajectory_controller of ros2_control."""

    address: str = value(WAY, ADDRESS, WAY.words)
    distribution: str = value(Text(*DISTRIBUTIONS), "jazzy", "version of ROS 2 behind the router")
    joints: tuple[str, ...] = value(
        Words(), help="the description's joints, by their names in ROS 2"
    )
    states: str = value(Text(), "/joint_states", "topic of sensor_msgs/JointState")
    commands: str = value(
        Text(),
        "/joint_trajectory_controller/joint_trajectory",
        "topic of trajectory_msgs/JointTrajectory",
    )
    lead: float = value(
        Measure(TIME, "40 ms", "700 ms"),
        "150 ms",
        "how far ahead in time points are sent to the arm",
    )
    silence: float = value(
        Measure(TIME, "20 ms", "1 s"),
        "100 ms",
        "without joint states for this long the arm is lost",
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address} {self.commands}",)

    @property
    def dof(self) -> int:
        return len(self.joints)


class Ros2Arm(PathArm):
    """The arm. Joints in the order of the robot's description."""

    declared: ClassVar[Mapping[str, str]] = {
        "a_gap_ends_without_a_jump": f"a new trajectory is sampled at its time, wherever the arm is: {PAGE}",
        "both_clocks_may_step": f"a trajectory is sampled by the controller's own clock: {PAGE}",
    }

    def __init__(
        self,
        wire: RosNode,
        clock: Clock,
        limits: ArmLimits,
        options: Ros2ArmFile,
        name: str = "arm",
        host_time: Callable[[], float] = time.time,
    ) -> None:
        super().__init__(name, clock, options.robot, limits, options.supervision, POINT_PERIOD)
        self.options = options
        self._wire = wire
        self._host_time = host_time
        self._feed = JointFeed(
            name, wire, options.states, options.joints, clock, options.silence, host_time
        )
        self._coder = coder(TRAJECTORY)
        self._path: RollingPath | None = None
        self._say_at = -np.inf
        self._rested = False
        self._offset = 0.0  # from the cell's time to the host's, of the present motion [s]
        self._own = uuid.uuid4().hex  # frame of our trajectories, which no controller reads
        self._foreign = False
        wire.subscribe(options.commands, TRAJECTORY, self._hear)

    # ---------------------------------------------------------------------------------------- connection

    def connect(self, deadline: float = FIRST) -> None:
        """Wait for the first joint states; nothing is sent. Raises DeviceLost: none came, or they cannot be true."""
        end = self._clock.now() + deadline
        while self._state is None:
            sample = self._feed.newest(PATIENCE)
            if sample is not None:
                self._believe(sample.stamp, sample.q, sample.qd)
            elif self._clock.now() > end:
                self._feed.check()
                raise DeviceLost(
                    self.name, f"no joints on {self.options.states} within {deadline:g} s"
                )
        self._problem = None

    def _hear(self, raw: bytes) -> None:
        """In the wire's thread: note a trajectory of somebody else."""
        self._foreign |= self._own.encode() not in raw

    def step(self) -> None:
        """Serve the arm for a moment; its own thread calls this without end."""
        try:
            self._watch_clock()
            sample = self._feed.newest(PATIENCE)
            if sample is not None:
                self._believe(sample.stamp, sample.q, sample.qd)
            self._feed.check()
        except DeviceLost as error:
            self._doubt(error)
            if self._feed.went_back:
                self._brake()
        if self._foreign:
            self._foreign = False
            self._condemn(DeviceFault(self.name, "another program commands the arm"))
        if self._path is not None:
            self._tell(self._path)
        self._watch_motion()

    def _failed(self, error: BaseException) -> None:
        """Handle a defect of the driver itself: the last message brings the arm to rest."""
        found = (
            error
            if isinstance(error, DeviceError)
            else DeviceFault(self.name, f"the driver failed: {error!r}")
        )
        self._blame(found)
        self._abandon(found.message)

    # ----------------------------------------------------------------------------------------- the wire

    @property
    def _stream(self) -> RollingPath | None:
        return self._path

    def _begin_stream(self, motion: PathMotion, q_arm: Float64) -> None:
        self._say_at, self._rested, self._offset = -np.inf, False, self._read_offset()
        self._path = RollingPath(
            self.name, motion, q_arm, self._clock, self.options.lead, self._supervisor.command
        )

    def _end_stream(self) -> None:
        self._path = None

    def _read_offset(self) -> float:
        """Return the host's time minus the cell's [s]: of three readings, the one that was interrupted least."""
        readings = []
        for _ in range(3):
            before = self._clock.now()
            wall = self._host_time()
            readings.append((self._clock.now() - before, wall - before))
        return min(readings)[1]

    def _watch_clock(self) -> None:
        """Stop a motion when the host's clock steps: its set-points then have the wrong times for the controller.

        Raises DeviceLost: it was stepped.
        """
        if self._path is None or self._path.braking_now:
            return
        stepped = self._read_offset() - self._offset
        if abs(stepped) > STEPPED:
            self._brake()
            raise DeviceLost(
                self.name, f"the clock of this computer was stepped by {stepped:+.3g} s in a motion"
            )

    def _tell(self, path: RollingPath) -> None:
        now = self._clock.now()
        try:
            path.go_on()
        except OutOfSetPointsError as error:
            self._blame(error)
            self._abandon(error.message)  # the last message brings it to rest
            return
        rested = self._rested
        self._rested = path.played
        if rested == path.played and (rested or now < self._say_at):
            return
        # period of repeated set-points [s]: if several get lost, one arrives before the lead is over
        self._say_at = now + 0.03
        points = path.window()
        if (
            path.braking_now or path.played
        ):  # a plan that has ended would be played again if a clock stepped back
            left = points[-1].due - now
            self._send(
                [point for point in points if point.due > now + min(REJOIN, left / 2.0)]
                or points[-1:],
                0.0,
            )
        else:
            self._send(points, points[0].due + self._offset)

    def _send(self, points: Sequence[SetPoint], stamp: float) -> None:
        """Send a trajectory.

        Args:
            stamp: time of the first point on the host's clock. 0: the controller begins at the arrival, on its own.
        """
        now = self._clock.now()
        began = points[0].due if stamp else now if now < points[0].due else points[0].due - REJOIN
        told = [
            {
                "positions": point.q,
                "velocities": point.qd,
                "time_from_start": stamped(point.due - began),
            }
            for point in points
        ]
        header = {"stamp": stamped(stamp), "frame_id": self._own}
        fields = {"header": header, "joint_names": list(self.options.joints), "points": told}
        self._wire.publish(
            self.options.commands,
            TRAJECTORY,
            self._coder.coded(fields),
            round(self._host_time() * 1e9),
        )

    def _halt(self, problem: str) -> None:
        """Brake from the present set-point within the limits; where the arm truly is, no joint shows.

        Joints that begin to move at rest do show it: something has held them, and they stay there.
        """
        self._doubted = True
        if self._motion is not None:
            self._motion.fail(problem)
        self._brake()
        if self._supervisor.has_come_free and self._state is not None:
            here = SetPoint(self._clock.now() + POINT_PERIOD, self._state.q, 0.0 * self._state.q)
            self._send([here], 0.0)

    def _brake(self) -> None:
        """Brake from the present set-point, and tell the controller at once."""
        if self._path is not None and not self._path.braking_now:
            self._path.brake()
            self._say_at = -np.inf

    # ---------------------------------------------------------------------------------------- the device

    def state(self) -> ArmState:
        """See the Protocol. Raises DeviceLost: there is no fresh state."""
        if not self._believed or self._state is None:
            raise DeviceLost(self.name, words(self._problem))
        return self._state

    def _release(self) -> None:
        self._problem = None
        self._owner.post(self._begin_anew)

    def _begin_anew(self) -> None:
        self._doubted = False
        if self._motion is None or self._motion.settled:
            self._supervisor.forget()

    def _leave(self) -> None:
        self._wire.close()


@driver(Ros2Arm, Ros2ArmFile)
def connect(settings: Settings[Ros2ArmFile], context: ConnectContext) -> Ros2Arm:
    """Listen to the arm that a cell file describes; nothing moves."""
    said = settings.values
    wire = open_peer(said.address, "pomona_arm", said.distribution)
    arm = Ros2Arm(wire, context.clock, said.limits, said)
    try:
        arm.connect()
    except DeviceLost as error:
        wire.close()
        hint = "is joint_state_broadcaster running on rmw_zenoh? `ros2 topic echo` shows the joints' names"
        raise settings.error(error.message, "states", hint) from error
    where = said.address, said.states, list(said.joints), AT_REST, said.distribution
    arm.outside_stop = "pomona.devices.ros2.outside:see_rest", where
    arm.start()
    return arm
