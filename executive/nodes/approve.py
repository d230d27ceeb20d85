"""Approve: a person looks at what is planned before a node starts."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from executive.nodes import takes
from executive.nodes.asking import Asking, Building, Ending, Flowing, Knowing
from executive.nodes.behaviours import Wrapper
from executive.nodes.ends import Ends, Names, Outcome
from executive.nodes.facts import Facts
from executive.nodes.node_type import Modifier
from executive.ports import Port

APPROVE, REFUSE = "approve", "refuse"


class Approve(Wrapper):
    """Waits at each start until a person approves; whoever refuses makes it fail, and so does nobody being there.

    Attributes:
        choices: the answers that there are.
        attended: whether there is somebody to answer; set by who runs the tree.
    """

    choices = (APPROVE, REFUSE)

    def __init__(self, name: str, child: Behaviour) -> None:
        super().__init__(name, child)
        self.attended = False
        self._answer: str | None = None

    @property
    def open(self) -> bool:
        """Whether it waits for an answer now."""
        return self.status is Status.RUNNING and self._answer is None

    @property
    def question(self) -> str:
        """As it is asked."""
        return f"May {self.decorated.name} start? What is planned is shown."

    def answer(self, choice: str) -> bool:
        """Answer it; the next tick goes on. False for what is no choice, or when nothing is asked now."""
        if not self.open or choice not in self.choices:
            return False
        self._answer = choice
        return True

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self._answer, self.why = None, None
        if self._answer == APPROVE:
            yield from super().tick()
            return
        if self._answer is None and self.attended:
            self.status, self.feedback_message = Status.RUNNING, self.question
        elif self._answer is None:
            self.stop(self.fails("NOBODY_TO_ASK", f"nobody is there to approve {self.decorated.name}"))
        else:
            self.stop(self.fails("NOT_APPROVED", f"{self.decorated.name} was not approved"))
        yield self


class ApproveType(Modifier):
    """waits for a person before each start; fails with `NOT_APPROVED`, or `NOBODY_TO_ASK` when nobody is there"""

    key, symbol = "approve", "✋"
    value = takes.Value(Port(bool), known=True)
    outside_of = "timeout"

    def needed(self, at: Asking) -> bool:
        return at.literal(self.key) is True

    def outcome(self, at: Ending) -> Outcome:
        return at.inside().plus("NOT_APPROVED", "NOBODY_TO_ASK")

    def flow(self, at: Flowing, before: Names) -> Ends:
        ends = at.inside(before)
        return Ends(ends.success, ends.failure & before, ends.skipped)

    def truth(self, at: Knowing, known: Facts) -> Facts:
        return at.inside(known)

    def build(self, at: Building) -> Behaviour:
        return Approve(at.name, at.inside())
