"""Questions to the operator: ask, and approve, which checks the plan before a node starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import LeafBehaviour, Wrapper
from pomona.executive.nodes.context import (
    BuildContext,
    CheckContext,
    NodeContext,
    OutcomeContext,
)
from pomona.executive.nodes.facts import Outcome
from pomona.executive.nodes.node_type import Leaf, Modifier, TreeNode
from pomona.executive.ports import Port
from pomona.executive.reasons import NoValue
from pomona.executive.values.yaml_nodes import YamlList, YamlScalar


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

    def renew(self) -> None:
        """Ask again, since what was shown may have changed; a node that has started goes on."""
        if self.status is Status.RUNNING and all(
            child.status is not Status.RUNNING for child in self.children
        ):
            self.ask()

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


APPROVE = "approve"
REFUSE = "refuse"


class Approve(Question, Wrapper):
    """Waits at each start for the operator's approval; fails after a refusal, or in a run without an operator."""

    choices = (APPROVE, REFUSE)

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.ask()
            self.why = None
        if self.given == APPROVE:
            yield from super().tick()
            return
        if self.given is None and self.attended:
            self.status = Status.RUNNING
            self.feedback_message = f"May {self.decorated.name} start? The plan is shown."
        elif self.given is None:
            self.stop(self.fails("NOBODY_TO_ASK", f"no operator can approve {self.decorated.name}"))
        else:
            self.stop(self.fails("NOT_APPROVED", f"{self.decorated.name} was not approved"))
        yield self


class ApproveType(Modifier):
    """asks the operator before each start; fails with `NOT_APPROVED`, or with `NOBODY_TO_ASK` without an operator"""

    key = "approve"
    symbol = "✋"
    value = takes.Value(Port(bool), known=True)
    codes = ("NOT_APPROVED", "NOBODY_TO_ASK")
    faithful = True

    def needed(self, at: NodeContext) -> bool:
        return at.literal(self.key) is True

    def choices(self, node: TreeNode) -> tuple[str, ...]:
        return Approve.choices

    makes = Approve


CHOICES = ("yes", "no")


class Ask(Question, LeafBehaviour):
    """Runs until the operator has answered. Without an answer it takes the default, or fails if there is none."""

    def __init__(
        self,
        name: str,
        question: Callable[[], str],
        choices: Sequence[str],
        write: Callable[[Any], None],
        now: Callable[[], float],
        *,
        default: str | None = None,
        within: Callable[[], float] | None = None,
    ) -> None:
        super().__init__(name)
        self.choices = tuple(choices)
        self._question = question
        self._write = write
        self._now = now
        self._default = default
        self._within = within
        self._asked, self._end = "", float("inf")

    def begin(self) -> None:
        self._asked = self._question()
        self.ask()
        self._end = float("inf") if self._within is None else self._now() + self._within()

    def act(self) -> Status:
        if self.given is not None:
            return self._ends(self.given, f"{self._asked} {self.given}")
        if not self.attended:
            return self._without("NOBODY_TO_ASK", "the run has no operator to answer")
        if self._now() >= self._end - 1e-9:
            return self._without("NO_ANSWER", "no answer came in time")
        self.feedback_message = self._asked
        return Status.RUNNING

    def _without(self, code: str, why: str) -> Status:
        if self._default is None:
            return self.fails(
                code, f"{why}: {self._asked}", question=self._asked, choices=list(self.choices)
            )
        return self._ends(self._default, f"{self._asked} {self._default} (the default: {why})")

    def _ends(self, answer: str, said: str) -> Status:
        self._write(answer)
        self.feedback_message = said
        return Status.SUCCESS


class AskType(Leaf):
    """asks the operator and writes the answer; fails with `NO_ANSWER` or `NOBODY_TO_ASK` unless there is a `default`"""

    key, symbol, colour = "ask", "?", "#b26a00"
    value = takes.Value(Port(str), "the question")
    fields: ClassVar[takes.Fields] = {
        "choices": takes.Words("the possible answers, by default yes and no"),
        "answer": takes.Target("name to which the answer is written"),
        "default": takes.Value(Port(str), "the answer if the operator gives none", known=True),
        "within": takes.duration("how long to wait for an answer"),
    }
    ends = ("success", "failure")

    def check_layer(self, at: CheckContext) -> None:
        super().check_layer(at)
        default = at.literal("default")
        written = at.written("default")
        choices = at.literal("choices") or CHOICES
        if len(set(choices)) != len(choices):
            at.findings.error(
                at.written("choices") or at.node.key, "value", "an answer stands twice in 'choices'"
            )
        if isinstance(written, YamlScalar) and isinstance(default, str) and default not in choices:
            at.findings.error(
                written,
                "value",
                f"the default '{default}' is not one of the choices: {', '.join(choices)}",
            )

    def choices(self, node: TreeNode) -> tuple[str, ...]:
        entry = node.entry(self, "choices")
        items = entry[1].items if entry is not None and isinstance(entry[1], YamlList) else ()
        return tuple(item.text for item in items if isinstance(item, YamlScalar)) or CHOICES

    codes = ("NO_ANSWER", "NOBODY_TO_ASK")

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome() if at.written("default") is not None else super().possible_outcome(at)

    def build(self, at: BuildContext) -> Behaviour:
        default = at.value("default")() if at.given("default") else None
        within = at.value("within") if at.given("within") else None
        write = at.writer("answer") if at.written("answer") is not None else _nowhere
        choices = at.literal("choices") or CHOICES
        return Ask(
            at.name,
            _text(at.value(self.key)),
            choices,
            write,
            at.now,
            default=default,
            within=within,
        )


def _text(get: Callable[[], Any]) -> Callable[[], str]:
    def question() -> str:
        value = get()
        if not isinstance(value, str):
            raise NoValue(f"a question must be a text, not {value!r}")
        return value

    return question


def _nowhere(_answer: Any) -> None:
    """Discard an answer that no node reads: only the operator's check is required."""
