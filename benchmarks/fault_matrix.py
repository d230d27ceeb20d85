"""The fault matrix: every fault in every phase of a pick, judged by the simulator's truth and by the record.

    python -m benchmarks.fault_matrix [--cell sim] [--only fingers.stuck …] [--phases lifting …] [--seed 3] [--jobs 2]
    python -m benchmarks.fault_matrix --cases fingers.zero@closing arm.frozen@following
    python -m benchmarks.fault_matrix --cell conveyor [--phases rising …]        # trees/pick_from_conveyor.yaml

For each case: the run ends as its row says, within its deadline; the device is named; the arm comes to rest within its
limits; a grip that held is never opened; no force above the limit; the record can be read and agrees; nothing resumes;
once the fault is cleared and acknowledged, the cell is clean; and no failure counts as success.

The pick runs once, and each case from where its fault begins, in a fork of the process. With `--alone` each case runs
from the beginning, recorded, and with the drivers' own threads on the emulated cell.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from benchmarks.fault_run import (
    SETTINGS,
    branch_cases,
    plan_here,
    prepare_to_fork,
    refuse_case,
    run_case,
)
from benchmarks.fault_table import Case, CaseVerdict, read_table, report


def _run(job: tuple[Case, str, int]) -> CaseVerdict:
    case, cell, seed = job
    try:
        return run_case(case, cell, seed)
    except Exception as error:  # a case that breaks the harness is a finding, too
        return CaseVerdict(case, wrong=[f"{type(error).__name__}: {error}"])


def run(
    cases: list[Case], cell: str, seed: int, jobs: int, alone: bool = False
) -> list[CaseVerdict]:
    """Run all cases, with a line on standard error for each; return them in the order of the table."""
    verdicts: list[CaseVerdict] = []
    planned = len(cases)

    def tell(verdict: CaseVerdict) -> None:
        verdicts.append(verdict)
        mark, case = "✗" if verdict.wrong else "✓", verdict.case
        done = sum(
            each.case.switch != "none" for each in verdicts
        )  # beside them the picks without a fault
        words = f"{done}/{planned} {mark} {case.name} {case.phase.name} {'; '.join(verdict.wrong)}"
        print(words, verdict.reason, file=sys.stderr, flush=True)

    if not alone:
        prepare_to_fork()  # before a cell is connected: a fork has no threads of the rasteriser
    for case in [case for case in cases if case.ends == "refused"]:
        tell(refuse_case(case, cell, seed))
    cases = [case for case in cases if case.ends != "refused"]
    if not cases:
        return verdicts
    if not alone:
        for tree in dict.fromkeys(case.phase.tree for case in cases):
            branch_cases(
                [case for case in cases if case.phase.tree == tree], cell, seed, jobs, tell
            )
    else:
        with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=plan_here) as pool:
            for verdict in pool.map(_run, [(case, cell, seed) for case in cases]):
                tell(verdict)
    places = {(v.case.name, v.case.phase.name): len(cases) for v in verdicts}
    places |= {(case.name, case.phase.name): place for place, case in enumerate(cases)}
    return sorted(verdicts, key=lambda v: places.get((v.case.name, v.case.phase.name), -1))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cell", default="sim", choices=SETTINGS)
    parser.add_argument("--only", nargs="*", help="faults, as switch.fault")
    parser.add_argument("--phases", nargs="*")
    parser.add_argument("--cases", nargs="*", help="as switch.fault@phase")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--alone", action="store_true", help="every case from the beginning")
    options = parser.parse_args()
    cases = [
        case
        for case in read_table(options.cell)
        if (not options.only or f"{case.switch}.{case.kind}" in options.only)
        and (not options.phases or case.phase.name in options.phases)
        and (not options.cases or f"{case.switch}.{case.kind}@{case.phase.name}" in options.cases)
    ]
    verdicts = run(cases, options.cell, options.seed, options.jobs, options.alone)
    print(report(verdicts))
    return 1 if any(verdict.wrong for verdict in verdicts) else 0


if __name__ == "__main__":
    sys.exit(main())
