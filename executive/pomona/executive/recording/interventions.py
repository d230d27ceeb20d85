"""What operators did in a run, as a chain: each entry holds the digest of the one before, and the last one closes it.

An entry that is changed, left out, put elsewhere or added breaks the chain. The digest of the closing entry names the
whole log: written down elsewhere (`pomona runs show` and `pomona evidence` print it), it finds also a log that somebody
has made anew from its first entry on, which the chain alone cannot.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.executive.recording.json_text import parse_object
from pomona.executive.recording.scan import scan
from pomona.executive.running.events import OperatorActed

INTERVENTIONS = "/interventions"
FIRST = "0" * 64
"""What the first entry holds, since there is none before."""
_ACT = ("t", "tick", "who", "action", "detail")


class EntryChain:
    """Makes the entries of a log."""

    def __init__(self) -> None:
        self.count = 0
        self._before = FIRST

    def add(self, act: OperatorActed) -> dict[str, Any]:
        """The entry of one intervention."""
        return self._entry(False, {name: getattr(act, name) for name in _ACT})

    def close(self) -> dict[str, Any]:
        """The entry that ends the log."""
        return self._entry(True, {})

    def _entry(self, closed: bool, act: dict[str, Any]) -> dict[str, Any]:
        from pomona.executive.encode import encoded  # only who writes needs numpy

        self.count += 1
        entry = {"number": self.count, "before": self._before, "closed": closed, **act}
        self._before = digest_of(encoded(entry))
        return entry


@dataclass(frozen=True, slots=True)
class Log:
    """What a record says about interventions.

    Attributes:
        acts: what was done, in order.
        digest: of the newest entry; empty without any.
        closed: the log has its end.
        problem: where the chain is broken, as a sentence; empty while it holds.
    """

    acts: tuple[OperatorActed, ...] = ()
    digest: str = ""
    closed: bool = False
    problem: str = ""


def digest_of(entry: bytes) -> str:
    """What the next entry must hold."""
    return hashlib.sha256(entry).hexdigest()


def read_log(entries: Iterable[bytes], acts: Sequence[dict[str, Any]] | None = None, cut: bool = False) -> Log:
    """Check a log.

    Args:
        entries: of `/interventions`, as they stand in the record.
        acts: the interventions among the record's events, which must be the same; None: they are not compared.
        cut: the record has no end, so the log needs none.
    """
    found: list[OperatorActed] = []
    before, closed, number = FIRST, False, 0
    for number, content in enumerate(entries, start=1):
        broken = Log(tuple(found), before, closed, f"the log of interventions is broken at entry {number}")
        if closed:
            return broken
        try:
            entry = parse_object(content)
            if entry["number"] != number or entry["before"] != before:
                return broken
            closed = entry["closed"] is True
            if not closed:
                found.append(OperatorActed(*(entry[name] for name in _ACT)))
        except (ValueError, KeyError):
            return broken
        before = digest_of(content)
    problem = ""
    if number and not closed and not cut:
        problem = "the log of interventions has no end: entries are missing"
    elif acts is not None and [_said(act) for act in found] != [{name: act.get(name) for name in _ACT} for act in acts]:
        missing_last = cut and len(acts) > len(found)
        problem = "" if missing_last else "the log of interventions says something else than the run's events"
    return Log(tuple(found), before if number else "", closed, problem)


def interventions(path: Path, cut: bool) -> Log:
    """The log of a record's file, compared with its events.

    Raises:
        UsageError: the file cannot be read or is not believed.
    """
    entries, acts = [], []
    for topic, content, *_ in scan(path):
        if topic == INTERVENTIONS:
            entries.append(content)
        elif topic == "/events" and content.startswith(b'{"event":"OperatorActed"'):
            acts.append(parse_object(content))
    return read_log(entries, acts if entries else None, cut)


def _said(act: OperatorActed) -> dict[str, Any]:
    return {name: getattr(act, name) for name in _ACT}
