"""What a node that asks a person is, for all who show questions and hand over answers."""

from __future__ import annotations

from collections.abc import Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import Status


class Question(Behaviour):
    """Runs until a person has answered; to be inherited beside a leaf or a wrapper.

    Attributes:
        choices: the answers that there are.
        attended: whether there is somebody to answer; set by who runs the tree.
        given: the answer; a new start takes it back.
    """

    choices: Sequence[str] = ()
    attended = False
    given: str | None = None

    @property
    def open(self) -> bool:
        """Whether it waits for an answer now."""
        return self.status is Status.RUNNING and self.given is None

    def answer(self, choice: str) -> bool:
        """Answer it; the next tick goes on. False for what is no choice, or when nothing is asked now."""
        if not self.open or choice not in self.choices:
            return False
        self.given = choice
        return True
