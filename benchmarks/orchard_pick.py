"""Simulated walls picked by the tree `pick_tree`, judged by the wall's own truth, in a report.

    python -m benchmarks.orchard_pick --walls 201..203 --leaves 0 --out docs/reports/orchard_pick

Each wall is one run of the command `pomona run`, with its own seed. The walls must not have been used for tuning:
walls 1 to 12 and 101 to 128 were looked at. Figures of a wall that was measured before are kept in `walls.json` of the
folder, so a report can grow. `--only-report` writes the page again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from pomona.executive.campaign.statistics import wilson
from pomona.executive.values.installation import commit_here

mpl.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).parents[1]
TREE, CELL = ROOT / "trees" / "experimental" / "pick_tree.yaml", ROOT / "trees" / "cells" / "orchard.yaml"
TUNED = (*range(1, 13), *range(101, 129))
"""Walls that were looked at while the skills were made, or for which errors were found."""
LIMIT = 7200.0
"""Wall-clock time after which a wall is given up [s]."""
COUNTED = ("apples", "reachable", "gripped", "detached", "picked", "dropped", "knocked_off", "bruised", "stems_torn")
GROUPS = {
    "ruled out": "no free grasp",
    "the stem held": "stem held",
    "the pads feel": "jammed",
    "touched something": "touched on the approach",
    "was lost": "lost",
    "the fruit left the pads": "slipped or lost",
    "the opening fell": "slipped or lost",
    "after closing": "not gripped",
}
"""Groups of the reasons in the tally, by a part of the sentence."""


def pick_wall(seed: int, leaves: float, extra: Sequence[str]) -> dict[str, Any]:
    """Run one wall and return its truth, its time and the reasons of the apples that were left."""
    command = [
        *(sys.executable, "-m", "pomona.executive.cli", "run", str(TREE), "--cell", str(CELL), "--seed", str(seed)),
        *("--set", f"leaves={leaves:g}", "--no-record", "--json", *extra),
    ]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    lines = ended.stdout.strip().splitlines()
    if not lines:
        raise SystemExit(f"wall {seed}: the run printed no result: {ended.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(lines[-1])
    truth, tally = found["truth"], (found.get("values") or {}).get("tally") or {"left": []}
    return {
        "seed": seed,
        "leaves": leaves,
        "commit": commit_here(),
        "outcome": found["outcome"],
        "reason": (found.get("reason") or {}).get("message", ""),
        "time_s": found["time_s"],
        "left": [each["why"] for each in tally["left"]],
        "truth": {key: truth.get(key) for key in (*COUNTED, "stem_force_median_n", "stem_force_p95_n", "numbers")},
    }


def group_of(why: str) -> str:
    """Return the group of a reason."""
    last = why.rpartition("the last: ")[2]
    return next((group for part, group in GROUPS.items() if part in last), last[:60])


def share(name: str, part: int, of: int) -> str:
    """Return a row: a share with its 95 % interval."""
    low, high = wilson(part, of)
    value = f"{part / of:.0%}" if of else "–"
    return f"| {name} | {part} of {of} | {value} | {low:.0%} to {high:.0%} |"


def report(walls: Sequence[Mapping[str, Any]], out: Path) -> str:
    """Return the page, and draw its picture."""
    total = Counter[str]()
    for wall in walls:
        total.update({key: int(wall["truth"].get(key) or 0) for key in COUNTED})
    time = sum(wall["time_s"] for wall in walls)
    why = Counter(group_of(each) for wall in walls for each in wall["left"])
    forces = [w["truth"]["stem_force_median_n"] for w in walls if w["truth"].get("stem_force_median_n") is not None]
    force = float(np.median(forces)) if forces else float("nan")
    rows = [
        share("in the bin, of those that both pads gripped", total["picked"], total["gripped"]),
        share("in the bin, of those with a free grasp and roll", total["picked"], total["reachable"]),
        share("in the bin, of all", total["picked"], total["apples"]),
        share("bruised, of all", total["bruised"], total["apples"]),
        share("neighbours knocked off, per detached apple", total["knocked_off"], max(total["detached"], 1)),
        share("dropped, per detached apple", total["dropped"], max(total["detached"], 1)),
    ]
    each = [
        f"| {w['seed']} | {w['leaves']:g} | " + " | ".join(str(w["truth"].get(key)) for key in COUNTED)
        + f" | {w['time_s']:.0f} | {w['outcome']} |"
        for w in walls
    ]  # fmt: skip
    draw(total, why, out / "picked.png")
    per_apple = time / total["picked"] if total["picked"] else float("nan")
    commits = ", ".join(f"`{c}`" for c in sorted({w["commit"] for w in walls}))
    stopped = [f"Wall {w['seed']} ended with *{w['outcome']}*: {w['reason']}." for w in walls if w["reason"]]
    return "\n".join([
        f"# Simulated: {total['apples']} apples of {len(walls)} fruit walls, picked by `pick_tree`",
        "",
        f"Simulated, at commit {commits} by `make orchard`. The tree is experimental. None of these walls was used for",
        "tuning. Perception is the shipped detector; ground truth serves the score alone. Stems break by the",
        "wall's law, whose bending strength is assumed and carries this motion",
        f"([decision](../../decisions/detach-by-rolling.md)). Numbers of the wall: {walls[0]['truth'].get('numbers')}.",
        "",
        "| figure | apples | share | 95 % interval |",
        "|---|---|---|---|",
        *rows,
        "",
        f"Time per apple in the bin: {per_apple:.1f} s (all looks and vain tries included). Stem force at the break: "
        f"{force:.1f} N (median of the walls' medians). Stems torn out: {total['stems_torn']}.",
        "The intervals count apples as independent; apples of one wall are not quite.",
        *(["", *stopped] if stopped else []),
        "",
        "| wall | leaves | " + " | ".join(key.replace("_", " ") for key in COUNTED) + " | time [s] | run |",
        "|---" * (len(COUNTED) + 4) + "|",
        *each,
        "",
        "| left on the wall because of | apples |",
        "|---|---|",
        *(f"| {name} | {count} |" for name, count in why.most_common()),
        "",
        "![what became of the apples](picked.png)",
        "",
    ])  # fmt: skip


def draw(total: Mapping[str, int], why: Mapping[str, int], path: Path) -> None:
    """Draw the way of the apples from the wall into the bin."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.2), layout="constrained")
    keys = ("apples", "reachable", "gripped", "detached", "picked")
    left.bar(keys, [total[key] for key in keys], color=["#8aa17a", "#8aa17a", "#c98b4a", "#c98b4a", "#b5453a"])
    for k, key in enumerate(keys):
        left.text(k, total[key], str(total[key]), ha="center", va="bottom")
    left.set_ylabel("apples (simulated)")
    names = [name for name, _ in Counter(why).most_common(7)][::-1]
    right.barh(names, [why[name] for name in names], color="#777777")
    right.set_xlabel("apples left, by reason")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def seeds_of(text: str) -> list[int]:
    """Return the numbers of walls: `201..203` or `201,205`."""
    first, dots, last = text.partition("..")
    return list(range(int(first), int(last) + 1)) if dots else [int(each) for each in text.split(",")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--walls", default="201..203", help="seeds, 201..203 or 201,205")
    parser.add_argument("--leaves", type=float, default=0.0, help="share of the full foliage")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "reports" / "orchard_pick")
    parser.add_argument("--only-report", action="store_true", help="write the page of the walls that are there")
    parser.add_argument("--set", action="append", default=[], help="passed on to pomona run")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "walls.json"
    walls = {(w["seed"], w["leaves"]): w for w in (json.loads(kept.read_text()) if kept.exists() else [])}
    for seed in () if args.only_report else seeds_of(args.walls):
        if seed in TUNED:
            parser.error(f"wall {seed} was used for tuning")
        extra = [word for each in args.set for word in ("--set", each)]
        walls[seed, args.leaves] = pick_wall(seed, args.leaves, extra)
        kept.write_text(json.dumps(list(walls.values()), indent=1) + "\n")
        print(seed, walls[seed, args.leaves]["truth"], flush=True)
    (args.out / "report.md").write_text(
        report(sorted(walls.values(), key=lambda w: (w["leaves"], w["seed"])), args.out)
    )


if __name__ == "__main__":
    main()
