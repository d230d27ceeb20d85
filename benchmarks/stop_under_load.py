"""How soon SAFE STOP acts while other processes want both cores: pressed in Chromium until the safe state is confirmed.

`python -m benchmarks.stop_under_load [--load 12] [--seconds 170]`. Chromium draws without a graphics card. The run's
process and the page's are those of `pomona dashboard`; the arm of the simulated cell moves in real time.
"""

from __future__ import annotations

import argparse
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_dashboard import FLAGS, machine, record_of

SETTLING = 0.7
"""Time for which the load is on before a press [s]."""

GOAL = 0.5
"""Longest time from a press to the confirmed safe state, 99th percentile [s]."""

PATIENCE = 300
"""Longest time for the page to open, or for a run to start: a busy computer needs minutes [s]."""

SHUTTLE = """pomona: 1
tree: shuttle
root:
  sequence:
    - MoveTo: {pose: observe}
    - MoveTo: {pose: home}
  repeat: 1000
"""

WAITING = "pomona: 1\ntree: waiting\nroot:\n  wait: 3600 s\n"

SITUATIONS = ("a dry run goes on", "a run is prepared", "a dry run goes on, a record is opened")
ARM_EVERY = 5
"""Turns from one run that moves the arm to the next: its start takes 3.5 s of processor time."""

START = """async ({ preparing, tree, dry, wait }) => {
  const load = (name) => import(`/static/${name}.js`), pause = (ms) => new Promise((next) => setTimeout(next, ms));
  const [{ page }, { link, press }, { startRun }] = await Promise.all(["page", "link", "runs"].map(load));
  const until = async (done, limit = 300000) => {
    const end = performance.now() + limit;
    while (!done()) { if (performance.now() > end) throw new Error(`waited for ${done}`); await pause(10); }
  };
  const live = () => page.live.whole, prepared = () => page.control.start && !page.control.start.problem;
  const going = () => prepared() && !page.control.start.cancelled;
  if (!page.control.held_by) { press("take"); await until(() => page.control.held_by); }
  await until(() => !prepared());
  await pause(500); // what is said of a run comes after its preparation's end
  if (live().run && !live().ended) press("safe_stop"); // a start that came too late to be measured
  await until(() => !live().run || live().ended);
  for (let n = 0; live().safeStop && n < 200; n++) { press("acknowledge"); await pause(500); }
  const before = live().run?.run, asked = performance.now(), begun = () => going() || live().run?.run !== before;
  while (!begun()) {
    await startRun({ tree, dry, cell: "sim", seed: 0, pace: "real", speed: "100 %", settings: {} });
    await pause(100);
    const late = performance.now() - asked > 120000;
    if (!begun() && late) throw new Error(`no start: ${document.getElementById("connection").textContent}`);
  }
  if (!preparing) await until(() => live().run && live().run.run !== before && !live().ended && live().t > 0.3);
  await pause(wait);
}"""
"""Start a run and wait until it is in the wanted state, in the page."""

PRESS = """async ({ run }) => {
  const load = (name) => import(`/static/${name}.js`), pause = (ms) => new Promise((next) => setTimeout(next, ms));
  const [{ page }, { link }] = await Promise.all(["page", "link"].map(load));
  const source = "onmessage = () => setTimeout(() => postMessage(performance.timeOrigin + performance.now()), 20)";
  const clock = new Worker(URL.createObjectURL(new Blob([source])));
  if (run) location.hash = `run=${run}`;
  const finger = await new Promise((next) => { clock.onmessage = (e) => next(e.data); clock.postMessage(0); });
  clock.terminate();
  const button = document.getElementById("safe-stop");
  const enabled = button.getAttribute("aria-disabled") === "false" && !button.disabled;
  const alive = document.getElementById("not-live").hidden;
  const still = Boolean(page.control.start && !page.control.start.problem);
  link.press = null;
  button.click();
  const made = link.press;
  while (made.state === "sent" || made.state === "accepted") await pause(10);
  if (run) { location.hash = ""; await pause(50); }
  return { took: performance.timeOrigin + made.ended - finger, state: made.state, enabled, alive, still };
}"""
"""Press and measure [ms]. A worker stamps the press, so that a busy page counts as with a finger."""


