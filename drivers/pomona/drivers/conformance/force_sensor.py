"""Claims of sensors that stream wrenches, judged by what truly presses on them, and when."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pomona.drivers.conformance.bench import Bench
from pomona.drivers.conformance.claims import Claims, Finding, judge_notice
from pomona.drivers.interfaces import WrenchSample
from pomona.executive.cell.device import FaultSwitch
from pomona.executive.clock import Clock
from pomona.executive.values.arrays import Float64

SLOPE = 2.0  # of the force that presses [N/s]: a sample's value tells when it was measured
OLD = 0.04  # samples are handed on within this time [s]
WILD = 200.0  # no sample of these claims has a larger force [N]
LASTS = 0.6  # a harm of this length is noticed [s]


class Press:
    """What truly presses on a sensor: nothing at first, then a force that grows along -z.

    Attributes:
        began: when it began to press [s].
    """

    def __init__(self, clock: Clock) -> None:
        self.began = math.inf
        self._clock = clock

    def force(self, at: float | None = None) -> float:
        """Return the force at a time [N]; now by default."""
        now = self._clock.now() if at is None else at
        return SLOPE * max(now - self.began, 0.0) if now > self.began else 0.0

    def wrench(self) -> Float64:
        """Return the wrench now, shape (6,) [N, N·m]."""
        return np.array([0.0, 0.0, -self.force(), 0.0, 0.0, 0.0])


class ForceBench(Bench):
    """A sensor's driver, and what presses on the sensor.

    Attributes:
        got: samples that a listener got, each with the time of that.
    """

    def __init__(
        self,
        device: object,
        clock: Clock,
        press: Press,
        *switches: FaultSwitch,
        tolerance: float = 0.3,
        without: tuple[str, ...] = (),
    ) -> None:
        """
        Args:
            tolerance: of a force, with the sensor's noise [N].
            switches, without: see the base.
        """
        super().__init__(device, clock, *switches, without=without)
        self.press = press
        self.tolerance = tolerance
        self.got: list[tuple[float, WrenchSample]] = []
        self.device.subscribe(lambda sample: self.got.append((self.now, sample)))
        self.serve(0.3)
        self.zero = self.told(self.got[-1][1]) if self.got else 0.0
        self.press.began = self.now

    def told(self, sample: WrenchSample) -> float:
        """Return the pressing force that a sample tells [N]."""
        return -float(sample.wrenches[0, 2])


Opened = Callable[[], ForceBench]
FORCE_SENSOR: Claims[ForceBench] = Claims("force sensor")


def force_sensor_claims(**benches: Opened) -> Callable[..., None]:
    """Return a test for pytest of every claim, for each bench by its name."""
    return FORCE_SENSOR.tests(**benches)


@FORCE_SENSOR.essential
def a_harm_is_noticed(opened: Opened) -> None:
    """A sensor that is silent, or tells what cannot be, is reported, until that is acknowledged."""
    judge_notice(opened, LASTS)


@FORCE_SENSOR.essential
def no_listener_gets_nonsense(opened: Opened) -> None:
    """What is handed on is a force that could be measured, at the time when it was."""
    for harm in ("", *opened().harms):
        bench = opened()
        bench.harm(harm, LASTS)
        bench.heal()
        bench.serve(0.6)
        for at, sample in bench.got:
            said = float(np.abs(sample.wrenches).max())
            if not said < WILD:
                raise Finding(f"'{harm}': a listener got {said:g} N")
            if not -1e-9 <= at - sample.stamp < 2.5 * OLD:
                raise Finding(f"'{harm}': a listener got a sample {at - sample.stamp:.3g} s old")


@FORCE_SENSOR.claim
def a_sample_is_true(opened: Opened) -> None:
    """A sample has the force that pressed at its time, soon after it, at the sensor's rate."""
    bench = opened()
    bench.got.clear()
    bench.serve(1.0)
    stamps = [sample.stamp for _, sample in bench.got]
    if abs(len(stamps) - bench.device.rate) > 0.3 * bench.device.rate:
        raise Finding(f"{len(stamps)} samples came in a second, of {bench.device.rate:g}")
    if np.diff(stamps).min() <= 0.0:
        raise Finding("a sample has a time that is not after the last one's")
    for at, sample in bench.got:
        told = bench.told(sample) - bench.zero
        true = bench.press.force(sample.stamp)
        if abs(told - true) > bench.tolerance:
            raise Finding(f"it tells {told:.2f} N where {true:.2f} N pressed")
        if at - sample.stamp > OLD:
            raise Finding(f"a sample came {1e3 * (at - sample.stamp):.0f} ms late")


@FORCE_SENSOR.claim
def a_failing_listener_is_told(opened: Opened) -> None:
    """A listener that fails is reported, and the others go on."""
    bench = opened()

    def fail(sample: WrenchSample) -> None:
        raise RuntimeError("of a test")

    bench.device.subscribe(fail)
    bench.got.clear()
    bench.serve(0.3)
    if "a listener failed" not in bench.problem():
        raise Finding(f"it says '{bench.problem()}'")
    if not bench.got:
        raise Finding("no other listener gets samples")
