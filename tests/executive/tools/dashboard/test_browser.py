"""The page in a real browser: an operator's view and actions, from the start of a run to its explanation."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_cell import FakeCell
from shown_runs import GATE, Show, press_stop

from pomona.executive.reasons import Reason, failure_codes
from pomona.executive.recording import overview as thinning, recorder as recording
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import (
    LinkChanged,
    NodeChanged,
    OperatorActed,
    PortWritten,
    Published,
    RunEnded,
    RunStarted,
    SafeStopped,
    StateChanged,
)
from pomona.executive.views import ImageView, Line2, Points3, SceneView, SeriesView, TableView
from pomona.tools.dashboard import record_messages
from pomona.tools.dashboard.choices import Choices
from pomona.tools.dashboard.command_dashboard import Launcher
from pomona.tools.dashboard.control_lock import RefusedError

pytestmark = pytest.mark.browser

HOLD = "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n    - Hold: {}\n    - Rest: {}\n"
JAM = """
pomona: 1
tree: jam
root:
  fallback:
    - Jam: {}
      name: The jam
    - Rest: {duration: 300 ms}
      name: The way out
"""
BROKEN = """
pomona: 1
tree: broken
root:
  sequence:
    - Rest: {}
    - Jam: {}
      name: '<img src=x onerror=alert(1)>'
