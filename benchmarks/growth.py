"""How costs grow: of a tick with nodes, of a record with length, of a campaign with runs, of the map with volume.

    python -m benchmarks.growth [--most 10000]

Costs are processor time of this process. The exponent b of cost = a · size^b is the slope of a line through the
logarithms, over all sizes and from each size to the next: 1 is linear, 2 is quadratic.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from py_trees.behaviour import Behaviour

from benchmarks.bench_tree import GROUP, Spin, processor, tree_text
from benchmarks.planning_scenes import table_look
from pomona.drivers.interfaces import Workspace
from pomona.executive.cell.cell import dry_cell
from pomona.executive.language import build, check, read
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.registry import Registry
from pomona.executive.running.runner import Runner
from pomona.executive.running.tick import EventStream
from pomona.executive.skill import Skill, Work
from pomona.executive.skill_testing import BenchContext
from pomona.skills.motion.occupancy import OccupancyMap, integrate
from pomona.tools.campaign.report import report
from pomona.tools.campaign.run import run_campaign
from pomona.tools.campaign.spec import read_campaign

PERIOD = 0.02
"""Of a tick [s]."""

MOST_NODES = 10_000
"""Nodes that a tree can have, with its root."""

COUNTING = """\
pomona: 1
tree: count
root:
  parallel:
    - wait: {seconds:.2f} s
    - parallel:
{skills}  success_on: one
"""

CAMPAIGN = """\
pomona: 1
campaign: growth
tree: pick_apple
cell: sim
seeds: {seeds}
vary: {{fruit: [apple_1, apple_5], place: [1, 2, 3, 4, 5]}}
"""

STEPS_OF_A_PICK = (
    "Detect",
    "Refine",
    "UpdateMap",
    "SampleGrasp",
    "Plan",
    "Follow",
    "Approach",
    "Lift",
)


class Count(Skill):
    """A skill whose feedback changes in every tick."""

    def run(self) -> Work[None]:
        ticks = 0
        while True:
            ticks += 1
            yield f"{ticks} ticks"


class Answering:
    """An engine that answers each order at once with the summary of a pick."""

    workers = 1

    def map(
        self, _function: object, orders: Sequence[object], _limit: float
    ) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield one summary for each order, with figures that differ."""
        steps = {
            "robot_time_s": dict.fromkeys(STEPS_OF_A_PICK, 0.5),
            "compute_s": dict.fromkeys(STEPS_OF_A_PICK, 0.1),
        }
        for index in range(len(orders)):
            truth = {
                "lifted": True,
                "slip_mm": abs(math.sin(index)),
                "peak_force_n": 4.0 + math.sin(index),
            }
            yield (
                index,
                {
                    "outcome": "success",
                    "reason": None,
                    "time_s": 4.0 + math.cos(index),
                    **steps,
                    "truth": truth,
                },
            )


class Cost(NamedTuple):
    """A cost at one size: its name, the unit of the size, the size, and the cost with its unit."""

    name: str
    per: str
    size: int
    cost: float
    unit: str = "ms"


