"""Cost of a whole run relative to bare py_trees, with recording off and on, and the jitter of ticks on the system's
clock.

    python -m benchmarks.bench_runner

Compared in one run: the same tree of polling leaves, ticked by bare py_trees, by the runner, and by the runner with a
recorder. Jitter: a tree at 50 Hz on the system's clock while a thread multiplies matrices in torch (as a detector does)
and a worker process is busy (as a planner is).
"""

from __future__ import annotations

import itertools
import statistics
import tempfile
import time
from pathlib import Path

import torch

from benchmarks.bench_tree import Spin, bare_tree, seconds_per_tick
from pomona.executive.cell.cell import Cell, dry_cell
from pomona.executive.clock import SystemClock
from pomona.executive.language import build, read
from pomona.executive.recording.recorder import Recorder
from pomona.executive.registry import Registry
from pomona.executive.running.compute import Computations
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream

SKILLS = Registry({"Spin": Spin})
ROUNDS = 5
PERIOD = 0.02


def tree_text(nodes: int, duration: float) -> str:
    """Parallels of nine polling skills, until the time is over."""
    group = "        - parallel:\n" + "            - Spin: {}\n" * 9
    body = group * max(1, nodes // 10)
    return (
        "pomona: 1\ntree: spin\nroot:\n  parallel:\n"
        f"    - wait: {duration:.3f} s\n    - parallel:\n{body}"
        "  success_on: one\n"
    )


def runner_tick(nodes: int, ticks: int, record: Path | None) -> float:
    """Processor seconds of one tick of a whole run, the recorder's thread included."""
    document = read(tree_text(nodes, ticks * PERIOD), "spin.yaml")
    events = EventStream()
    recorder = None if record is None else Recorder(record)
    if recorder is not None:
        events.subscribe(recorder.on_event)
    runner = Runner(
        lambda context, board: build(document, SKILLS, context=context, board=board),
        dry_cell(),
        events,
    )
    began = time.process_time()
    result = runner.run()
    if recorder is not None:
        recorder.close()
    assert result.outcome == "success", result.reason
    return (time.process_time() - began) / result.ticks


def overhead() -> None:
    """Print one line for each size."""
    for nodes, ticks in ((10, 4000), (100, 1000), (1000, 200)):
        bare, run, recorded = [], [], []
        for _ in range(ROUNDS):
            root = bare_tree(nodes)
            root.tick_once()
            bare.append(seconds_per_tick(root, ticks))
            run.append(runner_tick(nodes, ticks, None))
            with tempfile.TemporaryDirectory() as folder:
                recorded.append(runner_tick(nodes, ticks, Path(folder)))
        base = statistics.median(bare)
        off, on = statistics.median(run) / base, statistics.median(recorded) / base
        print(
            f"{nodes:5} nodes: bare tick {base * 1e6:7.1f} µs   runner {off:.2f} ×   recording {on:.2f} ×"
        )


def busy_process(seconds: float) -> float:
    """Keep a process busy."""
    end, x = time.perf_counter() + seconds, 0.0
    while time.perf_counter() < end:
        x += 1.0
    return x


def busy_thread(seconds: float) -> float:
    """Keep torch busy in this thread; it lets go of the interpreter's lock inside the product."""
    end, a = time.perf_counter() + seconds, torch.ones(512, 512)
    while time.perf_counter() < end:
        a = (a @ a) * 1e-3
    return float(a[0, 0])


class RealDryCell(Cell):
    """Nothing, on the system's clock; notes when it is looked after, which is once a tick."""

    def __init__(self) -> None:
        super().__init__("dry", "mock", SystemClock(), {})
        self.looks: list[float] = []

    def check(self) -> None:
        self.looks.append(time.perf_counter())


def jitter(seconds: float = 10.0) -> None:
    """Print how far tick periods are from 20 ms."""
    torch.set_num_threads(1)
    document = read(tree_text(100, seconds), "spin.yaml")
    cell, computations = RealDryCell(), Computations()
    runner = Runner(
        lambda context, board: build(document, SKILLS, context=context, board=board),
        cell,
        EventStream(),
    )
    computations.submit(
        "bench", busy_process, (0.0,), True
    ).result()  # its worker is there, as in a prepared run
    computations.submit("bench", busy_thread, (seconds,), False)
    computations.submit("bench", busy_process, (seconds,), True)
    runner.run()
    computations.close()
    periods = [after - before for before, after in itertools.pairwise(cell.looks[5:])]
    off = sorted(abs(period - PERIOD) for period in periods)
    p50, p99 = off[len(off) // 2], off[int(len(off) * 0.99)]
    print(f"jitter at 50 Hz, {len(off)} ticks beside a busy network and planner: median {p50 * 1e3:.2f} ms, "
          f"p99 {p99 * 1e3:.2f} ms, most {off[-1] * 1e3:.2f} ms")  # fmt: skip


if __name__ == "__main__":
    overhead()
    jitter()
