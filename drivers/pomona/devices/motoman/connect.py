"""The driver `motoman` of a cell file."""

from __future__ import annotations

from pomona.devices.motoman.driver import MotomanArm
from pomona.devices.motoman.options import MotomanFile
from pomona.drivers import ConnectContext, DeviceLost, Settings, driver, tcp_opener


@driver(MotomanArm, MotomanFile)
def connect(settings: Settings[MotomanFile], context: ConnectContext) -> MotomanArm:
    """Open the arm that a cell file describes."""
    said = settings.values
    host, port = said.address
    openers = {
        "state": tcp_opener(host, port + 1, context.wires),
        "motion": tcp_opener(host, port, context.wires),
    }
    arm = MotomanArm(lambda name: openers[name](), context.clock, said.limits, said)
    arm.outside_stop = (
        "pomona.devices.motoman.outside:stop",
        (host, port, said.order, said.group),
    )
    hint = f"is the controller on, and does MotoROS listen on {host}:{port} and {port + 1}?"
    return settings.opened(arm, {DeviceLost: ("address", hint)})
