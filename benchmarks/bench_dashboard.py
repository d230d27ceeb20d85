"""Cost and speed of the dashboard.

Needs Chromium. `python benchmarks/bench_dashboard.py [--short] [--only PART]`; `--short` measures less long.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from benchmarks.dashboard_presses import bench_presses
from benchmarks.dashboard_viewers import watch
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import Event, NodeChanged, Published, RunEnded, RunStarted
from pomona.executive.views import (
    BodiesView,
    ImageView,
    Mesh3,
    Points3,
    PosesView,
    SceneView,
    SeriesView,
)
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard

PERIOD = 0.02
TURNS = 4
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
         "--disable-sync", "--no-first-run"]  # fmt: skip
NODES: tuple[dict[str, Any], ...] = tuple(
    {"path": f"root/{n}" if n else "root", "parent": "root" if n else None, "kind": "skill", "type": "Rest",
     "name": f"node {n}", "description": "", "comment": "", "line": 1, "end_line": 1, "inputs": {}, "outputs": {}}
    for n in range(1001)
)  # fmt: skip


def started(nodes: int) -> RunStarted:
    """The first event of a run with a flat tree."""
    return RunStarted(
        0.0,
        0,
        "bench",
        "bench",
        "bench.yaml",
        "",
        "",
        "bench",
        "mock",
        "",
        "",
        0,
        {},
        NODES[:nodes],
        {},
        0.0,
        PERIOD,
    )


def tick_events(tick: int, feedback: str) -> list[Event]:
    """Events of a busy tick: a node's feedback, and ten samples of six quantities."""
    t = tick * PERIOD
    times = np.asarray(t + np.arange(10) * 0.002, np.float64)
    values: dict[str, NDArray[np.float64]] = {
        f"quantity {i} [N]": np.sin(times * (i + 1)) for i in range(6)
    }
    return [
        NodeChanged(t, tick, f"root/{1 + tick % 10}", "RUNNING", feedback, 1),
        Published(t, tick, "root/1", "grip", SeriesView(times, values)),
    ]


def ticks(on_event: Callable[[Event], None], duration: float) -> np.ndarray[Any, Any]:
    """Tick as a runner on a real cell does; returns the periods [s]."""
    beats, tick, following = [], 0, time.perf_counter()
    end = following + duration
    while following < end:
        beats.append(time.perf_counter())
        for event in tick_events(tick, f"{time.time():.4f}"):
            on_event(event)
        tick += 1
        following += PERIOD
        time.sleep(max(0.0, following - time.perf_counter()))
    return np.diff(beats)


def tick_periods(
    dashboard: Dashboard, viewers: int, stuck: bool, duration: float
) -> np.ndarray[Any, Any]:
    """Periods of the tick while so many watch."""
    dashboard.hub.on_event(started(20))
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    process = context.Process(target=watch, args=(dashboard.access.port, viewers, stuck, stop))
    if viewers:
        process.start()
        while dashboard.hub.viewers < viewers:
            time.sleep(0.05)
    periods = ticks(dashboard.hub.on_event, duration)
    if viewers:
        stop.set()
        process.join(10.0)
        process.kill()
        while dashboard.hub.viewers:
            time.sleep(0.05)
    return periods


def event_to_pixel(page: Any, dashboard: Dashboard, duration: float) -> np.ndarray[Any, Any]:
    """Seconds from an event in the tick to the frame that shows it: the event carries its time as feedback."""
    page.evaluate(
        """() => { window.delays = [];
        const seen = () => { const now = Date.now() / 1000;
          for (const e of document.querySelectorAll('.row .detail')) { const sent = Number(e.textContent);
            if (sent && e.dataset.seen !== e.textContent) { e.dataset.seen = e.textContent;
              const painted = new MessageChannel();
              painted.port1.onmessage = () => window.delays.push(Date.now() / 1000 - sent);
              requestAnimationFrame(() => painted.port2.postMessage(0)); } } };
        new MutationObserver(seen).observe(document.getElementById('tree'), {subtree: true, childList: true}); }"""
    )
    ticks(dashboard.hub.on_event, duration)
    page.wait_for_timeout(500)
    return np.array(page.evaluate("window.delays"))


PEAK_TICK, PEAK = 61_728, 99.0
"""When one sample of half an hour is as large as this [N]; all others lie between -1 and 1."""


