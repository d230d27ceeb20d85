"""Leases: a skill commands a device only through a handle, and the handle's right ends with the skill.

An interface marks what moves its device:

    class Arm(Protocol):
        @command
        def follow(self, trajectory: Trajectory) -> Motion: ...

`Skill.device` returns a handle with the members of the interface. Each `command` needs a valid lease at that moment;
any other member is passed on. So a thread that outlives its skill can read a device, but move nothing. A handle has the
members of its interface alone, and none of them can be replaced: a skill cannot change a sensor that others read.

Control that continues after its skill, such as a grip, requests a lease of its own while the skill runs: `keep`. A
later skill commands that control through the right to its device: `lend`.

After a `Notice` a command that is a `motion` also needs a watch, which a skill declares by its failure `BLOCKED`.
"""

from __future__ import annotations

import typing
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from operator import attrgetter
from threading import RLock
from typing import Any, Protocol, TypeVar
from weakref import WeakKeyDictionary

from pomona.executive.errors import NotOwnerError

T = TypeVar("T")
F = TypeVar("F", bound=Callable[..., Any])

BLOCKED = "PATH_BLOCKED"  # failure code of a motion that its watch has stopped, or not let start


@dataclass
class Notice:
    """Why a person may be near. Until an operator clears it, no motion starts that nothing watches.

    Attributes:
        beside: it may be beside the robot, which hides it: it was last seen there, or has touched it.
        watch: the newest one.
        watched: paths of the skills whose motions are watched now.
    """

    why: str = ""
    beside: bool = False
    watch: Any = None
    watched: set[str] = field(default_factory=set)

    def against(self, skill: str) -> str:
        """Return why a skill must not move a device, empty if it may."""
        if not self.why or skill in self.watched:
            return ""
        return f"nothing watches its motion after '{self.why}'"


_NOTICES: WeakKeyDictionary[object, Notice] = WeakKeyDictionary()


def notice_of(clock: object) -> Notice:
    """Return the notice of the run on this clock."""
    return _NOTICES.setdefault(clock, Notice())


def command(method: F) -> F:
    """Mark a method of an interface: it moves the device, so it needs a lease."""
    method.__is_command__ = True  # type: ignore[attr-defined]
    return method


def motion(method: F) -> F:
    """Mark a command that starts a motion: see `Notice`."""
    method.__is_motion__ = True  # type: ignore[attr-defined]
    return command(method)


class Lessee(Protocol):
    """The part of a skill that a lease needs."""

    path: str

    @classmethod
    def claims(cls) -> tuple[type, ...]:
        """Interfaces of the devices that it commands."""


class Lease:
    """The right to command devices, from its making until `end`.

    Attributes:
        owner: path of the skill, or name of the control, that has it.
        lock: held while a command is carried out, so that none begins behind the end.
        notice: that its motions obey: of the run, or one of its own.
    """

    notice = Notice()

    def __init__(
        self, owner: str, refused: Callable[[NotOwnerError], None], over: str = ""
    ) -> None:
        """
        Args:
            owner: as above.
            refused: called in the commanding thread with each refusal, before it is raised.
            over: why it gives no right from the beginning.
        """
        self.owner = owner
        self._refused = refused
        self._over = over
        self.lock = RLock()

    def end(self, why: str) -> None:
        """Give no right any more. A command that is being carried out ends first."""
        with self.lock:
            self._over = self._over or why

    def require(self, device: object, name: str, moves: bool = False) -> None:
        """Refuse a command of a device unless the lease is valid. Raises NotOwnerError: it is not."""
        if over := self._over or (moves and self.notice.against(self.owner)):
            error = NotOwnerError(
                self.owner, str(getattr(device, "name", type(device).__name__)), name, over
            )
            self._refused(error)
            raise error

    def handed_on(self, to: str) -> Lease:
        """Return a lease of its own for control that goes on after its skill; it has no right if this one has none."""
        with self.lock:
            over = self._over or self.notice.against(self.owner)
            return Lease(f"{self.owner} ({to})", self._refused, over)


class Leases:
    """The leases of a run's skills: one from each start of a skill until it has halted."""

    def __init__(self, refused: Callable[[NotOwnerError], None], clock: object) -> None:
        """
        Args:
            refused: called with each refusal, in the thread that commands.
            clock: of the run.
        """
        self._refused = refused
        self._notice = notice_of(clock)
        self._running: dict[Lessee, Lease] = {}

    def begin(self, skill: Lessee) -> None:
        """Start a lease: the skill may command the devices that it claims."""
        self._notice.watched.discard(skill.path)
        self._running[skill] = lease = Lease(skill.path, self._refused)
        lease.notice = self._notice

    def end(self, skill: Lessee) -> None:
        """The skill has ended: its handles command nothing any more. Harmless when it has no lease."""
        lease = self._running.pop(skill, None)
        if lease is not None:
            lease.end("the skill has ended")

    def handle(self, skill: Lessee, interface: type, device: T) -> T:
        """Return a skill's handle of a device; a device that is only read cannot be commanded."""
        lease = self._running.get(skill)
        if lease is None:
            lease = Lease(skill.path, self._refused, "the skill is not running")
        elif interface not in skill.claims():
            words = f"the skill may only look at the {interface.__name__}; name it in `moves`"
            lease = Lease(skill.path, self._refused, words)
        return leased(device, interface, lease)


