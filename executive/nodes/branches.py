"""Sequence and parallel: py_trees' own meaning, without its logging in every tick."""

from __future__ import annotations

from collections.abc import Iterator

import py_trees
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status


class Sequence(py_trees.composites.Sequence):
    """Ticks its children in order while they succeed. Without memory every tick starts again with the first."""

    path = ""

    def tick(self) -> Iterator[Behaviour]:
        children = self.children
        index = 0
        if self.status is not Status.RUNNING:
            for child in children:
                if child.status is not Status.INVALID:
                    child.stop(Status.INVALID)
        elif self.memory and self.current_child is not None:
            index = children.index(self.current_child)
        for at in range(index, len(children)):
            child = self.current_child = children[at]
            yield from child.tick()
            if child.status is Status.SUCCESS:
                continue
            if not self.memory:
                for later in children[at + 1 :]:
                    if later.status is not Status.INVALID:
                        later.stop(Status.INVALID)
            if child.status is Status.RUNNING:
                self.status = Status.RUNNING
            else:
                self.stop(Status.FAILURE)
            yield self
            return
        self.stop(Status.SUCCESS)
        yield self


class Parallel(py_trees.composites.Parallel):
    """Ticks all its children in each tick; those that have succeeded wait for the others. One failure ends it."""

    path = ""

    def tick(self) -> Iterator[Behaviour]:
        children = self.children
        if self.status is not Status.RUNNING:
            for child in children:
                if child.status is not Status.INVALID:
                    child.stop(Status.INVALID)
        waits = self.policy.synchronise
        for child in children:
            if not (waits and child.status is Status.SUCCESS):
                yield from child.tick()
        status = self._outcome(children)
        self.current_child = next((child for child in children if child.status is status), children[-1])
        if status is Status.RUNNING:
            self.status = status
        else:
            self.stop(status)
        yield self

    def _outcome(self, children: list[Behaviour]) -> Status:
        statuses = [child.status for child in children]
        if Status.FAILURE in statuses or Status.INVALID in statuses:
            return Status.FAILURE
        if isinstance(self.policy, ParallelPolicy.SuccessOnOne):
            return Status.SUCCESS if Status.SUCCESS in statuses else Status.RUNNING
        if isinstance(self.policy, ParallelPolicy.SuccessOnSelected):
            chosen = [child.status for child in self.policy.children]
            return Status.RUNNING if Status.RUNNING in chosen else Status.SUCCESS
        return Status.RUNNING if Status.RUNNING in statuses else Status.SUCCESS
