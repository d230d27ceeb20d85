"""Heaps and crates of fruit that touches, emptied by the tree `empty_crate`, judged by the simulator's truth.

    python -m benchmarks.bench_crate                             # 20 scenes of each kind
    python -m benchmarks.bench_crate --kinds heap5,crate6 --seeds 1..5 --out runs/bench_crate.jsonl

A scene is one run of the command `pomona run` with its own seed. Seeds from 101 on were used for tuning. A fruit counts
as cleared when it lies in the tray at the end. Rows are appended to the file; its scenes are not run again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.values.installation import commit_here
from pomona.tools.campaign.statistics import wilson

ROOT = Path(__file__).parents[1]
KINDS = {"heap5": ("sim_heap", 5), "heap8": ("sim_heap", 8), "crate6": ("sim_crate", 6), "crate8": ("sim_crate", 8)}
"""Cell and number of fruit of each kind of scene."""
TUNED_FROM = 101
LIMIT = 7200.0  # wall-clock time after which a scene is given up [s]


def clear(kind: str, seed: int, settings: Sequence[str] = ()) -> dict[str, Any]:
    """Run one scene and return its row."""
    commit, (cell, number) = commit_here(), KINDS[kind]
    command = [
        *(sys.executable, "-m", "pomona.executive.cli", "run", str(ROOT / "trees" / "empty_crate.yaml")),
        *("--cell", str(ROOT / "trees" / "cells" / f"{cell}.yaml"), "--seed", str(seed), "--no-record", "--json"),
        *("--cleared", "--set", f"others={number - 1}", *(word for one in settings for word in ("--set", one))),
    ]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    lines = ended.stdout.strip().splitlines()
    if not lines:
        raise SystemExit(f"{kind}, seed {seed}: the run printed no result: {ended.stderr[-2000:]}")
    found = json.loads(lines[-1])
    tally, truth = (found.get("values") or {}).get("tally") or {"left": []}, found["truth"]
    return {
        "kind": kind,
        "seed": seed,
        "commit": commit,
        "outcome": found["outcome"],
        "reason": (found.get("reason") or {}).get("message", ""),
        "fruit": number,
        "cleared": truth["put_away"],
        "time_s": found["time_s"],
        "drops": truth["drops"],
        "lost": truth["lost"],
        "bruised": truth["bruised"],
        "largest_press": truth["largest_press"],
        "touched": truth["collided_with"],
        "finger_peak_n": truth["finger_peak_n"],
        "left": [each["why"] for each in tally["left"]],
    }


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the figures of each kind as text."""
    lines = ["kind     scenes  cleared  of  share, 95 % interval   s per apple  dropped  lost  bruised  ended"]
    for kind in KINDS:
        own = [row for row in rows if row["kind"] == kind]
        if not own:
            continue
        part, of = sum(row["cleared"] for row in own), sum(row["fruit"] for row in own)
        low, high = wilson(part, of)
        pace = np.median([row["time_s"] / max(row["cleared"], 1) for row in own])
        dropped, lost, bruised = (sum(row[key] for row in own) for key in ("drops", "lost", "bruised"))
        ended = sum(row["outcome"] == "success" for row in own)
        lines.append(
            f"{kind:8} {len(own):6} {part:8} {of:3}  {part / of:4.0%}  {low:4.0%} to {high:4.0%}   {pace:11.1f} "
            f"{dropped:8} {lost:5} {bruised:8} {ended:4} of {len(own)}"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the scenes and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", default=",".join(KINDS), help=f"of {', '.join(KINDS)}")
    parser.add_argument("--seeds", default="1..20", help="first and last seed")
    parser.add_argument("--out", type=Path, default=Path("runs/bench_crate.jsonl"))
    parser.add_argument("--set", action="append", default=[], help="a parameter of the tree or an option of the cell")
    said = parser.parse_args()
    first, last = (int(number) for number in said.seeds.split(".."))
    said.out.parent.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in said.out.read_text("utf-8").splitlines()] if said.out.is_file() else []
    known = {(row["kind"], row["seed"]) for row in rows}
    for seed in range(first, last + 1):
        for kind in said.kinds.split(","):
            if (kind, seed) in known:
                continue
            rows.append(clear(kind, seed, said.set))
            with said.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
            sys.stdout.write(json.dumps(rows[-1]) + "\n")
            sys.stdout.flush()
    sys.stdout.write(table(rows) + "\n")
    if any(row["seed"] >= TUNED_FROM for row in rows):
        sys.stdout.write("some of these seeds were used for tuning\n")


if __name__ == "__main__":
    main()
