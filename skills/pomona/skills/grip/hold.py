"""The grip session: a controller that the sensor's stream steps until a node takes the fingers over.

A `Hold` is the value of a port. `SlipAvoidGrasp` starts it and publishes it when the fruit is held. The stream steps it
while later nodes run, through pause, failure and safe stop:

- Lift calls `show_grip(self, hold)` (pomona.skills.shared.held_fruit) each tick. `hold.holds` is True while the fruit
  is there, `hold.problem` has the reason otherwise, `hold.reading` the forces.
- Release and Retreat call `take_over(gripper)` before they move the fingers. Control ends, zero speed is commanded and
  nothing opens.
- FeelFriction commands `hold.under(gripper)`, the same session with the right to command it, which ends with the skill. A
  `Hold` from a port can only be read.

The subscription to the sensor keeps the object alive.
"""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from threading import RLock

import numpy as np

from pomona.drivers.errors import DeviceError
from pomona.drivers.interfaces import (
    Arm,
    ArmState,
    ForceSensor,
    Gripper,
    Subscription,
    WrenchSample,
)
from pomona.executive.lease import command, give_up, identity, keep, lend
from pomona.executive.values.arrays import Float64
from pomona.skills.grip.closing import PadTouch, TouchRecorder
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.grip import (
    IN_HAND,
    LIES,
    LIFTED,
    GripMode,
    GripPhase,
    GripProblem,
    GripReading,
    GripSamples,
)
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.pads import MIRROR
from pomona.skills.grip.sensor import EARLIEST, STALE_AFTER
from pomona.skills.grip.settings import GripSettings

KEPT = 2000  # recorded samples kept until `drain`: 20 s; the oldest are dropped first
TAKEN_OVER = (
    4e-4  # rise of the hand that takes a fruit's weight over [m]: 0.2 mm did in the simulated pads
)
PRESSES = 5  # samples over which a push is averaged: shorter ones bruise none
RECORDED_RATE = 100.0  # rate of the samples for viewers [Hz]

_HOLDS: weakref.WeakValueDictionary[int, Hold] = weakref.WeakValueDictionary()


