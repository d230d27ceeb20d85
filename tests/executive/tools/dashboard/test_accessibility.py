"""axe-core finds nothing on the page: while nothing runs, over a failed record, in the list of runs, light and dark."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from shown_runs import Show

from pomona.tools.dashboard.choices import Choices

pytestmark = pytest.mark.browser

AXE = Path(__file__).with_name("vendor") / "axe.min.js"
FAILED = "pomona: 1\ntree: old\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n    - Jam: {}\n"
ASK = """async () => (await axe.run(document, { resultTypes: ["violations"] })).violations
    .map((found) => `${found.id}: ${found.nodes.slice(0, 3).map((node) => node.html.slice(0, 160)).join(" | ")}`)"""


def expect(locator: Any) -> Any:
    from playwright.sync_api import expect as playwright_expect

    return playwright_expect(locator)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(show: Show, open_page: Callable[..., Any], scheme: str) -> None:
    show.record(FAILED, "old_1")
    show.dashboard.allow_starts(lambda _form: "", Choices.installed())
    page = open_page(color_scheme=scheme)
    page.evaluate(AXE.read_text(encoding="utf-8"))
    expect(page.locator("#connection")).to_have_text("recorded run")
    page.get_by_role("button", name="Back to live").click()
    expect(page.locator("#connection")).to_have_text("connected")
    problems = {"nothing runs": page.evaluate(ASK)}
    page.evaluate("location.hash = 'run=old_1'")
    expect(page.locator("#connection")).to_have_text("recorded run")
    expect(page.locator("#camera img")).to_be_visible()
    expect(page.locator("#plots .plot").first).to_be_visible()
    problems["a failed record"] = page.evaluate(ASK)
    if scheme == "dark":  # the rest differs in nothing but what the test of contrasts looks at
        assert problems == {"nothing runs": [], "a failed record": []}
        return
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#start-fields summary").first).to_be_visible()
    expect(page.locator("#runs tbody tr")).to_have_count(1)
    expect(page.locator("#runs .look img")).to_have_js_property("naturalWidth", 64)
    problems["the runs"] = page.evaluate(ASK)
    page.locator("#show-keys").evaluate("(button) => button.click()")
    problems["the keys"] = page.evaluate(ASK)
    assert {where: found for where, found in problems.items() if found} == {}
