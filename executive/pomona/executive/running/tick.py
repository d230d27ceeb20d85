"""One tick of the tree: it may be held at a breakpoint in its middle, and its changes become events.

A py_trees tick is a generator that hands over every node as soon as it has been ticked, before its parent goes on. A
node with a breakpoint also hands over a `HeldTick`; the caller that iterates the tick stops there, and later continues
the same iteration. Nothing else in the tree has moved meanwhile: no sibling was started, none was interrupted. Nodes
without a breakpoint pay nothing.
"""

from __future__ import annotations

import contextlib
import logging
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.errors import PomonaError, SkillError
from pomona.executive.language import BuiltTree
from pomona.executive.language.built import Side
from pomona.executive.nodes import Attempt
from pomona.executive.nodes.ask import Question
from pomona.executive.reasons import Reason, reason_of
from pomona.executive.running.events import AttemptEnded, Event, Logged, NodeChanged
from pomona.executive.skill import POLLED, Skill
from pomona.executive.values.sentences import sentence_of, shortened

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
        fresh = {path for path in self._patched if tree.behaviours.get(path) is not self._behaviours[path]}
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
        self._walk, self.held = None, ""
        for node in walk:
            if type(node) is HeldTick:
                self._walk, self.held = walk, node.path
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

    def __init__(self, tree: BuiltTree, emit: Callable[[Event], None], stamp: Callable[[], tuple[float, int]]) -> None:
        self._emit, self._stamp = emit, stamp
        self._known: dict[str, tuple[Status, str, int]] = {}
        self._started: set[int] = set()  # identities of the behaviours that acted in this tick
        self.follow(tree)

    def follow(self, tree: BuiltTree) -> None:
        """Go on with the nodes of a changed tree."""
        self._tree = tree
        self._known = {path: self._known.get(path, (Status.INVALID, "", 0)) for path in tree.behaviours}
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
            given: object = behaviour.feedback_message  # any behaviour may set it, as py_trees' own do
            before = self._known[path]
            if counted is not None:
                starts = counted.starts
            elif behaviour.children or behaviour.status is not before[0] or before[0] is not Status.INVALID:
                starts = before[2]
            else:
                starts = before[2] + (id(behaviour) in self._started)
            if given is before[1] and behaviour.status is before[0] and starts == before[2]:
                continue
            if not isinstance(given, str):
                behaviour.feedback_message = ""
                wrong = SkillError(path, f"its feedback is no text but {given!r:.60} ({type(given).__name__})")
            else:
                behaviour.feedback_message = shortened(given)
            if behaviour.status is before[0] and behaviour.feedback_message == before[1] and starts == before[2]:
                continue
            now = (behaviour.status, behaviour.feedback_message, starts)
            self._known[path] = now
            reason = reason_of(behaviour) if now[0] is Status.FAILURE else None
            self._emit(NodeChanged(*self._stamp(), path, now[0].value, now[1], starts, reason))
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
        self._emit(AttemptEnded(*self._stamp(), path, attempt.number, of, succeeded, attempt.reason))


def _is_running_leaf(behaviour: Behaviour) -> bool:
    return behaviour.status is Status.RUNNING and not behaviour.children


def _set_level(root: logging.Logger, level: int) -> None:
    """As `setLevel`, without the lock of `logging`: a thread that keeps it must not hold up the end of a run."""
    root.level = level
    for each in (root, *list(root.manager.loggerDict.values())):
        if isinstance(each, logging.Logger):
            each._cache.clear()  # type: ignore[attr-defined]


MOST_LOGGED = 20  # lines of a node in a second of the run; the others are counted, so that no record is flooded


class SkillLogs(logging.Handler):
    """Collects the lines that skills log with Python's `logging`, INFO and above."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._lines = deque[tuple[str, str, str]]()
        self._counts, self._until = Counter[str](), 0.0

    def createLock(self) -> None:
        """Make no lock: a thread that hangs while it logs must not hold up the tick."""
        self.lock = None

    @contextlib.contextmanager
    def listening(self) -> Iterator[None]:
        """Take INFO lines in here. Warnings go on to the error stream, as without this handler."""
        root = logging.getLogger()
        level, handlers = root.level, [self] if root.handlers else [self, logging.lastResort]
        root.handlers += [handler for handler in handlers if handler is not None]
        _set_level(root, min(level, logging.INFO))
        try:
            yield
        finally:
            _set_level(root, level)
            root.handlers = [handler for handler in root.handlers if handler not in handlers]

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a line of a skill; never raises."""
        node = POLLED.get()
        self._counts[node] += bool(node)
        if node and self._counts[node] <= MOST_LOGGED:
            try:
                text = record.getMessage()
                text += f": {sentence_of(record.exc_info[1])}" if record.exc_info and record.exc_info[1] else ""
            except Exception as error:  # of the caller's arguments: a log must not end a run
                text = f"{record.msg!r:.60} cannot be shown: {sentence_of(error)}"
            self._lines.append((node, record.levelname, shortened(text)))

    def take(self, t: float, tick: int, last: bool = False) -> Iterator[Logged]:
        """Yield the lines since the last call; once a second, and at last, also how many were left out."""
        while self._lines:
            yield Logged(t, tick, *self._lines.popleft())
        if t >= self._until or last:
            counts, self._counts, self._until = self._counts, Counter(), t + 1.0
            for node, count in list(counts.items()):
                if count > MOST_LOGGED:
                    yield Logged(t, tick, node, "WARNING", f"{count - MOST_LOGGED} more lines were left out")
