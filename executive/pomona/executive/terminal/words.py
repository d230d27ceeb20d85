"""The few signs and formats that every text view shares."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from pomona.executive.reasons import Reason
from pomona.executive.running.events import RunEnded

ICONS = {"SUCCESS": "✓", "FAILURE": "✗", "RUNNING": "▶", "INVALID": "·"}
STYLES = {"SUCCESS": "green", "FAILURE": "red", "RUNNING": "bold cyan", "INVALID": "dim"}

MARKS = {
    "success": ("✓", "green"),
    "failure": ("✗", "red"),
    "partial": ("◐", "yellow"),
    "stopped": ("■", "yellow"),
    "error": ("■", "red"),
    "running": ("▶", "bold cyan"),
    "cut off": ("…", "yellow"),
    "empty": ("…", "yellow"),
    "damaged": ("!", "bold red"),
    "unreadable": ("?", "red"),
}
"""By outcome, or by state for a run without one."""

UNCHECKED = "This record was written without checksums: later changes cannot be detected."


def end_words(ended: RunEnded) -> str:
    """`failed`, `done in part` …, of a run that did not succeed."""
    code = ended.reason and ended.reason.code
    word = "was not verified" if code == "UNVERIFIED" else "was done in part"
    words = {"partial": word, "failure": "failed", "stopped": "was stopped"}
    return words.get(ended.outcome, "ended in the safe state")


def felt_words(account: Mapping[str, Any]) -> str:
    """Return the evidence of a run's success, and the largest press on a fruit; empty without either."""
    return "; ".join(filter(None, (account.get("evidence"), account.get("pressed"))))


def seconds(value: float) -> str:
    """0.0123 -> '12 ms', 4.26 -> '4.3 s', 91 -> '1 min 31 s'."""
    if value < 0.0995:
        return f"{value * 1e3:.0f} ms"
    if value < 60.0:
        return f"{value:.1f} s"
    minutes, rest = divmod(round(value), 60)
    return f"{minutes} min {rest} s"


def say(reason: Reason | None) -> str:
    """One line for a reason: the leaf that caused it, with its node."""
    if reason is None:
        return ""
    last = list(reason.leaves())[-1]
    node = last.node_path.rsplit("/", 1)[-1]
    return f"{node} {last.code}: {last.message}{at_place(last)}".strip()


def at_place(reason: Reason) -> str:
    """` (skills/pomona/skills/lift.py:42, in run)` for a reason that is an exception; else nothing."""
    place = reason.data.get("place")
    return f" ({place})" if isinstance(place, str) and place else ""


UNITS = {
    "mm": "mm",
    "m": "m",
    "n": "N",
    "nm": "N·m",
    "kg": "kg",
    "deg": "°",
    "rad": "rad",
    "s": "s",
}
RESOLUTION = {
    "mm": 1e-3,
    "m": 1e-5,
    "n": 1e-3,
    "nm": 1e-5,
    "kg": 1e-4,
    "deg": 1e-2,
    "rad": 1e-4,
    "s": 1e-3,
}
"""Resolution below which a value counts as 0, in the unit itself: no supported device or simulation measures finer."""


def term(name: str) -> str:
    """`size_error` -> size error; `least_force`, a key of records, -> minimum grip force."""
    return {"least_force": "minimum grip force"}.get(name, name.replace("_", " "))


def figure(name: str, value: Any) -> str:
    """slip_mm, 0.1392 -> 'slip 0.1392 mm'; height_gained_m, -7.4e-08 -> 'height gained 0 m'; lifted -> 'lifted: yes'.

    A value below the resolution of every supported device and simulation is shown as 0.
    """
    from pomona.executive.encode import plain  # with numpy, which a list of runs does not need

    value = plain(value)
    if isinstance(value, bool):
        return f"{name.replace('_', ' ')}: {'yes' if value else 'no'}"
    words, unit = _with_unit(name)
    said = f"{term(words)} {_number(value, RESOLUTION.get(unit, 0.0))}"
    return f"{said} {UNITS[unit]}" if unit else said


def row_of(name: str, value: Any) -> tuple[str, str | None]:
    """slip_mm, 0.1392 -> 'slip [mm]', '0.1392'; no text for a value that is no verdict, number or word."""
    words, unit = _with_unit(name)
    title = f"{term(words)} [{UNITS[unit]}]" if unit else term(words)
    if isinstance(value, bool):
        return title, "yes" if value else "no"
    is_shown = isinstance(value, str) or is_number(value)
    return title, _number(value, RESOLUTION.get(unit, 0.0)) if is_shown else None


def _with_unit(name: str) -> tuple[str, str]:
    found = re.fullmatch(r"(.+)_([a-z]+)", name)
    return (found[1], found[2]) if found and found[2] in UNITS else (name, "")


MOST_FIGURES = 5  # figures of a world's score that a summary shows


def headline(truth: Mapping[str, Any]) -> list[str]:
    """Return the first figures of a world's score that are not 0; verdicts, numbers and the hardest press only.

    The world orders them by importance.
    """
    kept = {
        name: value
        for name, value in truth.items()
        if isinstance(value, bool) or is_number(value) or name == "pressed"
    }
    return [
        said
        for name, value in kept.items()
        if not re.search(r" 0( \S+)?$", said := figure(name, value))
    ][:MOST_FIGURES]


def is_number(value: Any) -> bool:
    """Return True for a finite number."""
    return isinstance(value, (int, float)) and math.isfinite(value)


def _number(value: Any, resolution: float) -> str:
    if is_number(value) and not isinstance(value, bool):
        return "0" if abs(value) < resolution / 2 or value == 0 else f"{value:.4g}"
    if isinstance(value, list):
        return "(" + ", ".join(_number(item, resolution) for item in value) + ")"
    return str(value)