def record_of(folder: Path, length: int = 90_000) -> None:
    """That many ticks with a change each, samples in a third of them, and an arm that always moves."""
    folder.mkdir()
    recorder = Recorder(folder)
    recorder.on_event(started(20))
    recorder.on_event(Published(0.0, 0, "", "robot", arm()))
    for tick in range(length):
        node, series = tick_events(tick, "on the way")
        recorder.on_event(node)
        if tick == PEAK_TICK:
            assert isinstance(series, Published)
            assert isinstance(series.value, SeriesView)
            series.value.values["quantity 0 [N]"][4] = PEAK
        if tick % 3 == 0:
            recorder.on_event(series)
        if tick % 5 == 0:
            recorder.on_event(Published(tick * PERIOD, tick, "", "robot", arm_at(tick * PERIOD)))
    end = length * PERIOD
    recorder.on_event(RunEnded(end, length, "success", None, length, end, end, None))
    recorder.close()


LINKS, SIDES = 13, 40


def arm() -> BodiesView:
    """As many bodies and faces as the picking arm has: 13 and 2080."""
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    ring = np.stack([0.05 * np.cos(turn), 0.05 * np.sin(turn), np.zeros(SIDES)], axis=1)
    vertices = np.concatenate([ring + np.array((0.0, 0.0, z)) for z in (0.0, 0.05, 0.1)])
    here, there = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    quads = [
        (here + k * SIDES, there + k * SIDES, here + (k + 1) * SIDES, there + (k + 1) * SIDES)
        for k in (0, 1)
    ]
    faces = np.concatenate(
        [np.stack(part, axis=1) for a, b, c, d in quads for part in ((a, b, c), (b, d, c))]
    )
    return BodiesView((Mesh3(vertices, faces.astype(np.int32), "arm", "robot"),) * LINKS)


def arm_at(t: float) -> PosesView:
    """The arm bent to and fro, and where its tip is."""
    bend = 0.1 * np.sin(t + 0.2 * np.arange(LINKS))
    poses = np.zeros((LINKS, 7))
    poses[:, 0], poses[:, 2] = (
        np.cumsum(0.1 * np.sin(bend.cumsum())),
        np.cumsum(0.1 * np.cos(bend.cumsum())),
    )
    poses[:, 4], poses[:, 6] = np.sin(0.5 * bend.cumsum()), np.cos(0.5 * bend.cumsum())
    return PosesView(poses, poses[-1, :3])


def pictures(tick: int) -> list[Event]:
    """Other events of an hour of picking: a moving robot, and sometimes an image and a map."""
    t = tick * PERIOD
    events: list[Event] = []
    rng = np.random.default_rng(tick)
    if tick == 0:
        vertices, faces = rng.uniform(size=(60, 3)), rng.integers(0, 60, (100, 3), np.int32)
        events.append(
            Published(
                t, tick, "", "robot", BodiesView((Mesh3(vertices, faces, "arm", "robot"),) * 12)
            )
        )
    if tick % 5 == 0:
        events.append(
            Published(
                t, tick, "", "robot", PosesView(rng.uniform(size=(12, 7)), rng.uniform(size=3))
            )
        )
    if tick % 200 == 0:
        image = rng.integers(0, 255, (240, 320, 3), np.uint8)
        events.append(Published(t, tick, "root/1", "look", ImageView(image)))
        events.append(
            Published(
                t, tick, "root/1", "map", SceneView(points=(Points3(rng.uniform(size=(300, 3))),))
            )
        )
    return events


def memory_mb() -> float:
    """Resident memory of this process."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return (
        int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]) / 1e3
    )


def machine() -> str:
    """The processor, how many cores of it there are, and how many processes wanted them in the last minute."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next(
        (line.partition(":")[2].strip() for line in lines if line.startswith("model name")),
        "processor",
    )
    return f"{model}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before"


class Figures:
    """The figures, and how many are missed."""

    def __init__(self) -> None:
        self.table = Table("figure", "measured", "wanted", title=f"dashboard, {machine()}")
        self.missed = 0

    def tell(self, what: str, value: float, unit: str, most: float) -> None:
        """A figure that has a limit."""
        self.missed += value > most
        self.table.add_row(
            what, f"{value:.3g} {unit}", f"≤ {most:g} {unit}", style="" if value <= most else "red"
        )

    def least(self, what: str, value: float, unit: str, least: float) -> None:
        """The same for a figure that should be high."""
        self.missed += value < least
        self.table.add_row(
            what,
            f"{value:.3g} {unit}",
            f"≥ {least:.3g} {unit}",
            style="" if value >= least else "red",
        )

    def note(self, what: str, words: str) -> None:
        """Add a note that helps to judge the figures."""
        self.table.add_row(f"  {what}", words, "")


