"""Runs imported trees beside BehaviorTree.CPP itself, tick by tick, with leaves that do the same in both.

    python -m benchmarks.import_compared ORIGINAL FOLDER...       # the trees of repositories, see import_foreign
    python -m benchmarks.import_compared ORIGINAL --random 2000   # random trees of BehaviorTree.CPP's own nodes

ORIGINAL is the program of `import_original.cpp`. A hash of a leaf's name and number sets the ticks and the end of each
start. The root's status and every start, end and interruption of a leaf must be the same in every tick; where nodes
begin again (retries, repetitions, loops) or hand the tick back on their way (`SequenceWithMemory`), the order of all of
them only: here a try takes a tick at least, and a sequence goes on at once. Left out are trees whose tries take other
ticks than the nodes beside them in a parallel, trees with clocks (`Timeout`, `Sleep`, `Delay`: BehaviorTree.CPP's is
the wall's), trees that need nodes that BehaviorTree.CPP has not, and those that it ends with an exception; how many
there are is printed.
"""

from __future__ import annotations

import argparse
import collections
import random
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.import_foreign import missing_in, refused_by_the_original, stand_ins, trees_in
from pomona.executive.language import build, check, read
from pomona.executive.registry import Registry
from pomona.executive.skill import Interrupted, Skill, Work
from pomona.executive.skill_testing import BenchContext
from pomona.executive.values.findings import Findings
from pomona.tools.groot.files import Forest
from pomona.tools.groot.import_xml import import_groot
from pomona.tools.groot.keys import small

TICKS = 40
PERIOD = 0.02
_CLOCKS = re.compile(r"<(Timeout|Sleep|Delay)\b")
_AGAIN = re.compile("<(SequenceWithMemory|Async|Retry|Repeat|KeepRunning|Loop|RecoveryNode)")
_MISSING = re.compile(r"nothing writes '(\w+)'")


def hashed(text: str) -> int:
    """FNV-1a of 32 bits, with its high bits folded in."""
    found = 2166136261
    for byte in text.encode():
        found = (found ^ byte) * 16777619 & 0xFFFFFFFF
    return found ^ found >> 15


@dataclass
class LeafRun:
    """Scripted leaves of one run, and the events so far."""

    seed: str
    starts: dict[str, int] = field(default_factory=lambda: collections.defaultdict(int))
    events: list[str] = field(default_factory=list)

    def leaf(self, name: str, stand_in: type[Skill]) -> type[Skill]:
        """Return a skill that behaves as the original's leaf of this name."""
        run = self

        def work(self: Skill, **given: object) -> Work[None]:
            run.starts[name] += 1
            job = hashed(f"{run.seed}/{name}/{run.starts[name]}")
            run.events.append(f"start:{name}")
            try:
                for _ in range(job % 3):
                    yield None
            except Interrupted:
                run.events.append(f"halt:{name}")
                raise
            success = (job >> 4) % 8 < 5
            run.events.append(f"{'success' if success else 'failure'}:{name}")
            if not success:
                raise self.failure("FAILED", "scripted failure")

        return type(
            name, (Skill,), {"inputs": stand_in.inputs, "failures": ("FAILED",), "run": work}
        )


def here(text: str, seed: str, stand: Registry) -> list[str]:
    """Return the events in each tick of the executive."""
    run, context = LeafRun(seed), BenchContext()
    skills = Registry({name: run.leaf(name, skill) for name, skill in stand.items()})
    tree = build(read(text, "t.yaml"), skills, context=context)
    told: list[str] = []
    status = "RUNNING"
    while status == "RUNNING" and len(told) < TICKS:
        run.events.clear()
        tree.board.tick += 1
        tree.root.tick_once()
        context.clock.advance(PERIOD)
        status = {"INVALID": "SUCCESS"}.get(tree.root.status.name, tree.root.status.name)
        told.append(" ".join([status, *run.events]))
    run.events.clear()
    tree.root.stop(type(tree.root.status).INVALID)
    return [*told, " ".join(["halted", *run.events])]


