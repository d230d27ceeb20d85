"""What the executive's tree costs: a tick beside bare py_trees, and the check of a large file.

    python -m benchmarks.bench_tree

Both trees have the same shape and leaves that poll a generator; they are ticked in turns in one run, without recording.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator

import py_trees
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from executive.language import build, check, read
from executive.registry import Registry
from executive.skill import Skill, Work
from executive.skill_testing import BenchContext

SIZES = (10, 100, 1000)
ROUNDS = 15
GROUP = 9


class Spin(Skill):
    """Never ends."""

    failures = ("NEVER",)

    def run(self) -> Work[None]:
        while True:
            yield None


class BareSpin(Behaviour):
    """The same on bare py_trees."""

    def initialise(self) -> None:
        self.work = self.body()

    def body(self) -> Iterator[None]:
        while True:
            yield None

    def update(self) -> Status:
        next(self.work)
        return Status.RUNNING


def tree_text(nodes: int) -> str:
    """A tree file with so many nodes: parallels of nine skills each, in a parallel."""
    group = "    - parallel:\n" + "        - Spin: {}\n" * GROUP
    return "pomona: 1\ntree: spin\nroot:\n  parallel:\n" + group * max(1, nodes // (GROUP + 1))


def bare_tree(nodes: int) -> Behaviour:
    """The same tree, made of py_trees' own composites."""
    policy = ParallelPolicy.SuccessOnAll
    groups = [
        py_trees.composites.Parallel(f"group {i}", policy(), [BareSpin(f"spin {i} {j}") for j in range(GROUP)])
        for i in range(max(1, nodes // (GROUP + 1)))
    ]
    return py_trees.composites.Parallel("root", policy(), groups)


def seconds_per_tick(root: Behaviour, ticks: int) -> float:
    """Mean processor time of a tick."""
    began = time.process_time()
    for _ in range(ticks):
        root.tick_once()
    return (time.process_time() - began) / ticks


def main() -> None:
    """Print one line for each size."""
    skills = Registry({"Spin": Spin})
    for nodes in SIZES:
        text = tree_text(nodes)
        ours = build(read(text, "spin.yaml"), skills, context=BenchContext()).root
        bare = bare_tree(nodes)
        ticks = max(3, 3000 // nodes)
        seconds_per_tick(ours, 3), seconds_per_tick(bare, 3)
        pairs = [(seconds_per_tick(ours, ticks), seconds_per_tick(bare, ticks)) for _ in range(ROUNDS)]
        ratio = statistics.median(a / b for a, b in pairs)
        checks = []
        for _ in range(3):
            began = time.process_time()
            check(read(text, "spin.yaml"), skills)
            checks.append(time.process_time() - began)
        ours_us, bare_us = (1e6 * statistics.median(times) for times in zip(*pairs, strict=True))
        print(
            f"{nodes:5d} nodes: tick {ours_us:7.0f} us, bare py_trees {bare_us:7.0f} us, ratio {ratio:.2f}; "
            f"read and check {1e3 * min(checks):.0f} ms"
        )


if __name__ == "__main__":
    main()
