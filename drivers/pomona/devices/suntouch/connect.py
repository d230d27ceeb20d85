"""The driver `suntouch` of a cell file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pomona.devices.suntouch.calibration import FingerCalibration, UnusableCalibration
from pomona.devices.suntouch.driver import SunTouchFingers
from pomona.devices.suntouch.finger import Finger
from pomona.drivers import (
    Belief,
    ConnectContext,
    DeviceError,
    DeviceLost,
    Gripper,
    SampleRate,
    Settings,
    driver,
    serial_opener,
    serial_ports,
)
from pomona.executive import RATE, TIME, Measure, PathTo, Problem, Section, Text, value

BAUDS = ("1000000", "500000", "115200")  # baud rates of the fingers [bit/s]


@dataclass(frozen=True, slots=True, kw_only=True)
class FingerFile:
    """One finger."""

    port: str = value(Text(), help="its serial port")
    calibration: Path = value(
        PathTo("file", "make it with `pomona calibrate fingers`"),
        help="from `pomona calibrate fingers`",
    )

    def problems(self) -> Iterator[Problem]:
        try:
            FingerCalibration.load(self.calibration)
        except UnusableCalibration as error:
            yield Problem("calibration", str(error), "pomona calibrate fingers makes one")


@dataclass(frozen=True, slots=True, kw_only=True)
class SunTouchFile:
    """Two SUNTouch fingers; their bias is taken when they are connected, unless something may be between them."""

    left: FingerFile = value(Section(FingerFile), help="the left finger")
    right: FingerFile = value(Section(FingerFile), help="the right finger")
    baud: str = value(Text(*BAUDS), BAUDS[0], "of both ports")
    rate: float = value(Measure(RATE, "10 Hz", "1 kHz"), "500 Hz", "samples per second")
    silence: float = value(
        Measure(TIME, "4 ms", "1 s"),
        "40 ms",
        "without a sample for this long the fingers are lost and the gripper stops",
    )
    belief: Belief = value(Section(Belief), Belief(), "limits beyond which samples are not trusted")

    @property
    def wires(self) -> tuple[str, ...]:
        return self.left.port, self.right.port

    def known(self) -> tuple[SampleRate, ...]:
        """How fast they sample."""
        return (SampleRate(self.rate),)

    def problems(self) -> Iterator[Problem]:
        if self.left.port == self.right.port:
            yield Problem(
                "right", f"both fingers are at {self.left.port}: each has a port of its own"
            )
        for side, finger in (("left", self.left), ("right", self.right)):
            made_for = FingerCalibration.load(finger.calibration)
            if made_for.other_than(side):
                words = f"its calibration {finger.calibration.name} was made for the finger '{made_for.finger}'"
                yield Problem(side, words, "are the two files exchanged?")


@driver(SunTouchFingers, SunTouchFile)
def connect(settings: Settings[SunTouchFile], context: ConnectContext) -> SunTouchFingers:
    """Open the two fingers that a cell file describes, and take their bias unless they may hold something."""
    said = settings.values
    left, right = (_finger(side, int(said.baud), context) for side in (said.left, said.right))
    gripper = context.find(Gripper)

    def hold() -> None:
        if gripper is not None:
            with contextlib.suppress(DeviceError):
                gripper.set_speed(0.0)

    fingers = SunTouchFingers(
        left,
        right,
        context.clock,
        rate=said.rate,
        silence=said.silence,
        on_lost=hold,
        belief=said.belief,
        gripper=gripper,
        memory=context.hand_memory(said.wires),
    )
    try:
        fingers.connect()
    except DeviceLost as error:
        side = "right" if "right finger" in error.message else "left"
        raise settings.error(error.message, side, serial_ports()) from error
    fingers.start()
    return fingers


def _finger(said: FingerFile, baud: int, context: ConnectContext) -> Finger:
    open_link = serial_opener(said.port, baud, context.wires)
    return Finger(open_link, FingerCalibration.load(said.calibration), context.clock)