def there(original: Path, xml: Path, leaves: str, seed: str) -> list[str] | None:
    """Return the events in each tick of BehaviorTree.CPP; None when it ends with an exception."""
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        file.write(leaves)
        file.flush()
        order = [str(original), str(xml), file.name, seed, str(TICKS)]
        done = subprocess.run(order, capture_output=True, text=True, check=False, timeout=60)
    told = done.stdout.replace(
        "SKIPPED", "SUCCESS"
    )  # a tree that is skipped as a whole has succeeded here
    return told.splitlines() if done.returncode == 0 else None


@dataclass
class ComparedTrees:
    """How many trees do the same, and why others were not compared."""

    original: Path
    runs: int
    same: int = 0
    counts: collections.Counter[str] = field(default_factory=collections.Counter)
    differ: list[str] = field(default_factory=list)

    def compare(self, place: str, xml: str, path: Path) -> None:
        """Run one tree in both, several times."""
        reason = self.left_out(place, xml, path)
        self.counts[reason or "compared"] += 1

    def left_out(self, place: str, xml: str, path: Path) -> str:
        if _CLOCKS.search(xml):
            return "has a clock"
        forest = Forest(Findings())
        forest.read([(xml, path)])
        if _AGAIN.search(xml) and "<Parallel" in xml:
            return "begins again beside a parallel"
        text, findings = import_groot(xml, path)
        if findings:
            return "is not carried over"
        stand = stand_ins(read(text, "t.yaml"), writes=False)
        missing = {
            name for f in check(read(text, "t.yaml"), stand) for name in _MISSING.findall(f.message)
        }
        for run in range(self.runs):
            seed = f"{place}/{run}"
            given = {name: hashed(f"{seed}/{name}") % 3 for name in sorted(missing)}
            declared = (
                "constants: {"
                + ", ".join(f"{name}: {value}" for name, value in given.items())
                + "}\n"
            )
            tree = text.replace("\nroot:", f"\n{declared if given else ''}root:", 1)
            errors = [
                finding
                for finding in check(read(tree, "t.yaml"), stand)
                if finding.severity == "error"
            ]
            if errors:
                return f"the check: {errors[0].code}: {errors[0].message}"
            told = [f"leaf {name} {' '.join(skill.inputs)}" for name, skill in stand.items()]
            told += [
                f"set {word} {given[small(word)]}"
                for word in set(re.findall(r"\w+", xml))
                if small(word) in given
            ]
            expected = there(self.original, path, "\n".join(told), seed)
            if expected is None:
                return "the original ends with an exception"
            found = here(tree, seed, stand)
            if _AGAIN.search(xml):
                expected, found = _in_order(expected), _in_order(found)
            if found != expected:
                both = "\n".join(
                    f"    {a:60} | {b}" for a, b in zip(expected + [""] * 40, found, strict=False)
                )
                self.differ.append(f"{place}, run {run}: original | here\n{xml}\n{text}\n{both}")
                return "differs"
        return ""

    def print(self) -> None:
        """Write the table."""
        print("\n\n".join(sorted(self.differ, key=len)[:5]))
        for reason, count in self.counts.most_common():
            print(f"{count:5d}  {reason}")


def _in_order(lines: list[str]) -> list[str]:
    """All events, and the last status; an unfinished run as far as both have come is not compared."""
    events = [word for line in lines[:-1] for word in line.split()[1:]]
    status = lines[-2].split()[0] if len(lines) > 1 else ""
    return [status] if status == "RUNNING" else [status, *events]


# ------------------------------------------------------------------------------------------- random trees


def random_xml(rng: random.Random) -> str:
    """A tree of BehaviorTree.CPP's own nodes; leaves `A` to `L`, keys `x` and `Y`."""
    inside = _node(rng, rng.randint(1, 4))
    called = '<BehaviorTree ID="S"><Sequence><Script code="own := 1; n += own"/><A/></Sequence></BehaviorTree>'
    return (
        '<root BTCPP_format="4" main_tree_to_execute="T"><BehaviorTree ID="T"><Sequence>'
        f'<Script code="x := 0; Y := 1"/>{inside}</Sequence></BehaviorTree>'
        f"{called if 'SubTree' in inside else ''}</root>"
    )