class Hold:
    """A grip under control. `SlipAvoidGrasp` makes it, `take_over` ends it."""

    def __init__(
        self,
        gripper: Gripper,
        sensor: ForceSensor,
        controller: GripController,
        now: Callable[[], float],
        arm: Arm | None = None,
    ) -> None:
        """Take the fingers over from an earlier grip session and start with the next sample.

        Args:
            gripper: is commanded a speed up to 50 times a second.
            sensor: its stream steps the controller.
            controller: in its first phase.
            now: the cell's clock, for the detection of a stale stream.
            arm: moves the hand; its acceleration shows on the pads.
        """
        take_over(gripper)
        self._gripper = keep(gripper, "the grip")
        self._controller = controller
        self._now, self._started = now, now()
        self._sensor = sensor
        self._arm = arm
        self._joints: ArmState | None = None
        self._lock = RLock()
        self._ended = False
        self._device_problem: GripProblem | None = None
        self._sensor_fault_reported = self._stands = False
        self._floor: FloorWatch | None = None
        self._touches = TouchRecorder(controller.settings.loop.stiffness)
        self._record_every = max(round(controller.settings.rate / RECORDED_RATE), 1)
        self._record_period = self._record_every * controller.settings.period
        self._samples = np.zeros((KEPT, 7))
        self.peaks = np.zeros(
            7
        )  # largest of each column of `GripSamples` that `drain` has returned
        self._written = self._drained = self._seen = 0
        self._pushes = deque([np.zeros(3)], KEPT)
        _HOLDS[identity(gripper)] = self
        self._subscription: Subscription = sensor.subscribe(self._on_sample)

    # -------------------------------------------------------------------------------------------- for later nodes

    @property
    def phase(self) -> GripPhase:
        """Phase of `mode`."""
        return self.mode.phase

    @property
    def reading(self) -> GripReading:
        """The grip after the newest sample, with its timestamp."""
        reading = self._controller.reading
        return replace(reading, phase=self.phase) if self._ended else reading

    @property
    def estimate(self) -> GripEstimate:
        """Loads, slip and disturbance after the newest sample."""
        return self._controller.estimate

    @property
    def mode(self) -> GripMode:
        """Mode of the grip; ENDED after `take_over`."""
        return GripMode.ENDED if self._ended else self._controller.mode

    @property
    def settings(self) -> GripSettings:
        """Settings of the grip, with the friction that it uses now."""
        return self._controller.settings

    @property
    def bias(self) -> Float64:
        """Reading of the fingers with nothing between them, shape (2, 6) [N, N·m]; not to be changed."""
        return self._controller.bias

    @property
    def tracked_force(self) -> float:
        """Grip force that is compared with the reference [N]."""
        return self._controller.tracked_force

    @property
    def slipped(self) -> float:
        """Distance that the fruit has slid on the pads [m]."""
        return self._controller.slipped

    @property
    def turned(self) -> float:
        """Motion of the load's lever arm since it settled, while the hand keeps its direction [m]."""
        return self._controller.turned

    @property
    def press_below(self) -> float:
        """Largest force of its support on the fruit that hangs now [N]: its weight, and the pads' pushes of 20 s."""
        pushes = np.array([*self.estimate.load, 0.0]) - self._pushes
        return float(np.linalg.norm(pushes, axis=1).max())

    @property
    def has_settled(self) -> bool:
        """True when the force has fallen to the requirement of the load."""
        return self._controller.has_settled

    @property
    def is_at_rest(self) -> bool:
        """True for a carried fruit without a problem, when the force has fallen to its requirement."""
        return self._controller.is_at_rest

    @property
    def first_touches(self) -> tuple[PadTouch | None, PadTouch | None]:
        """First touch of the left and the right pad while the fingers closed; None for a pad that felt nothing."""
        left, right = self._touches.touches
        return left, right

    @property
    def holds(self) -> bool:
        """True while a fruit is held under control and has not been lost."""
        problem = self._controller.problem
        gone = problem is not None and problem.code == "LOST"
        return self.mode in IN_HAND and not gone

    @property
    def problem(self) -> GripProblem | None:
        """The most serious problem, or None; while holding, the grip is kept in spite of it."""
        if not self._ended:
            newest = max(self._controller.usable_until, self._started)
            age = self._now() - newest
            if age > STALE_AFTER:
                return GripProblem(
                    "SENSOR_STALE",
                    f"fingers: no valid sample for {1e3 * age:.0f} ms; the grip is kept as it is",
                    newest,
                    {"age_s": age},
                )
        return self._controller.problem or self._device_problem

    @property
    def ended(self) -> bool:
        """True after `take_over`."""
        return self._ended

    def under(self, gripper: Gripper) -> Hold:
        """Return the hold as its gripper's owner commands it.

        Args:
            gripper: as the skill has it; the right ends with the skill.
        """
        return lend(self, Hold, gripper)

    @command
    def slide(self, force: float | None) -> None:
        """Press with this grasp force [N] and let the pads slide; None: hold again; see `FeelFriction`."""
        with self._lock:
            self._controller.slide(force)

    @command
    def lift(self, risen: float) -> None:
        """Tell how far the hand has risen with the fruit [m]; before `TAKEN_OVER` the fruit stands, whatever it weighs."""
        self._controller.stand_until_lifted(risen < TAKEN_OVER)

    @command
    def rest_on_contact(self, contact: float | None) -> None:
        """Let the fingers rest once something else carries the fruit; None: control the force in any case.

        Force control would respond to the new support by pressing harder. No sensor fault is reported meanwhile: a
        contact may press on one finger alone. The request outlives its skill, so that after an interrupt the fruit
        stays on its floor.

        Args:
            contact: change of the load along the pads, from now on, that is a contact [N]; see `FloorWatch`.
        """
        with self._lock:
            if not self._ended:
                self._floor = None if contact is None else FloorWatch(contact)
                self._controller.rests = False

    @command
    def set_friction(
        self, contact: SoftContact, mu_uncertainty: float, initial_force: float
    ) -> None:
        """Use another friction from now on, and press with `initial_force` [N] until the fruit is carried."""
        with self._lock:
            self._controller.set_friction(contact, mu_uncertainty, initial_force)

    @command
    def take_over(self) -> None:
        """End control, so that the caller may move the fingers. Zero speed is commanded, nothing opens."""
        with self._lock:
            if self._ended:
                return
            self._ended = True
        self._subscription.close()
        if _HOLDS.get(identity(self._gripper)) is self:
            del _HOLDS[identity(self._gripper)]
        self._command(0.0)
        give_up(self._gripper, "the grip was taken over")

    @property
    def waiting(self) -> float:
        """Duration of the samples that `drain` would return [s]."""
        return min(self._written - self._drained, KEPT) * self._record_period

    def drain(self) -> GripSamples:
        """Return the samples since the last call, 100 a second, at most the last 20 s."""
        with self._lock:
            first = max(self._drained, self._written - KEPT)
            rows = self._samples[np.arange(first, self._written) % KEPT]
            self._drained = self._written
            self.peaks = np.maximum(self.peaks, rows.max(axis=0, initial=0.0))
        return GripSamples(*np.ascontiguousarray(rows.T))

    # ------------------------------------------------------------------------------------- for the sensor's stream

    def _on_sample(self, sample: WrenchSample) -> None:
        with self._lock:
            if self._ended:
                return
            controller = self._controller
            # After a gap samples may stay delayed; a delayed force loop winds up, so zero speed is commanded.
            silent = self._now() - max(controller.usable_until, self._started)
            self._stands = self._stands or (silent > STALE_AFTER and controller.mode in IN_HAND)
            if controller.wants_width:
                state = self._gripper.state()
                controller.width = state.width
                controller.motor_force = state.motor_force
                controller.acceleration = self._acceleration()
            # else all later samples would be out of order
            if sample.stamp > self._now() + EARLIEST:
                self._report_sensor_fault()
                return
            if self._floor is not None and np.isfinite(sample.wrenches).all():
                self._rest(self._floor.look(sample.wrenches))
            # a copy: the loops are compiled for arrays that can be written
            speed = controller.step(
                sample.stamp, sample.sequence, sample.wrenches.copy(), sample.saturated
            )
            if speed is not None:
                self._command(0.0 if self._stands else speed)
            if controller.mode in (GripMode.CLOSING, GripMode.RAMP) and not self._touches.complete:
                self._touches.take(
                    sample.stamp, sample.wrenches - controller.bias, self._gripper.state()
                )
            self._report_sensor_fault()
            self._seen += 1
            if self._seen % self._record_every == 0:
                if controller.mode not in LIFTED:
                    estimate = controller.estimate
                    now = np.array([*estimate.load, estimate.left - estimate.right])
                    last = self._pushes[-1]
                    self._pushes.append(last + (now - last) / PRESSES)
                self._samples[self._written % KEPT] = controller.row()
                self._written += 1

    def _acceleration(self) -> float:
        """Bound the acceleration of the hand by that of the arm's joints, as a multiple of gravity."""
        if self._arm is None:
            return 0.0
        try:
            state = self._arm.state()
        except DeviceError:
            return 0.0  # the arm is lost, and reports that
        before = self._joints or state
        passed = state.stamp - before.stamp
        if passed > 0.0 or self._joints is None:
            self._joints = state
        # each joint moves the hand by 1 m/rad at most, and gravity is 9.81 m/s²
        way = 0.1 * float(np.abs(state.qd - before.qd).sum())
        return way / passed if passed > 0.0 else self._controller.acceleration

    def _rest(self, rests: bool) -> None:
        """Stop the fingers at once where they begin to rest."""
        controller = self._controller
        if rests and not controller.rests and not self._stands:
            controller.speed = 0.0
            self._command(0.0)
        controller.rests = rests

    def _report_sensor_fault(self) -> None:
        """Report unusable readings to the driver once, which ends the run; the grip is kept."""
        problem = None if self._controller.rests else self.problem
        lies = problem is not None and (
            problem.code == "SENSOR_FAULT"
            or (problem.code in LIES and self._controller.mode in IN_HAND)
        )
        if lies and not self._sensor_fault_reported and problem is not None:
            self._sensor.distrust(problem.message)
        self._sensor_fault_reported = lies

    def _command(self, speed: float) -> None:
        """Command a rate of the opening; a refusal is kept as a problem, and the next command tries again."""
        try:
            self._gripper.set_speed(speed)
            self._device_problem = None
        except DeviceError as refused:
            stamp = self._controller.reading.stamp
            self._device_problem = GripProblem(
                "LOST", f"gripper: the speed was refused: {refused}", stamp
            )


