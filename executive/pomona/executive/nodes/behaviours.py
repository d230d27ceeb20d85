"""Base of all behaviours of the language: explanation of failures, and the status of a skipped node.

A skipped node ends its tick as INVALID: idle, as if it had not been ticked. Its parent continues as if the node did not
exist (BehaviorTree.CPP's SKIPPED; py_trees has no status of that name).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

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

    def __init__(self, name: str, children: Sequence[Behaviour]) -> None:
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
        if child.status is Status.RUNNING or (new_status is Status.INVALID and child.status is not Status.INVALID):
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
