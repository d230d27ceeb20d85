"""The base class of nodes that ask the operator, and the number that ties an answer to its question."""

from __future__ import annotations

from collections.abc import Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import Status


class Question(Behaviour):
    """A node that runs until the operator has answered; inherit it beside a leaf or a wrapper.

    Attributes:
        choices: the possible answers.
        attended: True while an operator can answer; set by the runner.
        starts: number of questions that the node has asked, which is also the number of the newest one.
    """

    choices: Sequence[str] = ()
    attended = False
    starts = 0
    _given: str | None = None

    def ask(self) -> None:
        """Begin a new question. Call it at each start of the node: earlier answers no longer count."""
        self.starts += 1
        self._given = None

    @property
    def given(self) -> str | None:
        """Answer to the newest question; None while there is none."""
        return self._given

    @property
    def open(self) -> bool:
        """True while the newest question waits for its answer."""
        return self.status is Status.RUNNING and self.starts > 0 and self._given is None

    def answer(self, number: int, choice: str) -> bool:
        """Answer question `number`; the next tick goes on.

        Returns:
            False, and changes nothing, when another question or none is open, or when the choice is unknown.
        """
        if not self.open or number != self.starts or choice not in self.choices:
            return False
        self._given = choice
        return True
