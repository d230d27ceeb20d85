"""Pictures of the dashboard to look at: `python scripts/screenshots.py [FOLDER]` an apple is picked and the page
photographed.

Needs Chromium. The run, its replay, a failed dry run, the list of runs: on a desk's screen in light and dark, and on a
tablet.
"""

from __future__ import annotations

import shutil
import socket
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page, expect, sync_playwright

from executive.commands.dashboard import Launcher
from executive.dashboard.choices import Choices
from executive.dashboard.security import Access
from executive.dashboard.server import Dashboard
from executive.execute import RunOrder, execute
from executive.files import find_cell, find_tree

FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
         "--disable-sync", "--no-first-run"]  # fmt: skip
SCREENS = {
    "desk_light": (1600, 1000, "light"), "desk_dark": (1600, 1000, "dark"), "tablet": (1024, 768, "light")
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


def photograph(page: Page, into: Path, name: str) -> None:
    """One picture, once the page has drawn what it was told."""
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.screenshot(path=into / f"{name}.png")
    print(into / f"{name}.png")


def main(into: Path) -> None:
    """Run, and photograph."""
    into.mkdir(parents=True, exist_ok=True)
    browser_path = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)
    if browser_path is None:
        sys.exit("no Chromium is installed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        records = Path(scratch) / "runs"
        picked = execute(RunOrder(find_tree("pick_apple"), find_cell("sim"), seed=1, record=records)).record
        hard = Path(scratch) / "long_names.yaml"
        hard.write_text(HARD, encoding="utf-8")
        failed = execute(RunOrder(hard, find_cell("sim"), dry=True, record=records)).record
        assert picked is not None
        assert failed is not None
        dashboard = Dashboard(Access("127.0.0.1", port), records)
        choices = Choices.installed()
        dashboard.allow_starts(Launcher(dashboard, records, choices).start, choices)
        dashboard.start()
        browser = playwright.chromium.launch(executable_path=browser_path, args=FLAGS)
        for screen, (width, height, scheme) in SCREENS.items():
            context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)  # type: ignore[arg-type]
            for name, run in (("pick", picked.name), ("failed", failed.name)):
                page = context.new_page()
                page.goto(f"{dashboard.link}&run={run}")
                expect(page.locator("#connection")).to_have_text("recorded run", timeout=60_000)
                page.locator(".row").last.click()
                photograph(page, into, f"{screen}_{name}")
            page = context.new_page()
            page.goto(dashboard.link)
            page.get_by_role("button", name="Runs").click()
            expect(page.locator("#start-fields .field").first).to_be_visible()
            for box in page.locator("#runs input[type=checkbox]").all():
                box.check()
            page.get_by_role("button", name="Compare two").click()
            expect(page.locator("#comparison table")).to_be_visible()
            photograph(page, into, f"{screen}_runs")
            context.close()
        browser.close()
        dashboard.close()


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs/screenshots"))
