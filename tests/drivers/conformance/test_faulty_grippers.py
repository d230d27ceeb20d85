"""Five mistakes that a stranger's driver may hold: the claims find each, every time, and say which."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from typing import Any

import pytest

from pomona.drivers import Link, WidthOrder
from pomona.drivers.conformance import (
    GRIPPER,
    BenchClock,
    Finding,
    GripperBench,
    Wire,
    judged,
)
from pomona.tools.kit.pieces import TEMPLATES

PACKAGE = TEMPLATES / "package"
TIMES = 5


@pytest.fixture(scope="module")
def stranger() -> dict[str, Any]:
    """The names of the driver that `pomona new gripper clamp` writes."""
    name = "clamp_of_a_stranger"
    module = type(sys)(name)
    sys.modules[name] = module  # where its dataclasses look for their names
    module.__dict__.update(runpy.run_path(str(PACKAGE / "my_package" / "clamp.py"), run_name=name))
    return module.__dict__


def forgets_a_stop(clamp: Any) -> type:
    """A driver whose loss forgets the stop, too."""

    class Forgetful(clamp):  # type: ignore[misc]
        def _rest(self) -> None:
            super()._rest()
            if self._unacknowledged:
                self._wanted = None

    return Forgetful


def believes_what_it_sent(clamp: Any) -> type:
    """A driver that is settled as soon as a stop is on its way."""

    class Believing(clamp):  # type: ignore[misc]
        def settled(self) -> bool:
            return not isinstance(self._wanted, WidthOrder)

    return Believing


def ignores_a_force(clamp: Any) -> type:
    """A driver that always presses as it can."""

    class Strong(clamp):  # type: ignore[misc]
        def next_command(self, wanted: Any, status: Any) -> Any:
            if isinstance(wanted, WidthOrder):
                wanted = WidthOrder(wanted.width, wanted.speed, self.limits.force_max)
            return super().next_command(wanted, status)

    return Strong


def goes_on_when_it_is_connected_again(clamp: Any) -> type:
    """A driver that repeats its last move on a new wire."""

    class Eager(clamp):  # type: ignore[misc]
        def _open(self) -> None:
            super()._open()
            if self._asked is not None:
                move = self._asked
                self._wanted = WidthOrder(move.width, move.speed, move.force)

    return Eager


def halves_a_width(clamp: Any) -> type:
    """A driver that takes the way of one finger for the opening, both in what it tells and in what it commands."""

    class Half(clamp):  # type: ignore[misc]
        def _measured(self, stamp: float, width: float, speed: float) -> None:
            super()._measured(stamp, 0.5 * width, 0.5 * speed)

        def next_command(self, wanted: Any, status: Any) -> Any:
            if isinstance(wanted, WidthOrder):
                wanted = WidthOrder(2.0 * wanted.width, 2.0 * wanted.speed, wanted.force)
            return super().next_command(wanted, status)

    return Half


@pytest.mark.parametrize(
    ("mistake", "claim", "words"),
    [
        (
            forgets_a_stop,
            "a_problem_stops_the_fingers",
            "A problem that a driver reports ends each motion",
        ),
        (believes_what_it_sent, "settled_is_measured", "Fingers that are settled rest"),
        (ignores_a_force, "a_force_is_obeyed", "The force of a move bounds that of each finger"),
        (
            goes_on_when_it_is_connected_again,
            "a_problem_stops_the_fingers",
            "A problem that a driver reports ends each motion",
        ),
        (halves_a_width, "a_width_is_true", "A move that is done has the fingers at its width"),
    ],
)
def test_a_mistake_is_found_each_time_and_its_claim_is_named(
    stranger: dict[str, Any], mistake: Callable[[Any], type], claim: str, words: str
) -> None:
    driver = mistake(stranger["Clamp"])

    def bench() -> GripperBench:
        clock = BenchClock()
        hand = stranger["EmulatedClamp"](clock)
        clock.each_step.append(hand.advance)
        links: Callable[[], Link] = lambda: hand  # noqa: E731
        wire = Wire(links)
        gripper: Any = driver(wire.open, clock, stranger["ClampOptions"]())
        gripper.connect()
        return GripperBench(gripper, clock, hand, wire)

    (judge,) = (one for one in GRIPPER.all if one.name == claim)
    for _ in range(TIMES):
        with pytest.raises(Finding, match=f"^{words}.*: .* mm|^{words}.* N"):
            judged(bench, judge)
