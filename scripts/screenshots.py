"""Pictures of the dashboard to look at: an apple is picked and the page photographed.

    python scripts/screenshots.py [FOLDER]     # every screen, in runs/screenshots

The README's animation is made by `make figures` (scripts/pictures.py).

Needs Chromium. A live run (running, paused, stopped safely), replays of a pick, of a pick that failed and of a tree
with long names, the list of runs and a comparison: on a desk's screen in light and dark, and on a tablet.
"""

from __future__ import annotations

import argparse
import io
import shutil
import socket
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.runner import Runner
from pomona.tools.dashboard.choices import Choices
from pomona.tools.dashboard.command_dashboard import Launcher
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard

FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
         "--disable-sync", "--no-first-run"]  # fmt: skip
SCREENS = {
    "desk_light": (1600, 1000, "light"), "desk_dark": (1600, 1000, "dark"), "tablet": (1180, 820, "light")
}  # fmt: skip
HARD = """pomona: 1
tree: long_names
root:
  fallback:
    - fail: {code: BLOCKED, message: "a branch that nobody has seen before is in the way, 40 mm from the left finger"}
      name: A node with a very long name that nobody would write and somebody will do
    - sequence:
        - wait: 200 ms
        - fail: {code: BLOCKED, message: "the second way is blocked, too"}
          name: The second way
"""


class Photographer:
    """The same page on every screen."""

    def __init__(self, browser: Browser, into: Path) -> None:
        self._into = into
        self._contexts = {
            name: browser.new_context(
                viewport={"width": width, "height": height},
                color_scheme=scheme,  # type: ignore[arg-type]
            )
            for name, (width, height, scheme) in SCREENS.items()
        }
        self.pages: dict[str, Page] = {}

    def open(self, address: str, ready: Callable[[Page], None]) -> None:
        """Open an address everywhere, and wait until it is ready."""
        for page in self.pages.values():
            page.close()
        self.pages = {name: context.new_page() for name, context in self._contexts.items()}
        for page in self.pages.values():
            page.goto(address)
        for page in self.pages.values():
            ready(page)

    def take(self, what: str) -> None:
        """Take a picture on every screen, once the page has drawn the latest events."""
        for screen, page in self.pages.items():
            page.evaluate(
                "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
            )
            page.screenshot(path=self._into / f"{screen}_{what}.png")
            print(self._into / f"{screen}_{what}.png")


def recorded(page: Page) -> None:
    """Wait until a record has been read."""
    expect(page.locator("#connection")).to_have_text("recorded run", timeout=300_000)


def photograph_live(photographer: Photographer, dashboard: Dashboard) -> None:
    """A pick at real pace: running, paused at a breakpoint, stopped safely."""
    photographer.open(
        dashboard.link, lambda page: expect(page.locator("#connection")).to_have_text("connected")
    )
    order = RunOrder(
        find_tree("pick_apple"),
        find_cell("sim"),
        seed=1,
        real_time=True,
        breaks=(("Follow", "before"), ("Lift", "before")),
    )
    run = threading.Thread(
        target=execute,
        args=(order, [dashboard.hub.on_event]),
        kwargs={"on_ready": dashboard.control.serve, "on_latched": Runner.hold_latched},
    )
    run.start()
    page = next(iter(photographer.pages.values()))
    page.get_by_label("your name").fill("Ada")
    page.locator("#control [data-action=take]").click()
    paused = "❚❚ paused"
    expect(page.locator("#state")).to_have_text(paused, timeout=120_000)
    for other in photographer.pages.values():
        other.locator(".row", has=other.get_by_text("SlipAvoidGrasp", exact=True)).first.click()
    page.locator("#control [data-action=resume]").click()
    expect(page.locator("#state")).to_have_text("▶ running")
    photographer.take("running")
    expect(page.locator("#state")).to_have_text(paused, timeout=60_000)
    photographer.take("paused")
    page.locator("#control [data-action=resume]").click()
    expect(page.locator("#state")).to_have_text("▶ running")
    for _ in range(2):
        page.keyboard.press("Escape")
    expect(page.locator("#latched")).to_be_visible(timeout=20_000)
    expect(page.locator("#state")).to_have_text("■ stopped", timeout=20_000)
    photographer.take("stopped")
    page.get_by_role("button", name="Acknowledge and reset").click()
    expect(page.locator("#latched")).to_be_hidden()
    run.join()


