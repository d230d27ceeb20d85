"""Static results for a node: its failure codes, the names that are written at each end, and the conditions that hold.

The language turns expressions into `Fact`s; node types return those that hold after them (`NodeType.known_facts`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from pomona.executive.reasons import NoValue
from pomona.executive.values.findings import Located

Plain = bool | int | float | str
# maximum number of cases to analyse; a condition with more is assumed to be possible
MAX_CASES = 32


@dataclass(frozen=True, slots=True)
class Possible:
    """Which values something may have: a range, a set of words, or all but some."""

    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    below: bool = False
    among: frozenset[Plain] | None = None
    without: frozenset[Plain] = frozenset()

    def and_also(self, other: Possible) -> Possible:
        """Return the values that both allow."""
        low = max(self.low, other.low)
        high = min(self.high, other.high)
        above = any(p.above and p.low == low for p in (self, other))
        below = any(p.below and p.high == high for p in (self, other))
        sets = [p.among for p in (self, other) if p.among is not None]
        among = None if not sets else sets[0].intersection(*sets)
        return Possible(low, high, above, below, among, self.without | other.without)

    @property
    def none(self) -> bool:
        """Whether no value is left."""
        if self.among is not None:
            return not any(self.allows(value) for value in self.among)
        if self.low == self.high:
            return not self.allows(self.low)
        return self.low > self.high

    def allows(self, value: Plain) -> bool:
        """Return True if a value is in the range, and not one of those that are left out."""
        if value in self.without:
            return False
        if isinstance(value, str):
            return self.low == -math.inf and self.high == math.inf
        over = value > self.low if self.above else value >= self.low
        return over and (value < self.high if self.below else value <= self.high)


Case = Mapping[str, Possible]  # facts that hold together, by their subject


@dataclass(frozen=True, slots=True)
class Fact:
    """A condition as cases; at least one of them holds."""

    cases: tuple[Case, ...]  # if empty, it can never hold
    names: frozenset[str]  # the names that it reads
    lasts: bool  # whether it stays true until one of its names is written; a field of a value may change by itself
    text: str  # text, where: as it is written
    where: Located


@dataclass(frozen=True, slots=True)
class Facts:
    """Facts at a place; `shared` names may change at any time."""

    known: tuple[Fact, ...] = ()
    shared: frozenset[str] = frozenset()

    def plus(self, fact: Fact | None) -> Facts:
        """With one more fact."""
        if fact is None or fact.names & self.shared:
            return self
        return Facts((*self.known, fact), self.shared)

    def without(self, names: Iterable[str], *, passing: bool) -> Facts:
        """Return the facts after a write to these names; with `passing`, time passes, too."""
        if not self.known:
            return self
        gone = frozenset(names)
        kept = tuple(f for f in self.known if not f.names & gone and (f.lasts or not passing))
        return Facts(kept, self.shared)

    def sharing(self, names: Iterable[str]) -> Facts:
        """Return the facts while other nodes may write these names at any time."""
        return Facts(self.without(names, passing=True).known, self.shared.union(names))

    def against(self, fact: Fact) -> Fact | None:
        """Return a fact beside which the new one cannot hold; the new one itself when it never can."""
        cases = [
            case for case in fact.cases if not any(possible.none for possible in case.values())
        ]
        if not cases:
            return fact
        # facts about the same names that are looked at together; the newest stay
        for known in [known for known in self.known if known.names & fact.names][-20:]:
            joined = [
                both
                for one in cases
                for other in known.cases
                if (both := _joined(one, other)) is not None
            ]
            if not joined:
                return known
            if len(joined) <= MAX_CASES:
                cases = joined
        return None


def merged(one: Case, other: Case) -> Case:
    """Return both together."""
    both = dict(one)
    for about, possible in other.items():
        both[about] = both[about].and_also(possible) if about in both else possible
    return both


def _joined(one: Case, other: Case) -> Case | None:
    """Return both together, or None when they exclude each other."""
    both = merged(one, other)
    return None if any(possible.none for possible in both.values()) else both


Codes = frozenset[str]
NO_CODES: Codes = frozenset()
# stands for the codes of a skill or subtree that cannot be looked up: it may fail with any
UNKNOWN = "?"


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
        self.numbers = (
            {}
            if names is None
            else {name: number for number, name in enumerate(dict.fromkeys(names))}
        )
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
        made.bits = bits
        made.numbers = self.numbers
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


class Condition:
    """An expression with the values that it reads, for the sentence that explains a false result."""

    def __init__(
        self,
        text: str,
        holds: Callable[[], bool],
        read: Mapping[str, Callable[[], object]] | None = None,
    ) -> None:
        self.text, self.holds, self._read = text, holds, dict(read or {})

    def values(self) -> dict[str, object]:
        """Return the current values of the names in the expression."""
        found: dict[str, object] = {}
        for name, get in self._read.items():
            try:
                value = get()
            except NoValue:
                continue
            found[name] = (
                value
                if isinstance(value, (bool, int, float, str)) or value is None
                else str(value)[:80]
            )
        return found

    def sentence(self) -> str:
        """`{width} > 0.05 is false: width is 0.03`."""
        shown = ", ".join(
            f"{n} is {v:.6g}" if isinstance(v, float) else f"{n} is {v}"
            for n, v in self.values().items()
        )
        return f"{self.text} is false" + (f": {shown}" if shown else "")
