"""Handshake with a WSG gripper before its use: the same at every connection, except for motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pomona.devices.wsg.codec import (
    Command,
    Homing,
    Observe,
    Plain,
    Reply,
    Request,
    Script,
    SetSoftLimits,
    SetValue,
    Status,
    SystemState,
)
from pomona.devices.wsg.session import GripperSession
from pomona.drivers import DeviceFault, GripperLimits, GripperSupervision

ANSWER = 0.5
HOMING = 20.0  # deadlines of a request of the handshake, and of homing [s]


@dataclass(frozen=True, slots=True)
class WsgOptions:
    """Options of the gripper in the cell file."""

    finger_offset: float = 0.0  # opening between the pads' faces when the jaws' width is 0 [m]
    acceleration: float | None = None  # of moves [m/s²], or None for the gripper's own
    # of one finger in moves [N], or None for the largest
    force_limit: float | None = None
    soft_limits: tuple[float, float] | None = None  # least and most opening [m], or None
    # of moves and streamed speeds [m/s], or None for the gripper's own
    speed_max: float | None = None
    # find the reference at the first connection; the fingers move and would drop a held object. Never done at a
    # reconnection.
    home: bool = False
    watchdog: float = 0.1  # a streamed speed that is not renewed within this time becomes zero [s]
    silence: float = 0.045  # time without a reply after which the gripper is lost [s]
    period: float = 0.01  # of the automatic updates of state, width and speed [s]
    # how closely the gripper must follow its commands; None for the defaults
    supervision: GripperSupervision | None = None


@dataclass(frozen=True, slots=True)
class WsgIdentity:
    """Data that a gripper reported: firmware, limits of the hardware, and settings read back [SI units]."""

    kind: int
    hardware: int
    firmware: int
    serial: int
    stroke: float
    speed_max: float
    force_min: float
    force_max: float
    acceleration: float
    force_limit: float
    has_script: bool

    def limits(self, options: WsgOptions) -> GripperLimits:
        """Return the narrower of the hardware's and the cell file's limits, as openings between the pads."""
        low, high = options.soft_limits or (
            options.finger_offset,
            options.finger_offset + self.stroke,
        )
        speed = min(options.speed_max or self.speed_max, self.speed_max)
        force = min(options.force_limit or self.force_max, self.force_max)
        return GripperLimits(low, high, speed, force, self.force_min)

    def reach(self, options: WsgOptions) -> GripperLimits:
        """Return the hardware's limits, as openings between the pads."""
        low = options.finger_offset
        return GripperLimits(low, low + self.stroke, self.speed_max, self.force_max)


def shake_hands(
    session: GripperSession, options: WsgOptions, take: Callable[[Reply], None], first: bool
) -> WsgIdentity:
    """Ask who is there, stop the fingers, set and read back the settings, switch on the automatic updates.

    The stop comes before everything else: a move from before may still be under way.

    Args:
        take: gets every update of state, width and speed.
        first: whether homing and taring may be done, if the options want them.

    Raises:
        OSError, DeviceError: see `GripperSession.demand`.
    """

    def demand(request: Request, deadline: float = ANSWER) -> tuple[float, ...]:
        reply = session.demand(request, take, deadline)
        take(reply)
        return reply.values

    kind, hardware, firmware, serial = demand(Plain(Command.INFO))
    stop = session.ask(Plain(Command.STOP), take, ANSWER)
    stroke, _, speed_max, _, _, force_min, force_max, _ = demand(Plain(Command.LIMITS))
    if options.acceleration is not None:
        demand(SetValue(Command.SET_ACCELERATION, options.acceleration))
    if options.force_limit is not None:
        demand(SetValue(Command.SET_FORCE_LIMIT, options.force_limit))
    if options.soft_limits is None:
        demand(Plain(Command.CLEAR_SOFT_LIMITS))
    else:
        minus, plus = (limit - options.finger_offset for limit in options.soft_limits)
        demand(SetSoftLimits(minus, plus))
    (acceleration,) = demand(Plain(Command.GET_ACCELERATION))
    (force_limit,) = demand(Plain(Command.GET_FORCE_LIMIT))
    (bits,) = demand(Observe(Command.SYSTEM_STATE))
    if stop.status is not Status.SUCCESS and int(bits) & SystemState.MOVING:
        raise DeviceFault(session.device, f"moves, and refused STOP: {stop.status.name}")
    if options.home and first and not int(bits) & SystemState.REFERENCED:
        demand(Homing(), HOMING)
    probe = session.ask(Script(Command.SCRIPT_READ), take, ANSWER)
    for command in (Command.WIDTH, Command.SPEED, Command.SYSTEM_STATE):
        demand(Observe(command, True, options.period))
    has_script = probe.status is Status.SUCCESS
    return WsgIdentity(
        int(kind),
        int(hardware),
        int(firmware),
        int(serial),
        stroke,
        speed_max,
        force_min,
        force_max,
        acceleration,
        force_limit,
        has_script,
    )
