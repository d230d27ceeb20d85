"""One palette: Python's graphics have the colours of the operator's page in its light scheme."""

import re
from pathlib import Path

import pytest

from pomona.executive.palette import BAD, GOOD, INK, LINE, MUTED, OVERLAY, SCENE, SERIES, WARN, rgb

STATIC = (
    Path(__file__).resolve().parents[2] / "executive" / "pomona" / "tools" / "dashboard" / "static"
)
STYLE = (STATIC / "style.css").read_text("utf-8")
LIGHT = dict(re.findall(r"--([a-z0-9-]+): (#[0-9a-f]+);", STYLE[: STYLE.index("@media")]))


def test_text_and_judgements():
    names = ("text", "muted", "line", "good", "bad", "warn")
    assert [LIGHT[name] for name in names] == [INK, MUTED, LINE, GOOD, BAD, WARN]


def test_things_in_space():
    mapping = re.search(r"const STYLE = \{(.*?)\};", (STATIC / "scene.js").read_text("utf-8"), re.S)
    roles = dict(re.findall(r'(\w+): "--([a-z]+)"', mapping[1]))
    assert {role: LIGHT[variable] for role, variable in roles.items()} == SCENE


def test_outlines_on_photographs():
    outlines = dict(re.findall(r"\.line\.(\w+) \{ stroke: (#[0-9a-f]{6})", STYLE))
    assert (
        outlines | {"found": re.search(r"\.line \{[^}]*stroke: (#[0-9a-f]{6})", STYLE)[1]}
        == OVERLAY
    )


def test_curves():
    assert tuple(LIGHT[f"s{k}"] for k in range(1, 7)) == SERIES


def test_a_colour_as_numbers():
    assert rgb("#ff0080") == pytest.approx((1.0, 0.0, 128 / 255))
