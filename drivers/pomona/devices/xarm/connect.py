"""The driver `xarm` of a cell file."""

from __future__ import annotations

from pomona.devices.xarm.driver import WrongModelError, XArm
from pomona.devices.xarm.options import PORTS, XArmFile
from pomona.drivers import ConnectContext, DeviceError, DeviceLost, Settings, driver, tcp_opener


@driver(XArm, XArmFile)
def connect(settings: Settings[XArmFile], context: ConnectContext) -> XArm:
    """Open the arm that a cell file describes."""
    said = settings.values
    openers = {name: tcp_opener(said.address, port, context.wires) for name, port in PORTS.items()}
    arm = XArm(lambda name: openers[name](), context.clock, said.limits, said)
    arm.takes_over = context.takes_over
    arm.outside_stop = "pomona.devices.xarm.outside:stop", (said.address, PORTS["command"])
    ports = ", ".join(map(str, PORTS.values()))
    return settings.opened(
        arm,
        {
            WrongModelError: ("model", "is the address that of the right robot?"),
            DeviceLost: (
                "address",
                f"is the controller on, and do ports {ports} answer at {said.address}?",
            ),
            DeviceError: ("address", ""),
        },
    )