def milliseconds(work: Callable[[], object], repeats: int = 3) -> float:
    """Return the least processor time of some repeats [ms]."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        work()
        times.append(1e3 * (time.process_time() - began))
    return min(times)


def ticked_often(root: Behaviour, ticks: int) -> None:
    """Tick a tree."""
    for _ in range(ticks):
        root.tick_once()


def recorded(runner: Runner, recorder: Recorder) -> None:
    """Carry out a run and close its record."""
    runner.run()
    recorder.close()


def of_nodes(size: int) -> Iterator[Cost]:
    """A tick, and the check of a file: parallels of nine polling skills each, in a parallel."""
    size = min(size, MOST_NODES - GROUP - 1)
    text, skills = tree_text(size), Registry({"Spin": Spin})
    nodes = 1 + max(1, size // (GROUP + 1)) * (GROUP + 1)
    root = build(read(text, "spin.yaml"), skills, context=BenchContext()).root
    root.tick_once()
    ticks = max(3, 20_000 // size)
    ticked = milliseconds(lambda: ticked_often(root, ticks))
    yield Cost("tick of a tree", "nodes", nodes, 1e3 * ticked / ticks, "µs")
    yield Cost(
        "read and check a tree file",
        "nodes",
        nodes,
        milliseconds(lambda: check(read(text, "s.yaml"), skills)),
    )


def of_length(ticks: int) -> Iterator[Cost]:
    """A run with its record, reading the record, and its size: nine skills, each of which changes in every tick."""
    text = COUNTING.format(seconds=ticks * PERIOD, skills="        - Count: {}\n" * GROUP)
    document, skills = read(text, "count.yaml"), Registry({"Count": Count})
    with tempfile.TemporaryDirectory() as folder:
        events, recorder = EventStream(), Recorder(Path(folder))
        events.subscribe(recorder.on_event)
        runner = Runner(
            lambda context, board: build(document, skills, context=context, board=board),
            dry_cell(),
            events,
        )
        yield Cost(
            "run and record", "ticks", ticks, milliseconds(lambda: recorded(runner, recorder), 1)
        )
        yield Cost(
            "read a record",
            "ticks",
            ticks,
            milliseconds(lambda: list(read_events(Path(folder))), 1),
        )
        yield Cost(
            "size of a record",
            "ticks",
            ticks,
            (Path(folder) / EVENTS_FILE).stat().st_size / 1e3,
            "kB",
        )


def of_runs(runs: int) -> Iterator[Cost]:
    """Planning a campaign, its bookkeeping without the runs themselves, and its report."""
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "growth.yaml", Path(folder) / "out"
        path.write_text(CAMPAIGN.format(seeds=runs // 10))
        campaign = read_campaign(path)
        yield Cost("plan a campaign", "runs", runs, milliseconds(lambda: read_campaign(path), 1))
        engine = Answering()
        yield Cost(
            "keep its results",
            "runs",
            runs,
            milliseconds(lambda: run_campaign(campaign, out, engine), 1),
        )
        results = list(run_campaign(campaign, out, engine).values())
        page = milliseconds(
            lambda: report(campaign, results, "growth.yaml").write(out, "report"), 1
        )
        yield Cost("write its report", "runs", runs, page)


def of_volume(cells: int) -> Iterator[Cost]:
    """One depth image into a map of 20 mm cells, and the map's distance field."""
    frame, T_base_camera = table_look()
    half = 0.01 * round(cells ** (1.0 / 3.0))
    lower, upper = (
        np.array([-half, -0.45 - half, -0.15]),
        np.array([half, half - 0.45, 2.0 * half - 0.15]),
    )
    workspace, empty = Workspace(-0.12, lower, upper), OccupancyMap.empty(lower, upper, 0.02)
    maps = [integrate(empty, frame, T_base_camera, workspace) for _ in range(4)]
    _ = maps[3].field  # compiled
    fused = milliseconds(lambda: integrate(empty, frame, T_base_camera, workspace), 5)
    yield Cost("add a depth image to the map", "cells", empty.states.size, fused)
    waiting = iter(maps)
    yield Cost(
        "distance field of the map",
        "cells",
        empty.states.size,
        milliseconds(lambda: next(waiting).field),
    )


def exponent(costs: Sequence[Cost]) -> float:
    """Return b of cost = a · size^b by least squares through the logarithms."""
    return float(np.polyfit(np.log([c.size for c in costs]), np.log([c.cost for c in costs]), 1)[0])


def row(costs: Sequence[Cost]) -> str:
    """Return one cost's row of the table."""
    first = costs[0]
    cells = ", ".join(f"{c.size}: {c.cost:.3g}" for c in costs)
    between = ", ".join(f"{exponent(costs[k : k + 2]):.2f}" for k in range(len(costs) - 1))
    return f"| {first.name} [{first.unit}] | {first.per} | {cells} | **{exponent(costs):.2f}** | {between} |"


def main() -> None:
    """Measure and print the table, row by row."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--most", type=int, default=10_000, help="nodes, ticks and runs")
    most: int = parser.parse_args().most
    sizes = [size for size in (10, 100, 1_000, 10_000) if size <= most]
    volumes = [cells for cells in (8_000, 64_000, 512_000, 4_096_000) if cells <= 410 * most]
    print(
        f"{processor()}\n\n| cost | size | size: cost | exponent | from size to size |\n|---|---|---|---|---|"
    )
    for measure, counts in (
        (of_nodes, sizes),
        (of_length, sizes[1:]),
        (of_runs, sizes),
        (of_volume, volumes),
    ):
        for costs in zip(*(tuple(measure(count)) for count in counts), strict=True):
            print(row(costs), flush=True)


if __name__ == "__main__":
    main()
