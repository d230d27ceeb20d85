"""Meaning of the names `failure`, `retry`, `repeat` and `for_each` in an expression."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pomona.executive.reasons import Reason


@dataclass(frozen=True, slots=True)
class Around:
    """The context of a node in the file."""

    counters: frozenset[str] = frozenset()  # which of `retry`, `repeat` and `for_each` count here
    failure: frozenset[str] | None = None  # codes of the last failure; None when there is none
    items: frozenset[str] = frozenset()  # names of the items of all for_each around
    failed: str = ""  # label of the node that has failed, for messages


@dataclass(slots=True)
class LastFailure:
    """The failure that led here: of the sibling before in a fallback, or of the try that `on_failure` follows."""

    code: str = ""
    message: str = ""
    node: str = ""
    codes: tuple[str, ...] = ()
    data: Mapping[str, Any] = field(default_factory=dict)

    def see(self, reason: Reason) -> None:
        """Replace it: code, message and data are the failed leaf's."""
        leaf = reason
        while leaf.causes:
            leaf = leaf.causes[-1]
        self.code, self.message, self.data, self.node = reason.code, reason.message, leaf.data, leaf.node_path
        self.codes = tuple(sorted(reason.codes()))


@dataclass(slots=True)
class RetryCount:
    """The nearest retry around: number of this attempt, from 1, and how many there are."""

    attempt: int = 1
    of: int = 1


@dataclass(slots=True)
class RepeatCount:
    """The nearest repeat around: number of this round, from 1."""

    round: int = 1


@dataclass(slots=True)
class ForEachCount:
    """The nearest for_each around: number of this item, from 1, and how many there are."""

    index: int = 1
    of: int = 1


COUNTERS: Mapping[str, type[Any]] = {"retry": RetryCount, "repeat": RepeatCount, "for_each": ForEachCount}
"""Types of the counters, by the name in expressions."""
