"""A small interpreter of trees with leaves that take time and claim devices, written from the language page alone.

    python tests/executive/language/reference.py --trees 100000 --seed 0
    python tests/executive/language/reference.py --trees 100000 --first 40000     # a part of them: from 40 000 on

It knows nothing of py_trees, of expressions and of the builder: a node is a state machine with `tick` and `halt`.
Random trees run in it and in the executive, tick by tick; the root's status and every start, end and interruption of a
leaf must be the same.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pomona.executive.cell.cell import dry_cell
from pomona.executive.language import build, read
from pomona.executive.registry import Registry
from pomona.executive.running.compute import Computations
from pomona.executive.running.tick import RunContext
from pomona.executive.skill import Interrupted, Skill, Work

PERIOD = 0.02
TICKS = 80
RUNNING, SUCCESS, FAILURE, SKIPPED = "RUNNING", "SUCCESS", "FAILURE", "SKIPPED"
Event = tuple[int, str, str]


@dataclass
class World:
    """Time, the value of conditions, the owner of each device, and the events."""

    tick: int = 0
    held: dict[str, Leaf] = field(default_factory=dict)
    halting: list[list[Any]] = field(default_factory=list)
    log: list[Event] = field(default_factory=list)

    @property
    def now(self) -> float:
        return self.tick * PERIOD

    def end_of_tick(self) -> None:
        for entry in self.halting:
            entry[1] -= 1
            if entry[1] == 0:
                entry[0].release(self)
        self.halting = [entry for entry in self.halting if entry[1] > 0]


class Node:
    """A node; `running` is True after a tick that left it running."""

    running = False

    def tick(self, world: World) -> str:
        fresh, self.running = not self.running, True
        if fresh and isinstance(self, Branch):
            self.forget()
        status = self.step(world, fresh)
        if status != RUNNING:
            self.stop_children(world)
        self.running = status == RUNNING
        return status

    def halt(self, world: World) -> None:
        if self.running:
            self.running = False
            self.halted()
            self.stop_children(world)
            self.forget()

    def forget(self) -> None:
        """Forget the success that a rate counts from: an outer node begins afresh."""
        for child in self.children():
            child.forget()

    def stop_children(self, world: World) -> None:
        for child in self.children():
            child.halt(world)

    def step(self, world: World, fresh: bool) -> str:
        raise NotImplementedError

    def children(self) -> list[Node]:
        return []

    def halted(self) -> None:
        pass


class Leaf(Node):
    """Takes some ticks, then ends; when it is interrupted, letting go takes some, too."""

    def __init__(
        self, name: str, jobs: list[tuple[int, bool]], letting_go: int, devices: tuple[str, ...]
    ) -> None:
        self.name, self.jobs, self.letting_go, self.devices = name, jobs, letting_go, devices
        self.starts = self.left = 0
        self.at_work = False

    def step(self, world: World, fresh: bool) -> str:
        if fresh:
            self.starts += 1
            self.at_work = False
        if not self.at_work:
            if any(device in world.held for device in self.devices):
                return RUNNING
            self.at_work = True
            world.held.update(dict.fromkeys(self.devices, self))
            self.left = self.job[0]
            world.log.append((world.tick, self.name, "start"))
        if self.left > 0:
            self.left -= 1
            return RUNNING
        self.release(world)
        world.log.append((world.tick, self.name, "end"))
        return SUCCESS if self.job[1] else FAILURE

    @property
    def job(self) -> tuple[int, bool]:
        return self.jobs[min(self.starts, len(self.jobs)) - 1]

    def halt(self, world: World) -> None:
        if self.running and self.at_work:
            world.log.append((world.tick, self.name, "halt"))
            if self.letting_go:
                world.halting.append([self, self.letting_go])
            else:
                self.release(world)
        self.running = False

    def release(self, world: World) -> None:
        for device in self.devices:
            del world.held[device]


class Branch(Node):
    def __init__(self, *nodes: Node) -> None:
        self.nodes = list(nodes)
        self.at = 0
        self.seen: list[str] = []

    def children(self) -> list[Node]:
        return self.nodes


class InOrder(Branch):
    """Sequences and fallbacks: `stops` is the end of a child that ends the whole."""

    def __init__(self, stops: str, reactive: bool, keeps: bool, *nodes: Node) -> None:
        super().__init__(*nodes)
        self.stops, self.reactive, self.keeps = stops, reactive, keeps

    def step(self, world: World, fresh: bool) -> str:
        if fresh or self.reactive:
            self.seen = []
        if (fresh and not self.keeps) or self.reactive:
            self.at = 0
        while self.at < len(self.nodes):
            status = self.nodes[self.at].tick(world)
            if status in (RUNNING, self.stops):
                for later in self.nodes[self.at + 1 :]:
                    later.halt(world)
                    if self.reactive:
                        later.forget()
                return status
            self.seen.append(status)
            self.at += 1
        self.at = 0
        if len(self.seen) == len(self.nodes) and set(self.seen) == {SKIPPED}:
            return SKIPPED
        return SUCCESS if self.stops == FAILURE else FAILURE


class Parallel(Branch):
    def __init__(self, needed: list[int] | int, *nodes: Node) -> None:
        super().__init__(*nodes)
        self.needed = needed
        self.done: set[int] = set()

    def step(self, world: World, fresh: bool) -> str:
        if fresh:
            self.done = set()
        skipped: set[int] = set()
        for index, node in enumerate(self.nodes):
            if index in self.done:
                continue
            status = node.tick(world)
            if status == FAILURE:
                return FAILURE
            (self.done if status == SUCCESS else skipped if status == SKIPPED else set()).add(index)
            if isinstance(self.needed, int):
                if len(self.done) >= self.needed:
                    return SUCCESS
            elif set(self.needed) <= self.done | skipped:
                return SUCCESS
        return SKIPPED if len(skipped) == len(self.nodes) else RUNNING


class Tries(Branch):
    """Retry: the second node follows a failed try."""

    def __init__(self, total: int, *nodes: Node) -> None:
        super().__init__(*nodes)
        self.total = total

    def step(self, world: World, fresh: bool) -> str:
        if fresh:
            self.tried, self.recovering = 0, False
        if self.recovering:
            status = self.nodes[1].tick(world)
            if status == RUNNING:
                return RUNNING
            self.recovering = False
            if status == FAILURE:
                return FAILURE
            return FAILURE if self.tried == self.total else RUNNING
        status = self.nodes[0].tick(world)
        if status != FAILURE:
            return status
        self.tried += 1
        last = self.tried == self.total
        if len(self.nodes) > 1:
            self.recovering = True
            return RUNNING
        return FAILURE if last else RUNNING


class Choose(Branch):
    """If: the first node decides. `reactive` asks in every tick."""

    def __init__(self, reactive: bool, *nodes: Node) -> None:
        super().__init__(*nodes)
        self.reactive = reactive

    def step(self, world: World, fresh: bool) -> str:
        if fresh:
            self.chosen: Node | None = None
        if self.chosen is None or self.reactive:
            asked = self.nodes[0].tick(world)
            if asked in (RUNNING, SKIPPED):
                for other in self.nodes[1:]:
                    other.halt(world)
                return asked
            chosen = (
                self.nodes[1]
                if asked == SUCCESS
                else self.nodes[2]
                if len(self.nodes) > 2
                else None
            )
            for other in self.nodes[1:]:
                if other is not chosen:
                    other.halt(world)
            self.chosen = chosen
        return SKIPPED if self.chosen is None else self.chosen.tick(world)


class Look(Node):
    """A check."""

    def __init__(self, holds: Callable[[int], bool]) -> None:
        self.holds = holds

    def step(self, world: World, fresh: bool) -> str:
        return SUCCESS if self.holds(world.tick) else FAILURE


class Timed(Node):
    """Waits for a while, or until something holds."""

    def __init__(self, over: Callable[[World, float], bool]) -> None:
        self.over = over

    def step(self, world: World, fresh: bool) -> str:
        if fresh:
            self.since = world.now
        return SUCCESS if self.over(world, world.now - self.since) else RUNNING


class Pick(Branch):
    """Switch: the case of the value, looked at in every tick; the last node when none fits and there is one more."""

    def __init__(self, words: list[str], *nodes: Node) -> None:
        super().__init__(*nodes)
        self.words = words

    def step(self, world: World, fresh: bool) -> str:
        chosen = next(
            (n for w, n in zip(self.words, self.nodes, strict=False) if w == str(world.tick)), None
        )
        chosen = chosen or next(iter(self.nodes[len(self.words) :]), None)
        for other in self.nodes:
            if other is not chosen:
                other.halt(world)
        return SKIPPED if chosen is None else chosen.tick(world)


class Around(Node):
    """A modifier around one node, by its word."""

    def __init__(self, word: str, value: Any, inner: Node) -> None:
        self.word, self.value, self.inner = word, value, inner
        self.once = False
        self.since: float | None = None

    def children(self) -> list[Node]:
        return [self.inner]

    def forget(self) -> None:
        super().forget()
        self.since = None

    def step(self, world: World, fresh: bool) -> str:
        before = getattr(self, f"before_{self.word}", None)
        early = before(world, fresh) if before is not None else None
        if early is not None:
            return str(early)
        status = self.inner.tick(world)
        if status == SKIPPED:
            self.since = None
            if self.word != "for_each":
                return status
        return str(getattr(self, f"after_{self.word}")(world, status))

    def before_timeout(self, world: World, fresh: bool) -> None:
        if fresh:
            self.end = world.now + self.value

    def after_timeout(self, world: World, status: str) -> str:
        return FAILURE if status == RUNNING and world.now >= self.end - 1e-9 else status

    def after_invert(self, _world: World, status: str) -> str:
        return {SUCCESS: FAILURE, FAILURE: SUCCESS}.get(status, status)

    def after_force(self, _world: World, status: str) -> str:
        return status if status == RUNNING else str(self.value).upper()

    def before_delay(self, world: World, fresh: bool) -> str | None:
        if fresh:
            self.end = world.now + self.value
        return RUNNING if not self.inner.running and world.now < self.end - 1e-9 else None

    def after_delay(self, _world: World, status: str) -> str:
        return status

    def before_repeat(self, _world: World, fresh: bool) -> None:
        if fresh:
            self.rounds = 0

    def after_repeat(self, _world: World, status: str) -> str:
        self.rounds += status == SUCCESS
        return RUNNING if status == SUCCESS and self.rounds < self.value else status

    def before_rate(self, world: World, fresh: bool) -> str | None:
        if fresh:
            self.due = world.now if self.since is None else self.since + 1 / self.value
            self.since = None
        return RUNNING if not self.inner.running and world.now < self.due - 1e-9 else None

    def after_rate(self, world: World, status: str) -> str:
        self.since = world.now if status == SUCCESS else None
        return status

    def before_for_each(self, _world: World, fresh: bool) -> str | None:
        if fresh:
            self.items = 0
        return None

    def after_for_each(self, _world: World, status: str) -> str:
        if status in (RUNNING, FAILURE):
            return status
        self.items += 1
        return RUNNING if self.items < self.value else SUCCESS

    def before_disabled(self, _world: World, _fresh: bool) -> str:
        return SKIPPED

    def before_run_once(self, _world: World, fresh: bool) -> str | None:
        return SKIPPED if fresh and self.once else None

    def after_run_once(self, _world: World, status: str) -> str:
        self.once = self.once or status != RUNNING
        return status

    def before_guard(self, world: World, _fresh: bool) -> str | None:
        return None if self.value(world.tick) else FAILURE

    def after_guard(self, _world: World, status: str) -> str:
        return status

    def before_when(self, world: World, fresh: bool) -> str | None:
        return SKIPPED if fresh and not self.value(world.tick) else None

    def after_when(self, _world: World, status: str) -> str:
        return status


# ------------------------------------------------------------------------------------------- random trees

CONDITIONS: tuple[tuple[str, Callable[[int], bool]], ...] = (
    ("1 == 1", lambda n: True),
    ("1 == 2", lambda n: False),
    ("{n} < 4", lambda n: n < 4),
    ("{n} > 5", lambda n: n > 5),
    ("{n} != 3", lambda n: n != 3),
    ("{n} > 2 and {n} < 9", lambda n: 2 < n < 9),
)
DEVICES = ("Arm", "Gripper")


@dataclass
class Case:
    """A random tree: its text, the same for the interpreter, and its leaves."""

    rng: random.Random
    leaves: dict[str, Leaf] = field(default_factory=dict)
    subtrees: list[str] = field(default_factory=list)
    files: dict[str, str] | None = None
    """Texts of files of their own, by name; None when every subtree stands in the same file."""
    names: int = 0

    def node(self, depth: int) -> tuple[str, Node]:
        text, node = self.leaf() if depth == 0 or self.rng.random() < 0.25 else self.branch(depth)
        return self.modified(text, node, depth)

    def leaf(self) -> tuple[str, Node]:
        if self.rng.random() < 0.15:
            text, holds = self.rng.choice(CONDITIONS)
            return f"check: '{text}'", Look(holds)
        if self.rng.random() < 0.12:
            return self.instant()
        name = f"L{len(self.leaves)}"
        jobs = [
            (self.rng.choice((0, 0, 1, 2, 5)), self.rng.random() < 0.6)
            for _ in range(self.rng.randint(1, 3))
        ]
        devices = tuple(device for device in DEVICES if self.rng.random() < 0.3)
        leaf = self.leaves[name] = Leaf(name, jobs, self.rng.choice((0, 0, 1, 3)), devices)
        return f"{'With'.join(('Job', *devices))}: {{}}, name: {name}", leaf

    def instant(self) -> tuple[str, Node]:
        """Leaves of the language's own."""
        text, holds = self.rng.choice(CONDITIONS)
        pause = self.rng.randint(0, 3)
        return self.rng.choice(
            [
                (
                    f"wait: {pause * PERIOD * 1000:.0f} ms",
                    Timed(lambda _, past: past >= pause * PERIOD - 1e-9),
                ),
                (f"wait_until: '{text}'", Timed(lambda world, _: holds(world.tick))),
                ("succeed: {}", Look(lambda _: True)),
                ("fail: {code: NO}", Look(lambda _: False)),
                ("set: {v: 1}", Look(lambda _: True)),
                (
                    "ask: 'Go on?', default: 'yes'",
                    Look(lambda _: True),
                ),  # nobody is there to answer
                ("ask: 'Go on?', within: 1 s", Look(lambda _: False)),
            ]
        )

    def called(self, depth: int) -> tuple[str, Node]:
        """A subtree of the same file, or of one of its own."""
        before = len(self.subtrees)
        body, node = self.node(depth - 1)
        self.names += 1
        name = f"s{self.names}"
        if self.files is not None and self.rng.random() < 0.5:
            inner = subtrees_of(self.subtrees[before:])
            del self.subtrees[before:]
            head = f"pomona: 1\ntree: {name}\nparameters: {{n: {{type: int, default: 0}}}}\n"
            self.files[f"{name}.yaml"] = f"{head}root: {{{body}}}\n{inner}"
            self.subtrees.append(f"{name}: {{file: {name}.yaml}}")
        else:
            self.subtrees.append(f"{name}: {{in: {{n: int}}, root: {{{body}}}}}")
        return f"{name}: {{n: '{{n}}'}}", node

    def branch(self, depth: int) -> tuple[str, Node]:
        word = self.rng.choice(
            ("sequence", "sequence", "fallback", "fallback", "parallel", "parallel", "reactive_sequence", "if",
             "reactive_fallback", "sequence_with_memory", "reactive_if", "switch", "subtree")
        )  # fmt: skip
        if word == "subtree":
            return self.called(depth)
        count = {
            "if": self.rng.randint(2, 3),
            "reactive_if": self.rng.randint(2, 3),
        }.get(word)
        parts = [self.node(depth - 1) for _ in range(count or self.rng.randint(1, 3))]
        texts, nodes = [f"{{{text}}}" for text, _ in parts], [node for _, node in parts]
        if word in ("if", "reactive_if"):
            words = (word, "then", "else")
            text = ", ".join(f"{key}: {value}" for key, value in zip(words, texts, strict=False))
            return text, Choose(word == "reactive_if", *nodes)
        if word == "switch":
            words = [str(self.rng.randint(0, 9)) for _ in nodes[1:]] or ["3"]
            words = sorted(set(words), key=words.index)
            cases = ", ".join(f"'{key}': {value}" for key, value in zip(words, texts, strict=False))
            rest = f", default: {texts[len(words)]}" if len(words) < len(texts) else ""
            used = len(words) + bool(rest)
            return f"switch: '{{n}}', cases: {{{cases}}}{rest}", Pick(words, *nodes[:used])
        text = f"{word}: [{', '.join(texts)}]"
        if word == "parallel":
            if self.rng.random() < 0.4:
                return f"{text}, success_on: one", Parallel(1, *nodes)
            if self.rng.random() < 0.4:
                least = self.rng.randint(1, len(nodes))
                return f"{text}, success_on: {least}", Parallel(least, *nodes)
            return text, Parallel(list(range(len(nodes))), *nodes)
        stops = SUCCESS if "fallback" in word else FAILURE
        return text, InOrder(stops, "reactive" in word, word == "sequence_with_memory", *nodes)

    def modified(self, text: str, node: Node, depth: int) -> tuple[str, Node]:
        rng = self.rng

        def some(word: str, value: str, meaning: Any) -> None:
            nonlocal text, node
            if rng.random() < 0.08:
                text, node = f"{text}, {word}: {value}", Around(word, meaning, node)

        limit = rng.randint(1, 6) * PERIOD
        some("timeout", f"{limit * 1000:.0f} ms", limit)
        some("invert", "true", None)
        end = rng.choice(("success", "failure"))
        some("force", end, end)
        pause = rng.randint(0, 4) * PERIOD
        some("delay", f"{pause * 1000:.0f} ms", pause)
        starts = rng.choice((10, 20, 50))
        some("rate", f"{starts} Hz", starts)
        if rng.random() < 0.1:
            total, nodes = rng.randint(1, 3), [node]
            text += f", retry: {total}"
            if depth and rng.random() < 0.4:
                after_text, after = self.node(0)
                nodes.append(after)
                text += f", on_failure: {{{after_text}}}"
            node = Tries(total, *nodes)
        rounds = rng.randint(1, 3)
        some("repeat", str(rounds), rounds)
        items = rng.randint(1, 3)
        self.names += 1
        some("for_each", f"{list(range(items))}, as: i{self.names}", items)
        some("run_once", "true", None)
        for word in ("guard", "when"):
            said, holds = rng.choice(CONDITIONS)
            some(word, f"'{said}'", holds)
        if rng.random() < 0.03:
            text, node = f"{text}, disabled: true", Around("disabled", None, node)
        if rng.random() < 0.05:
            text += f", breakpoint: {rng.choice(('before', 'after'))}"  # nobody is there to go on: it holds nothing
        return text, node


