"""A parallel gripper behind ros2_control as a `Gripper` (`driver: ros2-gripper`): a joint's state in, its position out.

The controller is a forward_command_controller for a position. Moves and streamed speeds become position set-points
that advance at the commanded speed, at most `ahead` of the measured opening: this bounds the fingers' force, and they
come to rest when no more set-points arrive. Implausible states, silence, and fingers that do not follow their
set-points are latched until acknowledged.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from pomona.devices.ros2.joints import JointFeed, JointSample, RosNode
from pomona.drivers import (
    ConnectContext,
    Device,
    DeviceError,
    DeviceFault,
    DeviceLost,
    Gripper,
    GripperLimits,
    GripperMotion,
    GripperState,
    GripperSupervision,
    GripperSupervisor,
    MotionRefused,
    MotionState,
    Owner,
    Settings,
    Watchdog,
    allowed_speed,
    driver,
    require_move,
)
from pomona.executive import FORCE, LENGTH, SPEED, TIME, Clock, Measure, Number, Problem, Section, Span, Text, value
from pomona.tools.ros2.peer import ADDRESS, Ros2Peer
from pomona.tools.ros2.types import coder

COMMAND = "std_msgs/msg/Float64MultiArray"
PATIENCE = 0.004  # receive timeout [s]
SET_POINT_PERIOD = 0.01  # period of the set-points while anything moves [s]
ARRIVED = 1e-3  # position tolerance: fingers this close to their target have arrived [m]
BLOCKED = 0.2  # fingers at rest off their target for this long, beyond the allowed lag, are blocked [s]
SPEED_WINDOW = 0.04  # window of a speed by differences [s], without velocities: positions are quantised
FIRST_STATE = 3.0  # deadline for the first joint state [s]
ACCELERATION = 1.0  # assumed acceleration of the set-point for the supervisor [m/s²]; real fingers are quicker


@dataclass(frozen=True, slots=True)
class Ros2GripperOptions:
    """Options of the gripper in the cell file."""

    joint: str  # its name in ROS 2
    # scale, finger_offset: opening = finger_offset + scale · position; scale 2 where two fingers each move by it
    scale: float = 1.0
    finger_offset: float = 0.0
    states: str = "/joint_states"  # states, commands: topics of joint states and of position commands
    commands: str = "/gripper_controller/commands"
    ahead: float = 0.01  # how far the set-point may lead the measured opening [m]
    watchdog: float = 0.1  # a streamed speed that is not renewed within this time becomes zero [s]
    silence: float = 0.1  # without a joint state for this long the gripper is lost [s]
    supervision: GripperSupervision = field(default_factory=GripperSupervision)


class Ros2Gripper(Device):
    """The gripper. One thread owns the set-point; requests are posted to it."""

    interfaces = (Gripper,)
    outlives = True

    def __init__(
        self,
        wire: RosNode,
        clock: Clock,
        limits: GripperLimits,
        options: Ros2GripperOptions,
        name: str = "gripper",
        host_time: Callable[[], float] = time.time,
    ) -> None:
        super().__init__(name)
        self.limits, self.options = limits, options
        self._wire, self._clock, self._host_time = wire, clock, host_time
        self._lock = threading.Lock()  # of latched, problem and the requested move
        self._owner = Owner(name, self.step, self._failed, clock)
        self._feed = JointFeed(name, wire, options.states, (options.joint,), clock, options.silence, host_time)
        self._coder = coder(COMMAND)
        self._supervisor = GripperSupervisor(limits, ACCELERATION, options.supervision)
        self._state: GripperState | None = None
        self._lost, self._lost_since_ack = True, False
        self._widths: list[tuple[float, float]] = []
        self._set_point: float | None = None  # None: nothing was commanded yet, or the last command is no longer known
        self._move: GripperMotion | None = None
        self._speed = 0.0
        self._aim: float | None = None
        self._watchdog = Watchdog(options.watchdog)
        self._stepped_at = self._sent_at = clock.now()
        self._sent: float | None = None
        self._off_target_since = math.inf
        self._latched: str | None = None
        self._problem: DeviceError | None = None

    # ---------------------------------------------------------------------------------------- connection

    def connect(self, deadline: float = FIRST_STATE) -> None:
        """Wait for the first state; nothing is sent. Raises DeviceLost: none came; DeviceFault: it is implausible."""
        end = self._clock.now() + deadline
        self._supervisor.rest(self._clock.now())
        while self._state is None:
            sample = self._feed.newest(PATIENCE)
            if sample is not None:
                self._believe(sample)
            elif self._clock.now() > end:
                self._feed.check()
                raise DeviceLost(self.name, f"no joints on {self.options.states} within {deadline:g} s")
        if self._problem is not None:
            raise self._problem

    def start(self) -> None:
        """Serve the gripper in a thread of its own from now on."""
        self._owner.start()

    def step(self) -> None:
        """Serve the gripper once; its own thread calls this in a loop."""
        sample = self._feed.newest(PATIENCE)
        now = self._clock.now()
        try:
            if sample is not None:
                self._believe(sample)
            self._feed.check()
        except DeviceLost as error:
            self._lose(error)
        if self._state is not None and not self._lost:
            wrong = self._supervisor.look(now, self._state)
            if wrong:
                self._fail(wrong)
            self._advance(now, self._state)
            self._watch_move(self._state)
        self._stepped_at = now

    def _failed(self, error: BaseException) -> None:
        self._lose(error if isinstance(error, DeviceError) else DeviceFault(self.name, f"the driver failed: {error!r}"))

    # ------------------------------------------------------------------------------------------ the wire

    def _believe(self, sample: JointSample) -> None:
        options = self.options
        width = options.finger_offset + options.scale * float(sample.q[0])
        if sample.qd is not None:
            speed = options.scale * float(sample.qd[0])
        else:
            lately = [(t, w) for t, w in self._widths if t >= sample.stamp - SPEED_WINDOW]
            self._widths = [*(lately or self._widths[-1:]), (sample.stamp, width)]
            then, before = self._widths[0]
            elapsed = sample.stamp - then
            speed = (width - before) / elapsed if elapsed > 0.5 * SPEED_WINDOW else 0.0
        moving = self._move is not None and not self._move.settled
        state = GripperState(sample.stamp, width, speed, moving, aim=self._aim)
        wrong = self._supervisor.look(self._clock.now(), state)
        if wrong:
            self._fail(wrong)
            if not (math.isfinite(width) and math.isfinite(speed)):
                return  # NaN is no state
        self._lost, self._state = False, state

    def _advance(self, now: float, state: GripperState) -> None:
        if self._set_point is None:
            return
        elapsed = min(max(now - self._stepped_at, 0.0), 2.0 * SET_POINT_PERIOD)  # no jump after a stall of this thread
        move = self._move
        if move is not None and move.state is MotionState.RUNNING:
            way = move.width - self._set_point
            wanted = self._set_point + math.copysign(min(abs(way), move.speed * elapsed), way)
        else:
            if self._watchdog.has_expired(now):
                self._stream(0.0)
            wanted = self._set_point + self._speed * elapsed
        wanted = min(max(wanted, self.limits.width_min), self.limits.width_max)
        ahead = self.options.ahead
        if wanted < self._set_point:
            wanted = min(max(wanted, state.width - ahead), self._set_point)
        elif wanted > self._set_point:
            wanted = max(min(wanted, state.width + ahead), self._set_point)
        self._set_point = wanted
        # period at which a set-point that does not change is repeated [s], in case one was lost on the way
        if now - self._sent_at >= (SET_POINT_PERIOD if wanted != self._sent else 0.1):
            self._publish(wanted)

    def _publish(self, width: float) -> None:
        self._sent, self._sent_at = width, self._clock.now()
        position = (width - self.options.finger_offset) / self.options.scale
        coded = self._coder.coded({"data": [position]})
        self._wire.publish(self.options.commands, COMMAND, coded, round(self._host_time() * 1e9))

    # --------------------------------------------------------------------------------------- what is done

    def _begin(self, move: GripperMotion) -> None:
        """Start a move, unless a stop or a loss came first."""
        refusal = self._unready()
        if refusal:
            move.end(MotionState.FAILED, f"{self.name}: {refusal}")
            move.settled = True
            return
        state = self._state
        assert state is not None, "ready"
        if self._move is not None and self._move is not move:
            self._move.end(MotionState.STOPPED)
            self._move.settled = True
        self._move, self._speed, self._off_target_since = move, 0.0, math.inf
        self._aim = move.width
        self._set_point = state.width if self._set_point is None else self._set_point
        self._supervisor.move(self._clock.now(), state.width, move.width, move.speed)

    def _stop(self, move: GripperMotion) -> None:
        if not move.ended:
            move.end(MotionState.STOPPED)
            if move is self._move:
                self._rest()

    def _rest(self) -> None:
        """Freeze the set-point: fingers that hold something keep holding it."""
        self._speed = 0.0
        self._supervisor.rest(self._clock.now())

    def _stream(self, speed: float) -> None:
        if speed != self._speed or speed:
            self._speed = speed
            self._supervisor.stream(self._clock.now(), speed, self.options.watchdog)

    def _take_speed(self, speed: float) -> None:
        """While latched the fingers may close and hold but not open."""
        if self._lost or self._lost_since_ack or self._state is None:
            return
        wanted = allowed_speed(speed, self.limits, self._latched is not None)
        if self._move is not None and not self._move.ended:
            self._stop(self._move)
        self._aim = None
        self._set_point = self._state.width if self._set_point is None else self._set_point
        self._watchdog.renew(self._clock.now())
        self._stream(wanted)

    def _watch_move(self, state: GripperState) -> None:
        move = self._move
        if move is None or move.settled:
            return
        move.measured = state.width
        if move.state is MotionState.RUNNING:
            off_target = abs(state.width - move.width)
            if off_target < ARRIVED and self._set_point == move.width and self._supervisor.at_rest:
                move.end(MotionState.DONE)
                self._rest()
            elif not self._supervisor.at_rest or abs((self._set_point or 0.0) - state.width) < ARRIVED:
                self._off_target_since = math.inf
            else:
                self._off_target_since = min(self._off_target_since, state.stamp)
                if state.stamp - self._off_target_since > self.options.supervision.lag + BLOCKED:
                    move.end(MotionState.FAILED, f"the fingers are blocked at {1e3 * state.width:.1f} mm")
                    self._rest()
        if move.ended and self._supervisor.at_rest:
            move.settled = True

    def _fail(self, words: str) -> None:
        """The gripper misbehaves: its move has failed, and the set-point is frozen."""
        self._blame(DeviceFault(self.name, words))
        if self._move is not None and not self._move.ended:
            self._move.end(MotionState.FAILED, f"{self.name}: {words}")
        self._rest()

    def _lose(self, error: DeviceError) -> None:
        """Send nothing more: the controller holds the last set-point."""
        if not self._lost or self._problem is None:
            self._blame(error)
            if self._move is not None:
                self._move.end(MotionState.FAILED, f"the gripper was lost: {error.message}")
                self._move.settled = True  # its state is unknown
            self._rest()
        self._lost = self._lost_since_ack = True
        self._set_point = None

    def _blame(self, problem: DeviceError) -> None:
        """Latch a problem until it is acknowledged; the first one is kept."""
        with self._lock:
            if self._problem is None:
                self._problem = problem

    def _unready(self) -> str:
        if self._latched is not None:
            return f"latched in the safe state ({self._latched})"
        if self._lost or self._problem is not None:
            return f"not ready: {_words(self._problem)}"
        return ""

    # --------------------------------------------------------------------------------------- the interface

    def state(self) -> GripperState:
        """See the Protocol. Raises DeviceLost: there is no fresh state."""
        if self._lost or self._state is None:
            raise DeviceLost(self.name, _words(self._problem))
        return self._state

    def move(self, width: float, speed: float) -> GripperMotion:
        limits, refusal = self.limits, self._unready()
        if refusal:
            raise MotionRefused(self.name, refusal)
        require_move(self.name, limits, width, speed)
        width = min(max(width, limits.width_min), limits.width_max)
        move = GripperMotion(width, min(speed, limits.speed_max), self.state().width, self._leave_stop)
        self._owner.post(lambda: self._begin(move))
        return move

    def _leave_stop(self, move: GripperMotion) -> None:
        self._owner.post(lambda: self._stop(move))

    def set_speed(self, speed: float) -> None:
        """See the Protocol; while latched the fingers may close and hold but not open.

        Raises DeviceLost: the gripper is lost, or was lost and that is not acknowledged yet.
        """
        if self._lost or self._lost_since_ack:
            raise DeviceLost(self.name, f"was lost; acknowledge the loss before it moves: {_words(self._problem)}")
        self._owner.post(lambda: self._take_speed(speed))

    # ------------------------------------------------------------------------------------------ the device

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
        self._owner.post(self._stop_safely)

    def _stop_safely(self) -> None:
        if self._move is not None:
            self._move.end(MotionState.STOPPED)
        self._rest()

    def acknowledge(self) -> None:
        """Release the latch; the fingers stay where they are. Raises DeviceLost: no states come."""
        if self._lost:
            raise DeviceLost(self.name, f"is still lost: {_words(self._problem)}")
        self._owner.ask(self._release)

    def _release(self) -> None:
        self._supervisor.rest(self._clock.now())
        with self._lock:
            self._latched = self._problem = None
        self._lost_since_ack = False

    def pause(self) -> None:
        self._owner.post(self._pause)

    def _pause(self) -> None:
        if self._move is not None and self._move.state is MotionState.RUNNING:
            self._move.state = MotionState.PAUSED
            self._rest()

    def resume(self) -> None:
        self._owner.post(self._resume)

    def _resume(self) -> None:
        if self._move is not None and self._move.state is MotionState.PAUSED:
            self._move.state = MotionState.RUNNING
            self._begin(self._move)

    def settled(self) -> bool:
        """Return True if the fingers were measured at rest. Streamed speeds do not count as motion."""
        if self._lost:
            return self._clock.now() > self._supervisor.rest_by
        move = self._move
        ended = move is None or move.settled or move.state is MotionState.PAUSED
        return ended and (self._supervisor.at_rest if not self._speed else self._supervisor.follows)

    def close(self) -> None:
        """Disconnect; the fingers stay where they are."""
        self.safe_stop("closed")
        self._owner.close()
        self._problem = DeviceLost(self.name, "is closed")
        self._wire.close()


def _words(problem: DeviceError | None) -> str:
    return problem.message if problem is not None else "no joints have come"


# ------------------------------------------------------------------------------------------------ cell file


@dataclass(frozen=True, slots=True, kw_only=True)
class Ros2GripperFile:
    """A parallel gripper behind a forward_command_controller of ros2_control."""

    address: str = value(Text(), ADDRESS, "HOST:PORT of rmw_zenoh's router")
    joint: str = value(Text(), help="name of the gripper's joint in ROS 2")
    scale: float = value(Number(-1e3, 1e3), 1.0, "metres of opening per unit of the joint; two fingers: 2")
    finger_offset: float = value(Measure(LENGTH, "-200 mm", "500 mm"), "0 mm", "opening with the joint at zero")
    opening: tuple[float, float] = value(Span(Measure(LENGTH, "0 mm", "500 mm")), help="least and largest opening")
    speed_max: float = value(Measure(SPEED, "1 mm/s", "1 m/s"), "50 mm/s", "largest speed of the opening")
    force_max: float = value(Measure(FORCE, "0.1 N", "500 N"), "20 N", "force of one finger, as set in its controller")
    states: str = value(Text(), "/joint_states", "topic of sensor_msgs/JointState")
    commands: str = value(Text(), "/gripper_controller/commands", "topic of std_msgs/Float64MultiArray: a position")
    ahead: float = value(
        Measure(LENGTH, "1 mm", "50 mm"), "10 mm", "how far the set-point may lead the measured opening"
    )
    watchdog: float = value(
        Measure(TIME, "30 ms", "1 s"), "100 ms", "a streamed speed that is not renewed within this time becomes zero"
    )
    silence: float = value(
        Measure(TIME, "20 ms", "1 s"), "100 ms", "without a joint state for this long the gripper is lost"
    )
    supervision: GripperSupervision = value(
        Section(GripperSupervision), GripperSupervision(), "how closely the gripper must follow its commands"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address} {self.commands}",)

    def problems(self) -> Iterator[Problem]:
        if abs(self.scale) < 1e-6:
            yield Problem("scale", "it cannot be zero")
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
    )
    limits = GripperLimits(*said.opening, said.speed_max, said.force_max)
    wire = Ros2Peer(said.address, node="pomona_gripper")
    gripper = Ros2Gripper(wire, context.clock, limits, options)
    try:
        gripper.connect()
    except DeviceError as error:
        wire.close()
        hint = "is joint_state_broadcaster running on rmw_zenoh? `ros2 topic echo` shows the joints' names"
        raise settings.error(error.message, "states", hint) from error
    slow = 2e-3 / abs(said.scale)
    gripper.outside_stop = "pomona.devices.ros2.outside:see_rest", (said.address, said.states, [said.joint], slow)
    gripper.start()
    return gripper
