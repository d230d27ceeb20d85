"""Filter between a device and its listeners: only plausible samples pass.

Every driver of force fingers delivers its samples through a `WrenchStream`, and every driver of a camera checks its
frames with a `FrameGuard`. Real, emulated, simulated and mock devices thus have the same checks and the same messages.
Neither class accesses a device or compares sensors with each other: that is for skills.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pomona.drivers.errors import DeviceError, DeviceFault
from pomona.drivers.interfaces import Subscription, WrenchSample
from pomona.executive.clock import Clock
from pomona.executive.values.arrays import Float64
from pomona.executive.values.kinds import Measure
from pomona.executive.values.sections import value
from pomona.executive.values.units import FORCE, TIME

SILENCE = 0.040  # time without a valid sample after which the fingers are lost [s]
FEW = 5  # minimum run of bad samples before a fault: fewer may be a stall of the computer itself
# stamps are read from the cell's clock; ahead of it by more than this they are wrong [s]
EARLY = 0.005
WINDOW = 6
FEW_GAPS = 4
IN_BITS = 0.4
"""Limit of an intermittent stream: within this multiple of the silence allowed, this number of gaps of half of it or
more that together miss this ratio. A single gap may be the computer's; an intermittent stream controls no grip."""
# the same of cameras, whose clocks are followed to a few milliseconds [s]
FEW_FRAMES = 2
EARLY_FRAME = 0.020


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """Limits beyond which the samples of force fingers are not trusted.

    Attributes:
        stuck: a finger that repeats its value bit for bit for this long is stuck [s]: every live sensor has noise,
            though one with few bits may repeat itself for a while and need more.
        strongest: a force above this, or a torque above this number of N·m, is implausible [N]: no gripper here
            presses with more than 50 N.
    """

    stuck: float = value(
        Measure(TIME, "5 ms", "10 s"),
        "30 ms",
        "a finger that repeats its value exactly for this long is stuck",
    )
    strongest: float = value(
        Measure(FORCE, "1 N", "10000 N"), "200 N", "a larger force is not plausible"
    )


SIDES = ("the left finger", "the right finger")


class _Listener:
    def __init__(self, call: Callable[[WrenchSample], None], stream: WrenchStream) -> None:
        self.call = call
        self._stream = stream

    def close(self) -> None:
        self._stream._forget(self)


