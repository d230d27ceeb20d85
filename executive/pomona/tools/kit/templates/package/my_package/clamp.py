"""The driver `clamp` of a cell file: a parallel gripper."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from pomona.drivers import (
    ConnectContext,
    DeviceError,
    DeviceLost,
    GripperLimits,
    GripperState,
    ParallelGripper,
    Settings,
    SpeedOrder,
    TcpLink,
    Wanted,
    WidthOrder,
    driver,
    tcp_opener,
)
from pomona.executive import (
    FORCE,
    LENGTH,
    SPEED,
    Address,
    Clock,
    Link,
    Malformed,
    Measure,
    Nonsense,
    Span,
    value,
)

PERIOD = 0.01  # between questions for the state [s]
SILENCE = 0.1  # without an answer for this long it is lost [s]
WATCHDOG = 0.1  # a streamed speed that is not renewed within this time becomes zero [s]
ACCELERATION = 2.0  # with which the gripper's moves begin and end [m/s²]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClampOptions:
    """A parallel gripper on TCP; without an address an emulated one in this process."""

    tcp: tuple[str, int] | None = value(Address(4001), None, "HOST:PORT; default: emulated")
    opening: tuple[float, float] = value(
        Span(Measure(LENGTH, "0 mm", "500 mm")),
        (0.0, 0.1),
        "least and largest opening between the pads",
    )
    speed_max: float = value(Measure(SPEED, "1 mm/s", "1 m/s"), "100 mm/s", "of the opening")
    force_max: float = value(Measure(FORCE, "0.1 N", "500 N"), "20 N", "of one finger")
    obstacle: float = value(Measure(LENGTH, "0 mm", "1 m"), "0 mm", "in the emulated gripper")

    @property
    def wires(self) -> tuple[str, ...]:
        return () if self.tcp is None else (f"{self.tcp[0]}:{self.tcp[1]}",)

    @property
    def limits(self) -> GripperLimits:
        """Set `force_min` for a gripper that presses with a least force of its own."""
        return GripperLimits(*self.opening, self.speed_max, self.force_max)

    def known(self) -> Iterator[object]:
        """Yield the limits, which the check of a tree needs."""
        yield self.limits


class Clamp(ParallelGripper[GripperState, str]):
    """The gripper. Its lines, in µm, µm/s and µN: `state?`, `move WIDTH SPEED FORCE`, `speed SPEED FORCE`, `stop`.

    It stops by itself when it hears nothing for 0.2 s."""

    outlives = True

    def __init__(self, open_wire: Callable[[], Link], clock: Clock, options: ClampOptions) -> None:
        super().__init__(
            "gripper", clock, options.limits, acceleration=ACCELERATION, watchdog=WATCHDOG
        )
        self._open_wire, self._asked_at = open_wire, 0.0

    def _open(self) -> None:
        self._wire = self._open_wire()
        self._begun, self._heard_at = b"", self._clock.now()

    def _serve(self) -> None:
        now = self._clock.now()
        if now - self._asked_at >= PERIOD:
            self._asked_at = now
            self._wire.send(b"state?\n")
        *lines, self._begun = (self._begun + self._wire.receive(0.004)).split(b"\n")
        for line in lines:
            try:
                width, speed = (1e-6 * float(word) for word in line.split())
            except ValueError:
                raise Nonsense(self.name, Malformed(line, "no width and speed")) from None
            self._heard_at = self._clock.now()
            self._measured(self._heard_at, width, speed)
            self._status = self._state
        silent = self._clock.now() - self._heard_at
        if silent > SILENCE:
            self._lose(DeviceLost(self.name, f"no answer for {1e3 * silent:.0f} ms"))

    def next_command(self, wanted: Wanted, status: GripperState) -> str:
        """Return the line that brings the fingers to what is wanted."""
        match wanted:
            case WidthOrder(width, speed, force):
                return f"move {1e6 * width:.0f} {1e6 * speed:.0f} {1e6 * force:.0f}"
            case SpeedOrder(speed):
                return f"speed {1e6 * speed:.0f} {1e6 * self.limits.force_max:.0f}"
        return "stop"

    def _send(self, command: str) -> None:
        self._wire.send(command.encode() + b"\n")

    def _leave(self) -> None:
        self._wire.close()


class EmulatedClamp:
    """The other end of the wire: fingers that move as they are commanded, down to an elastic object between them."""

    def __init__(self, clock: Clock, obstacle: float = 0.0) -> None:
        self.width, self.obstacle, self.stiffness = 0.08, obstacle, 2e4  # of the object [N/m]
        self._clock, self._answers = clock, b""
        self._then = self._heard_at = clock.now()
        self._aim, self._speed, self._force, self._rate = 0.0, 0.0, 20.0, 0.0

    @property
    def force(self) -> float:
        """Force of one finger on the object [N]."""
        return self.stiffness * max(self.obstacle - self.width, 0.0) / 2.0

    def send(self, chunk: bytes) -> None:
        self.advance(self._clock.now())
        self._heard_at = self._then
        for line in chunk.decode().splitlines():
            word, *numbers = line.split()
            values = [1e-6 * int(number) for number in numbers]
            if word == "move":
                self._aim, self._speed, self._force = values
            elif word == "speed":
                self._aim, self._speed, self._force = (
                    float(values[0] > 0.0),
                    abs(values[0]),
                    values[1],
                )
            elif word == "stop":
                self._speed = 0.0
            else:
                self._answers += b"%d %d\n" % (round(1e6 * self.width), round(1e6 * self._rate))

    def advance(self, now: float) -> None:
        """Move the fingers until now [s]."""
        elapsed, self._then = now - self._then, now
        if elapsed <= 0.0:
            return
        if now - self._heard_at > 0.2:
            self._speed = 0.0
        before, way = self.width, self._speed * elapsed
        least = min(self.obstacle - 2.0 * self._force / self.stiffness, before)
        self.width = max(min(max(self._aim, before - way), before + way), least)
        self._rate = (self.width - before) / elapsed

    def receive(self, timeout: float) -> bytes:
        self._clock.advance(timeout)
        self.advance(self._clock.now())
        answers, self._answers = self._answers, b""
        return answers

    def close(self) -> None:
        """Nothing: it stops when it hears nothing."""


def stop(host: str, port: int) -> None:
    """Stop the gripper at this address over a wire of its own: its driver's process is gone."""
    TcpLink(host, port).send(b"stop\n")


@driver(Clamp, ClampOptions)
def connect(settings: Settings[ClampOptions], context: ConnectContext) -> Clamp:
    """`driver: clamp`"""
    options, clock = settings.values, context.clock
    emulated, tcp = EmulatedClamp(clock, options.obstacle), options.tcp
    open_wire = (lambda: emulated) if tcp is None else tcp_opener(*tcp, context.wires)
    gripper = Clamp(open_wire, clock, options)
    gripper.outside_stop = None if tcp is None else ("my_package.clamp:stop", tcp)
    return settings.opened(gripper, {DeviceError: ("tcp", "is it on, and on this network?")})
