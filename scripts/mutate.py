"""How much of the pure mathematics the tests hold: one small change at a time, and whether a test finds it.

    python scripts/mutate.py [--most 60] [--seed 1] [--only geometry] [--report runs/reports/mutation.md]

Every module of `MATHEMATICS` is changed in one place (a sign, an operator, a comparison, a number), its tests run in a
process of their own, and the change counts as found when one of them fails, or takes ten times as long as all of them
did. With more than `--most` places a module's are drawn with `--seed`. The score is a lower bound: an unfound change
may have no effect.
"""

from __future__ import annotations

import argparse
import ast
import copy
import importlib.abc
import importlib.util
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

os.environ["NUMBA_DISABLE_JIT"] = "1"  # each change would be compiled anew

import numpy as np  # noqa: F401  (loaded once, for all processes)
import pytest

from pomona.executive.values.installation import commit_here

ROOT = Path(__file__).resolve().parents[1]

MATHEMATICS: dict[str, tuple[str, ...]] = {
    "pomona.executive.values.units": ("tests/executive/values/test_units.py",),
    "pomona.executive.values.rotations": ("tests/executive/values/test_rotations.py",),
    "pomona.tools.library.campaign.statistics": (
        "tests/executive/tools/library/campaign/test_statistics.py",
    ),
    "pomona.drivers.trajectory": ("tests/drivers/test_trajectory.py",),
    "pomona.skills.geometry": ("tests/skills/test_geometry.py",),
    "pomona.skills.grip.observer": ("tests/skills/grip/test_observer.py",),
    "pomona.skills.grip.limit_surface": ("tests/skills/grip/test_limit_surface.py",),
    "pomona.skills.grip.pads": ("tests/skills/grip/test_pads.py",),
    "pomona.skills.motion.grasps.sphere": ("tests/skills/motion/grasps/test_sphere.py",),
    "pomona.skills.motion.planning.timing": ("tests/skills/motion/planning/test_timing.py",),
    "pomona.skills.perception.detection.instances": (
        "tests/skills/perception/detection/test_instances.py",
    ),
}
"""Modules with the tests that should find errors in them."""

BINARY: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Mod: ast.Mult,
}  # fmt: skip
COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
NAMES = {"min": "max", "max": "min", "sin": "cos", "cos": "sin", "minimum": "maximum", "maximum": "minimum",
         "any": "all", "all": "any"}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Change:
    """One place of a module and its replacement."""

    module: str
    line: int
    was: str
    now: str
    source: str