def current_hold(gripper: Gripper) -> Hold | None:
    """Return the grip session that controls the gripper's fingers, or None; the gripper's owner commands it."""
    hold = _HOLDS.get(identity(gripper))
    return None if hold is None else hold.under(gripper)


def take_over(gripper: Gripper) -> None:
    """End the grip session that controls the fingers; call it before moving them. Nothing opens."""
    hold = current_hold(gripper)
    if hold is not None:
        hold.take_over()


LASTING = 3  # number of consecutive samples that begin or end a contact: one may be a spike


class FloorWatch:
    """Compares the load along the pads with the load of the hanging fruit in the first sample.

    A floor reduces the load or reverses it. A contact ends when the load exceeds that of the hanging fruit: then the
    grip must bear more. A fruit that only hangs again is held by the same force as before.

    Attributes:
        carried: True while something else carries the fruit.
    """

    def __init__(self, contact: float) -> None:
        """
        Args:
            contact: change of the load that is a contact [N].
        """
        self._contact = contact
        self._hanging: Float64 | None = None
        self._lasted = 0
        self.carried = False

    def look(self, wrenches: Float64) -> bool:
        """Take one sample as in `WrenchSample`, shape (2, 6); return `carried`."""
        load = wrenches[0, :2] + (MIRROR * wrenches[1])[:2]
        if self._hanging is None:
            self._hanging = load
        change = load - self._hanging
        weight = float(np.linalg.norm(self._hanging))
        grown = float(change @ self._hanging) / max(weight, 1e-9)
        has_grown = grown > self._contact
        carried = not has_grown and (self.carried or float(np.linalg.norm(change)) > self._contact)
        self._lasted = self._lasted + 1 if carried is not self.carried else 0
        if self._lasted >= LASTING:
            self.carried = carried
            self._lasted = 0
        return self.carried
