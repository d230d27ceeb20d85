"""Output of a benchmark, kept as a page with its command, its commit and its machine.

    python scripts/measured.py refine make bench-refine
    python scripts/measured.py grasp python -m benchmarks.bench_grasp --ours --world lugre

writes runs/reports/measured/refine.md: what a row of docs/results.json needs.
"""

from __future__ import annotations

import datetime
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

from pomona.executive.values.installation import commit_here

ROOT = Path(__file__).resolve().parents[1]
MEASURED = ROOT / "runs" / "reports" / "measured"


def machine() -> str:
    """The processor, how many of it, and how busy it is with other things."""
    told = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.*)", told.read_text("utf-8")) if told.is_file() else []
    busy = os.getloadavg()[0]
    beside = (
        "nothing else running" if busy < 0.5 else f"on average {busy:.0f} other processes running"
    )
    return f"{os.cpu_count()} cores of {names[0] if names else platform.processor()}, {beside}"


def page(command: list[str], commit: str, day: str, where: str, printed: str) -> str:
    """The page of one measurement."""
    words = " ".join(command)
    return f"# {words}\n\nMade at commit `{commit}` with `{words}`, {day}, {where}.\n\n```text\n{printed.strip()}\n```\n"


def main() -> int:
    """Run the command, and write its page when it ended well."""
    name, *command = sys.argv[1:]
    commit, where = commit_here(), machine()
    typed = [sys.executable if word == "python" else word for word in command]
    if typed[0] == "make":
        typed.insert(1, "--silent")
    done = subprocess.run(typed, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        return done.returncode
    MEASURED.mkdir(parents=True, exist_ok=True)
    day = datetime.datetime.now(datetime.UTC).date().isoformat()
    (MEASURED / f"{name}.md").write_text(
        page(command, commit, day, where, done.stdout), encoding="utf-8"
    )
    sys.stdout.write(done.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
