"""The drivers `robotiq-ft300` and `universal-robots-force` of a cell file."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.devices.universal_robots.options import HOST, PORTS
from pomona.devices.wrist_sensors.codec import RANGE
from pomona.devices.wrist_sensors.sensor import StreamOptions, WristSensor, WristSession
from pomona.devices.wrist_sensors.sessions import Ft300Session, UrForceSession
from pomona.drivers import (
    ConnectContext,
    Settings,
    driver,
    serial_opener,
    serial_ports,
    tcp_opener,
)
from pomona.executive import FORCE, MASS, RATE, TIME, Measure, Text, value

# of the FT 300 as delivered [bit/s], and of its stream [1/s]
BAUD = 19200
FT300_RATE = 100.0
RTDE = PORTS["rtde"]
UR_RANGE = 200.0  # of the forces that a UR20 measures [N]; smaller arms measure less

CARRIED = Measure(MASS, "10 g", "30 kg")


@dataclass(frozen=True, slots=True, kw_only=True)
class Ft300File:
    """A Robotiq FT 300 or FT 300-S between flange and hand, on a serial line of its own."""

    port: str = value(Text(), help="its serial port, of a USB adapter for RS-485")
    mass: float = value(CARRIED, help="mass that it carries: hand, camera and fruit")
    least: float = value(
        Measure(FORCE, "0.1 N", "50 N"),
        "0.5 N",
        "smallest lasting change that is no error: measure it",
    )
    silence: float = value(
        Measure(TIME, "40 ms", "1 s"), "100 ms", "without a sample for this long it is lost"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (self.port,)


@dataclass(frozen=True, slots=True, kw_only=True)
class UrForceFile:
    """The force/torque sensor of a Universal Robots e-series, UR20 or UR30, read by RTDE."""

    address: str = value(HOST, help="HOST of the controller")
    mass: float = value(CARRIED, help="mass that it carries: hand, camera and fruit")
    least: float = value(
        Measure(FORCE, "0.1 N", "50 N"),
        "4 N",
        "smallest lasting change that is no error: measure it",
    )
    rate: float = value(Measure(RATE, "50 Hz", "500 Hz"), "125 Hz", "samples per second")
    silence: float = value(
        Measure(TIME, "20 ms", "1 s"), "60 ms", "without a sample for this long it is lost"
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return (f"{self.address}:{RTDE}",)


@driver(WristSensor, Ft300File)
def connect_ft300(settings: Settings[Ft300File], context: ConnectContext) -> WristSensor:
    """Open the sensor that a cell file describes."""
    said = settings.values
    open_port = serial_opener(said.port, BAUD, context.wires)

    def session() -> WristSession:
        return Ft300Session(settings.name, open_port(), context.clock)

    options = StreamOptions(FT300_RATE, said.silence, RANGE)
    sensor = WristSensor(session, context.clock, options, said.mass, said.least, settings.name)
    hint = f"is the FT 300 powered, with the Modbus address 9? {serial_ports()}"
    return settings.opened(sensor, {Exception: ("port", hint)})


@driver(WristSensor, UrForceFile)
def connect_ur_force(settings: Settings[UrForceFile], context: ConnectContext) -> WristSensor:
    """Open the sensor that a cell file describes."""
    said = settings.values
    open_link = tcp_opener(said.address, RTDE, context.wires)

    def session() -> WristSession:
        return UrForceSession(settings.name, open_link(), context.clock, said.rate)

    options = StreamOptions(said.rate, said.silence, UR_RANGE)
    sensor = WristSensor(session, context.clock, options, said.mass, said.least, settings.name)
    hint = f"is the controller on, and does port {RTDE} answer at {said.address}?"
    return settings.opened(sensor, {Exception: ("address", hint)})