"""
Open = Callable[..., Any]


def expect(locator: Any) -> Any:
    from playwright.sync_api import expect as playwright_expect

    return playwright_expect(locator)


def row(page: Any, name: str) -> Any:
    return page.locator(".row", has=page.get_by_text(name, exact=True)).first


def take_control(page: Any, name: str) -> None:
    page.get_by_label("your name").fill(name)
    page.locator("#control [data-action=take]").click()
    expect(page.locator("#holder")).to_have_text("You hold control.")


def wait_until_painted(page: Any, least: int) -> None:
    """Until more pixels of the scene than these are not empty: it is shown when it is ready."""
    page.wait_for_function(
        "(least) => { const seen = document.getElementById('scene');"
        " const c = Object.assign(document.createElement('canvas'), { width: seen.width, height: seen.height });"
        " const g = c.getContext('2d'); g.drawImage(seen, 0, 0, c.width, c.height);"
        " const { data } = g.getImageData(0, 0, c.width, c.height);"
        " return data.filter((v, i) => i % 4 === 3 && v).length > least }",
        arg=least,
        polling=100,
        timeout=60_000,
    )


@pytest.mark.landmark
def test_a_run_is_watched_from_start_to_end(show: Show, open_page: Open) -> None:
    page = open_page()
    expect(page.locator("#connection")).to_have_text("connected")
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    expect(page.locator("#kind")).to_have_text("MOCK")
    expect(row(page, "Hold").locator(".icon")).to_have_attribute("aria-label", "running")
    expect(row(page, "Hold").locator(".detail")).to_have_text("waiting at the gate")
    expect(page.locator("#links .ok")).to_have_text(re.compile(r"wheel (\d+ ms|0\.\d s)"))
    expect(page.locator("#camera img")).to_be_visible()
    expect(page.locator("#camera polygon")).to_have_count(1)
    expect(page.locator("#plots .plot")).to_have_count(2)
    expect(page.locator("#scene-legend")).to_contain_text("planned path")
    expect(page.locator("#scene-legend")).to_contain_text("executed path")
    wait_until_painted(page, 500)  # the robot's triangle, the floor, the paths
    row(page, "Look").click()
    expect(page.locator("#node .wires")).to_contain_text(re.compile(r"seen.*an apple.* · .* ago"))
    expect(page.locator("#node .history")).to_contain_text("✓ success")
    expect(page.locator("#node pre")).to_contain_text("Look: {seen")
    GATE.set()
    expect(page.locator("#state")).to_have_text("✓ success")
    expect(row(page, "Rest").locator(".icon")).to_have_attribute("aria-label", "success")
    expect(page.locator("#why")).to_contain_text("✓ Succeeded")
    expect(page.locator("#why")).to_contain_text("nothing failed on the way")


def test_pause_and_resume_show_the_acknowledged_state(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    pause = page.get_by_role("button", name="Pause")
    expect(pause).to_be_disabled()
    take_control(page, "ada")
    pause.click()
    expect(page.locator("#why")).to_contain_text("Paused, at rest: by ada")
    expect(page.locator("#ack")).to_have_text("last: pause by ada")
    assert show.cell.wheel.paused
    expect(pause).to_be_disabled()
    page.locator("#steps").get_by_role("button", name="Reload file").click()
    expect(page.locator("#connection")).to_have_text("this run has no tree file")
    assert show.cell.wheel.paused
    page.locator("#steps").get_by_role("button", name="Resume").click()
    expect(page.locator("#why")).to_contain_text("▶ Hold")
    assert not show.cell.wheel.paused


@pytest.mark.landmark
def test_a_safe_stop_by_keys_stays_until_it_is_reset_and_the_skill_stands_interrupted(
    show: Show, open_page: Open
) -> None:
    page, other = open_page(), open_page()
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    press_stop(page)  # nobody needs control for this, and nothing asks back
    expect(page.locator("#latched-reason")).to_have_text("safe stop by operator")
    expect(other.locator("#latched")).to_be_visible()
    expect(page.locator("#state")).to_have_text("■ stopped")
    assert show.cell.latched == "safe stop by operator"
    for seen in (page, other):
        expect(row(seen, "Hold").locator(".icon")).to_have_attribute("aria-label", "interrupted")
        expect(row(seen, "Hold")).to_have_class(re.compile(r"\bcut\b"))
    expect(row(page, "Look").locator(".icon")).to_have_attribute(
        "aria-label", "idle, last result success"
    )
    reset = page.get_by_role("button", name="Acknowledge and reset")
    expect(reset).to_be_disabled()
    take_control(page, "ada")
    reset.click()
    expect(page.locator("#latched")).to_be_hidden()
    expect(other.locator("#latched")).to_be_hidden()
    assert show.cell.latched is None
    show.close()
    acts = [
        (e.who, e.action)
        for e in read_events(show.records / "demo_1")
        if isinstance(e, OperatorActed)
    ]
    assert acts == [("operator", "safe_stop"), ("ada", "take"), ("ada", "acknowledge")]


def test_a_replay_of_a_stopped_run_shows_the_skill_interrupted(show: Show, open_page: Open) -> None:
    runner = show.run(HOLD.replace("- Look", "- Rest: {}\n      name: Hold once more\n    - Look"))
    page = open_page()
    expect(row(page, "Hold").locator(".icon")).to_have_attribute("aria-label", "running")
    runner.safe_stop("a test", "ada")
    expect(row(page, "Hold").locator(".icon")).to_have_attribute("aria-label", "interrupted")
    runner.leave()
    replay = open_page("run=demo_1")
    expect(replay.locator("#connection")).to_have_text("recorded run")
    expect(row(replay, "Hold").locator(".icon")).to_have_attribute("aria-label", "interrupted")
    expect(row(replay, "Hold once more").locator(".icon")).to_have_attribute(
        "aria-label", "idle, last result success"
    )


def test_a_skill_that_the_stop_refuses_stays_red(show: Show, open_page: Open) -> None:
    page = open_page()
    expect(page.locator("#connection")).to_have_text("connected")
    page.evaluate(Path(__file__).with_name("refused_by_the_stop.js").read_text(encoding="utf-8"))
    expect(row(page, "Lift")).to_have_class(re.compile(r"\bbad\b"))
    expect(row(page, "Feel")).to_have_class(re.compile(r"\bpast\b"))
    expect(page.locator("#why")).to_have_text(
        re.compile(r"^■ Stopped: SAFE_STOP safe stop by ada\.In the hand: not known\. Look first ")
    )


def test_a_failed_run_shows_the_remedy_of_its_code(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run("pomona: 1\ntree: late\nroot:\n  fail: {code: TIMEOUT, message: too slow}\n")
    expect(page.locator("#why .remedy")).to_have_text(
        re.compile(f"^Remedy: {failure_codes()['TIMEOUT'].remedy[:12]}")
    )
    expect(page.locator("#why")).not_to_contain_text("`")
    expect(page.locator("#why .remedy")).to_contain_text("budget (not set in this tree)")
    page.evaluate("""async () => { // as if a node had that input, and its value came from a parameter
        const { page } = await import("/static/page.js"), { whole } = page;
        whole.run = { ...whole.run, run: "other", parameter_texts: { time: "2 s" } };
        whole.byPath.get("late").inputs = { budget: "{time}" };
        page.dirty = true; }""")
    expect(page.locator("#why .remedy")).to_contain_text("budget (2 s at late, line 4)")


def test_a_failed_run_is_explained_in_words_with_data(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(BROKEN)
    why = page.locator("#why")
    expect(why).to_contain_text("✗ Failed at ")
    expect(why).to_contain_text("JAMMED the wheel is stuck")
    expect(why.locator("dl").first).to_have_text("angle0.5")
    expect(why).to_contain_text("<img src=x onerror=alert(1)>")  # a hostile name is text
    assert page.locator("#tree img, #why img").count() == 0


def test_a_failed_record_opens_at_its_failure_in_every_panel(show: Show, open_page: Open) -> None:
    show.record(BROKEN + "  retry: 2\n  on_failure:\n    Rest: {duration: 300 ms}\n", "old_1")
    page = open_page("run=old_1")
    expect(page.locator("#why")).to_contain_text("✗ Failed at 0.6 s")
    expect(page.locator("#clock")).to_have_text(re.compile(r"^0\.\d s of 0\.\d s$"))
    expect(page.locator("#timeline")).to_have_attribute("aria-valuenow", "0.6")
    expect(page.locator("#shown")).to_have_text(re.compile(r"^0\.6 s of 0\.9 s$"))
    expect(page.locator("#node .status")).to_contain_text("✗ failure")


def test_records_without_an_end_or_damaged_are_called_so(show: Show, open_page: Open) -> None:
    show.record(HOLD.replace("    - Hold: {}\n", ""), "whole")
    for name in ("no_end", "damaged", "empty"):
        (show.records / name).mkdir()
    recorder = Recorder(show.records / "no_end")
    for event in read_events(show.records / "whole"):
        if not isinstance(event, RunEnded):
            recorder.on_event(event)
    recorder.close()
    data = bytearray((show.records / "whole" / EVENTS_FILE).read_bytes())
    data[len(data) // 2] ^= 0x55
    (show.records / "damaged" / EVENTS_FILE).write_bytes(data)
    (show.records / "empty" / EVENTS_FILE).write_bytes(b"")
    page = open_page("run=no_end&t=NaN")
    expect(page.locator("#state")).to_have_text("■ no end")
    expect(page.locator("#why")).to_contain_text("The run was cut off, or still goes on.")
    expect(page.locator("#clock")).to_have_text(
        re.compile(r"^0\.\d s$")
    )  # a moment that is no number is left out
    page.evaluate("location.hash = 'run=damaged'")
    expect(page.locator("#why")).to_contain_text("✗ This record cannot be shown: ")
    expect(page.locator("#why")).to_contain_text("`pomona runs repair` saves the undamaged parts")
    expect(page.locator("#connection")).to_have_text("record not readable")
    page.evaluate("location.hash = 'run=empty'")
    expect(page.locator("#why")).to_contain_text("it holds no run")


def test_after_a_reset_the_next_steps_are_buttons(show: Show, open_page: Open) -> None:
    forms: list[Any] = []
    show.dashboard.allow_starts(lambda form: forms.append(form) or "demo", Choices.installed())
    page = open_page()
    runner = show.run(HOLD, seed=3)
    take_control(page, "ada")
    expect(page.locator("#state")).to_have_text("▶ running")
    runner.safe_stop("a test", "ada")
    page.get_by_role("button", name="Acknowledge and reset").click()
    page.locator("#steps").get_by_role("button", name="Run again").click()
    expect(page.locator("#connection")).to_have_text("connected")
    assert [(form["tree"], form["cell"], form["seed"]) for form in forms] == [("tree", "fake", 3)]
    page.evaluate(LASTING, "something is between the fingers")
    expect(page.locator("#why")).to_contain_text(
        re.compile(
            r"In the hand: something is between the fingers \d.* ago\. Look first at the hand"
        )
    )
    expect(page.locator("#why kbd")).to_contain_text(
        ["--set arm=lab:53200 --set 'kind=a pear' --recover"]
    )
    steps = page.locator("#steps button")
    expect(steps).to_have_text(["Put down the held fruit", "Home, slowly", "↻ Run again"])
    steps.first.click()
    asked = page.get_by_role("alert").filter(has_text="Put down the held fruit")
    expect(asked).to_contain_text("on fake, emulated, at lab:53200. The hand lowers")
    expect(asked).to_contain_text("In the hand: something is between the fingers.")
    page.evaluate(LASTING, "")  # another state than the one that was shown: it is asked anew
    expect(asked).to_have_count(0)
    assert len(forms) == 1  # nothing has moved yet
    page.locator("#steps").get_by_role("button", name="Home, slowly").click()
    page.get_by_role("button", name="Move now").click()
    expect(page.locator("#connection")).to_have_text("connected")
    assert (forms[-1]["tree"], forms[-1]["after"]) == ("recover", "demo_1")
    assert forms[-1]["settings"] == {"arm": "lab:53200", "release": "false"}


LASTING = """async (hand) => { // a cell that lasts, and what is felt in its hand
    const { page } = await import("/static/page.js"), { whole } = page.live;
    Object.assign(whole.run, { cell_kind: "emulated", parameters: { kind: "apple" },
      settings: { arm: "lab:53200", kind: "a pear" },
      cell_text: 'options:\\n  arm: 127.0.0.1:53100\\ndevices:\\n  arm:\\n    address: "{arm}"\\n' });
    Object.assign(whole, { hand, handAt: whole.t });
    page.dirty = true;
}"""


def test_a_recovery_is_refused_when_another_run_has_begun_since_it_was_shown(
    show: Show, tmp_path: Path
) -> None:
    show.record(JAM, "shown")
    launcher = Launcher(show.dashboard, tmp_path, Choices.installed())
    form = {"tree": "recover", "cell": "sim", "after": "shown"}
    assert launcher._order(form).tree.stem == "recover"
    show.record(JAM, "since")
    with pytest.raises(RefusedError, match="another run has begun since shown"):
        launcher._order(form)


def test_figures_have_their_units(show: Show, open_page: Open) -> None:
    page = open_page()
    figures = {"width_m": 0.07974, "wanted_force_n": 20.744, "angle_rad": 0.5, "ratio": 0.25}
    shown = page.evaluate(
        "async (of) => { const { quantity } = await import('/static/dom.js');"
        " return Object.entries(of).map(([name, value]) => quantity(name, value).join(' ')); }",
        figures,
    )
    assert shown == ["width 79.7 mm", "wanted force 20.7 N", "angle 28.6°", "ratio 0.25"]


def test_lines_that_a_skill_logs_stand_at_its_node_and_among_the_events(
    show: Show, open_page: Open
) -> None:
    show.record("pomona: 1\ntree: t\nroot: {sequence: [{Rest: {}}, {Murmur: {}}]}\n", "logged")
    page = open_page("run=logged")
    row(page, "Murmur").click()
    lines = page.locator("#node ol.history").last.locator("li")
    expect(lines).to_have_count(2)
    expect(lines.nth(0)).to_have_text(re.compile(r"^0\.\d s *WARNING the scale drifts *$"))
    expect(lines.nth(1)).to_contain_text("INFO <b>the scale</b> reads 151.5 g")
    row(page, "Rest").click()
    expect(page.locator("#node")).not_to_contain_text("the scale")
    page.get_by_role("tab", name="Events").click()
    expect(page.locator("#log")).to_contain_text("✎ Murmur WARNING: the scale drifts")


def test_why_names_the_next_step_of_the_tree(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(JAM)
    expect(page.locator("#why")).to_contain_text("Then the tree went on with The way out.")
    expect(page.locator("#why .verdict")).to_have_text(
        re.compile(r"^✓ Succeeded after 0\.\d+ s\.$|^✓ Succeeded after \d+ ms\.$")
    )
    expect(page.locator("#why")).to_contain_text("1 failure on the way. The latest, at")


def test_the_result_stands_before_the_failures_on_the_way(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(JAM)
    expect(page.locator("#why")).to_contain_text("1 failure on the way")
    page.evaluate("""async () => {
        const { page } = await import("/static/page.js");
        page.live.whole.tables.set("tally", { columns: [], rows: [], caption: "5 of 5 fruit put away" });
        page.live.whole.failures.push(page.live.whole.failures[0]);
        page.dirty = true;
    }""")
    expect(page.locator("#why .verdict")).to_have_text(
        re.compile("^✓ Succeeded: 5 of 5 fruit put away after ")
    )
    expect(page.locator("#why")).to_contain_text("2 failures on the way")


DECIDED = """pomona: 1
tree: decided
root:
  sequence:
    - set: {n: 1}
    - fallback:
        - check: "{n} > 1"
        - succeed: {}