class Load:
    """Processes that compute while `on`. A start is not measured, and its own computations give way to others."""

    def __init__(self, processes: int) -> None:
        self._loops = [
            subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)
        ]
        self.set(on=False)

    def set(self, *, on: bool) -> None:
        """Let them compute, or rest."""
        for loop in self._loops:
            loop.send_signal(signal.SIGCONT if on else signal.SIGSTOP)

    def close(self) -> None:
        """End them."""
        for loop in self._loops:
            loop.kill()
            loop.wait()


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """`pomona dashboard` in a process of its own; the link that lets a page act."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    trees = [folder / "shuttle.yaml", folder / "waiting.yaml"]
    for tree, words in zip(trees, (SHUTTLE, WAITING), strict=True):
        tree.write_text(words, encoding="utf-8")
    command = [
        sys.executable,
        "-u",
        "-c",
        "from pomona.executive.cli import main; import sys; sys.exit(main())",
        "dashboard",
    ]
    command += [
        "--port",
        str(port),
        "--record",
        str(folder / "runs"),
        *(f"--tree={tree}" for tree in trees),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=folder) as process:
        assert process.stdout is not None
        link = next(
            found[0] for line in process.stdout if (found := re.search(r"http://\S+", line))
        )
        try:
            yield link
        finally:
            process.terminate()


def measure(page: Any, load: Load, record: str, seconds: float) -> dict[str, list[dict[str, Any]]]:
    """Press by turns in each situation, while the load is on."""
    from playwright.sync_api import Error

    presses: dict[str, list[dict[str, Any]]] = {}
    end, rng = time.monotonic() + seconds, np.random.default_rng(7)
    for turn in range(1000):
        if time.monotonic() > end:
            break
        what = "the arm moves" if turn % ARM_EVERY == 0 else SITUATIONS[turn % len(SITUATIONS)]
        start = {
            "preparing": what == "a run is prepared",
            "tree": "shuttle" if what == "the arm moves" else "waiting",
            "dry": what.startswith("a dry run"),
            "wait": float(rng.uniform(0.0, 800.0)),
        }
        try:
            page.evaluate(START, start)
            load.set(on=True)
            time.sleep(SETTLING)
            made = page.evaluate(PRESS, {"run": record if "record" in what else ""})
        except (
            Error
        ) as error:  # a busy computer needs minutes for a start: the measured part counts
            print(f"turn {turn}, {what}: {error.message.splitlines()[0]}", file=sys.stderr)
            continue
        finally:
            load.set(on=False)
        if what != "a run is prepared" or made["still"]:  # else it had begun before the press
            presses.setdefault(what, []).append(made)
    return presses


def main() -> int:
    """Measure and print.

    Returns:
        the exit status: 1 when the goal is missed.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--load", type=int, default=12, help="processes that compute beside it")
    parser.add_argument("--seconds", type=float, default=170.0, help="time to press in [s]")
    options = parser.parse_args()
    browser_path = next(
        (path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None
    )
    if browser_path is None:
        print("no Chromium is installed", file=sys.stderr)
        return 2
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as scratch, sync_playwright() as playwright:
        folder = Path(scratch)
        (folder / "runs").mkdir()
        record_of(folder / "runs" / "recorded", 15_000)
        with served(folder) as link:
            browser = playwright.chromium.launch(executable_path=browser_path, args=FLAGS)
            page = browser.new_page(
                viewport={"width": 1280, "height": 800}, bypass_csp=True
            )  # for the worker
            page.set_default_timeout(1e3 * PATIENCE)
            page.goto(link)
            page.get_by_label("your name").fill("bench")
            with closing(Load(options.load)) as load:
                taken = measure(page, load, "recorded", options.seconds)
                where = machine().replace("before", "at the end")
            browser.close()
    print(f"SAFE STOP, {options.load} processes that compute; {where}")
    presses = {**taken, "all": [made for of in taken.values() for made in of]}
    for what, made in presses.items():
        took = np.array([one["took"] for one in made])
        print(
            f"{what}: {len(took)} presses, median {np.median(took):.0f} ms, p99 {np.percentile(took, 99):.0f} ms,"
        )
        print(
            f"  longest {took.max():.0f} ms; ended as {', '.join(sorted({one['state'] for one in made}))};"
        )
        disabled, silent = (
            sum(not one["enabled"] for one in made),
            sum(not one["alive"] for one in made),
        )
        print(f"  button disabled {disabled}, shown as not live {silent}")
    late = np.percentile([one["took"] for one in presses["all"]], 99) > 1e3 * GOAL
    return int(late or not all(one["enabled"] for one in presses["all"]))


if __name__ == "__main__":
    sys.exit(main())
