"""Measure the processor time of each test, and write those of 0.3 s and more to tests/slow_tests.txt.

    python scripts/slow_tests.py [FOLDER …]   # measure, or read the times that are in folders, and write the list

All tests run forwards, then those that were slow run backwards: what the first test of a process loads counts for none,
since the smaller of both times counts. The time of a fixture that a file shares is spread over the tests of the file.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "tests" / "slow_tests.txt"
QUICK = 0.3
"""Processor time of a quick test on one core of a server of 2026, at most [s]."""


def read(folder: Path) -> dict[str, float]:
    """Return the processor time of each test, with its part of what its file shares [s]."""
    own: dict[str, float] = {}
    shared: dict[str, float] = defaultdict(float)
    for path in folder.glob("*.txt"):
        for line in path.read_text("utf-8").splitlines():
            seconds, _, name = line.partition(" ")
            if name.startswith("shared "):
                shared[name.removeprefix("shared ").partition("::")[0]] += float(seconds)
            else:
                own[name] = float(seconds)
    tests: dict[str, int] = defaultdict(int)
    for name in own:
        tests[name.partition("::")[0]] += 1
    return {
        name: seconds + shared[file] / tests[file]
        for name, seconds in own.items()
        for file in [name.partition("::")[0]]
    }


def slow(times: Sequence[Mapping[str, float]]) -> list[str]:
    """Return the names of slow tests: a function where all its cases are slow, else the cases."""
    least = {
        name: min(each[name] for each in times if name in each) for name in set().union(*times)
    }
    cases: dict[str, list[str]] = defaultdict(list)
    for name in least:
        cases[name.partition("[")[0]].append(name)
    names = []
    for function, members in cases.items():
        over = [name for name in members if least[name] >= QUICK]
        names += [function] if len(over) == len(members) else over
    return sorted(names)


def measure(order: str, names: Sequence[str] = ("tests",)) -> dict[str, float]:
    """Run tests that no mark calls slow, in one order; return their times [s]."""
    LIST.write_text("", encoding="utf-8")
    words = ["-n", "2", "--dist", "worksteal", "-m", "not slow and not long and not realtime"]
    with tempfile.TemporaryDirectory() as folder:
        asked = Path(folder) / "asked"
        asked.write_text("\n".join(names), encoding="utf-8")
        settings = {**os.environ, "TEST_TIMES": folder, "TEST_ORDER": order}
        command = [sys.executable, "-m", "pytest", *words, f"@{asked}"]
        status = subprocess.run(command, cwd=ROOT, env=settings).returncode
        if status not in (0, 1):  # a test that fails has a time, too
            raise SystemExit(f"pytest ended with {status}")
        return read(Path(folder))


def main(folders: Sequence[str]) -> int:
    """Measure where no folder is given, and write the list."""
    if folders:
        times = [read(Path(folder)) for folder in folders]
    else:
        kept = LIST.read_text("utf-8")
        try:
            times = [measure("forwards")]
            over = [name for name, seconds in times[0].items() if seconds >= QUICK]
            times.append(measure("backwards", over))
        except BaseException:
            LIST.write_text(kept, encoding="utf-8")
            raise
    names = slow(times)
    LIST.write_text("".join(f"{name}\n" for name in names), encoding="utf-8")
    sys.stdout.write(f"{len(names)} slow tests or functions in {LIST.relative_to(ROOT)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
