"""Explanation of a run in a few plain sentences: the events and their causes."""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime
from typing import Any

from pomona.executive.reasons import Reason, failure_codes, latest_leaf
from pomona.executive.running.events import (
    AttemptEnded,
    ErrorRaised,
    Event,
    HandChanged,
    LinkChanged,
    Logged,
    NodeChanged,
    OperatorActed,
    RunEnded,
    RunStarted,
    SafeStopped,
    TickOverran,
)
from pomona.executive.speed import words_of
from pomona.executive.terminal.live import BLOCKED, did_not_work
from pomona.executive.terminal.summary import Summary
from pomona.executive.terminal.words import (
    at_place,
    end_words,
    felt_words,
    figure,
    headline,
    is_number,
    seconds,
)

ORDINALS = (
    "first",
    "second",
    "third",
    "fourth",
    "fifth",
    "sixth",
    "seventh",
    "eighth",
    "ninth",
    "tenth",
)
STOPPED = (
    "SAFE_STOP",
    "INTERRUPTED",
    "STOPPED",
)  # codes of a run that was stopped from outside its nodes
MOST_LINES = 20  # of the lines that nodes logged, the last ones are listed
LONGEST_ACCOUNT = 700  # letters: a crate may leave twenty fruit, each with its reason
MOST_ATTEMPTS = 4  # maximum number of attempts to list; of more, the first and the last are listed


def explain(
    events: Iterable[Event],
    going_on: bool = False,
    why_cut: str = "the process was killed or lost its power",
    *,
    whole: bool = True,
) -> list[str]:
    """Return paragraphs for an operator: the events, their causes, and a remedy.

    Args:
        events: of the run, from its start.
        going_on: the record has no end because the run is still going on.
        why_cut: otherwise, why it has none.
        whole: add everything that was recorded in the order of time, values, times, the score and tracebacks.
    """
    story = _Story()
    for event in events:
        story.on_event(event)
    told = [*story.briefly(going_on, why_cut), *(story.rest() if whole else ())]
    return [paragraph for paragraph in told if paragraph]


