"""Cost of the small commands: processor time of whole processes.

    python -m benchmarks.bench_start

Each command runs once to warm the disk and the declarations that are kept, then `ROUNDS` times; the least time counts,
since a busy machine only adds. The first check after a source has changed imports the skills and is printed apart.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

ROUNDS = 10
COMMANDS: tuple[tuple[tuple[str, ...], float], ...] = (
    (("--help",), 0.2),
    (
        ("check", "pick_apple"),
        1.5,
    ),  # imports all skills and the cell's drivers: poses and fruit are checked, too
    (("show", "pick_apple"), 0.6),
    (("skills",), 0.6),
    (("schema",), 0.6),
    (("export", "pick_apple"), 0.6),
    (("runs", "list"), 0.6),
)
"""Commands with the seconds of processor time that each may take."""


def seconds(arguments: tuple[str, ...], environment: dict[str, str], folder: str) -> float:
    """Processor time of one process, with its children."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "pomona.executive.cli", *arguments]
    subprocess.run(
        command, env=environment, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    """Print a line for each command; 1 when one takes longer than it may."""
    slow = 0
    with tempfile.TemporaryDirectory() as folder:
        paths = [str(Path(__file__).resolve().parents[1]), os.environ.get("PYTHONPATH", "")]
        environment = {
            **os.environ,
            "XDG_CACHE_HOME": folder,
            "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        }
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # who installs a program compiles it once
        environment["PYTHONPYCACHEPREFIX"] = folder
        Path(folder, "runs").mkdir()
        print(
            f"first check, imports every skill: {seconds(('check', 'pick_apple'), environment, folder):5.2f} s"
        )
        for arguments, limit in COMMANDS:
            seconds(arguments, environment, folder)
            least = min(seconds(arguments, environment, folder) for _ in range(ROUNDS))
            slow += least > limit
            print(
                f"pomona {' '.join(arguments):20} {least:5.2f} s of processor time (at most {limit:g} s)"
            )
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