def places(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the places to change: no texts, annotations, imports, decorators, raised or asserted expressions."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, (ast.Raise, ast.Import, ast.ImportFrom, ast.JoinedStr, ast.Assert)):
            continue
        yield node
        for name, field in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list", "bases", "type_params"):
                continue
            waiting += [
                child
                for child in (field if isinstance(field, list) else [field])
                if isinstance(child, ast.AST)
            ]


def changed(node: ast.AST) -> ast.AST | None:
    """A node with a small mistake; None where there is none to make."""
    new = copy.deepcopy(node)
    if isinstance(new, (ast.BinOp, ast.AugAssign)) and type(new.op) in BINARY:
        new.op = BINARY[type(new.op)]()
    elif isinstance(new, ast.Compare) and type(new.ops[0]) in COMPARED:
        new.ops[0] = COMPARED[type(new.ops[0])]()
    elif isinstance(new, ast.BoolOp):
        new.op = ast.Or() if isinstance(new.op, ast.And) else ast.And()
    elif isinstance(new, ast.UnaryOp) and isinstance(new.op, (ast.USub, ast.Not)):
        return new.operand
    elif isinstance(new, ast.Constant) and isinstance(new.value, bool):
        new.value = not new.value
    elif isinstance(new, ast.Constant) and isinstance(new.value, float) and new.value:
        new.value = 2.0 * new.value
    elif isinstance(new, ast.Constant) and isinstance(new.value, (int, float)):
        new.value = new.value + 1
    elif isinstance(new, ast.Attribute) and new.attr in NAMES:
        new.attr = NAMES[new.attr]
    elif isinstance(new, ast.Name) and new.id in NAMES:
        new.id = NAMES[new.id]
    else:
        return None
    return new


class _Put(ast.NodeTransformer):
    """Puts a node where another one stands."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self._new if node is self._old else self.generic_visit(node)


def changes(module: str, most: int, seed: int) -> list[Change]:
    """Some of the small changes of a module, in the order of its lines."""
    path = ROOT / (module.replace(".", "/") + ".py")
    tree: ast.AST = ast.parse(path.read_text("utf-8"))
    wrong = [(node, new) for node in places(tree) if (new := changed(node)) is not None]
    wrong.sort(key=lambda pair: (getattr(pair[0], "lineno", 0), getattr(pair[0], "col_offset", 0)))
    if len(wrong) > most:
        drawn = random.Random(seed).sample(range(len(wrong)), most)
        wrong = [wrong[k] for k in sorted(drawn)]
    made = []
    for node, new in wrong:
        tree = ast.fix_missing_locations(_Put(node, new).visit(tree))
        whole = ast.unparse(tree)
        tree = _Put(new, node).visit(tree)
        made.append(
            Change(module, getattr(node, "lineno", 0), ast.unparse(node), ast.unparse(new), whole)
        )
    return made


class _Changed(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports a module from another source."""

    def __init__(self, change: Change) -> None:
        self._change = change

    def find_spec(
        self, name: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != self._change.module:
            return None
        return importlib.util.spec_from_loader(
            name, self, origin=str(ROOT / (name.replace(".", "/") + ".py"))
        )

    def exec_module(self, module: ModuleType) -> None:
        path = ROOT / (self._change.module.replace(".", "/") + ".py")
        module.__file__ = str(path)
        exec(compile(self._change.source, str(path), "exec"), module.__dict__)


def run_tests(tests: Sequence[str], change: Change | None, limit: float) -> bool:
    """Whether tests pass, in a process of their own; a change that takes longer than the limit [s] does not."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            quiet = os.open(os.devnull, os.O_WRONLY)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            signal.setitimer(signal.ITIMER_REAL, limit)
            if change is not None:
                sys.meta_path.insert(0, _Changed(change))
            words = [
                "-p",
                "no:xdist",
                "-p",
                "no:cacheprovider",
                "-p",
                "no:randomly",
                "-x",
                "-q",
                *tests,
            ]
            status = int(pytest.main(words))
        finally:
            os._exit(0 if status == 0 else 1)
    _pid, status = os.waitpid(child, 0)
    return status == 0


def judge(module: str, tests: Sequence[str], most: int, seed: int) -> tuple[int, list[Change]]:
    """How many changes of a module were tried, and those that no test found."""
    began = time.monotonic()
    if not run_tests(tests, None, 600.0):
        raise SystemExit(f"{module}: its tests fail before anything is changed: {' '.join(tests)}")
    limit = 10.0 * (time.monotonic() - began) + 5.0
    tried = changes(module, most, seed)
    left = [change for change in tried if run_tests(tests, change, limit)]
    sys.stdout.write(f"{module:42} {len(tried) - len(left)} of {len(tried)} found\n")
    sys.stdout.flush()
    return len(tried), left


def report(results: dict[str, tuple[int, list[Change]]], command: str) -> str:
    """The result as a page."""
    tried = sum(count for count, _ in results.values())
    found = tried - sum(len(left) for _, left in results.values())
    lines = [
        "# How much of the mathematics the tests hold",
        "",
        f"Made at commit `{commit_here()}` with `{command}`. One small change at a time (a sign, an operator, a "
        f"comparison, a number): **{found} of {tried} = {100 * found / max(tried, 1):.0f} %** are found by the "
        "module's own tests. What is not found is listed; some of it changes nothing that could be seen.",
        "",
        "| module | found | of |",
        "|---|--:|--:|",
        *(
            f"| `{name}` | {count - len(left)} | {count} |"
            for name, (count, left) in results.items()
        ),
        "",
        "## Not found",
        "",
        *(
            f"- `{change.module}`:{change.line}: `{change.was}` → `{change.now}`"
            for _, left in results.values()
            for change in left
        ),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Change, test, count."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--most", type=int, default=60, help="changes a module (60)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (1)")
    parser.add_argument("--only", default="", help="modules with this in their name")
    parser.add_argument("--report", type=Path, help="write a page there")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = scratch
        chosen = {name: tests for name, tests in MATHEMATICS.items() if options.only in name}
        results = {
            name: judge(name, tests, options.most, options.seed) for name, tests in chosen.items()
        }
    chosen_by = " ".join(
        f"--{word} {getattr(options, word)}"
        for word in ("most", "seed", "only")
        if getattr(options, word) != parser.get_default(word)
    )
    page = report(results, f'make mutate MUTATE="{chosen_by}"' if chosen_by else "make mutate")
    if options.report is not None:
        options.report.parent.mkdir(parents=True, exist_ok=True)
        options.report.write_text(page, encoding="utf-8")
    sys.stdout.write(page.split("\n\n")[1] + "\n")


if __name__ == "__main__":
    main()
