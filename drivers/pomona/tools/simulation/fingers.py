"""The simulated force/tactile fingers: the pads' contact wrenches at the physics' rate, with a real sensor's errors."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pomona.drivers.errors import DeviceError, DeviceLost
from pomona.drivers.interfaces import ForceSensor, Subscription, WrenchSample
from pomona.drivers.streams import SILENCE, Belief, WrenchStream
from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.tools.simulation.layout import PADS
from pomona.tools.simulation.scene import TIMESTEP
from pomona.tools.simulation.world import FaultyDevice, PhysicsWorld

OFFSET = 1.0  # of a channel that jumps [N]
CLIPPED = 0.5  # where a channel that clips has its end, unknown to its `saturated` flag [N]
STEP = 0.5  # of a force that is measured coarsely [N]
# how old, and how far in the future, wrong stamps are [s]
LATE = 0.5
EARLY = 10.0

Lie = Callable[[WrenchSample, WrenchSample], WrenchSample]
"""Maps a sample, and the last one before the fault, to the delivered sample."""


def _changed(change: Callable[[Float64, Float64], None]) -> Lie:
    def lie(sample: WrenchSample, before: WrenchSample) -> WrenchSample:
        wrenches = sample.wrenches.copy()
        change(wrenches, before.wrenches)
        return WrenchSample(sample.stamp, sample.sequence, wrenches, sample.saturated)

    return lie


def _left(wrenches: Float64, before: Float64) -> None:
    wrenches[0] = before[0]


def _right(wrenches: Float64, before: Float64) -> None:
    wrenches[1] = before[1]


def _both(wrenches: Float64, before: Float64) -> None:
    wrenches[:] = before


def _set(index: Any, value: float) -> Callable[[Float64, Float64], None]:
    def change(wrenches: Float64, _before: Float64) -> None:
        wrenches[index] = value

    return change


def _add(index: Any, value: float) -> Callable[[Float64, Float64], None]:
    def change(wrenches: Float64, _before: Float64) -> None:
        wrenches[index] += value

    return change


def _clip(wrenches: Float64, _before: Float64) -> None:
    np.clip(wrenches[0, :3], -CLIPPED, CLIPPED, out=wrenches[0, :3])


def _round(wrenches: Float64, _before: Float64) -> None:
    wrenches[:, :3] = STEP * np.round(wrenches[:, :3] / STEP)


def _scale(factor: float) -> Callable[[Float64, Float64], None]:
    def change(wrenches: Float64, _before: Float64) -> None:
        wrenches *= factor

    return change


class _Slow:
    """Delivers one measurement many times, each with a stamp and a number of its own."""

    def __init__(self) -> None:
        self._measured: tuple[int, Float64] | None = None

    def __call__(self, sample: WrenchSample, _before: WrenchSample) -> WrenchSample:
        # number of successive samples with one measurement of slow fingers: 50 Hz of 500 Hz
        number = sample.sequence // 10
        if self._measured is None or self._measured[0] != number:
            self._measured = number, sample.wrenches
        return WrenchSample(sample.stamp, sample.sequence, self._measured[1], sample.saturated)


def _swap(wrenches: Float64, _before: Float64) -> None:
    wrenches[:] = wrenches[::-1].copy()


def _drift(index: Any, sign: float = 1.0) -> Lie:
    """Return an offset that grows from when the fault begins."""

    def lie(sample: WrenchSample, before: WrenchSample) -> WrenchSample:
        wrenches = sample.wrenches.copy()
        wrenches[index] += (
            sign * 0.5 * (sample.stamp - before.stamp)
        )  # how fast a channel drifts [N/s]
        return WrenchSample(sample.stamp, sample.sequence, wrenches, sample.saturated)

    return lie


def _stamped(offset: float) -> Lie:
    return lambda sample, _before: WrenchSample(
        sample.stamp + offset, sample.sequence, sample.wrenches, sample.saturated
    )


@dataclass(frozen=True, slots=True)
class DelayedSamples:
    """Samples that arrive late, through a line that begins empty: each second one waits until the line is full."""

    duration: float  # from the measurement to the arrival, once the line is full [s]
    hidden: bool = False  # the samples arrive with the stamps and numbers of their arrival

    def pass_on(self, line: deque[WrenchSample], sample: WrenchSample) -> WrenchSample | None:
        """Put a sample into the line; the one that leaves it, or None where none does."""
        line.append(sample)
        if sample.stamp - line[0].stamp < self.duration - 1e-9 and sample.sequence % 2:
            return None
        late = line.popleft()
        return replace(late, stamp=sample.stamp, sequence=sample.sequence) if self.hidden else late


DELAYS = {
    "late_40": DelayedSamples(0.04),
    "late_120": DelayedSamples(0.12),
    "hidden_late_40": DelayedSamples(0.04, hidden=True),
    "hidden_late_120": DelayedSamples(0.12, hidden=True),
}

LIES: dict[str, Lie] = {
    "stuck_left": _changed(_left),
    "stuck_right": _changed(_right),
    "stuck": _changed(_both),
    "dead_left": _changed(_set(0, 0.0)),
    "dead_right": _changed(_set(1, 0.0)),
    "zero": _changed(_set(slice(None), 0.0)),
    "bias_jump": _changed(_add((0, 2), -OFFSET)),
    "presses_less": _changed(_add((1, 2), OFFSET)),
    "both_press_more": _changed(_add((slice(None), 2), -OFFSET)),
    "pulls_more": _changed(_add((0, 0), OFFSET)),
    "clipped_left": _changed(_clip),
    "halved": _changed(_scale(0.5)),
    "doubled": _changed(_scale(2.0)),
    "drifts_along": _drift((slice(None), 0)),
    "drifts_pressing": _drift((0, 2), -1.0),
    "coarse": _changed(_round),
    "slow": _Slow(),
    "swapped": _changed(_swap),
    "not_a_number": _changed(_set((0, 1), np.nan)),
    "infinite": _changed(_set((slice(None), 2), -np.inf)),
    "old": _stamped(-LATE),
    "early": _stamped(EARLY),
    "repeated": lambda _sample, before: before,
}


LEVER = 0.01  # torque errors are the force errors at this lever [m]
_NOISE_ROWS = 8192


@kernel()
def pad_wrench(
    contact: Float64, site_position: Float64, site_rotation: Float64, wrench: Float64
) -> None:
    """Compute the wrench of the fruit on a pad, (6,), in the pad's frame, from the engine's net contact.

    Args:
        contact: net force [N], torque [N·m] and their point [m] that the pad exerts, shape (9,), in the base frame.
        site_position, site_rotation: pad frame's origin, shape (3,) [m], and axes as columns, row-major, shape (9,).
    """
    fx = -contact[0]
    fy = -contact[1]
    fz = -contact[2]
    px = contact[6] - site_position[0]
    py = contact[7] - site_position[1]
    pz = contact[8] - site_position[2]
    tx = -contact[3] + py * fz - pz * fy
    ty = -contact[4] + pz * fx - px * fz
    tz = -contact[5] + px * fy - py * fx
    for k in range(3):
        a = site_rotation[k]
        b = site_rotation[3 + k]
        c = site_rotation[6 + k]
        wrench[k] = a * fx + b * fy + c * fz
        wrench[3 + k] = a * tx + b * ty + c * tz


class SimFingers(FaultyDevice):
    """Two pads. Errors: a constant bias per channel, white noise, and the range's end.

    Faults: `lost` (no more samples), and every one of `finger_faults.LIES` and `DELAYS`.
    """

    interfaces = (ForceSensor,)
    known_faults = ("lost", *LIES, *DELAYS)
    rate = 1.0 / TIMESTEP

    def __init__(
        self,
        world: PhysicsWorld,
        noise: float,
        bias: float,
        force_range: float,
        belief: Belief | None = None,
    ) -> None:
        super().__init__("fingers")
        self._world = world
        self._range = force_range
        rng = np.random.default_rng([world.seed, 3])
        scale = np.array([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])
        offset = rng.uniform(-bias, bias, (2, 6)) * scale
        # A long ring of noise, indexed by the sample's number: independent of listeners, and fast.
        self._errors = offset + rng.normal(0.0, noise, (_NOISE_ROWS, 2, 6)) * scale
        self._contacts = [world.sensor(f"wrench_{pad}") for pad in PADS]
        sites = [world.model.site(pad).id for pad in PADS]
        self._positions = [world.state.site_xpos[site] for site in sites]
        self._rotations = [world.state.site_xmat[site] for site in sites]
        self._passing = WrenchStream(world.clock, belief=belief)
        self._lost: WrenchSample | None = None
        self._before: WrenchSample | None = None
        self._line: deque[WrenchSample] = deque()
        self._passed = -1  # the step of the last measured sample
        world.after_step.append(self._stream)

    def latest(self) -> WrenchSample | None:
        self._pass_on()
        return self._passing.newest

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        return self._passing.subscribe(listener)

    def check(self) -> None:
        if self._lost is not None and self._world.clock.now() - self._lost.stamp > SILENCE:
            raise DeviceLost(
                self.name,
                f"no sample for {1e3 * (self._world.clock.now() - self._lost.stamp):.0f} ms",
            )
        super().check()

    def _wrong(self) -> DeviceError | None:
        return self._passing.problem(self.name)

    def acknowledge(self) -> None:
        """Acknowledge the fault of the samples. Raises DeviceFault: it persists."""
        self._pass_on()  # without listeners the recovery of the samples has not been noted
        self._passing.acknowledge(self.name)

    def inject_fault(self, kind: str) -> None:
        newest = self._measure()
        super().inject_fault(kind)
        self._before = newest
        self._line.clear()
        self._lost = newest if kind == "lost" else None

    def clear_fault(self) -> None:
        super().clear_fault()
        self._lost = None

    def _stream(self) -> None:
        if (
            self._passing.has_listeners or self.fault is not None
        ):  # a fault is found whether or not anybody listens
            self._pass_on()

    def _pass_on(self) -> None:
        step = self._world.clock.steps
        if self._lost is not None and self._world.clock.now() - self._lost.stamp > SILENCE:
            self._passing.leave_out("has sent no sample for 40 ms", certain=True)
        if self._passed == step or self.fault == "lost":
            return
        self._passed = step
        sample = self._measure()
        if self.fault in DELAYS:
            arrived = DELAYS[self.fault].pass_on(self._line, sample)
            if arrived is None:
                return
            sample = arrived
        if self.fault in LIES and self._before is not None:
            sample = LIES[self.fault](sample, self._before)
        self._passing.deliver(sample)

    def _measure(self) -> WrenchSample:
        sequence = self._world.clock.steps
        wrenches = np.empty((2, 6))
        for i in range(2):
            pad_wrench(self._contacts[i], self._positions[i], self._rotations[i], wrenches[i])
        wrenches += self._errors[sequence % _NOISE_ROWS]
        forces = wrenches[:, :3]
        beyond = np.abs(forces) >= self._range
        saturated = (False, False)
        if beyond.any():
            np.clip(forces, -self._range, self._range, out=forces)
            saturated = (bool(beyond[0].any()), bool(beyond[1].any()))
        return WrenchSample(sequence * TIMESTEP, sequence, wrenches, saturated)
