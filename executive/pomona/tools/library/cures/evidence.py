"""Evidence in a record: how the run was begun and ended, which nodes ran, and which failed with which codes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

from pomona.executive.reasons import latest_leaf
from pomona.executive.running.events import (
    AttemptEnded,
    Event,
    NodeChanged,
    OperatorActed,
    RunEnded,
    RunStarted,
)

# weight of all failures before the last one, together, relative to it: an assumption
ON_THE_WAY = 0.5


@dataclass(frozen=True, slots=True)
class FailedNode:
    """A leaf, or a modifier, that failed; `weight` is 1 for the last one of the run."""

    path: str
    code: str
    message: str
    weight: float


@dataclass(slots=True)
class RunEvidence:
    """Content of a record that bears on a failure."""

    started: RunStarted | None = None
    ended: RunEnded | None = None
    acts: list[OperatorActed] = field(default_factory=list)
    ran: list[str] = field(default_factory=list)  # paths of nodes, by their first change
    # tries of the retries that used all of them, by their paths
    exhausted: dict[str, int] = field(default_factory=dict)
    failures: Counter[tuple[str, str]] = field(default_factory=Counter)  # by path and code
    messages: dict[tuple[str, str], str] = field(default_factory=dict)  # the last message of each

    def failed(self) -> list[FailedNode]:
        """Return the failed nodes: the last one first, then the others by the number of their failures."""
        reason = self.ended.reason if self.ended is not None else None
        last = latest_leaf(reason) if reason is not None else None
        found = [] if last is None else [FailedNode(last.node_path, last.code, last.message, 1.0)]
        keys = {(last.node_path, last.code)} if last is not None else set()
        others = [(key, count) for key, count in self.failures.most_common() if key not in keys]
        total = sum(self.failures.values())
        for (path, code), count in others:
            found.append(
                FailedNode(path, code, self.messages[path, code], ON_THE_WAY * count / total)
            )
        return found


def gather(events: Iterable[Event]) -> RunEvidence:
    """Return the evidence of a run's events."""
    found = RunEvidence()
    seen = set[str]()
    for event in events:
        if isinstance(event, RunStarted):
            found.started = event
        elif isinstance(event, RunEnded):
            found.ended = event
        elif isinstance(event, OperatorActed):
            found.acts.append(event)
        elif isinstance(event, AttemptEnded) and not event.succeeded and event.number >= event.of:
            found.exhausted[event.path] = event.of
        elif isinstance(event, NodeChanged):
            if event.path not in seen and event.status != "INVALID":
                seen.add(event.path)
                found.ran.append(event.path)
            reason = event.reason
            if reason is not None and not reason.causes and reason.code != "SKIPPED":
                found.failures[event.path, reason.code] += 1
                found.messages[event.path, reason.code] = reason.message
    return found
