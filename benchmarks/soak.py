"""Many picks in one process: memory, handles, threads and the time of a tick must stay flat.

    python -m benchmarks.soak --picks 1000                 # the simulated pick, recorded; hours
    python -m benchmarks.soak --picks 60 --dry             # mocks for all skills: the executive alone, for CI

Flat: over the second half of the picks the median of the last quarter is at most `GROWTH` above that of the one before.
"""

from __future__ import annotations

import argparse
import gc
import multiprocessing
import os
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path

from pomona.executive.execute import RunOrder, execute, give_back_memory
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.compute import keep_workers_warm

GROWTH = 0.01
"""Share by which a quantity may grow over the second half."""
SEEDS = 50
"""Seeds come again after so many picks, so that every quarter has the same work."""


def resident_mb(process: str) -> float:
    """Resident memory of a process [MB]."""
    return (
        int(Path(f"/proc/{process}/statm").read_text().split()[1])
        * os.sysconf("SC_PAGE_SIZE")
        / 1e6
    )


def measure() -> dict[str, float]:
    """Return resources of this process: its own and its workers' resident memory [MB], open handles, threads."""
    workers = [resident_mb(str(worker.pid)) for worker in multiprocessing.active_children()]
    return {
        "memory_mb": resident_mb("self"),
        "workers_mb": sum(workers),
        "handles": float(len(os.listdir("/proc/self/fd"))),
        "threads": float(threading.active_count()),
    }


def growth(values: list[float]) -> float:
    """By which share the last quarter lies above the third one."""
    quarter = max(1, len(values) // 4)
    before, after = (
        statistics.median(values[-2 * quarter : -quarter]),
        statistics.median(values[-quarter:]),
    )
    return after / before - 1.0 if before else 0.0


def soak(picks: int, tree: str, dry: bool) -> dict[str, list[float]]:
    """Run the tree so many times; each quantity after each run, and the processor's time per tick [ms]."""
    seen: dict[str, list[float]] = {}
    keep_workers_warm()
    with tempfile.TemporaryDirectory(prefix="pomona-soak-") as folder:
        for number in range(picks):
            record = Path(folder) / "runs"
            order = RunOrder(
                find_tree(tree), find_cell("sim"), seed=number % SEEDS, record=record, dry=dry
            )
            began = time.process_time()
            executed = execute(order)
            spent = time.process_time() - began
            gc.collect()  # unreferenced objects are not counted
            give_back_memory()
            now = measure()
            if (
                not dry
            ):  # a dry run's ticks are too few and too short to be timed on a shared machine
                now["tick_ms"] = 1e3 * spent / max(executed.result.ticks, 1)
            for name, value in now.items():
                seen.setdefault(name, []).append(value)
            if executed.record is not None:
                for path in executed.record.iterdir():
                    path.unlink()
                executed.record.rmdir()
            if number % 50 == 0 and not dry:
                print(
                    f"{number:5d} " + "  ".join(f"{k} {v:.2f}" for k, v in now.items()), flush=True
                )
    return seen


def main() -> int:
    """Returns 0 when all is flat."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--picks", type=int, default=1000)
    parser.add_argument("--tree", default="pick_apple")
    parser.add_argument("--dry", action="store_true")
    options = parser.parse_args()
    grown = 0
    for name, values in soak(options.picks, options.tree, options.dry).items():
        more = growth(values)
        grown += more > GROWTH
        print(
            f"{'✗' if more > GROWTH else '✓'} {name:10s} first {values[0]:.2f}, last {values[-1]:.2f}, {more:+.2%}"
        )
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main())
