"""The driver `suntouch` of a cell file."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

from drivers.cell_file import Settings
from drivers.device import Bench
from drivers.errors import DeviceError, DeviceLost
from drivers.interfaces import Gripper
from drivers.suntouch.calibration import FingerCalibration, UnusableCalibration
from drivers.suntouch.driver import SunTouchFingers
from drivers.suntouch.finger import Finger
from drivers.suntouch.transport import SerialLink, serial_ports
from drivers.wire import Link

BAUDS = (1_000_000, 500_000, 115_200)


def connect(settings: Settings, bench: Bench) -> SunTouchFingers:
    """Open the two fingers that a cell file describes, and take their bias: nothing may touch the pads.

    fingers:
      driver: suntouch
      left: {port: /dev/ttyUSB0, calibration: finger_left.json}
      right: {port: /dev/ttyUSB1, calibration: finger_right.json}
      baud: 1000000
      rate: 500 Hz
      silence: 40 ms                    # no sample for so long: the fingers are lost, the gripper stands still
    """
    baud = settings.integer("baud", BAUDS[0])
    if baud not in BAUDS:
        raise settings.error(f"the fingers know {', '.join(map(str, BAUDS))} baud, not {baud}", "baud")
    left, right = (_read_finger(settings.section(side), baud, bench) for side in ("left", "right"))
    gripper = bench.find(Gripper)

    def hold() -> None:
        if gripper is not None:
            with contextlib.suppress(DeviceError):
                gripper.set_speed(0.0)

    fingers = SunTouchFingers(
        left,
        right,
        bench.clock,
        rate=settings.number("rate", "rate", 500.0, 10.0, 1000.0),
        silence=settings.number("silence", "time", 0.040, 0.004, 1.0),
        on_lost=hold,
    )
    try:
        fingers.connect()
    except DeviceLost as error:
        side = "right" if "right finger" in error.message else "left"
        hint = f"serial ports of this machine: {', '.join(serial_ports()) or 'none'}"
        raise settings.error(error.message, side, hint) from error
    fingers.start()
    return fingers


def _read_finger(settings: Settings, baud: int, bench: Bench) -> Finger:
    port = settings.text("port")
    path = settings.file("calibration", "make it with `pomona calibrate fingers`")
    try:
        calibration = FingerCalibration.load(path)
    except UnusableCalibration as error:
        raise settings.error(str(error), "calibration", "pomona calibrate fingers makes one") from error
    settings.finish()
    return Finger(_opener(port, baud), calibration, bench.clock)


def _opener(port: str, baud: int) -> Callable[[], Link]:
    return lambda: SerialLink(port, baud)
