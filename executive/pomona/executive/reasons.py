"""Why a node failed: a chain of reasons from the root down to the leaves that caused it; the meaning of each code."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING

import yaml

from pomona.executive.errors import PomonaError
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.plain_text import read_plain_text

if TYPE_CHECKING:
    from py_trees.behaviour import Behaviour


# how far down, and how many, causes of one reason are recorded and read
DEEPEST_CAUSE = 90
MOST_CAUSES = 10_000


class NoValue(PomonaError):
    """A required value is missing: an unwritten port, a division by zero; `place` is the file and line, if known."""

    place = ""

    def at(self, place: str) -> NoValue:
        """Return the error with its place; one that has a place keeps it."""
        if not self.place:
            self.place = place
            self.args = (f"{self}, in {place}",)
        return self


@dataclass(frozen=True, slots=True)
class Reason:
    """Why one node failed."""

    node_path: str  # path id of the node
    # a skill's failure code, or one of the tree's own (TIMEOUT, CONDITION_FALSE …). A composite takes the code of its
    # latest cause, so that `failure.code` means the same around a leaf and around a subtree.
    code: str
    message: str  # a sentence for a person
    data: Mapping[str, object] = field(default_factory=dict)  # JSON-like values
    # reasons of the children that led here, in the order in which they failed, after those that were skipped
    causes: tuple[Reason, ...] = ()

    def leaves(self) -> Iterator[Reason]:
        """Yield the reasons without further causes, in the order in which they happened."""
        if not self.causes:
            yield self
        for cause in self.causes:
            yield from cause.leaves()

    def codes(self) -> frozenset[str]:
        """Return every code in the chain."""
        return frozenset({self.code}).union(*(cause.codes() for cause in self.causes))


def bounded(reason: Reason) -> Reason:
    """Return the reason with no more causes than are recorded, and none farther down: the latest are kept.

    Where the way down is too long, the leaf that it led to stands at its end.
    """
    left = MOST_CAUSES // 2  # each may need one more below it, its leaf

    def cut(reason: Reason, depth: int) -> Reason:
        nonlocal left
        left -= 1
        if not reason.causes:
            return reason
        if depth == DEEPEST_CAUSE - 1:
            return replace(reason, causes=(latest_leaf(reason),))
        kept: list[Reason] = []
        for cause in reversed(reason.causes):
            if left <= 0:
                break
            kept.append(cut(cause, depth + 1))
        return replace(reason, causes=tuple(reversed(kept)) or (latest_leaf(reason),))

    return cut(reason, 0)


def latest_leaf(reason: Reason) -> Reason:
    """Return the end of the chain of latest causes: the leaf that failed last."""
    while reason.causes:
        reason = reason.causes[-1]
    return reason


def path_of(node: Behaviour) -> str:
    """Return the node's path id; its name when it was not built from a tree file."""
    path = getattr(node, "path", "")
    return path if isinstance(path, str) and path else node.name


def reason_of(node: Behaviour) -> Reason:
    """Why `node` failed. Ask in the tick in which it failed: its children start afresh with the next one."""
    explain = getattr(node, "explain", None)
    if explain is not None:
        reason = explain()
        assert isinstance(reason, Reason)
        return reason
    from py_trees.common import Status  # already loaded in a process with nodes

    failure = getattr(node, "reason", None)
    if failure is not None:
        return Reason(path_of(node), failure.code, failure.message, failure.data)
    causes = tuple(reason_of(child) for child in node.children if child.status is Status.FAILURE)
    return from_causes(node, causes)


def from_causes(node: Behaviour, causes: tuple[Reason, ...]) -> Reason:
    """Return the reason of a node that failed because its children did."""
    if not causes:
        return Reason(
            path_of(node),
            "FAILED",
            node.feedback_message or f"{node.name} failed without saying why",
        )
    return Reason(path_of(node), causes[-1].code, causes[-1].message, causes=causes)


@dataclass(frozen=True, slots=True)
class FailureCode:
    """One code; meaning and remedy are sentences without a capital and a full stop."""

    code: str
    meaning: str
    remedy: str


@cache
def failure_codes() -> Mapping[str, FailureCode]:
    """Return the codes that are described, by name, in the order of the file (trees/failures)."""
    found = yaml.safe_load(read_plain_text(installed_trees() / "failures" / "codes.yaml"))[
        "failures"
    ]
    return {
        code: FailureCode(code, about["meaning"], about["remedy"]) for code, about in found.items()
    }
