"""The fingers' driver under random commands, faults and passing time, against the true wrenches of the emulated pads.

In every case a delivered sample is true and of its time. A lasting fault is reported and stops the gripper once. A
problem stays until it is acknowledged, and when the faults are over samples flow again.
"""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import Phase, settings, strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from pomona.devices.emulators.suntouch import NOISE
from pomona.devices.suntouch.codec import TAXELS
from pomona.devices.suntouch.driver import RECONNECT
from pomona.drivers.errors import DeviceError
from pomona.drivers.interfaces import WrenchSample
from tests.drivers.devices.suntouch.test_driver import Line, Rig

TOLD = 0.1
"""Duration after which a fault is reported [s]; 40 ms of silence, and the answers that are waited for."""
NEAR = 8.0 * NOISE * np.sqrt(TAXELS) + 0.03
"""The test's calibration sums the voltages: noise, the bias's own noise, and 12 bits of 3.3 V."""
FAULTS = ("silent", "stuck", "dead", "restless", "cut")


class FingersMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.rig = Rig()
        self.lines = (self.rig.left, self.rig.right)
        self.rig.fingers.connect()
        self.rig.fingers.subscribe(self.on_sample)
        self.newest: WrenchSample | None = None
        self.count = 0
        self.broken_since: float | None = None
        self.changed_at = self.stuck_since = -1.0
        self.wrong = False
        self.serve(0.05)

    def truth(self, line: Line) -> float:
        pad = line.device.pad
        return -float(np.sum(pad.volts(line.wrench) - pad.rest))

    def on_sample(self, sample: WrenchSample) -> None:
        now = self.rig.clock.now()
        assert 0.0 <= now - sample.stamp < 0.01, "a sample of another time was delivered"
        if self.newest is not None:
            assert sample.stamp > self.newest.stamp, "time went back"
            assert sample.sequence > self.newest.sequence, "a sample came twice"
        self.newest = sample
        self.count += 1
        for line, wrench in zip(self.lines, sample.wrenches, strict=True):
            old = line.device.stuck and now - self.stuck_since < 0.05  # not known yet to be stuck
            restless = line.device.restless and now - self.changed_at < 0.05
            if not old and not restless:
                assert abs(wrench[2] - self.truth(line)) < NEAR, (
                    "what was delivered is not what the pad feels"
                )

    def serve(self, seconds: float) -> None:
        fingers, end = self.rig.fingers, self.rig.clock.now() + seconds
        while self.rig.clock.now() < end:
            before = self.rig.clock.now()
            fingers.step()
            if self.rig.clock.now() == before:
                self.rig.clock.advance(0.001)
            wrong = fingers.link() != "ok"
            assert wrong or not self.wrong, (
                "what was wrong is forgotten, and nobody has acknowledged it"
            )
            self.wrong = wrong
        if self.broken_since is not None and self.rig.clock.now() - self.broken_since > TOLD:
            assert self.wrong, "a fault lasts, and nobody is told"

    @rule(seconds=st.sampled_from([0.002, 0.02, 0.15]))
    def pass_time(self, seconds: float) -> None:
        self.serve(seconds)

    @rule(
        side=st.sampled_from([0, 1]),
        force=st.sampled_from([0.0, -1.0, -6.0]),
        shear=st.sampled_from([0.0, 2.0]),
    )
    def press(self, side: int, force: float, shear: float) -> None:
        self.lines[side].wrench = np.array([shear, 0.0, force, 0.0, 0.0, 0.0])
        self.serve(0.02)

    @rule(side=st.sampled_from([0, 1]), kind=st.sampled_from(FAULTS))
    def something_breaks(self, side: int, kind: str) -> None:
        line, now = self.lines[side], self.rig.clock.now()
        if kind == "cut":
            line.cut = True
        else:
            setattr(line.device, kind, 0.2 if kind == "restless" else True)
        if kind == "stuck":
            self.stuck_since = now
        self.changed_at = now
        self.broken_since = self.broken_since or now

    @rule(side=st.sampled_from([0, 1]), count=st.integers(1, 49))
    def bytes_are_lost(self, side: int, count: int) -> None:
        self.lines[side].device.drop_bytes = count
        self.serve(0.02)

    @rule(side=st.sampled_from([0, 1]), jump=st.sampled_from([-0.4, 0.2]))
    def a_taxel_jumps_once(self, side: int, jump: float) -> None:
        self.lines[side].device.spike = jump
        self.serve(0.02)

    @rule()
    def mend(self) -> None:
        for line in self.lines:
            line.cut = line.device.silent = line.device.stuck = line.device.dead = False
            line.device.restless = 0.0
        self.broken_since = None
        self.serve(RECONNECT + 0.1)

    @rule(side=st.sampled_from([0, 1]), kind=st.sampled_from(FAULTS))
    def break_for_a_while(self, side: int, kind: str) -> None:
        """Break a finger for a while, the most important case: the fault must still be reported when it is over."""
        self.something_breaks(side, kind)
        self.serve(TOLD + 0.01)
        self.mend()

    @rule()
    def acknowledge(self) -> None:
        with contextlib.suppress(DeviceError):
            self.rig.fingers.acknowledge()
            self.wrong = False

    @invariant()
    def what_is_wrong_is_told(self) -> None:
        wrong = self.rig.fingers.link() != "ok"
        with pytest.raises(DeviceError) if wrong else contextlib.nullcontext():
            self.rig.fingers.check()
        assert not wrong or self.rig.stopped, "something is wrong, and the gripper was not stopped"

    def teardown(self) -> None:
        """When everything is well again, so is the driver."""
        self.mend()
        self.rig.fingers.acknowledge()
        self.wrong = False
        before = self.count
        self.serve(0.2)
        assert self.rig.fingers.link() == "ok"
        assert self.count - before > 90


FingersMachine.TestCase.settings = settings(
    max_examples=5,
    stateful_step_count=14,
    phases=(Phase.generate,),
)
TestFingers = FingersMachine.TestCase
