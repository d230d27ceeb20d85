"""The driver `clamp` of a cell file: a parallel gripper."""

from __future__ import annotations

from collections.abc import Iterator
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

    tcp: tuple[str, int] | None = value(
        Address(4001), None, "HOST or HOST:PORT; default: an emulated gripper"
    )
    opening: tuple[float, float] = value(
        Span(Measure(LENGTH, "0 mm", "500 mm")),
        (0.0, 0.1),
        "least and largest opening between the pads",
    )
    speed_max: float = value(
        Measure(SPEED, "1 mm/s", "1 m/s"), "100 mm/s", "largest speed of the opening"
    )
    force_max: float = value(
        Measure(FORCE, "0.1 N", "500 N"), "20 N", "largest force of one finger"
    )
    obstacle: float = value(
        Measure(LENGTH, "0 mm", "500 mm"), "0 mm", "width of an object in the emulated gripper"
    )

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
    """The gripper. Its lines, with lengths in µm: `state?`, `move WIDTH SPEED`, `speed SPEED`, `stop`."""

    outlives = True

    def __init__(
        self, wire: Link, clock: Clock, options: ClampOptions, name: str = "gripper"
    ) -> None:
        super().__init__(name, clock, options.limits, acceleration=ACCELERATION, watchdog=WATCHDOG)
        self._wire = wire
        self._begun = b""
        self._asked_at = self._heard_at = clock.now()

    def _serve(self) -> None:
        now = self._clock.now()
        if now - self._asked_at >= PERIOD:
            self._asked_at = now
            self._wire.send(b"state?\n")
        *lines, self._begun = (self._begun + self._wire.receive(0.004)).split(b"\n")
        for line in lines:
            self._take(line)
        silent = self._clock.now() - self._heard_at
        if silent > SILENCE:
            self._lose(DeviceLost(self.name, f"no answer for {1e3 * silent:.0f} ms"))

    def _take(self, line: bytes) -> None:
        try:
            width, speed = (1e-6 * float(word) for word in line.split())
        except ValueError:
            raise Nonsense(self.name, Malformed(line, "no width and speed")) from None
        self._heard_at = self._clock.now()
        self._measured(self._heard_at, width, speed)
        self._status = self._state

    def next_command(self, wanted: Wanted, status: GripperState) -> str:
        """Return the line that brings the fingers to what is wanted."""
        match wanted:
            case WidthOrder(width, speed):
                return f"move {round(1e6 * width)} {round(1e6 * speed)}"
            case SpeedOrder(speed):
                return f"speed {round(1e6 * speed)}"
        return "stop"

    def _send(self, command: str) -> None:
        self._wire.send(command.encode() + b"\n")

    def _leave(self) -> None:
        self._wire.close()


class EmulatedClamp:
    """The other end of the wire: fingers that move as they are commanded, down to an object between them."""

    def __init__(self, clock: Clock, obstacle: float = 0.0) -> None:
        self.width = 0.08
        self.obstacle = obstacle
        self.silent = False
        self._clock, self._moved_at = clock, clock.now()
        self._aim = self.width
        self._speed = 0.0
        self._answers = b""

    def send(self, chunk: bytes) -> None:
        for line in chunk.decode().splitlines():
            word, *numbers = line.split()
            values = [1e-6 * int(number) for number in numbers]
            if word == "move":
                self._aim, self._speed = values
            elif word == "speed":
                self._aim, self._speed = (1.0 if values[0] > 0.0 else 0.0), abs(values[0])
            elif word == "stop":
                self._aim = self.width
            elif not self.silent:
                self._answers += b"%d %d\n" % (
                    round(1e6 * self.width),
                    round(1e6 * self._advance()),
                )

    def _advance(self) -> float:
        """Move the fingers; return the rate of the opening [m/s]."""
        elapsed = self._clock.now() - self._moved_at
        self._moved_at = self._clock.now()
        before = self.width
        way = self._speed * elapsed
        self.width = max(
            min(max(self._aim, before - way), before + way), min(self.obstacle, before)
        )
        return (self.width - before) / elapsed if elapsed > 0.0 else 0.0

    def receive(self, timeout: float) -> bytes:
        self._clock.advance(timeout)
        answers = self._answers
        self._answers = b""
        return answers

    def close(self) -> None:
        self._aim = self.width


def stop(host: str, port: int) -> None:
    """Stop the gripper at this address over a wire of its own: its driver's process is gone."""
    TcpLink(host, port).send(b"stop\n")


@driver(Clamp, ClampOptions)
def connect(settings: Settings[ClampOptions], context: ConnectContext) -> Clamp:
    """`driver: clamp`"""
    options = settings.values
    clock = context.clock
    try:
        emulated = EmulatedClamp(clock, options.obstacle)
        wire = emulated if options.tcp is None else tcp_opener(*options.tcp, context.wires)()
        gripper = Clamp(wire, clock, options)
        gripper.connect()
    except (OSError, DeviceError) as error:
        raise settings.error(
            str(error), "tcp", "is the gripper switched on, and on this network?"
        ) from error
    gripper.outside_stop = None if options.tcp is None else ("my_package.clamp:stop", options.tcp)
    gripper.start()
    return gripper
