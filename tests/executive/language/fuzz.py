"""Mutation fuzzer of everything that reads a file: trees, scenarios, XML, expressions.

    python tests/executive/language/fuzz.py --cases 100000 --seed 1

Each case takes a good file, breaks it, and reads it. Every error must be a finding: no traceback, no hang.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import math
import random
import sys
import time
import traceback
from collections.abc import Callable
from pathlib import Path

from pomona.executive.language import TreeFileError, build, check, format_findings, read
from pomona.executive.registry import Registry
from pomona.executive.skill_testing import BenchContext
from pomona.tools.dashboard.drawing import show_svg, show_text
from pomona.tools.groot.export_xml import export_groot
from pomona.tools.groot.import_xml import import_groot
from pomona.tools.scenarios.run_scenario import run_scenario
from pomona.tools.scenarios.scenario import read_scenario

REPOSITORY = Path(__file__).resolve().parents[3]
SLOW = 2.0
"""Seconds of processor time after which a case counts as a hang."""

TOKENS = (
    "{", "}", "[", "]", ":", ": ", "- ", ",", '"', "'", "#", " # x", "|", ">", "&a ", "*a",
    "!!python/object:os.system ", "? ", "%", "@", "`", "\t", "\n", "\n  ", "\n    - ", "---\n", "...\n", "null",
    "~", "true", "none", "0", "-1", "1e999", "99999999999999999999", "3 mm", "5 s", "inf", ".nan",
    "{retry.attempt}", "{failure.code}", "{x}", "{item}", "\ud7ff", "é", "\u2028", "\x00", "\x1b", "\U0001f34e",
    "sequence", "fallback", "parallel", "retry", "timeout", "on_failure", "for_each", "when", "guard", "root",
    "subtrees", "file", "in", "out", "type", "default", "choices", "perceive", "Detect", "Plan", "name", "force",
    "set", "check",
    "if", "then", "else", "switch", "cases",
    "delay", "rate", "run_once",
    "and", "or", "not", "(", ")", "+", "*", "/", "==", "<", "in [",
)  # fmt: skip


def mutate(text: str, others: list[str], rng: random.Random) -> str:
    """One to six random changes."""
    for _ in range(rng.choice((1, 1, 2, 3, 6))):
        text = rng.choice(CHANGES)(text, others, rng)[:20_000]
    return text


def _span(text: str, rng: random.Random, longest: int) -> tuple[int, int]:
    start = rng.randrange(len(text) + 1)
    return start, min(len(text), start + rng.randrange(longest + 1))


def _insert(text: str, _others: list[str], rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(TOKENS) + text[at:]


def _delete(text: str, _others: list[str], rng: random.Random) -> str:
    start, end = _span(text, rng, 40)
    return text[:start] + text[end:]


def _replace(text: str, _others: list[str], rng: random.Random) -> str:
    start, end = _span(text, rng, 12)
    return text[:start] + rng.choice(TOKENS) + text[end:]


def _character(text: str, _others: list[str], rng: random.Random) -> str:
    at = rng.randrange(len(text) + 1)
    return (
        text[:at]
        + chr(rng.choice((rng.randrange(32, 127), rng.randrange(0x20, 0xD7FF))))
        + text[at + 1 :]
    )


def _repeat(text: str, _others: list[str], rng: random.Random) -> str:
    start, end = _span(text, rng, 60)
    return text[:end] + text[start:end] * rng.choice((1, 2, 50)) + text[end:]


def _splice(text: str, others: list[str], rng: random.Random) -> str:
    start, end = _span(text, rng, 200)
    other = rng.choice(others)
    a, b = _span(other, rng, 200)
    return text[:start] + other[a:b] + text[end:]


def _lines(text: str, _others: list[str], rng: random.Random) -> str:
    lines = text.split("\n")
    a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(4)
    if kind == 0:
        lines[a], lines[b] = lines[b], lines[a]
    elif kind == 1:
        lines.insert(b, lines[a])
    elif kind == 2:
        lines[a] = " " * rng.randrange(9) + lines[a].lstrip()
    else:
        del lines[a]
    return "\n".join(lines)


CHANGES: tuple[Callable[[str, list[str], random.Random], str], ...] = (
    _insert, _insert, _delete, _replace, _replace, _character, _repeat, _splice, _lines, _lines,
)  # fmt: skip


def try_tree(text: str, skills: Registry) -> None:
    """Everything that is done with a tree file."""
    document = read(text, "tree.yaml")
    findings = check(document, skills, overrides=["attempts=3"] if "attempts" in text else ())
    format_findings(findings)
    show_text(document)
    show_svg(document)
    with contextlib.suppress(TreeFileError):
        build(document, skills, context=BenchContext())
    with contextlib.suppress(TreeFileError):
        import_groot(export_groot(document, skills), "tree.xml")


def try_scenario(text: str, skills: Registry, folder: Path) -> None:
    """A scenario that tests a good tree."""
    scenario = read_scenario(text, folder / "scenario.yaml", skills)
    with contextlib.suppress(TreeFileError):
        run_scenario(scenario, skills)


def try_xml(text: str) -> None:
    """Try XML; the result is a tree file again."""
    translated, _ = import_groot(text, "tree.xml")
    if translated:
        read(translated, "tree.yaml")


def fuzz(
    cases: int,
    seed: int,
    trees: list[str],
    skills: Registry,
    attempt: Callable[[str], None],
    slow: float = math.inf,
) -> list[str]:
    """Try a number of cases; return the texts that failed, or took more than `slow` seconds, with the error."""
    broken = []
    for case in range(cases):
        rng = random.Random(f"{seed}/{case}")
        text = mutate(rng.choice(trees), trees, rng)
        started = time.process_time()
        try:
            attempt(text)
        except Exception:
            broken.append(f"case {seed}/{case}\n{traceback.format_exc()}\n{text[:2000]!r}")
        if time.process_time() - started > slow:
            broken.append(
                f"case {seed}/{case} took {time.process_time() - started:.1f} s\n{text[:2000]!r}"
            )
        if len(broken) >= 5:
            break
    return broken


def installed_trees() -> list[str]:
    """All tree files that come with the package."""
    return [path.read_text() for path in sorted((REPOSITORY / "trees").glob("*.yaml"))]


DUMMIES = "pomona_dummy_skills"


def dummy_skills() -> Registry:
    """The skills of the tests."""
    spec = importlib.util.spec_from_file_location(DUMMIES, Path(__file__).with_name("conftest.py"))
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[DUMMIES] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return Registry({skill.__name__: skill for skill in module.SKILLS})


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    order = parser.parse_args()
    skills = dummy_skills()
    trees = [sys.modules[DUMMIES].PICK_APPLE, *installed_trees()]
    xml = [export_groot(read(text, "t.yaml"), skills) for text in trees]
    started = time.perf_counter()
    broken = fuzz(
        order.cases * 9 // 10, order.seed, trees, skills, lambda text: try_tree(text, skills), SLOW
    )
    broken += fuzz(order.cases // 10, order.seed, xml, skills, try_xml, SLOW)
    print(
        f"{order.cases} cases in {time.perf_counter() - started:.0f} s, {len(broken)} of them broke something"
    )
    print("\n\n".join(broken))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
