"""Mutation fuzzer of cell files: every error is a finding with a place, never a traceback, and nothing connects.

python tests/drivers/cell/fuzz_cells.py --cases 100000 --seed 1
"""

from __future__ import annotations

import argparse
import importlib.util
import random
import sys
import time
import traceback
from pathlib import Path
from types import ModuleType

from pomona.executive.cell.cell_file import judge_cell_file
from pomona.executive.values.findings import Findings, format_findings

REPOSITORY = Path(__file__).resolve().parents[3]
TOKENS = (
    "driver", "motoman", "wsg", "suntouch", "mujoco", "sim-arm", "mock-gripper", "emulated-world", "realsense", "world",
    "devices", "options", "workspace", "include", "shared/workspace.yaml", "heartbeat", "record", "required", "clock",
    "poses", "obstacles", "{fruit}", "{nothing}", "-1 N", "0 mm", "1e9 m", "nan", "90 deg", "12 px", "127.0.0.1:99999",
    "../robots/sia5f_wsg32.xml", "/dev/null", "/", "..", "[1, 2, 3]", "{x: 1}", "S L E U R B T",
)  # fmt: skip


def load_mutations() -> ModuleType:
    """The mutations of the tree files' fuzzer, with words of cells."""
    path = REPOSITORY / "tests" / "executive" / "language" / "fuzz.py"
    spec = importlib.util.spec_from_file_location("pomona_fuzz", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.TOKENS = (*module.TOKENS, *TOKENS)
    return module


def shipped_cells() -> dict[Path, str]:
    """All cell files that come with the package."""
    return {
        path: path.read_text() for path in sorted((REPOSITORY / "trees" / "cells").glob("*.yaml"))
    }


def judged(path: Path, text: str) -> float:
    """The processor time of one judgement in s.

    Raises:
        AssertionError: the file was refused without a finding.
    """
    started, findings = time.process_time(), Findings()
    file = judge_cell_file(path, findings, {}, {str(path): text})
    format_findings(findings.sorted())
    assert file is not None or findings.sorted(), "refused without a word"
    return time.process_time() - started


def fuzz(cases: int, seed: int) -> list[str]:
    """Try a number of cases; return the texts that broke something, with the error."""
    mutations, cells = load_mutations(), shipped_cells()
    paths, texts, broken = list(cells), list(cells.values()), []
    for case in range(cases):
        rng = random.Random(f"{seed}/{case}")
        path = rng.choice(paths)
        text = mutations.mutate(cells[path], texts, rng)
        try:
            # The first file of a process also loads the drivers' packages: a slow one is judged once more.
            if (
                judged(path, text) > mutations.SLOW
                and (took := judged(path, text)) > mutations.SLOW
            ):
                broken.append(f"case {seed}/{case} took {took:.1f} s\n{text[:2000]!r}")
        except Exception:
            broken.append(f"case {seed}/{case}\n{traceback.format_exc()}\n{text[:2000]!r}")
        if len(broken) >= 5:
            break
    return broken


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    order = parser.parse_args()
    started = time.perf_counter()
    broken = fuzz(order.cases, order.seed)
    print(
        f"{order.cases} cell files in {time.perf_counter() - started:.0f} s, {len(broken)} of them broke something"
    )
    print("\n\n".join(broken))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
