"""Run a long target and keep at which commit it passed; print which targets are older than the code they judge.

    python scripts/evidence.py run NAME …      # run targets; each that passes is kept with date and commit
    python scripts/evidence.py status          # the table
    python scripts/evidence.py status --check [safety]   # 1 when a target (of safety) is stale or never passed

Targets, their commands and the paths that they judge stand in scripts/evidence.yaml. What was kept stands in
scripts/evidence.json, under version control. A target is stale when one of its paths changed after its commit.
"""

from __future__ import annotations

import argparse
import datetime
import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
TARGETS = Path(__file__).with_name("evidence.yaml")
KEPT = Path(__file__).with_name("evidence.json")


@dataclass(frozen=True, slots=True)
class Target:
    """A long target: its command, the paths that it judges, and whether it judges stops, recovery, persons or faults."""

    name: str
    command: str
    judges: tuple[str, ...]
    is_safety: bool


def read_targets() -> dict[str, Target]:
    """Return the targets by their names."""
    written: dict[str, dict[str, Any]] = yaml.safe_load(TARGETS.read_text("utf-8"))
    return {
        name: Target(name, row["run"], tuple(row["judges"]), row.get("safety", False))
        for name, row in written.items()
    }


def state(target: Target, kept: Mapping[str, Mapping[str, Any]]) -> str:
    """Return `fresh`, `stale` or `never`; a commit that this repository lacks is stale."""
    if target.name not in kept:
        return "never"
    commit = kept[target.name]["commit"]
    same = git("diff", "--quiet", commit, "HEAD", "--", *target.judges).returncode == 0
    return "fresh" if same else "stale"


def show(targets: Mapping[str, Target], kept: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Print the table of targets; return the state of each."""
    states = {name: state(target, kept) for name, target in targets.items()}
    for name, target in targets.items():
        row = kept.get(name, {})
        when = f"{row['date']}  {row['commit']}  {row['seconds']:6.0f} s" if row else ""
        safety = "safety" if target.is_safety else ""
        sys.stdout.write(f"{name:22} {states[name]:6} {safety:7} {when}\n")
    return states


def run(target: Target, kept: dict[str, dict[str, Any]]) -> bool:
    """Run a target; keep date, commit and duration if it passes on committed code. Return True if it passed."""
    if git("status", "--porcelain", "--", *target.judges).stdout:
        sys.stderr.write(f"{target.name}: commit what it judges first; else no commit names it\n")
        return False
    commit = git("rev-parse", "--short=10", "HEAD").stdout.strip()
    began = time.monotonic()
    sys.stdout.write(f"{target.name}: {target.command}\n")
    sys.stdout.flush()
    if subprocess.run(target.command, shell=True, cwd=ROOT).returncode:
        kept.pop(target.name, None)
        passed = False
    else:
        today = datetime.date.today().isoformat()
        seconds = round(time.monotonic() - began)
        kept[target.name] = {"commit": commit, "date": today, "seconds": seconds}
        passed = True
    KEPT.write_text(json.dumps(dict(sorted(kept.items())), indent=1) + "\n", encoding="utf-8")
    return passed


def git(*words: str) -> subprocess.CompletedProcess[str]:
    """Run git in the repository."""
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True)


def main(arguments: Sequence[str]) -> int:
    """Run targets, or print their states."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    running = commands.add_parser("run", help="run targets")
    running.add_argument("names", nargs="+", metavar="NAME")
    status = commands.add_parser("status", help="print the table")
    status.add_argument("--check", nargs="?", const="all", choices=["all", "safety"])
    options = parser.parse_args(arguments)
    targets = read_targets()
    kept = json.loads(KEPT.read_text("utf-8")) if KEPT.is_file() else {}
    if options.command == "status":
        states = show(targets, kept)
        judged = [name for name in states if options.check == "all" or targets[name].is_safety]
        return int(bool(options.check) and any(states[name] != "fresh" for name in judged))
    if unknown := [name for name in options.names if name not in targets]:
        sys.stderr.write(f"no target {', '.join(unknown)}; there are {', '.join(targets)}\n")
        return 2
    passed = [run(targets[name], kept) for name in options.names]
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