"""


def colour_of(locator: Any) -> str:
    return str(locator.evaluate("(element) => getComputedStyle(element).color"))


def test_a_failure_that_the_tree_went_on_from_is_not_red(show: Show, open_page: Open) -> None:
    show.record(JAM, "old_1")
    show.record(BROKEN, "old_2")
    page = open_page("run=old_1")
    warn, bad = "rgb(149, 82, 0)", "rgb(189, 34, 34)"
    expect(page.locator("#state")).to_have_text("✓ success")
    assert colour_of(row(page, "The jam").locator(".name")) == warn
    assert colour_of(page.locator("#why code").first) not in (warn, bad)
    page.get_by_role("tab", name="Events").click()
    assert colour_of(page.locator("#log .events span", has_text="JAMMED")) == warn
    assert page.evaluate(COLOURS, [189, 34, 34]) == 0
    page.evaluate("() => { location.hash = 'run=old_2'; }")
    expect(page.locator("#state")).to_have_text("✗ failure")
    assert colour_of(page.locator(".row.leaf.bad .name")) == bad
    page.wait_for_function(f"() => ({COLOURS})([189, 34, 34]) > 5")


COLOURS = """([r, g, b]) => { // how many points of the timeline have this colour
    const { data } = document.querySelector("#timeline").getContext("2d").getImageData(0, 0, 4000, 400);
    let count = 0;
    for (let i = 0; i < data.length; i += 4) count += data[i] === r && data[i + 1] === g && data[i + 2] === b;
    return count; }"""


def test_a_timeline_that_cannot_hold_all_spans_summarises_the_oldest(
    show: Show, open_page: Open
) -> None:
    kept = open_page().evaluate("""async () => {
        const { apply, emptyState } = await import("/static/store.js");
        const s = emptyState();
        const node = (path, parent = null) => ({ path, parent, name: path });
        apply(s, { event: "RunStarted", t: 0, seq: 1, nodes: [node("t"), node("a", "t"), node("b", "t")] });
        for (let i = 0; i < 9000; i++) {
            const path = i % 2 ? "a" : "b", reason = i === 6 ? { code: "JAMMED", message: "" } : null;
            const of = { event: "NodeChanged", path, starts: i };
            apply(s, { ...of, t: i, seq: 2 * i, status: "RUNNING" });
            apply(s, { ...of, t: i + 0.5, seq: 2 * i + 1, status: reason ? "FAILURE" : "SUCCESS", reason });
        }
        const [first] = s.spans, newest = s.spans.at(-1);
        return { count: s.spans.length, first: first.start, failed: first.status, newest: newest.start,
            all: s.spans.reduce((sum, span) => sum + (span.of ?? 1), 0) }; }""")
    assert kept["count"] <= 4000
    assert (kept["first"], kept["failed"], kept["newest"], kept["all"]) == (
        0,
        "FAILURE",
        8999,
        9000,
    )


def test_a_condition_that_does_not_hold_is_no_failure_on_the_way(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    show.run(DECIDED)
    expect(page.locator("#why .verdict")).to_contain_text("nothing failed on the way")
    marks = page.evaluate("""async () => {
        const { page } = await import("/static/page.js");
        return page.live.whole.marks.filter(({ text }) => text.includes("CONDITION_FALSE")).map(({ kind }) => kind);
    }""")
    assert marks == ["state"]
    show.run(DECIDED.replace("        - succeed: {}\n", ""), "demo_2")  # here it ends the run
    expect(page.locator("#why")).to_contain_text("CONDITION_FALSE")


def test_a_panel_is_one_module_in_the_list_with_its_own_markup_and_style(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    style = "#counter { color: rgb(1, 2, 3); }"
    page.route(
        "**/panels/counter.css", lambda route: route.fulfill(content_type="text/css", body=style)
    )
    show.run(JAM)
    page.evaluate("""async () => {
        const { PANELS } = await import("/static/panels/index.js");
        const draw = (box, s) => { box.textContent = `failures: ${s.failures.length}`; return s.failures.length > 0; };
        PANELS.counter = { title: "Counter", style: true, draw };
        PANELS.nothing = { title: "Nothing", draw: () => false };
        const { page } = await import("/static/page.js");
        page.dirty = true;
    }""")
    expect(page.locator("#counter-panel h2")).to_have_text("Counter")
    expect(page.locator("#counter")).to_have_text("failures: 1")
    expect(page.locator("#counter")).to_have_css("color", "rgb(1, 2, 3)")
    expect(page.locator("#nothing-panel")).to_be_hidden()


def test_outlines_of_an_earlier_picture_are_not_drawn_into_a_newer_one(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    drawn = page.evaluate("""async () => {
        const { CameraView } = await import("/static/pictures.js");
        const line = { points: [[0, 0], [5, 5]], style: "refined" }, image = "data:image/png;base64,";
        const look = (t) => ({ t, image, size: [10, 10], caption: `look at ${t}`, lines: [] });
        const measured = { t: 2, lines: [line], caption: "measured" };
        const outlines = () => document.querySelectorAll("#camera polyline").length;
        const count = (views) => { new CameraView().draw(views, null); return outlines(); };
        return [count([["look", look(1)], ["measured", measured]]), count([["look", look(3)], ["measured", measured]])];
    }""")
    assert drawn == [1, 0]
    expect(page.locator("#camera .caption")).to_have_text("look at 3")


def test_a_replay_is_scrubbed_played_and_shared(show: Show, open_page: Open) -> None:
    show.record(JAM, "old_1")
    page = open_page("run=old_1")
    expect(page.locator("#connection")).to_have_text("recorded run")
    expect(page.locator("#state")).to_have_text("✓ success")
    timeline = page.locator("#timeline")
    timeline.press("Home")
    expect(row(page, "The way out").locator(".icon")).not_to_have_attribute("aria-label", "success")
    expect(page.locator("#clock")).to_have_text(re.compile(r"^0\.0 s of 0\.\d s$"))
    timeline.press("ArrowRight")
    expect(row(page, "The jam").locator(".icon")).to_have_attribute(
        "aria-label", re.compile("failure")
    )
    page.get_by_label("speed", exact=True).select_option("8")
    page.get_by_role("button", name="play", exact=True).click()
    expect(row(page, "The way out").locator(".icon")).to_have_attribute("aria-label", "success")
    page.evaluate("location.hash = 'run=old_1&t=0.1'")
    expect(page.locator("#shown")).to_contain_text("0.1 s of")
    page.get_by_role("button", name="Back to live").click()
    expect(page.locator("#run")).to_have_text("no run yet")


def test_a_live_run_is_scrubbed_back_and_returned_to_live(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(HOLD)
    expect(row(page, "Hold").locator(".icon")).to_have_attribute("aria-label", "running")
    page.locator("#timeline").press("Home")
    expect(page.locator("body")).to_have_class(re.compile("past"))
    page.get_by_role("button", name="live", exact=False).first.click()
    expect(page.locator("body")).not_to_have_class(re.compile("past"))


def test_control_is_handed_over_where_everybody_sees_it(show: Show, open_page: Open) -> None:
    first, second = open_page(), open_page()
    show.run(HOLD)
    take_control(first, "ada")
    expect(second.locator("#holder")).to_have_text("ada holds control.")
    expect(second.locator("#viewers")).to_have_text("2 watch.")
    take_control(second, "ben")
    expect(first.locator("#holder")).to_have_text("ben holds control. It was taken over from you.")
    expect(first.get_by_role("button", name="Pause")).to_be_disabled()


def test_a_breakpoint_holds_and_is_shown_to_all(show: Show, open_page: Open) -> None:
    page, other = open_page(), open_page()
    show.run(HOLD)
    take_control(page, "ada")
    row(page, "Rest").click()
    page.locator("#tree").press("b")
    expect(other.locator("#breaks")).to_have_text("◉ Breakpoints: before Rest")
    GATE.set()
    expect(page.locator("#why")).to_contain_text("Paused, at rest: breakpoint before Rest")
    expect(row(page, "Rest").locator(".detail")).to_have_text("held by a breakpoint")
    page.locator("#control [data-action=resume]").click()
    expect(page.locator("#state")).to_have_text("✓ success")


def test_the_next_run_has_the_breakpoints_of_the_last_one(show: Show, open_page: Open) -> None:
    page = open_page()
    GATE.set()
    show.run(HOLD, "a")
    take_control(page, "ada")
    expect(page.locator("#state")).to_have_text("✓ success")
    row(page, "Rest").click()
    expect(page.locator("#node").get_by_role("button", name="Break before")).to_be_disabled()
    GATE.clear()
    show.run(HOLD, "b")
    row(page, "Rest").click()
    page.locator("#tree").press("b")
    expect(page.locator("#breaks")).to_have_text("◉ Breakpoints: before Rest")
    GATE.set()
    page.locator("#control [data-action=resume]").click()
    expect(page.locator("#state")).to_have_text("✓ success")
    show.run(HOLD, "c")
    expect(page.locator("#why")).to_contain_text("Paused, at rest: breakpoint before Rest")
    page.locator("#tree").press("b")
    page.locator("#control [data-action=resume]").click()
    expect(page.locator("#state")).to_have_text("✓ success")
    show.run(HOLD, "d")
    expect(page.locator("#state")).to_have_text("✓ success")


def test_escape_closes_a_comparison_and_the_list_before_it_arms_a_stop(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    runner = show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    page.locator("#show-runs").click()
    page.evaluate("document.getElementById('comparison').hidden = false")
    page.locator("body").press("Escape")
    expect(page.locator("#comparison")).to_be_hidden()
    expect(page.locator("#runs-view")).to_be_visible()
    page.locator("body").press("Escape")
    expect(page.locator("#run-view")).to_be_visible()
    assert runner.latched is None
    page.locator("body").press("Escape")
    page.locator("body").press("Escape")
    expect(page.locator("#latched")).to_be_visible()
    GATE.set()


def test_a_question_of_the_tree_is_answered_by_the_operator_in_control(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    show.run("pomona: 1\ntree: demo\nroot:\n  ask: Is it ripe?\n  choices: [ripe, not yet]\n")
    question = page.locator("#questions")
    expect(question).to_contain_text("Is it ripe?")
    expect(question.get_by_role("button", name="not yet")).to_be_disabled()
    take_control(page, "ada")
    question.get_by_role("button", name="not yet").click()
    expect(page.locator("#state")).to_have_text("✓ success")
    expect(question).to_be_hidden()
    expect(page.locator("#ack")).to_contain_text("last: answer by ada")


def test_a_double_click_answers_one_question(
    show: Show, open_page: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = open_page()
    told, on_event = [], show.dashboard.hub.on_event
    monkeypatch.setattr(
        show.dashboard.hub, "on_event", lambda event: (told.append(event), on_event(event))[1]
    )
    runner = show.run("pomona: 1\ntree: demo\nroot:\n  ask: Is it ripe?\n  repeat: 2\n")
    take_control(page, "ada")
    question = page.locator("#questions")
    question.get_by_role("button", name="yes").click()
    page.wait_for_function(
        "() => document.getElementById('questions').dataset.key.includes('\"demo\",2,')"
    )
    box = question.get_by_role("button", name="yes").bounding_box()
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.mouse.down(
        click_count=2
    )  # the second click of a double click, on the button of the next question
    page.mouse.up(click_count=2)
    question.get_by_role("button", name="no").click()
    expect(page.locator("#state")).to_have_text("✓ success")
    answers = [
        event.detail
        for event in told
        if isinstance(event, OperatorActed) and event.action == "answer"
    ]
    assert answers == ["yes ← demo", "no ← demo"]
    assert runner.tree.questions["demo"].starts == 2


def test_a_breakpoint_after_a_node_holds_when_it_has_ended(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(HOLD)
    take_control(page, "ada")
    row(page, "Hold").click()
    page.get_by_role("button", name="Break after (a)").click()
    expect(page.locator("#breaks")).to_have_text("◉ Breakpoints: after Hold")
    expect(row(page, "Hold").locator(".break")).to_have_text("◉ after")
    GATE.set()
    expect(page.locator("#why")).to_contain_text("Paused, at rest")
    expect(row(page, "Hold").locator(".icon")).to_have_attribute("aria-label", "success")
    expect(row(page, "Rest").locator(".icon")).to_have_attribute("aria-label", "idle")
    page.locator("#tree").press("a")
    expect(page.locator("#breaks")).to_be_hidden()
    page.locator("#control [data-action=resume]").click()
    expect(page.locator("#state")).to_have_text("✓ success")


def test_a_device_that_falls_silent_is_seen_in_the_banner(
    show: Show, open_page: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        FakeCell, "last_seen", lambda _cell: {"wheel": 0.0}
    )  # since the run began, nothing
    page = open_page()
    show.run(HOLD)
    expect(page.locator("#links .link.old")).to_have_text(re.compile(r"wheel ([2-9]|\d\d)\.\d s"))


def test_keys_that_come_faster_than_frames_all_count(show: Show, open_page: Open) -> None:
    show.record(JAM, "old_1")
    page = open_page("run=old_1")
    expect(page.locator("#connection")).to_have_text("recorded run")
    page.locator("#timeline").evaluate(
        "(line) => { for (const key of ['End', 'Home', 'ArrowRight', 'ArrowRight'])"
        " line.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true })); }"
    )
    expect(page.locator("#shown")).to_contain_text("0.2 s of")


def test_a_link_to_a_moment_leads_there_and_carries_no_token(show: Show, open_page: Open) -> None:
    show.record(JAM, "old_1")
    page = open_page("run=old_1", permissions=["clipboard-read", "clipboard-write"])
    expect(page.locator("#connection")).to_have_text("recorded run")
    expect(page.locator("#shown")).to_contain_text("0.3 s of")  # a failed run opens at its failure
    page.locator("#timeline").press("Home")
    expect(page.locator("#shown")).to_contain_text("0 ms of")
    page.locator("#timeline").press("ArrowRight")
    expect(page.locator("#shown")).to_contain_text("0.1 s of")
    page.get_by_role("button", name="Link to this moment").click()
    expect(page.locator("#connection")).to_contain_text("copied")
    link = page.evaluate("navigator.clipboard.readText()")
    assert link.endswith("#run=old_1&t=0.10")
    other = open_page("")
    other.goto(link)
    expect(other.locator("#shown")).to_contain_text("0.1 s of")
    expect(row(other, "The jam").locator(".icon")).to_have_attribute(
        "aria-label", re.compile("failure")
    )


def test_everything_is_reached_by_keys(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(HOLD)
    expect(row(page, "Hold").locator(".icon")).to_have_attribute("aria-label", "running")
    page.keyboard.press("j")
    expect(page.locator("#node")).to_contain_text("Hold")
    page.keyboard.press("/")
    expect(page.get_by_label("search nodes")).to_be_focused()
    page.keyboard.press("Tab")
    page.locator("#tree").focus()
    page.keyboard.press("ArrowDown")
    expect(page.locator("#node")).to_contain_text("Rest")
    page.keyboard.press("r")
    expect(page.locator("#runs-view")).to_be_visible()
    page.keyboard.press("r")
    expect(page.locator("#run-view")).to_be_visible()
    page.keyboard.press("?")
    expect(page.locator("#keys")).to_be_visible()
    page.get_by_role("button", name="Close").press("Enter")
    expect(page.locator("#keys")).to_be_hidden()
    page.get_by_role("tab", name="Node").press("ArrowRight")
    expect(page.locator("#ports")).to_contain_text("an apple")


def test_hostile_words_of_a_run_stay_words(show: Show, open_page: Open) -> None:
    hostile = "<img src=x onerror=alert(1)>"
    show.dashboard.hub.on_event(
        RunStarted(
            0.0, 0, hostile, hostile, hostile, hostile, hostile, hostile, hostile, hostile, hostile, 0,
            {hostile: hostile}, ({"path": "a", "parent": None, "kind": hostile, "type": hostile, "name": hostile,
            "description": hostile, "comment": hostile, "line": 1, "end_line": 1, "inputs": {hostile: hostile},
            "outputs": {}},), {}, 0.0, 0.02,
        )
    )  # fmt: skip
    reason = Reason("a", hostile, hostile, {hostile: hostile})
    outline = np.zeros((3, 2))
    view = ImageView(
        np.zeros((8, 8, 3), np.uint8), (Line2(outline, hostile, hostile),), caption=hostile
    )
    scene = SceneView(points=(Points3(np.zeros((1, 3)), hostile, hostile),), caption=hostile)
    series = SeriesView(np.zeros(2), {hostile: np.zeros(2)}, {hostile: 1.0})
    table = TableView((hostile,), ((hostile,),), hostile)
    for event in (
        NodeChanged(0.1, 1, "a", "FAILURE", hostile, 1, reason),
        PortWritten(0.1, 1, hostile, hostile, hostile, hostile),
        StateChanged(0.1, 1, hostile, hostile), LinkChanged(0.1, 1, hostile, hostile),
        OperatorActed(0.1, 1, hostile, hostile, hostile), SafeStopped(0.1, 1, hostile),
        *(Published(0.1, 1, "a", hostile, shown) for shown in (view, scene, series, table)),
    ):  # fmt: skip
        show.dashboard.hub.on_event(event)
    page = open_page()
    expect(page.locator("#latched-reason")).to_have_text(hostile)
    expect(page.locator("#tables")).to_contain_text(hostile)
    page.locator(".row").first.click()
    for tab in ("Values", "Events", "Node"):
        page.get_by_role("tab", name=tab).click()
    assert page.locator("img").count() == 2  # the mark and the camera's picture
    anew = TableView((hostile,), (("another value",),), hostile)
    show.dashboard.hub.on_event(Published(0.2, 2, "a", hostile, anew))
    expect(page.locator("#tables")).to_contain_text("another value")  # as many rows as before


def test_a_long_record_gives_its_details_where_one_looks(
    show: Show, open_page: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (record_messages, thinning, recording):
        for name, value in (("WHOLE", 10), ("WHOLE_BYTES", 10), ("PARTS", 8)):
            monkeypatch.setattr(module, name, value, raising=False)
    (show.records / "long_1").mkdir()
    recorder = Recorder(show.records / "long_1")
    node = {"path": "a", "parent": None, "kind": "skill", "type": "Rest", "name": "Walk", "line": 1}
    recorder.on_event(
        RunStarted(
            0.0,
            0,
            "long",
            "long",
            "",
            "",
            "",
            "fake",
            "mock",
            "",
            "",
            0,
            {},
            (node,),
            {},
            0.0,
            0.02,
        )
    )
    for tick in range(500):
        recorder.on_event(NodeChanged(tick * 0.2, tick, "a", "RUNNING", f"step {tick}", 1))
    recorder.on_event(RunEnded(100.0, 500, "success", None, 500, 100.0, 100.0, None))
    recorder.close()
    page = open_page("run=long_1&t=50.1")
    expect(page.locator("#connection")).to_have_text("recorded run")
    expect(row(page, "Walk").locator(".detail")).to_have_text("step 250")
    page.evaluate("location.hash = 'run=long_1&t=3.3'")
    expect(row(page, "Walk").locator(".detail")).to_have_text("step 16")


def test_runs_are_filtered_and_two_are_compared(show: Show, open_page: Open) -> None:
    show.record(JAM, "old_1", seed=1)
    show.record(BROKEN, "old_2", seed=2)
    page = open_page()
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#runs tbody tr")).to_have_count(2)
    page.get_by_label("result", exact=True).select_option("failure")
    expect(page.locator("#runs tbody tr")).to_have_count(1)
    page.get_by_label("result", exact=True).select_option("")
    expect(page.locator("#runs tbody tr")).to_have_count(2)
    page.get_by_label("tree of the runs").select_option("broken")
    expect(page.locator("#runs tbody tr")).to_have_count(1)
    page.get_by_label("tree of the runs").select_option("")
    expect(page.locator("#runs tbody tr")).to_have_count(2)
    page.get_by_label("compare old_1").check()
    page.get_by_label("compare old_2").check()
    page.get_by_role("button", name="Compare two").click()
    expect(page.locator("#comparison")).to_contain_text("JAMMED the wheel is stuck")
    expect(page.locator("#comparison tr.differs", has_text="outcome")).to_contain_text(
        "successfailure"
    )
    page.get_by_label("filter runs").fill("failure seed 2")
    expect(page.locator("#runs tbody tr")).to_have_count(1)
    page.get_by_role("button", name="old_2").click()
    expect(page.locator("#run")).to_have_text("broken · seed 2")


def test_fruit_and_damage_of_a_simulated_run_stand_in_its_row(show: Show, open_page: Open) -> None:
    show.record(JAM, "old_1")
    page = open_page()
    truth = {"put_away": 2, "bruised": 1, "drops": 0, "lost": 0, "collisions": 3}
    page.route("**/api/runs", lambda route: route.fulfill(json=with_truth(route.fetch(), truth)))
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#runs tbody .fruit")).to_have_text("2")
    expect(page.locator("#runs tbody .damage.warn")).to_have_text("1 bruised, 3 hit")


def test_fruit_and_press_that_the_robot_counts_stand_where_no_world_knows_better(
    show: Show, open_page: Open
) -> None:
    show.record(JAM, "old_1")
    page = open_page()
    account = {
        "count": 3,
        "pressed": "Lift: the pads pressed a fruit with 6.1 N, 0.59 of its limit",
    }
    page.route(
        "**/api/runs",
        lambda route: route.fulfill(
            json=[{**run, "truth": None, "account": account} for run in route.fetch().json()]
        ),
    )
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#runs tbody .fruit")).to_have_text("3")
    expect(page.locator("#runs tbody .damage")).to_contain_text("6.1 N, 0.59 of its limit")


def with_truth(answer: Any, truth: dict[str, int]) -> list[dict[str, Any]]:
    return [{**run, "truth": truth} for run in answer.json()]


def test_a_page_without_a_run_opens_the_newest_record_until_a_run_begins(
    show: Show, open_page: Open
) -> None:
    show.record(JAM, "2026-01-01_10-00-00_older", seed=1)
    show.record(BROKEN, "2026-01-02_10-00-00_newer", seed=2)
    show.dashboard.allow_starts(lambda _form: "demo", Choices.installed())
    page = open_page()
    expect(page.locator("#run")).to_have_text("broken · seed 2")
    expect(page.locator("#why")).to_contain_text("JAMMED")
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#control")).to_be_visible()  # a run can be started beside a record
    show.run(HOLD, seed=3)
    expect(page.locator("#run")).to_have_text("demo · seed 3")
    expect(page.locator("#state")).to_have_text("▶ running")
    GATE.set()


def test_a_comparison_gives_values_as_they_are_written(show: Show, open_page: Open) -> None:
    tree = "pomona: 1\ntree: high\nparameters: {height: {type: length, default: 150 mm}}\nroot:\n  Rest: {}\n"
    show.record(tree, "old_1")
    show.record(tree.replace("150 mm", "0.2 m"), "old_2")
    page = open_page()
    page.get_by_role("button", name="Runs").click()
    for run in ("old_1", "old_2"):
        page.get_by_label(f"compare {run}").check()
    page.get_by_role("button", name="Compare two").click()
    expect(page.locator("#comparison tr.differs", has_text="height").locator("td")).to_have_text(
        ["150 mm", "0.2 m", "≠"]
    )
    assert page.locator("#comparison .only").bounding_box()["width"] < 30


def test_a_thousand_nodes_are_searched_and_folded(show: Show, open_page: Open) -> None:
    leaves = "".join(f"    - Rest: {{}}\n      name: Rest {n}\n" for n in range(1000))
    show.record(f"pomona: 1\ntree: wide\nroot:\n  parallel:\n{leaves}", "wide_1")
    page = open_page("run=wide_1")
    expect(page.locator(".row")).to_have_count(1001)
    page.get_by_label("search nodes").fill("rest 99")
    expect(page.locator(".row:visible")).to_have_count(11)
    page.get_by_label("search nodes").fill("")
    page.get_by_role("button", name="Fold done").click()
    expect(page.locator(".row:visible")).to_have_count(1)


def test_a_connection_that_comes_back_goes_on_where_it_was(show: Show, open_page: Open) -> None:
    page = open_page()
    sockets: list[Any] = []

    def through(socket: Any) -> None:
        sockets.append(socket)
        socket.connect_to_server()

    page.route_web_socket("**/live*", through)
    page.reload()
    show.run(HOLD)
    expect(row(page, "Hold").locator(".icon")).to_have_attribute("aria-label", "running")
    before = len(sockets)
    sockets[-1].close(code=4000)
    expect(page.locator("#connection")).to_contain_text("connection lost")
    GATE.set()
    expect(page.locator("#state")).to_have_text("✓ success")
    expect(row(page, "Rest").locator(".icon")).to_have_attribute("aria-label", "success")
    first, second = (re.search(r"since=(\d+)&stream=(\w*)", sockets[at].url) for at in (0, before))
    assert first is not None
    assert second is not None
    assert int(first[1]) == 0
    assert int(second[1]) > 5
    assert second[2] == show.dashboard.hub.stream


def test_a_lost_connection_looks_lost(show: Show, chromium: Any) -> None:
    page = chromium.new_page()  # its console may complain: the server is gone
    page.goto(show.dashboard.link)
    expect(page.locator("#connection")).to_have_text("connected")
    show.close()
    expect(page.locator("#connection")).to_contain_text("connection lost")
    page.close()


def test_nothing_can_be_started_before_the_page_has_its_lists(show: Show, open_page: Open) -> None:
    show.dashboard.allow_starts(lambda *_: pytest.fail("nothing was chosen"), Choices.installed())
    page = open_page()
    page.evaluate("""() => {
        const plain = window.fetch, gate = new Promise((open) => { window.answer = open; });
        window.fetch = async (...of) => {
            if (String(of[0]).includes("/api/choices")) await gate;
            return plain(...of);
        };
    }""")
    take_control(page, "ada")
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#start-hint")).to_have_text("Reading trees and cells …")
    expect(page.locator("#start-button")).to_be_disabled()
    page.evaluate("() => window.answer()")
    expect(page.locator("#start-button")).to_be_enabled()
    expect(page.locator("#start-tree")).to_have_value("pick_apple")


def test_a_setting_that_cannot_be_used_is_marked_while_it_is_typed(
    show: Show, open_page: Open
) -> None:
    forms: list[Any] = []

    def judge(form: dict[str, Any]) -> dict[str, str]:
        forms.append(form)
        wrong = {"kind": ("stone", "there is no fruit 'stone'"), "looks": ("0", "0 is below 1")}
        return {
            name: words
            for name, (value, words) in wrong.items()
            if form["settings"].get(name) == value
        }

    show.dashboard.allow_starts(
        lambda *_: pytest.fail("nothing was started"), Choices.installed(), judge
    )
    page = open_page()
    take_control(page, "ada")
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#start-form .field:visible")).to_have_count(4)
    page.get_by_label("seed").fill("-1")
    expect(page.locator("#start-seed:invalid")).to_be_visible()
    page.get_by_label("seed").fill("")
    expect(page.locator("#start-seed:invalid")).to_be_visible()
    page.get_by_label("seed").fill("0")
    page.get_by_text("Parameters of the tree").click()
    field = page.locator("[data-setting=looks]")
    field.fill("0")
    expect(page.get_by_text("0 is below 1")).to_be_visible()
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(page.locator("#start-button")).to_be_disabled()
    expect(page.locator("#start-hint")).to_have_text("looks cannot be used.")
    expect(page.locator(".changes").first).to_have_text("1 changed")
    field.fill("2")
    expect(page.locator("#start-button")).to_be_enabled()
    page.locator("[data-setting=kind]").fill("stone")
    expect(page.get_by_text("there is no fruit 'stone'")).to_be_visible()
    expect(page.locator("#start-button")).to_be_disabled()
    assert forms[-1]["settings"] == {"looks": "2", "kind": "stone"}
    assert (forms[-1]["tree"], forms[-1]["cell"]) == ("pick_apple", "sim")
    expect(page.locator("#by-hand-about")).to_contain_text("A simulated cell begins anew")
    page.locator("#start-cell").select_option("emulated")
    expect(page.locator("#by-hand-motions button")).to_have_text(
        ["Put down the held fruit", "Home, slowly"]
    )
    expect(page.locator("#by-hand-motions button").first).to_be_enabled()
    page.get_by_text("Options of the cell").click()
    page.locator("[data-setting=arm]").fill("lab:53200")
    page.locator(
        "#by-hand-motions button"
    ).last.click()  # shows what would move, and starts nothing
    expect(page.locator("#by-hand-motions button").last).to_contain_text(
        re.compile("Look at the hand, then: Home, slowly on emulated, .*arm lab:53200")
    )


def test_modifiers_are_chips_and_skipped_branches_are_folded(show: Show, open_page: Open) -> None:
    tree = """pomona: 1
