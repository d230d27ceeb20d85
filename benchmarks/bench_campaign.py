"""Throughput of a campaign on two local workers relative to one, beside the machine's own gain.

    python -m benchmarks.bench_campaign [--picks 12] [--rounds 3]

Picks on the simulated cell with warm workers. A plain loop in one and in two processes, timed in the same rounds, shows
how much two processors are worth on this machine at this time: on a machine with other things to do it is less than 2.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import time
from collections.abc import Callable
from typing import Any

from pomona.executive.execute import RunOrder
from pomona.executive.files import find_cell, find_tree
from pomona.tools.campaign.engine import Engine, open_engine
from pomona.tools.campaign.run import RUN_LIMIT, run_order


def loop(count: int) -> int:
    """Work that shares nothing."""
    total = 0
    for i in range(count):
        total += i * i
    return total


def throughput(
    engine: Engine, function: Callable[..., Any], orders: list[tuple[Any, ...]]
) -> float:
    """Orders per second; every worker has done one before."""
    for _ in engine.map(function, orders[: engine.workers], RUN_LIMIT):
        pass
    started = time.perf_counter()
    for _index, answer in engine.map(function, orders, RUN_LIMIT):
        if isinstance(answer, BaseException):
            raise answer
    return len(orders) / (time.perf_counter() - started)


def main() -> None:
    """Print both, round by round, and the medians."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--picks", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    cells = itertools.cycle(itertools.product(("apple_1", "apple_3", "apple_5"), "12345"))
    tree, cell = find_tree("pick_apple"), find_cell("sim")
    picks = [
        (RunOrder(tree, cell, seed, {"fruit": fruit, "place": place, "distractors": "0"}),)
        for seed, (fruit, place) in zip(range(options.picks), cells, strict=False)
    ]
    loops = [(2_000_000,)] * 12
    ratios: list[tuple[float, float]] = []
    with open_engine("local", 1) as one, open_engine("local", 2) as two:
        for number in range(options.rounds):
            rates = [throughput(engine, run_order, picks) for engine in (one, two)]
            plain = [throughput(engine, loop, loops) for engine in (one, two)]
            ratios.append((rates[1] / rates[0], plain[1] / plain[0]))
            print(
                f"round {number + 1}: {rates[0]:.3f} picks/s with one worker, {rates[1]:.3f} with two: "
                f"× {ratios[-1][0]:.2f}; a plain loop: × {ratios[-1][1]:.2f}",
                flush=True,
            )
    picked, looped = (statistics.median(column) for column in zip(*ratios, strict=True))
    print(
        f"median: × {picked:.2f}; a plain loop: × {looped:.2f}; share of what the machine gives: {picked / looped:.0%}"
    )


if __name__ == "__main__":
    main()
