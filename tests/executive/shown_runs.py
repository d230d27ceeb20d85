"""A dashboard with small runs to show: on a cell without devices, in threads, held where a test wants them."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from fake_cell import FakeCell, Wheel

from pomona.executive.language import build, read
from pomona.executive.ports import Outputs, Time
from pomona.executive.recording.recorder import Recorder
from pomona.executive.registry import Registry
from pomona.executive.running.events import RunStarted
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.executive.skill import Interrupted, Skill, Work
from pomona.executive.values.yaml_nodes import written
from pomona.executive.views import (
    BodiesView,
    ImageView,
    Line2,
    Line3,
    Mesh3,
    Points3,
    PosesView,
    SceneView,
    SeriesView,
)
from pomona.tools.dashboard.security import Access
from pomona.tools.dashboard.server import Dashboard

GATE = threading.Event()
"""`Hold` waits for it: a test decides when a run goes on."""


SIZES = {"desk": (1440, 900), "small desk": (1280, 720), "tablet": (820, 1180), "phone": (390, 844)}
"""Windows in which everything must be in sight [px]."""

HOLD = "pomona: 1\ntree: demo\nroot:\n  sequence:\n    - Hold: {}\n    - Rest: {}\n"
APPROVED = """pomona: 1
tree: demo
root:
  sequence:
    - Look: {seen: '{seen}'}
    - Rest: {duration: 40 ms}
      approve: true
    - Hold: {}
"""


class Hold(Skill):
    """Turn the wheel until the test opens the gate."""

    devices = (Wheel,)

    def run(self) -> Work:
        wheel = self.device(Wheel)
        wheel.start()
        try:
            while not GATE.is_set():
                yield "waiting at the gate"
        except Interrupted:
            wheel.stop()
            while wheel.coasting:
                yield "coasting"
            raise
        wheel.stop()
        return {}


class Seen(Outputs):
    seen: str


class Look(Skill):
    """Show one view of each kind."""

    def run(self) -> Work[Seen]:
        image = np.zeros((48, 64, 3), np.uint8)
        outline = np.array([[8.0, 8.0], [40.0, 8.0], [40.0, 30.0]])
        self.publish(
            "camera",
            ImageView(image, (Line2(outline, "apple", "refined", True),), outline, "one apple"),
        )
        path = np.array([[0.0, 0.0, 0.0], [0.1, 0.2, 0.3]])
        self.publish(
            "path", SceneView((Line3(path, "planned path"),), (Points3(path, "tried", "tried"),))
        )
        triangle = Mesh3(
            np.array([[0.0, 0.0, 0.1], [0.2, 0.0, 0.1], [0.0, 0.2, 0.1]]),
            np.array([[0, 1, 2]]),
            "arm",
            "robot",
        )
        self.publish("robot", BodiesView((triangle,)))
        for x in (0.0, 0.1):
            self.publish(
                "robot",
                PosesView(np.array([[x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]), np.array([x, 0.0, 0.1])),
            )
        t = np.arange(5) * 0.002
        self.publish(
            "grip", SeriesView(t, {"grasp force [N]": t, "width [m]": t}, {"limit [N]": 0.005})
        )
        yield None
        return Seen("an apple")


class Murmur(Skill):
    """Log two lines."""

    def run(self) -> Work:
        self.logger.info("<b>the scale</b> reads 151.5 g")
        yield None
        self.logger.warning("the scale drifts")


class Jam(Skill):
    """Fail, with facts."""

    failures = ("JAMMED",)

    def run(self) -> Work:
        yield None
        raise self.failure("JAMMED", "the wheel is stuck", angle=0.5)


class Rest(Skill):
    """Let time pass."""

    def run(self, duration: Time = 0.1) -> Work[None]:
        yield from self.wait(duration)
        return {}


REGISTRY = Registry({"Hold": Hold, "Look": Look, "Jam": Jam, "Murmur": Murmur, "Rest": Rest})


def press_stop(page: Any) -> None:
    """Stop with the keys: Esc twice."""
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")


DRAWN = """async () => {
    const { page } = await import("/static/page.js");
    const next = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    do await next(); while (page.dirty || page.drawing);
}"""
"""Waits in the page until it has drawn the latest messages."""


class Wire:
    """The connection between a page and its server; data pass while `open` is True."""

    def __init__(self, page: Any) -> None:
        self.open = True
        page.route_web_socket("**/live*", self._stream)
        page.route("**/api/act", self._request)

    def _stream(self, page_side: Any) -> None:
        server = page_side.connect_to_server()
        page_side.on_message(lambda said: self.open and server.send(said))
        server.on_message(lambda said: self.open and page_side.send(said))

    def _request(self, route: Any) -> None:
        if self.open:
            route.continue_()
        else:
            route.abort()  # the page has to take a network that swallows it for the same: no answer


class Show:
    """A dashboard, and runs of small trees on a cell without devices."""

    def __init__(self, records: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.dashboard = Dashboard(Access("127.0.0.1", port), records)
        self.records = records
        self.cell = FakeCell()
        self._threads: list[threading.Thread] = []

    def run(self, tree: str, name: str = "demo_1", *, seed: int = 0) -> Runner:
        """Start a run in a thread of its own; it holds a latched safe state until it is acknowledged."""
        runner, finish = self._make(tree, name, seed, [self.dashboard.hub.on_event])
        self.dashboard.control.serve(runner)

        def work() -> None:
            runner.run()
            runner.hold_latched()
            finish()

        self._threads.append(threading.Thread(target=work))
        self._threads[-1].start()
        return runner

    def record(self, tree: str, name: str, *, seed: int = 0) -> None:
        """Leave the record of a whole run."""
        runner, finish = self._make(tree, name, seed, [])
        runner.run()
        finish()

    def _make(
        self, tree: str, name: str, seed: int, listeners: list[Any]
    ) -> tuple[Runner, Callable[[], None]]:
        self.cell, events = FakeCell(), EventStream()
        document = read(tree, "tree.yaml")
        folder = self.records / name
        folder.mkdir()
        recorder = Recorder(folder)
        for listener in (recorder.on_event, *listeners):
            events.subscribe(listener)
        runner = Runner(
            lambda context, board: build(document, REGISTRY, context=context, board=board),
            self.cell,
            events,
            real_time=bool(listeners),
            attended=bool(listeners),
        )
        nodes = tuple(node.facts() for node in runner.tree.nodes)
        declared = document.main.parameters.items()
        texts = {
            name: written(parameter.default)
            for name, parameter in declared
            if parameter.default is not None
        }
        events.emit(
            RunStarted(
                0.0, 0, name, runner.tree.name, "tree.yaml", tree, f"hash{seed}", "fake", "mock", "fake.yaml", "",
                seed, runner.tree.parameters, nodes, {}, 0.0, 0.02, parameter_texts=texts,
            )
        )  # fmt: skip
        return runner, recorder.close

    def close(self) -> None:
        """End running processes."""
        GATE.set()
        runner = self.dashboard.control.runner
        if runner is not None:
            runner.safe_stop("the test is over")
            runner.leave()
        for thread in self._threads:
            thread.join(10.0)
        self.dashboard.close()
