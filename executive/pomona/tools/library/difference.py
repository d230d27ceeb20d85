"""First difference between the events of two runs, ignoring fields that depend on the machine or the moment."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.executive.recording.folder import EVENTS, events_file
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.recording.scan import scan

OF_THE_MOMENT: Mapping[str, tuple[str, ...]] = {
    "RunStarted": (
        "run",
        "wall_time",
        "versions",
        "tree_path",
        "cell_path",
        "tree_files",
        "preparation",
    ),
    "Computed": ("wall",),
    "Logged": ("text",),
    "RunEnded": ("wall",),
    "ErrorRaised": ("traceback",),
}
"""Fields that differ between two equal runs, by event."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first event that differs between two runs."""

    number: int  # number of the event, from 1
    t: float  # time on the run's clock [s]
    what: str  # name and subject of the event
    where: str  # path of the first field that differs; empty for events of different kinds
    before: str  # the field in the first run, as text
    now: str  # the field in the second run, as text


def comparable(record: Path) -> Iterator[dict[str, Any]]:
    """Yield the events and images of a record without the fields in `OF_THE_MOMENT`."""
    for topic, content, *_ in scan(events_file(record)):
        if topic == EVENTS:
            event = parse_object(content)
            event.setdefault("event", "")
            if event["event"] == "TickOverran":
                continue  # its duration depends on the machine
            for name in OF_THE_MOMENT.get(str(event["event"]), ()):
                event.pop(name, None)
            if event["event"] == "RunStarted":
                event.setdefault("speed", 1.0)  # absent in records of earlier versions
            yield event
        elif topic.startswith(("/images/", "/depth/")):
            yield {
                "event": "Image",
                "t": 0.0,
                "topic": topic,
                "data": parse_object(content).get("data"),
            }


def first_difference(before: Path, now: Path) -> tuple[int, Difference | None]:
    """Return the number of equal events from the start, and the first difference, if any."""
    return next(differences(comparable(before), comparable(now)))


def differences(
    before: Iterable[dict[str, Any]], now: Iterable[dict[str, Any]]
) -> Iterator[tuple[int, Difference | None]]:
    """Yield the differences of two series of events, each with the number of equal events before it; at last None."""
    count = 0
    for number, (one, other) in enumerate(itertools.zip_longest(before, now), start=1):
        if one != other:
            yield count, _difference(number, one, other)
        else:
            count += one["event"] != "Image" if one is not None else 0
    yield count, None


def _difference(
    number: int, one: dict[str, Any] | None, other: dict[str, Any] | None
) -> Difference:
    written = (one or other or {}).get("t", 0.0)
    t = float(written) if isinstance(written, (int, float)) else 0.0
    if one is None or other is None or _name(one) != _name(other):
        names = [
            "no event: it ends here" if event is None else _name(event) for event in (one, other)
        ]
        return Difference(number, t, "another event", "", *names)
    whole: tuple[str, Any, Any] = (
        "",
        one,
        other,
    )  # they differ in a field that is null in one and missing in the other
    where, before, now = next(_parts(one, other, ""), whole)
    return Difference(number, t, _name(one), where, _short(before), _short(now))


def _parts(one: Any, other: Any, where: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield the innermost parts in which two JSON values differ: path, first and second value."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in dict.fromkeys((*one, *other)):
            if one.get(key) != other.get(key):
                yield from _parts(one.get(key), other.get(key), f"{where}.{key}" if where else key)
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for index, (a, b) in enumerate(zip(one, other, strict=True)):
            if a != b:
                yield from _parts(a, b, f"{where}[{index}]")
    else:
        yield where, one, other


def _name(event: Mapping[str, Any]) -> str:
    about = next(
        (
            str(event[key])
            for key in ("path", "key", "topic", "node", "device", "state")
            if event.get(key)
        ),
        "",
    )
    return f"{event['event']} {about}".strip()


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 100 else f"{text[:80]} … ({len(text)} characters)"


def explain_parting(before: Path, now: Path) -> list[str]:
    """Describe the first difference between the events of two runs."""
    count, difference = first_difference(before, now)
    if difference is None:
        return [f"both runs consist of the same {count} events"]
    return describe(difference, before.name, now.name)


def describe(difference: Difference, before: str, now: str) -> list[str]:
    """Describe a difference as lines; `before` and `now` are the names of the two runs."""
    where = f", {difference.where}" if difference.where else ""
    width = max(len(before), len(now))
    return [
        f"they part at event {difference.number}, at {difference.t:.2f} s: {difference.what}{where}",
        f"  {before:<{width}}  {difference.before}",
        f"  {now:<{width}}  {difference.now}",
    ]
