"""What is worth knowing of a run without reading all of it: one entry of the index."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from executive.errors import UsageError
from executive.recording.read import events_file
from executive.recording.recorder import EVENTS, hash_of
from executive.recording.scan import scan

_HEADS = tuple(f'{{"event":"{name}"'.encode() for name in ("RunStarted", "AttemptEnded", "RunEnded"))
_NODE, _FAILURE = b'{"event":"NodeChanged"', b'"status":"FAILURE"'


@dataclass(frozen=True, slots=True)
class Digest:
    """One recorded run.

    Attributes:
        run: its id, the name of its folder.
        state: ended, running, cut off (the process was killed), or unreadable (`message` says why).
        outcome: success, failure, stopped or error, of a run that has ended.
        code, message: why it did not succeed.
        codes: how often leaves of the tree failed, by code.
        attempts: how many attempts of retries there were.
        time, wall: seconds on the run's clock and really.
        wall_time: when it began, as seconds since 1970.
        tree_hash, cell_hash: of their texts.
        git: commit of the Pomona that ran, with a + for a changed one.
        bytes: size of its MCAP file.
        picture: whether there is one.
    """

    run: str
    state: str = "ended"
    tree: str = ""
    tree_hash: str = ""
    cell: str = ""
    cell_kind: str = ""
    cell_hash: str = ""
    seed: int | None = None
    wall_time: float = 0.0
    git: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)
    outcome: str | None = None
    code: str | None = None
    message: str | None = None
    codes: Mapping[str, int] = field(default_factory=dict)
    attempts: int = 0
    time: float | None = None
    wall: float | None = None
    ticks: int | None = None
    truth: Mapping[str, Any] | None = None
    bytes: int = 0
    picture: bool = False

    def as_json(self) -> dict[str, Any]:
        """For the page and for scripts."""
        return asdict(self)


def digest(record: Path) -> Digest:
    """Read a record's digest. A run without an end is `cut off`: whether it is still going on is asked elsewhere."""
    path = events_file(record)
    about: dict[str, Any] = {"run": record.name, "state": "cut off", "bytes": path.stat().st_size}
    about["picture"] = (record / "picture.png").is_file()
    codes: Counter[str] = Counter()
    attempts = 0
    try:
        for event in _events_of_interest(path):
            match event["event"]:
                case "RunStarted":
                    about |= _beginning(event)
                case "AttemptEnded":
                    attempts += 1
                case "NodeChanged":
                    reason = event.get("reason") or {}
                    if reason and not reason["causes"] and reason["code"] != "SKIPPED":
                        codes[reason["code"]] += 1
                case "RunEnded":
                    about |= _end(event)
    except (UsageError, ValueError, KeyError, TypeError, AttributeError) as error:
        about |= {"state": "unreadable", "message": str(error)}
    if not about.get("tree") and about["state"] == "ended":
        about |= {"state": "unreadable", "message": "it does not say how the run began"}
    return Digest(**about, codes=dict(codes), attempts=attempts)


def _events_of_interest(path: Path) -> Iterator[dict[str, Any]]:
    for topic, content in scan(path):
        if topic == EVENTS and (content.startswith(_HEADS) or (content.startswith(_NODE) and _FAILURE in content)):
            yield json.loads(content, parse_constant=lambda _name: None)


def _beginning(event: Mapping[str, Any]) -> dict[str, Any]:
    same = ("tree", "tree_hash", "cell", "cell_kind", "seed", "wall_time", "parameters", "settings")
    found = {name: event[name] for name in same if name in event}
    return {**found, "cell_hash": hash_of(event.get("cell_text", "")), "git": event.get("versions", {}).get("git", "")}


def _end(event: Mapping[str, Any]) -> dict[str, Any]:
    reason = event["reason"] or {}
    same = {name: event[name] for name in ("outcome", "time", "wall", "ticks", "truth")}
    return {**same, "state": "ended", "code": reason.get("code"), "message": reason.get("message")}