class _Story:
    def __init__(self) -> None:
        self.summary = Summary()
        self.nodes: dict[str, Mapping[str, Any]] = {}
        self.leaves: set[str] = set()
        self.failures: list[NodeChanged] = []
        self.moments: list[tuple[float, str]] = []
        self.stops: list[SafeStopped] = []
        self.errors: list[ErrorRaised] = []
        self.overruns: list[TickOverran] = []
        self.running: dict[str, float] = {}
        self.interrupted: list[str] = []
        self.logged = deque[Logged](maxlen=MOST_LINES)
        self.lines = 0
        self.hand = ""
        self.hand_told = ""
        self.hand_t = 0.0
        self.t = 0.0

    def on_event(self, event: Event) -> None:
        self.summary.on_event(event)
        self.t = max(self.t, event.t)
        if isinstance(event, RunStarted):
            self.nodes = {node["path"]: node for node in event.nodes}
            self.leaves = set(self.nodes) - {node["parent"] for node in event.nodes}
        elif isinstance(event, NodeChanged):
            self._follow(event)
        elif isinstance(event, OperatorActed):
            detail = f": {event.detail}" if event.detail else ""
            self._note(event.t, f"{event.who}: {event.action.replace('_', ' ')}{detail}")
        elif isinstance(event, SafeStopped):
            if not self.stops:
                self.interrupted = self._running_leaves()
            self.stops.append(event)
            self._note(event.t, f"the cell went to its safe state: {event.reason}")
        elif isinstance(event, ErrorRaised):
            self.errors.append(event)
            self._note(event.t, _raised(event, self._name(event.node) if event.node else ""))
        elif isinstance(event, Logged):
            self.logged.append(event)
            self.lines += 1
        elif isinstance(event, HandChanged):
            self.hand = event.what
            self.hand_t = event.t
        elif isinstance(event, TickOverran):
            self.overruns.append(event)
        elif isinstance(event, LinkChanged) and event.state != "ok":
            self._note(event.t, f"{event.device}: {event.state}")
        elif isinstance(event, RunEnded):
            self._note_hand()

    def _follow(self, event: NodeChanged) -> None:
        if event.status == "RUNNING":
            self.running.setdefault(event.path, event.t)
        elif self.running.pop(event.path, None) is not None and event.path in self.leaves:
            self._note_hand()
        if event.reason is not None and not event.reason.causes and event.reason.code != "SKIPPED":
            self.failures.append(event)

    def _note(self, t: float, text: str) -> None:
        self.moments.append((t, f"At {t:.1f} s {_sentence(text)}"))

    def _note_hand(self) -> None:
        """Note a change of contact at the fingers after a skill's end; a gripping skill reports its own changes."""
        if self.hand != self.hand_told:
            self._note(self.hand_t, f"finger contact changed: {self.hand or 'no contact'}")
            self.hand_told = self.hand

    # ------------------------------------------------------------------------------------------ paragraphs

    def briefly(self, going_on: bool, why_cut: str) -> Iterator[str]:
        """Yield the events, their causes, and a remedy."""
        started = self.summary.started
        ended = self.summary.ended
        if started is None:
            yield f"The record holds no beginning of a run: {why_cut}."
            return
        yield f"{self._opening(started)} {self._outcome(ended, going_on, why_cut)}"
        reason = ended.reason if ended is not None else None
        yield self._why(reason) if reason is not None else self._on_the_way()
        accounts = {
            table.caption for table in self.summary.tables.values()
        }  # of many things, such as fruit
        yield " ".join(
            _sentence(_cut(note)) for note in self.summary.notes.values() if note in accounts
        )
        felt = felt_words(ended.account or {}) if ended is not None else ""
        yield f"The robot measured: {felt}." if felt else ""
        code = (
            "EXCEPTION" if self.errors else latest_leaf(reason).code if reason is not None else ""
        )
        known = failure_codes().get(code)
        yield f"Remedy: {_sentence(known.remedy)}" if known is not None else ""

    def rest(self) -> Iterator[str]:
        """Yield all that was recorded beyond that."""
        ended = self.summary.ended
        if ended is not None and ended.reason is not None:
            yield self._figures(ended.reason)
            yield self._on_the_way()
        moments = sorted(
            [*self.moments, *self._attempts(), *self._late(), *self._logged()],
            key=lambda moment: moment[0],
        )
        yield " ".join(text for _, text in moments)
        yield " ".join(
            f"{name.capitalize()}: {_sentence(re.sub(' {2,}', ', ', note))}"
            for name, note in self.summary.notes.items()
        )
        yield self._time(ended)
        if ended is not None and (figures := headline(ended.truth or {})):
            yield f"The simulated world reports {', '.join(figures)}."
        for error in self.errors:
            opening = f"At {error.t:.1f} s, {_raised(error, self._name(error.node) if error.node else '')}"
            yield f"{opening}\n{error.traceback.rstrip()}"

    def _opening(self, started: RunStarted) -> str:
        settings = ", ".join(f"{key} = {value}" for key, value in started.settings.items())
        with_what = f"seed {started.seed}" + (f" and {settings}" if settings else "")
        if started.speed < 1.0:
            with_what += f", at {words_of(started.speed)} of the speed"
        kind = {"real": "real", "mock": "mocked"}.get(started.cell_kind, started.cell_kind)
        day = f"{datetime.fromtimestamp(started.wall_time):%d %B %Y at %H:%M}".lstrip("0")
        where = (
            "without a cell,"
            if started.cell in ("none", "dry")
            else f"on the {kind} cell {started.cell}"
        )
        return f"{started.tree} ran {where} with {with_what}, on {day}."

    def _outcome(self, ended: RunEnded | None, going_on: bool, why_cut: str) -> str:
        if ended is None:
            at = " and ".join(self._running_leaves())
            where = f", while {at} was running" if at else ""
            if going_on:
                return f"It is still going on: {seconds(self.t)} so far{where}."
            return f"The record ends after {seconds(self.t)}{where}: {why_cut}."
        if ended.outcome == "success":
            most = self.summary.last_attempt()
            which = "" if most is None else f", on the {_ordinal(most.number)} attempt of {most.of}"
            return f"It succeeded after {seconds(ended.time)}{which if most and most.number > 1 else ''}."
        return f"It {end_words(ended)} after {seconds(ended.time)}."

    def _why(self, reason: Reason) -> str:
        leaf = latest_leaf(reason)
        t = next((f.t for f in reversed(self.failures) if f.path == leaf.node_path), None)
        if t is None:
            t = self.stops[0].t if self.stops else self.t
        where = self._place(leaf.node_path)
        if leaf.code in STOPPED and where:  # the node did not fail: it was interrupted
            doing = f", while {where} was running"
            failed = leaf.code
        else:
            doing = (
                f", while {' and '.join(self.interrupted)} was running"
                if self.interrupted and not where
                else ""
            )
            failed = f"{where} failed with {leaf.code}" if where else leaf.code
        return (
            f"The reason, at {t:.1f} s{doing}: {failed}: {_sentence(leaf.message + at_place(leaf))}"
        )

    def _figures(self, reason: Reason) -> str:
        leaf = latest_leaf(reason)
        chain = list(dict.fromkeys(self._name(step.node_path) for step in _last_chain(reason)))
        with_it = (
            f"With it failed {', then '.join(reversed(chain[:-1]))}." if len(chain) > 2 else ""
        )
        return f"{_figures(leaf.data)} {with_it}".strip()

    def _attempts(self) -> Iterator[tuple[float, str]]:
        failed = self._failed_attempts()
        shown: list[tuple[AttemptEnded, str] | None] = list(failed)
        if len(failed) > MOST_ATTEMPTS:
            shown = [*failed[: MOST_ATTEMPTS - 1], None, failed[-1]]
        ended = self.summary.ended
        known = {_kind(leaf) for leaf in (ended.reason.leaves() if ended and ended.reason else ())}
        t = 0.0
        for entry in shown:
            if entry is None:
                yield t, f"So it went on, {len(failed) - MOST_ATTEMPTS} attempts more."
                continue
            attempt, within = entry
            t = attempt.t
            leaf = _leaf(attempt)
            name = self._name(attempt.path.partition(":")[0]) + (f", in {within}" if within else "")
            which = f"At {attempt.t:.1f} s attempt {attempt.number} of {attempt.of} ({name}) ended"
            if leaf is None:
                yield t, f"{which}."
            elif _kind(leaf) in known:
                yield t, f"{which} with {leaf.code}, too."
            else:
                known.add(_kind(leaf))
                yield (
                    t,
                    f"{which}: {self._name(leaf.node_path)} failed with {leaf.code}: {_sentence(leaf.message)}",
                )

    def _failed_attempts(self) -> list[tuple[AttemptEnded, str]]:
        """Return the failed attempts, each with its outer one, without outer attempts that failed only by them."""
        failed: list[tuple[AttemptEnded, str]] = []
        for attempt, within in zip(self.summary.attempts, self.summary.within(), strict=True):
            before = failed[-1][0] if failed else None
            around = (
                before is not None
                and before.path != attempt.path
                and _leaf(before) == _leaf(attempt)
            )
            if attempt.succeeded or around:
                continue
            failed.append((attempt, within))
        return failed

    def _on_the_way(self) -> str:
        ended = self.summary.ended
        reasons = ((f.path, f.reason.code) for f in self.failures if f.reason is not None)
        counted = Counter(
            (self._name(path), code) for path, code in reasons if code != "CONDITION_FALSE"
        )
        if not counted:
            return (
                "Nothing failed on the way."
                if ended is not None and ended.outcome == "success"
                else ""
            )
        parts = ", ".join(
            f"{name} {code}{_times(number)}" for (name, code), number in counted.most_common()
        )
        return f"On the way failed: {parts}."

    def _late(self) -> Iterator[tuple[float, str]]:
        """Yield the tick that waited longest, and how many more did."""
        late = [overrun for overrun in self.overruns if overrun.duration >= BLOCKED]
        if late:
            longest = max(late, key=lambda overrun: overrun.duration)
            others = (
                f" Ticks that waited {seconds(BLOCKED)} or longer: {len(late)}."
                if len(late) > 1
                else ""
            )
            yield longest.t, self._blocked(longest) + others

    def _logged(self) -> Iterator[tuple[float, str]]:
        if self.lines > len(self.logged):
            yield (
                self.logged[0].t,
                f"Of {self.lines} logged lines the last {len(self.logged)} are listed.",
            )
        for line in self.logged:
            yield (
                line.t,
                f"At {line.t:.1f} s {self._name(line.node)} logged {line.level}: {_sentence(line.text)}",
            )

    def _blocked(self, overrun: TickOverran) -> str:
        who = self._name(overrun.node) if overrun.node else "something"
        within = "".join(
            f", not even the limit of {self._name(path)}" for path in self._limits(overrun.node)
        )
        held = f"At {overrun.t:.1f} s {who} kept the tick waiting for {seconds(overrun.duration)}"
        untold = f"nothing could interrupt it meanwhile{within}"
        if did_not_work(overrun):
            computed = f"it computed for {seconds(overrun.worked or 0.0)} of them"
            return f"{held}: {computed}, so it waited for something, or the computer had too much to do; {untold}."
        return f"{held}: {untold}. Such work belongs into `self.compute`."

    def _limits(self, path: str) -> Iterator[str]:
        """Yield the timeouts around a node."""
        node = self.nodes.get(path)
        while node is not None and (node := self.nodes.get(str(node["parent"]))) is not None:
            if node.get("type") == "timeout":
                yield str(node["path"])

    def _time(self, ended: RunEnded | None) -> str:
        shares = sorted(self.summary.robot_time.items(), key=lambda item: -item[1])
        longest = [f"{name} ({seconds(value)})" for name, value in shares[:3] if value >= 0.01]
        text = f"Most of its time went to {_and(longest)}." if longest else ""
        computing = sum(self.summary.compute_time.values())
        if ended is not None:
            text += f" It took {self.summary.times()}"
            text += f"; computing took {seconds(computing)} of that." if computing else "."
        return text.strip()

    # ----------------------------------------------------------------------------------------------- words

    def _running_leaves(self) -> list[str]:
        return sorted({self._name(path) for path in self.running if path in self.leaves})

    def _name(self, path: str) -> str:
        node = self.nodes.get(path)
        return str(node["name"]) if node is not None else path.rsplit("/", 1)[-1].partition(":")[0]

    def _place(self, path: str) -> str:
        node = self.nodes.get(path)
        if node is None:
            return path
        line = f"line {node['line']} of the tree" if node.get("line") else ""
        places = ", ".join(filter(None, (line, _source(node))))
        return f"{node['name']} ({places})" if places else str(node["name"])


