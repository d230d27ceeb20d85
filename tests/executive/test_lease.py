"""A handle commands its device while its lease is valid, and not a moment longer."""

from __future__ import annotations

import threading
from typing import Any, Protocol, runtime_checkable

import pytest

from pomona.executive.clock import ManualClock
from pomona.executive.errors import NotOwnerError
from pomona.executive.lease import (
    Lease,
    Leases,
    command,
    commands_of,
    give_up,
    identity,
    keep,
    leased,
    lend,
    motion,
    notice_of,
)


@runtime_checkable
class Stream(Protocol):
    """A motion that takes set-points."""

    def aim_at(self) -> str:
        """Is no command: nothing of it moves."""
        ...

    @command
    def aim(self, x: float) -> None: ...

    def stop(self) -> None: ...


@runtime_checkable
class Lathe(Protocol):
    """A device with two commands."""

    size: float

    @property
    def angle(self) -> float: ...

    def state(self) -> str: ...

    @command
    def turn(self, angle: float, *, slowly: bool = False) -> str: ...

    @motion
    def follow(self) -> Stream: ...


@runtime_checkable
class Eye(Protocol):
    """A device that moves nothing."""

    def look(self) -> str: ...


class Facts:
    """Known of a cell; no device."""


class Machine:
    """Is both."""

    name = "lathe"
    interfaces: tuple[type, ...] = (Lathe,)
    size = 0.3

    def __init__(self) -> None:
        self.angle = 0.0
        self.log: list[str] = []

    def state(self) -> str:
        return "turning" if self.angle else "at rest"

    def look(self) -> str:
        return "nothing"

    def turn(self, angle: float, *, slowly: bool = False) -> str:
        self.angle = angle
        return "slowly" if slowly else "fast"

    def follow(self) -> Machine:
        return self

    def aim_at(self) -> str:
        return "here"

    def aim(self, x: float) -> None:
        self.log.append(f"aim {x}")

    def stop(self) -> None:
        self.log.append("stop")

    def acknowledge(self) -> None:
        self.log.append("acknowledge")


def handle(machine: Machine, lease: Lease, interface: type = Lathe) -> Any:
    return leased(machine, interface, lease)


@pytest.fixture
def refused() -> list[NotOwnerError]:
    return []


@pytest.fixture
def lease(refused: list[NotOwnerError]) -> Lease:
    return Lease("pick/Lift", refused.append)


def test_a_handle_commands_and_reads_while_its_lease_is_valid(lease: Lease) -> None:
    machine = Machine()
    lathe = handle(machine, lease)
    assert lathe.turn(0.5, slowly=True) == "slowly"
    assert (lathe.angle, lathe.size, lathe.state()) == (0.5, 0.3, "turning")
    machine.angle = 0.7
    assert lathe.angle == 0.7
    assert isinstance(lathe, Lathe)
    assert not isinstance(lathe, Eye)


def test_a_command_after_the_end_of_the_lease_is_refused_and_names_skill_device_and_command(
    lease: Lease, refused: list[NotOwnerError]
) -> None:
    machine = Machine()
    lathe = handle(machine, lease)
    lease.end("the skill has ended")
    with pytest.raises(NotOwnerError) as error:
        lathe.turn(0.5)
    words = (
        "pick/Lift: refused to command 'turn' of the lathe: the skill has ended; nothing has moved"
    )
    assert str(error.value) == words
    assert refused == [error.value]
    assert machine.angle == 0.0
    assert lathe.state() == "at rest"


def test_set_points_of_a_motion_need_the_same_lease_and_its_stop_needs_none(lease: Lease) -> None:
    machine = Machine()
    motion = handle(machine, lease).follow()
    motion.aim(1.0)
    lease.end("the skill has ended")
    with pytest.raises(NotOwnerError, match="'aim'"):
        motion.aim(2.0)
    motion.stop()
    assert motion.aim_at() == "here"
    assert machine.log == ["aim 1.0", "stop"]


