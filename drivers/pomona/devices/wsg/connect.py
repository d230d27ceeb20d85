"""The driver `wsg` of a cell file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from pomona.devices.wsg.driver import WsgGripper
from pomona.devices.wsg.handshake import WsgOptions
from pomona.devices.wsg.transport import TCP_PORT, CanLink, can_channels
from pomona.drivers import (
    HAND_STROKES,
    Address,
    ConnectContext,
    DeviceLost,
    GripperLimits,
    GripperSupervision,
    Link,
    Settings,
    Surroundings,
    driver,
    other_fingers,
    tcp_opener,
)
from pomona.executive import (
    ACCELERATION,
    FORCE,
    LENGTH,
    SPEED,
    TIME,
    Flag,
    Measure,
    Problem,
    Section,
    Span,
    Text,
    Whole,
    value,
)

LEAST_FORCE = 5.0  # of one finger, of each WSG (data sheets) [N]


@dataclass(frozen=True, slots=True, kw_only=True)
class CanFile:
    """The gripper's CAN bus."""

    interface: str = value(Text(), "socketcan", "of python-can")
    channel: str = value(Text(), "can0", "of the interface")
    bitrate: int = value(Whole(10_000, 1_000_000), 500_000, "bits per second")
    send_id: int = value(Whole(0, 0x7FF), 1, "CAN id of messages to the gripper")
    reply_id: int = value(Whole(0, 0x7FF), 2, "CAN id of messages from the gripper")


@dataclass(frozen=True, slots=True, kw_only=True)
class WsgFile:
    """A Weiss WSG gripper on TCP or CAN."""

    tcp: tuple[str, int] | None = value(
        Address(TCP_PORT), None, "HOST or HOST:PORT; alternatively 'can'"
    )
    can: CanFile | None = value(Section(CanFile), None, "the CAN bus; alternatively 'tcp'")
    finger_offset: float = value(
        Measure(LENGTH, "-200 mm", "500 mm"),
        "0 mm",
        "opening between the pads' faces when the jaws are closed",
    )
    soft_limits: tuple[float, float] | None = value(
        Span(Measure(LENGTH)), None, "least and largest opening"
    )
    acceleration: float | None = value(
        Measure(ACCELERATION, "0.1 mm/s²", "50 m/s²"), None, "default: the gripper's own"
    )
    force_limit: float | None = value(
        Measure(FORCE, "0.1 mN", "500 N"), None, "default: the gripper's own"
    )
    speed_max: float | None = value(
        Measure(SPEED, "0.1 mm/s", "1 m/s"), None, "default: the gripper's own"
    )
    home: bool = value(
        Flag(),
        False,
        "home a gripper without a reference in a start with --cleared: the fingers move",
    )
    watchdog: float = value(
        Measure(TIME, "30 ms", "1 s"),
        "100 ms",
        "a streamed speed that is not renewed within this time becomes zero",
    )
    silence: float = value(
        Measure(TIME, "15 ms", "1 s"), "45 ms", "without a reply for this long the gripper is lost"
    )
    supervision: GripperSupervision = value(
        Section(GripperSupervision),
        GripperSupervision(),
        "how closely the gripper must follow its commands",
    )

    @property
    def wires(self) -> tuple[str, ...]:
        if self.tcp is not None:
            return (f"{self.tcp[0]}:{self.tcp[1]}",)
        return (
            ()
            if self.can is None
            else (f"{self.can.interface} {self.can.channel}, id {self.can.send_id}",)
        )

    def problems(self) -> Iterator[Problem]:
        if (self.tcp is None) == (self.can is None):
            yield Problem("tcp", "the gripper needs either 'tcp' or 'can'")
        if self.soft_limits is not None and self.soft_limits[0] < self.finger_offset:
            yield Problem("soft_limits", "they are openings: they cannot lie below finger_offset")

    def known(self) -> Iterator[object]:
        """Yield the limits, which a check of a tree needs: those of a WSG 32, where the file has none."""
        closed = self.finger_offset
        opening = self.soft_limits or (closed, closed + HAND_STROKES["WSG 32"])
        yield GripperLimits(*opening, self.speed_max or 0.4, self.force_limit or 50.0, LEAST_FORCE)

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        yield from other_fingers(around, "WSG", self.finger_offset)


@driver(WsgGripper, WsgFile)
def connect(settings: Settings[WsgFile], context: ConnectContext) -> WsgGripper:
    """Open the gripper that a cell file describes."""
    said = settings.values
    options = WsgOptions(
        finger_offset=said.finger_offset,
        acceleration=said.acceleration,
        force_limit=said.force_limit,
        soft_limits=said.soft_limits,
        speed_max=said.speed_max,
        home=said.home and context.cleared,
        watchdog=said.watchdog,
        silence=said.silence,
        supervision=said.supervision,
    )
    open_link, key, outside_stop = _link(said, context)
    gripper = WsgGripper(open_link, context.clock, options)
    try:
        gripper.connect()
    except DeviceLost as error:
        raise settings.error(error.message, key, _what_is_there(key)) from error
    gripper.outside_stop = outside_stop
    gripper.start()
    return gripper


def _link(
    said: WsgFile, context: ConnectContext
) -> tuple[Callable[[], Link], str, tuple[str, tuple[Any, ...]]]:
    """How to open the wire, the setting's name, and how another process stops the gripper over a wire of its own."""
    if said.tcp is not None:
        host, port = said.tcp
        return (
            tcp_opener(host, port, context.wires),
            "tcp",
            ("pomona.devices.wsg.outside:stop", (host, port)),
        )
    can = said.can or CanFile()
    where = (can.interface, can.channel, can.bitrate, can.send_id, can.reply_id)
    return (lambda: CanLink.open(*where)), "can", ("pomona.devices.wsg.outside:stop_on_can", where)


def _what_is_there(key: str) -> str:
    if key == "tcp":
        return "is the gripper switched on, and its TCP interface (port 1000, binary commands) enabled?"
    return f"CAN interfaces of this machine: {', '.join(can_channels()) or 'none'}"
