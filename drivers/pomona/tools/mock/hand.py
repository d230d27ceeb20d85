"""A clock that moves mock devices, and the devices of a hand: gripper, force fingers and camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pomona.drivers.base.direct_gripper import DirectGripper
from pomona.drivers.base.parallel_gripper import SpeedOrder, WidthOrder
from pomona.drivers.errors import DeviceError, MotionRefused
from pomona.drivers.gripper_supervisor import GripperMotion
from pomona.drivers.interfaces import (
    Camera,
    ForceSensor,
    Frame,
    GripperLimits,
    GripperState,
    LoadSensor,
    MotionState,
    Subscription,
    WrenchSample,
)
from pomona.drivers.streams import SILENCE, WrenchStream
from pomona.executive.cell.device import Device
from pomona.executive.clock import Clock
from pomona.executive.values.arrays import Float64

PERIOD = 0.002  # step of mock devices [s]


class MockClock:
    """Simulated time without a world; `each_step` hooks are called after every step of 2 ms."""

    simulated = True

    def __init__(self) -> None:
        self.each_step: list[Callable[[], None]] = []
        self._steps = 0
        self._owed = 0.0

    def now(self) -> float:
        return self._steps * PERIOD

    def advance(self, duration: float) -> None:
        """Step; a rest shorter than a step is kept for the next call."""
        self._owed += max(duration, 0.0)
        count = int(self._owed / PERIOD + 1e-6)
        self._owed -= count * PERIOD
        for _ in range(count):
            self._steps += 1
            for hook in tuple(self.each_step):
                hook()


LIMITS = GripperLimits(width_min=0.035, width_max=0.103, speed_max=0.2, force_max=20.0)
WATCHDOG = 0.1
ACCELERATION = 1e3  # acceleration that the supervisor assumes [m/s²]: moves begin and end at once


class MockGripper(DirectGripper):
    """A kinematic gripper.

    Args:
        clock: that moves it.
        width: opening at the start [m].
        blocked_at: the fingers do not close below this [m]; 0 means never. For moves: they fail there.

    Attributes:
        force: with which a finger presses on what it met [N].
        width: present opening; write it to move the fingers by hand, which `check` notices.
        motor_force: reported with the state [N], or None.
        speeds: every value given to `set_speed`, with its time.
        moves: every move that was started.
    """

    def __init__(
        self,
        clock: MockClock,
        width: float = 0.10,
        limits: GripperLimits = LIMITS,
        blocked_at: float = 0.0,
    ) -> None:
        super().__init__("gripper", clock, limits, acceleration=ACCELERATION, watchdog=WATCHDOG)
        self.width = width
        self.blocked_at = blocked_at
        self.motor_force: float | None = None
        self.speeds: list[tuple[float, float]] = []
        self.moves: list[GripperMotion] = []
        self._rate = self.force = 0.0
        self._refused: str | None = None
        self._error: DeviceError | None = None
        clock.each_step.append(self.step)

    # ---------------------------------------------------------------------------------------------- script

    def refuse_next(self, why: str) -> None:
        """Refuse the next move."""
        self._refused = why

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._error = error

    # ----------------------------------------------------------------------------------------------- device

    def state(self) -> GripperState:
        moving = not self.settled()
        return GripperState(
            self._clock.now(), self.width, self._rate, moving, self.motor_force, aim=self._aim
        )

    def move(self, width: float, speed: float, force: float | None = None) -> GripperMotion:
        refusal = self._refused
        self._refused = None
        if refusal:
            raise MotionRefused(self.name, refusal)
        self.moves.append(super().move(width, speed, force))
        return self.moves[-1]

    def set_speed(self, speed: float) -> None:
        self.speeds.append((self._clock.now(), speed))
        super().set_speed(speed)

    def _wrong(self) -> DeviceError | None:
        return self._error or super()._wrong()

    def step(self) -> None:
        """Move the fingers for one period of the clock."""
        self._end_stale_stream(self._clock.now())
        force = self.limits.force_max
        match self._wanted:
            case WidthOrder(width, speed, force):
                left = width - self.width
                self._rate = math.copysign(min(speed, abs(left) / PERIOD), left)
            case SpeedOrder(speed):
                self._rate = speed
            case _:
                self._rate = 0.0
        low = max(self.limits.width_min, self.blocked_at)
        self.width = min(max(self.width + self._rate * PERIOD, low), self.limits.width_max)
        if self._rate:
            self.force = force if self._rate < 0.0 and self.width <= low else 0.0
        move = self._move
        if move is None or not isinstance(self._wanted, WidthOrder):
            return
        move.measured = self.width
        if abs(move.width - self.width) < 1e-6:
            self._end_move(MotionState.DONE)
        elif self._rate < 0.0 and self.width <= low:
            self._end_move(
                MotionState.FAILED, f"the fingers are blocked at {1e3 * self.width:.1f} mm"
            )


Script = Callable[[float], Float64]  # wrenches of both fingers, shape (2, 6), at a time [s]


def spring_fruit(gripper: MockGripper, width: float, stiffness: float = 2000.0) -> Script:
    """Return a fruit of the given width [m] between two soft pads of the given stiffness each [N/m]."""

    def feel(_now: float) -> Float64:
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -stiffness * max(width - gripper.width, 0.0) / 2.0
        return wrenches

    return feel


RIPPLE = 1e-13  # of every sample, to either side [N, N·m]: no live sensor repeats a value to the last bit


class MockForceSensor(Device):
    """A 500 Hz stream.

    Args:
        clock: that drives the stream.
        feel: the wrenches at the fingers; zero by default. May be replaced at any time.
    """

    interfaces = (ForceSensor,)
    rate = 1.0 / PERIOD

    def __init__(self, clock: MockClock, feel: Script | None = None) -> None:
        super().__init__("fingers")
        self._clock = clock
        self.feel: Script = feel or (lambda _now: np.zeros((2, 6)))
        self.saturated = (False, False)
        self._silent = 0.0
        self._sequence = 0
        self._stream = WrenchStream(clock)
        self._error: DeviceError | None = None
        clock.each_step.append(self._step)

    # ---------------------------------------------------------------------------------------------- script

    def lose(self, duration: float) -> None:
        """Deliver nothing for a duration [s]; the sequence counts on."""
        self._silent = self._clock.now() + duration

    def give(self, sample: WrenchSample) -> None:
        """Deliver one sample now, without checks."""
        self._stream.hand_on(sample)

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._error = error

    # ----------------------------------------------------------------------------------------------- device

    def latest(self) -> WrenchSample | None:
        return self._stream.newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        return self._stream.subscribe(listener)

    def acknowledge(self) -> None:
        self._stream.acknowledge(self.name)

    def _wrong(self) -> DeviceError | None:
        return self._error or self._stream.problem(self.name)

    def _step(self) -> None:
        self._sequence += 1
        now = self._clock.now()
        newest = self._stream.newest
        if newest is not None and now - newest.stamp > SILENCE:
            self._stream.leave_out("has sent no sample for 40 ms", certain=True)
        if now > self._silent:
            felt = np.array(self.feel(now), np.float64) + (
                RIPPLE if self._sequence % 2 else -RIPPLE
            )
            self._stream.deliver(WrenchSample(now, self._sequence, felt, self.saturated))


class MockLoadSensor(MockForceSensor):
    """A load sensor at the wrist: `feel` gives shape (1, 6)."""

    interfaces = (LoadSensor,)
    mass = 1.2
    least = 0.5

    def __init__(self, clock: MockClock) -> None:
        super().__init__(clock, lambda _now: np.zeros((1, 6)))
        self.name = "load"
        self._stream = WrenchStream(clock, sides=("the load sensor",))


class MockCamera(Device):
    """Every look shows the next frame; the last one stays.

    Args:
        frames: to show, in order; none gives a camera without frames.
        clock: stamps each frame with the time of the look; without it frames keep their own stamps.

    Attributes:
        looks: number of requested frames.
    """

    interfaces = (Camera,)

    def __init__(self, *frames: Frame, clock: Clock | None = None) -> None:
        super().__init__("camera")
        self._frames = list(frames)
        self._clock = clock
        self.looks = 0

    def show(self, *frames: Frame) -> None:
        """Show these frames from the next look on."""
        self._frames = list(frames)

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._problem = error

    def latest(self) -> Frame | None:
        self.looks += 1
        if not self._frames:
            return None
        frame = self._frames.pop(0) if len(self._frames) > 1 else self._frames[0]
        return frame if self._clock is None else replace(frame, stamp=self._clock.now())
