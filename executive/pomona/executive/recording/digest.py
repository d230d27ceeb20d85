"""Summary of one recorded run: one entry of the index; and its nodes as a tree."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import EVENTS, events_file, hash_of, why_cut
from pomona.executive.recording.plain_file import LONGEST, is_plain, moment_of, parse_object
from pomona.executive.recording.scan import DamagedRecordError, Verdict, require_valid, scan

MOST_NODES = 20_000
"""Largest tree that is read [nodes]; one of twice the size that `pomona check` allows."""

DEEPEST_NODE = 1_000
"""Deepest tree that is read [levels]: py_trees ticks with Python's recursion, whose limit is 1 000 calls."""


def tree_of(value: Any) -> list[dict[str, Any]]:
    """Return the nodes of a tree in drawing order: one root, then each node below an earlier one.

    Raises TypeError, ValueError: these are no nodes, or they form no tree; the text names the node.
    """
    if not isinstance(value, list) or len(value) > MOST_NODES:
        what = f"{len(value)} nodes" if isinstance(value, list) else f"{str(value)[:40]!r}"
        raise ValueError(f"{what} stand where a tree of at most {MOST_NODES} nodes is expected")
    levels: dict[str, int] = {}
    for node in value:
        path = _path_of(node)
        parent = node.get("parent")
        if path in levels:
            raise ValueError(f"the tree has two nodes '{path[:100]}'")
        if levels and not (isinstance(parent, str) and parent in levels):
            raise ValueError(f"node '{path[:100]}' has no parent before it: the nodes form no tree")
        if not levels and parent is not None:
            raise ValueError(f"the first node '{path[:100]}' has a parent: the nodes form no tree")
        levels[path] = levels[parent] + 1 if parent is not None else 0
        if levels[path] > DEEPEST_NODE:
            raise ValueError(f"node '{path[:100]}' is more than {DEEPEST_NODE} levels deep")
        node.setdefault("name", path)
    return value


def _path_of(node: Any) -> str:
    """Return a node's path. Raises TypeError: this is no node, or one of its texts is none."""
    if not isinstance(node, dict) or not isinstance(node.get("path"), str):
        raise TypeError(f"{str(node)[:40]!r} stands where a node with a path is expected")
    path: str = node["path"]
    line = node.get("line", 0)
    if not all(isinstance(node.get(key, ""), str) for key in ("name", "type", "kind")):
        raise TypeError(f"name, type and kind of node '{path[:100]}' are no texts")
    if not isinstance(line, int) or isinstance(line, bool):
        raise TypeError(f"the line of node '{path[:100]}' is no number")
    return path


MOST_TEXT = 2000
MOST_CODE = 100
MOST_CODES = 200
MOST_ENTRIES = 1000
MOST_QUANTITIES = 50
"""Limits of an entry: characters of a text, of a code or name; number of codes, settings, measured quantities."""


@dataclass(frozen=True, slots=True)
class Digest:
    """One recorded run."""

    run: str  # its id, the name of its folder
    # ended, running, cut off, damaged (its checks fail, so nothing in it is trusted), or unreadable
    state: str = "ended"
    tree: str = ""
    tree_hash: str = ""  # hash of the tree's text
    cell: str = ""
    cell_kind: str = ""
    cell_hash: str = ""  # hash of the cell's texts
    seed: int | None = None
    wall_time: float = 0.0  # start, in seconds since 1970
    git: str = ""  # commit of Pomona, with a + for a changed checkout
    parameters: Mapping[str, Any] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)
    outcome: str | None = (
        None  # success, partial, failure, stopped or error, of a run that has ended
    )
    code: str | None = None  # failure code of a run that did not succeed
    message: str | None = None  # reason for the failure, or for the missing end
    codes: Mapping[str, int] = field(default_factory=dict)  # number of failures of leaves, by code
    attempts: int = 0  # number of attempts of all retries
    time: float | None = None  # duration on the run's clock [s]
    wall: float | None = None  # duration on the wall clock [s]
    ticks: int | None = None
    truth: Mapping[str, Any] | None = None  # a simulated world's score
    account: Mapping[str, Any] | None = None  # the robot's own result, as `Account.report`
    # largest sample of each measured quantity, by its name with its unit
    peaks: Mapping[str, float] = field(default_factory=dict)
    bytes: int = 0  # size of its MCAP file
    picture: bool = False  # True if the record has a picture
    checked: bool = True  # True if everything in it has a checksum
    lost: str = ""  # the parts that a repair could not save; empty without loss

    def as_json(self) -> dict[str, Any]:
        """Return the entry as JSON, for the page and for scripts."""
        return asdict(self)


def digest(record: Path) -> Digest:
    """Return a record's digest; only a missing file is an error.

    The state of a run without an end is `cut off`, also while it is in progress (`folder.is_being_written`).

    Raises OSError: the file does not exist.
    """
    path = events_file(record)
    about: dict[str, Any] = {"run": record.name, "state": "cut off", "bytes": path.lstat().st_size}
    about["picture"] = is_plain(record / "picture.png")
    try:
        verdict = require_valid(path)
        about |= _read(path, verdict)
        if about["state"] == "cut off":
            about["message"] = why_cut(record, about["bytes"])
    except DamagedRecordError as error:
        about |= {"state": "damaged", "message": str(error).removeprefix(f"{path}: ")}
    except Exception as error:  # one malformed record must not prevent the list of all
        about |= {
            "state": "unreadable",
            "message": _text(str(error).removeprefix(f"{path}: ") or type(error).__name__),
        }
    return Digest(**about)


