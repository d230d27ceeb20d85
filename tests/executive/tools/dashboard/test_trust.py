"""In a real browser: unknown states are not shown as present, unconfirmed actions not as done."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from shown_runs import APPROVED, GATE, HOLD, Show, Wire, press_stop

from pomona.executive.running.events import (
    Computed,
    ErrorRaised,
    LinkChanged,
    NodeChanged,
    OperatorActed,
    SafeStopped,
)

pytestmark = pytest.mark.browser

Open = Callable[..., Any]


def expect(locator: Any) -> Any:
    from playwright.sync_api import expect as playwright_expect

    return playwright_expect(locator)


def test_a_page_without_messages_reports_it_within_two_seconds_and_a_stop_is_tried_until_it_is_confirmed(
    show: Show, chromium: Any
) -> None:
    page = chromium.new_page()  # its console may complain: requests fail
    page.clock.install()
    wire = Wire(page)
    page.goto(show.dashboard.link)
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    page.clock.pause_at(
        page.evaluate("Date.now() + 100")
    )  # from here on the page's time is the test's
    while page.locator("#not-live").is_visible():  # a busy machine was silent for a while itself
        page.clock.run_for(100)
    wire.open = False
    page.clock.run_for(2_000)
    expect(page.locator("#not-live")).to_be_visible()
    page.clock.resume()
    expect(page.locator("#not-live-words")).to_contain_text("the cell may have moved since")
    expect(page.locator("#state")).to_have_text("? last known: running")
    expect(page.locator("body")).to_have_class(re.compile("stale"))
    press_stop(page)
    expect(page.locator("#press-what")).to_have_text("SAFE STOP NOT CONFIRMED")
    expect(page.locator("#press-words")).to_contain_text("press the EMERGENCY STOP")
    expect(page.locator("#press-words")).to_contain_text(
        re.compile(r"after ([2-9]|\d\d) tries.*Error: the server cannot")
    )
    expect(page.locator("#safe-stop")).not_to_have_attribute("aria-disabled", "true")
    assert show.cell.latched is None
    wire.open = True
    expect(page.locator("#latched-rest")).to_have_text(re.compile(r"^Confirmed after \d+ ms\. "))
    assert show.cell.latched == "safe stop by operator"
    expect(page.locator("#not-live")).to_be_hidden()
    page.close()


def test_a_program_that_is_closed_after_its_run_raises_no_alarm(show: Show, chromium: Any) -> None:
    page = chromium.new_page()  # its console may complain: it tries to connect again
    page.goto(show.dashboard.link)
    show.run("pomona: 1\ntree: demo\nroot:\n  Rest: {}\n")
    expect(page.locator("#state")).to_have_text("✓ success")
    show.close()
    expect(page.locator("#why")).to_contain_text(
        re.compile(r"The run has ended\. Its program was closed at [\d:]+")
    )
    page.wait_for_function(
        "async () => (await import('/static/link.js')).age() > 2"
    )  # else an alarm may come later
    expect(page.locator("#not-live")).to_be_hidden()
    expect(page.locator("body")).not_to_have_class(re.compile("stale"))
    expect(page.locator("#state")).to_have_text("✓ success")
    expect(page.locator("#connection")).to_have_text("program closed")
    expect(page.locator("#safe-stop-words")).to_have_text("the program is closed")
    expect(page.locator("#control")).to_be_hidden()
    page.close()


def test_a_program_that_ends_during_its_run_is_not_live(show: Show, chromium: Any) -> None:
    page = chromium.new_page()
    page.goto(show.dashboard.link)
    runner = show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    show.dashboard.close()
    expect(page.locator("#not-live-words")).to_contain_text("the cell may have moved since")
    runner.stop()
    page.close()


def test_a_stop_is_confirmed_at_once_by_the_run(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    page.locator("#safe-stop").click()
    expect(page.locator("#latched-reason")).to_have_text("safe stop by operator")
    expect(page.locator("#latched-rest")).to_contain_text(
        re.compile(r"Confirmed after \d+ ms\. The cell reports standstill")
    )
    expect(page.locator("#banner > :visible")).to_have_count(1)


@pytest.mark.parametrize(
    ("fragment", "words"),
    [("", "this page only watches"), ("#token=of-yesterday", "this page is of another start")],
)
def test_a_page_that_cannot_act_looks_disarmed_and_reports_that_a_stop_was_not_carried_out(
    show: Show, chromium: Any, fragment: str, words: str
) -> None:
    page = chromium.new_page()
    page.goto(f"{show.dashboard.access.address}{fragment}")
    show.run(HOLD)
    expect(page.locator("#safe-stop-words")).to_have_text(words)
    expect(page.locator("#safe-stop")).to_have_class(re.compile("disarmed"))
    page.locator("#safe-stop").click(force=True)
    expect(page.locator("#press-what")).to_have_text("SAFE STOP NOT CARRIED OUT")
    expect(page.locator("#press-words")).to_contain_text("open the link that was printed")
    assert show.cell.latched is None
    page.close()


def test_a_page_whose_scripts_do_not_come_looks_disarmed(show: Show, chromium: Any) -> None:
    page = chromium.new_page()
    page.route("**/app.js", lambda route: route.abort())
    page.goto(show.dashboard.link)
    expect(page.locator("#safe-stop-words")).to_have_text("the page is not ready")
    expect(page.locator("#safe-stop")).to_have_class(re.compile("disarmed"))
    page.close()


def test_the_live_cell_stays_in_sight_and_can_be_stopped_over_a_record(
    show: Show, open_page: Open
) -> None:
    show.record("pomona: 1\ntree: old\nroot:\n  sequence:\n    - Rest: {}\n", "old_1")
    page = open_page("run=old_1")
    expect(page.locator("#connection")).to_have_text("recorded run")
    expect(page.locator("#strip-state")).to_have_text("LIVE: nothing runs")
    show.run(HOLD)
    expect(page.locator("#strip-state")).to_have_text("LIVE: ▶ running")
    expect(page.locator("#strip-words")).to_contain_text("demo on fake")
    expect(page.locator("#run")).to_have_text("old · seed 0")  # still the record
    assert "Nothing here moves" not in page.locator("body").inner_text()
    press_stop(page)
    expect(page.locator("#strip-state")).to_have_text("LIVE: ■ safe state, latched")
    expect(page.locator("#strip-words")).to_have_text(
        "safe stop by operator. Go back to live to reset it."
    )
    assert show.cell.latched == "safe stop by operator"
    page.get_by_role("button", name="Back to live").click()
    expect(page.locator("#latched")).to_be_visible()
    expect(page.locator("#run")).to_have_text("demo · seed 0")
    expect(page.locator("#strip")).to_be_hidden()


def test_escape_closes_an_open_picture_and_stops_when_pressed_twice(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    page.keyboard.press("/")
    page.keyboard.type("hold")
    page.keyboard.press("Escape")
    expect(page.get_by_label("search nodes")).not_to_be_focused()
    page.keyboard.press("?")
    page.keyboard.press("Escape")
    expect(page.locator("#keys")).to_be_hidden()
    page.locator("[data-enlarge=camera]").click()
    page.keyboard.press("Escape")
    expect(page.locator("body")).to_have_attribute("data-large", "")
    assert show.cell.latched is None
    page.keyboard.press("Escape")
    expect(page.locator("#safe-stop-words")).to_have_text("Esc again stops")
    expect(page.locator("#safe-stop-words")).to_have_text(
        "not the emergency stop"
    )  # too late for the second
    page.keyboard.press("Escape")
    assert show.cell.latched is None
    page.keyboard.press("Escape")
    expect(page.locator("#latched")).to_be_visible()


def test_a_run_that_is_prepared_is_shown_with_its_progress_and_is_stopped(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    desk = show.dashboard.control
    starting = desk.prepare("pick_apple")
    starting.cell_kind = "simulated"
    starting.reach("preparing Detect", 2, 9)
    expect(page.locator("#state")).to_have_text("◌ preparing")
    expect(page.locator("#kind")).to_have_text("SIMULATED")
    expect(page.locator("#preparing-what")).to_have_text("◌ Preparing pick_apple")
    expect(page.locator("#preparing-words")).to_contain_text("preparing Detect, 3 of 9")
    expect(page.locator("#why-bar")).to_be_hidden()  # one banner at a time
    press_stop(page)
    expect(page.locator("#press-words")).to_have_text(
        "the run that was being prepared does not begin"
    )
    expect(page.locator("#preparing-words")).to_contain_text("Cancelled (safe stop by operator)")
    desk.clear("safe stop by operator")
    expect(page.locator("#problem-words")).to_have_text(
        "pick_apple did not start: safe stop by operator"
    )
    page.locator("#problem-close").click()
    expect(page.locator("#problem")).to_be_hidden()


def test_the_run_before_is_dimmed_while_another_one_is_prepared(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    show.run("pomona: 1\ntree: demo\nroot:\n  Rest: {}\n")
    expect(page.locator("#state")).to_have_text("✓ success")
    show.dashboard.control.prepare("pick_apple")
    expect(page.locator("#preparing-words")).to_contain_text("Below: the run before")
    expect(page.locator("#run-view")).to_have_css("opacity", "0.45")
    expect(page.locator("#clock")).to_have_text("")
    show.dashboard.control.clear("cancelled")
    expect(page.locator("#run-view")).to_have_css("opacity", "1")


def test_the_banner_claims_no_unreported_rest(show: Show, open_page: Open) -> None:
    page = open_page()
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    hear = show.dashboard.hub.on_event
    hear(SafeStopped(0.1, 1, "arm lost"))
    expect(page.locator("#latched-rest")).to_have_text(
        "Stop requested; standstill not yet reported."
    )
    hear(
        ErrorRaised(
            0.1, 1, "", "letting go", "PomonaError", "the cell has not come to rest", "", ""
        )
    )
    expect(page.locator("#latched-rest")).to_contain_text(
        "Standstill not confirmed: the cell has not come to rest"
    )
    hear(LinkChanged(0.2, 2, "arm", "lost"))
    expect(page.locator("#latched-rest")).to_contain_text(
        "No feedback from arm: its motion is unknown."
    )


def test_skills_that_compute_show_their_time_and_old_values_are_not_called_stale(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    show.run(
        "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n    - Hold: {}\n"
    )
    expect(page.locator("#camera img")).to_be_visible()
    hear = show.dashboard.hub.on_event
    row = page.locator(".row", has=page.get_by_text("Look", exact=True)).first
    path = row.get_attribute("data-path")
    hear(NodeChanged(90.0, 4500, path, "RUNNING", "", 2))
    hear(Computed(90.0, 4500, path, "detect", 1.25))
    hear(NodeChanged(90.0, 4500, path, "SUCCESS", "", 2))
    expect(row.locator(".time")).to_have_text("computed 1.3 s")
    expect(page.locator("#camera-age")).to_have_text(re.compile(r"^1 min \d+ s ago$"))
    assert "stale" not in page.locator("main").first.inner_text()


def test_a_camera_that_delivers_pictures_is_shown_live_with_the_last_look_in_a_corner(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    show.run(
        "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n    - Hold: {}\n"
    )
    expect(page.locator("#camera .picture > img")).to_be_visible()
    expect(page.locator("#camera-age")).not_to_contain_text("live")
    picture = np.full((48, 64, 3), 120, np.uint8), 0.0
    show.cell.pictures = lambda: {"eye": picture}  # type: ignore[method-assign]
    expect(page.locator("#camera-age")).to_have_text(re.compile(r"^live · eye; last look .* ago$"))
    expect(page.locator("#camera .live")).to_have_attribute("src", re.compile("^data:image/jpeg"))
    expect(page.locator("#camera .inset polygon")).to_have_count(1)
    GATE.set()
    expect(page.locator("#state")).to_have_text("✓ success")
    expect(page.locator("#camera .live")).to_have_count(0)


def test_a_page_whose_answer_is_lost_still_knows_that_it_holds_control(
    show: Show, open_page: Open
) -> None:
    page = open_page("")
    dropped: list[str] = []

    def drop_answers(socket: Any) -> None:
        server = socket.connect_to_server()
        socket.on_message(server.send)
        server.on_message(
            lambda text: dropped.append(text) if '"Pressed"' in text else socket.send(text)
        )

    page.route_web_socket("**/live*", drop_answers)
    page.reload()
    expect(page.locator("#connection")).to_have_text("connected")
    page.get_by_label("your name").fill("ada")
    page.locator("#control [data-action=take]").click()
    expect(page.locator("#holder")).to_have_text("You hold control.")
    assert dropped
    page.get_by_role("button", name="Give back").click()
    expect(page.locator("#holder")).to_have_text("No operator holds control.")


def test_a_page_that_holds_control_and_falls_silent_is_reported_to_the_others(
    show: Show, open_page: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pomona.tools.dashboard.server.PAGE_SILENT", 0.9)
    page, other = open_page(), open_page()
    page.get_by_label("your name").fill("ada")
    page.locator("#control [data-action=take]").click()
    expect(other.locator("#holder")).to_have_text("ada holds control.")
    page.close()
    expect(other.locator("#holder")).to_have_text(
        "ada holds control, but that page is not connected."
    )


def test_a_press_that_the_run_does_not_answer_is_not_taken_for_done(
    show: Show, open_page: Open
) -> None:
    page = open_page()
    runner = show.run(HOLD)
    page.get_by_label("your name").fill("ada")
    page.locator("#control [data-action=take]").click()
    expect(page.locator("#holder")).to_have_text("You hold control.")
    runner.pause = lambda who="": None  # type: ignore[method-assign]  # a tick that hangs takes no commands
    page.get_by_role("button", name="Pause").click()
    expect(page.locator("#press-what")).to_have_text("PAUSE NOT CONFIRMED")
    expect(page.locator("#press-words")).to_contain_text("the run has not confirmed it")
    show.dashboard.hub.on_event(OperatorActed(1.0, 1, "ada", "pause", ""))
    expect(page.locator("#press")).to_be_hidden()
    GATE.set()


def test_a_plan_is_shown_and_waits_for_an_operator_that_may_change_it_first(
    show: Show, open_page: Open
) -> None:
    page = open_page(viewport={"width": 1280, "height": 720})
    show.run(APPROVED)
    expect(page.locator("#questions")).to_contain_text("May Rest start? The plan is shown.")
    expect(page.locator("#questions").get_by_role("button", name="Approve")).to_be_disabled()
    expect(page.locator("#camera")).to_be_hidden()
    expect(page.locator("#scene-legend")).to_contain_text("planned path")
    page.wait_for_function(
        "() => document.getElementById('scene').getBoundingClientRect().height > 250"
    )  # it has room
    page.get_by_label("your name").fill("ada")
    page.locator("#control [data-action=take]").click()
    page.locator(".row .name", has_text="Rest").last.click()
    field = page.get_by_label("input = value")
    field.fill("durable=60 ms")
    field.press("Enter")
    expect(page.locator("#connection")).to_contain_text("has no input 'durable'")
    field.fill("duration=60 ms")
    field.press("Enter")
    page.locator("#tree").focus()
    expect(page.locator("#node .changed")).to_contain_text(
        "duration = 60 ms from its next start on, by ada"
    )
    page.locator("#questions").get_by_role("button", name="Approve").click()
    expect(page.locator("#questions")).to_be_hidden()
    expect(page.locator("#camera")).to_be_visible()
    expect(
        page.locator(".row", has=page.get_by_text("Hold", exact=True)).locator(".icon")
    ).to_have_attribute("aria-label", "running")
    GATE.set()
