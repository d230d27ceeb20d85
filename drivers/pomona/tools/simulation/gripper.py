"""The simulated gripper: both fingers move alike, at a commanded speed, with a watchdog."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pomona.drivers.base.direct_gripper import DirectGripper
from pomona.drivers.base.parallel_gripper import Stop, WidthOrder
from pomona.drivers.errors import DeviceLost
from pomona.drivers.gripper_supervisor import GripperMotion, GripperSupervision
from pomona.drivers.interfaces import GripperLimits, GripperState, MotionState
from pomona.tools.simulation.scene import TIMESTEP
from pomona.tools.simulation.world import FaultyDevice, PhysicsWorld

ACCELERATION = 2.0  # of the opening, during moves [m/s²]
ARRIVED = 1e-4  # a move is done this near to its width [m]
BLOCKED = 2e-3  # fingers this far behind their set-point [m] …
STANDING = 2e-3  # … that move slower than this [m/s] …
PATIENCE = 0.05  # … for this long [s] are blocked …
PATIENCE_NEAR = 0.2  # … as are fingers nearer to it, held by something that sways, that do not arrive in this time [s]
STALE = 0.045  # a state that is older than this is none [s]; as of a WSG
# speed of runaway fingers [m/s], and time from a safe stop to the fast stop [s]
RUNAWAY = 0.03
FAST_STOP = 0.2
MOTOR_STEP = 0.5  # step of the grip force by the motor's current [N]


class SimGripper(DirectGripper, FaultyDevice):
    """Two fingers that move alike, on a spindle that holds what pushes them.

    The motor gives way elastically up to its force. The thread carries a larger push: the fingers stay within this
    distance of the set-point. The set-point does not run ahead of blocked fingers.

    Faults: `jam` (the fingers stand still), `lost` (no answer; they stop), `busy` (a move never begins nor ends),
    `runaway` (the fingers open at any command, until a safe stop has lasted a moment), `frozen` (the state does not
    change), `sticks` (the width does not change, except for noise), `not_a_number` (the width is none).
    """

    known_faults = ("jam", "lost", "busy", "runaway", "frozen", "sticks", "not_a_number")

    def __init__(
        self,
        world: PhysicsWorld,
        speed_max: float,
        force_max: float,
        watchdog: float,
        supervision: GripperSupervision | None = None,
    ) -> None:
        self._world = world
        model = world.model
        self._closed = _opening_when_closed(world)
        self._fingers = [model.joint(name) for name in ("finger_left", "finger_right")]
        stroke = float(self._fingers[0].range[1])
        self._across = abs(
            float(self._fingers[0].axis[1])
        )  # part of a finger's way that opens; the rest is forward
        limits = GripperLimits(
            self._closed, self._closed + 2.0 * stroke * self._across, speed_max, force_max
        )
        super().__init__(
            "gripper",
            world.clock,
            limits,
            acceleration=ACCELERATION,
            watchdog=watchdog,
            supervision=supervision,
        )
        self._actuator = model.actuator("gripper").id
        self._limit(force_max)
        self._joints = [int(finger.id) for finger in self._fingers]
        self._stroke = stroke
        self._address = [int(finger.qposadr[0]) for finger in self._fingers]
        self._dof = [int(finger.dofadr[0]) for finger in self._fingers]
        self._rate = self._blocked_for = self._latched_at = 0.0
        self._frozen = GripperState(0.0, 0.0, 0.0, False)
        # noise of a width that sticks [m]: without it each reading would repeat the last one exactly
        self._noise = np.random.default_rng([world.seed, 9]).normal(0.0, 2e-5, 512).tolist()
        world.before_step.append(self.step)

    def _limit(self, force: float) -> None:
        """Press with this force of one finger at most [N], from now on."""
        model = self._world.model
        drive = 2.0 * force * self._across
        self._force = force
        model.actuator_forcerange[self._actuator] = [-drive, drive]
        self._gives = drive / float(model.actuator_gainprm[self._actuator, 0])  # of each finger [m]

    def state(self) -> GripperState:
        state = self._read()
        if self._state is None or math.isfinite(state.width):  # NaN is no state
            self._state = state
        return self._state

    def _read(self) -> GripperState:
        state = self._measure()
        if self.fault == "frozen":
            return self._frozen
        return replace(state, width=math.nan) if self.fault == "not_a_number" else state

    def _measure(self) -> GripperState:
        state = self._world.state
        if self.fault == "sticks":
            width = self._frozen.width + self._noise[self._world.clock.steps % len(self._noise)]
            speed = 0.0
        else:
            width = self._closed + self._across * float(sum(state.qpos[self._address]))
            speed = self._across * float(sum(state.qvel[self._dof]))
        motor_force = MOTOR_STEP * round(
            -float(state.actuator_force[self._actuator]) / self._across / MOTOR_STEP
        )
        return GripperState(
            self._clock.now(), width, speed, not self.settled(), motor_force, aim=self._aim
        )

    def check(self) -> None:
        silent = self._clock.now() - self.state().stamp
        if silent > STALE and self.fault != "lost":
            self._lose(DeviceLost(self.name, f"has not sent its width for {1e3 * silent:.0f} ms"))
        super().check()

    def inject_fault(self, kind: str) -> None:
        self._frozen = self._measure()
        super().inject_fault(kind)
        if kind == "lost":
            self._lose(DeviceLost(self.name, "does not answer"))

    def safe_stop(self, reason: str) -> None:
        if self._latched is None:
            self._latched_at = self._clock.now()
        super().safe_stop(reason)

    def acknowledge(self) -> None:
        self._lost = self.fault == "lost"
        super().acknowledge()

    def settled(self) -> bool:
        """Return True at rest. Force control does not count as motion: it may go on for hours."""
        if self.fault == "runaway" and self._runs_away():
            return False
        move = self._move
        return (
            move is None
            or move.settled
            or (move.state is MotionState.PAUSED and abs(self._rate) < 1e-6)
        )

    def step(self) -> None:
        """Command the opening's rate for this step, shared between the fingers."""
        set_point = self._closed + 2.0 * self._across * float(self._world.state.act[0])
        self._end_stale_stream(self._clock.now())
        move = self._move
        order = self._wanted
        if not isinstance(order, Stop):
            force = order.force if isinstance(order, WidthOrder) else self.limits.force_max
            if force != self._force:
                self._limit(force)
        wanted = (
            self._speed if move is None or move.settled else self._rate_of_move(move, set_point)
        )
        if self.fault in ("jam", "lost", "busy"):
            wanted = 0.0
        elif self.fault == "runaway" and self._runs_away():
            wanted = RUNAWAY
        self._rate = wanted
        self._hold(wanted)

    def _hold(self, wanted: float) -> None:
        """Drive the set-point, unless it pulls with the motor's whole force already; limit the fingers to its give."""
        state = self._world.state
        set_point = float(state.act[0])
        fingers = state.qpos[
            self._address
        ]  # the one that gives way more takes the thread's push first
        ahead = set_point - float(fingers.max() if wanted < 0.0 else fingers.min())
        rate = 0.5 * wanted / self._across
        state.ctrl[self._actuator] = (
            0.0 if abs(ahead) >= self._gives and ahead * wanted > 0.0 else rate
        )
        self._world.model.jnt_range[self._joints] = (
            max(set_point - self._gives, 0.0),
            min(set_point + self._gives, self._stroke),
        )

    def _runs_away(self) -> bool:
        return self._latched is None or self._clock.now() - self._latched_at < FAST_STOP

    def _rate_of_move(self, move: GripperMotion, set_point: float) -> float:
        state = self._measure()
        measured = state.width
        speed = state.speed
        move.measured = measured
        left = move.width - set_point
        if self.fault == "busy":
            return 0.0
        resting = abs(speed) < STANDING
        blocked = min(BLOCKED, 1.8 * self._across * self._gives)
        far = (abs(set_point - measured) > blocked and resting) or self.fault == "jam"
        near = abs(left) < ARRIVED / 4.0
        self._blocked_for = self._blocked_for + TIMESTEP if far or near else 0.0
        if self._blocked_for > (PATIENCE if far else PATIENCE_NEAR):
            self._end_move(
                MotionState.FAILED, f"the fingers are blocked at {1e3 * measured:.1f} mm"
            )
            return 0.0
        if abs(left) < ARRIVED / 4.0 and abs(move.width - measured) < ARRIVED:
            self._end_move(MotionState.DONE)
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
    left, right = (
        world.model.site(name).pos + world.model.body(name).pos
        for name in ("pad_left", "pad_right")
    )
    return float(abs(left[1] - right[1]))
