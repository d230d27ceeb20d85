"""An arm behind ros2_control as an `Arm` (`driver: ros2-arm`): joint states in, trajectories for its controller out.

The controller is a joint_trajectory_controller, by its topic. It gives no answers, so what it does is judged by the
joints alone. Silence, what cannot be true, an arm that does not follow and set-points that ran out fail the motion and
stay latched until somebody acknowledges it; nothing goes on by itself.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.device import ConnectContext, Device
from drivers.driver import Settings, driver
from drivers.errors import BadTrajectory, DeviceError, DeviceFault, DeviceLost, MotionRefused, UnusableRobotFile
from drivers.interfaces import Arm, ArmLimits, ArmState, Motion, MotionState, Trajectory
from drivers.motion_supervisor import MotionSupervisor, Supervision
from drivers.owner import Owner
from drivers.path_motion import PathMotion
from drivers.posted_motion import PostedMotion
from drivers.robot_file import read_limits
from drivers.ros2.joints import JointFeed, RosNode, stamped
from drivers.ros2.rolling_path import PERIOD, OutOfSetPointsError, RollingPath, SetPoint
from drivers.trajectory import check_trajectory
from executive.clock import Clock
from executive.ros2.peer import ADDRESS, Ros2Peer
from executive.ros2.types import coder
from executive.values.arrays import Float64
from executive.values.kinds import Measure, PathTo, Text, Words
from executive.values.sections import Problem, Section, value
from executive.values.units import TIME

TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
AT_REST = 5e-3
"""No joint moves faster than this when the arm rests [rad/s]."""
SAY = 0.03
"""Set-points are said again so often [s]: of several that get lost, one arrives before the lead is over."""
PATIENCE = 0.004
"""The wire is waited for no longer than this at a time [s]."""
HOLD = 0.05
"""An arm that does not follow is told to be where it is, in this time [s]."""
FIRST = 3.0
"""Deadline of the first joint state [s]."""


@dataclass(frozen=True, slots=True)
class Ros2ArmOptions:
    """What the cell file says of the arm.

    Attributes:
        joints: of the robot's description, by their names in ROS 2.
        states, commands: topics.
        lead: how far ahead of the arm it is told what to do [s].
        silence: no joint states for so long: the arm is lost [s].
        supervision: how far the arm is believed.
    """

    joints: tuple[str, ...]
    states: str = "/joint_states"
    commands: str = "/joint_trajectory_controller/joint_trajectory"
    lead: float = 0.15
    silence: float = 0.1
    supervision: Supervision = field(default_factory=Supervision)


class Ros2Arm(Device):
    """The arm. Joints in the order of the robot's description."""

    interfaces = (Arm,)
    outlives = True

    def __init__(
        self,
        wire: RosNode,
        clock: Clock,
        description: Path,
        limits: ArmLimits,
        options: Ros2ArmOptions,
        name: str = "arm",
        host_time: Callable[[], float] = time.time,
    ) -> None:
        super().__init__(name)
        self.description, self.limits, self.options = description, limits, options
        self._wire, self._clock, self._host_time = wire, clock, host_time
        self._lock = threading.Lock()  # of latched, problem and motion; nobody waits with it
        self._owner = Owner(name, self.step, self._failed, clock)
        self._supervisor = MotionSupervisor(name, limits, options.supervision)
        self._feed = JointFeed(name, wire, options.states, options.joints, clock, options.silence, host_time)
        self._coder = coder(TRAJECTORY)
        self._state: ArmState | None = None
        self._lost = True  # no joints that can be believed now
        self._doubted = False  # nor at some time since the last acknowledgement
        self._motion: PathMotion | None = None
        self._path: RollingPath | None = None
        self._say_at = -np.inf
        self._latched: str | None = None
        self._problem: DeviceError | None = None

    # ---------------------------------------------------------------------------------------- connection

    def connect(self, deadline: float = FIRST) -> None:
        """Wait for the first joint states; nothing is sent.

        Raises:
            DeviceLost: none came, or they cannot be true.
        """
        end = self._clock.now() + deadline
        while self._state is None:
            sample = self._feed.newest(PATIENCE)
            if sample is not None:
                self._believe(sample.stamp, sample.q, sample.qd)
            elif self._clock.now() > end:
                self._feed.check()
                raise DeviceLost(self.name, f"no joints on {self.options.states} within {deadline:g} s")

    def start(self) -> None:
        """Serve the arm in a thread of its own from now on."""
        self._owner.start()

    def step(self) -> None:
        """Serve the arm for a moment; its own thread calls this without end."""
        try:
            sample = self._feed.newest(PATIENCE)
            if sample is not None:
                self._believe(sample.stamp, sample.q, sample.qd)
            self._feed.check()
        except DeviceLost as error:
            self._doubt(error)
        if self._path is not None:
            self._tell(self._path)
        self._watch_motion()

    def _failed(self, error: BaseException) -> None:
        """The driver itself is wrong: the arm brakes, and nobody goes on."""
        found = error if isinstance(error, DeviceError) else DeviceFault(self.name, f"the driver failed: {error!r}")
        self._blame(found)
        self._abandon(found.message)

    # ----------------------------------------------------------------------------------------- the wire

    def _believe(self, stamp: float, q: Float64, qd: Float64 | None) -> None:
        """Take over what the joints say.

        Raises:
            DeviceLost: it cannot be true.
        """
        before = self._state
        if qd is None:
            elapsed = 0.0 if before is None else stamp - before.stamp
            qd = (q - before.q) / elapsed if before is not None and 0.0 < elapsed < 0.2 else np.zeros_like(q)
        self._lost = True
        self._supervisor.on_feedback(stamp, q, qd)
        self._lost = False
        self._state = ArmState(stamp, q, qd, self._motion is not None and not self._motion.at_rest)

    def _doubt(self, error: DeviceLost) -> None:
        """Brake on the path: that needs no feedback."""
        self._lost, self._doubted = True, True
        self._blame(error)
        if self._motion is not None:
            self._motion.fail(error.message)

    def _blame(self, problem: DeviceError) -> None:
        """Latch a problem until somebody acknowledges it; the first is kept."""
        with self._lock:
            if self._problem is None:
                self._problem = problem

    def _tell(self, path: RollingPath) -> None:
        now = self._clock.now()
        try:
            path.go_on()
        except OutOfSetPointsError as error:
            self._blame(error)
            self._abandon(error.message)  # what was said last brings it to rest
            return
        if now >= self._say_at and not path.played:
            self._say_at = now + SAY
            self._send(path.window())

    def _send(self, points: Sequence[SetPoint]) -> None:
        """A trajectory that begins with the first point, whose time it carries."""
        now, wall = self._clock.now(), self._host_time()
        first = points[0].due
        told = [
            {
                "positions": point.q,
                "velocities": point.qd,
                "time_from_start": stamped(point.due - first),
            }
            for point in points
        ]
        header = {"stamp": stamped(wall + first - now), "frame_id": ""}
        fields = {"header": header, "joint_names": list(self.options.joints), "points": told}
        self._wire.publish(self.options.commands, TRAJECTORY, self._coder.coded(fields), round(wall * 1e9))

    def _watch_motion(self) -> None:
        motion, path, state = self._motion, self._path, self._state
        if motion is None or motion.settled or state is None:
            self._path = None
            self._supervisor.end()
            return
        # Joints in doubt say nothing about rest either: what was said is over, then.
        resting = bool(np.abs(state.qd).max() < AT_REST) if not self._doubted else path is None or path.played
        if path is None:
            motion.settled = resting and motion.state is MotionState.FAILED  # else it has not begun yet
            return
        if path.played:
            motion.look(resting, float(np.abs(state.q - path.q_last).max()), self._clock.now())
        now = self._clock.now()
        if not (motion.settled or self._doubted) and self._supervisor.due(now):
            try:
                self._supervisor.look(now, motion, path.told)
            except DeviceLost as error:
                self._doubt(error)
            except DeviceFault as error:
                self._blame(error)
                self._abandon(error.message)
                self._hold_here(state)

    def _hold_here(self, state: ArmState) -> None:
        """An arm that goes elsewhere than it was told stays where it is."""
        self._send([SetPoint(self._clock.now() + HOLD, state.q, np.zeros_like(state.q))])

    def _abandon(self, problem: str) -> None:
        """Nothing more of the motion is said."""
        self._path = None
        self._supervisor.end()
        if self._motion is not None:
            self._motion.abandon(problem)

    # -------------------------------------------------------------------------------------- the interface

    def state(self) -> ArmState:
        """As the Protocol says.

        Raises:
            DeviceLost: there is no fresh state.
        """
        if self._lost or self._state is None:
            raise DeviceLost(self.name, _words(self._problem))
        return self._state

    def follow(self, trajectory: Trajectory) -> Motion:
        with self._lock:
            if self._latched is not None:
                raise MotionRefused(self.name, f"latched in the safe state ({self._latched})")
            if self._problem is not None or self._state is None:
                raise MotionRefused(self.name, f"not ready: {_words(self._problem)}")
            if self._motion is not None and not self._motion.settled:
                raise MotionRefused(self.name, "still moves; stop the motion and wait until it has settled")
            q = self._state.q
            try:
                check_trajectory(trajectory, self.limits, q)
            except BadTrajectory as bad:
                raise MotionRefused(self.name, bad.problem) from bad
            motion = self._motion = PathMotion(trajectory, self.limits, PERIOD)
        self._owner.post(lambda: self._begin(motion, trajectory.q[0], q))
        return PostedMotion(motion, self._owner)

    def _begin(self, motion: PathMotion, q_start: Float64, q_arm: Float64) -> None:
        """Begin a motion, unless the arm was stopped or lost since it was asked for."""
        problem = self._latched or (_words(self._problem) if self._problem is not None else None)
        if problem is not None:
            motion.abandon(problem)
            motion.settled = True
            return
        self._supervisor.end()
        self._say_at = -np.inf
        self._path = RollingPath(
            self.name, motion, q_start, q_arm, self._clock, self.options.lead, self._supervisor.command
        )

    # ---------------------------------------------------------------------------------------- the device

    def link(self) -> str:
        return "ok" if self._problem is None else self._problem.message

    def last_seen(self) -> float | None:
        return None if self._state is None else self._state.stamp

    def check(self) -> None:
        problem = self._problem
        if problem is not None:
            raise problem
        self._owner.check()

    def safe_stop(self, reason: str) -> None:
        with self._lock:
            if self._latched is None:
                self._latched = reason
            motion = self._motion
        if motion is not None:
            self._owner.post(motion.stop)

    def acknowledge(self) -> None:
        """Release the latch.

        Raises:
            DeviceLost: no joints come that can be believed.
        """
        with self._lock:
            if self._lost:
                raise DeviceLost(self.name, f"is still lost: {_words(self._problem)}")
            self._latched = self._problem = None
        self._owner.post(self._begin_anew)

    def _begin_anew(self) -> None:
        self._doubted = False
        if self._motion is None or self._motion.settled:
            self._supervisor.forget()

    def pause(self) -> None:
        motion = self._motion
        if motion is not None:
            self._owner.post(motion.pause)

    def resume(self) -> None:
        motion = self._motion
        if motion is not None:
            self._owner.post(motion.resume)

    def settled(self) -> bool:
        motion, path = self._motion, self._path
        if motion is None or motion.settled:
            return True
        return motion.at_rest and path is not None and path.played

    def close(self) -> None:
        """Come to rest on the path, then leave."""
        self.safe_stop("closed")
        end = self._clock.now() + 2.0
        while not self.settled() and self._clock.now() < end:
            self._clock.advance(0.02)
        self._owner.close()
        self._problem = DeviceLost(self.name, "is closed")
        self._wire.close()