def _node(rng: random.Random, depth: int) -> str:
    if depth == 0 or rng.random() < 0.2:
        leaf = rng.choice("ABCDEFGHIJKL")
        return rng.choice(
            [f"<{leaf}{_conditions(rng)}/>"] * 6
            + [
                "<AlwaysSuccess/>",
                "<AlwaysFailure/>",
                '<Script code="x += 1"/>',
                '<ScriptCondition code="x &lt; 2"/>',
            ]
            + [
                '<SubTree ID="S" n="{x}"/>',
                '<SubTree ID="S" n="{Y}"/>',
                '<SetBlackboard output_key="x" value="{Y}"/>',
            ]
        )
    word, fewest, most = rng.choice(
        [("Sequence", 1, 3), ("Fallback", 1, 3), ("ReactiveSequence", 1, 3), ("ReactiveFallback", 1, 3),
         ("Parallel", 1, 3), ("IfThenElse", 2, 3), ("WhileDoElse", 3, 3),
         ("TryCatch", 2, 3), ("Switch2", 3, 3), ("Inverter", 1, 1), ("ForceSuccess", 1, 1), ("ForceFailure", 1, 1),
         ("RunOnce", 1, 1), ("Precondition", 1, 1), ("RetryUntilSuccessful", 1, 1), ("Repeat", 1, 1)]
    )  # fmt: skip
    more = {
        "Parallel": f' failure_count="1" success_count="{rng.choice(("-1", "1"))}"',
        "Switch2": ' variable="{x}" case_1="0" case_2="1"',
        "Precondition": f' if="x &lt; 2" else="{rng.choice(("SUCCESS", "FAILURE", "SKIPPED"))}"',
        "RetryUntilSuccessful": f' num_attempts="{rng.choice((1, 2, 3))}"',
        "Repeat": f' num_cycles="{rng.choice((1, 2, 3))}"',
    }.get(word, "")
    count = rng.randint(fewest, most)
    children = [_node(rng, depth - 1) for _ in range(count)]
    if word == "WhileDoElse":
        children[0] = f'<ScriptCondition code="x &lt; {rng.randint(0, 3)}"/>'
    if word == "Parallel" and 'success_count="1"' in more and count == 1:
        more = ' failure_count="1" success_count="-1"'
    return f"<{word}{more}{_conditions(rng)}>{''.join(children)}</{word}>"


def _conditions(rng: random.Random) -> str:
    scripts = {
        "_skipIf": "x == 1", "_successIf": "x == 2", "_failureIf": "x > 2", "_while": "x &lt; 3",
        "_onSuccess": "x += 1", "_onFailure": "Y += 1", "_post": "x -= 1",
    }  # fmt: skip
    return "".join(f' {name}="{script}"' for name, script in scripts.items() if rng.random() < 0.05)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("original", type=Path, help="the program of import_original.cpp")
    parser.add_argument("folder", type=Path, nargs="*", help="a checkout of a foreign repository")
    parser.add_argument(
        "--random", type=int, default=0, metavar="N", help="also so many random trees"
    )
    parser.add_argument(
        "--runs",
        type=int,
        default=5,
        help="how often each tree runs, with other results of its leaves",
    )
    parser.add_argument("--seed", type=int, default=0)
    order = parser.parse_args()
    failed = 0
    for folder in order.folder:
        table = ComparedTrees(order.original, order.runs)
        trees = list(trees_in(folder))
        with tempfile.TemporaryDirectory() as scratch:
            for number, tree in enumerate(trees):
                if refused_by_the_original(tree, trees) or missing_in(tree):
                    continue
                path = tree.path if tree.path.suffix == ".xml" else Path(scratch) / f"{number}.xml"
                if path != tree.path:
                    path.write_text(tree.text, encoding="utf-8")
                table.compare(f"{tree.path.relative_to(folder)}:{tree.line}", tree.text, path)
        print(folder)
        table.print()
        failed += len(table.differ)
    if order.random:
        table = ComparedTrees(order.original, 1)
        with tempfile.TemporaryDirectory() as scratch:
            path = Path(scratch) / "random.xml"
            for number in range(order.random):
                xml = random_xml(random.Random(f"{order.seed}/{number}"))
                path.write_text(xml, encoding="utf-8")
                table.compare(f"random {order.seed}/{number}", xml, path)
        table.print()
        failed += len(table.differ)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
