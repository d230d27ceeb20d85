"""Simulated walls picked by the tree `pick_tree`, judged by the wall's own truth, in a report.

    python -m benchmarks.orchard_pick --walls 201..203 --leaves 0 --out runs/reports/orchard_pick
    python -m benchmarks.orchard_pick --walls 201..203 --stops=-350,0,350      # places of the base, one after the other

Each stop at a wall is one run of the command `pomona run`, with the wall's own seed. It begins with the apples that the
runs before left hanging; branches keep the shape in which they carried the others, and moving the base takes no time.
The walls must not have been used for tuning: walls 1 to 12, 101 to 128 and 204 to 209 were. Figures of a wall that was
measured before are kept in `walls.json` of the folder, so a report can grow. `--only-report` writes the page again.
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

from pomona.executive.values.installation import commit_here
from pomona.tools.campaign.statistics import wilson

mpl.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).parents[1]
TREE, CELLS = ROOT / "trees" / "experimental" / "pick_tree.yaml", ROOT / "trees" / "cells"
USUAL = ("orchard", (0,))
"""Cell and stops [mm] of the main figures."""
TUNED = (*range(1, 13), *range(101, 129), *range(204, 210))
"""Walls that were looked at while the skills were made, or for which errors were found."""
LIMIT = 7200.0
"""Wall-clock time after which a wall is given up [s]."""
COUNTED = (
    "apples",
    "reachable",
    "gripped",
    "detached",
    "picked",
    "dropped",
    "knocked_off",
    "bruised",
    "stems_torn",
)
GROUPS = {
    "ruled out": "no free grasp",
    "the stem held": "stem held",
    "the pads feel": "jammed",
    "off its commands": "jammed",
    "depth agrees": "mostly hidden",
    "of the model's size": "mostly hidden",
    "the surface there has": "mostly hidden",
    "cannot roll": "no room for the roll",
    "into a neighbour": "no room for the roll",
    "touched something": "touched on the approach",
    "something holds it": "touched on the approach",
    "was lost": "lost",
    "the fruit left the pads": "slipped or lost",
    "the opening fell": "slipped or lost",
    "after closing": "not gripped",
}
"""Groups of the reasons in the tally, by a part of the sentence."""


def pick_wall(
    cell: str, seed: int, leaves: float, stops: Sequence[int], extra: Sequence[str]
) -> dict[str, Any]:
    """Pick one wall from several stops [mm]: truth, time, and the reasons of the apples that each stop left."""
    runs: list[dict[str, Any]] = []
    gone = set[int]()
    for stop in stops:
        without = ",".join(map(str, sorted(gone))) or "none"
        settings = {"leaves": f"{leaves:g}", "stop": f"{stop} mm", "without": without}
        words = [word for name, text in settings.items() for word in ("--set", f"{name}={text}")]
        runs.append(found := pick_from(cell, seed, [*words, *extra]))
        gone |= numbers_in(found["truth"]["which_gone"])
        if len(gone) == runs[0]["truth"]["apples"]:
            break
    bad = next((found for found in runs if found["outcome"] != "success"), runs[-1])
    tallies = [(found.get("values") or {}).get("tally") or {"left": []} for found in runs]
    return {
        "cell": cell,
        "seed": seed,
        "leaves": leaves,
        "stops": list(stops),
        "picked_at": [found["truth"]["picked"] for found in runs],
        "commit": commit_here(),
        "outcome": bad["outcome"],
        "reason": (bad.get("reason") or {}).get("message", ""),
        "time_s": sum(found["time_s"] for found in runs),
        "left": [each["why"] for tally in tallies for each in tally["left"]],
        "truth": together([found["truth"] for found in runs]),
    }


def numbers_in(text: str) -> set[int]:
    """Return the fruit of a text such as `3,7` or `none`."""
    return {int(each) for each in text.split(",") if each != "none"}


def together(truths: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the truth of all stops at a wall. A fruit that two stops gripped, reached or bruised counts once.

    The stem's force is the median of the stops' medians, and the highest of their 95 %.
    """
    forces = {
        key: [truth[key] for truth in truths if truth[key] is not None]
        for key in ("stem_force_median_n", "stem_force_p95_n")
    }
    named = ("reachable", "gripped", "bruised")
    return {
        "apples": truths[0]["apples"],
        **{
            key: len(set().union(*(numbers_in(truth[f"which_{key}"]) for truth in truths)))
            for key in named
        },
        **{
            key: sum(t[key] for t in truths)
            for key in ("detached", "picked", "dropped", "knocked_off", "stems_torn")
        },
        **{
            key: float((np.median if "median" in key else np.max)(each)) if each else None
            for key, each in forces.items()
        },
        "numbers": truths[0]["numbers"],
    }