def _source(node: Mapping[str, Any]) -> str:
    """Return the file and line of a node's skill, where it is installed; empty for another node and for a mock."""
    from pomona.executive.nodes.leaves import SKILL  # skills are loaded for a failure alone
    from pomona.executive.registry import source_of

    return (
        source_of(str(node["type"]))
        if node.get("kind") == SKILL.key and not node.get("mocked")
        else ""
    )


def _leaf(attempt: AttemptEnded) -> Reason | None:
    return list(attempt.reason.leaves())[-1] if attempt.reason is not None else None


def _kind(leaf: Reason) -> tuple[str, str, str]:
    """Return the kind of a failure, without its figures."""
    return leaf.node_path, leaf.code, re.sub(r"[\d.]+", "#", leaf.message)


def _last_chain(reason: Reason) -> Iterator[Reason]:
    """From the root to the leaf that failed last."""
    yield reason
    if reason.causes:
        yield from _last_chain(reason.causes[-1])


def _raised(error: ErrorRaised, node: str) -> str:
    """Where an exception was raised, and which."""
    of = f" of {node}" if node else ""
    place = f" in {error.place}" if error.place else ""
    return f"during {error.during}{of}, {error.error} was raised{place}: {error.message}"


def _figures(data: Mapping[str, Any]) -> str:
    parts = [
        figure(name, v) for name, v in data.items() if is_number(v) and not isinstance(v, bool)
    ]
    return f"Figures: {', '.join(parts)}." if parts else ""


def _cut(account: str) -> str:
    """Return a long account up to the end of a part of it."""
    if len(account) <= LONGEST_ACCOUNT:
        return account
    shown = account[:LONGEST_ACCOUNT].rpartition("; ")[0] or account[:LONGEST_ACCOUNT]
    return f"{shown}; … the rest with --all"


def _sentence(text: str) -> str:
    text = text.strip()
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _ordinal(number: int) -> str:
    return ORDINALS[number - 1] if 0 < number <= len(ORDINALS) else f"{number}th"


def _times(number: int) -> str:
    return "" if number == 1 else f" {number} times"


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