def _words(problem: DeviceError | None) -> str:
    return problem.message if problem is not None else "no joints have come"


# ------------------------------------------------------------------------------------------------ cell file


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2ArmFile:
    """An arm behind a joint_trajectory_controller of ros2_control."""

    address: str = value(Text(), ADDRESS, "HOST:PORT of rmw_zenoh's router")
    robot: Path = value(PathTo("file"), help="the robot's description (MJCF or URDF), with its limits")
    joints: tuple[str, ...] = value(Words(), help="the description's joints, by their names in ROS 2")
    states: str = value(Text(), "/joint_states", "topic of sensor_msgs/JointState")
    commands: str = value(
        Text(), "/joint_trajectory_controller/joint_trajectory", "topic of trajectory_msgs/JointTrajectory"
    )
    lead: float = value(Measure(TIME, "40 ms", "700 ms"), "150 ms", "how far ahead of the arm it is told what to do")
    silence: float = value(Measure(TIME, "20 ms", "1 s"), "100 ms", "no joint states for so long: the arm is lost")
    supervision: Supervision = value(Section(Supervision), Supervision(), "how far the arm is believed")

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address} {self.commands}",)

    def problems(self) -> Iterator[Problem]:
        try:
            read_limits(self.robot, len(self.joints))
        except UnusableRobotFile as error:
            yield Problem("robot", str(error))

    def known(self) -> Iterator[object]:
        yield read_limits(self.robot, len(self.joints))


@driver(Ros2Arm, Ros2ArmFile)
def connect(settings: Settings[Ros2ArmFile], context: ConnectContext) -> Ros2Arm:
    """Listen to the arm that a cell file describes; nothing moves."""
    said = settings.values
    options = Ros2ArmOptions(said.joints, said.states, said.commands, said.lead, said.silence, said.supervision)
    limits = read_limits(said.robot, len(said.joints))
    wire = Ros2Peer(said.address, node="pomona_arm")
    arm = Ros2Arm(wire, context.clock, said.robot, limits, options)
    try:
        arm.connect()
    except DeviceLost as error:
        wire.close()
        hint = "does joint_state_broadcaster run on rmw_zenoh? `ros2 topic echo` shows the names of the joints"
        raise settings.error(error.message, "states", hint) from error
    arm.outside_stop = "drivers.ros2.outside:see_rest", (said.address, said.states, list(said.joints), AT_REST)
    arm.start()
    return arm
