"""The log of the door: one JSON line for each request, written before its answer is given."""

from __future__ import annotations

import hashlib
import itertools
import json
import threading
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError

LOG = "assistants.jsonl"  # in the folder of records
MOST_SHOWN = 300  # characters of a text that the log repeats; a longer one is named by its length and SHA-256


class CallLog:
    """Appends to the log; numbers go on where an earlier door has stopped."""

    def __init__(self, records: Path) -> None:
        """Raises UsageError: the log cannot be written, and without it the door stays closed."""
        self.path = records / LOG
        try:
            records.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab"):
                pass
            with self.path.open("rb") as stream:
                self._numbers = itertools.count(1 + sum(1 for _ in stream))
        except OSError as error:
            raise UsageError(f"{self.path}: no log can be written: {error.strerror}") from error
        self._lock = threading.Lock()

    def number(self) -> int:
        """Return the number of the next call."""
        return next(self._numbers)

    def write(
        self, call: int, method: str, asked: Mapping[str, Any], refused: str, seconds: float
    ) -> None:
        """Append one request: its number, its arguments, why it was refused if it was, its duration.

        Raises OSError: it cannot be written.
        """
        line = {
            "at": datetime.now(UTC).isoformat(timespec="milliseconds"), "call": call, "method": method,
            "asked": _short(asked), "refused": refused or None, "seconds": round(seconds, 3),
        }  # fmt: skip
        with self._lock, self.path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(line) + "\n")


def _short(value: Any) -> Any:
    if isinstance(value, str) and len(value) > MOST_SHOWN:
        digest = hashlib.sha256(value.encode(errors="replace")).hexdigest()[:16]
        return f"{value[:60]}… {len(value)} characters, SHA-256 {digest}"
    if isinstance(value, Mapping):
        return {_short(str(key)): _short(each) for key, each in itertools.islice(value.items(), 50)}
    if isinstance(value, list):
        return [_short(each) for each in value[:50]]
    return value
