"""In every state of a run, at four sizes, all texts are in sight, and SAFE STOP can be pressed.

`make screens` leaves a picture of each state at each size in runs/screens.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from shown_runs import APPROVED, DRAWN, GATE, HOLD, SIZES, Show, Wire, press_stop

from pomona.executive.running.events import ErrorRaised, LinkChanged, Published, SafeStopped
from pomona.executive.views import TableView
from pomona.tools.dashboard.choices import Choices

pytestmark = pytest.mark.browser

MEASURE = Path(__file__).with_name("in_sight.js").read_text(encoding="utf-8")
ASKED = "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - ask: is the crate below the gripper, and is it empty?\n"
JAMMED = "pomona: 1\ntree: demo\nroot:\n  Jam: {}\n  retry: 3\n"
LOOKED = "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n    - Hold: {}\n"
Open = Callable[..., Any]


def expect(locator: Any) -> Any:
    from playwright.sync_api import expect as playwright_expect

    return playwright_expect(locator)


def in_sight(page: Any, state: str) -> list[str]:
    """Return the problems at each size."""
    problems = []
    for size, (width, height) in SIZES.items():
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate(DRAWN)
        problems += [f"{state}, {size}: {problem}" for problem in page.evaluate(MEASURE)]
        if folder := os.environ.get("SCREENS"):
            page.screenshot(path=Path(folder) / f"{state}_{width}x{height}.png")
    return problems


def take_control(page: Any) -> None:
    page.get_by_label("your name").fill("Ada of the long surname")
    page.locator("#control [data-action=take]").click()
    expect(page.locator("#holder")).to_have_text("You hold control.")


def test_while_a_run_is_prepared_runs_is_paused_and_is_stopped(show: Show, open_page: Open) -> None:
    page = open_page()
    expect(page.locator("#connection")).to_have_text("connected")
    problems = in_sight(page, "idle")
    starting = show.dashboard.control.prepare("pick_apple")
    starting.reach("preparing SlipAvoidGrasp and everything it needs", 2, 9)
    expect(page.locator("#preparing-words")).to_contain_text("3 of 9")
    problems += in_sight(page, "preparing")
    show.dashboard.control.clear(
        "the cell's controller at 192.168.255.1 did not answer within 5 s: is it switched on?"
    )
    expect(page.locator("#problem")).to_be_visible()
    problems += in_sight(page, "not_begun")
    page.set_viewport_size({"width": 1440, "height": 900})
    page.locator("#problem-close").click()
    show.run(LOOKED)
    expect(page.locator("#state")).to_have_text("▶ running")
    problems += in_sight(page, "running")
    page.set_viewport_size({"width": 1440, "height": 900})
    take_control(page)
    page.locator(".row", has_text="Hold").click()
    page.get_by_role("button", name="Break after").click()
    expect(page.locator("#breaks")).to_have_text("◉ Breakpoints: after Hold")
    page.get_by_role("button", name="Pause").click()
    expect(page.locator("#state")).to_have_text("❚❚ paused")
    problems += in_sight(page, "paused")
    press_stop(page)
    expect(page.locator("#latched")).to_be_visible()
    problems += in_sight(page, "stopped")
    hear = show.dashboard.hub.on_event
    hear(
        SafeStopped(
            0.1, 1, "the arm's controller has not answered for 123 ms, which is longer than 100 ms"
        )
    )
    hear(
        ErrorRaised(
            0.1,
            1,
            "",
            "letting go",
            "PomonaError",
            "the cell has not come to rest within 10 s",
            "",
            "",
        )
    )
    hear(LinkChanged(0.2, 2, "arm", "lost: no answer for 123 ms"))
    expect(page.locator("#latched-rest")).to_contain_text("No feedback from arm")
    problems += in_sight(page, "lost_device")
    assert problems == []


def test_before_the_first_run_the_page_states_what_it_shows_and_how_a_run_begins(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    expect(page.locator("#why")).to_contain_text("A run is shown here live: its tree, the camera")
    expect(page.locator("#why")).to_contain_text("It appears when the program begins it.")
    expect(page.locator("#steps")).to_have_text("Open a run")
    show.dashboard.allow_starts(lambda _form: "", Choices.installed())
    expect(page.locator("#why")).to_contain_text("The button opens the form that starts one")
    expect(page.locator("#steps")).to_have_text("Start or open a run")
    assert in_sight(page, "before_the_first_run") == []


def test_while_a_person_is_asked(show: Show, open_page: Open) -> None:
    page = open_page()
    runner = show.run(ASKED)
    expect(page.locator("#questions")).to_contain_text("is the crate below")
    problems = in_sight(page, "asking")
    page.set_viewport_size({"width": 1440, "height": 900})
    take_control(page)
    problems += in_sight(page, "asking_who_holds_control")
    runner.stop()
    expect(page.locator("#state")).to_have_text("■ stopped")
    runner.acknowledge()
    show.run(APPROVED, "demo_2")
    expect(page.locator("#questions")).to_contain_text("May Rest start?")
    problems += in_sight(page, "approving")
    assert problems == []


def test_when_it_failed_and_beside_a_live_run(show: Show, open_page: Open) -> None:
    show.record(JAMMED, "old_1")
    page = open_page("run=old_1")
    expect(page.locator("#why")).to_contain_text("the wheel is stuck")
    problems = in_sight(page, "recorded")
    show.run(HOLD)
    expect(page.locator("#strip-state")).to_have_text("LIVE: ▶ running")
    problems += in_sight(page, "recorded_beside_live")
    page.locator("#safe-stop").click()
    expect(page.locator("#strip-state")).to_have_text("LIVE: ■ safe state, latched")
    problems += in_sight(page, "recorded_beside_stopped")
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#runs tbody tr").first).to_be_visible()
    problems += in_sight(page, "list_of_runs")
    assert problems == []


def test_a_reason_that_is_known_stays_while_the_server_is_silent(show: Show, chromium: Any) -> None:
    show.record(JAMMED, "old_1")
    page = chromium.new_page()
    wire = Wire(page)
    page.goto(f"{show.dashboard.link}&run=old_1")
    expect(page.locator("#why")).to_contain_text("the wheel is stuck")
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#runs tbody tr")).to_have_count(1)
    wire.open = False
    expect(page.locator("#not-live")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#why")).to_be_visible()
    problems = in_sight(page, "recorded_and_silent")
    page.evaluate("() => { location.hash = ''; }")
    page.route("**/api/runs/old_1/**", lambda _route: None)  # it is never answered
    page.get_by_role("button", name="Runs").click()
    page.locator(".open-run").click()
    expect(page.locator("#why .verdict")).to_have_text("failure: JAMMED the wheel is stuck.")
    page.close()
    assert problems == []


def test_in_the_safe_state_nothing_looks_alive_and_ages_grow_on(
    show: Show, open_page: Open
) -> None:
    page = open_page(viewport={"width": 1280, "height": 800})
    runner = show.run(LOOKED)
    expect(page.locator(".keys b").first).to_be_visible()
    show.dashboard.hub.on_event(
        Published(0.0, 1, "", "tally", TableView(("fruit",), (("apple",),), "one fruit"))
    )
    expect(page.locator("#camera-age")).to_have_text(re.compile("now|ago"))
    runner.safe_stop("a test", "ada")
    expect(page.locator("#latched")).to_be_visible()
    expect(page.locator(".keys b")).to_have_text(["–", "–"])
    colours = page.evaluate(LIVELY)
    assert colours == []
    for age in ("#camera-age", "#scene-age", ".plot .age >> nth=0", "#tables caption small"):
        expect(page.locator(age)).to_have_text(re.compile(r"^\d.* ago$"))
    first = page.locator("#camera-age").text_content()
    expect(page.locator("#camera-age")).not_to_have_text(first)
    runner.acknowledge("ada")
    expect(page.locator(".link.still")).to_have_text("wheel: closed")


LIVELY = """() => [...document.querySelectorAll("#camera, .stage, #plots, #tables, .link")].filter((e) => {
    const rgb = getComputedStyle(e).color.match(/\\d+/g).slice(0, 3).map(Number), { filter } = getComputedStyle(e);
    return filter !== "grayscale(1)" && Math.max(...rgb) - Math.min(...rgb) > 40; }).map((e) => e.id || e.className)"""


def test_when_nothing_is_heard_and_when_the_page_cannot_act(show: Show, chromium: Any) -> None:
    page = chromium.new_page()
    wire = Wire(page)
    page.goto(show.dashboard.link)
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    wire.open = False
    expect(page.locator("#not-live")).to_be_visible()
    problems = in_sight(page, "stale")
    press_stop(page)
    expect(page.locator("#press-what")).to_have_text("SAFE STOP NOT CONFIRMED")
    problems += in_sight(page, "stale_and_stop_not_confirmed")
    page.close()
    page = chromium.new_page()
    page.goto(show.dashboard.access.address)
    expect(page.locator("#safe-stop-words")).to_have_text("this page only watches")
    problems += in_sight(page, "disarmed")
    press_stop(page)
    expect(page.locator("#press-what")).to_have_text("SAFE STOP NOT CARRIED OUT")
    problems += in_sight(page, "disarmed_and_stop_refused")
    page.close()
    GATE.set()
    assert problems == []


def test_when_the_program_was_closed_after_its_run(show: Show, chromium: Any) -> None:
    page = chromium.new_page()
    page.goto(show.dashboard.link)
    show.run("pomona: 1\ntree: demo\nroot:\n  Rest: {}\n")
    expect(page.locator("#state")).to_have_text("✓ success")
    show.close()
    expect(page.locator("#why")).to_contain_text("Its program was closed")
    problems = in_sight(page, "closed")
    page.close()
    assert problems == []


def test_what_picks_show_of_the_camera_stands_below_the_curves_not_beside_the_result(
    show: Show, open_page: Open
) -> None:
    page = open_page(viewport={"width": 1280, "height": 800})
    show.run(LOOKED)
    expect(page.locator("#state")).to_have_text("▶ running")
    words = "The camera sits 6.1 ± 0.4 mm to the left of where the cell file has it (12 picks)."
    for sentence in ("The camera's place is not known from 1 pick.", words):
        table = TableView(("camera",), ((sentence,),), "the camera, from the touches of the pads")
        show.dashboard.hub.on_event(Published(0.2, 1, "", "camera", table))
        expect(page.locator("#tables tbody tr")).to_have_text(sentence)
    expect(page.locator("#why")).not_to_contain_text("camera")
    GATE.set()
    assert in_sight(page, "camera_off") == []
