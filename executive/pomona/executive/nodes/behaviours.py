"""Behaviours of the language: their bases, sequences and parallels; failures are explained, nodes may be skipped.

A skipped node ends its tick as INVALID: idle, as if it had not been ticked. Its parent continues as if the node did not
exist (BehaviorTree.CPP's SKIPPED; py_trees has no status of that name).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence as SequenceOf
from itertools import islice

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Composite
from py_trees.decorators import Decorator

from pomona.executive.reasons import NoValue, Reason, from_causes, path_of, reason_of


class LeafBehaviour(Behaviour):
    """A leaf that knows why it failed. Subclasses override `act`, and `begin` if they must."""

    path = ""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.why: Reason | None = None

    def begin(self) -> None:
        """Called at each start; may raise NoValue."""

    def act(self) -> Status:
        """One tick; may raise NoValue."""
        return Status.SUCCESS

    def fails(self, code: str, message: str, **data: object) -> Status:
        """Note why the node fails."""
        self.why = Reason(path_of(self), code, message, data)
        self.feedback_message = message
        return Status.FAILURE

    def explain(self) -> Reason:
        """Why the node failed."""
        return self.why or Reason(path_of(self), "FAILED", f"{self.name} failed")

    def update(self) -> Status:
        """One tick, for py_trees' own drivers."""
        return self.act()

    def tick(self) -> Iterator[Behaviour]:
        try:
            if self.status is not Status.RUNNING:
                self.why = None
                self.feedback_message = ""
                self.begin()
            status = self.act()
        except NoValue as missing:
            status = self.fails("BAD_VALUE", str(missing))
        if status is not Status.RUNNING:
            self.stop(status)
        self.status = status
        yield self


class Branch(Composite):
    """A node with several children; at its end it interrupts children that still run."""

    path = ""

    def __init__(self, name: str, children: SequenceOf[Behaviour]) -> None:
        super().__init__(name, list(children))

    def stop(self, new_status: Status = Status.INVALID) -> None:
        if new_status is Status.INVALID:
            self.current_child = None
            for child in self.children:
                if child.status is not Status.INVALID:
                    child.stop(Status.INVALID)
        else:
            for child in self.children:
                if child.status is Status.RUNNING:
                    child.stop(Status.INVALID)
        self.terminate(new_status)
        self.status = new_status

    def reset(self) -> None:
        """Make all children idle again, before a fresh start."""
        for child in self.children:
            if child.status is not Status.INVALID:
                child.stop(Status.INVALID)


class Sequence(Branch):
    """Ticks its children in order while they succeed. Without memory every tick starts again with the first.

    Args:
        keeps: whether a start after a failure goes on with the child that failed.
    """

    def __init__(
        self, name: str, memory: bool, children: SequenceOf[Behaviour], keeps: bool = False
    ) -> None:
        super().__init__(name, children)
        self.memory = memory
        self.keeps = keeps
        self._at = self._skipped = 0

    def tick(self) -> Iterator[Behaviour]:
        children = self.children
        if self.status is not Status.RUNNING:
            self.reset()
            if not self.keeps:
                self._at = 0
            self._skipped = 0
        elif not self.memory:
            self._at = self._skipped = 0
        for at, child in islice(
            enumerate(children), self._at, None
        ):  # a held tick may find more children
            self.current_child = child
            yield from child.tick()
            status = child.status
            if status is Status.SUCCESS:
                continue
            if status is Status.INVALID:
                self._skipped += 1
                continue
            self._at = at
            if not self.memory:
                for later in children[at + 1 :]:
                    if later.status is not Status.INVALID:
                        later.stop(Status.INVALID)
            if status is Status.RUNNING:
                self.status = status
            else:
                self.stop(Status.FAILURE)
            yield self
            return
        self._at = 0
        self.stop(Status.INVALID if self._skipped == len(children) else Status.SUCCESS)
        yield self


class Parallel(Branch):
    """Ticks its children in order, in each tick all that have not ended; ends with the first decisive child.

    Children after the decisive one are not ticked any more, and running children are interrupted. A skipped child is
    ticked again in the next tick.

    Args:
        needed: indices of the children that must succeed, or be skipped; or the number of children that must succeed.
    """

    def __init__(
        self, name: str, children: SequenceOf[Behaviour], needed: frozenset[int] | int
    ) -> None:
        super().__init__(name, children)
        self._any = needed if isinstance(needed, int) else 0
        self._needed = [
            not isinstance(needed, int) and index in needed for index in range(len(children))
        ]
        self._open = 0

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.reset()
            self._open = self._any or sum(self._needed)
        done = Status.SUCCESS
        skipped = 0
        skipped_needed = 0
        for child, needed in zip(self.children, self._needed, strict=True):
            if child.status is done:
                continue
            yield from child.tick()
            status = child.status
            if status is Status.RUNNING:
                continue
            failed = status is Status.FAILURE
            if status is Status.INVALID:
                skipped += 1
                skipped_needed += needed
            elif not failed:
                self._open -= needed or self._any > 0
            if failed or self._open <= skipped_needed:
                self.current_child = child
                self.stop(status if failed else Status.SUCCESS)
                yield self
                return
        if skipped == len(self.children):
            self.stop(Status.INVALID)
        else:
            self.current_child = self.children[-1]
            self.status = Status.RUNNING
        yield self


class Wrapper(Decorator):
    """A decorator that knows why it failed. Subclasses override `begin` and `after`."""

    path = ""

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name, child)
        self.why: Reason | None = None

    def begin(self) -> Status | None:
        """Called at each start, before the child's first tick; a status ends the node without ticking the child.

        INVALID skips the node, RUNNING asks again in the next tick.

        Raises NoValue: a value that the node needs is not there; the node fails.
        """
        return None

    def after(self, status: Status) -> Status:
        """Return the node's own status, given its child's: RUNNING, SUCCESS or FAILURE."""
        return status

    def after_skipped(self) -> Status:
        """Return the node's own status when its child was skipped."""
        return Status.INVALID

    def fails(self, code: str, message: str, *causes: Reason, **data: object) -> Status:
        """Note why the node fails."""
        self.why = Reason(path_of(self), code, message, data, causes)
        self.feedback_message = message
        return Status.FAILURE

    def explain(self) -> Reason:
        """Why the node failed."""
        return self.why or from_causes(self, (reason_of(self.decorated),))

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.why = None
            self.feedback_message = ""
            try:
                ended = self.begin()
            except NoValue as missing:
                ended = self.fails("BAD_VALUE", str(missing))
            if ended is not None:
                self.stop(ended)
                yield self
                return
        yield from self.decorated.tick()
        status = self.decorated.status
        status = self.after_skipped() if status is Status.INVALID else self.after(status)
        if status is not Status.RUNNING:
            self.stop(status)
        self.status = status
        yield self

    def stop(self, new_status: Status) -> None:
        child = self.decorated
        if child.status is Status.RUNNING or (
            new_status is Status.INVALID and child.status is not Status.INVALID
        ):
            child.stop(Status.INVALID)
        self.terminate(new_status)
        self.status = new_status

    def update(self) -> Status:
        """Return the status after its child was ticked, for py_trees' own drivers."""
        return self.after(self.decorated.status)


class Subtree(Wrapper):
    """The frame around a subtree."""


class WholeTree(Wrapper):
    """Around a root that may be skipped: when there was nothing to do, the run has succeeded."""

    def explain(self) -> Reason:
        """Return the root's own reason."""
        return reason_of(self.decorated)

    def after_skipped(self) -> Status:
        return Status.SUCCESS