class WrenchStream:
    """Checks the samples of two fingers, or of the parts that `sides` names, and passes the plausible ones on.

    Implausible samples are dropped, and are a fault of the device if no others arrive; a force that is not finite or
    impossible, and a stuck finger, are a fault at once. A listener that fails is not called again, and is a fault as
    well: it may have been the grip's controller.

    Attributes:
        newest: the newest accepted sample, or None.
        left_out: number of rejected samples so far.
        on_lost: called once when a fault begins, in the thread that delivers: stops the gripper.
    """

    def __init__(
        self,
        clock: Clock,
        silence: float = SILENCE,
        on_lost: Callable[[], None] = lambda: None,
        belief: Belief | None = None,
        sides: tuple[str, ...] = SIDES,
    ) -> None:
        self.newest: WrenchSample | None = None
        self.left_out = 0
        self.on_lost = on_lost
        self._clock, self._silence, self._belief = clock, silence, belief or Belief()
        self._sides = sides
        self._lock = threading.Lock()
        self._listeners: tuple[_Listener, ...] = ()
        self._delivered = math.nan  # stamp of the newest sample that a listener got
        self._gaps: list[
            tuple[float, float]
        ] = []  # between two of them: how long, and when they ended
        self._wrong = ""
        self._cause: Exception | None = None
        self.restart()

    # ------------------------------------------------------------------------------------------ who listens

    def subscribe(self, call: Callable[[WrenchSample], None]) -> Subscription:
        """Call this with every accepted sample, in the thread that delivers."""
        with self._lock:
            listener = _Listener(call, self)
            self._listeners = (*self._listeners, listener)
        return listener

    @property
    def has_listeners(self) -> bool:
        """Whether anybody listens."""
        return bool(self._listeners)

    def _forget(self, listener: _Listener) -> None:
        with self._lock:
            self._listeners = tuple(other for other in self._listeners if other is not listener)

    # ------------------------------------------------------------------------------------------ who delivers

    def deliver(self, sample: WrenchSample) -> None:
        """Judge a sample and hand it on."""
        flaw = self._flaw(sample)
        if flaw:
            self.leave_out(flaw)
            return
        same = self._unchanged(sample)
        if same:
            self.leave_out(same, certain=True)
            return
        self._left_out, self._believed_at = 0, self._clock.now()
        if sample.stamp - self._delivered > 0.5 * self._silence:
            self._note_gap(sample.stamp - self._delivered, sample.stamp)
        # who only asks now and then misses nothing
        self._delivered = sample.stamp if self._listeners else math.nan
        self.hand_on(sample)

    def _note_gap(self, gap: float, until: float) -> None:
        window = WINDOW * self._silence
        self._gaps = [
            (gap, until),
            *((gap, end) for gap, end in self._gaps if end > until - window),
        ]
        missing = sum(gap for gap, _ in self._gaps)
        if len(self._gaps) >= FEW_GAPS and missing > IN_BITS * window:
            self._accuse(
                f"comes and goes: no sample in {1e3 * missing:.0f} of the last {1e3 * window:.0f} ms"
            )

    def hand_on(self, sample: WrenchSample) -> None:
        """Give a sample to every listener without judging it."""
        self.newest = sample
        for listener in self._listeners:
            try:
                listener.call(sample)
            except Exception as error:
                listener.close()
                self._accuse(f"a listener failed: {error!r}", error)

    def leave_out(self, flaw: str, certain: bool = False) -> None:
        """Count a rejected sample; the driver may have a reason of its own.

        Args:
            flaw: the problem, as a sentence that follows the device's name.
            certain: one is enough for a fault.
        """
        self.left_out += 1
        self._left_out += 1
        silent = self._clock.now() - self._believed_at
        if certain or (self._left_out >= FEW and silent > self._silence):
            self._accuse(flaw)

    # ------------------------------------------------------------------------------------------- the device

    def problem(self, device: str) -> DeviceError | None:
        """Return the problem of the stream until it is acknowledged, or None."""
        if not self._wrong:
            return None
        fault = DeviceFault(device, self._wrong)
        fault.__cause__ = self._cause
        return fault

    def acknowledge(self, device: str) -> None:
        """Acknowledge the problem. Raises DeviceFault: it persists."""
        if self._wrong and self._left_out:
            raise DeviceFault(device, f"still: {self._wrong}")
        self._wrong = ""
        self._cause = None

    # -------------------------------------------------------------------------------------------- judgement

    def restart(self) -> None:
        """The sensor was started anew: its next sample has no past."""
        self._last = (-math.inf, -1)
        self._delivered = math.nan
        self._gaps = []
        self._same: Float64 | None = None
        self._same_since, self._same_count = [0.0] * len(self._sides), [0] * len(self._sides)
        self._left_out = 0
        self._believed_at = self._clock.now()

    def _accuse(self, words: str, cause: Exception | None = None) -> None:
        if not self._wrong:
            self._wrong = words
            self._cause = cause
            self.on_lost()

    def _flaw(self, sample: WrenchSample) -> str:
        """Why a sample cannot be true; empty when it can."""
        age = self._clock.now() - sample.stamp
        if not math.isfinite(age):
            return "stamps its samples with a time that is not finite"
        stamp, sequence = self._last
        if sample.sequence == sequence or sample.stamp == stamp:
            return f"repeats its sample {sample.sequence}"
        if age < -EARLY:
            return f"stamps its samples {-age:.3g} s in the future"
        if age > self._silence + 1e-9:
            return f"delivers samples that are {age:.3g} s old"
        if sample.sequence < sequence or sample.stamp < stamp:
            return "delivers its samples out of order"
        self._last = (sample.stamp, sample.sequence)
        return ""

    def _unchanged(self, sample: WrenchSample) -> str:
        """Return the certain fault of the fingers' values: impossible, or the same for too long."""
        wrenches = sample.wrenches
        strongest = self._belief.strongest
        if not np.abs(wrenches).max() <= strongest:  # this form is True also for NaN
            row, said = next(
                (i // 6, float(one))
                for i, one in enumerate(wrenches.flat)
                if not abs(one) <= strongest
            )
            what = f"{said:g} N" if math.isfinite(said) else f"{said} instead of a force"
            return f"{self._sides[row]} reports {what}"
        same = (
            (wrenches == self._same).all(axis=1)
            if self._same is not None
            else (False,) * len(wrenches)
        )
        self._same = wrenches
        stuck = []
        for finger in range(len(wrenches)):
            if not same[finger]:
                self._same_since[finger], self._same_count[finger] = sample.stamp, 0
                continue
            self._same_count[finger] += 1
            if (
                self._same_count[finger] >= FEW
                and sample.stamp - self._same_since[finger] >= self._belief.stuck
            ):
                stuck.append(finger)
        if not stuck:
            return ""
        who, have = ("both fingers", "have") if len(stuck) == 2 else (self._sides[stuck[0]], "has")
        what = "zero" if not wrenches[stuck].any() else "the same to the last bit"
        return f"{who} {have} reported {what} for {1e3 * self._belief.stuck:.0f} ms"


class FrameGuard:
    """Judges when a camera's frames were taken, and whether they are new ones."""

    def __init__(self, clock: Clock, silence: float) -> None:
        """
        Args:
            silence: time without a valid frame after which the camera is lost [s]; older frames are rejected.
        """
        self._clock = clock
        self._silence = silence
        self.restart()

    def restart(self) -> None:
        """The camera was started anew: its next frame has no past."""
        self._last = (-math.inf, -1)
        self._images: dict[str, tuple[bytes, float]] = {}
        self._flaw = ""
        self._flawed = 0
        self._believed_at = self._clock.now()

    def judge(self, stamp: float, number: int, colour: bytes = b"", depth: bytes = b"") -> bool:
        """Return True for a frame that is new and plausible.

        Args:
            stamp: time of exposure on the cell's clock [s].
            number: the camera's own.
            colour, depth: some pixels of the one, all of the other. A live sensor never repeats both, nor a measured
                depth image, exactly; near surfaces repeat most pixels, since noise is below the step there.
        """
        self._flaw = self._flaw_of(stamp, number) or self._repeated("picture", colour + depth)
        if depth.strip(b"\0"):
            self._flaw = self._flaw or self._repeated("depth image", depth)
        if self._flaw:
            self._flawed += 1
            return False
        self._last, self._flawed, self._believed_at = (stamp, number), 0, self._clock.now()
        return True

    def check(self, device: str) -> None:
        """Check that valid frames arrive.

        Raises DeviceFault: all recent frames are implausible; the text has the reason.
        """
        if self._flawed >= FEW_FRAMES and self._clock.now() - self._believed_at > self._silence:
            raise DeviceFault(device, self._flaw)

    def _flaw_of(self, stamp: float, number: int) -> str:
        age = self._clock.now() - stamp
        if not math.isfinite(age):
            return "stamps its frames with no time"
        if number == self._last[1]:
            return f"repeats its frame {number}"
        if age < -EARLY_FRAME:
            return f"stamps its frames {-age:.3g} s in the future"
        if age > self._silence:
            return f"delivers frames that are {age:.3g} s old"
        if number < self._last[1] or stamp <= self._last[0]:
            return "delivers its frames out of order"
        return ""

    def _repeated(self, name: str, pixels: bytes) -> str:
        """Return the flaw of an image that equals the one before it; empty otherwise."""
        now = self._clock.now()
        before, since = self._images.get(name, (b"", now))
        if not pixels or pixels != before:
            self._images[name] = pixels, now
            return ""
        return f"shows the same {name} for {now - since:.2g} s, to the last bit"
