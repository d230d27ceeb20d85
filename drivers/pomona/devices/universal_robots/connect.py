"""The driver `universal-robots` of a cell file."""

from __future__ import annotations

from pomona.devices.universal_robots.dashboard import WrongArmError
from pomona.devices.universal_robots.driver import UrArm
from pomona.devices.universal_robots.options import PORTS, UrFile
from pomona.drivers import ConnectContext, DeviceError, DeviceLost, Settings, driver, tcp_opener


@driver(UrArm, UrFile)
def connect(settings: Settings[UrFile], context: ConnectContext) -> UrArm:
    """Open the arm that a cell file describes."""
    said = settings.values
    openers = {name: tcp_opener(said.address, port, context.wires) for name, port in PORTS.items()}
    arm = UrArm(lambda name: openers[name](), context.clock, said.limits, said)
    arm.outside_stop = (
        "pomona.devices.universal_robots.outside:stop",
        (said.address, PORTS["dashboard"]),
    )
    ports = ", ".join(map(str, PORTS.values()))
    return settings.opened(
        arm,
        {
            WrongArmError: ("model", "is the address that of the right robot?"),
            DeviceLost: (
                "address",
                f"is the controller on, and do ports {ports} answer at {said.address}?",
            ),
            DeviceError: ("address", ""),
        },
    )
