"""Facts at a place in a tree: conditions that have held on every path to it.

The language turns expressions into `Fact`s; node types return those that hold after them (`NodeType.known_facts`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from pomona.executive.values.findings import Located

Plain = bool | int | float | str
MAX_CASES = 32  # maximum number of cases to analyse; a condition with more is assumed to be possible


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
        low, high = max(self.low, other.low), min(self.high, other.high)
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
        cases = [case for case in fact.cases if not any(possible.none for possible in case.values())]
        if not cases:
            return fact
        # facts about the same names that are looked at together; the newest stay
        for known in [known for known in self.known if known.names & fact.names][-20:]:
            joined = [both for one in cases for other in known.cases if (both := _joined(one, other)) is not None]
            if not joined:
                return known
            if len(joined) <= MAX_CASES:
                cases = joined
        return None


def _joined(one: Case, other: Case) -> Case | None:
    """Return both together, or None when they exclude each other."""
    both = dict(one)
    for about, possible in other.items():
        both[about] = both[about].and_also(possible) if about in both else possible
        if both[about].none:
            return None
    return both
