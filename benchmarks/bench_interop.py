"""Cost and speed of other tools: live views, ROS 2 to another process, exports.

    python -m benchmarks.bench_interop [tick] [image] [joints] [export]

`tick`: the period's 99th percentile at 50 Hz without viewers, and with Foxglove (three clients) and ROS 2 (a subscriber
to everything), turn by turn. `image`: a picture of 640 x 480 from its publication to a listener in
another process. `joints`: joint states at 100 Hz for a minute, and how many arrived. `export`: a record of half an
hour.
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bench_dashboard import started, ticks
from pomona.executive.running.events import Event, NodeChanged, Published, RunEnded, RunStarted
from pomona.executive.views import ImageView, Pinhole

PORT = 17661
TURN, TURNS = 4.0, 5
"""Seconds of a turn with and without views, and how many of each."""
MINUTE, RATE = 60.0, 100
IMAGES = 200
HALF_HOUR = 1800.0


def _listen(port: int, topic: str, ready: Any, stop: Any, out: Any) -> None:
    """Another process: how late each message of a topic arrives, by the stamp in its attachment [s]."""
    import zenoh

    config = zenoh.Config()
    settings = {
        "mode": '"peer"',
        "connect/endpoints": f'["tcp/127.0.0.1:{port}"]',
        "listen/endpoints": "[]",
    }
    for key, value in {**settings, "scouting/multicast/enabled": "false"}.items():
        config.insert_json5(key, value)
    late: list[tuple[int, float]] = []

    def take(sample: Any) -> None:
        now, attachment = time.time(), sample.attachment.to_bytes()
        late.append(
            (
                int.from_bytes(attachment[:8], "little"),
                now - int.from_bytes(attachment[8:16], "little") / 1e9,
            )
        )

    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(f"0/{topic}", take)
        ready.set()
        stop.wait()
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    out.put(late)


class Listener:
    """A subscriber in a process of its own."""

    def __init__(self, topic: str) -> None:
        context = multiprocessing.get_context("spawn")
        ready, self._stop, self._out = context.Event(), context.Event(), context.Queue()
        self._process = context.Process(
            target=_listen, args=(PORT, topic, ready, self._stop, self._out)
        )
        self._process.start()
        ready.wait(60.0)
        time.sleep(1.0)

    def end(self) -> list[tuple[int, float]]:
        """Return the arrivals: number and delay [s]."""
        self._stop.set()
        late: list[tuple[int, float]] = self._out.get(timeout=20.0)
        self._process.join()
        return late


def _watch(link: str, stop: Any) -> None:
    """Another process: a client of Foxglove that subscribes to everything."""
    import json

    from websockets.sync.client import connect

    with connect(link, subprotocols=["foxglove.sdk.v1"], max_size=None) as client:  # type: ignore[list-item]
        number = 0
        while not stop.is_set():
            try:
                message = client.recv(timeout=0.2)
            except TimeoutError:
                continue
            if isinstance(message, str) and json.loads(message)["op"] == "advertise":
                wanted = []
                for channel in json.loads(message)["channels"]:
                    number += 1
                    wanted.append({"id": number, "channelId": channel["id"]})
                client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


def bridge() -> tuple[Any, Any]:
    """Return a peer and a bridge without an operator."""
    from pomona.tools.dashboard.control_lock import ControlLock
    from pomona.tools.ros2.bridge import Ros2Bridge
    from pomona.tools.ros2.peer import Ros2Peer

    peer = Ros2Peer(f"127.0.0.1:{PORT}")
    return peer, Ros2Bridge(peer, ControlLock(), lambda _token: False)


def bench_tick() -> None:
    """The tick's period with and without views."""
    from pomona.tools.exchange.foxglove_view import FoxgloveView
    from pomona.tools.exchange.live import Live

    _peer, ros2 = bridge()
    foxglove = FoxgloveView(PORT + 1)
    lives = [Live(ros2), Live(foxglove)]
    listener = Listener("**")
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    clients = [context.Process(target=_watch, args=(foxglove.link, stop)) for _ in range(3)]
    for client in clients:
        client.start()
    time.sleep(3.0)

    def shown(event: Event) -> None:
        for live in lives:
            live.on_event(event)
            if event.tick % 5 == 0 and isinstance(event, NodeChanged):
                live.read(event.t, event.tick, readings(event.t))

    begin = started(20)
    for live in lives:
        live.on_event(begin)
    found: dict[str, list[Any]] = {"no viewers": [], "all viewers": []}
    for _ in range(TURNS):
        found["no viewers"].append(ticks(lambda _event: None, TURN))
        found["all viewers"].append(ticks(shown, TURN))
    stop.set()
    for live in lives:
        live.close()
    listener.end()
    for client in clients:
        client.join()
    p99 = {
        name: np.percentile(np.concatenate(periods), 99) * 1e3 for name, periods in found.items()
    }
    alone, watched = p99.values()
    print(
        f"tick p99: {alone:.2f} ms alone, {watched:.2f} ms watched by {len(lives)} kinds: {watched / alone - 1:+.1%}"
    )
    print(f"events left out: {sum(live.dropped for live in lives)}")


