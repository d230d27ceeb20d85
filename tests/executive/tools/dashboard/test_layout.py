"""Panels are resized and stay so; one picture fills the middle."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from shown_runs import DRAWN, GATE, HOLD, SIZES, Show

pytestmark = pytest.mark.browser

LOOK = "pomona: 1\ntree: old\nroot:\n  sequence:\n    - Look: {seen: '{seen}'}\n"


def expect(locator: Any) -> Any:
    from playwright.sync_api import expect as playwright_expect

    return playwright_expect(locator)


def box(page: Any, selector: str) -> dict[str, float]:
    found: dict[str, float] = page.locator(selector).bounding_box()
    return found


def wait_for_size(page: Any, selector: str, width: float, height: float) -> None:
    """Until something is larger than this: a scene is shown once there is something in it."""
    page.wait_for_function(
        "([what, w, h]) => { const { width, height } = document.querySelector(what).getBoundingClientRect();"
        " return width >= w && height >= h; }",
        arg=[selector, width, height],
    )


def test_panels_are_resized_with_mouse_and_keys_and_stay_so(
    show: Show, open_page: Callable[..., Any]
) -> None:
    page = open_page(viewport={"width": 1440, "height": 900})
    expect(page.locator("#connection")).to_have_text("connected")
    before = box(page, ".tree-panel")["width"]
    grip = box(page, ".handle.left")
    page.mouse.move(grip["x"] + 3, 400)
    page.mouse.down()
    page.mouse.move(grip["x"] + 123, 400)
    page.mouse.up()
    wide = box(page, ".tree-panel")["width"]
    assert wide == pytest.approx(before + 120, abs=10)
    page.reload()
    expect(page.locator("#connection")).to_have_text("connected")
    assert box(page, ".tree-panel")["width"] == pytest.approx(wide, abs=1)
    page.locator(".handle.left").dblclick()
    assert box(page, ".tree-panel")["width"] == pytest.approx(before, abs=25)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_scene_fills_the_middle_when_it_is_wanted_large(
    show: Show, open_page: Callable[..., Any]
) -> None:
    show.record(LOOK, "old_1")
    page = open_page("run=old_1", viewport={"width": 1440, "height": 900})
    expect(page.locator("#connection")).to_have_text("recorded run")
    page.locator("[data-enlarge=scene]").click()
    wait_for_size(page, "#scene", 600, 380)
    expect(page.locator("#camera")).to_be_hidden()
    page.reload()
    expect(page.locator("#connection")).to_have_text("recorded run")
    wait_for_size(page, "#scene", 600, 380)
    page.locator("[data-enlarge=scene]").click()
    expect(page.locator("#camera")).to_be_visible()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "height", "unfolded"), [(1280, 800, False), (1600, 900, True), (390, 844, False)]
)
def test_the_legend_of_a_small_scene_is_folded_until_it_is_wanted(
    show: Show, open_page: Callable[..., Any], width: int, height: int, unfolded: bool
) -> None:
    show.record(LOOK, "old_1")
    page = open_page("run=old_1", viewport={"width": width, "height": height})
    label, stage = page.locator("#scene-labels", has_text="planned path"), page.locator(".stage")
    expect(page.locator("#connection")).to_have_text("recorded run")
    expect(page.locator("#scene-legend")).to_be_visible()
    page.evaluate(DRAWN)
    expect(label).to_be_visible(visible=unfolded)
    before = stage.bounding_box()
    page.locator("#scene-legend summary").press("Enter")
    expect(label).to_be_visible(visible=not unfolded)
    assert stage.bounding_box() == before
    page.locator("#scene-legend summary").press("Space")
    expect(label).to_be_visible(visible=unfolded)
    page.locator("[data-enlarge=scene]").click()  # a choice stays, whatever room there is
    expect(page.locator("#camera")).to_be_hidden()
    page.evaluate(DRAWN)
    expect(label).to_be_visible(visible=unfolded)


@pytest.mark.parametrize("large", ["", "scene"])
def test_on_a_phone_the_camera_or_a_large_scene_stands_above_the_tree(
    show: Show, open_page: Callable[..., Any], large: str
) -> None:
    show.record(LOOK, "old_1")
    page = open_page("run=old_1", viewport={"width": 390, "height": 844})
    expect(page.locator("#connection")).to_have_text("recorded run")
    if large:
        page.locator(f"[data-enlarge={large}]").click()
    page.evaluate(DRAWN)
    seen = box(page, f".{large or 'camera'}-panel")
    assert seen["y"] + seen["height"] <= box(page, ".tree-panel")["y"]
    assert box(page, "#why")["y"] < seen["y"]


def test_a_stretch_of_the_curves_is_zoomed_into_and_a_double_click_goes_back(
    show: Show, open_page: Callable[..., Any]
) -> None:
    show.record(LOOK, "old_1")
    page = open_page("run=old_1", viewport={"width": 1280, "height": 800})
    plot = page.locator(".plot .u-over").first
    expect(plot).to_be_visible()
    page.evaluate(DRAWN)  # a second plot has taken its half of the panel
    moment = "document.querySelector('.plot .plot-cursor').dataset.place"
    before, there = page.evaluate(moment), plot.bounding_box()
    page.mouse.move(there["x"] + 10, there["y"] + 20)
    page.mouse.down()
    page.mouse.move(there["x"] + there["width"] / 2, there["y"] + 20, steps=4)
    page.mouse.up()
    page.wait_for_function(
        f"(place) => {moment} !== place", arg=before
    )  # the shorter stretch has it elsewhere
    plot.dblclick()
    page.wait_for_function(f"(place) => {moment} === place", arg=before)


def test_lane_and_row_of_the_running_skill_are_in_sight_at_any_moment(
    show: Show, open_page: Callable[..., Any]
) -> None:
    rests = "".join(f"    - Rest: {{}}\n      name: Rest {i}\n" for i in range(30))
    show.record(f"pomona: 1\ntree: long\nroot:\n  sequence:\n{rests}", "old_1")
    page = open_page("run=old_1&t=2.85", viewport={"width": 1280, "height": 800})
    expect(page.locator("#connection")).to_have_text("recorded run")
    row = page.locator(".row.busy.leaf")
    expect(row).to_contain_text("Rest 28")
    expect(row).to_be_in_viewport()
    expect(page.locator("#node .about")).to_contain_text("Rest 28")  # nothing is chosen yet
    timeline = page.locator("#timeline")
    expect(timeline).to_have_attribute("data-first", re.compile("2[0-8]"))
    timeline.press("Home")
    expect(timeline).to_have_attribute("data-first", "0")


GRIP = """async () => { // four forces, a speed and a width
    const { page } = await import("/static/page.js");
    const { apply } = await import("/static/store.js");
    const names = ["force [N]", "reference [N]", "least [N]", "load [N]", "slip [mm/s]", "width [mm]"];
    const values = Object.fromEntries(names.map((name) => [name, [1, 2]]));
    const value = { type: "SeriesView", t: [0, 1], values };
    apply(page.live.whole, { event: "Published", topic: "grip", t: 1, value });
    page.dirty = true;
}"""


def test_the_header_of_a_tablet_is_one_row_and_answers_are_shown(
    show: Show, open_page: Callable[..., Any]
) -> None:
    page = open_page(viewport={"width": 1180, "height": 820})
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    expect(page.locator("#links .link")).to_be_visible()
    assert box(page, "header")["height"] < 70
    expect(page.locator("#connection")).to_be_hidden()
    page.locator("#control [data-action=take]").click()
    expect(page.locator("#connection")).to_be_visible()  # type your name first


@pytest.mark.parametrize(("width", "height"), SIZES.values())
def test_all_curves_are_in_sight(
    show: Show, open_page: Callable[..., Any], width: int, height: int
) -> None:
    page = open_page(viewport={"width": width, "height": height})
    expect(page.locator("#connection")).to_have_text("connected")
    page.evaluate(GRIP)
    expect(page.locator("#plots .plot")).to_have_count(3)
    assert page.locator("#plots").evaluate("(plots) => plots.scrollWidth <= plots.clientWidth + 1")


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1280, 800)])
def test_curves_have_120_px_of_height_beside_a_table(
    show: Show, open_page: Callable[..., Any], width: int, height: int
) -> None:
    page = open_page(viewport={"width": width, "height": height})
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    page.evaluate(GRIP)
    page.evaluate(TABLE)
    expect(page.locator("#plots .plot")).to_have_count(3)
    page.evaluate(DRAWN)
    heights = "(curves) => curves.map((curve) => curve.getBoundingClientRect())"
    boxes = page.locator("#plots .u-over").evaluate_all(heights)
    assert min(box["height"] for box in boxes) >= 120
    assert max(box["y"] + box["height"] for box in boxes) < height


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1280, 800), (768, 1024)])
def test_no_chart_lies_under_another_in_a_window_that_was_made_smaller(
    show: Show, open_page: Callable[..., Any], width: int, height: int
) -> None:
    page = open_page(viewport={"width": width + 600, "height": height})
    expect(page.locator("#connection")).to_have_text("connected")
    page.evaluate(GRIP)
    expect(page.locator("#plots .plot")).to_have_count(3)
    page.evaluate(DRAWN)
    page.evaluate(
        "async () => { (await import('/static/page.js')).page.drawing = true; }"
    )  # busy: it draws later
    page.set_viewport_size({"width": width, "height": height})
    page.evaluate(
        "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )
    over = """(plots) => plots.flatMap((plot) => { const right = plot.getBoundingClientRect().right + 4;
        const parts = [...plot.querySelectorAll(".keys span, canvas")];
        return parts.filter((part) => part.getBoundingClientRect().right > right).map((part) => part.outerHTML); })"""
    assert page.locator("#plots .plot").evaluate_all(over) == []


TABLE = """async () => {
    const { page } = await import("/static/page.js");
    const columns = ["fruit", "size", "along the belt", "place known to", "state"];
    const rows = [["0", "72 × 63 × 73 mm", "-216 mm", "1.7 mm", "rests"]];
    page.live.whole.tables.set("fruit", { columns, rows, caption: "1 fruit on the belt, belt at 0.15 m/s" });
    page.dirty = true;
}"""


@pytest.mark.parametrize(("width", "height"), [(1920, 1080), (1280, 800), (768, 1024)])
def test_a_table_below_the_curves_has_its_first_row_in_sight(
    show: Show, open_page: Callable[..., Any], width: int, height: int
) -> None:
    page = open_page(viewport={"width": width, "height": height})
    show.run(HOLD)
    expect(page.locator("#state")).to_have_text("▶ running")
    page.evaluate(GRIP)
    page.evaluate(TABLE)
    expect(page.locator("#plots .plot")).to_have_count(3)
    expect(page.locator("#tables tbody tr")).to_be_in_viewport(ratio=0.99)


LANES = """() => { window.names = []; const { fillText } = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.fillText = function (words, x, y) {
      if (this.canvas.id === "timeline" && /^Rest/.test(words)) window.names.push(y);
      fillText.call(this, words, x, y); };
}"""


def test_at_1280_px_nothing_of_header_lanes_and_speed_is_cut_or_printed_over(
    show: Show, open_page: Callable[..., Any]
) -> None:
    rests = "".join(f"    - Rest: {{duration: 20 ms}}\n      name: Rest {i}\n" for i in range(9))
    page = open_page(viewport={"width": 1280, "height": 800})
    expect(page.locator("#connection")).to_have_text("connected")
    page.evaluate(LANES)
    show.run(
        f"pomona: 1\ntree: a_rather_long_name_of_a_tree\nroot:\n  sequence:\n{rests}    - Hold: {{}}\n"
    )
    page.wait_for_function("() => window.names.length > 0")
    page.evaluate(DRAWN)
    tall = page.locator("div.lanes:not(.handle)").evaluate("(lanes) => lanes.clientHeight")
    assert max(page.evaluate("() => window.names")) <= tall - 7  # middle of a line of 15 px
    page.wait_for_function(APART)  # the links are drawn anew with each message
    assert box(page, "#speed")["width"] >= 55
    GATE.set()


APART = """() => { // the last device's link ends before the connection's word begins
    const [link, word] = ["#links .link:last-child", "#connection"].map((each) => document.querySelector(each));
    return link && link.getBoundingClientRect().right <= word.getBoundingClientRect().left;
}"""


NAMED = """(length) => { // a run with a name of this length, and the devices of a cell
    document.getElementById("run").textContent = "n".repeat(length);
    document.getElementById("kind").textContent = "SIMULATED";
    document.getElementById("state").textContent = "succeeded";
    const device = (name) => Object.assign(document.createElement("span"), { className: "link ok", textContent: name });
    document.getElementById("links").replaceChildren(...["arm", "camera", "fingers", "gripper"].map(device));
}"""


@pytest.mark.parametrize(
    ("width", "height"), [(950, 700), (1024, 768), (1200, 800), (1280, 800), (1920, 1080)]
)
def test_safe_stop_stands_beside_the_name_of_the_run_however_long_it_is(
    show: Show, open_page: Callable[..., Any], width: int, height: int
) -> None:
    page = open_page(viewport={"width": width, "height": height})
    expect(page.locator("#connection")).to_have_text("connected")
    for length in range(4, 48, 4):
        page.evaluate(NAMED, length)
        stop, title = box(page, "#safe-stop"), box(page, ".title")
        assert stop["y"] < title["y"] + title["height"], length  # in one row
        assert stop["x"] + stop["width"] > width - 30


PICK = """() => { // clicks all over the scene, until something is hit
    const canvas = document.getElementById("scene"), box = canvas.getBoundingClientRect();
    for (let y = 4; y < box.height; y += 6) for (let x = 4; x < box.width; x += 6) {
      const at = { clientX: box.left + x, clientY: box.top + y, bubbles: true };
      canvas.dispatchEvent(new PointerEvent("pointerdown", { ...at, pointerId: 1, button: 2 }));
      canvas.dispatchEvent(new MouseEvent("click", at));
      if (document.getElementById("tree").getAttribute("aria-activedescendant")) return;
    }
}"""
PAINTED = """() => { const seen = document.getElementById("scene");
    const c = Object.assign(document.createElement("canvas"), { width: seen.width, height: seen.height });
    const g = c.getContext("2d"); g.drawImage(seen, 0, 0);
    return g.getImageData(0, 0, c.width, c.height).data.reduce((sum, v) => sum + v, 0); }"""


def test_an_object_clicked_in_the_scene_is_chosen_in_the_tree_and_back(
    show: Show, open_page: Callable[..., Any]
) -> None:
    show.record(LOOK, "old_1")
    page = open_page("run=old_1", viewport={"width": 1280, "height": 720})
    expect(page.locator("#scene-legend")).to_contain_text("planned path")
    wait_for_size(
        page, "#scene", 400, 180
    )  # on the smallest desk's screen, with everything else in sight
    page.wait_for_function(f"() => ({PAINTED})() > 0")
    before = page.evaluate(PAINTED)
    page.evaluate(PICK)
    expect(page.locator(".row.selected .name")).to_have_text("Look")
    expect(page.locator("#node .about")).to_contain_text("Look")
    page.wait_for_function(
        f"(before) => ({PAINTED})() !== before", arg=before
    )  # its things stand out


def test_statistics_of_the_shown_runs_say_rate_force_time_and_why_they_failed(
    show: Show, open_page: Callable[..., Any]
) -> None:
    fails = "pomona: 1\ntree: bad\nroot:\n  sequence:\n    - Jam: {}\n"
    for day, tree in (("2026-11-20", fails), ("2026-11-21", fails), ("2026-11-21", LOOK)):
        show.record(tree, f"{day}_{len(list(show.records.iterdir()))}")
    show.run(HOLD, "2026-11-20_stop").stop()
    page = open_page(viewport={"width": 1280, "height": 720})
    expect(page.locator("#state")).to_have_text("■ stopped")
    page.get_by_role("button", name="Runs").click()
    page.get_by_role("button", name="Statistics").click()
    expect(page.locator("#statistics .figure").first).to_contain_text("33 %")
    expect(page.locator("#statistics .figure").first).to_contain_text(
        "1 stopped by an operator not counted"
    )
    expect(page.locator("#statistics .codes tbody tr")).to_have_text(
        ["JAMMED2 of 32026-11-21_12026-11-20_0"]
    )
    page.get_by_label("filter runs").fill("2026-11-21")
    expect(page.locator("#statistics .figure").first).to_contain_text("1 of 2")
    page.get_by_role("link", name="2026-11-21_1").first.click()
    expect(page.locator("#connection")).to_have_text("recorded run")
    expect(page.locator("#why")).to_contain_text("the wheel is stuck")


def test_two_runs_are_seen_over_each_other_at_the_same_moment(
    show: Show, open_page: Callable[..., Any]
) -> None:
    show.record(LOOK, "old_1")
    show.record(
        LOOK.replace("- Look: {seen: '{seen}'}", "- Rest: {}\n    - Look: {seen: '{seen}'}"),
        "old_2",
        seed=3,
    )
    page = open_page()
    page.get_by_role("button", name="Runs").click()
    for run in ("old_1", "old_2"):
        page.get_by_label(f"compare {run}").check()
    page.get_by_role("button", name="Compare two").click()
    page.get_by_role("button", name="Over each other").click()
    expect(page.locator("#connection")).to_have_text(
        "recorded run"
    )  # the second one may come first
    expect(page.locator("#over-words")).to_have_text("old_2: Rest, 0 ms")
    page.locator("#timeline").press("End")
    expect(page.locator("#over-words")).to_contain_text("old_2: ✓ success after")
    expect(page.locator("#run")).to_have_text(
        "old · seed 0"
    )  # the first one still is what is looked at
    expect(page.locator("#scene-legend")).to_contain_text("path of the run over it")
    expect(page.locator(".plot .keys").first).to_have_text(re.compile(r"grasp force .* · "))
    page.get_by_role("button", name="Hide it").click()
    expect(page.locator("#over")).to_be_hidden()
    expect(page.locator(".plot .keys").first).not_to_contain_text("·")