def subtrees_of(written: list[str]) -> str:
    """The part of a file that holds them."""
    return "".join(["subtrees:\n", *(f"  {subtree}\n" for subtree in written)]) if written else ""


# ------------------------------------------------------------------------------------------- the executive's side


class Context(RunContext):
    """A real run's context, on a cell without devices; it notes the events of leaves."""

    def __init__(self) -> None:
        cell = dry_cell()
        super().__init__(cell, Computations(lambda *_: None), 0, lambda *_: None)
        self.world_clock = cell.clock  # a skill sees a clock that it cannot advance
        self.tick = 0
        self.log: list[Event] = []


class Arm: ...


class Gripper: ...


class Job(Skill):
    """Behaves as the interpreter's leaf of the same name."""

    failures = ("NO",)
    leaf: Leaf

    def run(self) -> Work:
        context = self.context
        assert isinstance(context, Context)
        context.log.append((context.tick, self.name, "start"))
        duration, succeeds = self.leaf.jobs[min(self.starts, len(self.leaf.jobs)) - 1]
        try:
            for _ in range(duration):
                yield None
        except Interrupted:
            context.log.append((context.tick, self.name, "halt"))
            for _ in range(self.leaf.letting_go):
                yield None
            raise
        context.log.append((context.tick, self.name, "end"))
        if not succeeds:
            raise self.failure("NO", "told to fail")


