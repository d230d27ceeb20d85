"""Cost of the executive's tree: a tick relative to bare py_trees, the check of a large file, an editor's answers on it.

    python -m benchmarks.bench_tree            # all
    python -m benchmarks.bench_tree --check    # the check and the editor only: twenty seconds

Both trees have the same shape and leaves that poll a generator; they are ticked in turns in one run, without recording.
The file that is checked wires the shipped skills' ports, with modifiers, conditions and fallbacks. Times are of the
processor, but for those over the streams of `pomona lsp`; the least of some runs is printed beside the median, since
others on the machine make every run slower.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import py_trees
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status

from pomona.executive.language import build, check, read
from pomona.executive.language.expression import parse_expression
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill, Work
from pomona.executive.skill_testing import BenchContext
from pomona.tools.editor.service import TreeService

SIZES = (10, 100, 1000)
ROUNDS = 15
GROUP = 9


WIRED = """\
    - fallback:
        - sequence:
            - MoveTo: {{pose: observe, speed: 0.5}}
              timeout: 20 s
            - Detect: {{fruit: apple, detection: "{{found_{0}}}"}}
              timeout: 5 s
              retry: 3
            - check: "{{found_{0}.score}} > 0.8"
            - Refine: {{detection: "{{found_{0}}}", measured: "{{apple_{0}}}"}}
            - UpdateMap: {{map: "{{map_{0}}}"}}
            - SampleGrasp: {{around: "{{apple_{0}}}", map: "{{map_{0}}}", candidates: "{{grasps_{0}}}"}}
            - Plan: {{to: "{{grasps_{0}}}", map: "{{map_{0}}}", path: "{{path_{0}}}", budget: 300 ms}}
            - Follow: {{path: "{{path_{0}}}"}}
              guard: "{{apple_{0}.inlier_ratio}} > 0.6"
        - fail: {{code: NOT_FOUND}}
"""
"""Eleven nodes with ports."""


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
        py_trees.composites.Parallel(
            f"group {i}", policy(), [BareSpin(f"spin {i} {j}") for j in range(GROUP)]
        )
        for i in range(max(1, nodes // (GROUP + 1)))
    ]
    return py_trees.composites.Parallel("root", policy(), groups)


def seconds_per_tick(root: Behaviour, ticks: int) -> float:
    """Mean processor time of a tick."""
    began = time.process_time()
    for _ in range(ticks):
        root.tick_once()
    return (time.process_time() - began) / ticks


def wired_text(nodes: int) -> str:
    """A tree file of shipped skills with so many nodes, every port wired to a name of its own."""
    return "pomona: 1\ntree: long\nroot:\n  sequence:\n" + "".join(
        map(WIRED.format, range(nodes // 11))
    )


def milliseconds(
    work: Callable[[], object], runs: int = 15, clock: Callable[[], float] = time.process_time
) -> str:
    """The least and the median time of some runs, the processor's unless another clock is given."""
    times = []
    for _ in range(runs):
        began = clock()
        work()
        times.append(1e3 * (clock() - began))
    return f"{min(times):.1f} ms (median {statistics.median(times):.1f})"


def check_afresh(text: str, skills: Registry) -> None:
    """Read and check a file as a process does that has seen none of its expressions."""
    parse_expression.cache_clear()
    check(read(text, "long.yaml"), skills)


def print_check(nodes: int) -> None:
    """Print the time for the check of a file, and the waiting times of an editor."""
    skills, text = Registry.installed(), wired_text(nodes)
    found = check(read(text, "long.yaml"), skills)
    document = read(text, "long.yaml")
    print(f"{nodes} nodes with ports, {len(text) // 1024} KiB, {len(found)} findings:")
    print(f"  read   {milliseconds(lambda: read(text, 'long.yaml'))}")
    print(f"  check  {milliseconds(lambda: check(document, skills))}")
    print(f"  both   {milliseconds(lambda: check(read(text, 'long.yaml'), skills))}")
    print(
        f"  both, no expression of it read before  {milliseconds(lambda: check_afresh(text, skills))}"
    )
    service = TreeService(Path("long.yaml"), skills)
    texts = [text, text.replace("speed: 0.5", "speed: 0.6", 1)]
    print(
        f"  editor: findings after a keystroke {milliseconds(lambda: service.update(texts[service.text == text]))}"
    )
    lines = text.split("\n")
    row = max(number for number, line in enumerate(lines) if "inlier_ratio" in line)
    name, field = lines[row].index("apple_"), lines[row].index("inlier_ratio")
    print(f"  editor: completion of names {milliseconds(lambda: service.complete(row, name))}")
    print(f"  editor: completion of fields {milliseconds(lambda: service.complete(row, field))}")
    print(f"  editor: hover {milliseconds(lambda: service.hover(row, field))}")
    print(f"  editor: definition {milliseconds(lambda: service.definition_of(row, name))}")


