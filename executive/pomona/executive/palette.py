"""Colours of all graphics: pictures of runs, records for other viewers, reports, the operator's page.

The page defines them in style.css, in light and dark; a test compares its light scheme with this file.
"""

from __future__ import annotations

from collections.abc import Mapping

INK, MUTED, LINE = "#1a1e23", "#5b6470", "#d8dce2"  # text, secondary text, and rules

GOOD, BAD, WARN = "#11703f", "#bd2222", "#955200"

SCENE: Mapping[str, str] = {
    "planned": "#1c5bc7",
    "executed": "#d0731a",
    "approach": "#a8246a",
    "muted": "#8b6fae",
    "occupied": "#707a86",
    "free": "#2f86c9",
    "chosen": GOOD,
    "ruled_out": BAD,
    "tried": WARN,
    "object": "#8f7400",
    "robot": "#aeb6c0",
    "tool": "#6f7883",
}
"""Things in space, by the style of their view (`pomona.executive.views`)."""

OVERLAY: Mapping[str, str] = {
    "found": "#ffb02e",
    "refined": "#2ee08b",
    "chosen": "#4fa8ff",
    "muted": "#c3c9d1",
    "ruled_out": "#ff6a5f",
}
"""Colours over a photograph: brighter, since leaves and fruit are dark."""

SERIES = (
    "#1c5bc7",
    "#bd2222",
    "#11703f",
    "#955200",
    "#743bb8",
    "#0b7582",
)  # curves and bars, in their order


def rgb(colour: str) -> tuple[float, float, float]:
    """`"#1c5bc7"` as red, green and blue, each from 0 to 1."""
    red, green, blue = (int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return red, green, blue
