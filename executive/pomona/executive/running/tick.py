"""One tick of the tree: it may be held at a breakpoint in its middle, skills use the run, and changes become events.

A py_trees tick is a generator that hands over every node as soon as it has been ticked, before its parent goes on. A
node with a breakpoint also hands over a `HeldTick`; the caller that iterates the tick stops there, and later continues
the same iteration. Nothing else in the tree has moved meanwhile: no sibling was started, none was interrupted. Nodes
without a breakpoint pay nothing.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.account import Account
from pomona.executive.cell.cell import Cell
from pomona.executive.clock import Clock
from pomona.executive.errors import NotOwnerError, PomonaError, SkillError
from pomona.executive.language import BuiltTree
from pomona.executive.language.built import Side
from pomona.executive.lease import Leases, viewed
from pomona.executive.nodes import Attempt
from pomona.executive.nodes.ask import Question
from pomona.executive.reasons import Reason, reason_of
from pomona.executive.running.compute import Computations
from pomona.executive.running.events import AttemptEnded, Event, Listener, NodeChanged
from pomona.executive.running.traces import keep_place, place_here
from pomona.executive.skill import POLLED, Computation, Interrupted, Skill, Work, leave_if_forked
from pomona.executive.values.sentences import LONGEST, shortened

T = TypeVar("T")

BREAK_ACTIONS: dict[str, tuple[Side, bool]] = {
    "break": ("before", True),
    "unbreak": ("before", False),
    "break_after": ("after", True),
    "unbreak_after": ("after", False),
}
"""Breakpoint actions of an operator, by the name of the action in events and in the live stream."""


class UnknownNodeError(PomonaError):
    """A breakpoint at a node that the tree does not have."""

    def __init__(self, path: str) -> None:
        self.path = path
        super().__init__(f"the tree has no node {path}")


@dataclass(frozen=True, slots=True)
class HeldTick:
    """Where a tick is held."""

    path: str
    side: Side


class Breakpoints:
    """The breakpoints of one tree, and the tick that one of them holds."""

    def __init__(self, behaviours: Mapping[str, Behaviour]) -> None:
        """
        Args:
            behaviours: the tree's nodes by path.
        """
        self._behaviours = behaviours
        self._set: dict[Side, set[str]] = {"before": set(), "after": set()}
        self._patched: set[str] = set()
        self._walk: Iterator[Any] | None = None
        self.held = ""  # path of the node at which a tick is held

    def check(self, path: str) -> None:
        """Raises UnknownNodeError: there is no such node."""
        if path not in self._behaviours:
            raise UnknownNodeError(path)

    def change(self, path: str, side: Side, on: bool) -> None:
        """Set or clear one. Raises UnknownNodeError: there is no such node."""
        self.check(path)
        if not on:
            self._set[side].discard(path)
            return
        self._set[side].add(path)
        if path not in self._patched:
            self._patched.add(path)
            behaviour = self._behaviours[path]
            # In the instance, so that its class and all other nodes stay as they are.
            vars(behaviour)["tick"] = self._stopping(path, behaviour, behaviour.tick)

    def follow(self, tree: BuiltTree) -> None:
        """Go on with the nodes of a changed tree; breakpoints of nodes that are gone are forgotten."""
        fresh = {
            path
            for path in self._patched
            if tree.behaviours.get(path) is not self._behaviours[path]
        }
        self._behaviours, self._patched = tree.behaviours, self._patched - fresh
        for side, paths in self._set.items():
            for path in paths & fresh:
                paths.discard(path)
                if path in tree.behaviours:
                    self.change(path, side, True)

    @property
    def holding(self) -> bool:
        """Whether a tick is held."""
        return self._walk is not None

    def tick(self, root: Behaviour, visited: Callable[[Behaviour], object] = id) -> HeldTick | None:
        """Tick the tree once, or go on with the tick that is held, up to the next breakpoint.

        Args:
            root: the tree's root.
            visited: gets each behaviour right after its tick.

        Returns:
            where the tick is held; None when it is complete.
        """
        walk = self._walk if self._walk is not None else root.tick()
        self._walk = None
        self.held = ""
        for node in walk:
            if type(node) is HeldTick:
                self._walk = walk
                self.held = node.path
                return node
            visited(node)
        return None

    def drop(self) -> None:
        """Forget the tick that is held; the caller stops the tree."""
        self._walk = None

    def _stopping(
        self, path: str, behaviour: Behaviour, tick: Callable[[], Iterator[Behaviour]]
    ) -> Callable[[], Iterator[Any]]:
        def walk() -> Iterator[Any]:
            if behaviour.status is not Status.RUNNING and path in self._set["before"]:
                behaviour.feedback_message = "held by a breakpoint"
                yield HeldTick(path, "before")
            yield from tick()
            if behaviour.status is not Status.RUNNING and path in self._set["after"]:
                yield HeldTick(path, "after")

        return walk


class TreeObserver:
    """Compares every node with how it was after the tick before."""

    def __init__(
        self, tree: BuiltTree, emit: Callable[..., None], stamp: Callable[[], tuple[float, int]]
    ) -> None:
        self._emit = emit
        self._stamp = stamp
        self._known: dict[str, tuple[Status, str, int]] = {}
        self._started: set[int] = set()  # identities of the behaviours that acted in this tick
        self.follow(tree)

    def follow(self, tree: BuiltTree) -> None:
        """Go on with the nodes of a changed tree."""
        self._tree = tree
        self._known = {
            path: self._known.get(path, (Status.INVALID, "", 0)) for path in tree.behaviours
        }
        self._nodes = tuple(
            (path, behaviour, behaviour if isinstance(behaviour, (Skill, Question)) else None)
            for path, behaviour in tree.behaviours.items()
        )
        tree.on_attempt(self._attempt)

    def visited(self, behaviour: Behaviour) -> None:
        """Note that a behaviour acted: its parent may interrupt it in the same tick."""
        if behaviour.status is not Status.INVALID:
            self._started.add(id(behaviour))

    def after_tick(self) -> None:
        """Emit the changes. Raises SkillError: the feedback of a node is no text; it counts as empty from then on."""
        wrong: SkillError | None = None
        for path, behaviour, counted in self._nodes:
            given: object = (
                behaviour.feedback_message
            )  # any behaviour may set it, as py_trees' own do
            before = self._known[path]
            if counted is not None:
                starts = counted.starts
            elif (
                behaviour.children
                or behaviour.status is not before[0]
                or before[0] is not Status.INVALID
            ):
                starts = before[2]
            else:
                starts = before[2] + (id(behaviour) in self._started)
            if given is before[1] and behaviour.status is before[0] and starts == before[2]:
                continue
            if not isinstance(given, str):
                behaviour.feedback_message = ""
                wrong = SkillError(
                    path, f"its feedback is no text but {given!r:.60} ({type(given).__name__})"
                )
            elif len(given) > LONGEST:
                behaviour.feedback_message = shortened(given)
            if (
                behaviour.status is before[0]
                and behaviour.feedback_message == before[1]
                and starts == before[2]
            ):
                continue
            now = (behaviour.status, behaviour.feedback_message, starts)
            self._known[path] = now
            reason = reason_of(behaviour) if now[0] is Status.FAILURE else None
            feedback = now[0] is before[0] and starts == before[2]
            self._emit(
                NodeChanged(*self._stamp(), path, now[0].value, now[1], starts, reason),
                feedback=feedback,
            )
        self._started.clear()
        if wrong is not None:
            raise wrong

    def slowest(self) -> str:
        """Path of the skill that kept the newest tick waiting longest."""
        skills = [skill for skill in self._tree.skills if skill.status is not Status.INVALID]
        return max(skills, key=lambda skill: skill.blocked).path if skills else ""

    def root_reason(self) -> Reason | None:
        """Why the tree failed, from the root down."""
        return reason_of(self._tree.root)

    def culprit(self) -> str:
        """Path of the skill that broke, else of the last running leaf: the best estimate of a fault's place."""
        broke = [skill.path for skill in self._tree.skills if skill.broke]
        running = [path for path, behaviour, _ in self._nodes if _is_running_leaf(behaviour)]
        return (broke or running or [""])[-1]

    def _attempt(self, path: str, attempt: Attempt, of: int) -> None:
        succeeded = attempt.status is Status.SUCCESS
        self._emit(
            AttemptEnded(*self._stamp(), path, attempt.number, of, succeeded, attempt.reason)
        )