def photograph_runs(page: Page) -> None:
    """Compare the two oldest of the listed runs."""
    page.get_by_role("button", name="Runs").click()
    expect(page.locator("#start-fields summary").first).to_be_visible()
    boxes = page.locator("#runs input[type=checkbox]")
    expect(boxes.nth(1)).to_be_visible(timeout=60_000)  # the list may come after the form
    for box in boxes.all()[-2:]:
        box.check()
    page.get_by_role("button", name="Compare two").click()
    expect(page.locator("#comparison table")).to_be_visible()


FRAMES = 60
"""Pictures of the animation; the README's stays below 3 MB with as many."""
PACE = 0.12
"""For how long each is shown [s]."""
LANES_BEGIN, LANES_END = 150, 10
"""The lanes' margins, as in timeline.js [px]."""


def animate(page: Page, address: str, out: Path) -> None:
    """A recorded run as the page plays it, from its beginning to its end, as an animated WebP."""
    page.goto(address)
    recorded(page)
    page.locator(".row", has_text="SlipAvoidGrasp").last.click()
    lanes = page.locator("#timeline").bounding_box()
    assert lanes is not None
    pictures = []
    for number in range(FRAMES):
        along = LANES_BEGIN + (lanes["width"] - LANES_BEGIN - LANES_END) * number / (FRAMES - 1)
        page.mouse.click(lanes["x"] + along, lanes["y"] + 4)
        page.wait_for_load_state("networkidle")
        page.evaluate(
            "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )
        recorded(page)  # on a busy machine the page may report a lost server for a while
        pictures.append(Image.open(io.BytesIO(page.screenshot())))
    times = [int(1e3 * PACE)] * (FRAMES - 1) + [2000]
    pictures[0].save(
        out, save_all=True, append_images=pictures[1:], duration=times, loop=0, quality=60, method=4
    )
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")


def main(into: Path, animation: Path | None = None) -> None:
    """Run, and photograph; with `animation` that file, and nothing else."""
    into.mkdir(parents=True, exist_ok=True)
    browser_path = next(
        (path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None
    )
    if browser_path is None:
        sys.exit("no Chromium is installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        records = Path(scratch) / "runs"
        hard = Path(scratch) / "long_names.yaml"
        hard.write_text(HARD, encoding="utf-8")
        settings = {"fruit": "apple_4", "place": "2"}
        orders = {
            "pick": RunOrder(
                find_tree("pick_apple"), find_cell("sim"), 5, settings, record=records
            ),
            "failed": RunOrder(
                find_tree("pick_apple"),
                find_cell("sim"),
                seed=1,
                settings={"height": "900 mm"},
                record=records,
            ),
            "names": RunOrder(hard, find_cell("sim"), dry=True, record=records),
        }
        if animation is not None:
            orders = {"pick": orders["pick"]}
        names = {
            what: record.name
            for what, order in orders.items()
            if (record := execute(order).record) is not None
        }
        dashboard = Dashboard(Access("127.0.0.1", port), records)
        choices = Choices.installed()
        launcher = Launcher(dashboard, records, choices)
        dashboard.allow_starts(launcher.start, choices)
        dashboard.start()
        browser = playwright.chromium.launch(executable_path=browser_path, args=FLAGS)
        if animation is not None:
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.set_default_timeout(300_000)  # a busy machine may take its time
            animate(page, f"{dashboard.link}&run={names['pick']}", animation)
            browser.close()
            launcher.close()
            dashboard.close()
            return
        photographer = Photographer(browser, into)
        for what, name in names.items():
            photographer.open(f"{dashboard.link}&run={name}", recorded)
            for page in (
                photographer.pages.values() if what == "pick" else ()
            ):  # a failed leaf is selected by the page
                page.locator(".row", has_text="Refine").last.click()
            photographer.take(what)
        photographer.open(f"{dashboard.link}&run={names['pick']}&t=1.5", recorded)
        photographer.take("scrubbed")
        photographer.open(dashboard.link, photograph_runs)
        photographer.take("runs")
        photograph_live(photographer, dashboard)
        browser.close()
        launcher.close()
        dashboard.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "into",
        nargs="?",
        type=Path,
        default=Path("runs/screenshots"),
        help="folder of the pictures",
    )
    main(parser.parse_args().into)