def pick_from(cell: str, seed: int, settings: Sequence[str]) -> dict[str, Any]:
    """Run the tree from one stop and return the result of the command."""
    command = [
        *(
            sys.executable,
            "-m",
            "pomona.executive.cli",
            "run",
            str(TREE),
            "--cell",
            str(CELLS / f"{cell}.yaml"),
        ),
        *("--seed", str(seed), "--no-record", "--json", *settings),
    ]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    lines = ended.stdout.strip().splitlines()
    if not lines:
        raise SystemExit(f"wall {seed}: the run printed no result: {ended.stderr[-2000:]}")
    found: dict[str, Any] = json.loads(lines[-1])
    return found


def group_of(why: str) -> str:
    """Return the group of a reason."""
    last = why.rpartition("the last: ")[2]
    return next((group for part, group in GROUPS.items() if part in last), last[:60])


def share(name: str, part: int, of: int) -> str:
    """Return a row: a share with its 95 % interval."""
    low, high = wilson(min(part, of), of)  # reachable apples are a lower bound
    value = f"{part / of:.0%}" if of else "–"
    return f"| {name} | {part} of {of} | {value} | {low:.0%} to {high:.0%} |"


def way_of(wall: Mapping[str, Any]) -> tuple[str, tuple[int, ...]]:
    """Return the cell and the stops [mm] of a wall; older ones were picked in the usual way."""
    return wall.get("cell", USUAL[0]), tuple(wall.get("stops", USUAL[1]))


def compared(ways: Mapping[tuple[str, tuple[int, ...]], Sequence[Mapping[str, Any]]]) -> list[str]:
    """Return a table: picked of all, for each cell with its stops."""
    rows = []
    for (cell, stops), walls in ways.items():
        counts = [sum(int(wall["truth"][key]) for wall in walls) for key in ("picked", "apples")]
        seeds = ", ".join(str(wall["seed"]) for wall in walls)
        rows.append(
            share(f"cell {cell}, stops at {', '.join(map(str, stops))} mm: walls {seeds}", *counts)
        )
    return [
        "",
        "| in the bin, of all | apples | share | 95 % interval |",
        "|---|---|---|---|",
        *rows,
    ]