def _is_running_leaf(behaviour: Behaviour) -> bool:
    return behaviour.status is Status.RUNNING and not behaviour.children


class EventStream:
    """Hands every event to every listener, in order, in the thread that emits it.

    If a listener fails, the others still get the event; `take_failure` reports the error to the run.
    """

    def __init__(self) -> None:
        self._listeners: list[Listener] = []
        self._of_states: list[Listener] = []
        self._failed: set[int] = set()  # their ids: a listener need not be hashable
        self._failures: list[BaseException] = []

    def subscribe(self, listener: Listener, *, feedback: bool = True) -> None:
        """Listeners must return at once; slow ones keep a queue of their own.

        Args:
            feedback: whether it also gets the changes of a node's feedback alone, in nearly every tick.
        """
        self._listeners.append(listener)
        if not feedback:
            self._of_states.append(listener)

    def emit(self, event: Event, *, feedback: bool = False) -> None:
        """Emit an event, perhaps of a node's feedback alone; never raises for an error of a listener."""
        for listener in self._listeners:
            if feedback and listener in self._of_states:
                continue
            try:
                listener(event)
            except BaseException as error:  # any error: the record must get the later events
                if (
                    id(listener) not in self._failed
                ):  # a terminal that is gone fails with every event
                    self._failed.add(id(listener))
                    self._failures.append(error)

    def take_failure(self) -> BaseException | None:
        """Return the first error of a listener, once for each listener; None if there is none."""
        return self._failures.pop(0) if self._failures else None


