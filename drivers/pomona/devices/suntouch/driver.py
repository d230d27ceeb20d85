"""Two SUNTouch fingers as a `ForceSensor`: polled together 500 times a second by one thread.

A sample without an answer of one finger, with a spike or with implausible values (`pomona.drivers.streams`) is left out
and leaves a gap in the sequence. A lost or faulty finger stops the gripper and stays latched; a lost one is reopened in
the background.

The bias, the voltages without contact, is taken when nothing can be between the fingers; otherwise the last one stays
in force, which `pomona.drivers.hold_watch` keeps from one connection to the next.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pomona.devices.suntouch.codec import TAXELS, FingerReading
from pomona.devices.suntouch.finger import JUMP, Finger
from pomona.drivers import (
    SIDES,
    SILENCE,
    Belief,
    Device,
    DeviceError,
    DeviceFault,
    DeviceLost,
    ForceSensor,
    Gripper,
    HandMemory,
    Owner,
    Subscription,
    WrenchSample,
    WrenchStream,
    may_hold,
)
from pomona.executive import Clock, Float64

RECONNECT = 0.5  # pause between attempts to open a lost finger again [s]
FIRST_SAMPLE = 1.0  # deadline of the first sample after opening [s]
ANSWER = 0.004  # deadline of an answer [s]; a late answer is still a sample, but after this time the line is restarted
CATCH_UP = 2  # periods that this thread may oversleep and still ask for each of them, one right after the other
# samples left out before and taken for the bias
DROPPED = 10
AVERAGED = 100


class NoBias(DeviceError):
    """No bias is taken of fingers that may hold something; `held` is why they may."""

    def __init__(self, device: str, held: str) -> None:
        self.held = held
        super().__init__(
            device,
            f"no bias can be taken, since something may be between the fingers: {held}. Take it out, open the gripper "
            "fully with its own interface, and connect again",
        )


class SunTouchFingers(Device):
    """The left and the right finger.

    Attributes:
        lost_samples: periods in which no sample was delivered.
    """

    interfaces = (ForceSensor,)

    def __init__(
        self,
        left: Finger,
        right: Finger,
        clock: Clock,
        *,
        rate: float = 500.0,
        silence: float = SILENCE,
        on_lost: Callable[[], None] = lambda: None,
        belief: Belief | None = None,
        gripper: Gripper | None = None,
        memory: HandMemory | None = None,
        name: str = "fingers",
    ) -> None:
        """
        Args:
            on_lost: called once when the stream is lost or faulty, by the owner: stops the gripper.
            gripper: moves the fingers; its opening shows whether they can hold something. None: nothing moves them.
            memory: keeps the bias and the state of the hand; by default for as long as this object lives.
        """
        super().__init__(name)
        self.rate = rate
        self.lost_samples = 0
        self.fingers = (left, right)
        self.hand_memory: HandMemory = memory or HandMemory(None)
        self._gripper = gripper
        self._clock = clock
        self._silence = silence
        self._period = 1.0 / rate
        self._owner = Owner(name, self.step, self._lose, clock)
        self._stream = WrenchStream(clock, silence, on_lost, belief)
        self._sequence = 0
        self._due = 0.0
        self._last_seen = 0.0
        self._unanswered = 0
        self._streaming = self._measures = False  # without a bias nothing is measured
        self._retry_at = 0.0
        self._biasing: list[tuple[FingerReading, FingerReading]] | None = None
        self._biases_asked = self._biases_begun = 0
        self._problem = DeviceLost(name, "was never connected")

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open both lines, wait for the first sample, and take the bias unless something may be between the fingers.

        Raises:
            DeviceLost: a line cannot be opened, or a finger does not answer.
            DeviceFault: the samples are not plausible.
            NoBias: something may be between the fingers, and no earlier bias of them is known, or it does not fit.
        """
        try:
            self._open()
            force = self._pressing() if self._recall_bias() else None
            held = self._may_hold(force)
            if held and (force is None or not math.isfinite(force)):
                raise NoBias(self.name, held)
            if not held:
                self._measures = False
                self._ask_for_bias()
                self._sample_until(lambda: self.biased)
        except OSError as error:
            self._close_lines()
            raise DeviceLost(self.name, str(error)) from error
        except DeviceError:
            self._close_lines()
            raise
        self._problem = None

    def start(self) -> None:
        """Stream in a thread of its own from now on."""
        self._owner.start()

    def bias(self) -> None:
        """Take the voltages of the next readings as those without contact: 10 are left out, 100 averaged.

        Raises NoBias: something may be between the fingers; the bias stays as it was.
        """
        sample = self.latest()
        held = self._may_hold(None if sample is None else float((-sample.wrenches[:, 2]).min()))
        if held:
            raise NoBias(self.name, held)
        self._ask_for_bias()

    @property
    def biased(self) -> bool:
        """False while the bias is being taken."""
        return self._biasing is None and self._biases_begun == self._biases_asked

    def _ask_for_bias(self) -> None:
        self._biases_asked += 1
        self._owner.post(self._begin_bias)

    def _begin_bias(self) -> None:
        self._biasing = []
        self._biases_begun = self._biases_asked

    def _recall_bias(self) -> bool:
        """Measure from the last bias of these fingers; False when none is known."""
        record = self.hand_memory.record
        known = {} if record is None else record.bias
        biases = [known.get(finger.calibration.fingerprint, ()) for finger in self.fingers]
        if any(len(bias) != TAXELS for bias in biases):
            return False
        for finger, bias in zip(self.fingers, biases, strict=True):
            finger.bias = np.array(bias)
        self._measures = True
        return True

    def _pressing(self) -> float:
        """Smaller of both fingers' pressing forces [N], over as many readings as a bias; infinite if implausible."""
        forces: list[Float64] = []
        subscription = self.subscribe(lambda sample: forces.append(-sample.wrenches[:, 2]))
        try:
            self._sample_until(lambda: len(forces) >= AVERAGED)
        except DeviceFault:  # the bias is not theirs any more
            self._stream.restart()
            self._stream.acknowledge(self.name)
            return math.inf
        finally:
            subscription.close()
        return float(np.mean(forces, axis=0).min())

    def _sample_until(self, done: Callable[[], bool]) -> None:
        while not done():
            self._sample()
            problem = self._stream.problem(self.name)
            if problem is not None:
                raise problem

    def _may_hold(self, force: float | None) -> str:
        """Why something may be between the fingers; empty when nothing can be."""
        if self._gripper is None:
            return ""
        return may_hold(self._gripper.state(), self._gripper.limits, self.hand_memory.record, force)

    def step(self) -> None:
        """One period; the sensor's own thread calls this without end."""
        try:
            if self._streaming:
                self._sample()
            elif self._clock.now() >= self._retry_at:
                self._open()
            else:
                self._clock.advance(min(self._retry_at - self._clock.now(), 0.05))
        except (OSError, DeviceError) as error:
            self._lose(error)

    def _open(self) -> None:
        for side, finger in zip(("left", "right"), self.fingers, strict=True):
            try:
                finger.open()
                self._first_reading(finger)
            except (OSError, DeviceLost) as error:
                raise DeviceLost(self.name, f"the {side} finger: {error}") from error
        self._due = self._last_seen = self._clock.now()
        self._stream.restart()
        self._streaming = True

    def _first_reading(self, finger: Finger) -> None:
        end = self._clock.now() + FIRST_SAMPLE
        while self._clock.now() < end:
            finger.ask()
            if finger.answer(self._clock.now() + 0.02) is not None:
                return
        raise DeviceLost(self.name, f"no reading within {FIRST_SAMPLE:g} s")

    # -------------------------------------------------------------------------------------------- stream

    def _sample(self) -> None:
        self._await_period()
        asked = self._clock.now()
        for finger in self.fingers:
            finger.ask()
        due = asked + ANSWER
        left, right = (finger.answer(due) for finger in self.fingers)
        now = self._clock.now()
        if left is None or right is None:
            self.lost_samples += 1
            self._unanswered += 1
            # Several unanswered requests, or this thread itself was held up.
            if now - self._last_seen > self._silence and self._unanswered >= 5:
                raise DeviceLost(self.name, f"no sample for {1e3 * (now - self._last_seen):.0f} ms")
            return
        self._last_seen = now
        self._unanswered = 0
        flaw = self._flaw((left, right))
        if flaw:
            self.lost_samples += 1
            self._stream.leave_out(flaw)
            return
        if self._biasing is not None:
            self._take_bias(left, right)
        if self._measures:
            self._deliver(asked, left, right)

    def _flaw(self, readings: tuple[FingerReading, FingerReading]) -> str:
        """Return why the readings are rejected; empty for valid ones."""
        believed = [
            f.spikes.accept(reading.volts)
            for f, reading in zip(self.fingers, readings, strict=True)
        ]
        for side, reading in zip(SIDES, readings, strict=True):
            if reading.dead:
                return f"{side} has every taxel at the end of its range"
        for side, good in zip(SIDES, believed, strict=True):
            if not good:
                return (
                    f"{side} reports only spikes: a taxel jumps by more than {JUMP:g} V each time"
                )
        return ""

    def _await_period(self) -> None:
        """Sleep until the next period; periods that were overslept by more than a moment are lost samples."""
        self._sequence += 1
        self._due += self._period
        late = self._clock.now() - self._due
        if late < 0.0:
            self._clock.advance(-late)
        elif late > CATCH_UP * self._period:
            missed = int(late / self._period)
            self._sequence += missed
            self.lost_samples += missed
            self._due += missed * self._period

    def _deliver(self, stamp: float, left: FingerReading, right: FingerReading) -> None:
        wrenches = np.stack(
            [f.wrench(reading) for f, reading in zip(self.fingers, (left, right), strict=True)]
        )
        self._stream.deliver(
            WrenchSample(stamp, self._sequence, wrenches, (left.saturated, right.saturated))
        )

    def _take_bias(self, left: FingerReading, right: FingerReading) -> None:
        taken = self._biasing
        assert taken is not None
        taken.append((left, right))
        if len(taken) == DROPPED + AVERAGED:
            for finger, readings in zip(
                self.fingers, zip(*taken[DROPPED:], strict=True), strict=True
            ):
                finger.bias = np.mean([reading.volts for reading in readings], axis=0)
            bias = {
                finger.calibration.fingerprint: tuple(finger.bias.tolist())
                for finger in self.fingers
            }
            width = None if self._gripper is None else self._gripper.state().width
            self.hand_memory.keep_bias(bias, width)
            self._biasing = None
            self._measures = True

    def _lose(self, error: BaseException) -> None:
        first = self._streaming
        self._streaming = False
        self._retry_at = self._clock.now() + RECONNECT
        if first:
            words = (
                f"a line failed: {error}"
                if isinstance(error, OSError)
                else f"the driver failed: {error!r}"
            )
            self._problem = (
                error if isinstance(error, DeviceError) else DeviceLost(self.name, words)
            )
            self._stream.on_lost()
        self._close_lines()

    def _close_lines(self) -> None:
        for finger in self.fingers:
            finger.close()

    # ------------------------------------------------------------------------------------- the interface

    def latest(self) -> WrenchSample | None:
        return self._stream.newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        return self._stream.subscribe(listener)

    # ---------------------------------------------------------------------------------------- the device

    def check(self) -> None:
        super().check()
        self._owner.check()

    def acknowledge(self) -> None:
        """Accept that the stream had been lost. Raises DeviceLost, or another DeviceError: it is lost or faulty."""
        if not self._streaming:
            raise DeviceLost(self.name, f"is still lost: {self.link()}")
        self._owner.ask(self._release)

    def _release(self) -> None:
        self._stream.acknowledge(self.name)
        self._problem = None

    def _wrong(self) -> DeviceError | None:
        return self._problem or self._stream.problem(self.name)

    def close(self) -> None:
        self._owner.close()
        self._close_lines()
        self._streaming = False
        self._problem = DeviceLost(self.name, "is closed")