JOBS = Registry(
    {
        name: type(name, (Job,), {"devices": devices})
        for name, devices in {
            "Job": (), "JobWithArm": (Arm,), "JobWithGripper": (Gripper,), "JobWithArmWithGripper": (Arm, Gripper),
        }.items()
    }
)  # fmt: skip


def differs(seed: str, through: Callable[[str], str] | None = None) -> str:
    """Return the difference between executive and interpreter for one random tree; empty without one. The executive
    gets the tree `through` a conversion that must not change its meaning.
    """
    rng = random.Random(seed)
    case = Case(rng, files={} if through is None else None)
    body, node = case.node(rng.randint(1, 3))
    text = f"pomona: 1\ntree: t\nroot: {{sequence: [{{set: {{n: 0}}}}, {{{body}}}]}}\n{subtrees_of(case.subtrees)}"
    text = text if through is None else through(text)
    context, world = Context(), World()
    tree = build(read(text, "t.yaml", texts=case.files or {}), JOBS, context=context)
    for skill in tree.skills:
        skill.leaf = case.leaves[skill.name]
    root = InOrder(FAILURE, False, False, Look(lambda _: True), node)
    for tick in range(TICKS):
        world.tick = context.tick = tick
        tree.board.write("/n", tick, "test")
        if tick == 0:
            tree.board.tick = 1
        tree.root.tick_once()
        expected = root.tick(world)
        found = tree.root.status.name
        if (found, context.log) != (expected, world.log):
            return f"{text}{case.files}\ntick {tick}: {found}, expected {expected}\n{context.log}\n{world.log}"
        world.end_of_tick()
        context.drive_halting()
        context.world_clock.advance(PERIOD)
        if expected != RUNNING:
            break
    if root.running:
        tree.root.stop(type(tree.root.status).INVALID)
        root.halt(world)
        if context.log != world.log:
            return f"{text}{case.files}\nhalt: {context.log}\n{world.log}"
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trees", type=int, default=100_000)
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first tree, to go on with a part"
    )
    parser.add_argument("--seed", type=int, default=0)
    order = parser.parse_args()
    started = time.perf_counter()
    broken: list[str] = []
    for number in range(order.first, order.trees):
        if told := differs(f"{order.seed}/{number}"):
            broken.append(told)
        if (number + 1) % 1000 == 0 or number + 1 == order.trees:
            past = time.perf_counter() - started
            print(
                f"trees {order.first} to {number}: {len(broken)} differ, {past:.0f} s", flush=True
            )
    print("\n\n".join(sorted(broken, key=len)[:3]))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