def bench_viewers(report: Figures, dashboard: Dashboard, _browser: Any, duration: float) -> None:
    """Measure the cost of viewers for the tick, in turns, so that other load of the machine affects all alike."""
    turns = [
        ("alone", 0, False),
        ("with 50 viewers", 50, False),
        ("with a viewer that stops reading", 1, True),
    ]
    periods: dict[str, list[Any]] = {what: [] for what, _viewers, _stuck in turns}
    for _ in range(TURNS):
        for what, viewers, stuck in turns:
            periods[what].append(tick_periods(dashboard, viewers, stuck, duration / TURNS))
    p99 = {what: float(np.percentile(np.concatenate(of), 99)) for what, of in periods.items()}
    for what in list(p99)[1:]:
        report.tell(
            f"change of the tick's p99 period {what}",
            (p99[what] / p99["alone"] - 1.0) * 100.0,
            "%",
            10.0,
        )
    report.note(
        "p99 periods", ", ".join(f"{what} {1e3 * value:.2f} ms" for what, value in p99.items())
    )
    spread = [float(np.percentile(of, 99)) for of in periods["alone"]]
    report.note(
        "p99 alone, from turn to turn", f"{1e3 * min(spread):.2f} to {1e3 * max(spread):.2f} ms"
    )


def bench_page(report: Figures, dashboard: Dashboard, browser: Any, duration: float) -> None:
    """Measure how soon the page is usable, and how soon it shows events."""
    from playwright.sync_api import expect

    page = browser.new_page()
    page.goto(dashboard.link)
    page.reload()  # the first start of the browser itself is not the page's
    timing = page.evaluate(
        "performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd / 1000"
    )
    report.tell("page interactive", timing, "s", 1.0)
    for nodes in (20, 1001):
        dashboard.hub.on_event(started(nodes))
        expect(page.locator(".row")).to_have_count(nodes)
        delays = event_to_pixel(page, dashboard, duration)
        p95 = float(np.percentile(delays, 95)) * 1000.0
        report.tell(f"event to pixel, p95 of {len(delays)}, {nodes} nodes", p95, "ms", 150.0)
    page.close()


def bench_record(report: Figures, dashboard: Dashboard, browser: Any, _duration: float) -> None:
    """How soon a long record can be looked at, and a moment in its middle in full."""
    from playwright.sync_api import expect

    folder = dashboard.records / "half_hour"
    record_of(folder)
    size = (folder / "run.mcap").stat().st_size / 1e6
    page = browser.new_page(viewport={"width": 1440, "height": 900})
    wait_for_rest(browser)
    began = time.time()
    page.goto(f"{dashboard.link}&run=half_hour", wait_until="domcontentloaded")
    report.tell(
        f"a record of 30 minutes ({size:.0f} MB) opens", page.evaluate(DRAWN) - began, "s", 2.0
    )
    began = time.perf_counter()
    with page.expect_event(
        "requestfinished", lambda request: "standing&begin=8" in request.url, timeout=60_000
    ):
        page.evaluate("location.hash = 'run=half_hour&t=900'")
    report.note("everything around a moment is there after", f"{time.perf_counter() - began:.2f} s")
    page.wait_for_timeout(1000)
    expect(page.locator("#scene-legend")).to_contain_text("executed path")
    client = page.context.new_cdp_session(page)
    client.send("Performance.enable", {"timeDomain": "threadTicks"})
    spent = main_thread(client)
    gaps = np.diff(page.evaluate(PLAYED))
    cost = {
        what: 1e3 * (after - spent[what]) / (len(gaps) + 30)
        for what, after in main_thread(client).items()
    }
    report.tell(
        "the page's own thread, for each frame while it is played", cost["TaskDuration"], "ms", 8.0
    )
    parts = ("ScriptDuration", "LayoutDuration", "RecalcStyleDuration")
    report.note(
        "of these",
        ", ".join(f"{what.removesuffix('Duration')} {cost[what]:.2f} ms" for what in parts),
    )
    report.least("frames a second while it is played", 1e3 / float(np.mean(gaps)), "", 60.0 * 0.97)
    report.note(
        "frames that took longer than two", f"{np.mean(gaps > 2.1e3 / 60.0):.1%} of {len(gaps)}"
    )
    page.evaluate(f"location.hash = 'run=half_hour&t={PEAK_TICK * PERIOD + 1.0}'")
    page.evaluate(CURVES)
    for span in ("10 s", "1 min", "all"):
        page.get_by_role("button", name=span, exact=True).click()
        page.wait_for_function("(peak) => window.highest?.() === peak", arg=PEAK)
    report.note("one sample of 99 N in half an hour", "in the curves of 10 s, 1 min and all")
    page.close()


def wait_for_rest(browser: Any) -> None:
    """Wait until the browser has finished its own work: each new window takes 1 s of processor time."""
    client, before, spent = browser.new_browser_cdp_session(), -1.0, 0.0
    while spent - before > 0.05:
        time.sleep(0.5)
        before, spent = (
            spent,
            sum(of["cpuTime"] for of in client.send("SystemInfo.getProcessInfo")["processInfo"]),
        )
    client.detach()


