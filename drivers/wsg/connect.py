"""The driver `wsg` of a cell file."""

from __future__ import annotations

from collections.abc import Callable

from drivers.cell_file import Settings
from drivers.device import Bench
from drivers.errors import DeviceLost
from drivers.wire import Link, TcpLink, read_address
from drivers.wsg.driver import WsgGripper
from drivers.wsg.handshake import WsgOptions
from drivers.wsg.transport import TCP_PORT, CanLink, can_channels


def connect(settings: Settings, bench: Bench) -> WsgGripper:
    """Open the gripper that a cell file describes.

    gripper:
      driver: wsg
      tcp: 192.168.1.20:1000            # or can: {interface: socketcan, channel: can0, reply_id: 2}
      finger_offset: 35 mm              # opening between the pads' faces when the jaws are closed
      soft_limits: [36 mm, 102 mm]      # of the opening
      acceleration: 1 m/s²
      force_limit: 20 N
      speed_max: 200 mm/s
      home: true                        # find the reference when the run starts, if there is none: the fingers move
      tare: false
      watchdog: 100 ms                  # a streamed speed that is not renewed becomes zero
      silence: 45 ms                    # no reply for so long: the gripper is lost
    """
    open_link, key = _read_link(settings, bench)
    offset = settings.number("finger_offset", "length", 0.0, -0.2, 0.5)
    soft_limits = None
    if settings.has("soft_limits"):
        soft_limits = settings.span("soft_limits", "length")
        if soft_limits[0] < offset:
            raise settings.error("soft_limits are openings: they cannot lie below finger_offset", "soft_limits")
    options = WsgOptions(
        finger_offset=offset,
        acceleration=_optional(settings, "acceleration", "acceleration", 50.0),
        force_limit=_optional(settings, "force_limit", "force", 500.0),
        soft_limits=soft_limits,
        speed_max=_optional(settings, "speed_max", "speed", 1.0),
        home=settings.boolean("home", False),
        tare=settings.boolean("tare", False),
        watchdog=settings.number("watchdog", "time", 0.1, 0.03, 1.0),
        silence=settings.number("silence", "time", 0.045, 0.015, 1.0),
    )
    gripper = WsgGripper(open_link, bench.clock, options)
    try:
        gripper.connect()
    except DeviceLost as error:
        raise settings.error(error.message, key, _what_is_there(key)) from error
    gripper.start()
    return gripper


def _read_link(settings: Settings, bench: Bench) -> tuple[Callable[[], Link], str]:
    if settings.has("tcp") == settings.has("can"):
        raise settings.error("the gripper needs either 'tcp' or 'can'", "tcp")
    if settings.has("tcp"):
        host, port = read_address(settings, "tcp", TCP_PORT)
        return (lambda: TcpLink(host, port)), "tcp"
    can = settings.section("can")
    interface, channel = can.text("interface", "socketcan"), can.text("channel", "can0")
    bitrate = can.integer("bitrate", 500_000, 10_000, 1_000_000)
    send_id, reply_id = can.integer("send_id", 1, 0, 0x7FF), can.integer("reply_id", 2, 0, 0x7FF)
    can.finish()
    return (lambda: CanLink.open(interface, channel, bitrate, send_id, reply_id)), "can"


def _optional(settings: Settings, key: str, kind: str, high: float) -> float | None:
    return settings.number(key, kind, low=1e-4, high=high) if settings.has(key) else None


def _what_is_there(key: str) -> str:
    if key == "tcp":
        return "is the gripper switched on, and its TCP interface (port 1000, binary commands) enabled?"
    return f"CAN interfaces of this machine: {', '.join(can_channels()) or 'none'}"
