"""Services of a run for its skills: the real `SkillContext`."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

from pomona.executive.cell.cell import Cell
from pomona.executive.clock import Clock
from pomona.executive.errors import NotOwnerError, SkillError
from pomona.executive.lease import Leases, viewed
from pomona.executive.running.compute import Computations
from pomona.executive.running.traces import keep_place, place_here
from pomona.executive.skill import POLLED, Computation, Interrupted, Skill, Work
from pomona.executive.values.processes import leave_if_forked

T = TypeVar("T")

HALT_TIMEOUT = 10.0  # time on the run's clock within which an interrupted skill must have halted [s]


class RunContext:
    """Clock, devices, computations and the list of interrupted skills that still bring their devices to rest."""

    def __init__(
        self,
        cell: Cell,
        computations: Computations,
        seed: int,
        publish: Callable[[str, str, object], None],
    ) -> None:
        self._cell, self.computations, self.run_seed = cell, computations, seed
        self._clock = viewed(cell.clock, Clock)
        self._publish = publish
        self._halting: list[tuple[Skill, Work[Any], float]] = []
        self._owners: dict[type, Skill] = {}
        self._leases = Leases(self._note_refusal)
        self._refusals: list[NotOwnerError] = []
        self._noted: set[tuple[str, str, str]] = set()
        self._failures: list[tuple[str, BaseException]] = []
        self._paused_for = 0.0
        self._paused_since: float | None = None
        self._speed = 1.0
        self._start = cell.clock.now()

    # --------------------------------------------------------------------------------------- SkillContext

    @property
    def clock(self) -> Clock:
        return self._clock

    def device(self, interface: type[T], skill: Skill) -> T:
        return self._leases.handle(skill, interface, self._cell.device(interface))

    def elapsed(self) -> float:
        now = self._cell.clock.now() if self._paused_since is None else self._paused_since
        return now - self._start - self._paused_for

    def seed(self, node: str) -> int:
        return zlib.crc32(f"{self.run_seed}/{node}".encode())

    def compute(self, node: str, function: Callable[..., Any], *arguments: Any, isolated: bool) -> Computation:
        computation: Computation = self.computations.submit(node, function, arguments, isolated)
        return computation

    def publish(self, node: str, topic: str, value: object) -> None:
        self._publish(node, topic, value)

    def acquire(self, skill: Skill) -> str | None:
        for other, _work, _deadline in self._halting:
            if set(self._offered(other.claims())) & set(skill.devices):
                return f"waiting until {other.name} has halted"
        claimed = self._offered(skill.claims())
        for interface in claimed:
            owner = self._owners.get(interface)
            if owner is not None and owner is not skill:
                return f"waiting for {owner.name}, which uses the {interface.__name__}"
        self._owners.update(dict.fromkeys(claimed, skill))
        self._leases.begin(skill)
        self._give_speed(skill)
        return None

    def release(self, skill: Skill) -> None:
        for interface in [interface for interface, owner in self._owners.items() if owner is skill]:
            del self._owners[interface]
        self._leases.end(skill)

    def halt(self, skill: Skill, work: Work[Any]) -> None:
        if not self._let_go(skill, lambda: work.throw(Interrupted())):
            self._halting.append((skill, work, self.clock.now() + HALT_TIMEOUT))

    # ------------------------------------------------------------------------------------- for the runner

    @property
    def speed(self) -> float:
        """Share of the speed that the operator allows."""
        return self._speed

    def set_speed(self, speed: float) -> None:
        """Scale the speeds of skills and tree by this ratio from now on, also for motions in progress."""
        self._speed = speed
        self._cell.set_speed(speed)
        for skill in dict.fromkeys(self._owners.values()):
            self._give_speed(skill)

    def _give_speed(self, skill: Skill) -> None:
        if skill.claims():
            self._cell.set_speed(skill.speed(self._speed), skill.claims())

    def start_clock(self) -> None:
        """The run begins now."""
        self._start, self._paused_for, self._paused_since = self._cell.clock.now(), 0.0, None

    def freeze(self) -> None:
        """The run's time stands still from now on."""
        if self._paused_since is None:
            self._paused_since = self._cell.clock.now()

    def thaw(self) -> None:
        """The run's time goes on."""
        if self._paused_since is not None:
            self._paused_for += self._cell.clock.now() - self._paused_since
            self._paused_since = None

    @property
    def halting(self) -> tuple[str, ...]:
        """Names of the interrupted skills that have not halted yet."""
        return tuple(skill.name for skill, _work, _deadline in self._halting)

    @property
    def owners(self) -> Mapping[type, str]:
        """Owner of each interface: names of skills that run or still halt."""
        return {interface: skill.name for interface, skill in self._owners.items()}

    def drive_halting(self) -> None:
        """Advance every interrupted skill by one step; `take_failure` returns their errors."""
        still = []
        for skill, work, deadline in self._halting:
            if self._let_go(skill, partial(next, work)):
                continue
            if self.clock.now() > deadline:
                late = SkillError(skill.name, f"was interrupted and has not halted within {HALT_TIMEOUT:.0f} s")
                self._failures.append((skill.path, late))
                self.release(skill)
                continue
            still.append((skill, work, deadline))
        self._halting = still

    def take_refusal(self) -> NotOwnerError | None:
        """Return a refused command, once for each owner, device and command; None when there is nothing more."""
        return self._refusals.pop(0) if self._refusals else None

    def forget_refusal(self, error: BaseException) -> None:
        """Drop a refusal that is already reported as the end of the run."""
        self._refusals = [refused for refused in self._refusals if refused is not error]

    def take_failure(self) -> tuple[str, BaseException] | None:
        """Return the next error of a halting skill, with the skill's path; None if there is none."""
        return self._failures.pop(0) if self._failures else None

    def _offered(self, interfaces: Sequence[type]) -> tuple[type, ...]:
        """Return all interfaces of the devices that have one of these: a device has one owner under any interface."""
        there = self._cell.interfaces() if interfaces else ()  # a dry run has no device
        found = [
            (one, *getattr(self._cell.device(one), "interfaces", ())) if one in there else (one,) for one in interfaces
        ]
        return tuple(dict.fromkeys(interface for offered in found for interface in offered))

    def _note_refusal(self, error: NotOwnerError) -> None:
        """Called in the thread that commands: its place is known here alone."""
        what = error.skill, error.device, error.command
        if what not in self._noted:
            self._noted.add(what)
            keep_place(error, place_here())
            self._refusals.append(error)

    def _let_go(self, skill: Skill, step: Callable[[], object]) -> bool:
        """Return True if the body has ended with this step; an error must not keep the others from their step."""
        polled = POLLED.set(skill.path)
        try:
            step()
        except (Interrupted, StopIteration):
            pass
        except BaseException as error:
            self._failures.append((skill.path, error))
        else:
            return False
        finally:
            leave_if_forked()
            POLLED.reset(polled)
        self.release(skill)
        return True
