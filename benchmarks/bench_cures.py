"""Seeded failures of nine kinds, each given to `pomona why`: how often the right cause comes first, and what it costs.

python -m benchmarks.bench_cures --each 1 --budget "60 s"
python -m benchmarks.bench_cures --out cures.jsonl      # started again, it goes on after the failures in the file

The tree of a pick is changed so that it fails; the change is the right cause. A cure of another place that succeeds
with all seeds counts as found, not as right. A false cure is one that fails with one of five further seeds. The workers
of all searches are the same: their start (some 15 s of processor time) counts once.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median

from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder
from pomona.executive.files import find_cell, find_tree
from pomona.executive.recording.folder import find_record
from pomona.executive.terminal.output import write_json
from pomona.executive.values.kinds import Measure
from pomona.executive.values.units import TIME
from pomona.tools.library.cures.command_why import FailedRun, as_json, read_case, usable
from pomona.tools.library.cures.search import CureSearch, TriedChange
from pomona.tools.library.cures.trials import TrialPool

FIRST = 101  # seed of the first run of each kind
FURTHER = 1000  # the further seeds begin so far behind: none of them was used in the search
SUCCEEDED = "SUCCEEDED"  # the code of a run that did not fail: it is kept, not counted
QUICK = (
    ("default: 3,      min: 1, help: looks", "default: 1,      min: 1, help: looks"),
    ("default: 8,  ", "default: 2,  "),
)
"""Tries of the pick, lowered so that a failure ends soon."""


@dataclass(frozen=True, slots=True)
class SeededFailure:
    """One kind of failure.

    Attributes:
        kind: its name.
        causes: names of the changed place; each is right.
        edits: pieces of the tree's text, old and new.
        settings: of the run.
    """

    kind: str
    causes: tuple[str, ...]
    edits: tuple[tuple[str, str], ...] = ()
    settings: tuple[tuple[str, str], ...] = ()


KINDS = (
    SeededFailure(
        "a timeout",
        ("Approach.timeout",),
        (
            (
                "acceleration: 3 m/s²}\n        - Slip",
                "acceleration: 3 m/s²}\n          timeout: 300 ms\n        - Slip",
            ),
        ),
    ),
    SeededFailure("a setting of the run", ("kind",), (), (("kind", "lemon"), ("distractors", "0"))),
    SeededFailure(
        "a parameter, too large",
        ("height",),
        (("150 mm, help: how high", "900 mm, help: how high"),),
    ),
    SeededFailure(
        "a parameter, too strict",
        ("smallest",),
        (("{type: ratio,  default: 0.55,", "{type: ratio,  default: 0.98,"),),
    ),
    SeededFailure(
        "a timeout of tries",
        ("Attempt.timeout",),
        (("      name: Attempt\n", "      name: Attempt\n      timeout: 2 s\n"),),
    ),
    SeededFailure(
        "a port, too strict", ("Detect.score",), (("fallback_score: 0.4,", "score: 0.9999,"),)
    ),
    SeededFailure(
        "a port of measuring",
        ("Refine.min_inliers",),
        (('method: "{refine}",', 'method: "{refine}", min_inliers: 1.0,'),),
    ),
    SeededFailure(
        "an option of the cell", ("mass", "SlipAvoidGrasp.max_force"), (), (("mass", "1.2 kg"),)
    ),
    SeededFailure(
        "a limit of force",
        ("SlipAvoidGrasp.max_force",),
        (("initial_force: 0.7 N,", "initial_force: 0.7 N, max_force: 1.5 N,"),),
    ),
)


@dataclass(frozen=True, slots=True)
class CureResult:
    """One seeded failure: whether the cure is the right one, false with further seeds, and the cost."""

    kind: str
    seed: int
    code: str
    cure: str
    right: bool
    false: int
    processor: float  # time of all processes during the search [s]
    wall: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=5, help="failures of each kind (default: 5)")
    parser.add_argument(
        "--budget", type=Measure(TIME, "1 s").option, default=60.0, help="real time of a search"
    )
    parser.add_argument(
        "--seeds", type=int, default=5, help="other seeds that a cure must pass (default: 5)"
    )
    parser.add_argument(
        "--further", type=int, default=5, help="further seeds that show a false cure (default: 5)"
    )
    parser.add_argument("--only", default="", help="kinds whose name holds this text")
    parser.add_argument(
        "--out", type=Path, help="file of the results, a line of JSON each; those in it are kept"
    )
    options = parser.parse_args(arguments)
    results = _kept(options.out)
    done = {(one.kind, one.seed) for one in results}
    asked = [(seeded, FIRST + 17 * number) for number in range(options.each) for seeded in KINDS]
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.closing(TrialPool(2)) as pool,
    ):
        for seeded, seed in asked:
            if options.only in seeded.kind and (seeded.kind, seed) not in done:
                result = measure(seeded, seed, Path(folder), options, pool)
                if result is not None:
                    results.append(result)
                    _keep(options.out, result)
    _print([one for one in results if one.code != SUCCEEDED])
    return 0


def _kept(path: Path | None) -> list[CureResult]:
    """Return the results in a file of `--out`; none if there is no file."""
    lines = path.read_text("utf-8").splitlines() if path is not None and path.is_file() else ()
    return [CureResult(**json.loads(line)) for line in lines]


def _keep(path: Path | None, result: CureResult) -> None:
    if path is not None:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(result), ensure_ascii=False) + "\n")


def measure(
    seeded: SeededFailure, seed: int, folder: Path, options: argparse.Namespace, pool: TrialPool
) -> CureResult | None:
    """Make a failure, search its cure, try that with further seeds; no search if that does not fail; None: lost."""
    text = find_tree("pick_apple").read_text("utf-8")
    for old, new in (*QUICK, *seeded.edits):
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    tree = folder / f"{seeded.kind.replace(' ', '_').replace(',', '')}.yaml"
    tree.write_text(text, "utf-8")
    records = folder / f"{tree.stem}_{seed}"
    pool.start(
        None, RunOrder(tree, find_cell("sim"), seed, dict(seeded.settings), record=records), 600.0
    )
    for _, trial in pool.ended():
        _say(f"{seeded.kind}, seed {seed}: {trial}")
        if trial.outcome == "lost":  # nothing is known: the next call repeats it
            return None
    record = find_record("last", records)
    try:
        case = read_case(record)
    except UsageError as error:  # it did not fail: no failure was seeded
        _say(f"{seeded.kind}, seed {seed}: {error}")
        return CureResult(seeded.kind, seed, SUCCEEDED, "none", False, 0, 0.0, 0.0)
    processor, wall = _processor(), time.monotonic()
    answer = CureSearch(
        case.order, case.candidates, usable, options.seeds, 1, options.budget, _progress
    ).run(pool)
    pool.give_up()  # what the budget left running would be taken for a result of the next search
    processor, wall = _processor() - processor, time.monotonic() - wall
    write_json(as_json(record, answer, case))
    cure = next(iter(answer.cures()), None)
    code = case.evidence.failed()[0].code if case.evidence.failed() else "not scored"
    name = "none" if cure is None else cure.candidate.change.sentence
    right = cure is not None and cure.candidate.change.name in seeded.causes
    result = CureResult(
        seeded.kind,
        seed,
        code,
        name,
        right,
        0 if cure is None else _false(case, cure, seed, options.further, pool),
        processor,
        wall,
    )
    _say(str(result))
    return result


def _false(case: FailedRun, cure: TriedChange, seed: int, count: int, pool: TrialPool) -> int:
    """Return with how many further seeds the cure fails."""
    order = cure.candidate.change.applied(case.order)
    waiting, failed = [seed + FURTHER + k for k in range(count)], 0
    while True:
        while waiting and pool.free:
            pool.start(waiting[0], replace(order, seed=waiting[0]), 600.0)
            waiting.pop(0)
        ended = list(pool.ended())
        failed += sum(not trial.succeeded for _, trial in ended)
        if not ended:
            return failed


def _progress(what: str, candidate: object, seed: int, trial: object) -> None:
    _say(
        f"    {what} {getattr(getattr(candidate, 'change', None), 'sentence', '')} seed {seed}: {trial}"
    )


def _processor() -> float:
    """Return the processor time of this process and all its descendants, those that have ended included [s]."""
    parents: dict[int, int] = {}
    used: dict[int, int] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = path.read_text("utf-8").rpartition(")")[2].split()
            number = int(path.parent.name)
            parents[number], used[number] = (
                int(fields[1]),
                sum(int(field) for field in fields[11:15]),
            )
    total = 0
    for number in used:
        ancestor = number
        while ancestor not in (0, os.getpid()):
            ancestor = parents.get(ancestor, 0)
        total += used[number] if ancestor else 0
    return total / os.sysconf("SC_CLK_TCK")


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def _print(results: Sequence[CureResult]) -> None:
    sys.stdout.write(
        f"{'kind':<26}{'seed':>5}  {'code':<18}{'right':>6}{'false':>6}{'processor':>10}  cure\n"
    )
    for one in results:
        sys.stdout.write(
            f"{one.kind:<26}{one.seed:>5}  {one.code:<18}{'yes' if one.right else 'no':>6}{one.false:>6}"
            f"{one.processor:>8.0f} s  {Path(one.cure).name if one.cure != 'none' else 'none'}\n"
        )
    if results:
        right = sum(one.right for one in results)
        sys.stdout.write(
            f"{len(results)} failures, the right cause first {right} ({100 * right / len(results):.0f} %), runs with "
            f"further seeds that failed {sum(one.false for one in results)}, processor time "
            f"{median(one.processor for one in results):.0f} s (median), "
            f"{max(one.processor for one in results):.0f} s (most)\n"
        )


if __name__ == "__main__":
    sys.exit(main())
