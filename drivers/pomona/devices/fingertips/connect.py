"""The driver `robotiq-tsf85` of a cell file."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.devices.fingertips.codec import BAUD
from pomona.devices.fingertips.driver import TsfFingertips, TsfSession
from pomona.devices.wrist_sensors.sensor import StreamOptions
from pomona.drivers import (
    ConnectContext,
    Gripper,
    Settings,
    driver,
    may_hold,
    serial_opener,
    serial_ports,
)
from pomona.executive import FORCE, TIME, Counts, Measure, Text, value


@dataclass(frozen=True, slots=True, kw_only=True)
class TsfFile:
    """Two Robotiq TSF-85 fingertips on USB: contact and pressing force, no shear."""

    port: str = value(Text(), help="its serial port; better /dev/serial/by-id/…")
    count: float = value(
        Measure(FORCE, "0.001 mN", "1 N"),
        help="pressing force of one count: measure it with a scale",
    )
    zero: tuple[int, ...] | None = value(
        Counts(2, 0, 2_000_000),
        None,
        "sums of the left and right taxels without contact; by default taken at the start",
    )
    period: float = value(Measure(TIME, "2 ms", "50 ms"), "10 ms", "time between packets")
    silence: float = value(
        Measure(TIME, "40 ms", "1 s"), "100 ms", "without a packet for this long they are lost"
    )
    strongest: float = value(
        Measure(FORCE, "1 N", "500 N"), "100 N", "end of the range of a finger's pressing force"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (self.port,)


@driver(TsfFingertips, TsfFile)
def connect(settings: Settings[TsfFile], context: ConnectContext) -> TsfFingertips:
    """Open the fingertips that a cell file describes; their zero is taken only where nothing can press on them."""
    said = settings.values
    gripper = context.find(Gripper)
    if said.zero is None and gripper is not None and not context.cleared:
        held = may_hold(gripper.state(), gripper.limits, None, None)
        if held:
            hint = "empty the hand and start with --cleared, or give 'zero' here"
            raise settings.error(f"its zero cannot be taken: {held}", "port", hint)
    open_port = serial_opener(said.port, BAUD, context.wires)
    zero = None if said.zero is None else (float(said.zero[0]), float(said.zero[1]))

    def open_session() -> TsfSession:
        nonlocal zero
        session = TsfSession(
            settings.name, open_port(), context.clock, said.period, said.count, zero
        )
        zero = (
            float(session.zero[0]),
            float(session.zero[1]),
        )  # of the run: a line that is opened again takes none
        return session

    options = StreamOptions(1.0 / said.period, said.silence, said.strongest)
    fingertips = TsfFingertips(open_session, context.clock, options, settings.name)
    return settings.opened(
        fingertips, {Exception: ("port", f"are the TSF-85 on this port? {serial_ports()}")}
    )
