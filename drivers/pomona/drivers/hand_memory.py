"""State of the hand that outlives a connection: contact, width, and the fingers' bias.

Fingers that measure from a bias must not take it under load: the load would read as zero. So the last bias is kept with
the last state of the hand, and a driver of such fingers asks `HandMemory` before it takes a new one. A killed process
cannot write, so each change is written when it happens.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from pomona.executive.values.plain_text import read_plain_text
from pomona.executive.values.processes import warn

logger = logging.getLogger(__name__)

FORMAT = "pomona hand 1"


@dataclass(frozen=True, slots=True)
class HandRecord:
    """Last known state of a hand."""

    held: str = ""  # sentence about the held object; empty for an empty hand
    # opening between the pads at that time [m]; None for any opening (the hand of a new simulated world)
    width: float | None = None
    # voltages without contact [V] by the fingerprint of a finger's calibration
    bias: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


class HandMemory:
    """Keeps the newest `HandRecord` of one hand, in a file or in this process alone. Callable from any thread."""

    def __init__(self, path: Path | None, record: HandRecord | None = None) -> None:
        """
        Args:
            path: of the file; None keeps the record in this process.
            record: the first one; by default the file's.
        """
        self.path = path
        self._lock = threading.Lock()
        self._record = record if record is not None or path is None else _read(path)
        self._warned = False

    @property
    def record(self) -> HandRecord | None:
        """The newest record; None when nothing is known."""
        return self._record

    def keep_bias(self, bias: Mapping[str, tuple[float, ...]], width: float | None) -> None:
        """Keep a bias that was just taken, with an empty hand at this width [m]."""
        self._keep(lambda _last: HandRecord("", width, bias))

    def keep_hand(self, held: str, width: float) -> None:
        """Keep the state of the hand at this width [m]."""
        self._keep(lambda last: replace(last, held=held, width=width))

    def _keep(self, change: Callable[[HandRecord], HandRecord]) -> None:
        """A file that cannot be written is removed and reported once: the next connection then knows nothing."""
        with self._lock:
            self._record = change(self._record or HandRecord())
            try:
                if self.path is not None:
                    _write(self.path, self._record)
            except OSError as error:
                if not self._warned:
                    warn(logger, "%s: the state of the hand cannot be kept: %s", self.path, error)
                self._warned = True


def memory_of(wires: Iterable[str]) -> HandMemory:
    """Return the memory of the hand on these wires: a file of the user's state folder."""
    base = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    key = hashlib.sha256("\n".join(sorted(wires)).encode()).hexdigest()[:16]
    return HandMemory(Path(base, "pomona", f"hand-{key}.json"))


def _read(path: Path) -> HandRecord | None:
    """A damaged file is no record: nothing is known then."""
    try:
        content = json.loads(read_plain_text(path))
        if content["format"] != FORMAT:
            return None
        width = float(content["width"])
        bias = {str(key): tuple(float(volts) for volts in taxels) for key, taxels in content["bias"].items()}
        finite = math.isfinite(width) and all(math.isfinite(volts) for taxels in bias.values() for volts in taxels)
        return HandRecord(str(content["held"]), width, bias) if finite else None
    except (OSError, ValueError, RecursionError, TypeError, KeyError, AttributeError):
        return None


def _write(path: Path, record: HandRecord) -> None:
    """Replace the file as a whole; when that fails, remove it: an outdated record could call a full hand empty."""
    new = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new.write_text(json.dumps({"format": FORMAT, **asdict(record)}), encoding="utf-8")
        new.replace(path)
    except OSError:
        for outdated in (path, new):
            outdated.unlink(missing_ok=True)
        raise
