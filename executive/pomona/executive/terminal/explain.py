"""What happened in a run and why, in a few plain sentences."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from pomona.executive.reasons import Reason
from pomona.executive.recording.difference import Difference, first_difference
from pomona.executive.running.events import (
    AttemptEnded,
    ErrorRaised,
    Event,
    HandChanged,
    LinkChanged,
    NodeChanged,
    OperatorActed,
    RunEnded,
    RunStarted,
    SafeStopped,
    TickOverran,
)
from pomona.executive.speed import words_of
from pomona.executive.terminal.summary import Summary
from pomona.executive.terminal.words import at_place, figure, seconds

ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth", "ninth", "tenth")
BLOCKED = 0.5
"""Seconds from which a tick that waited is told."""


def did_not_work(overrun: TickOverran) -> bool:
    """Whether the tick was late though it had little to compute."""
    return overrun.worked is not None and overrun.worked < 0.5 * overrun.duration


MOST_ATTEMPTS = 4
"""Attempts that are told one by one; of more, the first and the last are."""


def explain(
    events: Iterable[Event], going_on: bool = False, why_cut: str = "the process was killed or lost its power"
) -> list[str]:
    """Paragraphs for a person.

    Args:
        events: of the run, from its start.
        going_on: the record has no end because the run is still going on.
        why_cut: otherwise, why it has none.
    """
    story = _Story()
    for event in events:
        story.on_event(event)
    return [paragraph for paragraph in story.tell(going_on, why_cut) if paragraph]


class _Story:
    def __init__(self) -> None:
        self.summary = Summary()
        self.nodes: dict[str, Mapping[str, Any]] = {}
        self.failures: list[NodeChanged] = []
        self.acts: list[OperatorActed] = []
        self.stops: list[SafeStopped] = []
        self.links: list[LinkChanged] = []
        self.errors: list[ErrorRaised] = []
        self.hands: list[HandChanged] = []
        self.overruns: list[TickOverran] = []
        self.running: dict[str, float] = {}
        self.t = 0.0

    def on_event(self, event: Event) -> None:
        self.summary.on_event(event)
        self.t = max(self.t, event.t)
        if isinstance(event, RunStarted):
            self.nodes = {node["path"]: node for node in event.nodes}
        elif isinstance(event, NodeChanged):
            if event.status == "RUNNING":
                self.running.setdefault(event.path, event.t)
            else:
                self.running.pop(event.path, None)
            if event.reason is not None and not event.reason.causes and event.reason.code != "SKIPPED":
                self.failures.append(event)
        elif isinstance(event, OperatorActed):
            self.acts.append(event)
        elif isinstance(event, SafeStopped):
            self.stops.append(event)
        elif isinstance(event, ErrorRaised):
            self.errors.append(event)
        elif isinstance(event, HandChanged):
            self.hands.append(event)
        elif isinstance(event, TickOverran):
            self.overruns.append(event)
        elif isinstance(event, LinkChanged) and event.state != "ok":
            self.links.append(event)

    # ------------------------------------------------------------------------------------------ paragraphs

    def tell(self, going_on: bool, why_cut: str) -> Iterator[str]:
        started, ended = self.summary.started, self.summary.ended
        if started is None:
            yield f"The record holds no beginning of a run: {why_cut}."
            return
        yield f"{self._opening(started)} {self._outcome(ended, going_on, why_cut)}"
        if ended is not None and ended.reason is not None:
            yield self._why(ended.reason)
        yield self._attempts()
        yield self._on_the_way(ended)
        yield self._in_hand()
        yield self._interventions()
        yield from self._errors()
        yield " ".join(
            f"{name.capitalize()}: {_sentence(re.sub(' {2,}', ', ', note))}"
            for name, note in self.summary.notes.items()
        )
        yield self._time(ended)
        if ended is not None and ended.truth:
            yield _world(ended.truth)

    def _opening(self, started: RunStarted) -> str:
        settings = ", ".join(f"{key} = {value}" for key, value in started.settings.items())
        with_what = f"seed {started.seed}" + (f" and {settings}" if settings else "")
        if started.speed < 1.0:
            with_what += f", at {words_of(started.speed)} of the speed"
        kind = {"real": "real", "mock": "mocked"}.get(started.cell_kind, started.cell_kind)
        day = f"{datetime.fromtimestamp(started.wall_time):%d %B %Y at %H:%M}".lstrip("0")
        return f"{started.tree} ran on the {kind} cell {started.cell} with {with_what}, on {day}."

    def _outcome(self, ended: RunEnded | None, going_on: bool, why_cut: str) -> str:
        if ended is None:
            at = " and ".join(sorted({self._name(path) for path in self.running if path in self._leaves()}))
            where = f", while {at} was running" if at else ""
            if going_on:
                return f"It is still going on: {seconds(self.t)} so far{where}."
            return f"The record ends after {seconds(self.t)}{where}: {why_cut}."
        if ended.outcome == "success":
            most = self.summary.last_attempt()
            which = "" if most is None else f", on the {_ordinal(most.number)} attempt of {most.of}"
            return f"It succeeded after {seconds(ended.time)}{which if most and most.number > 1 else ''}."
        word = {"failure": "failed", "stopped": "was stopped"}.get(ended.outcome, "ended in the safe state")
        return f"It {word} after {seconds(ended.time)}."

    def _why(self, reason: Reason) -> str:
        leaf = list(reason.leaves())[-1]
        where = self._place(leaf.node_path)
        text = f"The reason is {leaf.code}" + (f" of {where}" if where else "")
        text += f": {_sentence(leaf.message + at_place(leaf))}"
        text += _figures(leaf.data)
        chain = list(dict.fromkeys(self._name(step.node_path) for step in _last_chain(reason)))
        if len(chain) > 2:
            text += f" With it failed {', then '.join(reversed(chain[:-1]))}."
        return text

    def _attempts(self) -> str:
        failed = self._failed_attempts()
        shown: list[tuple[AttemptEnded, str] | None] = list(failed)
        if len(failed) > MOST_ATTEMPTS:
            shown = [*failed[: MOST_ATTEMPTS - 1], None, failed[-1]]
        ended = self.summary.ended
        known = {_kind(leaf) for leaf in (ended.reason.leaves() if ended and ended.reason else ())}
        sentences = []
        for entry in shown:
            if entry is None:
                sentences.append(f"So it went on, {len(failed) - MOST_ATTEMPTS} attempts more.")
                continue
            attempt, within = entry
            leaf = _leaf(attempt)
            name = self._name(attempt.path.partition(":")[0]) + (f", in {within}" if within else "")
            which = f"Attempt {attempt.number} of {attempt.of} ({name})"
            if leaf is None:
                sentences.append(f"{which} ended at {attempt.t:.1f} s.")
            elif _kind(leaf) in known:
                sentences.append(f"{which} ended at {attempt.t:.1f} s with {leaf.code}, too.")
            else:
                known.add(_kind(leaf))
                why = f"{self._name(leaf.node_path)} said {leaf.code}: {_sentence(leaf.message)}"
                sentences.append(f"{which} ended at {attempt.t:.1f} s: {why}")
        return " ".join(sentences)

    def _failed_attempts(self) -> list[tuple[AttemptEnded, str]]:
        """Attempts that failed, without those around them that failed with them; each with what it is within."""
        failed: list[tuple[AttemptEnded, str]] = []
        for attempt, within in zip(self.summary.attempts, self.summary.within(), strict=True):
            before = failed[-1][0] if failed else None
            around = before is not None and before.path != attempt.path and _leaf(before) == _leaf(attempt)
            if attempt.succeeded or around:
                continue
            failed.append((attempt, within))
        return failed

    def _on_the_way(self, ended: RunEnded | None) -> str:
        counted = Counter((self._name(f.path), f.reason.code) for f in self.failures if f.reason is not None)
        if not counted:
            return "Nothing failed on the way." if ended is not None and ended.outcome == "success" else ""
        parts = [f"{name} {code}{_times(number)}" for (name, code), number in counted.most_common()]
        return f"What failed on the way: {', '.join(parts)}."

    def _in_hand(self) -> str:
        """What the fingers felt: when something came between them, and when it went."""
        shown, felt = [], ""
        for hand in self.hands:
            if hand.what != felt:
                shown.append(f"at {hand.t:.1f} s {hand.what or 'nothing any more'}")
                felt = hand.what
        return f"The fingers felt: {', '.join(shown)}." if shown else ""

    def _interventions(self) -> str:
        parts = [f"At {link.t:.1f} s, {link.device}: {_sentence(link.state)}" for link in self.links]
        parts += [self._blocked(overrun) for overrun in self.overruns if overrun.duration >= BLOCKED]
        parts += [f"At {act.t:.1f} s {act.who} asked for {act.action} {act.detail}".rstrip() + "." for act in self.acts]
        parts += [f"At {stop.t:.1f} s the cell went to its safe state: {_sentence(stop.reason)}" for stop in self.stops]
        return " ".join(parts)

    def _blocked(self, overrun: TickOverran) -> str:
        who = self._name(overrun.node) if overrun.node else "something"
        within = "".join(f", not even the limit of {self._name(path)}" for path in self._limits(overrun.node))
        held = f"At {overrun.t:.1f} s {who} kept the tick waiting for {seconds(overrun.duration)}"
        untold = f"nothing could interrupt it meanwhile{within}"
        if did_not_work(overrun):
            computed = f"it computed for {seconds(overrun.worked or 0.0)} of them"
            return f"{held}: {computed}, so it waited for something, or the computer had too much to do; {untold}."
        return f"{held}: {untold}. Such work belongs into `self.compute`."

    def _limits(self, path: str) -> Iterator[str]:
        """The timeouts around a node."""
        node = self.nodes.get(path)
        while node is not None and (node := self.nodes.get(str(node["parent"]))) is not None:
            if node.get("type") == "timeout":
                yield str(node["path"])

    def _errors(self) -> Iterator[str]:
        """Every exception where it was raised, with its traceback as it stands in the record."""
        for error in self.errors:
            of = f" of {self._name(error.node)}" if error.node else ""
            opening = f"At {error.t:.1f} s, during {error.during}{of}, {error.error} was raised"
            yield f"{opening}{f' in {error.place}' if error.place else ''}:\n{error.traceback.rstrip()}"

    def _time(self, ended: RunEnded | None) -> str:
        shares = sorted(self.summary.robot_time.items(), key=lambda item: -item[1])
        longest = [f"{name} ({seconds(value)})" for name, value in shares[:3] if value >= 0.01]
        text = f"Most of its time went to {_and(longest)}." if longest else ""
        computing = sum(self.summary.compute_time.values())
        if computing and ended is not None:
            text += f" It computed for {seconds(computing)}; the whole run took {seconds(ended.wall)} here."
        return text.strip()

    # ----------------------------------------------------------------------------------------------- words

    def _leaves(self) -> set[str]:
        return set(self.nodes) - {node["parent"] for node in self.nodes.values()}

    def _name(self, path: str) -> str:
        node = self.nodes.get(path)
        return str(node["name"]) if node is not None else path.rsplit("/", 1)[-1].partition(":")[0]

    def _place(self, path: str) -> str:
        node = self.nodes.get(path)
        if node is None:
            return path
        line = f" (line {node['line']} of the tree)" if node.get("line") else ""
        return f"{node['name']}{line}"


def _leaf(attempt: AttemptEnded) -> Reason | None:
    return list(attempt.reason.leaves())[-1] if attempt.reason is not None else None


def _kind(leaf: Reason) -> tuple[str, str, str]:
    """What a failure is, whatever its figures."""
    return leaf.node_path, leaf.code, re.sub(r"[\d.]+", "#", leaf.message)


def _last_chain(reason: Reason) -> Iterator[Reason]:
    """From the root to the leaf that failed last."""
    yield reason
    if reason.causes:
        yield from _last_chain(reason.causes[-1])


def _world(truth: Mapping[str, Any]) -> str:
    """The simulated world's score, as far as it is figures."""
    parts = [figure(name, value) for name, value in truth.items() if _is_figure(value)]
    return f"The simulated world says {', '.join(parts)}." if parts else ""