# time on the run's clock within which an interrupted skill must have halted [s]
HALT_TIMEOUT = 10.0


class RunContext:
    """Clock, devices, computations and the list of interrupted skills that still bring their devices to rest."""

    def __init__(
        self,
        cell: Cell,
        computations: Computations,
        seed: int,
        publish: Callable[[str, str, object], None],
    ) -> None:
        self._cell = cell
        self.computations = computations
        self.run_seed = seed
        self.account = Account()
        self._clock = viewed(cell.clock, Clock)
        self._publish = publish
        self._halting: list[tuple[Skill, Work[Any], float]] = []
        self._owners: dict[type, Skill] = {}
        self._leases = Leases(self._note_refusal, self._clock)
        self._refusals: list[NotOwnerError] = []
        self._noted: set[tuple[str, str, str]] = set()
        self._failures: list[tuple[str, BaseException]] = []
        self._paused_for = 0.0
        self._paused_since: float | None = None
        self._speed = 1.0
        self.attended = False
        self.pause_for = ""
        self._start = cell.clock.now()

    # --------------------------------------------------------------------------------------- SkillContext

    @property
    def lacking(self) -> tuple[Any, ...]:
        """See `SkillContext`."""
        account = self.account
        return account.verified, account.bruises, *filter(None, account.lacking.values())

    @property
    def clock(self) -> Clock:
        return self._clock

    def device(self, interface: type[T], skill: Skill) -> T:
        return self._leases.handle(skill, interface, self._cell.device(interface))

    def elapsed(self) -> float:
        now = self._cell.clock.now() if self._paused_since is None else self._paused_since
        return now - self._start - self._paused_for

    def pause(self, why: str) -> bool:
        self.pause_for = why if self.attended else ""
        return self.attended

    def seed(self, node: str) -> int:
        return zlib.crc32(f"{self.run_seed}/{node}".encode())

    def compute(
        self, node: str, function: Callable[..., Any], *arguments: Any, isolated: bool
    ) -> Computation:
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
        self._start = self._cell.clock.now()
        self._paused_for = 0.0
        self._paused_since = None

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
                late = SkillError(
                    skill.name, f"was interrupted and has not halted within {HALT_TIMEOUT:.0f} s"
                )
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
            (one, *getattr(self._cell.device(one), "interfaces", ())) if one in there else (one,)
            for one in interfaces
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
