"""Static results for a node: the codes with which it can fail, and the names that are certainly written at each end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

Codes = frozenset[str]
NO_CODES: Codes = frozenset()
UNKNOWN = "?"  # stands for the codes of a skill or subtree that cannot be looked up: it may fail with any


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a node can end."""

    codes: Codes = NO_CODES  # with which codes it can fail; without any it cannot fail
    succeeds: bool = True  # whether it can succeed
    skips: bool = False  # whether it can be skipped
    least: float = 0.0  # seconds of the run that a success takes at least

    def plus(self, *codes: str) -> Outcome:
        """Return the same with more codes."""
        return Outcome(self.codes.union(codes), self.succeeds, self.skips, self.least)


def codes_of(outcomes: Iterable[Outcome]) -> Codes:
    """Return all codes together."""
    return NO_CODES.union(*(outcome.codes for outcome in outcomes))


class Names:
    """A set of names, or ALL of them: a bit for each name, since long trees join and meet their ways very often.

    Sets made from one another number their names alike.
    """

    __slots__ = ("bits", "numbers")

    def __init__(self, names: Iterable[str] | None) -> None:
        """`names` is None for ALL."""
        self.numbers = {} if names is None else {name: number for number, name in enumerate(dict.fromkeys(names))}
        self.bits = (1 << len(self.numbers)) - 1 if names is not None else _EVERY_BIT

    def __contains__(self, name: str) -> bool:
        number = self.numbers.get(name)
        return self.bits == _EVERY_BIT or (number is not None and bool(self.bits >> number & 1))

    def __iter__(self) -> Iterator[str]:
        return (name for name in self.numbers if name in self)

    def __and__(self, other: Names) -> Names:
        if self.bits == _EVERY_BIT or self is other:
            return other
        if other.bits == _EVERY_BIT:
            return self
        return self._with(self.bits & self._numbered(other))

    def __or__(self, other: Names) -> Names:
        if self.bits == _EVERY_BIT or other.bits == _EVERY_BIT:
            return ALL
        return self._with(self.bits | self._numbered(other))

    @property
    def reachable(self) -> bool:
        """Whether an end at which they are written can be reached."""
        return self.bits != _EVERY_BIT

    def when(self, before: Names) -> Names:
        """Return these names if the place is reachable, else ALL."""
        return self if before.bits != _EVERY_BIT else ALL

    def plus(self, *names: str) -> Names:
        """Return the same with more names."""
        if not names or self.bits == _EVERY_BIT:
            return self
        bits = self.bits
        for name in names:
            bits |= 1 << self.numbers.setdefault(name, len(self.numbers))
        return self._with(bits)

    def _with(self, bits: int) -> Names:
        made = Names.__new__(Names)
        made.bits, made.numbers = bits, self.numbers
        return made

    def _numbered(self, other: Names) -> int:
        """Return the bits of another set as this one numbers names."""
        return other.bits if other.numbers is self.numbers else self._with(0).plus(*other).bits


_EVERY_BIT = -1
ALL = Names(None)  # stands for an end that cannot be reached


class Ends(NamedTuple):
    """Names that are certainly written at a node's three ends."""

    success: Names
    failure: Names = ALL
    skipped: Names = ALL

    def any(self) -> Names:
        """Return names that are certainly written at any end."""
        return self.success & self.failure & self.skipped