def test_a_handle_has_the_members_of_its_interface_alone(lease: Lease) -> None:
    lathe = handle(Machine(), lease)
    for name in ("acknowledge", "look", "log"):
        with pytest.raises(AttributeError):
            getattr(lathe, name)
    with pytest.raises(AttributeError):
        lathe.turn = None


def test_a_concrete_class_is_an_interface_too(lease: Lease) -> None:
    class Wheel:
        def __init__(self) -> None:
            self.turns = 0

        @command
        def start(self) -> None:
            self.turns += 1

    wheel = leased(Wheel(), Wheel, lease)
    wheel.start()
    assert wheel.turns == 1
    lease.end("the skill has ended")
    with pytest.raises(NotOwnerError, match="of the Wheel"):
        wheel.start()


@pytest.mark.parametrize("interfaces", [(Eye,), (Eye, Lathe)])
def test_a_device_that_moves_nothing_is_seen_as_its_interface_alone(
    lease: Lease, interfaces: tuple[type, ...]
) -> None:
    machine = Machine()
    machine.interfaces = interfaces
    eye: Any = leased(machine, Eye, lease)
    assert eye.look() == "nothing"
    assert isinstance(eye, Eye)
    assert not hasattr(eye, "acknowledge")
    with pytest.raises(AttributeError):
        eye.look = lambda: "a fruit"


def test_an_object_of_a_class_without_commands_needs_no_handle(lease: Lease) -> None:
    facts = Facts()
    assert leased(facts, Facts, lease) is facts


def test_a_member_of_a_handle_cannot_be_replaced(lease: Lease) -> None:
    machine = Machine()
    lathe = handle(machine, lease)
    for name in ("turn", "state", "size", "angle", "planted"):
        with pytest.raises(AttributeError):
            setattr(lathe, name, lambda *_: None)
    assert lathe.turn(0.5) == "fast"


def test_commands_are_those_that_are_marked() -> None:
    assert commands_of(Eye) == frozenset()
    assert commands_of(Lathe) == {"turn", "follow"}


def test_control_that_is_kept_goes_on_until_it_is_given_up(lease: Lease) -> None:
    machine = Machine()
    lathe = handle(machine, lease)
    kept = keep(lathe, "the grip")
    assert identity(kept) == identity(lathe) == identity(machine)
    lease.end("the skill has ended")
    kept.turn(0.5)
    give_up(kept, "the grip was taken over")
    with pytest.raises(NotOwnerError, match=r"pick/Lift \(the grip\): .*the grip was taken over"):
        kept.turn(0.6)
    assert machine.angle == 0.5


def test_a_leftover_thread_cannot_keep_control(lease: Lease) -> None:
    machine = Machine()
    lathe = handle(machine, lease)
    lease.end("the skill has ended")
    with pytest.raises(NotOwnerError):
        keep(lathe, "the grip").turn(0.5)
    assert machine.angle == 0.0


def test_a_device_itself_needs_no_lease() -> None:
    machine = Machine()
    assert keep(machine, "the grip") is machine
    give_up(machine, "over")


def test_the_end_of_a_lease_waits_for_a_command_that_is_being_carried_out(lease: Lease) -> None:
    began, go_on, ended = threading.Event(), threading.Event(), threading.Event()

    class Slow(Machine):
        def turn(self, angle: float, *, slowly: bool = False) -> str:
            began.set()
            go_on.wait(5.0)
            assert not ended.is_set()
            return super().turn(angle, slowly=slowly)

    machine = Slow()
    commands = threading.Thread(target=handle(machine, lease).turn, args=(0.5,))
    ends = threading.Thread(target=lambda: (lease.end("the skill has ended"), ended.set()))
    commands.start()
    assert began.wait(5.0)
    ends.start()
    assert not ended.wait(0.02)
    go_on.set()
    commands.join()
    ends.join()
    assert machine.angle == 0.5


class Turning:
    """A skill, as leases see it."""

    path = "pick/Turn"

    @classmethod
    def claims(cls) -> tuple[type, ...]:
        return (Lathe,)


