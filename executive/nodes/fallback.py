"""Fallback: try children until one succeeds, and remember why each of the others failed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Selector

from executive.nodes.in_sight import FailureInSight
from executive.reasons import Reason, from_causes, path_of, reason_of


class Fallback(Selector):
    """py_trees' selector forgets a child's failure once it has gone on; this one keeps it and shows it to the next.

    Without memory every tick starts again with the first child.
    """

    path = ""

    def __init__(
        self, name: str, memory: bool, children: Sequence[Behaviour], in_sight: FailureInSight | None = None
    ) -> None:
        super().__init__(name, memory, children)
        self._causes: list[Reason] = []
        self._in_sight = in_sight or FailureInSight()

    def explain(self) -> Reason:
        """All children's reasons; the code is that of the last one that was not skipped.

        Those that were skipped come first: the last cause is what the fallback failed with.
        """
        tried = [cause for cause in self._causes if cause.code != "SKIPPED"]
        if not tried:
            return from_causes(self, tuple(self._causes))
        skipped = [cause for cause in self._causes if cause.code == "SKIPPED"]
        message = tried[-1].message
        if len(tried) > 1:
            message = f"none of {len(tried)} alternatives succeeded; the last: {message}"
        return Reason(path_of(self), tried[-1].code, message, causes=(*skipped, *tried))

    def tick(self) -> Iterator[Behaviour]:
        children = self.children
        index = 0
        if self.status is not Status.RUNNING:
            for child in children:
                if child.status is not Status.INVALID:
                    child.stop(Status.INVALID)
            self._causes.clear()
        elif self.memory and self.current_child is not None:
            index = children.index(self.current_child)
        else:
            self._causes.clear()
        for at in range(index, len(children)):
            child = children[at]
            yield from child.tick()
            if child.status is Status.RUNNING or child.status is Status.SUCCESS:
                self.current_child = child
                for lower in children[at + 1 :]:
                    if lower.status is not Status.INVALID:
                        lower.stop(Status.INVALID)
                if child.status is Status.SUCCESS:
                    self.stop(Status.SUCCESS)
                else:
                    self.status = Status.RUNNING
                yield self
                return
            reason = reason_of(child)
            self._causes.append(reason)
            if reason.code != "SKIPPED":
                self._in_sight.see(reason)
        self.current_child = children[-1] if children else None
        self.stop(Status.FAILURE)
        yield self