def readings(t: float) -> dict[str, dict[str, Any]]:
    """A tenth of a second of an arm at 50 Hz and fingers at 500 Hz."""
    slow, fast = t - np.arange(5)[::-1] / 50.0, t - np.arange(50)[::-1] / 500.0
    parts = ("force_x_N", "force_y_N", "force_z_N", "torque_x_Nm", "torque_y_Nm", "torque_z_Nm")
    wrench = {f"finger_{n}_{part}": np.sin(fast) for n in (1, 2) for part in parts}
    joints = {f"q_{k}_rad": np.sin(slow * k) for k in range(1, 8)}
    return {"arm": {"stamp_s": slow, **joints}, "fingers": {"stamp_s": fast, **wrench}}


def look(t: float, tick: int, number: int) -> Published:
    """A picture of 640 x 480 with its depth."""
    image = np.full((480, 640, 3), number % 250, np.uint8)
    image[::7, ::5] = 255 - number % 250
    depth = np.full((480, 640), 0.5 + 0.001 * (number % 100), np.float32)
    return Published(
        t,
        tick,
        "a",
        "look",
        ImageView(image, depth=depth, pinhole=Pinhole(610.0, 610.0, 320.0, 240.0)),
    )


def bench_image() -> None:
    """From the event to a subscriber in another process."""
    from pomona.tools.exchange.live import Live

    _peer, ros2 = bridge()
    live, listener = Live(ros2), Listener("camera/look/image_raw/**")
    work = time.process_time()
    for number in range(IMAGES):
        now = time.time()
        live.on_event(
            RunStarted(**{**_fields(started(1)), "wall_time": now})
        )  # its stamp is when it was published
        live.on_event(look(0.0, number, number))
        time.sleep(0.1)
    work = time.process_time() - work
    late = sorted(seconds for _number, seconds in listener.end())
    live.close()
    print(
        f"image to another process: {len(late)} of {IMAGES}, median {1e3 * late[len(late) // 2]:.1f} ms, "
        f"p95 {1e3 * late[int(0.95 * len(late))]:.1f} ms, worst {1e3 * late[-1]:.1f} ms; "
        f"{1e3 * work / IMAGES:.1f} ms of the processor for each with its depth"
    )


def _fields(event: RunStarted) -> dict[str, Any]:
    return {name: getattr(event, name) for name in event.__dataclass_fields__}


def bench_joints() -> None:
    """A hundred joint states a second for a minute: as readings of an arm, ten at a time."""
    from pomona.tools.exchange.live import Live

    _peer, ros2 = bridge()
    live, listener = Live(ros2), Listener("joint_states/**")
    live.on_event(started(1))
    begin, sent = time.perf_counter(), 0
    while sent < MINUTE * RATE:
        stamps = (sent + np.arange(1, 11)) / RATE
        live.read(float(stamps[-1]), sent, {"arm": {"stamp_s": stamps, "q_1_rad": np.sin(stamps)}})
        sent += 10
        time.sleep(max(0.0, begin + sent / RATE - time.perf_counter()))
    time.sleep(1.0)
    numbers = [number for number, _late in listener.end()]
    live.close()
    in_order = numbers == sorted(numbers)
    print(
        f"joint states at {RATE} Hz for {MINUTE:.0f} s: {len(set(numbers))} of {sent} arrived, in order: {in_order}"
    )


def bench_export(folder: Path) -> None:
    """Half an hour: an arm at 50 Hz, fingers at 500 Hz, a look every ten seconds."""
    from pomona.executive.recording.recorder import Recorder
    from pomona.tools.ros2.rosbag2 import export_rosbag2

    (folder / "long").mkdir()
    recorder, t, tick = Recorder(folder / "long"), 0.0, 0
    recorder.on_event(started(20))
    while t < HALF_HOUR:
        t, tick = t + 0.1, tick + 5
        recorder.read(t, tick, readings(t))
        recorder.on_event(
            NodeChanged(t, tick, f"root/{1 + tick // 5 % 10}", "RUNNING", f"{t:.1f}", 1)
        )
        if tick % 500 == 0:
            recorder.on_event(look(t, tick, tick))
    recorder.on_event(RunEnded(t, tick, "success", None, tick, t, t, None))
    recorder.close()
    size = (folder / "long" / "run.mcap").stat().st_size / 1e6
    begin, wall = time.process_time(), time.perf_counter()
    export_rosbag2(folder / "long", folder / "bag")
    cost, wall = time.process_time() - begin, time.perf_counter() - wall
    speed = f"{wall:.0f} s, {HALF_HOUR / wall:.0f} x real time ({cost:.0f} s of work)"
    print(f"half an hour ({size:.0f} MB) as a bag: {speed}")
    if find_spec("pyarrow") is not None:
        from pomona.tools.exchange.lerobot import export_lerobot

        begin, wall = time.process_time(), time.perf_counter()
        export_lerobot([folder / "long"], folder / "dataset", 10)
        cost, wall = time.process_time() - begin, time.perf_counter() - wall
        print(
            f"the same as a dataset: {wall:.0f} s, {HALF_HOUR / wall:.0f} x real time ({cost:.0f} s of work)"
        )


def main(parts: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        for part in parts or ["tick", "image", "joints", "export"]:
            if part == "tick":
                bench_tick()
            elif part == "image":
                bench_image()
            elif part == "joints":
                bench_joints()
            elif part == "export":
                bench_export(Path(folder))


if __name__ == "__main__":
    main(sys.argv[1:])
