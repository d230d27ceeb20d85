"""Heaps and crates of fruit that touches, emptied by the tree `empty_crate`, judged by the simulator's truth.

    python -m benchmarks.bench_crate                             # 20 scenes of each kind
    python -m benchmarks.bench_crate --kinds heap5,crate6 --seeds 1..5 --out runs/bench_crate.jsonl

A scene is one run of the command `pomona run` with its own seed. Seeds from 101 on were used for tuning. A fruit counts
as cleared when it lies in the tray at the end. Rows are appended to the file; its scenes are not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pomona.applications.inventory.tally import Tally
from pomona.executive.execute import RunOrder, execute
from pomona.executive.running.events import Event, NodeChanged, PortWritten, RunStarted
from pomona.executive.values.installation import commit_here
from pomona.tools.library.campaign.statistics import wilson

ROOT = Path(__file__).parents[1]
KINDS = {
    "heap5": ("sim_heap", 5, "1"),
    "heap8": ("sim_heap", 8, "1"),
    "crate6": ("sim_crate", 6, "1"),
    "crate8": ("sim_crate", 8, "1"),
    "crate12": ("sim_crate", 12, "1"),
    "heap12": ("sim_heap", 12, "2"),
}
"""Cell, number of fruit and layers of each kind of scene; a tray has nine places, and no operator exchanges it here."""
TUNED_FROM = 101
MANOEUVRES = ("Hook", "Insert")
COUNTED = (
    *MANOEUVRES,
    "SampleHook",
    "SampleInsert",
    "SampleGrasp",
    "Plan",
    "Approach",
    "SlipAvoidGrasp",
    "Lift",
    "Release",
)
"""Skills whose failures are counted by code."""


class _Counter:
    """Counts the starts of manoeuvres in a run, and their failures by code."""

    def __init__(self) -> None:
        self.starts: Counter[str] = Counter()
        self.failures: Counter[str] = Counter()
        self.left: list[str] = []
        self._types: dict[str, str] = {}

    def __call__(self, event: Event) -> None:
        """Take an event."""
        if isinstance(event, RunStarted):
            self._types = {str(node["path"]): str(node["type"]) for node in event.nodes}
        if isinstance(event, PortWritten) and isinstance(event.value, Tally):
            self.left = [fruit.why for fruit in event.value.left]
        if not isinstance(event, NodeChanged) or event.status not in ("SUCCESS", "FAILURE"):
            return
        name = self._types.get(event.path, "")
        if name in MANOEUVRES:
            self.starts[name] += 1
        if event.reason is not None and name in COUNTED:
            self.failures[f"{name} {event.reason.code}"] += 1


def clear(kind: str, seed: int, settings: Mapping[str, str]) -> dict[str, Any]:
    """Run one scene and return its row."""
    (cell, number, layers), counter = KINDS[kind], _Counter()
    order = RunOrder(
        ROOT / "trees" / "empty_crate.yaml", ROOT / "trees" / "cells" / f"{cell}.yaml", seed,
        {"others": str(number - 1), "layers": layers, **settings}, cleared=True,
    )  # fmt: skip
    result = execute(order, [counter]).result
    truth = result.truth
    assert truth is not None
    return {
        "kind": kind,
        "seed": seed,
        "commit": commit_here(),
        "settings": dict(settings),
        "outcome": result.outcome,
        "reason": "" if result.reason is None else f"{result.reason.code}: {result.reason.message}",
        "fruit": number,
        "cleared": truth["put_away"],
        "time_s": result.time,
        "drops": truth["drops"],
        "lost": truth["lost"],
        "bruised": truth["bruised"],
        "largest_press": truth["largest_press"],
        "touched": truth["collided_with"],
        "finger_peak_n": truth["finger_peak_n"],
        "manoeuvres": dict(counter.starts),
        "failures": dict(counter.failures),
        "left": counter.left,
    }


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the figures of each kind as text."""
    lines = [
        "kind     scenes  cleared  of  share, 95 % interval   s per apple  dropped  lost  bruised  ended"
    ]
    for kind in KINDS:
        own = [row for row in rows if row["kind"] == kind]
        if not own:
            continue
        part, of = sum(row["cleared"] for row in own), sum(row["fruit"] for row in own)
        low, high = wilson(part, of)
        pace = np.median([row["time_s"] / max(row["cleared"], 1) for row in own])
        dropped, lost, bruised = (
            sum(row[key] for row in own) for key in ("drops", "lost", "bruised")
        )
        ended = sum(row["outcome"] == "success" for row in own)
        lines.append(
            f"{kind:8} {len(own):6} {part:8} {of:3}  {part / of:4.0%}  {low:4.0%} to {high:4.0%}   {pace:11.1f} "
            f"{dropped:8} {lost:5} {bruised:8} {ended:4} of {len(own)}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the scenes and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"of {', '.join(KINDS)}")
    parser.add_argument("--seeds", default="1..20", help="first and last seed")
    parser.add_argument("--out", type=Path, default=Path("runs/bench_crate.jsonl"))
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        help="a parameter of the tree or an option of the cell",
    )
    said = parser.parse_args()
    first, last = (int(number) for number in said.seeds.split(".."))
    said.out.parent.mkdir(parents=True, exist_ok=True)
    rows = (
        [json.loads(line) for line in said.out.read_text("utf-8").splitlines()]
        if said.out.is_file()
        else []
    )
    known = {(row["kind"], row["seed"]) for row in rows}
    for seed in range(first, last + 1):
        for kind in said.kinds.split(","):
            if (kind, seed) in known:
                continue
            row = clear(kind, seed, dict(each.split("=", 1) for each in said.set))
            if row["outcome"] == "stopped":  # by a signal: it counts for nothing, and none follows
                raise SystemExit("stopped")
            rows.append(row)
            with said.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
            sys.stdout.write(json.dumps(rows[-1]) + "\n")
            sys.stdout.flush()
    sys.stdout.write(table(rows) + "\n")
    if any(row["seed"] >= TUNED_FROM for row in rows):
        sys.stdout.write("some of these seeds were used for tuning\n")


if __name__ == "__main__":
    main()
