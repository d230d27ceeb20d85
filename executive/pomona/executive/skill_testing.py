"""Drive one skill in a unit test: no tree, no runner, mock devices, a manual clock.

outcome = drive(Refine(), {"detection": detection}, devices={Camera: MockCamera(frame)})
assert outcome.reason.code == "NO_DEPTH"
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

from py_trees.common import Status

from pomona.executive.clock import Clock, ManualClock
from pomona.executive.errors import NotOwnerError
from pomona.executive.lease import Leases
from pomona.executive.skill import Computation, Failure, Interrupted, Skill, Work

T = TypeVar("T")


@dataclass
class _Finished:
    """A computation that is complete at its request, and reports its end after a number of polls."""

    value: Any = None
    error: BaseException | None = None
    looks: int = 0
    cancelled: bool = False

    def done(self) -> bool:
        self.looks -= 1
        return self.looks < 0

    def result(self) -> Any:
        if self.error is not None:
            raise self.error
        return self.value

    def cancel(self) -> None:
        self.cancelled = True


@dataclass(eq=False)
class BenchContext:
    """A `SkillContext` whose computations run at once, in the caller; `computing` ticks later they are done."""

    clock: Clock = field(default_factory=ManualClock)
    devices: Mapping[type, object] = field(default_factory=dict)
    run_seed: int = 0
    computing: int = 0
    computations: list[_Finished] = field(default_factory=list)
    published: list[tuple[str, object]] = field(default_factory=list)
    lacking: tuple[Any, ...] = (float("nan"), 0)
    halting: list[tuple[Skill, Work[Any]]] = field(default_factory=list)
    refused: list[NotOwnerError] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.leases = Leases(self.refused.append, self.clock)

    def device(self, interface: type[T], skill: Skill) -> T:
        return self.leases.handle(skill, interface, cast(T, self.devices[interface]))

    def seed(self, node: str) -> int:
        return zlib.crc32(f"{self.run_seed}/{node}".encode())

    def compute(
        self, node: str, function: Callable[..., Any], *arguments: Any, isolated: bool
    ) -> Computation:
        try:
            self.computations.append(_Finished(function(*arguments), looks=self.computing))
        except Exception as error:
            self.computations.append(_Finished(error=error, looks=self.computing))
        return self.computations[-1]

    def publish(self, node: str, topic: str, value: object) -> None:
        self.published.append((topic, value))

    def pause(self, why: str) -> bool:
        return False

    def elapsed(self) -> float:
        return self.clock.now()

    def acquire(self, skill: Skill) -> str | None:
        self.leases.begin(skill)
        return None

    def release(self, skill: Skill) -> None:
        self.leases.end(skill)

    def halt(self, skill: Skill, work: Work[Any]) -> None:
        try:
            work.throw(Interrupted())
        except (Interrupted, StopIteration):
            self.release(skill)
            return
        self.halting.append((skill, work))


@dataclass(frozen=True)
class SkillEnd:
    """How a driven skill ended: its status, outputs, reason of failure, published views, seconds on the clock.

    `cancelled` counts the computations that it gave up.
    """

    status: Status
    outputs: Mapping[str, Any]
    reason: Failure | None
    published: tuple[tuple[str, object], ...]
    duration: float
    feedback: str
    cancelled: int = 0


def drive(
    skill: Skill,
    inputs: Mapping[str, object] | None = None,
    devices: Mapping[type, object] | None = None,
    *,
    clock: Clock | None = None,
    period: float = 0.02,
    limit: float = 60.0,
    interrupt_after: int | None = None,
    each_tick: Callable[[int], None] | None = None,
    seed: int = 0,
    computing: int = 0,
) -> SkillEnd:
    """Tick a skill until it ends.

    Args:
        skill: a fresh or an already driven instance (state across starts is kept, as in a tree).
        inputs: by port name, in SI; ports that are left out get their declared default.
        clock: advanced by `period` after every tick; a `ManualClock` by default.
        limit: seconds on the clock after which the skill is interrupted.
        interrupt_after: interrupt it after this number of ticks and drive it until it has halted; the status is then
            INVALID.
        each_tick: called with the number of the tick before it, to script the devices.
        computing: ticks that every computation takes, to interrupt one.

    Raises:
        KeyError: inputs that the skill does not have.
        TimeoutError: after `limit` it still runs, or has not halted.
    """
    context = BenchContext(
        clock=clock or ManualClock(), devices=devices or {}, run_seed=seed, computing=computing
    )
    given = dict(inputs or {})
    values = {name: given.pop(name, port.default_value) for name, port in skill.inputs.items()}
    if given:
        raise KeyError(f"{type(skill).__name__} has no inputs {sorted(given)}")
    outputs: dict[str, object] = {}
    skill.bind(context, skill.name, lambda: values, outputs.__setitem__)
    start = context.clock.now()
    ticks = 0
    while True:
        if each_tick is not None:
            each_tick(ticks)
        skill.tick_once()
        ticks += 1
        ended = skill.status is not Status.RUNNING
        if not ended and interrupt_after is not None and ticks >= interrupt_after:
            skill.stop(Status.INVALID)
            while context.halting:
                context.clock.advance(period)
                _drive_halting(context)
                if context.clock.now() - start > limit:
                    raise TimeoutError(
                        f"{skill.name} was interrupted and has not stopped after {limit} s"
                    )
            ended = True
        if ended:
            return SkillEnd(
                skill.status,
                outputs,
                skill.reason,
                tuple(context.published),
                context.clock.now() - start,
                skill.feedback_message,
                sum(computation.cancelled for computation in context.computations),
            )
        context.clock.advance(period)
        if context.clock.now() - start > limit:
            skill.stop(Status.INVALID)
            raise TimeoutError(f"{skill.name} still runs after {limit} s: {skill.feedback_message}")


def _drive_halting(context: BenchContext) -> None:
    for skill, work in list(context.halting):
        try:
            next(work)
        except (Interrupted, StopIteration):
            context.halting.remove((skill, work))
            context.release(skill)
