"""The few signs and formats that every text view shares."""

from __future__ import annotations

from executive.reasons import Reason

ICONS = {"SUCCESS": "✓", "FAILURE": "✗", "RUNNING": "▶", "INVALID": "·"}
STYLES = {"SUCCESS": "green", "FAILURE": "red", "RUNNING": "bold cyan", "INVALID": "dim"}


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
    """` (skills/lift.py:42, in run)` for a reason that is an exception; else nothing."""
    place = reason.data.get("place")
    return f" ({place})" if isinstance(place, str) and place else ""