def test_a_skill_has_a_lease_from_its_start_to_its_end_and_a_new_one_at_its_next_start(
    refused: list[NotOwnerError],
) -> None:
    leases, machine, skill = Leases(refused.append, ManualClock()), Machine(), Turning()

    def fetch() -> Any:
        return leases.handle(skill, Lathe, machine)

    with pytest.raises(NotOwnerError, match="the skill is not running"):
        fetch().turn(0.1)
    leases.begin(skill)
    first = fetch()
    first.turn(0.2)
    leases.end(skill)
    leases.end(skill)
    for late in (first, fetch()):
        with pytest.raises(NotOwnerError):
            late.turn(0.3)
    leases.begin(skill)
    fetch().turn(0.4)
    with pytest.raises(NotOwnerError, match="the skill has ended"):
        first.turn(0.5)
    assert machine.angle == 0.4


def test_after_a_notice_no_motion_starts_that_nothing_watches(
    refused: list[NotOwnerError],
) -> None:
    clock = ManualClock()
    notice = notice_of(clock)
    leases, machine, skill = Leases(refused.append, clock), Machine(), Turning()
    leases.begin(skill)
    lathe: Any = leases.handle(skill, Lathe, machine)
    before = keep(lathe, "the grip")
    lathe.follow()
    notice.why = "a hand came in"
    lathe.turn(0.1)
    with pytest.raises(NotOwnerError, match="nothing watches its motion after 'a hand came in'"):
        lathe.follow()
    with pytest.raises(NotOwnerError, match="nothing watches its motion"):
        keep(lathe, "another grip").turn(0.1)
    before.follow()  # control that goes on holds what it holds
    notice.watched.add(skill.path)
    lathe.follow().aim(0.1)
    keep(lathe, "another grip").follow()
    leases.begin(skill)
    again: Any = leases.handle(skill, Lathe, machine)
    with pytest.raises(NotOwnerError, match="nothing watches its motion"):
        again.follow()
    notice.why = ""
    again.follow()
    assert len(refused) == 3


def test_a_skill_that_only_looks_commands_nothing(refused: list[NotOwnerError]) -> None:
    class Looking(Turning):
        @classmethod
        def claims(cls) -> tuple[type, ...]:
            return ()

    leases, machine, skill = Leases(refused.append, ManualClock()), Machine(), Looking()
    leases.begin(skill)
    lathe: Any = leases.handle(skill, Lathe, machine)
    assert lathe.state() == "at rest"
    with pytest.raises(NotOwnerError, match="may only look at the Lathe; name it in `moves`"):
        lathe.turn(0.1)


class Governor:
    """Control that goes on over a lathe, and that later skills command."""

    def __init__(self) -> None:
        self.turns = 1.0

    @command
    def set_turns(self, turns: float) -> None:
        self.turns = turns


def test_control_is_commanded_with_the_right_to_its_device_and_no_longer() -> None:
    refused: list[NotOwnerError] = []
    lease, governor = Lease("Turn", refused.append), Governor()
    lent = lend(governor, Governor, leased(Machine(), Lathe, lease))
    assert isinstance(lent, Governor)  # as a port's value
    lent.set_turns(2.0)
    assert governor.turns == lent.turns == 2.0
    lease.end("the skill has ended")
    with pytest.raises(NotOwnerError, match="set_turns"):
        lent.set_turns(3.0)
    assert governor.turns == 2.0
    assert [error.command for error in refused] == ["set_turns"]


def test_a_later_skill_gets_its_own_right_from_a_handle_whose_right_has_ended() -> None:
    ended, governor = Lease("Turn", lambda _error: None, "the skill has ended"), Governor()
    handed_on = lend(governor, Governor, leased(Machine(), Lathe, ended))
    again = lend(handed_on, Governor, leased(Machine(), Lathe, Lease("Weigh", lambda _error: None)))
    again.set_turns(4.0)
    assert governor.turns == 4.0


def test_a_device_without_a_handle_gives_every_right_to_its_control() -> None:
    governor = Governor()
    assert lend(governor, Governor, Machine()) is governor