tree: chips
parameters:
  pause: {type: time, default: 20 ms}
root:
  fallback:
    - sequence:
        - Rest: {duration: "{pause}"}
          timeout: 5 s
        - Jam: {}
          retry: 2
      name: First way
    - Rest: {duration: 40 ms}
      name: Second way
    - Rest: {}
      name: Third way
"""
    show.record(tree, "old_1")
    page = open_page("run=old_1")
    expect(row(page, "Jam").locator(".chip")).to_have_text("retry 2/2")
    expect(row(page, "Rest").locator(".chip")).to_have_text("timeout 5 s")
    expect(page.locator(".row:visible")).to_have_count(5)
    expect(row(page, "Third way")).to_be_hidden()
    more = page.locator(".row .more:visible")
    expect(more).to_have_text("+1")
    more.click()
    expect(row(page, "Third way")).to_be_visible()
    row(page, "Jam").locator(".chip").click()
    expect(page.locator("#node .about")).to_contain_text("retry")
    row(page, "Rest").locator(".name").click()
    expect(page.locator("#node .wires")).to_contain_text("20 ms{pause}")


@pytest.mark.slow
def test_a_simulated_pick_is_started_from_the_page_and_watched_to_its_end(
    show: Show, open_page: Open
) -> None:
    choices = Choices.installed()
    launcher = Launcher(show.dashboard, show.records, choices)
    show.dashboard.allow_starts(launcher.start, choices)
    page = open_page()
    take_control(page, "ada")
    page.get_by_role("button", name="Runs").click()
    page.get_by_label("seed").fill("1")
    page.get_by_text("How it runs").click()
    page.locator("#start-pace").select_option("fast")
    page.get_by_role("button", name="Start", exact=True).click()
    expect(page.locator("#preparing-what")).to_have_text("◌ Preparing pick_apple")
    expect(page.locator("#preparing-words")).to_contain_text("preparing", timeout=180_000)
    expect(page.locator("#kind")).to_have_text("SIMULATED")
    expect(page.locator("#state")).to_have_text("✓ success", timeout=240_000)
    expect(page.locator("#camera img")).to_be_visible()
    expect(page.locator("#plots .plot").first).to_be_visible()
    assert [path.name for path in Path(show.records).glob("*_pick_apple")]
    launcher.close()


def test_the_arm_is_slowed_down_with_the_keyboard_and_every_page_shows_it(
    show: Show, open_page: Open
) -> None:
    page, other = open_page(), open_page()
    show.run(HOLD)
    speed = page.locator("#arm-speed")
    expect(speed).to_be_disabled()
    take_control(page, "ada")
    expect(speed).to_be_enabled()
    page.locator("#tree").press("v")
    expect(speed).to_be_focused()
    for _ in range(7):
        speed.press("ArrowLeft")
    expect(page.locator("#arm-speed-words")).to_have_text("30 %")
    expect(other.locator("#arm-speed-words")).to_have_text("30 %")
    expect(other.locator("#arm-speed")).to_be_disabled()
    expect(page.locator("#ack")).to_contain_text("last: speed by ada")
    later = open_page()
    expect(later.locator("#arm-speed-words")).to_have_text("30 %")
    GATE.set()
    expect(page.locator("#state")).to_have_text("✓ success")
