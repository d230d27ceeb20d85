"""Curves in a real browser: a long run keeps its peaks, and thinned curves are marked."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from shown_runs import GATE, Show

pytestmark = pytest.mark.browser

LONG = """async () => {
    const { apply, emptyState } = await import("/static/store.js");
    const s = emptyState();
    const at = () => ({ event: "Published", seq: 1, tick: 1, node: "a", topic: "grip" });
    for (let k = 0; k < 9000; k++) {
      const t = Array.from({ length: 10 }, (_x, i) => k * 0.2 + i * 0.02);
      const force = t.map((_t, i) => (k === 777 && i === 3 ? 99 : k === 778 && i === 4 ? -5 : 1));
      const slip = t.map(() => (k < 100 ? null : 0.25));
      const values = { "force [N]": force, "slip [mm]": slip };
      apply(s, { ...at(), t: t.at(-1), value: { type: "SeriesView", t, values, thresholds: {} } });
    }
    const { t, values, thinned } = s.series.get("grip");
    const rising = t.every((x, i) => !i || x >= t[i - 1]);
    const [force, slip] = [values["force [N]"], values["slip [mm]"]];
    return { count: t.length, least: Math.min(...force), greatest: Math.max(...force), slip: [...new Set(slip)],
      rising, thinned, end: t.at(-1), equal: slip.length === t.length };
}"""


def test_half_an_hour_of_samples_keeps_its_peaks_and_marks_thinned_parts(
    open_page: Callable[..., Any],
) -> None:
    kept = open_page().evaluate(LONG)
    assert kept["count"] <= 40_000
    assert (kept["least"], kept["greatest"]) == (-5, 99)
    assert kept["slip"] == [None, 0.25]
    assert kept["rising"]
    assert kept["equal"]
    ((begin, end),) = kept["thinned"]
    assert begin == pytest.approx(0.0, abs=0.1)
    assert 1000.0 < end < kept["end"]  # the newest are all there


GAP = """async () => {
    const { apply, emptyState } = await import("/static/store.js");
    const s = emptyState();
    for (const t of [[0, 0.1], [0.2, 0.3], [4.8, 4.9]]) {
      const value = { type: "SeriesView", t, values: { "force [N]": [1, 2] }, thresholds: {} };
      apply(s, { event: "Published", seq: 1, tick: 1, node: "a", topic: "grip", t: t.at(-1), value });
    }
    return s.series.get("grip").values["force [N]"];
}"""


def test_no_line_joins_samples_with_seconds_between_them(open_page: Callable[..., Any]) -> None:
    assert open_page().evaluate(GAP) == [1, 2, 1, 2, None, 1, 2]


def test_the_name_of_a_limit_is_written_whole(show: Show, open_page: Callable[..., Any]) -> None:
    page = open_page()
    page.evaluate("""() => { const { fillText } = CanvasRenderingContext2D.prototype; window.written = [];
        CanvasRenderingContext2D.prototype.fillText = function (words, x, y) {
          window.written.push([words, this.textAlign]); fillText.call(this, words, x, y); }; }""")
    show.run(
        "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n    - Hold: {}\n"
    )
    page.wait_for_function("() => window.written.some(([words]) => words === 'limit')")
    assert (
        page.evaluate(
            "() => window.written.filter(([words, at]) => words === 'limit' && at !== 'left')"
        )
        == []
    )
    GATE.set()


LOOKS = "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n"


def test_a_value_of_now_is_bold_and_none_is_when_the_run_has_ended(
    show: Show, open_page: Callable[..., Any]
) -> None:
    page = open_page()
    show.run(LOOKS + "    - Hold: {}\n")
    page.wait_for_selector(".keys b")
    GATE.set()
    page.wait_for_function("() => document.querySelectorAll('.keys b.old').length === 2")


def test_a_value_that_is_a_second_old_is_grey_with_its_age(
    show: Show, open_page: Callable[..., Any]
) -> None:
    page = open_page()
    show.run(LOOKS + "    - Rest: {duration: 1.5 s}\n    - Hold: {}\n")
    page.wait_for_selector(".keys b:not(.old)")
    page.wait_for_function("() => document.querySelectorAll('.keys b.old').length === 2")
    ages = page.locator(".plot .age").all_text_contents()
    assert all(re.fullmatch(r"\d+\.\d s ago", age) for age in ages), ages
    GATE.set()