def _is_figure(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)


def _figures(data: Mapping[str, Any]) -> str:
    parts = [figure(name, v) for name, v in data.items() if _is_figure(v) and not isinstance(v, bool)]
    return f" ({', '.join(parts)})" if parts else ""


def _sentence(text: str) -> str:
    text = text.strip()
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _ordinal(number: int) -> str:
    return ORDINALS[number - 1] if 0 < number <= len(ORDINALS) else f"{number}th"


def _times(number: int) -> str:
    return "" if number == 1 else f" {number} times"


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


# ------------------------------------------------------------------------------------------ two of a kind


def explain_parting(before: Path, now: Path) -> list[str]:
    """Where the events of two runs part, for people."""
    count, difference = first_difference(before, now)
    if difference is None:
        return [f"both runs consist of the same {count} events"]
    return describe(difference, before.name, now.name)


def describe(difference: Difference, before: str, now: str) -> list[str]:
    """A difference as lines; `before` and `now` are what the two runs are called."""
    where = f", {difference.where}" if difference.where else ""
    width = max(len(before), len(now))
    return [
        f"they part at event {difference.number}, at {difference.t:.2f} s: {difference.what}{where}",
        f"  {before:<{width}}  {difference.before}",
        f"  {now:<{width}}  {difference.now}",
    ]