def _read(path: Path, verdict: Verdict) -> dict[str, Any]:
    about: dict[str, Any] = {}
    codes: Counter[str] = Counter()
    attempts = 0
    peaks: dict[str, float] = {}
    topics = set()
    for topic, content, *_ in scan(path, verdict):
        topics.add(topic)
        match parse_object(content) if topic == EVENTS else {}:
            case {"event": "RunStarted", **event}:
                about |= _beginning(event)
            case {"event": "AttemptEnded"}:
                attempts += 1
            case {
                "event": "NodeChanged",
                "status": "FAILURE",
                "reason": {"causes": [], "code": code},
            }:
                if code != "SKIPPED":
                    code = _text(code, MOST_CODE)
                    codes[code if code in codes or len(codes) < MOST_CODES else "…"] += 1
            case {"event": "Published", "value": {"type": "SeriesView", "values": dict(values)}}:
                _raise_peaks(peaks, values)
            case {"event": "RunEnded", **event}:
                about |= _end(event)
    foreign = topics and EVENTS not in topics and verdict.state == "whole"
    if not about.get("tree") and (foreign or about.get("state") == "ended"):
        raise UsageError("not a record of a run: it has no event RunStarted")
    if verdict.lost:
        about["lost"] = _text(verdict.lost)
    return {
        **about,
        "codes": dict(codes),
        "attempts": attempts,
        "peaks": peaks,
        "checked": verdict.checked,
    }


def _raise_peaks(peaks: dict[str, float], values: Mapping[str, Any]) -> None:
    """Take the samples of a message. A malformed one adds nothing."""
    with contextlib.suppress(ValueError, TypeError):
        for name, series in values.items():
            measured = [sample for sample in series if sample is not None]
            if measured and (name in peaks or len(peaks) < MOST_QUANTITIES):
                peaks[_text(name, MOST_CODE)] = max(
                    float(max(measured)), peaks.get(name, -math.inf)
                )


def _beginning(event: Mapping[str, Any]) -> dict[str, Any]:
    about: dict[str, Any] = {
        name: _text(event.get(name, "")) for name in ("tree", "tree_hash", "cell", "cell_kind")
    }
    seed = event.get("seed")
    tree_of(event.get("nodes", []))
    return {
        **about,
        "seed": seed if isinstance(seed, int) and abs(seed) < 2**63 else None,
        "wall_time": moment_of(event.get("wall_time")),
        "parameters": _mapping(event.get("parameters")),
        "settings": {key: _text(value) for key, value in _mapping(event.get("settings")).items()},
        "cell_hash": hash_of(*(_text(text, None) for text in _cell_texts(event))),
        "git": _text(_mapping(event.get("versions")).get("git", "")),
    }


def _cell_texts(event: Mapping[str, Any]) -> tuple[Any, ...]:
    return event.get("cell_text", ""), *_mapping(event.get("cell_files", {})).values()


def _end(event: Mapping[str, Any]) -> dict[str, Any]:
    reason = event["reason"]
    ticks = event["ticks"]
    return {
        "state": "ended",
        "outcome": _text(event["outcome"]),
        "time": _number(event["time"]),
        "wall": _number(event["wall"]),
        "ticks": ticks if isinstance(ticks, int) and abs(ticks) < 2**63 else None,
        **{it: event.get(it) and _mapping(event[it]) for it in ("truth", "account")},
        "code": None if reason is None else _text(reason["code"], MOST_CODE),
        "message": None if reason is None else _text(_last_cause(reason)["message"]),
    }


def _last_cause(reason: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the innermost last cause of a reason."""
    while reason["causes"]:
        reason = _mapping(reason["causes"][-1])
    return reason


def _text(value: Any, most: int | None = MOST_TEXT) -> str:
    if not isinstance(value, str):
        raise UsageError(f"{str(value)[:40]!r} stands where a text is expected")
    return value if most is None or len(value) <= most else f"{value[: most - 1]}…"


def _number(value: Any) -> float | None:
    """Return a finite number; null, written for a value that was not finite, becomes None."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LONGEST:
        raise UsageError(
            f"{str(value)[:40]!r} stands where a number is expected, {LONGEST:g} at most"
        )
    return float(value)


def _mapping(value: Any) -> Mapping[str, Any]:
    if not isinstance(value, dict) or len(value) > MOST_ENTRIES:
        raise UsageError(f"{str(value)[:40]!r} stands where names with values are expected")
    return value


def trusted(record: Path) -> Digest:
    """Return a run's digest, for a command that shows or repeats it.

    Raises UsageError: its record is damaged, is no record, or cannot be read.
    """
    try:
        found = digest(record)
    except OSError as error:
        raise UsageError(f"{record}: {error.strerror}") from error
    if found.state in ("damaged", "unreadable"):
        raise UsageError(f"{record}: {found.message}")
    return found
