"""Picks with arms that Pomona does not ship: a simulated cell is written from each URDF, and picks an apple in it.

    python -m benchmarks.bench_own_arms ur10.urdf panda.urdf:panda_hand_tcp --picks 5 --out runs/own_arms

A URDF may name the link that the hand is bolted on behind a colon. Public packages: see the README of
`pomona.tools.own_arm`. Prints a line for each arm; a pick whose file exists in `--out` is not run again. All picks run
in this process: one for each pick would load the code anew, for 10 s of a processor.
"""

from __future__ import annotations

import argparse
import io
import json
import sys
import time
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from pomona.executive.cli import main as pomona
from pomona.executive.running.compute import keep_workers_warm

APPLES, PLACES = 5, (3, 2, 1, 4, 5)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 when an arm could not be used."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("urdfs", nargs="+", metavar="URDF[:LINK]")
    parser.add_argument("--picks", type=int, default=5)
    parser.add_argument("--hand", default="wsg32")
    parser.add_argument("--out", type=Path, default=Path("runs/own_arms"))
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    keep_workers_warm()
    usable = True
    for text in options.urdfs:
        path, _, flange = text.partition(":")
        name = Path(path).stem.replace("-", "_")
        cell, why = own_cell(Path(path), flange, options.hand, options.out / name)
        if cell is None:
            print(f"{name:24} not usable: {why}", flush=True)
            usable = False
            continue
        results = [
            pick(cell, number, options.out / f"{name}_{number}.json")
            for number in range(options.picks)
        ]
        lifted = sum(result == "lifted" for result in results)
        others = ", ".join(sorted({result for result in results if result != "lifted"}))
        print(f"{name:24} {lifted} of {len(results)} lifted  {others}", flush=True)
    return 0 if usable else 1


def own_cell(urdf: Path, flange: str, hand: str, into: Path) -> tuple[Path | None, str]:
    """Return the cell that is written for an arm, or None and the reason."""
    found = next(iter(into.rglob("cell.yaml")), None) if into.is_dir() else None
    if found is None:
        link = ["--flange", flange] if flange else []
        status, said = silently(
            ["new", "arm", str(urdf), "--hand", hand, "--into", str(into), *link]
        )
        if status:
            return None, " ".join(said.split())[:300]
        found = next(iter(into.rglob("cell.yaml")), None)
    return found, "no cell.yaml was written"


def silently(words: Sequence[str]) -> tuple[int, str]:
    """Run one subcommand; return its status, and the text that it printed."""
    printed = io.StringIO()
    with redirect_stdout(printed), redirect_stderr(printed):
        status = pomona(words)
    return status, printed.getvalue()


def pick(cell: Path, number: int, into: Path) -> str:
    """Return "lifted", or the code of the failure, of one pick; the seed is its number."""
    if not into.is_file():
        fruit, place = (
            f"fruit=apple_{number % APPLES + 1}",
            f"place={PLACES[number // APPLES % len(PLACES)]}",
        )
        words = [
            "run",
            "pick_apple",
            "--cell",
            str(cell),
            "--seed",
            str(number),
            "--no-record",
            "--json",
        ]
        began = time.monotonic()
        status, printed = silently([*words, "--set", fruit, "--set", place])
        lines = [line for line in printed.splitlines() if line.startswith("{")]
        last = json.loads(lines[-1]) if lines else {"error": printed.strip()[-300:]}
        into.write_text(
            json.dumps({"rc": status, "wall_s": time.monotonic() - began, "last": last}) + "\n"
        )
    kept = json.loads(into.read_text("utf-8"))
    if kept["rc"] == 0:
        return "lifted"
    reason = kept["last"].get("reason") or kept["last"]
    return str(reason.get("code", reason) if isinstance(reason, dict) else reason)[:120]


if __name__ == "__main__":
    sys.exit(main())
