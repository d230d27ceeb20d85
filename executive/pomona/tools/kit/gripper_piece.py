"""Files written by `pomona new gripper`: a driver on the base of parallel grippers, and an emulated gripper."""

from __future__ import annotations

from pomona.tools.kit.piece import Piece

GRIPPER = Piece(
    "a parallel gripper on the base `ParallelGripper`, with an emulated one at the other end of its wire",
    {
        "$module/$name.py": '''"""The driver `$name` of a cell file: a parallel gripper."""

from __future__ import annotations

from dataclasses import dataclass

from pomona.drivers import (
    ConnectContext,
    DeviceError,
    DeviceLost,
    GripperLimits,
    GripperMotion,
    ParallelGripper,
    Settings,
    TcpLink,
    driver,
    tcp_opener,
)
from pomona.executive import FORCE, LENGTH, SPEED, Address, Clock, Link, Malformed, Measure, Nonsense, Span, value

PERIOD, SILENCE = 0.01, 0.1  # between questions for the state; without an answer for this long it is lost [s]
WATCHDOG = 0.1  # a streamed speed that is not renewed within this time becomes zero [s]
ACCELERATION = 2.0  # with which the gripper's moves begin and end [m/s²]


@dataclass(frozen=True, slots=True, kw_only=True)
class ${Name}Options:
    """A parallel gripper on TCP; without an address an emulated one in this process."""

    tcp: tuple[str, int] | None = value(Address(4001), None, "HOST or HOST:PORT; default: an emulated gripper")
    opening: tuple[float, float] = value(
        Span(Measure(LENGTH, "0 mm", "500 mm")), (0.0, 0.1), "least and largest opening between the pads"
    )
    speed_max: float = value(Measure(SPEED, "1 mm/s", "1 m/s"), "100 mm/s", "largest speed of the opening")
    force_max: float = value(Measure(FORCE, "0.1 N", "500 N"), "20 N", "largest force of one finger")
    obstacle: float = value(Measure(LENGTH, "0 mm", "500 mm"), "0 mm", "width of an object in the emulated gripper")

    @property
    def wires(self) -> tuple[str, ...]:
        return () if self.tcp is None else (f"{self.tcp[0]}:{self.tcp[1]}",)


class $Name(ParallelGripper):
    """The gripper. Its lines, with lengths in µm: `state?`, `move WIDTH SPEED`, `speed SPEED`, `stop`."""

    outlives = True

    def __init__(self, wire: Link, clock: Clock, options: ${Name}Options, name: str = "gripper") -> None:
        limits = GripperLimits(*options.opening, options.speed_max, options.force_max)
        super().__init__(name, clock, limits, acceleration=ACCELERATION, watchdog=WATCHDOG)
        self._wire, self._begun = wire, b""
        self._asked_at = self._heard_at = clock.now()

    def step(self) -> None:
        now = self._clock.now()
        if now - self._asked_at >= PERIOD:
            self._asked_at = now
            self._wire.send(b"state?\\n")
        *lines, self._begun = (self._begun + self._wire.receive(0.004)).split(b"\\n")
        for line in lines:
            self._take(line)
        silent = self._clock.now() - self._heard_at
        if silent > SILENCE:
            self._lose(DeviceLost(self.name, f"no answer for {1e3 * silent:.0f} ms"))
        self._supervise()

    def _take(self, line: bytes) -> None:
        try:
            width, speed = (1e-6 * float(word) for word in line.split())
        except ValueError:
            raise Nonsense(self.name, Malformed(line, "no width and speed")) from None
        self._heard_at = self._clock.now()
        self._measured(self._heard_at, width, speed)

    def _send(self, *words: object) -> None:
        self._wire.send(" ".join(map(str, words)).encode() + b"\\n")

    def _start_move(self, move: GripperMotion) -> None:
        self._send("move", round(1e6 * move.width), round(1e6 * move.speed))

    def _start_stream(self, speed: float) -> None:
        self._send("speed", round(1e6 * speed))

    def _start_rest(self) -> None:
        self._send("stop")

    def _leave(self) -> None:
        self._wire.close()


class Emulated$Name:
    """The other end of the wire: fingers that move as they are commanded, down to an object between them."""

    def __init__(self, clock: Clock, obstacle: float = 0.0) -> None:
        self.width, self.obstacle, self.silent = 0.08, obstacle, False
        self._clock, self._moved_at = clock, clock.now()
        self._aim, self._speed, self._answers = self.width, 0.0, b""

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
                self._answers += b"%d %d\\n" % (round(1e6 * self.width), round(1e6 * self._advance()))

    def _advance(self) -> float:
        """Move the fingers; return the rate of the opening [m/s]."""
        elapsed, self._moved_at = self._clock.now() - self._moved_at, self._clock.now()
        before, way = self.width, self._speed * elapsed
        self.width = max(min(max(self._aim, before - way), before + way), min(self.obstacle, before))
        return (self.width - before) / elapsed if elapsed > 0.0 else 0.0

    def receive(self, timeout: float) -> bytes:
        self._clock.advance(timeout)
        answers, self._answers = self._answers, b""
        return answers

    def close(self) -> None:
        self._aim = self.width


def stop(host: str, port: int) -> None:
    """Stop the gripper at this address over a wire of its own: its driver's process is gone."""
    TcpLink(host, port).send(b"stop\\n")


@driver($Name, ${Name}Options)
def connect(settings: Settings[${Name}Options], context: ConnectContext) -> $Name:
    """`driver: $name`"""
    options, clock = settings.values, context.clock
    try:
        emulated = Emulated$Name(clock, options.obstacle)
        wire = emulated if options.tcp is None else tcp_opener(*options.tcp, context.wires)()
        gripper = $Name(wire, clock, options)
        gripper.connect()
    except (OSError, DeviceError) as error:
        raise settings.error(str(error), "tcp", "is the gripper switched on, and on this network?") from error
    gripper.outside_stop = None if options.tcp is None else ("$module.$name:stop", options.tcp)
    gripper.start()
    return gripper
''',
        "cells/$name.yaml": """# This gripper alone: pomona run cells/${name}_tree.yaml --cell cells/$name.yaml
name: $name
kind: emulated                # with an address below: real

devices:
  gripper: {driver: $name, obstacle: 50 mm}   # tcp: HOST of a real one, without an obstacle
""",
        "cells/${name}_tree.yaml": """# Close on an object, until it stops the fingers.
pomona: 1
tree: ${name}_tree

root:
  sequence:
    - Grasp: {width: 20 mm, speed: 50 mm/s}
""",
        "tests/test_$name.py": '''"""The driver `$name` at the emulated gripper, on a clock that the test moves."""

from __future__ import annotations

import pytest
from pomona.drivers import DeviceLost, Gripper, MotionRefused, MotionState
from pomona.executive import ManualClock

from $module.$name import Emulated$Name, $Name, ${Name}Options

Pair = tuple[$Name, Emulated$Name]


@pytest.fixture
def pair() -> Pair:
    clock = ManualClock()
    wire = Emulated$Name(clock)
    gripper = $Name(wire, clock, ${Name}Options())
    gripper.connect()
    return gripper, wire


def serve(gripper: $Name, steps: int) -> None:
    for _ in range(steps):  # of 4 ms
        gripper.step()


def test_a_move_goes_to_its_width(pair: Pair) -> None:
    gripper, wire = pair
    motion = gripper.move(0.03, 0.1)
    serve(gripper, 300)
    assert isinstance(gripper, Gripper)
    assert (motion.state, motion.settled) == (MotionState.DONE, True)
    assert wire.width == pytest.approx(0.03)
    gripper.check()


def test_an_object_stops_a_move_which_is_no_fault(pair: Pair) -> None:
    gripper, wire = pair
    wire.obstacle = 0.05
    motion = gripper.move(0.03, 0.1)
    serve(gripper, 300)
    assert motion.problem == "the fingers are blocked at 50.0 mm"
    gripper.check()


def test_a_safe_stop_ends_a_move_and_nothing_opens_after_it(pair: Pair) -> None:
    gripper, wire = pair
    gripper.move(0.03, 0.1)
    serve(gripper, 50)
    gripper.safe_stop("test")
    serve(gripper, 100)
    stood = wire.width
    gripper.set_speed(0.05)
    serve(gripper, 100)
    assert gripper.settled()
    assert wire.width == stood
    with pytest.raises(MotionRefused, match="latched"):
        gripper.move(0.03, 0.1)


def test_a_streamed_speed_ends_when_it_is_not_renewed(pair: Pair) -> None:
    gripper, wire = pair
    gripper.set_speed(-0.02)
    serve(gripper, 200)
    assert wire.width == pytest.approx(0.08 - 0.02 * 0.1, abs=5e-4)
    gripper.check()


def test_silence_is_a_loss_until_it_is_acknowledged(pair: Pair) -> None:
    gripper, wire = pair
    wire.silent = True
    serve(gripper, 50)
    with pytest.raises(DeviceLost, match="no answer for"):
        gripper.check()
    wire.silent = False
    serve(gripper, 50)
    with pytest.raises(DeviceLost, match="acknowledge the loss"):
        gripper.set_speed(-0.02)
    gripper.acknowledge()
    gripper.check()
''',
    },
    entry=("pomona.drivers", "$name", "$module.$name:connect"),
)
