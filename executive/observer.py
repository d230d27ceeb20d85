"""Turns what a tick changed in the tree into events."""

from __future__ import annotations

from collections.abc import Callable

from py_trees.common import Status

from executive.events import AttemptEnded, Event, NodeChanged
from executive.reasons import Reason, reason_of
from executive.skill import Skill
from executive.tree_file import BuiltTree


class TreeObserver:
    """Compares every node with how it was after the tick before."""

    def __init__(self, tree: BuiltTree, emit: Callable[[Event], None], stamp: Callable[[], tuple[float, int]]) -> None:
        self._tree, self._emit, self._stamp = tree, emit, stamp
        self._known: dict[str, tuple[Status, str, int]] = {}
        self._attempts: dict[str, int] = {}

    def after_tick(self) -> str:
        """Emit what has changed.

        Returns:
            the path of the skill that kept the tick waiting longest.
        """
        slowest, longest = "", -1.0
        for node in self._tree.nodes:
            behaviour = node.behaviour
            starts = getattr(behaviour, "starts", 0)
            now = (behaviour.status, behaviour.feedback_message, starts)
            if isinstance(behaviour, Skill) and behaviour.status is not Status.INVALID and behaviour.blocked > longest:
                slowest, longest = node.path, behaviour.blocked
            if self._known.get(node.path) == now:
                continue
            before = self._known.get(node.path)
            self._known[node.path] = now
            if before is None and now[0] is Status.INVALID:
                continue
            failed = behaviour.status is Status.FAILURE
            self._emit(
                NodeChanged(
                    *self._stamp(), node.path, behaviour.status.value, now[1], starts,
                    reason_of(behaviour) if failed else None,
                )
            )  # fmt: skip
        for node in self._tree.nodes:
            attempts = getattr(node.behaviour, "attempts", ())
            seen = self._attempts.get(node.path, 0)
            if len(attempts) < seen:  # the retry was started afresh
                seen = 0
            for attempt in attempts[seen:]:
                self._emit(
                    AttemptEnded(
                        *self._stamp(), node.path, attempt.number, attempt.of, attempt.succeeded,
                        attempt.started, attempt.reason,
                    )
                )  # fmt: skip
            self._attempts[node.path] = len(attempts)
        return slowest

    def root_reason(self) -> Reason | None:
        """Why the tree failed, from the root down."""
        return reason_of(self._tree.root)

    def running_leaf(self) -> str:
        """Path of the deepest running node: where a fault happened, as far as the tree can tell."""
        running = [
            n.path for n in self._tree.nodes if n.behaviour.status is Status.RUNNING and not n.behaviour.children
        ]
        return running[-1] if running else ""
