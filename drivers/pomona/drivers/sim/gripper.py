"""The simulated gripper: both fingers move alike, at a commanded speed, with a watchdog."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pomona.drivers.errors import DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.gripper_motion import DirectMotion, allowed_speed, require_move
from pomona.drivers.gripper_supervisor import GripperSupervision, GripperSupervisor
from pomona.drivers.interfaces import Gripper, GripperLimits, GripperState, Motion, MotionState
from pomona.drivers.sim.scene import TIMESTEP
from pomona.drivers.sim.world import FaultyDevice, PhysicsWorld
from pomona.drivers.watchdog import Watchdog

ACCELERATION = 2.0  # of the opening, during moves [m/s²]
ARRIVED = 1e-4  # a move is done this near to its width [m]
BLOCKED = 2e-3  # fingers this far behind their set-point [m] …
STANDING = 2e-3  # … that move slower than this [m/s] …
PATIENCE = 0.05  # … for this long [s] are blocked …
PATIENCE_NEAR = 0.2  # … as are resting fingers nearer to it that do not arrive in this time [s]
STALE = 0.045  # a state that is older than this is none [s]; as of a WSG
RUNAWAY, FAST_STOP = 0.03, 0.2  # speed of runaway fingers [m/s], and time from a safe stop to the fast stop [s]
MOTOR_STEP = 0.5  # step of the grip force by the motor's current [N]


ESTRANGED = "was lost; acknowledge the loss before it moves"


class SimGripper(FaultyDevice):
    """Two fingers that move alike.

    Faults: `jam` (the fingers stand still), `lost` (no answer; they stop), `busy` (a move never begins nor ends),
    `runaway` (the fingers open at any command, until a safe stop has lasted a moment), `frozen` (the state does not
    change), `sticks` (the width does not change, except for noise), `not_a_number` (the width is none).
    """

    interfaces = (Gripper,)
    known_faults = ("jam", "lost", "busy", "runaway", "frozen", "sticks", "not_a_number")

    def __init__(
        self,
        world: PhysicsWorld,
        speed_max: float,
        force_max: float,
        watchdog: float,
        supervision: GripperSupervision | None = None,
    ) -> None:
        super().__init__("gripper")
        self._world, self._watchdog = world, Watchdog(watchdog)
        model = world.model
        self._closed = _opening_when_closed(world)
        self._fingers = [model.joint(name) for name in ("finger_left", "finger_right")]
        stroke = float(self._fingers[0].range[1])
        self.limits = GripperLimits(self._closed, self._closed + 2.0 * stroke, speed_max, force_max)
        self._actuator = model.actuator("gripper").id
        model.actuator_forcerange[self._actuator] = [-2.0 * force_max, 2.0 * force_max]
        self._address = [int(finger.qposadr[0]) for finger in self._fingers]
        self._dof = [int(finger.dofadr[0]) for finger in self._fingers]
        self._speed, self._rate = 0.0, 0.0
        self._aim: float | None = None
        self._move: DirectMotion | None = None
        self._blocked_for = 0.0
        self._paused = False
        self._latched: str | None = None
        self._latched_at = 0.0
        self._lost_since_ack = False  # lost since the last acknowledgement
        self._frozen = GripperState(0.0, 0.0, 0.0, False)
        # noise of a width that sticks [m]: without it each reading would repeat the last one exactly
        self._noise = np.random.default_rng([world.seed, 9]).normal(0.0, 2e-5, 512).tolist()
        self._supervisor = GripperSupervisor(self.limits, ACCELERATION, supervision)
        self._supervisor.rest(world.clock.now())
        world.before_step.append(self._command)

    def state(self) -> GripperState:
        state = self._measure()
        if self.fault == "frozen":
            return self._frozen
        return replace(state, width=math.nan) if self.fault == "not_a_number" else state

    def _measure(self) -> GripperState:
        state = self._world.state
        if self.fault == "sticks":
            width, speed = self._frozen.width + self._noise[self._world.clock.steps % len(self._noise)], 0.0
        else:
            width = self._closed + float(state.qpos[self._address[0]] + state.qpos[self._address[1]])
            speed = float(state.qvel[self._dof[0]] + state.qvel[self._dof[1]])
        motor_force = MOTOR_STEP * round(-float(state.actuator_force[self._actuator]) / MOTOR_STEP)
        return GripperState(self._world.clock.now(), width, speed, not self.settled(), motor_force, aim=self._aim)

    def move(self, width: float, speed: float) -> Motion:
        if self._latched is not None:
            raise MotionRefused(self.name, f"latched in the safe state ({self._latched})")
        if self._lost_since_ack:
            raise MotionRefused(self.name, "does not answer" if self.fault == "lost" else ESTRANGED)
        require_move(self.name, self.limits, width, speed)
        self._end_move()
        self._speed, self._aim = 0.0, width
        now, start = self._world.clock.now(), self._measure().width
        self._supervisor.move(now, start, width, speed)
        self._move = DirectMotion(width, speed, start, lambda: self._supervisor.rest(self._world.clock.now()))
        return self._move

    def set_speed(self, speed: float) -> None:
        if self._lost_since_ack:
            raise DeviceLost(self.name, "does not answer" if self.fault == "lost" else ESTRANGED)
        self._end_move()
        self._aim = None
        now = self._world.clock.now()
        self._speed = allowed_speed(speed, self.limits, self._latched is not None)
        self._watchdog.renew(now)
        self._supervisor.stream(now, self._speed, self._watchdog.limit)

    def check(self) -> None:
        now, state = self._world.clock.now(), self.state()
        if self.fault == "lost":
            raise DeviceLost(self.name, "does not answer")
        if now - state.stamp > STALE:
            raise DeviceLost(self.name, f"has not sent its width for {1e3 * (now - state.stamp):.0f} ms")
        wrong = self._supervisor.look(now, state)
        if wrong:
            raise DeviceFault(self.name, wrong)

    def inject_fault(self, kind: str) -> None:
        self._frozen = self._measure()
        super().inject_fault(kind)
        self._lost_since_ack = self._lost_since_ack or kind == "lost"

    def safe_stop(self, reason: str) -> None:
        if self._latched is None:
            self._latched_at = self._world.clock.now()
        self._latched, self._paused = reason, False  # a pause ends with it
        self._end_move()
        self._speed = min(self._speed, 0.0)

    def acknowledge(self) -> None:
        self._latched = None
        self._lost_since_ack = self.fault == "lost"
        self._supervisor.rest(self._world.clock.now())

    def pause(self) -> None:
        self._paused = True
        if self._move is not None and self._move.state is MotionState.RUNNING:
            self._move.state = MotionState.PAUSED
            self._supervisor.rest(self._world.clock.now())

    def resume(self) -> None:
        self._paused = False
        if self._move is not None and self._move.state is MotionState.PAUSED:
            self._move.state = MotionState.RUNNING
            self._supervisor.move(self._world.clock.now(), self._measure().width, self._move.width, self._move.speed)

    def settled(self) -> bool:
        """Return True at rest. Force control does not count as motion: it may go on for hours."""
        if self.fault == "runaway" and self._runs_away():
            return False
        return self._move is None or self._move.settled or (self._paused and abs(self._rate) < 1e-6)

    def _end_move(self) -> None:
        if self._move is not None and not self._move.settled:
            self._move.stop()

    def _command(self) -> None:
        """The opening's rate for this step, shared between the fingers."""
        set_point = self._closed + 2.0 * float(self._world.state.act[0])
        move, now = self._move, self._world.clock.now()
        if self._watchdog.has_expired(now) and self._speed:
            self._speed = 0.0
            self._supervisor.stream(now, 0.0, self._watchdog.limit)
        wanted = self._rate_of_move(move, set_point) if move is not None and not move.settled else self._speed
        if self.fault in ("jam", "lost", "busy"):
            wanted = 0.0
        elif self.fault == "runaway" and self._runs_away():
            wanted = RUNAWAY
        self._rate = wanted
        self._world.state.ctrl[self._actuator] = 0.5 * wanted

    def _runs_away(self) -> bool:
        return self._latched is None or self._world.clock.now() - self._latched_at < FAST_STOP

    def _rate_of_move(self, move: DirectMotion, set_point: float) -> float:
        state = self._measure()
        measured, speed = state.width, state.speed
        move.measured = measured
        left = move.width - set_point
        if self.fault == "busy":
            return 0.0
        resting = abs(speed) < STANDING
        far = (abs(set_point - measured) > BLOCKED and resting) or self.fault == "jam"
        near = resting and abs(left) < ARRIVED / 4.0
        self._blocked_for = self._blocked_for + TIMESTEP if far or near else 0.0
        if self._blocked_for > (PATIENCE if far else PATIENCE_NEAR):
            move.end(MotionState.FAILED, f"the fingers are blocked at {1e3 * measured:.1f} mm")
            self._supervisor.rest(self._world.clock.now())
            return 0.0
        if abs(left) < ARRIVED / 4.0 and abs(move.width - measured) < ARRIVED:
            move.end(MotionState.DONE)
            self._supervisor.rest(self._world.clock.now())
            return 0.0
        if move.state is MotionState.PAUSED:
            target = 0.0
        else:
            target = math.copysign(min(move.speed, math.sqrt(2.0 * ACCELERATION * abs(left))), left)
            target = math.copysign(min(abs(target), abs(left) / TIMESTEP), left)
        change = ACCELERATION * TIMESTEP
        return min(max(target, self._rate - change), self._rate + change)


def _opening_when_closed(world: PhysicsWorld) -> float:
    """Return the distance of the pads' faces when the fingers' joints are at 0, from the robot's own geometry [m]."""
    left, right = (world.model.site(name).pos + world.model.body(name).pos for name in ("pad_left", "pad_right"))
    return float(abs(left[1] - right[1]))
