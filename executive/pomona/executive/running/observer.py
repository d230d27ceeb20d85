"""Turns the changes of a tick in the tree into events."""

from __future__ import annotations

from collections.abc import Callable

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.errors import SkillError
from pomona.executive.language import BuiltTree
from pomona.executive.nodes import Attempt
from pomona.executive.nodes.question import Question
from pomona.executive.reasons import Reason, reason_of
from pomona.executive.running.events import AttemptEnded, Event, NodeChanged
from pomona.executive.skill import Skill
from pomona.executive.values.sentences import shortened


class TreeObserver:
    """Compares every node with how it was after the tick before."""

    def __init__(self, tree: BuiltTree, emit: Callable[[Event], None], stamp: Callable[[], tuple[float, int]]) -> None:
        self._tree, self._emit, self._stamp = tree, emit, stamp
        self._known: dict[str, tuple[Status, str, int]] = dict.fromkeys(tree.behaviours, (Status.INVALID, "", 0))
        self._nodes = tuple(
            (path, behaviour, behaviour if isinstance(behaviour, (Skill, Question)) else None)
            for path, behaviour in tree.behaviours.items()
        )
        self._started: set[int] = set()  # identities of the behaviours that acted in this tick
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