def main_thread(client: Any) -> dict[str, float]:
    """Return seconds of processor time of the page's own thread, by purpose; other processes add none."""
    metrics = client.send("Performance.getMetrics")["metrics"]
    return {metric["name"]: metric["value"] for metric in metrics}


DRAWN = """() => new Promise((done) => { const words = document.getElementById("connection"), painted = new MessageChannel();
    painted.port1.onmessage = () => done(Date.now() / 1000);
    const seen = () => { if (words.textContent !== "recorded run") return;
      watch.disconnect(); requestAnimationFrame(() => painted.port2.postMessage(0)); };
    const watch = new MutationObserver(seen);
    watch.observe(words, {subtree: true, childList: true, characterData: true});
    seen(); })"""  # noqa: E501
"""Time at which a record is drawn, measured in the page, since a poll from outside has a period of a second."""

CURVES = """async () => { const { PlotsView } = await import("/static/pictures.js"), { update } = PlotsView.prototype;
    PlotsView.prototype.update = function (...of) { update.apply(this, of);
      window.highest = () => Math.max(...[...this.charts.values()].flatMap(({ plot }) => {
        const [from, to] = plot.data[0].reduce(([a, b], t, i) => (t < this.page[0] ? [i, b] : t <= this.page[1] ? [a, i] : [a, b]), [0, 0]);
        return plot.data.slice(1).flatMap((row) => row.slice(from, to + 1).filter((v) => v !== null && v !== undefined)); })); }; }"""  # noqa: E501
PLAYED = """async () => { const times = [];
    document.getElementById("play").click();
    await new Promise((done) => { const frame = (t) => { times.push(t); if (t - times[0] < 6000) requestAnimationFrame(frame); else done(); }; requestAnimationFrame(frame); });
    document.getElementById("play").click();
    return times.slice(30); }"""  # noqa: E501


def bench_memory(report: Figures, dashboard: Dashboard, browser: Any, duration: float) -> None:
    """An hour of a busy run, as fast as the page can follow."""
    from playwright.sync_api import expect

    page = browser.new_page()
    page.goto(dashboard.link)
    client = page.context.new_cdp_session(page)
    client.send("Performance.enable")
    dashboard.hub.on_event(started(20))
    hour = 180_000 if duration > 10.0 else 40_000
    heaps, elements, memories = [], [], []
    for tick in range(hour):
        for event in tick_events(tick, "on the way") + pictures(tick):
            dashboard.hub.on_event(event)
        if tick % (hour // 8) == hour // 8 - 1:
            expect(page.locator("#clock")).to_contain_text(
                f"{tick * PERIOD:.1f} s", timeout=120_000
            )
            client.send("HeapProfiler.collectGarbage")
            metrics = {
                metric["name"]: metric["value"]
                for metric in client.send("Performance.getMetrics")["metrics"]
            }
            heaps.append(metrics["JSHeapUsedSize"] / 1e6)
            elements.append(metrics["Nodes"])
            memories.append(memory_mb())
        elif tick % 500 == 499:
            time.sleep(0.05)  # the hour passes quickly, but the page must be able to follow
    for what, values in (("page's heap", heaps), ("server's memory", memories)):
        report.tell(
            f"{what}, end of the run against its middle",
            values[-1] / values[3] * 100.0 - 100.0,
            "%",
            10.0,
        )
    minutes = hour * PERIOD / 60.0
    report.note(
        f"heap after each eighth of {minutes:.0f} min, collected",
        f"{', '.join(f'{h:.0f}' for h in heaps)} MB",
    )
    report.note("resident memory of the server", f"{', '.join(f'{m:.0f}' for m in memories)} MB")
    report.note("nodes of the document", f"{', '.join(f'{n:.0f}' for n in elements)}")
    page.close()


PARTS = {
    "viewers": bench_viewers,
    "presses": bench_presses,
    "page": bench_page,
    "record": bench_record,
    "memory": bench_memory,
}


def main() -> int:
    """Measure and print.

    Returns:
        the exit status: 1 when a figure is missed.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="measure less long; noisier")
    parser.add_argument("--only", choices=PARTS, help="measure this part only")
    options = parser.parse_args()
    browser_path = next(
        (path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None
    )
    if browser_path is None:
        print("no Chromium is installed", file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    report = Figures()
    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        dashboard = Dashboard(Access("127.0.0.1", port), Path(scratch))
        dashboard.start()
        browser = playwright.chromium.launch(executable_path=browser_path, args=FLAGS)
        for name, part in PARTS.items():
            if options.only in (None, name):
                part(report, dashboard, browser, 6.0 if options.short else 20.0)
        browser.close()
        dashboard.close()
    Console().print(report.table)
    return 1 if report.missed else 0


if __name__ == "__main__":
    sys.exit(main())