def by_leaves(walls: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a table of the shares for each foliage."""
    rows = []
    for leaves in sorted({wall["leaves"] for wall in walls}):
        some = [wall for wall in walls if wall["leaves"] == leaves]
        total = {key: sum(int(wall["truth"].get(key) or 0) for wall in some) for key in COUNTED}
        cells = []
        for of in ("gripped", "reachable", "apples"):
            low, high = wilson(min(total["picked"], total[of]), total[of])
            cells.append(f"{total['picked']} of {total[of]} ({low:.0%} to {high:.0%})")
        time = sum(wall["time_s"] for wall in some) / max(total["picked"], 1)
        ended = sum(wall["outcome"] == "success" for wall in some)
        rows.append(
            f"| {leaves:g} | {len(some)} | {' | '.join(cells)} | {total['bruised']} of {total['apples']} "
            f"| {total['knocked_off']} of {total['detached']} | {time:.1f} | {ended} |"
        )
    return [
        "",
        "| leaves | walls | in the bin, of gripped | of reachable | of all | bruised | knocked off | s per apple "
        "| ended by themselves |",
        "|---|---|---|---|---|---|---|---|---|",
        *rows,
    ]


def report(measured: Sequence[Mapping[str, Any]], out: Path) -> str:
    """Return the page, and draw its picture. Its figures are those of the usual cell and stop, where they were run."""
    ways: dict[tuple[str, tuple[int, ...]], list[Mapping[str, Any]]] = {}
    for wall in sorted(measured, key=lambda each: way_of(each) != USUAL):
        ways.setdefault(way_of(wall), []).append(wall)
    (cell, stops), walls = next(iter(ways.items()))
    total = Counter[str]()
    for wall in walls:
        total.update({key: int(wall["truth"].get(key) or 0) for key in COUNTED})
    time = sum(wall["time_s"] for wall in walls)
    why = Counter(group_of(each) for wall in walls for each in wall["left"])
    forces = [
        w["truth"]["stem_force_median_n"]
        for w in walls
        if w["truth"].get("stem_force_median_n") is not None
    ]
    force = float(np.median(forces)) if forces else float("nan")
    rows = [
        share("in the bin, of those that both pads gripped", total["picked"], total["gripped"]),
        share(
            "in the bin, of those with a free grasp and roll", total["picked"], total["reachable"]
        ),
        share("in the bin, of all", total["picked"], total["apples"]),
        share("bruised, of all", total["bruised"], total["apples"]),
        share(
            "neighbours knocked off, per detached apple",
            total["knocked_off"],
            max(total["detached"], 1),
        ),
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
    stopped = [
        f"Wall {w['seed']} ended with *{w['outcome']}*: {w['reason']}."
        for w in walls
        if w["reason"]
    ]
    return "\n".join([
        f"# Simulated: {total['apples']} apples of {len(walls)} fruit walls, picked by `pick_tree`",
        "",
        *([] if (cell, stops) == USUAL else [f"Cell {cell}, stops at {', '.join(map(str, stops))} mm.", ""]),
        f"Simulated, at commit {commits} by `make orchard`. The tree is experimental. None of these walls was used for",
        "tuning. Perception is the shipped detector; ground truth serves the score alone. Stems break by the",
        "wall's law, whose bending strength is assumed and carries this motion",
        f". Numbers of the wall: {walls[0]['truth'].get('numbers')}.",
        "",
        "| figure | apples | share | 95 % interval |",
        "|---|---|---|---|",
        *rows,
        "",
        f"Time per apple in the bin: {per_apple:.1f} s (all looks and vain tries included). Stem force at the break: "
        f"{force:.1f} N (median of the walls' medians). Stems torn out: {total['stems_torn']}.",
        "The intervals count apples as independent; apples of one wall are not quite.",
        *(["", *stopped] if stopped else []),
        *by_leaves(walls),
        *(compared(ways) if len(ways) > 1 else []),
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
    left.bar(
        keys,
        [total[key] for key in keys],
        color=["#8aa17a", "#8aa17a", "#c98b4a", "#c98b4a", "#b5453a"],
    )
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
    return (
        list(range(int(first), int(last) + 1)) if dots else [int(each) for each in text.split(",")]
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--walls", default="201..203", help="seeds, 201..203 or 201,205")
    parser.add_argument("--cell", default=USUAL[0], help="name of a cell in trees/cells")
    parser.add_argument(
        "--stops", default="0", help="places of the base along the row [mm]: --stops=-350,0,350"
    )
    parser.add_argument("--leaves", type=float, default=0.0, help="share of the full foliage")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "reports" / "orchard_pick")
    parser.add_argument(
        "--only-report", action="store_true", help="write the page of the walls that are there"
    )
    parser.add_argument("--set", action="append", default=[], help="passed on to pomona run")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    kept = args.out / "walls.json"
    before = json.loads(kept.read_text()) if kept.exists() else []
    walls = {(way_of(w), w["seed"], w["leaves"]): w for w in before}
    stops = tuple(map(int, args.stops.split(",")))
    for seed in () if args.only_report else seeds_of(args.walls):
        if seed in TUNED:
            parser.error(f"wall {seed} was used for tuning")
        extra = [word for each in args.set for word in ("--set", each)]
        wall = pick_wall(args.cell, seed, args.leaves, stops, extra)
        walls[way_of(wall), seed, args.leaves] = wall
        kept.write_text(json.dumps(list(walls.values()), indent=1) + "\n")
        print(seed, wall["picked_at"], wall["truth"], flush=True)
    (args.out / "report.md").write_text(
        report(sorted(walls.values(), key=lambda w: (w["leaves"], w["seed"])), args.out)
    )


if __name__ == "__main__":
    main()