def main() -> None:
    """Print one line for each size."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="no ticks")
    print(processor())
    if not parser.parse_args().check:
        print_ticks()
    print_check(1000)
    print_editor(1000)


class Editor:
    """An editor that speaks with `pomona lsp` over its streams."""

    def __init__(self) -> None:
        words = [sys.executable, "-c", "from pomona.executive.cli import main; main(['lsp'])"]
        self.server = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.asked = 0

    def tell(self, method: str, params: dict[str, Any], **more: Any) -> None:
        """Send a message."""
        assert self.server.stdin is not None
        body = json.dumps({"jsonrpc": "2.0", "method": method, "params": params, **more}).encode()
        self.server.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))
        self.server.stdin.flush()

    def hear(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The next message that is wanted."""
        assert self.server.stdout is not None
        while True:
            length = 0
            while line := self.server.stdout.readline().strip():
                if line.lower().startswith(b"content-length:"):
                    length = int(line.split(b":")[1])
            message: dict[str, Any] = json.loads(self.server.stdout.read(length))
            if wanted(message):
                return message

    def ask(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        """Ask, and wait for the answer."""
        self.asked += 1
        self.tell(method, params, id=self.asked)
        return self.hear(lambda message: message.get("id") == self.asked)


def print_editor(nodes: int) -> None:
    """Print how long an editor waits on a file, from its question over the streams to the answer, by a clock."""
    text = wired_text(nodes)
    document, version = {"uri": "file:///long.yaml"}, 1
    editor = Editor()
    editor.ask("initialize", {"processId": None, "rootUri": None, "capabilities": {}})
    editor.tell("initialized", {})
    told = lambda message: message.get("method") == "textDocument/publishDiagnostics"  # noqa: E731
    opened = {**document, "languageId": "yaml", "version": version, "text": text}
    editor.tell("textDocument/didOpen", {"textDocument": opened})
    assert editor.hear(told)["params"]["diagnostics"] == []
    time.sleep(10)  # it imports the skills beside its first answers
    lines = text.split("\n")
    row = max(number for number, line in enumerate(lines) if "inlier_ratio" in line)
    name, field = lines[row].index("apple_"), lines[row].index("inlier_ratio")

    def key() -> None:
        nonlocal version
        version += 1
        changed = text.replace("speed: 0.5", f"speed: 0.{5 + version % 2}", 1)
        changes = {
            "textDocument": {**document, "version": version},
            "contentChanges": [{"text": changed}],
        }
        editor.tell("textDocument/didChange", changes)
        editor.hear(told)

    def at(method: str, column: int) -> Callable[[], object]:
        asked = {"textDocument": document, "position": {"line": row, "character": column}}
        return lambda: editor.ask(f"textDocument/{method}", asked)

    for what, work in (
        ("findings after a keystroke", key), ("completion of names", at("completion", name)),
        ("completion of fields", at("completion", field)), ("hover", at("hover", field)),
        ("definition", at("definition", name)),
    ):  # fmt: skip
        print(
            f"  pomona lsp, over its streams: {what} {milliseconds(work, clock=time.perf_counter)}"
        )
    editor.ask("shutdown", {})
    editor.tell("exit", {})
    editor.server.wait(10)


def processor() -> str:
    """Name the processor of this machine."""
    found = (
        re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())
        if sys.platform == "linux"
        else None
    )
    cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count()
    return f"{found[1] if found else platform.processor()}, {cores} cores, Python {platform.python_version()}"


def print_ticks() -> None:
    """Print a tick beside bare py_trees for each size."""
    skills = Registry({"Spin": Spin})
    for nodes in SIZES:
        text = tree_text(nodes)
        ours = build(read(text, "spin.yaml"), skills, context=BenchContext()).root
        bare = bare_tree(nodes)
        ticks = max(3, 3000 // nodes)
        seconds_per_tick(ours, 3), seconds_per_tick(bare, 3)
        pairs = [
            (seconds_per_tick(ours, ticks), seconds_per_tick(bare, ticks)) for _ in range(ROUNDS)
        ]
        ratio = statistics.median(a / b for a, b in pairs)
        ours_us, bare_us = (1e6 * statistics.median(times) for times in zip(*pairs, strict=True))
        print(
            f"{nodes:5d} nodes: tick {ours_us:7.0f} us, bare py_trees {bare_us:7.0f} us, ratio {ratio:.2f}"
        )


if __name__ == "__main__":
    main()