class Handle:
    """A device as its lessee sees it: the members of one interface. Made by `leased`."""

    __slots__ = ("__weakref__", "_device", "_lease")

    def __init__(self, device: object, lease: Lease) -> None:
        self._device = device
        self._lease = lease


def leased(device: T, interface: type, lease: Lease) -> T:
    """Return a handle of a device, or the object itself if the interface is a class without commands.

    Args:
        interface: whose members the handle has.
        lease: its commands need it.
    """
    made = _handle_class(interface, tuple(getattr(device, "interfaces", ())))
    return device if made is None else typing.cast(T, made(device, lease))


def viewed(device: T, interface: type) -> T:
    """Return a handle that gives no right to a command."""
    return leased(
        device, interface, Lease("a skill", lambda _refused: None, "it may only be looked at")
    )


def keep(device: T, control: str) -> T:
    """Return a handle for control that continues after its skill's end, until `give_up`.

    Args:
        device: a handle; anything else is returned as it is.
        control: name of the control, for messages.
    """
    if not isinstance(device, Handle):
        return device
    return typing.cast(T, type(device)(device._device, device._lease.handed_on(control)))


def lend(control: T, interface: type, by: object) -> T:
    """Return a handle of control that a device is under: its commands need the lease of the device's handle.

    Args:
        control: or a handle of it.
        interface: whose members the handle has.
        by: the device's handle; a device itself gives every right, and the control is returned.
    """
    own = typing.cast(T, control._device) if isinstance(control, Handle) else control
    return leased(own, interface, by._lease) if isinstance(by, Handle) else own


def give_up(device: object, why: str) -> None:
    """End the lease of a handle; harmless for anything else."""
    if isinstance(device, Handle):
        device._lease.end(why)


def identity(device: object) -> int:
    """Return a number that all handles of a device share with it."""
    return id(device._device if isinstance(device, Handle) else device)


@cache
def commands_of(interface: type, mark: str = "__is_command__") -> frozenset[str]:
    """Return names of an interface's commands, or of its methods with another mark."""
    found = {
        name: member for base in reversed(interface.__mro__) for name, member in vars(base).items()
    }
    return frozenset(name for name, member in found.items() if getattr(member, mark, False))


@cache
def _handle_class(interface: type, offered: tuple[type, ...]) -> type[Handle] | None:
    """Handles with an interface's members; None for a class that is no Protocol, where a device has no commands.

    Of a concrete class any other attribute is passed on as well, and `isinstance` takes the handle for one of it.
    """
    concrete = not getattr(interface, "_is_protocol", False)
    if concrete and not any(commands_of(one) for one in (interface, *offered)):
        return None
    commands = commands_of(interface)
    members = _members_of(interface)
    space: dict[str, Any] = {"__slots__": (), "__doc__": interface.__doc__}
    space |= {name: property(attrgetter(f"_device.{name}")) for name in members - commands}
    space |= {name: _command(interface, name) for name in commands}
    if concrete:
        space["__getattr__"] = lambda self, name: getattr(self._device, name)
        space["__class__"] = property(lambda _self: interface)
    return type(f"Leased{interface.__name__}", (Handle,), space)


def _members_of(interface: type) -> frozenset[str]:
    bases = [
        base for base in interface.__mro__ if base not in (object, typing.Protocol, typing.Generic)
    ]
    names = {
        name for base in bases for name in (*vars(base), *vars(base).get("__annotations__", ()))
    }
    return frozenset(name for name in names if not name.startswith("_"))


def _command(interface: type, name: str) -> Callable[..., Any]:
    """Return the handle's method; if its result has commands, they need the same lease."""
    returned = typing.get_type_hints(getattr(interface, name)).get("return")
    gives = returned if isinstance(returned, type) and commands_of(returned) else None
    moves = name in commands_of(interface, "__is_motion__")

    def carry_out(handle: Handle, *arguments: Any, **named: Any) -> Any:
        lease = handle._lease
        device = handle._device
        with lease.lock:
            lease.require(device, name, moves)
            result = getattr(device, name)(*arguments, **named)
        return result if gives is None else leased(result, gives, lease)

    carry_out.__name__ = name
    return carry_out
