"""What is known of a node before the run: with which codes it can fail, and what is surely written when it ends."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

Codes = frozenset[str]
NO_CODES: Codes = frozenset()
UNKNOWN = "?"
"""Stands for the codes of a skill or subtree that cannot be looked up: it may fail with any."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a node can end.

    Attributes:
        codes: with which codes it can fail; without any it cannot fail.
        succeeds: whether it can succeed.
        skips: whether it can be skipped.
        least: seconds of the run that a success takes at least.
    """

    codes: Codes = NO_CODES
    succeeds: bool = True
    skips: bool = False
    least: float = 0.0

    def plus(self, *codes: str) -> Outcome:
        """The same with more codes."""
        return Outcome(self.codes.union(codes), self.succeeds, self.skips, self.least)


def codes_of(outcomes: Iterable[Outcome]) -> Codes:
    """All codes together."""
    return NO_CODES.union(*(outcome.codes for outcome in outcomes))


class Names:
    """A set of names, or ALL of them."""

    __slots__ = ("names",)

    def __init__(self, names: frozenset[str] | None) -> None:
        self.names = names

    def __contains__(self, name: str) -> bool:
        return self.names is None or name in self.names

    def __and__(self, other: Names) -> Names:
        if self.names is None:
            return other
        if other.names is None or other.names is self.names:
            return self
        return Names(self.names & other.names)

    def __or__(self, other: Names) -> Names:
        if self.names is None or other.names is None:
            return ALL
        return Names(self.names | other.names)

    @property
    def reachable(self) -> bool:
        """Whether an end at which they are written can be reached."""
        return self.names is not None

    def when(self, before: Names) -> Names:
        """These, if what leads here can be reached; else ALL."""
        return self if before.reachable else ALL

    def plus(self, *names: str) -> Names:
        """The same with more names."""
        return self if self.names is None or not names else Names(self.names.union(names))


ALL = Names(None)
"""Stands for an end that cannot be reached."""


@dataclass(frozen=True, slots=True)
class Ends:
    """What is certainly written at a node's three ends."""

    success: Names
    failure: Names = ALL
    skipped: Names = ALL

    def any(self) -> Names:
        """What is certainly written however it ends."""
        return self.success & self.failure & self.skipped
