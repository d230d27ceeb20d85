"""Words on the page can be read: contrast of its colours by WCAG 2, in light and dark."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

STYLE = (
    Path(__file__).resolve().parents[4]
    / "executive"
    / "pomona"
    / "tools"
    / "dashboard"
    / "static"
    / "style.css"
).read_text("utf-8")
SCHEMES = {
    scheme: dict(re.findall(r"--([\w-]+): (#[0-9a-f]+);", block))
    for scheme, block in zip(
        ("light", "dark"), re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL), strict=False
    )
}
WORDS = ("text", "muted", "good", "bad", "busy", "warn", "idle", "accent")
GROUNDS = ("panel", "bg", "sunk")


def luminance(colour: str) -> float:
    """Relative luminance of #rgb or #rrggbb."""
    digits = colour.lstrip("#")
    digits = "".join(2 * d for d in digits) if len(digits) == 3 else digits
    channels = [int(digits[i : i + 2], 16) / 255.0 for i in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """From 1 to 21."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("word", WORDS)
@pytest.mark.parametrize("ground", GROUNDS)
def test_words_stand_out_from_their_background(scheme: str, word: str, ground: str) -> None:
    colours = SCHEMES[scheme]
    assert contrast(colours[word], colours[ground]) >= 4.5


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_running_rows_and_primary_buttons_can_be_read(scheme: str) -> None:
    colours = SCHEMES[scheme]
    for words, ground in (("busy", "glow"), ("text", "glow"), ("on-accent", "accent")):
        assert contrast(colours[words], colours[ground]) >= 4.5


def test_the_safe_stop_can_be_read() -> None:
    assert contrast("#ffffff", "#c01c1c") >= 4.5
    assert contrast("#ffffff", "#ab1717") >= 4.5
