"""The reason is never cut off: at four sizes, for everything that a skill can fail with, it is wholly in sight."""

from __future__ import annotations

import ast
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from shown_runs import SIZES, Show

pytestmark = pytest.mark.browser

DRAWN = 10_000 if "SCREENS" in os.environ else 2
"""Reasons, the longest, for which the whole page is drawn, too; `make screens` draws it for all."""
NODES = [f"Node {n}" for n in range(40)]
MEASURE = Path(__file__).with_name("reason_in_sight.js")


def failures_in_the_source() -> dict[str, str]:
    """Every code that a skill declares or fails with, and its longest message, with a figure where a value stands."""
    found: dict[str, str] = {}
    for path in sorted((Path(__file__).parents[4] / "skills" / "pomona").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(args=[ast.Constant(value=str(code)), message, *_]) if code.isupper():
                    found[code] = max(found.get(code, ""), written(message), key=len)
                case ast.Assign(targets=[ast.Name(id=name)], value=ast.Tuple(elts=codes)) if (
                    "failures" in name.lower()
                ):
                    found |= {
                        c.value: found.get(c.value, "")
                        for c in codes
                        if isinstance(c, ast.Constant)
                    }
    return {code: words or "a sentence that only the device knows" for code, words in found.items()}


def written(message: ast.expr) -> str:
    match message:
        case ast.Constant(value=str(words)):
            return words
        case ast.JoinedStr(values=parts):
            return "".join(
                part.value if isinstance(part, ast.Constant) else "123.4 mm" for part in parts
            )
    return ""


def test_the_reason_is_wholly_in_sight_for_every_failure(
    show: Show, open_page: Callable[..., Any]
) -> None:
    page = open_page(viewport={"width": 1440, "height": 900})
    from playwright.sync_api import expect

    expect(page.locator("#connection")).to_have_text("connected")
    failures = failures_in_the_source()
    assert len(failures) > 30
    facts = {
        "nearest_distance_m": 0.0123456,
        "candidate": 12,
        "clearance_m": 0.008,
        "planner": "RRTConnect",
    }
    reasons = [{"code": code, "message": words, "data": facts} for code, words in failures.items()]
    reasons.append(
        {
            "code": "LONG",
            "message": "a branch is in the way, " * 12,
            "data": {f"n{i}": i for i in range(20)},
        }
    )
    ruled_out = [f"{i}: TABLE: the left finger would be 318 mm inside the table" for i in range(16)]
    reasons.append(
        {"code": "NO_CANDIDATE", "message": "all are ruled out", "data": {"ruled_out": ruled_out}}
    )
    reasons.append({"code": "X" * 60, "message": "without_a_single_space_" * 12, "data": {}})
    reasons.sort(key=lambda reason: -len(str(reason["message"])))
    measure = MEASURE.read_text(encoding="utf-8")
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        cut_off = page.evaluate(measure, {"reasons": reasons, "nodes": NODES, "drawn": DRAWN})
        assert cut_off == [], size
